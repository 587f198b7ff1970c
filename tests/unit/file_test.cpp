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
  EXPECT_THROW(checkWritable(folder_ / std::string(300, 'a')), Error);
  fs::create_symlink("b", folder_ / "c");
  fs::create_symlink("c", folder_ / "b");
  EXPECT_THROW(checkWritable(folder_ / "b"), Error);
}

/// The temporary's name is longer than the target's, which may be as long as names get.
TEST_F(FileTest, NamesAsLongAsTheyGet) {
  const fs::path target = folder_ / (std::string(251, 'a') + ".exr");
  checkWritable(target);
  writeTextAtomically(target, "all");
  EXPECT_EQ(read(target), "all");
  std::ofstream(folder_ / ("." + std::string(227, 'a') + ".999999999.tmp.exr")) << "left";
  EXPECT_EQ(removeDeadTemporaries(target).size(), 1u);
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(FileTest, OutputsAreNoInputs) {
  std::ofstream(folder_ / "a.exr") << "picture";
  fs::create_symlink("a.exr", folder_ / "same.exr");
  EXPECT_THROW(checkIsNotInput(folder_ / "a.exr", folder_ / "a.exr"), Error);
  EXPECT_THROW(checkIsNotInput(folder_ / "same.exr", folder_ / "a.exr"), Error);
  checkIsNotInput(folder_ / "b.exr", folder_ / "a.exr");
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
