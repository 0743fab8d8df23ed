// Random histories of a container against a map: appends, commits, kills, closes, resumes and
// replacements in any order.
#include <rapidcheck.h>

#include <gtest/gtest.h>

#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

// What a run of operations did so far: what is in the file for sure, and what the writer holds.
class History {
 public:
  explicit History(std::string path) : path_(std::move(path)) {
    writer_ = std::move(TileWriter::create(path_, {}).value());
  }

  void append() {
    const auto run = *rc::gen::inRange(1, 40);
    // Mostly neighbours; now and then a gap, a large gap, or a new level.
    const auto step = *rc::gen::weightedElement<std::uint64_t>(
        {{20, 1}, {3, 2}, {1, 700}, {1, 1500}, {1, std::uint64_t{1} << 40}});
    // 1: a new level; 2: a new state of it.
    const auto level_up = *rc::gen::weightedElement<int>({{8, 0}, {1, 1}, {2, 2}});
    const auto size = *rc::gen::element<std::size_t>(0, 1, 40, 900, 5000, 70000, 300000);
    for (int i = 0; i < run; ++i) {
      TileKey key = top_ ? TileKey{top_->level, top_->index + step, top_->state} : TileKey{};
      if (i == 0 && level_up == 1 && top_) key = {static_cast<std::uint8_t>(top_->level + 1), 0};
      if (i == 0 && level_up == 2 && top_) key = in_state({top_->level, 0}, top_->state + 1);
      const Bytes bytes = tile_bytes(key, size == 0 ? 0 : size + key.index % 9, salt_);
      const TileKey earlier = in_state(key, key.state / 2);
      const bool same = key.state > 0 && key.index % 3 > 0 && is_stored(earlier);
      RC_ASSERT(
          (same ? writer_->append(key, {}, key.state - earlier.state) : writer_->append(key, bytes))
              .has_value());
      held_[key] = same ? Bytes() : bytes;
      if (same) same_[key] = earlier;
      if (!same) same_.erase(key);
      top_ = key;
    }
  }

  void commit() {
    RC_ASSERT(writer_->commit().has_value());
    const auto last = writer_->last();
    const auto moved = std::erase_if(held_, [&](const auto& tile) {
      if (!last || tile.first > *last) return false;
      kept_[tile.first] = tile.second;
      return true;
    });
    RC_ASSERT(moved == 0 || kept_.contains(*last));
    take_replaced();
  }

  void close_and_resume() {
    RC_ASSERT(writer_->close().has_value());
    kept_.merge(held_);
    held_.clear();
    take_replaced();
    reopen();
  }

  // What was not committed is gone.
  void kill_and_resume() {
    ++salt_;
    held_.clear();
    replaced_.clear();
    reopen();
  }

  void replace() {
    if (kept_.empty()) return;
    const auto at = *rc::gen::inRange<std::size_t>(0, kept_.size());
    const TileKey key = std::next(kept_.begin(), static_cast<long>(at))->first;
    const auto state = *rc::gen::element(TileState::missing, TileState::empty, TileState::stored);
    const Bytes bytes =
        state == TileState::stored ? tile_bytes(key, 1 + at * 97 % 9000, ++salt_) : Bytes{};
    const bool dropped = state == TileState::missing;
    const auto done = dropped ? writer_->drop(key) : writer_->replace(key, bytes);
    RC_ASSERT(done.has_value());
    replaced_[key] = {state, bytes};
  }

  void compare() const {
    auto store = TileStore::open(path_);
    RC_ASSERT(store.has_value());
    std::vector<Error> findings;
    store->check_structure(findings);
    RC_ASSERT(findings.empty());
    Model expected;
    for (const auto& [key, bytes] : kept_) expected[key] = shown_bytes(key);
    RC_ASSERT(contents(*store) == expected);
    const auto random = *rc::gen::arbitrary<std::uint64_t>();
    for (const auto& [key, bytes] : kept_) {
      if ((key.index + random) % 7 != 0) continue;
      for (const TileKey near :
           {key, TileKey{key.level, key.index + 1, key.state},
            TileKey{key.level, key.index - (key.index > 0 ? 1 : 0), key.state}}) {
        const auto found = store->find(near);
        RC_ASSERT(found.has_value());
        const auto kept = kept_.find(near);
        const bool lost = same_.contains(near) && shown_bytes(near).empty();
        RC_ASSERT((found->state == TileState::missing) == (kept == kept_.end() || lost));
        if (found->state == TileState::missing) continue;
        RC_ASSERT((found->source != near) == same_.contains(near));
        const auto seen = find_whole(*store, near);
        RC_ASSERT(seen.has_value());
        RC_ASSERT(std::ranges::equal(seen->payload, shown_bytes(near)));
      }
    }
  }

 private:
  [[nodiscard]] bool is_stored(TileKey key) const {
    for (const Model* model : {&held_, &kept_})
      if (const auto tile = model->find(key); tile != model->end()) return !tile->second.empty();
    return false;
  }

  [[nodiscard]] Bytes shown_bytes(TileKey key) const {
    const auto same = same_.find(key);
    const auto tile = kept_.find(same == same_.end() ? key : same->second);
    return tile == kept_.end() ? Bytes() : tile->second;
  }

  void take_replaced() {
    for (const auto& [key, tile] : replaced_) {
      same_.erase(key);
      if (tile.first == TileState::missing)
        kept_.erase(key);
      else
        kept_[key] = tile.second;
    }
    replaced_.clear();
  }

  void reopen() {
    writer_.reset();
    auto writer = TileWriter::resume(path_);
    RC_ASSERT(writer.has_value());
    writer_ = std::move(*writer);
    top_ = writer_->last();
  }

  std::string path_;
  std::optional<TileWriter> writer_;
  Model kept_;
  Model held_;
  std::map<TileKey, TileKey> same_;  // of both: the tile of an earlier state that it is
  std::map<TileKey, std::pair<TileState, Bytes>> replaced_;  // not committed
  std::optional<TileKey> top_;
  std::uint64_t salt_ = 0;
};

TEST(Model, AnyHistoryLeavesWhatItShould) {
  const bool passed = rc::check([] {
    TemporaryFolder folder;
    History history(folder / "a.slf");
    const auto length = *rc::gen::inRange(1, 25);
    for (int i = 0; i < length; ++i) {
      switch (*rc::gen::weightedElement<int>({{8, 0}, {4, 1}, {1, 2}, {1, 3}, {2, 4}, {1, 5}})) {
        case 0:
          history.append();
          break;
        case 1:
          history.commit();
          break;
        case 2:
          history.close_and_resume();
          break;
        case 3:
          history.kill_and_resume();
          break;
        case 4:
          history.replace();
          break;
        default:
          history.compare();
      }
    }
    history.commit();
    history.compare();
  });
  EXPECT_TRUE(passed);
}

}  // namespace
}  // namespace slf::storage::testing
