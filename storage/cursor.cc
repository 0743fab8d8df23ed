#include "storage/internal/cursor.h"
#include "base/try.h"

namespace slf::storage::internal {

Result<bool> Cursor::seek(ByteSpan key) {
  depth_ = 0;
  node_ = {};
  if (tree_.root == kNoPage) return false;
  if (tree_.depth == 0 || tree_.depth > kMaxDepth)
    return pages_->damaged(tree_.root, "root of a tree of depth ", tree_.depth);
  return descend(tree_.root, key);
}

Result<bool> Cursor::find(std::string_view key) {
  const bool found = SLF_TRY(seek(bytes_of(key)));
  return found && compare_keys(node_.key, bytes_of(key)) == 0;
}

// The previous entry follows from the path to `key`: go up to the deepest page with an entry to the
// left, step left, and descend along the last entries.
Result<bool> Cursor::seek_before(ByteSpan key) {
  SLF_TRY(seek(key));
  if (depth_ == 0) return descend_to_last(tree_.root);
  while (depth_ > 0 && path_[depth_ - 1].index == 0) --depth_;
  if (depth_ == 0) return false;
  Step& step = path_[depth_ - 1];
  --step.index;
  Node node;
  if (!step.page.node(step.index, node)) return bad_node(step.page, step.index);
  if (!step.page.leaf()) return descend_to_last(node.child);
  node_ = node;
  return true;
}

// Descends to the last entry below page `number`, which becomes path_[depth_].
Result<bool> Cursor::descend_to_last(std::uint64_t number) {
  if (number == kNoPage) return false;
  while (depth_ < tree_.depth) {
    auto page = SLF_TRY(pages_->tree_page(number, depth_ + 1 == tree_.depth));
    const std::uint32_t index = page.count() - 1;
    path_[depth_++] = {page, index};
    if (!page.node(index, node_)) return bad_node(page, index);
    number = node_.child;
  }
  return true;
}

Result<bool> Cursor::next() {
  if (depth_ == 0) return false;
  ++path_[depth_ - 1].index;
  return move_to_entry();
}

// Descends towards `key` from page `number`, which becomes path_[depth_].
Result<bool> Cursor::descend(std::uint64_t number, ByteSpan key) {
  while (true) {
    const bool leaf = depth_ + 1 == tree_.depth;
    if (++visited_ > pages_->count()) {
      depth_ = 0;  // the tree has a cycle, so do not go on
      return pages_->damaged(number, "reached more than once");
    }
    auto page = SLF_TRY(pages_->tree_page(number, leaf));
    std::uint32_t index = 0;
    if (!(leaf ? page.lower_bound(key, index) : page.child_for(key, index)))
      return bad_node(page, index);
    path_[depth_++] = {page, index};
    if (leaf) return move_to_entry();
    Node child;
    if (!page.node(index, child)) return bad_node(page, index);
    number = child.child;
  }
}

// Moves to the entry at the path or, if the path is past the last entry of its page, to the next.
Result<bool> Cursor::move_to_entry() {
  while (depth_ > 0) {
    Step& step = path_[depth_ - 1];
    if (step.index >= step.page.count()) {
      if (--depth_ > 0) ++path_[depth_ - 1].index;
      continue;
    }
    Node node;
    if (!step.page.node(step.index, node)) return bad_node(step.page, step.index);
    if (!step.page.leaf()) return descend(node.child, {});
    if (!node_.key.empty() && compare_keys(node.key, node_.key) <= 0)
      return pages_->damaged(step.page.number(), "entry ", step.index, " is out of order");
    node_ = node;
    return true;
  }
  return false;
}

}  // namespace slf::storage::internal
