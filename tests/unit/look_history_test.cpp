// LookHistory: steps, what a commit takes together, and what the camera does to it.
#include "src/viewer/look_history.h"

#include <gtest/gtest.h>

namespace trex {
namespace {

Look start() {
  Look look;
  look.materials.resize(2);
  return look;
}

Look rough(Look look, float roughness) {
  look.materials[0].roughness = roughness;
  return look;
}

Look seenFrom(Look look, double x) {
  look.camera.eye.x = x;
  return look;
}

TEST(LookHistory, StartsWithNothingToUndo) {
  LookHistory history(start());
  EXPECT_FALSE(history.canUndo());
  EXPECT_FALSE(history.canRedo());
  EXPECT_EQ(history.undoName(), "");
  EXPECT_FALSE(history.unsaved());
  EXPECT_TRUE(history.undo() == start());
  EXPECT_TRUE(history.redo() == start());
}

TEST(LookHistory, UndoAndRedoByName) {
  LookHistory history(start());
  history.set(rough(start(), 0.5f), true, "first");
  history.set(rough(start(), 0.25f), true, "second");
  EXPECT_EQ(history.undoName(), "second");
  EXPECT_EQ(history.undo().materials[0].roughness, 0.5f);
  EXPECT_EQ(history.undoName(), "first");
  EXPECT_EQ(history.redoName(), "second");
  EXPECT_TRUE(history.undo() == start());
  EXPECT_EQ(history.redo().materials[0].roughness, 0.5f);
  EXPECT_EQ(history.redo().materials[0].roughness, 0.25f);
  EXPECT_FALSE(history.canRedo());
}

TEST(LookHistory, ADragIsOneStep) {
  LookHistory history(start());
  for (int i = 1; i <= 10; ++i)
    history.set(rough(start(), 0.05f * static_cast<float>(i)), false, "drag");
  EXPECT_TRUE(history.canUndo());
  history.set(rough(start(), 0.5f), true, "drag");
  EXPECT_EQ(history.undoName(), "drag");
  EXPECT_TRUE(history.undo() == start());
  EXPECT_FALSE(history.canUndo());
}

TEST(LookHistory, UndoInADragTakesTheDragBack) {
  LookHistory history(start());
  history.set(rough(start(), 0.5f), true, "first");
  history.set(rough(start(), 0.1f), false, "drag");
  EXPECT_FALSE(history.canRedo());
  EXPECT_EQ(history.undo().materials[0].roughness, 0.5f);
  EXPECT_EQ(history.undoName(), "first");
}

TEST(LookHistory, ANewStepForgetsWhatWasUndone) {
  LookHistory history(start());
  history.set(rough(start(), 0.5f), true, "first");
  history.undo();
  history.set(rough(start(), 0.2f), true, "other");
  EXPECT_FALSE(history.canRedo());
  EXPECT_TRUE(history.undo() == start());
}

TEST(LookHistory, ACommitThatChangesNothingIsNoStep) {
  LookHistory history(start());
  history.set(start(), true, "nothing");
  EXPECT_FALSE(history.canUndo());
}

TEST(LookHistory, OldStepsAreForgotten) {
  LookHistory history(start());
  const std::size_t steps = LookHistory::kMostSteps + 50;
  for (std::size_t i = 1; i <= steps; ++i) {
    history.set(rough(start(), static_cast<float>(i)), true, "step");
  }
  std::size_t undone = 0;
  for (; history.canUndo(); ++undone) history.undo();
  EXPECT_EQ(undone, LookHistory::kMostSteps);
  EXPECT_EQ(history.current().materials[0].roughness, 50.0f);
}

TEST(LookHistory, UndoLeavesTheCameraWhereItIs) {
  LookHistory history(start());
  history.set(rough(start(), 0.5f), true, "rough");
  history.set(seenFrom(rough(start(), 0.5f), 7.0), false, "View");
  EXPECT_EQ(history.undoName(), "rough");
  const Look undone = history.undo();
  EXPECT_EQ(undone.camera.eye.x, 7.0);
  EXPECT_EQ(undone.materials[0].roughness, start().materials[0].roughness);
  EXPECT_EQ(history.redo().camera.eye.x, 7.0);
}

TEST(LookHistory, ACameraMoveBeforeAnEditIsNotUndoneWithIt) {
  LookHistory history(start());
  history.set(seenFrom(start(), 7.0), false, "View");
  EXPECT_FALSE(history.canUndo());
  history.set(seenFrom(rough(start(), 0.5f), 7.0), true, "rough");
  EXPECT_EQ(history.undo().camera.eye.x, 7.0);
  EXPECT_FALSE(history.canUndo());
}

TEST(LookHistory, ACommittedCameraMoveIsAStep) {
  LookHistory history(start());
  history.set(seenFrom(start(), 1.0), false, "camera");
  history.set(seenFrom(start(), 2.0), true, "camera");
  EXPECT_EQ(history.undoName(), "camera");
  EXPECT_EQ(history.undo().camera.eye.x, 0.0);
  EXPECT_EQ(history.redo().camera.eye.x, 2.0);
}

TEST(LookHistory, TheCameraKeepsWhatCanBeRedone) {
  LookHistory history(start());
  history.set(rough(start(), 0.5f), true, "rough");
  history.undo();
  history.set(seenFrom(start(), 3.0), false, "View");
  ASSERT_TRUE(history.canRedo());
  const Look again = history.redo();
  EXPECT_EQ(again.materials[0].roughness, 0.5f);
  EXPECT_EQ(again.camera.eye.x, 3.0);
}

TEST(LookHistory, OnlyEditsNeedSaving) {
  LookHistory history(start());
  history.set(seenFrom(start(), 3.0), true, "camera");
  EXPECT_FALSE(history.unsaved());
  history.set(rough(start(), 0.5f), false, "drag");
  EXPECT_TRUE(history.unsaved());
  history.set(rough(start(), 0.5f), true, "drag");
  history.markSaved();
  EXPECT_FALSE(history.unsaved());
  history.undo();
  EXPECT_TRUE(history.unsaved());
  history.redo();
  EXPECT_FALSE(history.unsaved());
}

}  // namespace
}  // namespace trex
