#include "src/app/view/input.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <iterator>

#include "src/app/view/handles.h"

namespace trex {
namespace {

constexpr float kClickReach = 4.0f;    ///< pixels that a click may move
constexpr double kDoubleClick = 0.35;  ///< seconds
constexpr int kFlyKeys[] = {GLFW_KEY_W, GLFW_KEY_A, GLFW_KEY_S, GLFW_KEY_D, GLFW_KEY_Q, GLFW_KEY_E};

bool fliesBy(int key) {
  return std::find(std::begin(kFlyKeys), std::end(kFlyKeys), key) != std::end(kFlyKeys);
}

}  // namespace

void Input::handle(const std::vector<InputEvent>& events, double seconds) {
  for (const InputEvent& event : events) {
    switch (event.kind) {
      case InputEvent::Kind::kButton:
        button(event);
        break;
      case InputEvent::Kind::kMove:
        move(event.position);
        break;
      case InputEvent::Kind::kKey:
        key(event);
        break;
      case InputEvent::Kind::kDrop:
        ui_.open(event.path);
        break;
      case InputEvent::Kind::kScroll:
        if (!ui_.camera || ui_.pointOnPanel(event.position)) break;
        ui_.camera->dolly(event.scroll.y);
        ui_.moveCamera();
        break;
    }
  }
  fly(seconds);
}

void Input::button(const InputEvent& event) {
  if (event.down) {
    if (drag_ == Drag::kNothing) press(event);
    return;
  }
  if (drag_ == Drag::kNothing || event.code != dragButton_) return;
  move(event.position);
  const bool click = !moved_ && drag_ == Drag::kOrbit;
  if (drag_ == Drag::kHandle) releaseHandle();
  drag_ = Drag::kNothing;
  if (!click) return;
  const double now = glfwGetTime();
  const vec2 pixel = ui_.toPicture(event.position);
  if (now - clickedAt_ < kDoubleClick && glm::length(event.position - clickPlace_) < kClickReach) {
    ui_.setPivotAt(pixel);
    clickedAt_ = -1.0;
    return;
  }
  clickedAt_ = now;
  clickPlace_ = event.position;
  ui_.pickAt(pixel);
}

void Input::press(const InputEvent& event) {
  if (!ui_.camera || ui_.pointOnPanel(event.position)) return;
  dragButton_ = event.code;
  pressedAt_ = last_ = event.position;
  moved_ = false;
  if (event.code == GLFW_MOUSE_BUTTON_RIGHT) drag_ = Drag::kLook;
  if (event.code == GLFW_MOUSE_BUTTON_MIDDLE) drag_ = Drag::kPan;
  if (event.code != GLFW_MOUSE_BUTTON_LEFT) return;
  drag_ = holdHandle(ui_, ui_.toPicture(event.position)) ? Drag::kHandle
          : event.shift                                  ? Drag::kPan
                                                         : Drag::kOrbit;
}

void Input::move(const vec2& to) {
  const bool over = ui_.shows() && !ui_.pointOnPanel(to);
  ui_.pointer = over ? std::optional<vec2>(ui_.toPicture(to)) : std::nullopt;
  if (over) {
    ui_.viewer.state().pointer =
        to / vec2(static_cast<float>(ui_.window.width()), static_cast<float>(ui_.window.height()));
  }
  if (drag_ == Drag::kNothing || !ui_.camera) return;
  if (glm::length(to - pressedAt_) > kClickReach) moved_ = true;
  if (!moved_ || to == last_) return;
  const vec2 drag = (to - last_) / static_cast<float>(ui_.window.height());
  if (drag_ == Drag::kHandle) dragHandle(ui_, ui_.toPicture(last_), ui_.toPicture(to));
  last_ = to;
  if (drag_ == Drag::kHandle) return;
  if (drag_ == Drag::kOrbit) ui_.camera->orbit(drag);
  if (drag_ == Drag::kLook) ui_.camera->look(drag);
  if (drag_ == Drag::kPan) ui_.camera->pan(drag);
  ui_.moveCamera();
}

void Input::key(const InputEvent& event) {
  if (!event.down) {
    held_.erase(event.code);
    return;
  }
  if (ImGui::GetIO().WantTextInput || ui_.files.open()) return;
  if (event.code == GLFW_KEY_ESCAPE) {
    escape();
  } else if (ui_.question != Question::kNothing) {
    return;
  } else if (event.code == GLFW_KEY_F12 && !event.repeated) {
    ui_.savePicture(event.shift ? ".exr" : ".png");
  } else if (event.control && (!fliesBy(event.code) || event.code == GLFW_KEY_S)) {
    shortcut(event);
  } else if (fliesBy(event.code)) {
    held_.insert(event.code);
  } else {
    plainKey(event);
  }
}

void Input::shortcut(const InputEvent& event) {
  switch (event.code) {
    case GLFW_KEY_Z:
      event.shift ? ui_.redo() : ui_.undo();
      break;
    case GLFW_KEY_Y:
      ui_.redo();
      break;
    case GLFW_KEY_S:
      ui_.saveEdits();
      break;
    case GLFW_KEY_C:
      ui_.copyCamera();
      break;
    case GLFW_KEY_V:
      ui_.pasteCamera();
      break;
    default:
      break;
  }
}

void Input::plainKey(const InputEvent& event) {
  if (event.repeated) return;
  ViewState& state = ui_.viewer.state();
  switch (event.code) {
    case GLFW_KEY_F:
      ui_.frameAll();
      break;
    case GLFW_KEY_H:
      ui_.help = !ui_.help;
      break;
    case GLFW_KEY_TAB:
      ui_.hidden = !ui_.hidden;
      break;
    case GLFW_KEY_P:
      state.paused = !state.paused;
      break;
    case GLFW_KEY_R:
      ui_.restart();
      break;
    case GLFW_KEY_B:
      state.split = !state.split;
      break;
    case GLFW_KEY_SPACE:
      if (ui_.pointer) ui_.setPivotAt(*ui_.pointer);
      break;
    default:
      if (event.code >= GLFW_KEY_1 && event.code <= GLFW_KEY_9) {
        ui_.goToCamera(static_cast<std::size_t>(event.code - GLFW_KEY_1));
      }
  }
}

void Input::escape() {
  if (ui_.question != Question::kNothing) {
    ui_.question = Question::kNothing;
  } else if (ui_.help) {
    ui_.help = false;
  } else {
    ui_.askToClose();
  }
}

void Input::fly(double seconds) {
  // A key may have been let go while another window had the keyboard.
  std::erase_if(held_, [&](int key) { return !ui_.window.keyDown(key); });
  if (held_.empty() || !ui_.camera) return;
  const auto down = [&](int key) { return held_.contains(key) ? 1.0f : 0.0f; };
  const vec3 direction(down(GLFW_KEY_D) - down(GLFW_KEY_A), down(GLFW_KEY_E) - down(GLFW_KEY_Q),
                       down(GLFW_KEY_W) - down(GLFW_KEY_S));
  if (direction == vec3(0.0f)) return;
  const auto either = [&](int left, int right) {
    return ui_.window.keyDown(left) || ui_.window.keyDown(right);
  };
  const double pace = either(GLFW_KEY_LEFT_SHIFT, GLFW_KEY_RIGHT_SHIFT)       ? kFastPace
                      : either(GLFW_KEY_LEFT_CONTROL, GLFW_KEY_RIGHT_CONTROL) ? kSlowPace
                                                                              : 1.0;
  ui_.camera->fly(direction, seconds, pace);
  ui_.moveCamera();
}

}  // namespace trex
