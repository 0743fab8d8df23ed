#include "storage/internal/prefetch.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "storage/internal/range_set.h"
#include "storage/internal/trees.h"

namespace slf::storage::internal {
namespace {

/// A page of the tree, and the keys whose path leads to it: [begin, end).
struct PageVisit {
  std::uint64_t page = 0;
  std::size_t begin = 0;
  std::size_t end = 0;
};

ByteSpan bytes_of_pages(const Pages& pages, std::uint64_t first, std::uint64_t bytes) {
  const std::uint64_t count = (bytes + kPageSize - 1) / kPageSize;
  if (first < 2 || first >= pages.count() || count > pages.count() - first) return {};
  return pages.file().subspan(first * kPageSize, count * kPageSize);
}

/// Adds those children of a branch to which the visit's keys lead.
void add_children(const Pages& pages, std::span<const RecordKey> keys, const PageVisit& visit,
                  std::vector<PageVisit>& below) {
  const auto branch = pages.tree_page(visit.page, false);
  if (!branch) return;
  const std::size_t first = below.size();
  for (std::size_t k = visit.begin; k < visit.end; ++k) {
    std::uint32_t index = 0;
    Node node;
    if (!branch->child_for(keys[k], index) || !branch->node(index, node)) continue;
    if (below.size() == first || below.back().page != node.child)
      below.push_back({node.child, k, k});
    below.back().end = k + 1;
  }
}

/// Adds the heads of the records that hold the visit's keys, but not the first record of the next
/// leaf.
void add_heads(const Pages& pages, std::span<const RecordKey> keys, const PageVisit& visit,
               Advice& advice) {
  const auto leaf = pages.tree_page(visit.page, true);
  if (!leaf) return;
  std::uint32_t next = 0;  // the entry after the last one added
  for (std::size_t k = visit.begin; k < visit.end; ++k) {
    std::uint32_t index = 0;
    if (!leaf->lower_bound(keys[k], index) || index >= leaf->count() || index < next) continue;
    advice.add(record_head(pages, *leaf, index));
    next = index + 1;
  }
}

}  // namespace

void Advice::add(ByteSpan bytes) {
  const auto begin = reinterpret_cast<std::uintptr_t>(bytes.data());
  if (!bytes.empty()) ranges_.push_back({begin, begin + bytes.size()});
}

void Advice::expect() {
  const auto file = reinterpret_cast<std::uintptr_t>(pages_.file().data());
  std::vector<FileRange> ranges;
  for (const FileRange& range : ranges_) ranges.push_back({range.begin - file, range.end - file});
  pages_.source()->expect(ranges);
}

void Advice::apply(int advice) {
  if (pages_.source() != nullptr && advice == MADV_WILLNEED) expect();
  static const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  for (FileRange& range : ranges_)
    range = {range.begin / page * page, (range.end + page - 1) / page * page};
  for (const FileRange& range : merged(std::exchange(ranges_, {}), 0))
    // NOLINTNEXTLINE(performance-no-int-to-ptr)
    (void)madvise(reinterpret_cast<void*>(range.begin), range.size(), advice);
}

ByteSpan record_head(const Pages& pages, const TreePage& leaf, std::uint32_t index) {
  Node node;
  if (!leaf.node(index, node) || (node.flags & kBigData) == 0) return {};
  const std::uint64_t span = max_tiles_in_record(leaf, index, node);
  const std::uint64_t table = kPageHeader + usual_head_bytes(span);
  const std::uint64_t all = kPageHeader + node.data_size;
  return bytes_of_pages(pages, node.child, span == 1 ? all : std::min(all, table));
}

void prefetch_records(const Pages& pages, const Tree& tree, std::span<const RecordKey> keys) {
  if (keys.empty() || tree.root == kNoPage || tree.depth == 0 || tree.depth > kMaxDepth) return;
  std::vector<PageVisit> visits{{tree.root, 0, keys.size()}};
  Advice advice(pages);
  for (std::size_t depth = 1; depth < tree.depth; ++depth) {
    std::vector<PageVisit> below;
    for (const PageVisit& visit : visits) add_children(pages, keys, visit, below);
    visits = std::move(below);
    for (const PageVisit& visit : visits) advice.add(bytes_of_pages(pages, visit.page, kPageSize));
    advice.apply(MADV_WILLNEED);
  }
  for (const PageVisit& visit : visits) add_heads(pages, keys, visit, advice);
  advice.apply(MADV_WILLNEED);
}

void prefetch_heads(const Pages& pages, const Cursor& at, TileKey to) {
  Advice advice(pages);
  const TreePage& leaf = at.leaf();
  for (std::uint32_t i = at.index(); i < leaf.count(); ++i) {
    advice.add(record_head(pages, leaf, i));
    Node node;
    if (!leaf.node(i, node)) continue;
    if (const auto last = decode_key(node.key); last && *last >= to) break;
  }
  advice.apply(MADV_WILLNEED);
}

}  // namespace slf::storage::internal
