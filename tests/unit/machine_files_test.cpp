// Files that a machine other than machine 0 has, read by all.
#include <gtest/gtest.h>

#include <cstring>

#include "src/machines/remote_files.h"
#include "src/machines/servers.h"
#include "tests/unit/machine_net.h"

namespace trex::machines {
namespace {

using namespace test_net;

/// Bytes that count up; those from `bad` on can't be read.
class CountingFile : public hccm::PageFile {
 public:
  explicit CountingFile(std::uint64_t bad = ~0ull) : bad_(bad) {}
  static std::byte at(std::uint64_t i) { return static_cast<std::byte>(i * 7 % 251); }
  void read(std::uint64_t offset, std::span<std::byte> out) const override {
    if (offset + out.size() > bad_) fail(ExitCode::kInput, "model.trex, byte {}: is bad", bad_);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = at(offset + i);
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t) const override { return "model.trex"; }

 private:
  std::uint64_t bad_;
};

void expectCounts(const hccm::PageFile& file, std::uint64_t offset, std::size_t count) {
  std::vector<std::byte> bytes(count);
  file.read(offset, bytes);
  for (std::size_t i = 0; i < count; ++i) ASSERT_EQ(bytes[i], CountingFile::at(offset + i)) << i;
}

/// What reading throws.
Error problemOf(const hccm::PageFile& file, std::uint64_t offset, std::size_t count) {
  std::vector<std::byte> bytes(count);
  try {
    file.read(offset, bytes);
  } catch (const Error& e) {
    return e;
  }
  return Error(ExitCode::kDone, "nothing was thrown");
}

/// Questions are kept, and answered by the test.
struct Asked {
  std::mutex mutex;
  std::vector<std::pair<std::uint32_t, Fetch>> questions;
  RemoteFiles files{[this](std::uint32_t to, const Bytes& message) {
                      ByteView body;
                      EXPECT_EQ(openMessage(message, body), Kind::kFetch);
                      const std::lock_guard lock(mutex);
                      questions.emplace_back(to, decode<Fetch>(body));
                    },
                    [](std::uint32_t) { return LinkSpeed{}; }};
  std::pair<std::uint32_t, Fetch> next() {
    for (;;) {
      {
        const std::lock_guard lock(mutex);
        if (!questions.empty()) {
          const auto first = questions.front();
          questions.erase(questions.begin());
          return first;
        }
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
};

TEST(RemoteFiles, TakeAnswersOfWhoWasAskedAlone) {
  Asked asked;
  const auto file = asked.files.file(2, 5, "model.trex");
  std::vector<std::byte> bytes(3);
  std::jthread reads([&] { file->read(10, bytes); });
  const auto [to, fetch] = asked.next();
  EXPECT_EQ(to, 2u);
  ASSERT_EQ(fetch.ranges.size(), 1u);
  EXPECT_EQ(fetch.ranges[0].file, 5u);
  EXPECT_EQ(fetch.ranges[0].offset, 10u);
  EXPECT_EQ(asked.files.outstanding(), 1u);
  const Bytes sent{std::byte{1}, std::byte{2}, std::byte{3}};
  const Part part{fetch.number, sent};
  EXPECT_THROW(asked.files.hear(1, part), MessageError);
  EXPECT_THROW(asked.files.hear(2, Part{fetch.number, {}}), MessageError);
  EXPECT_THROW(asked.files.hear(2, Part{fetch.number + 1, part.bytes}), MessageError);
  asked.files.hear(2, part);
  reads.join();
  EXPECT_EQ(bytes, sent);
  asked.files.hear(2, part);  // it comes twice
  EXPECT_EQ(bytes, sent);
  EXPECT_EQ(asked.files.outstanding(), 0u);
}

TEST(RemoteFiles, SayWhyThereIsNoAnswer) {
  Asked asked;
  const auto file = asked.files.file(2, 0, "model.trex");
  const auto whileReading = [&](const std::function<void(std::uint64_t number)>& happens) {
    Error problem(ExitCode::kDone, "");
    std::jthread reads([&] { problem = problemOf(*file, 0, 4); });
    happens(asked.next().second.number);
    reads.join();
    return problem;
  };
  const Error bad = whileReading([&](std::uint64_t number) {
    asked.files.hear(2, NoPart{number, 3, "byte 7 is bad"});
  });
  EXPECT_EQ(bad.code(), ExitCode::kInput);
  EXPECT_NE(std::string(bad.what()).find("machine 2: byte 7 is bad"), std::string::npos);
  const Error code = whileReading([&](std::uint64_t number) {
    asked.files.hear(2, NoPart{number, -99, "no such code"});
  });
  EXPECT_EQ(code.code(), ExitCode::kFailed);
  const Error cut = whileReading([&](std::uint64_t number) {
    asked.files.hear(2, Part{number, Bytes(3)});
  });
  EXPECT_NE(std::string(cut.what()).find("3 bytes of a file instead of 4"), std::string::npos);
  const Error lost = whileReading([&](std::uint64_t) {
    asked.files.lose(1, Error(ExitCode::kFailed, "machine 1 has ended"));  // another one
    asked.files.lose(2, Error(ExitCode::kFailed, "machine 2 has ended"));
  });
  EXPECT_STREQ(lost.what(), "machine 2 has ended");
  EXPECT_STREQ(problemOf(*file, 0, 4).what(), "machine 2 has ended") << "asked afterwards";
  EXPECT_EQ(asked.files.outstanding(), 0u);
}

TEST(RemoteFiles, WhatNobodyWaitsForIsStillOnItsWay) {
  Asked asked;
  const auto file = asked.files.file(2, 0, "model.trex");
  Error problem(ExitCode::kDone, "");
  std::jthread reads([&] { problem = problemOf(*file, 0, 4); });
  const auto number = asked.next().second.number;
  asked.files.stop();
  reads.join();
  EXPECT_EQ(problem.code(), ExitCode::kInterrupted);
  EXPECT_EQ(asked.files.outstanding(), 1u);
  asked.files.hear(2, Part{number, Bytes(4)});
  EXPECT_EQ(asked.files.outstanding(), 0u);
  EXPECT_EQ(problemOf(*file, 0, 4).code(), ExitCode::kInterrupted);
}

Hello with(const std::string& model, std::uint64_t digest, std::uint64_t bytes = 1000) {
  Hello made = hello();
  made.model = model;
  made.modelDigest = digest;
  made.modelBytes = model.empty() ? 0 : bytes;
  return made;
}

/// A window's machine in this thread; the others wait for the end, some of which have models.
struct Holders {
  explicit Holders(const std::vector<Hello>& others, std::uint64_t bad = ~0ull)
      : net(static_cast<std::uint32_t>(others.size()) + 1, 5), servers(wireOf(net, 0), hello()) {
    setLogLevel(LogLevel::kQuiet);
    for (std::uint32_t i = 0; i < others.size(); ++i) {
      threads.emplace_back([this, i, bad, self = others[i]] {
        std::vector<ServedFile> files;
        if (!self.model.empty()) {
          files.push_back({std::make_shared<CountingFile>(bad), self.modelBytes});
        }
        Worker worker(wireOf(net, i + 1), self, std::move(files));
        try {
          const auto welcome = worker.awaitWelcome();
          if (welcome) welcomed(worker, *welcome);
        } catch (const Error& e) {
          worker.failed(e);
        }
        worker.failed(Error(ExitCode::kFailed, "of no use"));  // and waits for the stop
        worker.finish();
      });
    }
  }
  ~Holders() { servers.finish(0); }
  void welcomed(Worker& worker, const Welcome& welcome) {
    if (welcome.holder == 0) return;
    EXPECT_EQ(welcome.model, "model.trex");
    EXPECT_EQ(welcome.fileBytes.at(0), 1000u);
    if (welcome.holder == worker.rank()) return;
    expectCounts(*worker.file(welcome.holder, 0, welcome.model), 300, 700);
    ++read;
  }

  Net net;
  std::atomic<int> read{0};
  std::vector<std::jthread> threads;
  Servers servers;  // ends before the threads
};

TEST(Holder, AllReadTheModelOfTheMachineThatHasIt) {
  Holders all({with("", 0), with("model.trex", 9), with("", 0)});
  ASSERT_EQ(all.servers.findHolder(kGoOn), 2u);
  all.servers.welcomeTo(2, {{}, {}}, {64, 64, ""});
  const auto file = all.servers.model(2);
  std::vector<std::byte> a(10), b(1);
  const std::vector<hccm::FilePart> parts = {{990, a}, {0, b}};
  file->readAll(parts);
  EXPECT_EQ(a[9], CountingFile::at(999));
  EXPECT_EQ(b[0], CountingFile::at(0));
  expectCounts(*file, 0, 1000);
  while (all.read < 2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

TEST(Holder, WhatItCanNotReadIsSaid) {
  Holders all({with("model.trex", 9)}, 500);
  ASSERT_EQ(all.servers.findHolder(kGoOn), 1u);
  all.servers.welcomeTo(1, {{}, {}}, {64, 64, ""});
  const auto file = all.servers.model(1);
  expectCounts(*file, 0, 500);
  const Error bad = problemOf(*file, 400, 200);
  EXPECT_EQ(bad.code(), ExitCode::kInput);
  EXPECT_NE(std::string(bad.what()).find("machine 1: model.trex, byte 500: is bad"),
            std::string::npos);
  expectCounts(*file, 100, 100);
}

TEST(Holder, NoModelOrDifferentOnesAreErrors) {
  const auto problem = [](const std::vector<Hello>& others) {
    Holders all(others);
    try {
      all.servers.findHolder(kGoOn);
    } catch (const Error& e) {
      return fmt::format("{} {}", static_cast<int>(e.code()), e.what());
    }
    return std::string("none");
  };
  EXPECT_NE(problem({with("", 0), with("", 0)}).find("2 trex view under mpirun: name the model"),
            std::string::npos);
  const std::string two = problem({with("a.trex", 1), with("", 0), with("b.trex", 2)});
  EXPECT_NE(two.find("2 two machines have different models"), std::string::npos);
  EXPECT_NE(two.find("a.trex"), std::string::npos);
  EXPECT_NE(two.find("machine 3"), std::string::npos);
  EXPECT_EQ(problem({with("", 0), with("a.trex", 1), with("b.trex", 1)}), "none");
}

}  // namespace
}  // namespace trex::machines
