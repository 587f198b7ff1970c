// What mouse and keys mean over the picture.
#pragma once

#include <set>
#include <vector>

#include "src/app/view/ui.h"

namespace trex {

class Input {
 public:
  explicit Input(Ui& ui) : ui_(ui) {}

  /// Handles what has happened, and walks on for `seconds` if keys to fly are held.
  void handle(const std::vector<InputEvent>& events, double seconds);
  /// True while a key to fly is held: frames must go on.
  bool flying() const { return !held_.empty(); }

 private:
  enum class Drag { kNothing, kOrbit, kLook, kPan, kHandle };

  void button(const InputEvent& event);
  void press(const InputEvent& event);
  void move(const vec2& to);
  void key(const InputEvent& event);
  void shortcut(const InputEvent& event);
  void plainKey(const InputEvent& event);
  void escape();
  void fly(double seconds);

  Ui& ui_;
  Drag drag_ = Drag::kNothing;
  int dragButton_ = 0;
  vec2 pressedAt_{0.0f}, last_{0.0f};
  bool moved_ = false;       ///< the pointer has left the place of the press
  double clickedAt_ = -1.0;  ///< seconds, of the last click
  vec2 clickPlace_{0.0f};
  std::set<int> held_;  ///< keys to fly that are down
};

}  // namespace trex
