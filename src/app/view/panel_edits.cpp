#include <fmt/format.h>

#include "src/app/view/panels.h"

namespace trex {

void editsPanel(Ui& ui) {
  LookHistory& history = ui.viewer.history();
  ImGui::BeginDisabled(!history.canUndo());
  if (ImGui::Button("Undo")) ui.undo();
  ImGui::EndDisabled();
  ImGui::SameLine();
  ImGui::TextUnformatted(history.canUndo() ? history.undoName().c_str() : "nothing to undo");
  ImGui::BeginDisabled(!history.canRedo());
  if (ImGui::Button("Redo")) ui.redo();
  ImGui::EndDisabled();
  ImGui::SameLine();
  ImGui::TextUnformatted(history.canRedo() ? history.redoName().c_str() : "nothing to redo");
  heading("Edits as a file");
  weakText(ui.viewer.unsavedEdits() ? "There are edits that are not saved."
                                    : "All edits are saved.");
  if (ImGui::Button("Save (Ctrl+S)")) ui.saveEdits();
  tip("A small file of what differs from the model; trex render --edits reads it");
  ImGui::SameLine();
  if (ImGui::Button("Load")) {
    ui.files.ask("Load edits", ui.editsFile.empty() ? "." : ui.editsFile, {".json"}, false,
                 [&ui](const std::filesystem::path& path) { ui.loadEditsFrom(path); });
  }
  if (!ui.editsFile.empty()) weakText(ui.editsFile.string());
  heading("Render this view without a window");
  const std::string edits = ui.editsFile.empty() ? "look.json" : ui.editsFile.string();
  const std::string command = ui.viewer.headlessCommand(edits, "picture.exr");
  weakText(command);
  if (ImGui::Button("Copy the command")) {
    ui.window.setClipboard(command);
    ui.say("The command is in the clipboard");
  }
  heading("Save the picture");
  if (ImGui::Button("PNG (F12)")) ui.savePicture(".png");
  tip("As shown, tone-mapped");
  ImGui::SameLine();
  if (ImGui::Button("EXR (Shift+F12)")) ui.savePicture(".exr");
  tip("Linear, with layers");
}

}  // namespace trex
