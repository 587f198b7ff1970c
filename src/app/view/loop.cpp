#include "src/app/view/loop.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>

#include "src/command/interrupt.h"

namespace trex {
namespace {

/// Frames that ImGui needs until panels have settled after input.
constexpr int kSettlingFrames = 3;
/// Seconds between redraws of figures while no new picture comes.
constexpr double kFigures = 0.5;
/// Seconds that the loop sleeps at most: a signal is seen this late.
constexpr double kSleep = 0.25;
/// Seconds to wait where work goes on in the background alone.
constexpr double kBackground = 0.01;
/// Share of the budget that a step gets at least, however slow drawing is.
constexpr double kLeastShare = 0.3;

}  // namespace

ViewLoop::ViewLoop(Viewer& viewer, Window& window, Ui& ui, double budgetSeconds, int scale)
    : viewer_(viewer),
      window_(window),
      ui_(ui),
      input_(ui),
      budget_(budgetSeconds),
      scale_(static_cast<std::uint32_t>(scale)) {}

double ViewLoop::pause(bool maySleep) const {
  if (window_.minimised()) return kSleep;
  if (framesToDraw_ > 0 || input_.flying() || !maySleep) return 0.0;
  if (viewer_.idle()) return kSleep;
  return idled_ ? kBackground : 0.0;
}

Turn ViewLoop::turn(bool maySleep) {
  window_.poll(pause(maySleep));
  Turn turn;
  const double start = glfwGetTime();
  if (window_.takeActivity()) framesToDraw_ = kSettlingFrames;
  ui_.follow();
  input_.handle(window_.takeEvents(), std::min(start - lastTurn_, 0.1));
  lastTurn_ = start;
  if (window_.closing()) {
    window_.refuseClosing();
    ui_.askToClose();
  }
  if (window_.minimised()) return turn;
  viewer_.resize(std::max(window_.width() / scale_, 1u), std::max(window_.height() / scale_, 1u));
  turn.step = viewer_.step(std::max(budget_ - drawCost_, kLeastShare * budget_));
  idled_ = turn.step.kind == StepReport::Kind::kIdle && !turn.step.newPicture;
  ui_.follow();
  if (drawsNow(turn.step)) {
    const double drawing = glfwGetTime();
    draw();
    turn.presented = true;
    turn.drawSeconds = glfwGetTime() - drawing;
    drawCost_ += 0.2 * (turn.drawSeconds - drawCost_);
  }
  turn.seconds = glfwGetTime() - start;
  return turn;
}

bool ViewLoop::drawsNow(const StepReport& step) {
  const bool figuresDue = !viewer_.idle() && glfwGetTime() - lastDraw_ > kFigures;
  return step.newPicture || framesToDraw_ > 0 || figuresDue || ui_.noticeEnded();
}

void ViewLoop::draw() {
  framesToDraw_ = std::max(framesToDraw_ - 1, 0);
  lastDraw_ = glfwGetTime();
  window_.beginPanels();
  ui_.draw();
  window_.present(viewer_.screen());
  // An edit made by a panel wants the panels to follow.
  if (ui_.editor.underWay()) framesToDraw_ = std::max(framesToDraw_, 1);
}

int ViewLoop::run() {
  catchInterrupts();
  while (!ui_.closed && interruptedBy() == 0) turn(true);
  return interruptedBy() == 0 ? 0 : 128 + interruptedBy();
}

}  // namespace trex
