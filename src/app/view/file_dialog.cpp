#include "src/app/view/file_dialog.h"

#include <imgui.h>
#include <imgui_stdlib.h>

#include <algorithm>

namespace trex {
namespace {

namespace fs = std::filesystem;

}  // namespace

void FileDialog::ask(const std::string& title, const fs::path& start,
                     const std::vector<std::string>& extensions, bool save, Chosen chosen) {
  std::error_code ignored;
  const fs::path whole = fs::absolute(start.empty() ? fs::path(".") : start, ignored);
  const bool isFolder = fs::is_directory(whole, ignored);
  folder_ = (isFolder ? whole : whole.parent_path()).lexically_normal();
  name_ = isFolder ? "" : whole.filename().string();
  title_ = title;
  extensions_ = extensions;
  save_ = save;
  overwrite_ = false;
  chosen_ = std::move(chosen);
  open_ = opening_ = true;
  list();
}

void FileDialog::list() {
  folders_.clear();
  names_.clear();
  std::error_code problem;
  for (fs::directory_iterator entry(folder_, problem), end; !problem && entry != end;
       entry.increment(problem)) {
    const std::string name = entry->path().filename().string();
    std::error_code ignored;
    if (name.starts_with(".")) continue;
    if (entry->is_directory(ignored)) {
      folders_.push_back(name);
    } else if (std::find(extensions_.begin(), extensions_.end(),
                         entry->path().extension().string()) != extensions_.end()) {
      names_.push_back(name);
    }
  }
  std::sort(folders_.begin(), folders_.end());
  std::sort(names_.begin(), names_.end());
}

void FileDialog::draw() {
  if (!open_) return;
  if (opening_) ImGui::OpenPopup(title_.c_str());
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const float em = ImGui::GetFontSize();
  ImGui::SetNextWindowPos(ImVec2(0.5f * screen.x, 0.5f * screen.y), ImGuiCond_Always,
                          ImVec2(0.5f, 0.5f));
  ImGui::SetNextWindowSize(
      ImVec2(std::min(0.94f * screen.x, 36.0f * em), std::min(0.9f * screen.y, 28.0f * em)));
  if (!ImGui::BeginPopupModal(title_.c_str(), &open_,
                              ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoMove)) {
    return;
  }
  ImGui::TextUnformatted(folder_.c_str());
  ImGui::BeginChild("list", ImVec2(0.0f, -2.0f * ImGui::GetFrameHeightWithSpacing()), true);
  std::string into;
  if (ImGui::Selectable("..", false, ImGuiSelectableFlags_DontClosePopups)) into = "..";
  for (const std::string& folder : folders_) {
    if (ImGui::Selectable((folder + "/").c_str(), false, ImGuiSelectableFlags_DontClosePopups)) {
      into = folder;
    }
  }
  for (const std::string& name : names_) {
    if (!ImGui::Selectable(name.c_str(), name == name_, ImGuiSelectableFlags_DontClosePopups)) {
      continue;
    }
    name_ = name;
    overwrite_ = false;
  }
  ImGui::EndChild();
  if (!into.empty()) {
    folder_ = (folder_ / into).lexically_normal();
    list();
  }
  if (opening_) ImGui::SetKeyboardFocusHere();
  opening_ = false;
  ImGui::SetNextItemWidth(-1.0f);
  const bool entered = ImGui::InputText("##name", &name_, ImGuiInputTextFlags_EnterReturnsTrue);
  const char* button = overwrite_ ? "Overwrite" : save_ ? "Save" : "Open";
  if (ImGui::Button(button) || entered) answer();
  ImGui::SameLine();
  if (ImGui::Button("Cancel") || ImGui::IsKeyPressed(ImGui::GetKeyIndex(ImGuiKey_Escape))) {
    open_ = false;
  }
  if (overwrite_) {
    ImGui::SameLine();
    ImGui::TextUnformatted("The file exists.");
  }
  if (!open_) ImGui::CloseCurrentPopup();
  ImGui::EndPopup();
}

void FileDialog::answer() {
  if (name_.empty()) return;
  const fs::path path = fs::path(name_).is_absolute() ? fs::path(name_) : folder_ / name_;
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) {
    folder_ = path.lexically_normal();
    name_.clear();
    list();
    return;
  }
  if (save_ && !overwrite_ && fs::exists(path, ignored)) {
    overwrite_ = true;
    return;
  }
  open_ = false;
  chosen_(path);
}

}  // namespace trex
