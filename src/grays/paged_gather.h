// Cones through a tree of which only pages are on the device. Private to src/grays.
//
// As GatherPass, but batches are cut into chunks of PagePlan::queries cones, of which two are under
// way at a time. Before a chunk starts, pages that the chunks before it missed are copied into
// slots that no running chunk sees (page_table.h): the copies overlap the tracing.
#pragma once

#include <array>
#include <chrono>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "asvo/asvo.h"
#include "src/grays/grid_tracer.h"
#include "src/grays/page_plan.h"
#include "src/grays/page_table.h"
#include "src/grays/query_order.h"
#include "src/grays/shaderio.h"
#include "src/vulkan/vulkan.h"

namespace trex {

/// The limits of a device for planPages(). `storageBuffers`: do not read through texel buffers.
PageLimits pageLimits(const vulkan::Device& device, bool storageBuffers);

class PagedGather {
 public:
  /// The tree must outlive it. The plan must fit (planPages()). Throws Error(kMemoryOrDevice).
  PagedGather(vulkan::Device& device, const asvo::Tree& tree, const PagePlan& plan);

  /// What cones read of each node (ConeTable), which must stay as it is until the next call. To be
  /// called before the first submit(), and after drain().
  void setCones(std::span<const asvo::uvec4> cones);
  /// As GRayTracer's.
  int submit(std::span<const shaderio::GatherQuery> queries);
  std::span<const shaderio::GatherResult> finish(int ticket);
  /// Traces all that was submitted to its end; tickets stay valid.
  void drain();

  double seconds() const { return seconds_; }
  const PageTable& pages() const { return pages_; }

 private:
  using Clock = std::chrono::steady_clock;
  /// One of the two batches of the caller.
  struct Ticket {
    std::vector<shaderio::GatherQuery> queries;
    std::vector<shaderio::GatherResult> results;
    std::size_t started = 0, ended = 0;
    bool open = false;
  };
  /// One of the two chunks on the device.
  struct Work {
    std::optional<vulkan::Buffer> queries, results, table, marks, staging;
    std::optional<vulkan::Bindings> bindings;
    std::optional<vulkan::Batch> batch;
    std::uint64_t number = 0;  ///< of the chunk, from 1
    unsigned ticket = 0;
    std::size_t first = 0, count = 0;
    std::size_t staged = 0;  ///< bytes
    Clock::time_point start;
    bool running = false;
  };
  void makeKernels();
  void makeWork(Work& work);
  void put(Work& work, const vulkan::Buffer& to, std::uint64_t offset,
           std::span<const std::byte> bytes);
  void details(std::uint32_t page, std::vector<asvo::uvec4>& words) const;
  std::span<const asvo::uvec4> conesOf(std::uint32_t page) const;
  template <typename Words>
  void fill(vulkan::Buffer& pool, const Words& words);
  void loadPages(Work& work);
  void start(unsigned ticket);
  void pump();
  void wait(Work& work);
  void advance();

  vulkan::Device& device_;
  const asvo::Tree& tree_;
  PagePlan plan_;
  PageTable pages_;
  GridTracer tracer_;  ///< for what it says of a cone's start; without arrays
  QueryOrder order_{tracer_};
  std::span<const asvo::uvec4> cones_;
  std::optional<vulkan::Buffer> grid_, details_, conePool_;
  std::array<std::optional<vulkan::Kernel>, 2> kernels_;  ///< for cones that start wide; for all
  std::array<Work, 2> works_;
  std::array<Ticket, 2> tickets_;
  std::vector<asvo::uvec4> page_;  ///< being loaded
  vulkan::Slicer slicer_{1u << 14};
  Clock::time_point lastEnd_{};
  unsigned next_ = 0;         ///< ticket
  std::uint64_t chunks_ = 0;  ///< started so far
  double seconds_ = 0.0;
};

}  // namespace trex
