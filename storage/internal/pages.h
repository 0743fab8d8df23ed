// Reads LMDB's file format, and checks every number before it uses it.
//
// A file is an array of pages. Pages 0 and 1 are meta pages. Each describes one snapshot; the one
// with the higher transaction number is current. A snapshot is a set of B+trees of branch and leaf
// pages. Values above about half a page are in overflow pages. For the bytes see
// doc/format/pages.md.
//
// The bytes are untrusted and may change during reading. So the code loads each number once, into a
// local variable, and then checks and uses that.
#pragma once

#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/byte_source.h"

namespace slf::storage::internal {

inline constexpr std::size_t kPageSize = 4096;  ///< LMDB's on most systems; no other is accepted
inline constexpr std::size_t kPageHeader = 16;
inline constexpr std::size_t kNodeHeader = 8;
inline constexpr std::size_t kMetaEnd = 152;  ///< bytes of a meta page in use
inline constexpr std::size_t kTreeBytes = 48;
inline constexpr std::size_t kMaxDepth = 32;
inline constexpr std::size_t kMaxKey = 511;
inline constexpr std::uint64_t kNoPage = ~std::uint64_t{0};

enum PageFlag : std::uint16_t { kBranch = 1, kLeaf = 2, kOverflow = 4, kMeta = 8 };
enum NodeFlag : std::uint16_t { kBigData = 1, kSubTree = 2 };
inline constexpr std::uint16_t kIntegerKeys = 8;  ///< flag of the free-list tree

/// A B+tree as a meta page or a named entry describes it.
struct Tree {
  std::uint16_t flags = 0;
  std::uint16_t depth = 0;  ///< pages from root to leaf; 0 when empty
  std::uint64_t branch_pages = 0;
  std::uint64_t leaf_pages = 0;
  std::uint64_t overflow_pages = 0;
  std::uint64_t entries = 0;
  std::uint64_t root = kNoPage;

  /// REQUIRES: kTreeBytes readable bytes.
  [[nodiscard]] static Tree parse(const std::byte* from);
};

/// The content of a meta page.
struct Meta {
  std::uint64_t last_page = 0;
  std::uint64_t transaction = 0;
  Tree free_list;
  Tree main;
};

/// Reads both meta pages of an open file and selects the current one.
/// bad_file: one is damaged, or they do not match. unsupported: another version or page size.
[[nodiscard]] Result<Meta> read_metas(int file, const std::string& path);

/// The same from the start of a file: the bytes of both pages, or fewer if the file is shorter.
[[nodiscard]] Result<Meta> parse_metas(ByteSpan start, const std::string& path);

/// bad_file: a file of `size` bytes is too short for these pages.
[[nodiscard]] Result<void> check_length(const Meta& meta, std::uint64_t size,
                                        const std::string& path);

/// One entry of a branch or leaf page.
struct Node {
  ByteSpan key;
  std::uint16_t flags = 0;      ///< leaf only
  std::uint64_t child = 0;      ///< branch: the child. leaf with kBigData: the first overflow page
  std::uint64_t data_size = 0;  ///< leaf only
  ByteSpan data;                ///< leaf without kBigData
};

/// A branch or leaf page whose header has been checked.
class TreePage {
 public:
  TreePage() = default;
  TreePage(ByteSpan bytes, std::uint64_t number, bool leaf, std::uint32_t count)
      : bytes_(bytes), number_(number), leaf_(leaf), count_(count) {}

  [[nodiscard]] bool leaf() const { return leaf_; }
  [[nodiscard]] std::uint32_t count() const { return count_; }
  [[nodiscard]] std::uint64_t number() const { return number_; }
  [[nodiscard]] ByteSpan bytes() const { return bytes_; }

  /// Reads node `i` into `node`. False: it extends beyond the page.
  [[nodiscard]] bool node(std::uint32_t i, Node& node) const;

  /// Leaf: the first entry with key >= `key`, or count(). False: entry `index` extends beyond the
  /// page.
  [[nodiscard]] bool lower_bound(ByteSpan key, std::uint32_t& index) const;

  /// Branch: the last child whose first key is <= `key`, or child 0. False: as above.
  [[nodiscard]] bool child_for(ByteSpan key, std::uint32_t& index) const;

 private:
  template <class Before>
  [[nodiscard]] bool search(std::uint32_t begin, const Before& before, std::uint32_t& index) const;

  ByteSpan bytes_;
  std::uint64_t number_ = 0;
  bool leaf_ = false;
  std::uint32_t count_ = 0;
};

/// The pages of one snapshot. Views the map or the source; does not own it.
class Pages {
 public:
  Pages() = default;
  Pages(ByteSpan file, const Meta& meta, const std::string* path)
      : file_(file), meta_(meta), path_(path) {}
  Pages(const ByteSource& source, const Meta& meta, const std::string* path)
      : source_(&source), meta_(meta), path_(path) {}

  [[nodiscard]] const Meta& meta() const { return meta_; }
  [[nodiscard]] std::uint64_t count() const { return meta_.last_page + 1; }
  /// The whole file in memory; empty if the source does not have it there (ByteSource::file()).
  [[nodiscard]] ByteSpan file() const { return source_ != nullptr ? source_->file() : file_; }
  /// The source of the bytes; null if the file is mapped.
  [[nodiscard]] const ByteSource* source() const { return source_; }
  [[nodiscard]] bool mapped() const { return source_ == nullptr; }

  /// A branch (leaf = false) or leaf page. bad_file: the page is damaged or of another kind.
  [[nodiscard]] Result<TreePage> tree_page(std::uint64_t number, bool leaf) const;

  /// The value of a leaf node. If it is in overflow pages, returns only its first `max_bytes`
  /// bytes. bad_file: the overflow pages are damaged.
  [[nodiscard]] Result<ByteSpan> value(const Node& node,
                                       std::uint64_t max_bytes = ~std::uint64_t{0}) const;

  /// Where the value of a leaf node in overflow pages begins in the file.
  [[nodiscard]] std::uint64_t value_offset(const Node& node) const {
    return node.child * kPageSize + kPageHeader;
  }

  /// How many pages an overflow value of `size` bytes needs.
  [[nodiscard]] static std::uint64_t overflow_pages(std::uint64_t size) {
    return (kPageHeader + size + kPageSize - 1) / kPageSize;
  }

  /// A bad_file error about one page.
  template <class... Parts>
  [[nodiscard]] tl::unexpected<Error> damaged(std::uint64_t page, const Parts&... parts) const {
    return fail(ErrorCode::bad_file, *path_, ": page ", page, ": ", parts...);
  }

 private:
  /// REQUIRES: the range is inside the snapshot's pages.
  [[nodiscard]] Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const {
    if (source_ != nullptr) return source_->bytes(offset, size);
    return file_.subspan(offset, size);
  }

  ByteSpan file_;
  const ByteSource* source_ = nullptr;
  Meta meta_;
  const std::string* path_ = nullptr;
};

/// LMDB's default key order: unsigned bytes, then length.
[[nodiscard]] int compare_keys(ByteSpan a, ByteSpan b);

}  // namespace slf::storage::internal
