// A file of another machine as a PageFile: what is read is asked for, not too much at once.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>

#include "hccmesh/pages.h"
#include "src/machines/link_probe.h"

namespace trex::machines {

/// Thread safe, as far as what it is made of is.
class RemoteFile final : public hccm::PageFile {
 public:
  /// `read` brings all of some parts, or throws Error; `link`: what is known of the way there;
  /// `name`: for messages.
  RemoteFile(std::function<void(std::span<const hccm::FilePart>)> read,
             std::function<LinkSpeed()> link, std::string name)
      : read_(std::move(read)), link_(std::move(link)), name_(std::move(name)) {}
  void read(std::uint64_t offset, std::span<std::byte> out) const override;
  /// Of pages.
  void readAll(std::span<const hccm::FilePart> parts) const override;
  unsigned partsAtOnce() const override { return pagesAtOnce(link_()); }
  hccm::FileSpeed speed() const override {
    const LinkSpeed link = link_();
    return {link.roundTrip, link.bandwidth};
  }
  void readAhead(std::uint64_t, std::uint64_t) const override {}
  std::string place(std::uint64_t offset) const override {
    return name_ + ", byte " + std::to_string(offset);
  }

 private:
  std::function<void(std::span<const hccm::FilePart>)> read_;
  std::function<LinkSpeed()> link_;
  std::string name_;
};

/// Bytes of all parts.
inline std::size_t sizeOf(std::span<const hccm::FilePart> parts) {
  std::size_t bytes = 0;
  for (const hccm::FilePart& part : parts) bytes += part.out.size();
  return bytes;
}

/// Gives out what came of parts, one after the other; `came` is as long as all of them.
void giveOut(std::span<const std::byte> came, std::span<const hccm::FilePart> parts);

}  // namespace trex::machines
