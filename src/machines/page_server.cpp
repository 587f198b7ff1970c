#include "src/machines/page_server.h"

#include <span>

namespace trex::machines {
namespace {

constexpr std::size_t kThreads = 4;
constexpr std::uint64_t kMostBytesAsked = std::uint64_t{16} << 20;  // of a question

}  // namespace

Error errorOf(std::uint32_t machine, const NoPart& why) {
  const bool known = why.code >= 1 && why.code <= static_cast<int>(ExitCode::kDiffer);
  return Error(known ? static_cast<ExitCode>(why.code) : ExitCode::kFailed,
               fmt::format("machine {}: {}", machine, why.text));
}

PageServer::PageServer(std::function<void(std::uint32_t, Bytes)> send,
                       std::function<void(const Error&)> failed)
    : send_(std::move(send)), failed_(std::move(failed)) {}

void PageServer::stop() {
  std::vector<std::thread> threads;
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
    threads.swap(threads_);
  }
  wake_.notify_all();
  for (std::thread& t : threads) t.join();
}

void PageServer::setFiles(std::vector<ServedFile> files) {
  const std::lock_guard lock(mutex_);
  files_ = std::move(files);
}

std::uint64_t PageServer::ask(std::uint32_t from, Fetch fetch) {
  const std::lock_guard lock(mutex_);
  std::uint64_t bytes = 0;
  Question question{from, std::move(fetch), {}};
  for (const FileRange& r : question.fetch.ranges) {
    if (r.file >= files_.size()) throw MessageError("it asks for a file that there is not");
    const ServedFile& file = files_[r.file];
    bytes += r.bytes;
    if (bytes > kMostBytesAsked || r.offset > file.size || r.bytes > file.size - r.offset) {
      throw MessageError("it asks for bytes beyond a file's end");
    }
    question.files.push_back(file.bytes);
  }
  if (ends_) return 0;
  questions_.push_back(std::move(question));
  while (threads_.size() < kThreads) threads_.emplace_back([this] { work(); });
  wake_.notify_one();
  return bytes;
}

Bytes PageServer::answerTo(const Question& question) {
  std::size_t bytes = 0;
  for (const FileRange& r : question.fetch.ranges) bytes += r.bytes;
  FieldWriter message;
  message(question.fetch.number);
  std::span<std::byte> left = message.list(bytes);
  std::vector<hccm::FilePart> parts;
  for (std::size_t i = 0; i < question.files.size(); ++i) {
    const FileRange& r = question.fetch.ranges[i];
    if (r.bytes > 0) parts.push_back({r.offset, left.first(r.bytes)});
    left = left.subspan(r.bytes);
    const bool sameNext =
        i + 1 < question.files.size() && question.files[i + 1] == question.files[i];
    if (sameNext || parts.empty()) continue;
    question.files[i]->readAll(parts);
    parts.clear();
  }
  return message.take(Kind::kPart);
}

void PageServer::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [&] { return ends_ || !questions_.empty(); });
    if (ends_) return;
    const Question question = std::move(questions_.front());
    questions_.pop_front();
    lock.unlock();
    try {
      send_(question.from, answerTo(question));
    } catch (const Error& e) {
      if (failed_) failed_(e);
      send_(question.from,
            encode(NoPart{question.fetch.number, static_cast<std::int32_t>(e.code()), e.what()}));
    }
    lock.lock();
  }
}

}  // namespace trex::machines
