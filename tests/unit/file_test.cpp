#include "src/core/file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include "src/core/error.h"
#include "src/core/memory.h"

namespace trex {
namespace {
namespace fs = std::filesystem;

class FileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / fmt::format("trex-file-{}", ::getpid());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  static std::string read(const fs::path& path) {
    std::ifstream in(path);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  std::size_t filesLeft() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}));
  }
  fs::path folder_;
};

TEST_F(FileTest, ReplacesWhole) {
  const fs::path target = folder_ / "a.txt";
  for (const char* text : {"old", "new and longer"}) {
    writeAtomically(target, [&](const fs::path& p) { std::ofstream(p) << text; });
    EXPECT_EQ(read(target), text);
  }
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(FileTest, FailureKeepsTheOldFileAndLeavesNothing) {
  const fs::path target = folder_ / "a.txt";
  std::ofstream(target) << "old";
  EXPECT_THROW(writeAtomically(target,
                               [&](const fs::path& p) {
                                 std::ofstream(p) << "half";
                                 throw Error(ExitCode::kOutput, "disk full");
                               }),
               Error);
  EXPECT_EQ(read(target), "old");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(FileTest, WriterThatMakesNothingIsAnError) {
  try {
    writeAtomically(folder_ / "b.txt", [](const fs::path&) {});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.code(), ExitCode::kOutput);
    EXPECT_NE(std::string(e.what()).find("b.txt"), std::string::npos);
  }
}

TEST_F(FileTest, CheckWritableNamesTheFolder) {
  EXPECT_THROW(checkWritable(folder_ / "none" / "a.png"), Error);
  EXPECT_THROW(checkWritable(folder_), Error);
  checkWritable(folder_ / "a.png");
}

TEST(Memory, FormatsForPeople) {
  EXPECT_EQ(formatBytes(17), "17 B");
  EXPECT_EQ(formatBytes(1536), "1.5 KiB");
  EXPECT_EQ(formatBytes(std::uint64_t{8} << 30), "8.0 GiB");
  EXPECT_GT(peakResidentBytes(), 1u << 20);
  EXPECT_GE(availableMemoryLimit(), peakResidentBytes());
}

}  // namespace
}  // namespace trex
