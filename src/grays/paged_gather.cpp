#include "src/grays/paged_gather.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "src/grays/shaders.h"
#include "src/grays/tables.h"
#include "src/grays/vulkan_passes.h"

namespace trex {

namespace {

constexpr std::uint64_t kWordBytes = sizeof(asvo::uvec4);

}  // namespace

PageLimits pageLimits(const vulkan::Device& device, bool storageBuffers) {
  const vulkan::DeviceInfo& info = device.info();
  PageLimits limits;
  limits.maxBytes = device.maxBytes();
  limits.maxBuffer = std::min(info.maxStorageBufferRange, info.maxAllocationBytes);
  // See useTexels() of vulkan_gather.cpp; some devices' texel buffers are too small for a pool.
  const bool texels = info.sharesHostCores && info.maxTexelBufferElements >= 1u << 24;
  limits.maxElements = texels && !storageBuffers ? info.maxTexelBufferElements : 0;
  limits.staged = !info.mappedMemory;
  return limits;
}

PagedGather::PagedGather(vulkan::Device& device, const asvo::Tree& tree, const PagePlan& plan)
    : device_(device),
      tree_(tree),
      plan_(plan),
      pages_(plan.pages, plan.slots, plan.resident),
      tracer_(tree, plan.gridLevel, {}, {}, {}, {}) {
  const std::vector<std::uint32_t> entries = makeGrid(tree, plan.gridLevel);
  const auto bytes = std::as_bytes(std::span(entries));
  grid_.emplace(device, "the grid of cones", bytes.size(), vulkan::Place::kDevice);
  grid_->upload(bytes);
  makeKernels();
  const std::uint64_t poolBytes = plan.slots * plan.pageNodes() * kWordBytes;
  details_.emplace(device, "pages of bricks and leaves", poolBytes, vulkan::Place::kDevice);
  conePool_.emplace(device, "pages of what cones read", poolBytes, vulkan::Place::kDevice);
  fill(*details_, [&](std::uint32_t page) {
    details(page, page_);
    return std::span<const asvo::uvec4>(page_);
  });
  for (Work& work : works_) makeWork(work);
}

void PagedGather::makeKernels() {
  // Bricks and leaves, cone words, page table, grid, queries; then results and marks.
  const std::vector<std::uint32_t> texelWords =
      plan_.texels ? std::vector<std::uint32_t>{4, 4, 1, 1, 4} : std::vector<std::uint32_t>();
  for (std::uint32_t fine = 0; fine < 2; ++fine) {
    kernels_[fine].emplace(device_, vulkan::KernelOptions{.name = "gather in pages",
                                                          .spirv = pagedGatherShader(plan_.texels),
                                                          .bindings = 7,
                                                          .texelWords = texelWords,
                                                          .pushBytes = sizeof(GatherPush),
                                                          .constants = {gatherGroupSize(device_),
                                                                        fine, plan_.pageBits}});
  }
}

void PagedGather::makeWork(Work& work) {
  using vulkan::Place;
  const std::uint64_t tableBytes = plan_.pages * sizeof(std::uint32_t);
  work.queries.emplace(device_, "queries of gathering",
                       plan_.queries * sizeof(shaderio::GatherQuery), Place::kHost);
  work.results.emplace(device_, "results of gathering",
                       plan_.queries * sizeof(shaderio::GatherResult), Place::kHost);
  work.table.emplace(device_, "the page table", tableBytes, Place::kDevice);
  work.marks.emplace(device_, "marks of pages", 2 * tableBytes, Place::kHost);
  if (work.table->mapped() == nullptr) {
    work.staging.emplace(device_, "pages to be copied",
                         tableBytes + plan_.loads * plan_.pageNodes() * 2 * kWordBytes,
                         Place::kHost);
  }
  const std::array<const vulkan::Buffer*, 7> buffers = {
      &*details_, &*conePool_, &*work.table, &*grid_, &*work.queries, &*work.results, &*work.marks};
  work.bindings.emplace(device_, *kernels_[0], buffers);
  work.batch.emplace(device_);
}

/// ASVO_BRICK or ASVO_LEAF of each node of a page.
void PagedGather::details(std::uint32_t page, std::vector<asvo::uvec4>& words) const {
  const std::uint64_t first = std::uint64_t{page} << plan_.pageBits;
  words.resize(std::min(plan_.pageNodes(), tree_.nodes.size() - first));
  for (std::size_t i = 0; i < words.size(); ++i) {
    const auto node = static_cast<std::uint32_t>(first + i);
    words[i] = node < tree_.info.firstLeaf
                   ? brickOf(tree_, node)
                   : asvo::uvec4(tree_.leaves[node - tree_.info.firstLeaf], 0u, 0u);
  }
}

std::span<const asvo::uvec4> PagedGather::conesOf(std::uint32_t page) const {
  const std::uint64_t first = std::uint64_t{page} << plan_.pageBits;
  return cones_.subspan(first, std::min(plan_.pageNodes(), cones_.size() - first));
}

void PagedGather::setCones(std::span<const asvo::uvec4> cones) {
  cones_ = cones;
  fill(*conePool_, [&](std::uint32_t page) { return conesOf(page); });
}

/// Writes the words of all pages that are there; many in one copy.
template <typename Words>
void PagedGather::fill(vulkan::Buffer& pool, const Words& words) {
  constexpr std::size_t kRun = 64;
  const std::span<const std::uint32_t> pages = pages_.pages();
  std::vector<asvo::uvec4> run;
  for (std::size_t first = 0; first < pages.size(); first += kRun) {
    const std::span<const std::uint32_t> part =
        pages.subspan(first, std::min(kRun, pages.size() - first));
    run.assign(part.size() * plan_.pageNodes(), asvo::uvec4(0u));
    for (std::size_t i = 0; i < part.size(); ++i) {
      if (part[i] == PageTable::kNoPage) continue;
      const std::span<const asvo::uvec4> from = words(part[i]);
      std::copy(from.begin(), from.end(),
                run.begin() + static_cast<std::ptrdiff_t>(i * plan_.pageNodes()));
    }
    pool.upload(std::as_bytes(std::span(run)), first * plan_.pageNodes() * kWordBytes);
  }
}

/// Into device memory before the work's dispatches run: at once where it is mapped (no running
/// chunk sees the place), else through the staging buffer.
void PagedGather::put(Work& work, const vulkan::Buffer& to, std::uint64_t offset,
                      std::span<const std::byte> bytes) {
  if (to.mapped() != nullptr) {
    std::memcpy(to.mapped() + offset, bytes.data(), bytes.size());
    return;
  }
  std::memcpy(work.staging->mapped() + work.staged, bytes.data(), bytes.size());
  work.batch->copy(*work.staging, work.staged, to, offset, bytes.size());
  work.staged += bytes.size();
}

void PagedGather::loadPages(Work& work) {
  work.staged = 0;
  for (const PageLoad& load : pages_.begin(work.number, plan_.loads)) {
    const std::uint64_t offset = load.slot * plan_.pageNodes() * kWordBytes;
    details(load.page, page_);
    put(work, *details_, offset, std::as_bytes(std::span(page_)));
    put(work, *conePool_, offset, std::as_bytes(conesOf(load.page)));
  }
  put(work, *work.table, 0, std::as_bytes(pages_.table()));
  work.marks->clear();
}

/// The next chunk of a ticket, on a piece of work that is free.
void PagedGather::start(unsigned ticket) {
  Ticket& from = tickets_[ticket & 1u];
  Work& work = works_[(chunks_ + 1) & 1u];
  work.number = ++chunks_;
  work.ticket = ticket;
  work.first = from.started;
  work.count = std::min<std::size_t>(plan_.queries, from.queries.size() - from.started);
  auto* out = reinterpret_cast<shaderio::GatherQuery*>(work.queries->mapped());
  const std::uint32_t wide =
      order_.write(std::span(from.queries).subspan(work.first, work.count), out);
  loadPages(work);
  const GatherPush coarse{tree_.info, plan_.gridLevel, 0, 0, wide};
  const GatherPush fine{tree_.info, plan_.gridLevel, 0, wide,
                        static_cast<std::uint32_t>(work.count)};
  dispatchCones(device_, *work.batch, *kernels_[0], *work.bindings, coarse, slicer_);
  dispatchCones(device_, *work.batch, *kernels_[1], *work.bindings, fine, slicer_);
  work.start = Clock::now();
  work.batch->submit();
  work.running = true;
  from.started += work.count;
}

/// Starts chunks, the older ticket's first, while there is room for them.
void PagedGather::pump() {
  for (unsigned i = 0; i < 2; ++i) {
    const unsigned ticket = next_ + i;  // of the two before next_, by the parity of its slot
    const Ticket& from = tickets_[ticket & 1u];
    while (from.open && from.started < from.queries.size() && !works_[(chunks_ + 1) & 1u].running) {
      start(ticket);
    }
  }
}

int PagedGather::submit(std::span<const shaderio::GatherQuery> queries) {
  Ticket& ticket = tickets_[next_ & 1u];
  assert(!ticket.open && "at most two batches may be under way");
  ticket.queries.assign(queries.begin(), queries.end());
  ticket.results.resize(queries.size());
  ticket.started = ticket.ended = 0;
  ticket.open = true;
  const auto number = static_cast<int>(next_++);
  pump();
  return number;
}

void PagedGather::wait(Work& work) {
  if (!work.running) return;
  const bool late = !work.batch->busy();  // it ended some time ago: its time is not known
  work.batch->wait();
  work.running = false;
  const auto end = Clock::now();
  const double seconds =
      std::chrono::duration<double>(end - std::max(work.start, lastEnd_)).count();
  lastEnd_ = end;
  seconds_ += seconds;
  if (!late) slicer_.measured(work.count, seconds);
  Ticket& ticket = tickets_[work.ticket & 1u];
  std::copy_n(reinterpret_cast<const shaderio::GatherResult*>(work.results->mapped()), work.count,
              ticket.results.begin() + static_cast<std::ptrdiff_t>(work.first));
  ticket.ended += work.count;
  const auto* marks = reinterpret_cast<const std::uint32_t*>(work.marks->mapped());
  pages_.finished(work.number, {marks, std::size_t{2} * plan_.pages});
}

/// Waits for the older chunk on the device and starts what there is room for then.
void PagedGather::advance() {
  Work& older = works_[(chunks_ + 1) & 1u];
  wait(older.running ? older : works_[chunks_ & 1u]);
  pump();
}

std::span<const shaderio::GatherResult> PagedGather::finish(int number) {
  Ticket& ticket = tickets_[static_cast<unsigned>(number) & 1u];
  assert(ticket.open && "a ticket is finished once");
  while (ticket.ended < ticket.queries.size()) advance();
  ticket.open = false;
  return ticket.results;
}

void PagedGather::drain() {
  for (const Ticket& ticket : tickets_) {
    while (ticket.open && ticket.ended < ticket.queries.size()) advance();
  }
}

}  // namespace trex
