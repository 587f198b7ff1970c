// Asks for a file: a folder's contents, and a name to type.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace trex {

class FileDialog {
 public:
  using Chosen = std::function<void(const std::filesystem::path&)>;

  /// Asks for a file. `start`: a folder, or a file whose name is proposed. `extensions` (with their
  /// dot): what is listed. `chosen` gets the answer.
  void ask(const std::string& title, const std::filesystem::path& start,
           const std::vector<std::string>& extensions, bool save, Chosen chosen);
  void draw();
  bool open() const { return open_; }

 private:
  void list();
  void answer();

  bool open_ = false, opening_ = false, save_ = false, overwrite_ = false;
  std::string title_, name_;
  std::filesystem::path folder_;
  std::vector<std::string> extensions_;
  std::vector<std::string> folders_, names_;
  Chosen chosen_;
};

}  // namespace trex
