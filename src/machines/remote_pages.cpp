#include "src/machines/remote_pages.h"

#include <algorithm>
#include <chrono>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "src/core/clock.h"
#include "src/machines/remote_file.h"

namespace trex::machines {
namespace {

constexpr std::uint32_t kModelFile = 0;  // the one whose pages have homes
// Who does not answer for so long, and for so many times what answers take, is taken to have
// stopped until something comes from it.
constexpr double kLateSeconds = 2.0, kLateTimes = 8.0;

bool isWhole(const hccm::FilePart& part) {
  return XXH3_64bits(part.out.data(), part.out.size()) == part.checksum;
}

}  // namespace

RemotePages::RemotePages(Send send, std::function<void(const Error&)> failed)
    : send_(std::move(send)),
      failed_(std::move(failed)),
      server_([this](std::uint32_t to, Bytes message) { answer(to, std::move(message)); },
              [this](const Error& e) {
                if (e.code() != ExitCode::kInterrupted) failed_(e);
              }) {}

RemotePages::~RemotePages() { stop(); }

void RemotePages::setPlace(std::uint32_t rank, std::uint32_t machines) {
  const std::lock_guard lock(mutex_);
  rank_ = rank;
  late_.assign(machines, false);
  refuses_.assign(machines, false);
}

std::unique_ptr<hccm::PageFile> RemotePages::file(std::uint32_t number, const std::string& name) {
  return std::make_unique<RemoteFile>([this, number](Parts parts) { read(number, parts); },
                                      [this] { return link(); }, name + " of machine 0");
}

void RemotePages::passOn(std::unique_ptr<PageShelf> shelf,
                         const std::vector<std::uint64_t>& fileBytes) {
  std::vector<ServedFile> files(fileBytes.size());
  if (!files.empty()) {
    auto pages =
        std::make_shared<RemoteFile>([this](Parts parts) { readAtHome(kModelFile, parts); },
                                     [this] { return link(); }, "the model of machine 0");
    files[kModelFile] = {std::move(pages), fileBytes[kModelFile]};
  }
  server_.setFiles(std::move(files));
  const std::lock_guard lock(mutex_);
  shelf_ = std::move(shelf);
}

bool RemotePages::passesOn() const {
  const std::lock_guard lock(mutex_);
  return shelf_ != nullptr;
}

void RemotePages::opened() {
  const std::lock_guard lock(mutex_);
  bytes_.received = 0;
}

PageBytes RemotePages::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

LinkSpeed RemotePages::link() const {
  const std::lock_guard lock(mutex_);
  return speed_;
}

// ---- reading ----

/// Where a part is asked for; this machine's own number: here. The lock is held.
std::uint32_t RemotePages::whoHas(std::uint32_t file, const hccm::FilePart& part) const {
  if (file != kModelFile || part.checksum == 0) return 0;
  const std::uint32_t home = homeOf(part.offset, homes_);
  if (home == rank_) return shelf_ ? home : 0;
  return late_[home] || refuses_[home] ? 0 : home;
}

void RemotePages::read(std::uint32_t file, Parts parts) {
  std::map<std::uint32_t, std::vector<hccm::FilePart>> byMachine;
  {
    const std::lock_guard lock(mutex_);
    for (const hccm::FilePart& part : parts) byMachine[whoHas(file, part)].push_back(part);
  }
  std::vector<hccm::FilePart> here, again;
  std::vector<Asked> asked;
  try {
    for (auto& [machine, some] : byMachine) {
      if (machine != 0 && machine == rank_) {
        here = std::move(some);
      } else {
        asked.push_back(ask(machine, file, std::move(some)));
      }
    }
    if (!here.empty()) readAtHome(file, here);
    for (Asked& a : asked) {
      if (!await(a)) again.insert(again.end(), a.parts.begin(), a.parts.end());
    }
  } catch (...) {
    forget(asked);
    throw;
  }
  if (!again.empty()) readFrom0(file, again);
}

/// Their answers have nowhere to go any more.
void RemotePages::forget(const std::vector<Asked>& asked) {
  const std::lock_guard lock(mutex_);
  for (const Asked& a : asked) questions_.erase(a.number);
}

void RemotePages::readFrom0(std::uint32_t file, Parts parts) {
  Asked asked = ask(0, file, {parts.begin(), parts.end()});
  await(asked);
}

/// Pages of our home: each is asked for once, by whoever wants it first.
void RemotePages::readAtHome(std::uint32_t file, Parts parts) {
  std::vector<hccm::FilePart> left(parts.begin(), parts.end());
  while (true) {
    std::erase_if(left, [&](const hccm::FilePart& p) { return shelf_->read(p.offset, p.out); });
    if (left.empty()) return;
    std::vector<hccm::FilePart> ours;
    {
      std::unique_lock lock(mutex_);
      throwIfEnded();
      for (const hccm::FilePart& part : left) {
        if (coming_.insert(part.offset).second) ours.push_back(part);
      }
      if (ours.empty()) {
        changed_.wait(
            lock, [&] { return stopped_ || problem_ || !coming_.contains(left.front().offset); });
        continue;
      }
    }
    const auto came = [&] {
      const std::lock_guard lock(mutex_);
      for (const hccm::FilePart& part : ours) coming_.erase(part.offset);
      changed_.notify_all();
    };
    try {
      readFrom0(file, ours);
    } catch (...) {
      came();
      throw;
    }
    for (const hccm::FilePart& part : ours) shelf_->keep(part.offset, part.out);
    came();
    std::erase_if(left, [&](const hccm::FilePart& part) {
      return std::any_of(ours.begin(), ours.end(), [&](const hccm::FilePart& our) {
        return our.offset == part.offset && our.out.data() == part.out.data();
      });
    });
  }
}

RemotePages::Asked RemotePages::ask(std::uint32_t to, std::uint32_t file,
                                    std::vector<hccm::FilePart> parts) {
  Fetch fetch;
  for (const hccm::FilePart& part : parts) {
    fetch.ranges.push_back({part.offset, file, static_cast<std::uint32_t>(part.out.size())});
  }
  const std::lock_guard lock(mutex_);
  throwIfEnded();
  fetch.number = ++asked_;
  Asked asked{fetch.number, to, secondsNow(), std::move(parts)};
  questions_[fetch.number] = {to, asked.parts};  // which stay where they are if that is moved
  send_(to, encode(fetch));
  return asked;
}

/// The lock is held.
void RemotePages::throwIfEnded() const {
  if (problem_) throw Error(*problem_);
  if (stopped_) fail(ExitCode::kInterrupted, "machine 0 has ended the work");
}

/// The lock is held.
bool RemotePages::isAwaited(const Asked& asked) const {
  const bool hopes = asked.to == 0 || !late_[asked.to];
  return hopes && !stopped_ && !problem_ && !questions_.at(asked.number).answered();
}

/// False if machine 0 is to be asked instead.
bool RemotePages::await(Asked& asked) {
  std::unique_lock lock(mutex_);
  const auto over = [&] { return !isAwaited(asked); };
  if (asked.to == 0) {
    changed_.wait(lock, over);
  } else {
    const double most = std::max(kLateSeconds, kLateTimes * usual_);
    if (!changed_.wait_for(lock, std::chrono::duration<double>(most), over)) late_[asked.to] = true;
  }
  const Question question = std::move(questions_.at(asked.number));
  const std::optional<std::uint64_t>& got = question.answer;
  questions_.erase(asked.number);
  if (question.problem) throw Error(*question.problem);
  if (!got) {
    throwIfEnded();
    return false;
  }
  const std::size_t bytes = sizeOf(asked.parts);
  usual_ += 0.1 * (secondsNow() - asked.since - usual_);
  if (*got != bytes) {
    if (asked.to != 0) {
      refuses_[asked.to] = true;
      return false;
    }
    fail(ExitCode::kFailed, "machine 0: sent {} bytes of a file instead of {}", *got, bytes);
  }
  lock.unlock();
  return asked.to == 0 || std::all_of(asked.parts.begin(), asked.parts.end(), isWhole);
}

// ---- what is heard ----

/// Null if its answer came late, or twice. The lock is held.
RemotePages::Question* RemotePages::questionOf(std::uint32_t from, std::uint64_t number) {
  late_.at(from) = false;
  if (number == 0 || number > asked_) throw MessageError("nobody asked for this part");
  const auto at = questions_.find(number);
  if (at == questions_.end() || at->second.answered()) return nullptr;
  if (at->second.to != from) throw MessageError("another was asked for this part");
  return &at->second;
}

void RemotePages::hearPart(std::uint32_t from, const Part& part) {
  const std::lock_guard lock(mutex_);
  bytes_.received += part.bytes.size();
  Question* question = questionOf(from, part.number);
  if (question == nullptr) return;
  question->answer = part.bytes.size();
  if (part.bytes.size() == sizeOf(question->parts)) giveOut(part.bytes, question->parts);
  changed_.notify_all();
}

void RemotePages::hearNoPart(std::uint32_t from, const NoPart& why) {
  const std::lock_guard lock(mutex_);
  Question* question = questionOf(from, why.number);
  if (question == nullptr) return;
  if (from == 0) {
    question->problem = errorOf(from, why);
  } else {
    question->answer = 0;
  }
  changed_.notify_all();
}

void RemotePages::hearFetch(std::uint32_t from, Fetch fetch) {
  if (passesOn()) {
    server_.ask(from, std::move(fetch));
  } else {
    answer(from, encode(NoPart{fetch.number, static_cast<std::int32_t>(ExitCode::kFailed),
                               "passes no pages on"}));
  }
}

/// To others, as long as they take it.
void RemotePages::answer(std::uint32_t to, Bytes message) {
  const std::lock_guard lock(mutex_);
  if (stopped_ || problem_) return;
  bytes_.passed += message.size();
  send_(to, std::move(message));
}

void RemotePages::hearHomes(const Homes& homes) {
  const std::lock_guard lock(mutex_);
  for (const PageHome& home : homes.machines) {
    if (home.machine == 0 || home.machine >= late_.size() || home.weight == 0) {
      throw MessageError("it names a home of pages that there is not");
    }
  }
  if (homes.machines.size() >= late_.size()) throw MessageError("it names too many homes of pages");
  homes_ = homes.machines;
}

void RemotePages::hearLink(const LinkFound& found) {
  const LinkSpeed speed{found.roundTrip, found.bandwidth};
  if (!isPossible(speed)) throw MessageError("no link is so fast");
  const std::lock_guard lock(mutex_);
  speed_ = speed;
}

void RemotePages::lost(std::uint32_t machine) {
  const std::lock_guard lock(mutex_);
  late_.at(machine) = refuses_.at(machine) = true;
  changed_.notify_all();
}

void RemotePages::stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

void RemotePages::broken(const Error& error) {
  const std::lock_guard lock(mutex_);
  if (!problem_) problem_ = error;
  changed_.notify_all();
}

}  // namespace trex::machines
