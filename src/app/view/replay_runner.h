// Runs a replay script in the window and writes down what it measures.
#pragma once

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "src/app/view/loop.h"
#include "src/viewer/replay.h"

namespace trex {

class ReplayRunner {
 public:
  using Clock = std::chrono::steady_clock;

  /// `started`: when the program did.
  ReplayRunner(const ReplayScript& script, ViewLoop& loop, Viewer& viewer, Window& window, Ui& ui,
               double budgetSeconds, Clock::time_point started);

  /// Runs all steps. Returns 0, 3 if the model can't be opened, or 130 or 143 after a signal.
  /// Throws Error.
  int run();
  /// What was measured, as docs/viewer.md says.
  nlohmann::ordered_json report() const;

 private:
  /// Thrown to end the script early, with the exit code.
  struct Stop {
    int code = 0;
  };
  /// Turns of one step that had something to do.
  struct Turns {
    std::vector<double> frames, steps;  ///< seconds, whole turn and the viewer's part
    std::uint32_t longestWait = 0;      ///< frames that a tile was not served
  };
  /// Pictures that were presented while one settled.
  struct Shown {
    double seconds = 0.0;
    std::vector<std::uint8_t> rgba;
  };

  void step(const ReplayStep& step);
  void prepare(const ReplayStep& step);
  bool edit(const ReplayStep& step);
  void awaitCoarse(double start);
  void settle(const ReplayStep& step, double start);
  void goOn(const ReplayStep& step);
  void await(ReplayWait wait);
  void measureIdle(double seconds);
  void save(const ReplayStep& step);
  Turn turn(bool maySleep);
  template <typename Condition>
  void turnUntil(const char* what, const Condition& condition);
  double now() const;
  std::uint64_t pageBytes() const;
  void keep(double start);
  nlohmann::ordered_json figures(const Turns& turns) const;

  const ReplayScript& script_;
  ViewLoop& loop_;
  Viewer& viewer_;
  Window& window_;
  Ui& ui_;
  double budget_;
  Clock::time_point started_;
  Turns turns_, allTurns_;
  std::vector<Shown> shown_;
  std::optional<double> opened_, shownAt_, readyAt_;  ///< seconds since started_
  nlohmann::ordered_json entry_, entries_ = nlohmann::ordered_json::array();
};

}  // namespace trex
