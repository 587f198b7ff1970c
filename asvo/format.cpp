// The file of a tree, as FORMAT.md describes it, and the validator.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "asvo/asvo.h"

namespace asvo {
namespace {

static_assert(std::endian::native == std::endian::little, "files are little-endian");

constexpr char kMagic[8] = {'A', 'S', 'V', 'O', 't', 'r', 'e', 'e'};
constexpr std::uint32_t kVersion = 3;
constexpr std::uint32_t kByteOrder = 0x01020304u;
constexpr std::uint64_t kAlignment = 4096;

struct Section {
  std::uint64_t offset;  ///< from the start of the file, a multiple of 4096
  std::uint64_t hash;    ///< XXH3-64 of its bytes
};

constexpr int kSections = 4;

/// 144 bytes at the start of the file.
struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t byteOrder;
  std::uint64_t fileBytes;
  std::uint64_t sourceHash;
  AsvoInfo info;
  Section sections[kSections];  ///< nodes, voxels, leaves, emitters
  std::uint32_t emitterCount;
  std::uint32_t reserved;
  std::uint64_t hash;  ///< XXH3-64 of the 136 bytes before
};
static_assert(sizeof(Header) == 144 && offsetof(Header, info) == 32 &&
              offsetof(Header, sections) == 64 && offsetof(Header, hash) == 136);

[[noreturn]] void fail(const std::string& what) { throw FormatError("asvo: " + what); }

std::uint64_t aligned(std::uint64_t bytes) { return (bytes + kAlignment - 1) & ~(kAlignment - 1); }

std::array<std::uint64_t, kSections> sectionBytes(const AsvoInfo& info, std::uint64_t emitters) {
  return {std::uint64_t{info.nodeCount} * sizeof(uvec2),
          std::uint64_t{info.nodeCount} * sizeof(uvec4),
          std::uint64_t{info.leafCount} * sizeof(uvec2), emitters * sizeof(Emitter)};
}

void checkInfo(const AsvoInfo& info) {
  if (info.depth < 1 || info.depth > ASVO_MAX_DEPTH) {
    fail("depth " + std::to_string(info.depth) + " is not in 1.." + std::to_string(ASVO_MAX_DEPTH));
  }
  const bool finite = std::isfinite(info.lowerX) && std::isfinite(info.lowerY) &&
                      std::isfinite(info.lowerZ) && std::isfinite(info.size);
  if (!finite || !(info.size > 0.0f)) fail("the cube is not finite or has no size");
  if (info.nodeCount < 1 || info.firstLeaf > info.nodeCount ||
      info.leafCount != info.nodeCount - info.firstLeaf) {
    fail("counts of nodes and leaves disagree");
  }
}

/// Level offsets from the child masks; checks that children stand where the layout says.
std::vector<std::uint32_t> levelsOf(const AsvoInfo& info, std::span<const uvec2> nodes) {
  std::vector<std::uint32_t> offsets = {0, 1};
  std::uint64_t next = 1;
  for (std::uint32_t level = 0; level < info.depth; ++level) {
    for (std::uint32_t i = offsets[level]; i < offsets[level + 1]; ++i) {
      const uvec2& node = nodes[i];
      const bool emptyRoot = i == 0 && info.nodeCount == 1;
      if (node.x != next || node.y > 255u || (node.y == 0 && !emptyRoot)) {
        fail("node " + std::to_string(i) + " has a wrong first child or child mask");
      }
      next += static_cast<std::uint32_t>(std::popcount(node.y));
      if (next > info.nodeCount) fail("node " + std::to_string(i) + " has children beyond the end");
    }
    offsets.push_back(static_cast<std::uint32_t>(next));
  }
  if (next != info.nodeCount || offsets[info.depth] != info.firstLeaf) {
    fail("the levels do not end with the leaves");
  }
  return offsets;
}

void checkLeaves(const Tree& tree) {
  for (std::uint32_t k = 0; k < tree.info.leafCount; ++k) {
    const uvec2 node = tree.nodes[tree.info.firstLeaf + k];
    if (node.x != 0 || node.y != 0) fail("leaf " + std::to_string(k) + " has children");
    if ((tree.leaves[k].x | tree.leaves[k].y) == 0) {
      fail("leaf " + std::to_string(k) + " is empty");
    }
  }
}

void checkEmitters(const Tree& tree) {
  for (std::size_t i = 0; i < tree.emitters.size(); ++i) {
    const Emitter& e = tree.emitters[i];
    const bool inOrder = i == 0 || tree.emitters[i - 1].node < e.node;
    if (!inOrder || e.node >= tree.info.nodeCount || (e.front | e.back) == 0) {
      fail("emitter " + std::to_string(i) + " is out of order, dark, or of no node");
    }
  }
}

Header readHeader(std::span<const std::byte> bytes) {
  Header header;
  if (bytes.size() < sizeof(Header)) fail("shorter than a header");
  std::memcpy(&header, bytes.data(), sizeof(Header));
  if (std::memcmp(header.magic, kMagic, sizeof(kMagic)) != 0) fail("not a tree (wrong magic)");
  if (header.byteOrder != kByteOrder) fail("written with another byte order");
  if (header.version != kVersion) {
    fail("version " + std::to_string(header.version) + ", expected " + std::to_string(kVersion));
  }
  if (header.hash != XXH3_64bits(&header, offsetof(Header, hash))) fail("header checksum differs");
  if (header.fileBytes != bytes.size()) fail("truncated, or bytes behind the end");
  checkInfo(header.info);
  std::uint64_t expected = kAlignment;
  const auto sizes = sectionBytes(header.info, header.emitterCount);
  for (int i = 0; i < kSections; ++i) {
    if (header.sections[i].offset != expected)
      fail("section " + std::to_string(i) + " is misplaced");
    expected += aligned(sizes[i]);
  }
  if (expected != bytes.size() || header.reserved != 0) fail("sections do not fill the file");
  return header;
}

template <typename T>
void readSection(std::span<const std::byte> bytes, const Section& section, std::uint64_t size,
                 std::vector<T>& out) {
  const auto data = bytes.subspan(section.offset, size);
  if (XXH3_64bits(data.data(), data.size()) != section.hash) {
    fail("checksum of the section at byte " + std::to_string(section.offset) + " differs");
  }
  const auto padding = bytes.subspan(section.offset + size, aligned(size) - size);
  if (std::any_of(padding.begin(), padding.end(), [](std::byte b) { return b != std::byte{}; })) {
    fail("padding behind byte " + std::to_string(section.offset + size) + " is not zero");
  }
  out.resize(size / sizeof(T));
  if (size > 0) std::memcpy(static_cast<void*>(out.data()), data.data(), size);
}

}  // namespace

void validate(const Tree& tree) {
  checkInfo(tree.info);
  if (tree.nodes.size() != tree.info.nodeCount || tree.voxels.size() != tree.info.nodeCount ||
      tree.leaves.size() != tree.info.leafCount) {
    fail("the arrays do not have the sizes that the header gives");
  }
  if (tree.levelOffsets != levelsOf(tree.info, tree.nodes)) fail("level offsets disagree");
  checkLeaves(tree);
  checkEmitters(tree);
}

std::vector<std::byte> Tree::toBytes() const {
  const auto sizes = sectionBytes(info, emitters.size());
  const void* data[kSections] = {nodes.data(), voxels.data(), leaves.data(), emitters.data()};
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof(kMagic));
  header.version = kVersion;
  header.byteOrder = kByteOrder;
  header.sourceHash = sourceHash;
  header.info = info;
  header.emitterCount = static_cast<std::uint32_t>(emitters.size());
  header.fileBytes = kAlignment;
  for (int i = 0; i < kSections; ++i) {
    header.sections[i] = {header.fileBytes, XXH3_64bits(data[i], sizes[i])};
    header.fileBytes += aligned(sizes[i]);
  }
  header.hash = XXH3_64bits(&header, offsetof(Header, hash));
  std::vector<std::byte> bytes(header.fileBytes);
  std::memcpy(bytes.data(), &header, sizeof(header));
  for (int i = 0; i < kSections; ++i) {
    if (sizes[i] > 0) std::memcpy(bytes.data() + header.sections[i].offset, data[i], sizes[i]);
  }
  return bytes;
}

Tree Tree::fromBytes(std::span<const std::byte> bytes) {
  const Header header = readHeader(bytes);
  const auto gap = bytes.subspan(sizeof(Header), kAlignment - sizeof(Header));
  if (std::any_of(gap.begin(), gap.end(), [](std::byte b) { return b != std::byte{}; })) {
    fail("padding behind the header is not zero");
  }
  const auto sizes = sectionBytes(header.info, header.emitterCount);
  Tree tree;
  tree.info = header.info;
  tree.sourceHash = header.sourceHash;
  readSection(bytes, header.sections[0], sizes[0], tree.nodes);
  readSection(bytes, header.sections[1], sizes[1], tree.voxels);
  readSection(bytes, header.sections[2], sizes[2], tree.leaves);
  readSection(bytes, header.sections[3], sizes[3], tree.emitters);
  tree.levelOffsets = levelsOf(tree.info, tree.nodes);
  validate(tree);
  return tree;
}

}  // namespace asvo
