#include "storage/internal/structure.h"

#include "storage/internal/container.h"

#include <optional>
#include <string>
#include <utility>

namespace slf::storage::internal {
namespace {

constexpr std::size_t kMaxFindings = 300;

class Checker {
 public:
  Checker(const Pages& pages, CheckScope scope, std::vector<Error>& findings)
      : pages_(pages),
        scope_(scope),
        findings_(findings),
        limit_(findings.size() + kMaxFindings),
        used_(pages.count(), false) {}

  void run() {
    used_[0] = used_[1] = true;
    walk(pages_.meta().free_list, "the free list", Content::free_list);
    walk(pages_.meta().main, "the root", Content::trees);
    for (const auto& [name, tree] : named_)
      walk(tree, "tree '" + name + "'", name == kManifest ? Content::blobs : Content::records);
    if (scope_ == CheckScope::everything) report_lost();
  }

 private:
  enum class Content { free_list, trees, blobs, records };

  /// A page to visit. Its keys must be >= low and < high; an empty bound does not apply.
  struct Visit {
    std::uint64_t page = 0;
    std::uint32_t level = 1;
    ByteSpan low;
    ByteSpan high;
  };

  // Always false.
  template <class... Parts>
  bool report(std::uint64_t page, const Parts&... parts) {
    return !gave_up() && report(pages_.damaged(page, parts...).value());
  }
  bool report(Error error) {
    if (gave_up()) return false;
    findings_.push_back(std::move(error));
    if (findings_.size() == limit_)
      findings_.push_back({ErrorCode::bad_file, "too many findings; the rest are not listed"});
    return false;
  }
  [[nodiscard]] bool gave_up() const { return findings_.size() > limit_; }

  // Marks pages as used. False: they do not exist or are used already.
  bool claim(std::uint64_t first, std::uint64_t count, const std::string& user) {
    if (first < 2 || first >= used_.size() || count > used_.size() - first)
      return report(first, user, " uses pages outside the file");
    for (std::uint64_t page = first; page < first + count; ++page) {
      if (used_[page]) return report(page, "used twice, the second time by ", user);
      used_[page] = true;
    }
    return true;
  }

  void walk(const Tree& tree, const std::string& name, Content content) {
    Tree counted;
    if (tree.root == kNoPage) {
      if (tree.depth != 0 || tree.entries != 0)
        report(tree.root, name, " is empty but claims depth ", tree.depth, " and ", tree.entries,
               " entries");
      return;
    }
    if (tree.depth == 0 || tree.depth > kMaxDepth) {
      report(tree.root, name, " has depth ", tree.depth);
      return;
    }
    std::vector<Visit> visits{{tree.root, 1, {}, {}}};
    while (!visits.empty() && !gave_up()) {
      const Visit visit = visits.back();
      visits.pop_back();
      if (!claim(visit.page, 1, name)) continue;
      const bool leaf = visit.level == tree.depth;
      auto page = pages_.tree_page(visit.page, leaf);
      if (!page) {
        report(std::move(page.error()));
        continue;
      }
      ++(leaf ? counted.leaf_pages : counted.branch_pages);
      if (!check_nodes(*page, visit, content)) continue;
      if (leaf)
        check_leaf(*page, name, content, counted);
      else
        push_children(*page, visit, visits);
    }
    compare(tree, counted, name);
  }

  // Checks that every node is complete, that keys are in order and within the page's bounds, and
  // that each byte from `upper` on belongs to exactly one node.
  bool check_nodes(const TreePage& page, const Visit& visit, Content content) {
    const auto size = static_cast<std::uint64_t>(page.bytes().size());
    const std::uint64_t upper = load_le<std::uint16_t>(page.bytes().data() + 14);
    const std::uint64_t node_limit = (size - kPageHeader) / 2;
    std::uint64_t filled = 0;
    ByteSpan before;
    for (std::uint32_t i = 0; i < page.count(); ++i) {
      Node node;
      if (!page.node(i, node)) return report(page.number(), "entry ", i, " leaves the page");
      const bool keyed = page.leaf() || i > 0;  // the first child's key has no meaning
      const bool big = (node.flags & kBigData) != 0;
      const std::uint64_t data = !page.leaf() ? 0 : big ? 8 : node.data_size;
      if (node.key.size() > kMaxKey || kNodeHeader + node.key.size() + data > node_limit)
        return report(page.number(), "entry ", i, " is larger than LMDB makes them");
      filled += (kNodeHeader + node.key.size() + data + 1) / 2 * 2;
      const auto at = static_cast<std::uint64_t>(node.key.data() - page.bytes().data());
      if (at < upper + kNodeHeader)
        return report(page.number(), "entry ", i, " lies in free space");
      if (!keyed) continue;
      if (node.key.empty() || (!before.empty() && !less(before, node.key, content)) ||
          (!visit.low.empty() && less(node.key, visit.low, content)) ||
          (!visit.high.empty() && !less(node.key, visit.high, content)))
        return report(page.number(), "entry ", i, " is out of order");
      before = node.key;
    }
    if (filled != size - upper)
      return report(page.number(), "entries of ", filled, " bytes in ", size - upper, " bytes");
    return true;
  }

  static bool less(ByteSpan a, ByteSpan b, Content content) {
    if (content == Content::free_list && a.size() == 8 && b.size() == 8)
      return load_le<std::uint64_t>(a.data()) < load_le<std::uint64_t>(b.data());
    return compare_keys(a, b) < 0;
  }

  static void push_children(const TreePage& page, const Visit& visit, std::vector<Visit>& visits) {
    std::optional<Visit> child;
    for (std::uint32_t i = 0; i < page.count(); ++i) {
      Node node;
      if (!page.node(i, node)) return;
      if (child) {
        child->high = node.key;
        visits.push_back(*child);
      }
      child = Visit{node.child, visit.level + 1, i == 0 ? visit.low : node.key, {}};
    }
    child->high = visit.high;
    visits.push_back(*child);
  }

  void check_leaf(const TreePage& page, const std::string& name, Content content, Tree& counted) {
    for (std::uint32_t i = 0; i < page.count(); ++i) {
      Node node;
      if (!page.node(i, node)) return;
      ++counted.entries;
      const std::uint16_t expected = content == Content::trees ? kSubTree : node.flags & kBigData;
      if (node.flags != expected) {
        report(page.number(), "entry ", i, " of ", name, " has flags ", node.flags);
        continue;
      }
      if ((node.flags & kBigData) != 0 && !check_overflow_pages(node, name, content, counted))
        continue;
      if (content == Content::trees) add_tree(page, i, node);
      if (content == Content::free_list) check_free_list_entry(page, i, node);
    }
  }

  bool check_overflow_pages(const Node& node, const std::string& name, Content content,
                            Tree& counted) {
    std::uint64_t run = pages_.overflow_pages(node.data_size);
    if (scope_ == CheckScope::everything || content != Content::records) {
      auto value = pages_.value(node);
      if (!value) return report(std::move(value.error()));
      run = load_le<std::uint32_t>(value->data() - kPageHeader + 12);
    }
    counted.overflow_pages += run;
    return claim(node.child, run, name);
  }

  void add_tree(const TreePage& page, std::uint32_t i, const Node& node) {
    const std::string name(chars_of(node.key));
    if (node.data.size() != kTreeBytes) {
      report(page.number(), "entry ", i, " describes no tree");
      return;
    }
    const Tree tree = Tree::parse(node.data.data());
    if (tree.flags != 0)
      report(page.number(), "tree '", name, "' has flags ", tree.flags, ", expected none");
    else
      named_.emplace_back(name, tree);
  }

  // Checks an entry of the free list. Its key is the transaction that freed the pages, its value a
  // count and that many page numbers in descending order.
  void check_free_list_entry(const TreePage& page, std::uint32_t i, const Node& node) {
    auto value = pages_.value(node);
    if (!value) return (void)report(std::move(value.error()));
    const std::uint64_t count = value->size() < 8 ? 0 : load_le<std::uint64_t>(value->data());
    const std::uint64_t freed_by =
        node.key.size() == 8 ? load_le<std::uint64_t>(node.key.data()) : 0;
    if (freed_by == 0 || freed_by > pages_.meta().transaction || value->size() < 8 ||
        count > value->size() / 8 - 1) {
      report(page.number(), "entry ", i, " of the free list is damaged");
      return;
    }
    std::uint64_t above = pages_.count();
    for (std::uint64_t k = 1; k <= count && !gave_up(); ++k) {
      const auto free_page = load_le<std::uint64_t>(value->data() + 8 * k);
      if (free_page >= above) {
        report(page.number(), "entry ", i, " of the free list is out of order");
        return;
      }
      claim(free_page, 1, "the free list");
      above = free_page;
    }
  }

  void compare(const Tree& tree, const Tree& counted, const std::string& name) {
    const auto differ = [&](const char* what, std::uint64_t claims, std::uint64_t found) {
      if (claims != found) report(tree.root, name, " claims ", claims, " ", what, ", has ", found);
    };
    differ("branch pages", tree.branch_pages, counted.branch_pages);
    differ("leaf pages", tree.leaf_pages, counted.leaf_pages);
    differ("entries", tree.entries, counted.entries);
    if (scope_ == CheckScope::everything)
      differ("overflow pages", tree.overflow_pages, counted.overflow_pages);
  }

  void report_lost() {
    for (std::uint64_t page = 0; page < used_.size() && !gave_up(); ++page) {
      if (used_[page]) continue;
      const std::uint64_t first = page;
      while (page + 1 < used_.size() && !used_[page + 1]) ++page;
      report(first, "neither used nor free, as are all up to page ", page);
    }
  }

  const Pages& pages_;
  CheckScope scope_;
  std::vector<Error>& findings_;
  std::size_t limit_;
  std::vector<bool> used_;
  std::vector<std::pair<std::string, Tree>> named_;
};

}  // namespace

void check_pages(const Pages& pages, CheckScope scope, std::vector<Error>& findings) {
  Checker(pages, scope, findings).run();
}

}  // namespace slf::storage::internal
