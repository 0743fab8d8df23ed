// Cursor: a position in a B+tree of a snapshot. Visits entries in key order, from any key on.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {

/// Untrusted input is safe: a path has at most kMaxDepth pages, keys must ascend, and a cursor
/// never visits more pages than the file has.
///
/// seek() and next() return
///   true    the cursor is at an entry: key(), value()
///   false   there are no more entries
///   error   the entries below one page are lost; next() continues after them
class Cursor {
 public:
  /// `pages` must outlive the cursor.
  Cursor(const Pages& pages, const Tree& tree) : pages_(&pages), tree_(tree) {}

  /// Moves to the first entry with key >= `key`. An empty key selects the first entry of the tree.
  [[nodiscard]] Result<bool> seek(ByteSpan key);

  /// Moves to the entry with this key. False: there is none.
  [[nodiscard]] Result<bool> find(std::string_view key);

  /// Moves to the last entry with key < `key`. Do not call next() afterwards.
  [[nodiscard]] Result<bool> seek_before(ByteSpan key);

  /// Moves to the next entry. REQUIRES: seek() was called.
  [[nodiscard]] Result<bool> next();

  /// Appends the numbers of the pages from the root to the entry.
  void path(std::vector<std::uint64_t>& pages) const {
    for (std::size_t step = 0; step < depth_; ++step) pages.push_back(path_[step].page.number());
  }
  [[nodiscard]] ByteSpan key() const { return node_.key; }
  [[nodiscard]] const Node& node() const { return node_; }
  [[nodiscard]] Result<ByteSpan> value() const { return pages_->value(node_); }

  /// The entry's leaf page and its position there. REQUIRES: the cursor is at an entry.
  [[nodiscard]] const TreePage& leaf() const { return path_[depth_ - 1].page; }
  [[nodiscard]] std::uint32_t index() const { return path_[depth_ - 1].index; }

 private:
  struct Step {
    TreePage page;
    std::uint32_t index = 0;
  };

  /// Descends from page `number` towards `key`, to the first entry that is not below it.
  [[nodiscard]] Result<bool> descend(std::uint64_t number, ByteSpan key);
  [[nodiscard]] Result<bool> move_to_entry();
  [[nodiscard]] Result<bool> descend_to_last(std::uint64_t number);
  [[nodiscard]] tl::unexpected<Error> bad_node(const TreePage& page, std::uint32_t index) const {
    return pages_->damaged(page.number(), "entry ", index, " leaves the page");
  }

  const Pages* pages_;
  Tree tree_;
  std::array<Step, kMaxDepth> path_;
  std::size_t depth_ = 0;  ///< steps of the path in use
  std::uint64_t visited_ = 0;
  Node node_;
};

}  // namespace slf::storage::internal
