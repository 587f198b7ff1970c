// Pages of machine 0 that other machines pass on.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <map>
#include <mutex>
#include <numeric>
#include <random>
#include <thread>

#include "src/machines/remote_pages.h"
#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

constexpr std::uint64_t kPage = 3000, kPages = 200;

std::byte byteAt(std::uint64_t offset) {
  return static_cast<std::byte>(offset * 7 + offset / kPage);
}

class Numbers : public hccm::PageFile {
 public:
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    served += out.size();
    for (std::byte& b : out) b = byteAt(offset++);
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t) const override { return "numbers"; }
  mutable std::atomic<std::uint64_t> served{0};
};

std::unique_ptr<PageShelf> shelf(std::uint64_t limit = ~0ull, int* file = nullptr) {
  const int made = ::memfd_create("trex-test", MFD_CLOEXEC);
  if (file != nullptr) *file = made;
  return std::make_unique<PageShelf>(made, limit);
}

/// Machine 0, which serves the file, and others that read it, over the net of the tests, which
/// mixes and doubles what they say.
class Readers {
 public:
  Readers(std::uint32_t machines, unsigned seed) : net(machines, seed), zero_(wireOf(net, 0)) {
    server_.setFiles({{file, kPage * kPages}});
    zero_.listen({.message =
                      [this](std::uint32_t from, Kind kind, ByteView body) {
                        ASSERT_EQ(kind, Kind::kFetch);
                        server_.ask(from, decode<Fetch>(body));
                      },
                  .tick = {},
                  .broken = [this](const Error& e) { problem = e.what(); }});
    for (std::uint32_t i = 1; i < machines; ++i) {
      auto& one = others_.emplace_back(std::make_unique<Other>(net, i));
      one->pages.setPlace(i, machines);
      one->link.listen({.message =
                            [this, o = one.get()](std::uint32_t from, Kind kind, ByteView body) {
                              if (kind == Kind::kPart) {
                                const Part part = decode<Part>(body);
                                Bytes bytes(part.bytes.begin(), part.bytes.end());
                                if (from == spoils && !bytes.empty()) {
                                  bytes.front() ^= std::byte{1};
                                }
                                o->pages.hearPart(from, {part.number, bytes});
                              } else if (kind == Kind::kNoPart) {
                                o->pages.hearNoPart(from, decode<NoPart>(body));
                              } else {
                                o->pages.hearFetch(from, decode<Fetch>(body));
                              }
                            },
                        .tick = {},
                        .broken = [this](const Error& e) { problem = e.what(); }});
    }
  }
  ~Readers() {
    for (auto& o : others_) o->pages.stop();
    server_.stop();
  }
  RemotePages& of(std::uint32_t machine) { return others_[machine - 1]->pages; }
  /// All have a shelf, and know of each other.
  void passOn() {
    std::vector<PageHome> homes;
    for (std::uint32_t i = 1; i < net.size(); ++i) homes.push_back({i, kWholeWeight});
    for (std::uint32_t i = 1; i < net.size(); ++i) {
      if (i != withoutShelf) of(i).passOn(shelf(), {kPage * kPages});
      of(i).hearHomes({homes});
    }
  }
  /// A machine reads all pages, in an order of its own and by two threads, some at a time.
  void readAll(std::uint32_t machine) {
    const auto pages = of(machine).file(0, "a.trex");
    std::vector<std::jthread> threads;
    for (unsigned thread = 0; thread < 2; ++thread) {
      threads.emplace_back([&, thread] {
        std::vector<std::uint64_t> order(kPages);
        std::iota(order.begin(), order.end(), 0);
        std::shuffle(order.begin(), order.end(), std::mt19937(machine * 2 + thread));
        for (std::size_t i = 0; i < order.size(); i += 8) {
          std::vector<std::byte> bytes(8 * kPage);
          std::vector<hccm::FilePart> parts;
          for (std::size_t k = 0; k < 8; ++k) {
            const std::uint64_t offset = order[i + k] * kPage;
            parts.push_back({offset, std::span(bytes).subspan(k * kPage, kPage), checksum(offset)});
          }
          pages->readAll(parts);
          for (const hccm::FilePart& part : parts) {
            for (std::size_t at = 0; at < kPage; at += 13) {
              ASSERT_EQ(part.out[at], byteAt(part.offset + at));
            }
          }
        }
      });
    }
  }
  void allReadAll() {
    std::vector<std::jthread> machines;
    for (std::uint32_t i = 1; i < net.size(); ++i) {
      if (i != idle) machines.emplace_back([this, i] { readAll(i); });
    }
  }
  static std::uint64_t checksum(std::uint64_t offset) {
    std::vector<std::byte> page(kPage);
    for (std::byte& b : page) b = byteAt(offset++);
    return XXH3_64bits(page.data(), page.size());
  }
  static constexpr std::uint64_t kAll = kPage * kPages;

  Net net;
  std::shared_ptr<Numbers> file = std::make_shared<Numbers>();
  std::uint32_t idle = ~0u, withoutShelf = ~0u;
  std::atomic<std::uint32_t> spoils = ~0u;
  std::string problem;

 private:
  struct Other {
    Other(Net& net, std::uint32_t rank)
        : pages([this](std::uint32_t to, Bytes message) { link.send(to, std::move(message)); },
                [](const Error&) {}),
          link(wireOf(net, rank)) {}
    RemotePages pages;
    Link link;  // the last: it calls the others
  };
  PageServer server_{[this](std::uint32_t to, Bytes answer) { zero_.send(to, std::move(answer)); },
                     [this](const Error& e) { problem = e.what(); }};
  Link zero_;
  std::vector<std::unique_ptr<Other>> others_;
};

TEST(RemotePages, EachPageLeavesMachineZeroOnce) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    Readers all(4, seed);
    all.passOn();
    all.allReadAll();
    EXPECT_EQ(all.problem, "");
    // A question that came twice was answered twice.
    EXPECT_LE(all.file->served, 2 * Readers::kAll);
    std::uint64_t passed = 0;
    for (std::uint32_t i = 1; i < 4; ++i) passed += all.of(i).bytes().passed;
    EXPECT_GE(passed, 2 * Readers::kAll);
    // What is there already is asked for nowhere.
    const std::uint64_t served = all.file->served;
    all.allReadAll();
    EXPECT_EQ(all.file->served, served);
  }
}

TEST(RemotePages, WithoutHomesMachineZeroHasThemAll) {
  Readers all(3, 5);
  all.allReadAll();
  EXPECT_GE(all.file->served, 4 * Readers::kAll);  // two machines, two threads
  EXPECT_EQ(all.of(1).bytes().passed + all.of(2).bytes().passed, 0u);
}

/// One that stopped is waited for once, then machine 0 is asked.
TEST(RemotePages, WhoDoesNotAnswerIsNotWaitedFor) {
  Readers all(4, 6);
  all.passOn();
  all.net.muteAfter(3, Kind::kPart);
  all.idle = 3;
  all.allReadAll();
  // What two threads of two machines asked before they knew, of some 100 questions.
  EXPECT_GE(all.net.unheard(), 1u);
  EXPECT_LE(all.net.unheard(), 8u);
  EXPECT_EQ(all.problem, "");
  all.net.hearAgain();
}

TEST(RemotePages, WhoHasEndedIsNotWaitedFor) {
  Readers all(4, 7);
  all.passOn();
  all.net.muteAfter(3, Kind::kPart);
  all.idle = 3;
  std::jthread readers([&] { all.allReadAll(); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  all.of(1).lost(3);
  all.of(2).lost(3);
  readers.join();
  EXPECT_EQ(all.problem, "");
  all.net.hearAgain();
}

TEST(RemotePages, WhoHasNoShelfSaysSo) {
  Readers all(4, 8);
  all.withoutShelf = 2;
  all.passOn();
  all.allReadAll();
  EXPECT_EQ(all.problem, "");
}

/// What does not fit a page's checksum is asked of machine 0.
TEST(RemotePages, WhatWasSpoiledOnTheWayIsAskedForAgain) {
  Readers all(4, 9);
  all.passOn();
  all.spoils = 3;
  all.idle = 3;
  all.allReadAll();
  EXPECT_EQ(all.problem, "");
}

TEST(RemotePages, TheEndWakesWhoWaits) {
  Readers all(3, 10);
  all.passOn();
  all.net.muteAfter(2, Kind::kPart);
  std::atomic<bool> ended = false;
  std::jthread reader([&] {
    const auto pages = all.of(1).file(0, "a.trex");
    std::vector<std::byte> page(kPage);
    try {
      for (std::uint64_t i = 0;; i = (i + 1) % kPages) {
        const hccm::FilePart one{i * kPage, page, Readers::checksum(i * kPage)};
        pages->readAll({&one, 1});
      }
    } catch (const Error& e) {
      ended = e.code() == ExitCode::kInterrupted;
    }
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  all.of(1).stop();
  reader.join();
  EXPECT_TRUE(ended);
  all.net.hearAgain();
}

TEST(RemotePages, WhatMakesNoSenseIsRefused) {
  RemotePages pages([](std::uint32_t, Bytes) {}, [](const Error&) {});
  pages.setPlace(1, 3);
  EXPECT_THROW(pages.hearPart(0, {1, Bytes(4)}), MessageError);
  EXPECT_THROW(pages.hearHomes({{{0, 1}}}), MessageError);
  EXPECT_THROW(pages.hearHomes({{{3, 1}}}), MessageError);
  EXPECT_THROW(pages.hearHomes({{{1, 0}}}), MessageError);
  EXPECT_THROW(pages.hearHomes({{{1, 1}, {2, 1}, {1, 1}}}), MessageError);
  EXPECT_THROW(pages.hearLink({1.0, -1.0}), MessageError);
  pages.hearFetch(2, {1, {{~0ull, 7, 1}}});  // it passes nothing on, and says so
  pages.passOn(shelf(), {kPage});
  EXPECT_THROW(pages.hearFetch(2, {1, {{kPage - 1, 0, 2}}}), MessageError);
  EXPECT_THROW(pages.hearFetch(2, {1, {{0, 1, 2}}}), MessageError);
}

/// One of two questions fails: what comes of the other then has nowhere to go.
TEST(RemotePages, AnAnswerThatNobodyWaitsForIsDropped) {
  struct Asked {
    std::uint32_t to;
    Fetch fetch;
  };
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<Asked> asked;
  RemotePages pages(
      [&](std::uint32_t to, Bytes message) {
        ByteView body;
        ASSERT_EQ(openMessage(message, body), Kind::kFetch);
        const std::lock_guard lock(mutex);
        asked.push_back({to, decode<Fetch>(body)});
        changed.notify_all();
      },
      [](const Error&) {});
  pages.setPlace(1, 3);
  pages.hearHomes({{{2, 1}}});
  const auto file = pages.file(0, "a.trex");
  Bytes out(2 * kPage);
  bool failed = false;
  std::thread reader([&] {
    // A page, which has a home, and a part of something else.
    const std::array<hccm::FilePart, 2> parts = {
        hccm::FilePart{0, std::span(out).first(kPage), Readers::checksum(0)},
        hccm::FilePart{kPage, std::span(out).last(kPage), 0}};
    try {
      file->readAll(parts);
    } catch (const Error& e) {
      failed = e.code() == ExitCode::kInput;
    }
  });
  {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return asked.size() == 2; });
  }
  for (const Asked& a : asked)
    if (a.to == 0) pages.hearNoPart(0, {a.fetch.number, 3, "it is gone"});
  reader.join();
  EXPECT_TRUE(failed);
  const Bytes before = out;
  for (const Asked& a : asked)
    if (a.to == 2) pages.hearPart(2, {a.fetch.number, Bytes(kPage, std::byte{9})});
  EXPECT_EQ(out, before);
}

TEST(PageShelf, GivesWhatItWasGivenOrNothing) {
  int file = 0;
  const auto kept = shelf(3 * kPage, &file);
  const auto pageAt = [](std::uint64_t offset) {
    std::vector<std::byte> page(kPage);
    for (std::byte& b : page) b = byteAt(offset++);
    return page;
  };
  for (std::uint64_t i = 0; i < 5; ++i) kept->keep(i * kPage, pageAt(i * kPage));
  std::vector<std::byte> out(kPage), less(kPage - 1);
  EXPECT_TRUE(kept->read(kPage, out));
  EXPECT_EQ(out, pageAt(kPage));
  EXPECT_FALSE(kept->read(kPage, less));
  EXPECT_FALSE(kept->read(kPage + 1, out));
  EXPECT_FALSE(kept->read(3 * kPage, out));  // there was no room
  const char other = 1;
  ASSERT_EQ(::pwrite(file, &other, 1, 5), 1);
  EXPECT_FALSE(kept->read(0, out));
  EXPECT_TRUE(kept->read(2 * kPage, out));
  PageShelf full(::open("/dev/full", O_RDWR | O_CLOEXEC), ~0ull);
  full.keep(0, out);
  EXPECT_FALSE(full.read(0, out));
}

TEST(PageHomes, ShareThePagesByTheirLinks) {
  const auto countOf = [](std::span<const PageHome> homes) {
    std::map<std::uint32_t, int> pages;
    for (std::uint64_t p = 0; p < 30'000; ++p) ++pages[homeOf(p * 14'801, homes)];
    return pages;
  };
  EXPECT_EQ(homeOf(5, {}), 0u);
  const std::vector<PageHome> three{{1, 256}, {2, 256}, {3, 128}}, two{{1, 256}, {3, 128}};
  auto pages = countOf(three);
  EXPECT_NEAR(pages[1], 12'000, 400);
  EXPECT_NEAR(pages[3], 6'000, 400);
  // Those of the others stay where one is lost.
  for (std::uint64_t p = 0; p < 1000; ++p) {
    if (const std::uint32_t home = homeOf(p * 14'801, three); home != 2) {
      EXPECT_EQ(homeOf(p * 14'801, two), home);
    }
  }
}

TEST(PageHomes, AreMachinesWhoseLinksAreNotSlow) {
  const LinkSpeed fast{1e-4, 1e8}, fifth{1e-4, 2e7}, slow{1e-4, 5e6}, unknown;
  const auto homes = [](std::vector<HomeCandidate> of) { return chooseHomes(of); };
  EXPECT_EQ(homes({{1, fast}, {2, fast}, {3, fifth}, {4, slow}, {5, unknown}}),
            (std::vector<PageHome>{{1, 256}, {2, 256}, {3, 51}, {5, 256}}));
  EXPECT_TRUE(homes({{1, fast}}).empty());
  EXPECT_TRUE(homes({}).empty());
  EXPECT_EQ(homes({{1, unknown}, {2, unknown}}).size(), 2u);
}

}  // namespace
}  // namespace trex::machines
