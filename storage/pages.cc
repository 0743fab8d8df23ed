#include "storage/internal/pages.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "base/try.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint32_t kLmdbMagic = 0xBEEFC0DE;
constexpr std::uint32_t kLmdbVersion = 1;
constexpr std::uint16_t kHarmlessFlags = 0x4000;  // MDB_NOSUBDIR: only says how the file was opened

Result<Meta> parse_meta(ByteSpan bytes, const std::string& path, std::uint64_t number) {
  const std::byte* page = bytes.data();
  if (bytes.size() < kMetaEnd || load_le<std::uint32_t>(page + 16) != kLmdbMagic) {
    if (number == 0) return bad_file(path, "not a field: it is not an LMDB file");
    return bad_file(path, "meta page 1 is damaged or missing");
  }
  if (const auto version = load_le<std::uint32_t>(page + 20); version != kLmdbVersion)
    return unsupported(path, "LMDB data version ", version, ", expected ", kLmdbVersion,
                       ", that of LMDB 0.9");
  if (load_le<std::uint64_t>(page) != number || load_le<std::uint16_t>(page + 10) != kMeta)
    return bad_file(path, "meta page ", number, " is damaged");

  Meta meta;
  meta.free_list = Tree::parse(page + 40);
  meta.main = Tree::parse(page + 88);
  meta.last_page = load_le<std::uint64_t>(page + 136);
  meta.transaction = load_le<std::uint64_t>(page + 144);
  if (const auto size = load_le<std::uint32_t>(page + 40); size != kPageSize)
    return unsupported(path, "pages of ", size, " bytes, expected ", kPageSize,
                       "; make it anew on a system of 4 KiB pages");
  // Other flags would change the order of keys or, for LMDB, the address of the map.
  if ((meta.free_list.flags & ~kHarmlessFlags) != kIntegerKeys || meta.main.flags != 0)
    return bad_file(path, "meta page ", number, " has flags ", meta.free_list.flags, " and ",
                    meta.main.flags);
  return meta;
}

}  // namespace

Tree Tree::parse(const std::byte* from) {
  Tree tree;
  tree.flags = load_le<std::uint16_t>(from + 4);
  tree.depth = load_le<std::uint16_t>(from + 6);
  tree.branch_pages = load_le<std::uint64_t>(from + 8);
  tree.leaf_pages = load_le<std::uint64_t>(from + 16);
  tree.overflow_pages = load_le<std::uint64_t>(from + 24);
  tree.entries = load_le<std::uint64_t>(from + 32);
  tree.root = load_le<std::uint64_t>(from + 40);
  return tree;
}

Result<Meta> read_metas(int file, const std::string& path) {
  std::array<std::byte, kPageSize + kMetaEnd> start;
  const ssize_t got = pread(file, start.data(), start.size(), 0);
  if (got < 0)
    return fail(ErrorCode::io, path, ": cannot read the meta pages: ", std::strerror(errno));
  return parse_metas(ByteSpan(start).first(static_cast<std::size_t>(got)), path);
}

Result<Meta> parse_metas(ByteSpan start, const std::string& path) {
  auto first = parse_meta(start, path, 0);
  if (!first) return first;
  auto second = parse_meta(start.subspan(std::min(start.size(), kPageSize)), path, 1);
  if (!second) return second;
  // Transaction t writes meta page t mod 2, so the two are consecutive; a new file has two zeros.
  const std::uint64_t a = first->transaction;
  const std::uint64_t b = second->transaction;
  const bool neighbours = a % 2 == 0 && (b == a + 1 || a == b + 1);
  if (!(neighbours || (a == 0 && b == 0)))
    return bad_file(path, "the meta pages contradict each other: transactions ", a, " and ", b);
  return b > a ? second : first;
}

Result<void> check_length(const Meta& meta, std::uint64_t size, const std::string& path) {
  if (meta.last_page >= 1 && meta.last_page < size / kPageSize) return {};
  return bad_file(path, "truncated: ", size, " bytes, expected ", meta.last_page + 1, " pages of ",
                  kPageSize);
}

bool TreePage::node(std::uint32_t i, Node& node) const {
  const std::byte* page = bytes_.data();
  const std::size_t size = bytes_.size();
  const std::size_t at = load_le<std::uint16_t>(page + kPageHeader + 2 * std::size_t{i});
  if (at < kPageHeader + 2 * std::size_t{count_} || at % 2 != 0 || at + kNodeHeader > size)
    return false;
  const std::byte* head = page + at;
  const std::uint64_t low = load_le<std::uint32_t>(head);
  const auto flags = load_le<std::uint16_t>(head + 4);
  const std::size_t key_size = load_le<std::uint16_t>(head + 6);
  std::size_t end = at + kNodeHeader + key_size;
  if (end > size) return false;
  node.key = {head + kNodeHeader, key_size};
  if (!leaf_) {
    node.child = low | std::uint64_t{flags} << 32;
    return true;
  }
  node.flags = flags;
  node.data_size = low;
  if ((flags & kBigData) != 0) {
    if (end + 8 > size) return false;
    node.child = load_le<std::uint64_t>(page + end);
    node.data = {};
  } else {
    if (low > size - end) return false;
    node.data = {page + end, static_cast<std::size_t>(low)};
  }
  return true;
}

// Binary search for the first entry from `begin` on for which `before` is false.
template <class Before>
bool TreePage::search(std::uint32_t begin, const Before& before, std::uint32_t& index) const {
  std::uint32_t end = count_;
  while (begin < end) {
    index = begin + (end - begin) / 2;
    Node entry;
    if (!node(index, entry)) return false;
    if (before(entry))
      begin = index + 1;
    else
      end = index;
  }
  index = begin;
  return true;
}

bool TreePage::lower_bound(ByteSpan key, std::uint32_t& index) const {
  return search(
      0, [&](const Node& entry) { return compare_keys(entry.key, key) < 0; }, index);
}

// The first child has no lower bound, so the search ignores its key.
bool TreePage::child_for(ByteSpan key, std::uint32_t& index) const {
  if (!search(
          1, [&](const Node& entry) { return compare_keys(entry.key, key) <= 0; }, index))
    return false;
  --index;
  return true;
}

Result<TreePage> Pages::tree_page(std::uint64_t number, bool leaf) const {
  if (number < 2 || number > meta_.last_page)
    return damaged(number, "outside the file's ", count(), " pages");
  const auto loaded = SLF_TRY(bytes(number * kPageSize, kPageSize));
  const std::byte* page = loaded.data();
  const auto own_number = load_le<std::uint64_t>(page);
  const auto flags = load_le<std::uint16_t>(page + 10);
  const std::size_t lower = load_le<std::uint16_t>(page + 12);
  const std::size_t upper = load_le<std::uint16_t>(page + 14);
  if (own_number != number) return damaged(number, "calls itself page ", own_number);
  if (flags != (leaf ? kLeaf : kBranch))
    return damaged(number, "expected a ", leaf ? "leaf" : "branch", ", found flags ", flags);
  if (lower <= kPageHeader || lower % 2 != 0 || lower > upper || upper > kPageSize)
    return damaged(number, "free space ", lower, " to ", upper, " of ", kPageSize, " bytes");
  return TreePage({page, kPageSize}, number, leaf,
                  static_cast<std::uint32_t>((lower - kPageHeader) / 2));
}

Result<ByteSpan> Pages::value(const Node& node, std::uint64_t max_bytes) const {
  if ((node.flags & kBigData) == 0) return node.data;
  const std::uint64_t needed = overflow_pages(node.data_size);
  if (node.child < 2 || node.child > meta_.last_page || needed > count() - node.child)
    return damaged(node.child, "a value of ", node.data_size, " bytes leaves the file");
  auto loaded = bytes(node.child * kPageSize, kPageHeader + std::min(node.data_size, max_bytes));
  if (!loaded) return loaded;
  const std::byte* page = loaded->data();
  const auto own_number = load_le<std::uint64_t>(page);
  const auto flags = load_le<std::uint16_t>(page + 10);
  const std::uint64_t run = load_le<std::uint32_t>(page + 12);
  if (own_number != node.child || flags != kOverflow || run < needed || run > count() - node.child)
    return damaged(node.child, "expected a run of ", needed, " overflow pages, found page ",
                   own_number, " with flags ", flags, " and ", run, " pages");
  return loaded->subspan(kPageHeader);
}

int compare_keys(ByteSpan a, ByteSpan b) {
  const std::size_t common = std::min(a.size(), b.size());
  const int order = common == 0 ? 0 : std::memcmp(a.data(), b.data(), common);
  if (order != 0) return order;
  return a.size() < b.size() ? -1 : a.size() > b.size() ? 1 : 0;
}

}  // namespace slf::storage::internal
