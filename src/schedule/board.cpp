#include "src/schedule/board.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace trex::schedule {
namespace {

/// What overruns is taken to end after this share of a millisecond: soon, but not now.
constexpr double kSoon = 1e-3;

bool contains(const std::vector<std::uint32_t>& list, std::uint32_t value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

}  // namespace

Board::Board(const State& state, Evict evict)
    : s_(state),
      evict_(evict),
      memories_(static_cast<std::uint32_t>(state.graph->memories.size())),
      devices_(state.graph->devices.size()),
      channels_(state.graph->channels.size()),
      channelFree_(state.graph->channels.size(), state.now),
      rows_(state.items.size(), 0),
      places_(state.items.size(), 0),
      rooms_(memories_),
      promised_(memories_, 0.0) {
  for (std::uint32_t m = 0; m < memories_; ++m) {
    rooms_[m].free = state.graph->memories[m].capacity;
    if (std::isfinite(rooms_[m].free)) finite_ |= std::uint64_t{1} << m;
  }
  readCopies();
  readWork();
}

void Board::readCopies() {
  const auto any = std::count_if(s_.items.begin(), s_.items.end(),
                                 [](const Item& item) { return item.bytes > 0.0; });
  copies_.resize(static_cast<std::size_t>(any) * memories_);
  std::uint32_t row = 0;
  for (std::uint32_t i = 0; i < s_.items.size(); ++i) {
    const Item& item = s_.items[i];
    if (item.bytes <= 0.0) continue;
    places_[i] = item.copies;
    rows_[i] = row;
    row += memories_;
    for (std::uint64_t rest = item.copies; rest != 0; rest &= rest - 1) {
      const auto m = static_cast<std::uint32_t>(std::countr_zero(rest));
      copy(i, m).arrival = s_.now;
      if (item.moves || !std::isfinite(s_.graph->memories[m].capacity)) continue;
      rooms_[m].free -= item.bytes;
      rooms_[m].held.push_back(i);
    }
  }
}

void Board::readWork() {
  for (const Fetch& f : s_.moving) {
    const double end = std::max(f.end, s_.now + kSoon);
    channels_[f.channel].take(s_.now, end - s_.now);
    channelFree_[f.channel] = channels_[f.channel].free(s_.now);
    if (s_.items[f.item].moves || s_.items[f.item].bytes <= 0.0) continue;
    copy(f.item, f.from).until = std::max(copy(f.item, f.from).until, end);
    copy(f.item, f.to).arrival = end;
    places_[f.item] |= std::uint64_t{1} << f.to;
    if (!std::isfinite(s_.graph->memories[f.to].capacity)) continue;
    rooms_[f.to].free -= s_.items[f.item].bytes;
    copy(f.item, f.to).until = end;
    rooms_[f.to].held.push_back(f.item);
  }
  for (const Running& r : s_.running) {
    const double end = std::max(r.end, s_.now + kSoon);
    const std::uint32_t memory = s_.graph->devices[r.device].memory;
    devices_[r.device].take(s_.now, end - s_.now);
    for (std::uint32_t item : r.reads) {
      if (s_.items[item].bytes <= 0.0) continue;
      copy(item, memory).until = std::max(copy(item, memory).until, end);
    }
    rooms_[memory].free -= r.scratch;
    if (r.scratch > 0.0) addRelease(memory, {end, r.scratch});
  }
}

/// Offer::again, of an item that comes from here.
double Board::loadedAgain(std::uint32_t item, std::uint32_t source, std::uint32_t target) const {
  if ((finite_ >> source & 1u) != 0 || (places_[item] & finite_) == 0) return 0.0;
  const Routes::Hop& hop = s_.routes->hops(source, target).front();
  return s_.graph->channels[hop.channel].seconds(s_.items[item].bytes);
}

double Board::arrivalAtBest(const Item& item, std::uint32_t number, std::uint32_t target,
                            double& again) const {
  double best = copy(number, target).arrival;
  if (best <= s_.now) return best;
  std::uint32_t source = memories_;
  for (std::uint64_t rest = places_[number]; rest != 0; rest &= rest - 1) {
    const auto m = static_cast<std::uint32_t>(std::countr_zero(rest));
    const std::uint32_t first = s_.routes->firstChannel(m, target);
    if (first == Routes::kNoChannel) continue;
    const double there = std::max(copy(number, m).arrival, channelFree_[first]) +
                         s_.routes->seconds(m, target, item.bytes);
    if (there >= best) continue;
    best = there;
    source = m;
  }
  if (source < memories_) again += loadedAgain(number, source, target);
  return best;
}

Offer Board::atBest(std::uint32_t job, std::uint32_t device) const {
  const Device& d = s_.graph->devices[device];
  const Job& j = s_.jobs[job];
  if (s_.timing->at(device, j.kind).rates.empty()) return {};
  double ready = devices_[device].free(s_.now), again = 0.0;
  for (std::uint32_t number : j.reads) {
    const Item& item = s_.items[number];
    if (item.bytes <= 0.0) continue;
    ready = std::max(ready, arrivalAtBest(item, number, item.moves ? d.host : d.memory, again));
  }
  return {ready, ready + s_.timing->at(device, j.kind).seconds(j.amounts), again};
}

/// What it would cost to do without a copy: the less, the earlier it goes.
double Board::lossOf(std::uint32_t item, std::uint32_t memory) const {
  const Item& what = s_.items[item];
  if (evict_ == Evict::kUsedLongestAgo) return what.lastUse;
  double again = kNever;
  for (std::uint64_t rest = places_[item] & ~(std::uint64_t{1} << memory); rest != 0;
       rest &= rest - 1) {
    const auto m = static_cast<std::uint32_t>(std::countr_zero(rest));
    again = std::min(again, s_.routes->seconds(m, memory, what.bytes));
  }
  return what.need * again;
}

double Board::loss(std::uint32_t item, std::uint32_t memory) const {
  const Copy& c = copy(item, memory);
  if (c.loss < 0.0) c.loss = lossOf(item, memory);
  return c.loss;
}

/// Where an item is has changed.
void Board::move(std::uint32_t item, std::uint32_t memory, bool there) {
  const std::uint64_t bit = std::uint64_t{1} << memory;
  places_[item] = there ? places_[item] | bit : places_[item] & ~bit;
  for (std::uint32_t m = 0; m < memories_; ++m) copy(item, m).loss = -1.0;
}

/// Copies that nobody uses go first, of them those that are missed least; then those in use, as
/// they become free.
Board::Clearing Board::clear(const Job& job, std::uint32_t memory, double bytes) const {
  const Room& room = rooms_[memory];
  Clearing c{s_.now, {}, 0, room.free};
  while (c.bytes < bytes) {
    std::uint32_t best = 0xffffffffu;
    double until = kNever, least = kNever;
    for (std::uint32_t k = 0; k < room.held.size(); ++k) {
      const double free = std::max(copy(room.held[k], memory).until, s_.now);
      if (free > until || contains(job.reads, room.held[k]) || contains(c.victims, k)) continue;
      const double lost = loss(room.held[k], memory);
      if (best != 0xffffffffu && free == until &&
          (lost != least ? lost > least : room.held[k] > room.held[best])) {
        continue;
      }
      best = k;
      until = free;
      least = lost;
    }
    const bool release = c.releases < room.releases.size();
    if (best == 0xffffffffu && !release) return {};
    if (release && (best == 0xffffffffu || room.releases[c.releases].time < until)) {
      c.time = std::max(c.time, room.releases[c.releases].time);
      c.bytes += room.releases[c.releases++].bytes;
      continue;
    }
    c.time = std::max(c.time, until);
    c.bytes += s_.items[room.held[best]].bytes;
    c.victims.push_back(best);
  }
  return c;
}

/// Whether clear() would have them now, without a look at what is missed least.
bool Board::mayBeFreed(const Job& job, std::uint32_t memory, double bytes) const {
  const Room& room = rooms_[memory];
  double free = room.free;
  for (std::size_t k = 0; k < room.held.size() && free < bytes; ++k) {
    const std::uint32_t item = room.held[k];
    if (copy(item, memory).until <= s_.now && !contains(job.reads, item))
      free += s_.items[item].bytes;
  }
  return free >= bytes;
}

/// When there is room for more bytes than are promised already. With `keep`, takes it; leave() has
/// to follow.
double Board::takeRoom(const Job& job, std::uint32_t memory, double bytes, bool keep,
                       std::vector<std::uint32_t>& evicted) {
  if (!std::isfinite(s_.graph->memories[memory].capacity)) return s_.now;
  Room& room = rooms_[memory];
  if (!keep) {
    promised_[memory] += bytes;
    if (mayBeFreed(job, memory, promised_[memory])) return s_.now;
    return clear(job, memory, promised_[memory]).time;
  }
  if (room.free >= bytes) {
    room.free -= bytes;
    return s_.now;
  }
  Clearing c = clear(job, memory, bytes);
  if (c.time == kNever) return c.time;
  std::sort(c.victims.begin(), c.victims.end(), std::greater<>());
  for (std::uint32_t k : c.victims) {
    evicted.push_back(room.held[k]);
    room.held.erase(room.held.begin() + k);
  }
  room.releases.erase(room.releases.begin(), room.releases.begin() + static_cast<long>(c.releases));
  room.free = 0.0;
  surplus_ = c.bytes - bytes;
  return c.time;
}

/// What was evicted goes at this time, and what it left over is free from then on.
void Board::leave(std::uint32_t memory, double time, const std::vector<std::uint32_t>& evicted) {
  for (std::uint32_t item : evicted) {
    copy(item, memory) = {kNever, time};
    move(item, memory, false);
  }
  if (surplus_ > 0.0) addRelease(memory, {time, surplus_});
  surplus_ = 0.0;
}

void Board::addRelease(std::uint32_t memory, const Release& release) {
  Room& room = rooms_[memory];
  if (release.time <= s_.now) {
    room.free += release.bytes;
    return;
  }
  const auto earlier = [](const Release& a, const Release& b) { return a.time < b.time; };
  room.releases.insert(
      std::upper_bound(room.releases.begin(), room.releases.end(), release, earlier), release);
}

void Board::undoChannels(std::size_t left) {
  while (taken_.size() > left) {
    channels_[taken_.back().channel].undo(taken_.back().place);
    taken_.pop_back();
  }
}

/// When an item is there that sets out at `from` and takes these hops.
double Board::along(const Job& job, std::uint32_t item, double from,
                    const std::vector<Routes::Hop>& hops, bool keep) {
  const Item& what = s_.items[item];
  for (const Routes::Hop& hop : hops) {
    Fetch fetch{item, hop.channel, hop.from, hop.to, 0.0, 0.0, {}};
    if (!what.moves) {
      // One that is given up later in this plan can't come again before.
      from = std::max(
          {from, copy(item, hop.to).until, takeRoom(job, hop.to, what.bytes, keep, fetch.evicted)});
      if (from == kNever) return kNever;
    }
    const double length = s_.graph->channels[hop.channel].seconds(what.bytes);
    fetch.start = channels_[hop.channel].earliest(from, length);
    fetch.end = from = fetch.start + length;
    taken_.push_back({hop.channel, channels_[hop.channel].take(fetch.start, length)});
    if (!keep) continue;
    channelFree_[hop.channel] = channels_[hop.channel].free(s_.now);
    leave(hop.to, fetch.start, fetch.evicted);
    Copy& source = copy(item, hop.from);
    source.until = std::max(source.until, fetch.end);
    copy(item, hop.to) = {fetch.end, fetch.end};
    move(item, hop.to, true);
    if (!what.moves && std::isfinite(s_.graph->memories[hop.to].capacity)) {
      rooms_[hop.to].held.push_back(item);
    }
    made_.fetches.push_back(std::move(fetch));
  }
  return from;
}

/// When an item is in `target`, over the path that is the first to bring it.
double Board::bring(const Job& job, std::uint32_t item, std::uint32_t target, bool keep) {
  if (copy(item, target).arrival < kNever) return copy(item, target).arrival;
  double best = kNever;
  std::uint32_t source = 0;
  const std::vector<double> promised = promised_;
  const std::size_t before = taken_.size();
  for (std::uint64_t rest = places_[item]; rest != 0; rest &= rest - 1) {
    const auto m = static_cast<std::uint32_t>(std::countr_zero(rest));
    const double there = copy(item, m).arrival;
    const std::vector<Routes::Hop>& hops = s_.routes->hops(m, target);
    if (hops.empty()) continue;
    if (std::any_of(hops.begin(), hops.end() - 1, [&](const Routes::Hop& h) {
          return copy(item, h.to).arrival < kNever;  // then that one is the source
        })) {
      continue;
    }
    // At best; what is left needs no trial.
    if (best < kNever && there + s_.routes->seconds(m, target, s_.items[item].bytes) >= best) {
      continue;
    }
    if (places_[item] == std::uint64_t{1} << m) {
      again_ += loadedAgain(item, m, target);
      return along(job, item, there, hops, keep);
    }
    const double end = along(job, item, there, hops, false);
    undoChannels(before);
    promised_ = promised;
    if (end >= best) continue;
    best = end;
    source = m;
  }
  if (best == kNever) return kNever;
  again_ += loadedAgain(item, source, target);
  return along(job, item, copy(item, source).arrival, s_.routes->hops(source, target), keep);
}

double Board::neededFromStores() const {
  double all = 0.0, stores = 0.0;
  for (std::uint32_t i = 0; i < s_.items.size(); ++i) {
    const Item& item = s_.items[i];
    if (item.moves || item.bytes <= 0.0) continue;
    all += item.need;
    if ((places_[i] & finite_) == 0) stores += item.need;
  }
  return all > 0.0 ? stores / all : 0.0;
}

bool Board::bringAhead(std::uint32_t channel) {
  if (channels_[channel].end(s_.now) > s_.now) return false;
  const Link* link = nullptr;
  std::uint32_t best = 0;
  for (const Link& l : s_.graph->channels[channel].links) {
    if ((finite_ >> l.from & 1u) != 0 || (finite_ >> l.to & 1u) == 0) continue;
    for (std::uint32_t i = 0; i < s_.items.size(); ++i) {
      const Item& item = s_.items[i];
      if (item.moves || item.need <= 0.0 || (places_[i] & finite_) != 0) continue;
      if ((places_[i] >> l.from & 1u) == 0 || rooms_[l.to].free < item.bytes) continue;
      if (link != nullptr && item.need <= s_.items[best].need) continue;
      link = &l;
      best = i;
    }
  }
  if (link == nullptr) return false;
  along(Job(), best, s_.now, {{channel, link->from, link->to}}, true);
  return true;
}

Offer Board::settle(std::uint32_t job, std::uint32_t device, bool keep) {
  const Device& d = s_.graph->devices[device];
  const Job& j = s_.jobs[job];
  if (s_.timing->at(device, j.kind).rates.empty()) return {};
  std::fill(promised_.begin(), promised_.end(), 0.0);
  taken_.clear();
  again_ = 0.0;
  double ready = s_.now;
  for (std::uint32_t item : j.reads) {
    if (s_.items[item].bytes <= 0.0 || ready == kNever) continue;
    ready = std::max(ready, bring(j, item, s_.items[item].moves ? d.host : d.memory, keep));
  }
  Run run{job, device, kNever, kNever, {}};
  if (j.scratch > 0.0 && ready < kNever) {
    ready = std::max(ready, takeRoom(j, d.memory, j.scratch, keep, run.evicted));
  }
  if (!keep) undoChannels(0);
  if (ready == kNever) return {};
  const double length = s_.timing->at(device, j.kind).seconds(j.amounts);
  run.start = devices_[device].earliest(ready, length);
  run.end = run.start + length;
  const Offer offer{run.start, run.end, again_};
  if (!keep) return offer;
  devices_[device].take(run.start, length);
  for (std::uint32_t item : j.reads) {
    if (s_.items[item].bytes <= 0.0) continue;
    Copy& c = copy(item, s_.items[item].moves ? d.host : d.memory);
    c.until = std::max(c.until, run.end);
  }
  leave(d.memory, run.start, run.evicted);
  if (j.scratch > 0.0) addRelease(d.memory, {run.end, j.scratch});
  made_.runs.push_back(std::move(run));
  return offer;
}

}  // namespace trex::schedule
