// The files that a bundle was baked from.
#include "src/bundle/bundle.h"
#include "src/core/error.h"
#include "src/core/hash.h"

namespace trex {
namespace {

namespace fs = std::filesystem;

fs::path folderOf(const fs::path& bundle) {
  std::error_code ignored;
  const fs::path folder = bundle.has_parent_path() ? bundle.parent_path() : fs::path(".");
  const fs::path whole = fs::weakly_canonical(fs::absolute(folder, ignored), ignored);
  return whole.empty() ? folder : whole;
}

bool same(const SourceFile& a, const SourceFile& b) {
  return a.bytes == b.bytes && a.modifiedNanoseconds == b.modifiedNanoseconds;
}

}  // namespace

SourceState compareSource(const fs::path& bundle, const bundle::BakedFile& file) {
  const fs::path path = folderOf(bundle) / file.file.path;
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return SourceState::kAbsent;
  try {
    const SourceFile found = examineSource(path);
    if (same(found, file.file)) return SourceState::kUnchanged;
    if (found.bytes != file.file.bytes) return SourceState::kChanged;
    return hashFile(path) == file.hash ? SourceState::kUnchanged : SourceState::kChanged;
  } catch (const Error&) {
    return SourceState::kAbsent;  // it can't be read, so it can't be compared
  }
}

std::vector<bundle::BakedFile> hashSources(const std::vector<SourceFile>& files,
                                           const fs::path& target) {
  std::vector<bundle::BakedFile> out;
  const fs::path folder = folderOf(target);
  for (const SourceFile& file : files) {
    const std::uint64_t hash = hashFile(file.path);
    if (!same(examineSource(file.path), file)) {
      fail(ExitCode::kInput, "{}: changed while it was read; bake again", file.path);
    }
    const fs::path whole = fs::weakly_canonical(file.path);
    out.push_back(
        {{whole.lexically_relative(folder).generic_string(), file.bytes, file.modifiedNanoseconds},
         hash});
  }
  return out;
}

}  // namespace trex
