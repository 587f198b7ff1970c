#include "src/machines/remote_files.h"

#include <algorithm>

#include "src/machines/page_server.h"
#include "src/machines/remote_file.h"

namespace trex::machines {

RemoteFiles::RemoteFiles(std::function<void(std::uint32_t, Bytes)> send,
                         std::function<LinkSpeed(std::uint32_t)> speed)
    : send_(std::move(send)), speed_(std::move(speed)) {}

std::unique_ptr<hccm::PageFile> RemoteFiles::file(std::uint32_t machine, std::uint32_t number,
                                                  const std::string& name) {
  return std::make_unique<RemoteFile>(
      [this, machine, number](std::span<const hccm::FilePart> parts) {
        read(machine, number, parts);
      },
      [this, machine] { return speed_(machine); }, fmt::format("{} of machine {}", name, machine));
}

/// One that this machine was asked; null if it has answered before. The lock is held, as below.
RemoteFiles::Question* RemoteFiles::questionOf(std::uint32_t from, std::uint64_t number) {
  if (number == 0 || number > asked_) throw MessageError("nobody asked for this part");
  const auto at = questions_.find(number);
  if (at == questions_.end() || at->second.answered()) return nullptr;
  if (at->second.machine != from) throw MessageError("another was asked for this part");
  return &at->second;
}

/// A question has its answer, which is dropped if nobody waits for it.
void RemoteFiles::settle(std::uint64_t number) {
  if (!questions_.at(number).awaited) questions_.erase(number);
  changed_.notify_all();
}

void RemoteFiles::hear(std::uint32_t from, const Part& part) {
  const std::lock_guard lock(mutex_);
  if (part.bytes.empty()) throw MessageError("a part of a file is empty");
  Question* question = questionOf(from, part.number);
  if (question == nullptr) return;
  question->answer = part.bytes.size();
  if (question->awaited && part.bytes.size() == sizeOf(question->parts))
    giveOut(part.bytes, question->parts);
  settle(part.number);
}

void RemoteFiles::hear(std::uint32_t from, const NoPart& why) {
  const std::lock_guard lock(mutex_);
  Question* question = questionOf(from, why.number);
  if (question == nullptr) return;
  question->problem = errorOf(from, why);
  settle(why.number);
}

void RemoteFiles::lose(std::uint32_t machine, const Error& error) {
  const std::lock_guard lock(mutex_);
  lost_.emplace(machine, error);
  std::erase_if(questions_,
                [&](const auto& q) { return q.second.machine == machine && !q.second.awaited; });
  changed_.notify_all();
}

void RemoteFiles::broken(const Error& error) {
  const std::lock_guard lock(mutex_);
  if (!broken_) broken_ = error;
  std::erase_if(questions_, [](const auto& q) { return !q.second.awaited; });
  changed_.notify_all();
}

void RemoteFiles::stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

std::size_t RemoteFiles::outstanding() const {
  const std::lock_guard lock(mutex_);
  if (broken_) return 0;
  return static_cast<std::size_t>(std::count_if(
      questions_.begin(), questions_.end(),
      [&](const auto& q) { return !q.second.answered() && !lost_.contains(q.second.machine); }));
}

void RemoteFiles::read(std::uint32_t machine, std::uint32_t file,
                       std::span<const hccm::FilePart> parts) {
  const std::size_t bytes = sizeOf(parts);
  if (bytes == 0) return;
  Fetch fetch;
  for (const hccm::FilePart& part : parts) {
    fetch.ranges.push_back({part.offset, file, static_cast<std::uint32_t>(part.out.size())});
  }
  std::unique_lock lock(mutex_);
  const std::uint64_t number = fetch.number = ++asked_;
  const auto ended = [&] { return stopped_ || broken_ || lost_.contains(machine); };
  if (!ended()) {
    questions_[number] = {.machine = machine, .parts = parts};
    send_(machine, encode(fetch));
    changed_.wait(lock, [&] { return ended() || questions_.at(number).answered(); });
    Question& q = questions_.at(number);
    q.awaited = false;
    if (q.answered()) {
      const Question got = std::move(q);
      questions_.erase(number);
      if (got.problem) throw Error(*got.problem);
      if (got.answer == bytes) return;
      fail(ExitCode::kFailed, "machine {}: sent {} bytes of a file instead of {}", machine,
           got.answer, bytes);
    }
    if (broken_ || lost_.contains(machine)) questions_.erase(number);
  }
  if (const auto lost = lost_.find(machine); lost != lost_.end()) throw Error(lost->second);
  if (broken_) throw Error(*broken_);
  fail(ExitCode::kInterrupted, "machine {}: nothing is read from it any more", machine);
}

}  // namespace trex::machines
