// Questions that need an answer, and the page of keys.
#include <fmt/format.h>

#include <algorithm>

#include "src/app/view/panels.h"

namespace trex {
namespace {

void centreNext() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos(ImVec2(0.5f * screen.x, 0.5f * screen.y), ImGuiCond_Always,
                          ImVec2(0.5f, 0.5f));
}

bool beginQuestion(const char* title) {
  if (!ImGui::IsPopupOpen(title)) ImGui::OpenPopup(title);
  centreNext();
  return ImGui::BeginPopupModal(title, nullptr,
                                ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove);
}

constexpr const char* kCloseTitle = "Edits are not saved";
constexpr const char* kRecoveryTitle = "Edits of an earlier run";

/// Closes a question that was taken back by key: ImGui would wait for it for ever.
void endQuestion(const char* title) {
  if (!ImGui::IsPopupOpen(title) || !ImGui::BeginPopupModal(title)) return;
  ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
}

struct Key {
  const char* keys;
  const char* does;
};
constexpr Key kKeys[] = {
    {"Left drag", "turn about the pivot"},
    {"Right drag", "look around"},
    {"Middle or Shift+left drag", "move sideways"},
    {"Wheel", "nearer, farther"},
    {"W A S D, Q E", "fly; Shift fast, Ctrl slow"},
    {"Double-click, Space", "set the pivot"},
    {"F", "frame all, or what is selected"},
    {"1 to 9", "cameras of the file"},
    {"Ctrl+C, Ctrl+V", "copy, paste the camera as text"},
    {"Click", "pick object and material, or a light"},
    {"Ctrl+Z, Ctrl+Y", "undo, redo"},
    {"Ctrl+S", "save the edits"},
    {"F12, Shift+F12", "save the picture: PNG, EXR"},
    {"P", "pause"},
    {"R", "start the picture anew"},
    {"B", "compare with the exact mode"},
    {"Tab", "hide or show the panels"},
    {"H", "this page"},
    {"Esc", "close; asks if edits are not saved"},
};

}  // namespace

void Ui::questions() {
  if (question == Question::kClose) closeQuestion();
  if (question == Question::kRecovery) recoveryQuestion();
  if (question != Question::kClose) endQuestion(kCloseTitle);
  if (question != Question::kRecovery) endQuestion(kRecoveryTitle);
}

void Ui::closeQuestion() {
  if (!beginQuestion(kCloseTitle)) return;
  ImGui::TextUnformatted("Save the edits before closing?");
  ImGui::Spacing();
  if (ImGui::Button("Save")) {
    question = Question::kNothing;
    saveEdits();
    // With no file known yet a dialog asks for one; closing is then up to the person again.
    if (!viewer.unsavedEdits()) closed = true;
  }
  ImGui::SameLine();
  if (ImGui::Button("Close without saving")) {
    question = Question::kNothing;
    viewer.discardRecovery();
    closed = true;
  }
  ImGui::SameLine();
  if (ImGui::Button("Cancel")) question = Question::kNothing;
  if (question == Question::kNothing) ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
}

void Ui::recoveryQuestion() {
  if (!beginQuestion(kRecoveryTitle)) return;
  ImGui::TextUnformatted(
      "The viewer ended last time with edits of this model that were not saved.");
  ImGui::Spacing();
  if (ImGui::Button("Restore them")) {
    question = Question::kNothing;
    attempt([&] { viewer.restoreRecovery(); });
  }
  ImGui::SameLine();
  if (ImGui::Button("Discard them")) {
    question = Question::kNothing;
    viewer.discardRecovery();
  }
  ImGui::SameLine();
  if (ImGui::Button("Later")) question = Question::kNothing;
  if (question == Question::kNothing) ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
}

void Ui::helpWindow() {
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const float em = ImGui::GetFontSize();
  centreNext();
  ImGui::SetNextWindowSize(
      ImVec2(std::min(0.94f * screen.x, 36.0f * em), std::min(0.94f * screen.y, 34.0f * em)));
  ImGui::Begin("Keys and mouse", &help,
               ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse);
  for (const Key& key : kKeys) {
    ImGui::TextUnformatted(key.keys);
    ImGui::SameLine(15.0f * em);
    ImGui::TextUnformatted(key.does);
  }
  ImGui::End();
}

}  // namespace trex
