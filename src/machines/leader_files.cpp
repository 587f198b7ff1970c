// What machine 0 serves to others, and reads of them.
#include "src/core/clock.h"
#include "src/machines/leader.h"

namespace trex::machines {

/// What there is to open. The lock is held.
void Leader::sendWelcome(std::uint32_t to) {
  tell(to, *welcome_);
  if (serve_) tell(to, *serve_);
}

void Leader::welcome(bool local, bool baked, std::vector<ServedFile> files) {
  Welcome w;
  w.local = local;
  w.baked = baked;
  welcomeAll(w, std::move(files));
}

void Leader::welcomeTo(std::uint32_t holder, std::vector<ServedFile> files) {
  const MachineRow row = rows()[holder];
  Welcome w;
  w.baked = 1;
  w.holder = holder;
  w.model = row.model;
  files.at(0) = {nullptr, row.modelBytes};
  welcomeAll(w, std::move(files));
}

std::unique_ptr<hccm::PageFile> Leader::file(std::uint32_t machine, std::uint32_t number) {
  return remote_.file(machine, number, rows()[machine].model);
}

void Leader::welcomeAll(const Welcome& welcome, std::vector<ServedFile> files) {
  const std::lock_guard lock(mutex_);
  Welcome w = welcome;
  w.window = serve_.has_value();
  for (ServedFile& f : files) {
    w.fileBytes.push_back(f.size);
    if (!f.bytes) f.size = 0;  // nobody gets that here
  }
  server_.setFiles(std::move(files));
  welcome_ = w;
  for (std::uint32_t i = 1; i < machines_.size(); ++i) {
    if (machines_[i].state == State::kGreeted) sendWelcome(i);
  }
}

/// By whomever it was asked for. False if it is nothing of that.
bool Leader::hearOfFiles(std::uint32_t from, Kind kind, ByteView body) {
  switch (kind) {
    case Kind::kFetch:
      serve(from, decode<Fetch>(body));
      return true;
    case Kind::kPart:
      remote_.hear(from, decode<Part>(body));
      break;
    case Kind::kNoPart:
      remote_.hear(from, decode<NoPart>(body));
      break;
    default:
      return false;
  }
  const std::lock_guard lock(mutex_);
  machines_[from].heard = secondsNow();
  changed_.notify_all();
  return true;
}

/// Deals and results go on while the file is read.
void Leader::serve(std::uint32_t to, Fetch fetch) {
  const std::uint64_t bytes = server_.ask(to, std::move(fetch));
  const std::lock_guard lock(mutex_);
  machines_[to].heard = secondsNow();
  machines_[to].row.servedBytes += bytes;
}

}  // namespace trex::machines
