#include "src/command/interrupt.h"

#include <csignal>
#include <cstdlib>
#include <initializer_list>

namespace trex {
namespace {

volatile std::sig_atomic_t signal_ = 0;
volatile std::sig_atomic_t hangup_ = 0;

extern "C" void onSignal(int number) {
  if (number == SIGHUP) {
    hangup_ = 1;
    return;
  }
  if (signal_ != 0) std::_Exit(128 + number);
  signal_ = number;
}

}  // namespace

void catchInterrupts() {
  struct sigaction action {};
  action.sa_handler = onSignal;
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) sigaction(number, &action, nullptr);
}

int interruptedBy() { return signal_; }
bool hangupSeen() { return hangup_ != 0; }
void clearHangup() { hangup_ = 0; }

}  // namespace trex
