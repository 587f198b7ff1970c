#include "src/app/interrupt.h"

#include <csignal>
#include <cstdlib>

namespace trex {
namespace {

volatile std::sig_atomic_t signal_ = 0;

extern "C" void onSignal(int number) {
  if (signal_ != 0) std::_Exit(128 + number);
  signal_ = number;
}

}  // namespace

void catchInterrupts() {
  struct sigaction action {};
  action.sa_handler = onSignal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

int interruptedBy() { return signal_; }

}  // namespace trex
