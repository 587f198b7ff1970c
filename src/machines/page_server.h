// Threads of a machine that read parts of files for the others, several questions at once, so that
// its link, and at machine 0 who deals jobs, wait for no disk.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "hccmesh/pages.h"
#include "src/core/error.h"
#include "src/machines/messages.h"

namespace trex::machines {

/// A file that other machines read parts of.
struct ServedFile {
  std::shared_ptr<const hccm::PageFile> bytes;
  std::uint64_t size = 0;
};

/// What a machine says it can't read.
Error errorOf(std::uint32_t machine, const NoPart& why);

/// Thread safe.
class PageServer {
 public:
  /// `send` gets answers, by any thread, also of what can't be read; `failed` what a file threw.
  PageServer(std::function<void(std::uint32_t to, Bytes answer)> send,
             std::function<void(const Error& error)> failed = {});
  ~PageServer() { stop(); }
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;

  /// Ends the threads; questions that wait, or come later, are left.
  void stop();

  /// Of these files from now on.
  void setFiles(std::vector<ServedFile> files);
  /// Takes a question and returns at once: bytes that will be sent. Throws MessageError for one
  /// that can't be answered.
  std::uint64_t ask(std::uint32_t from, Fetch fetch);

 private:
  struct Question {
    std::uint32_t from = 0;
    Fetch fetch;
    std::vector<std::shared_ptr<const hccm::PageFile>> files;  ///< of the ranges
  };
  void work();
  static Bytes answerTo(const Question& question);

  std::function<void(std::uint32_t, Bytes)> send_;
  std::function<void(const Error&)> failed_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<ServedFile> files_;
  std::deque<Question> questions_;
  bool ends_ = false;
  std::vector<std::thread> threads_;  ///< from the first question on
};

}  // namespace trex::machines
