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
    writer_ = std::move(TileWriter::create(path_, kTwoLayers, {}).value());
  }

  void append() {
    const auto layer = *rc::gen::inRange<LayerId>(0, 2);
    const auto run = *rc::gen::inRange(1, 40);
    // Mostly neighbours; now and then a gap, a large gap, or a new level.
    const auto step = *rc::gen::weightedElement<std::uint64_t>(
        {{20, 1}, {3, 2}, {1, 700}, {1, 1500}, {1, std::uint64_t{1} << 40}});
    const auto level_up = *rc::gen::weightedElement<int>({{9, 0}, {1, 1}});
    const auto size = *rc::gen::element<std::size_t>(0, 1, 40, 900, 5000, 70000, 300000);
    for (int i = 0; i < run; ++i) {
      std::optional<TileKey>& top = top_[layer];
      TileKey key = top ? TileKey{top->level, top->index + step} : TileKey{};
      if (i == 0 && level_up != 0 && top) key = {static_cast<std::uint8_t>(top->level + 1), 0};
      const Bytes bytes = tile_bytes(layer, key, size == 0 ? 0 : size + key.index % 9, salt_);
      RC_ASSERT(writer_->append(layer, key, bytes).has_value());
      held_[layer][key] = bytes;
      top = key;
    }
  }

  void commit() {
    RC_ASSERT(writer_->commit().has_value());
    for (LayerId layer = 0; layer < 2; ++layer) {
      const auto last = writer_->last(layer).value();
      const auto moved = std::erase_if(held_[layer], [&](const auto& tile) {
        if (!last || tile.first > *last) return false;
        kept_[layer][tile.first] = tile.second;
        return true;
      });
      RC_ASSERT(moved == 0 || kept_[layer].contains(*last));
    }
    take_replaced();
  }

  void close_and_resume() {
    RC_ASSERT(writer_->close().has_value());
    for (LayerId layer = 0; layer < 2; ++layer) {
      kept_[layer].merge(held_[layer]);
      held_[layer].clear();
    }
    take_replaced();
    reopen();
  }

  // What was not committed is gone.
  void kill_and_resume() {
    ++salt_;
    for (LayerId layer = 0; layer < 2; ++layer) {
      held_[layer].clear();
      replaced_[layer].clear();
    }
    reopen();
  }

  void replace() {
    const auto layer = *rc::gen::inRange<LayerId>(0, 2);
    const Model& kept = kept_[layer];
    if (kept.empty()) return;
    const auto at = *rc::gen::inRange<std::size_t>(0, kept.size());
    const TileKey key = std::next(kept.begin(), static_cast<long>(at))->first;
    const auto state = *rc::gen::element(TileState::missing, TileState::empty, TileState::stored);
    const Bytes bytes =
        state == TileState::stored ? tile_bytes(layer, key, 1 + at * 97 % 9000, ++salt_) : Bytes{};
    RC_ASSERT(writer_->replace(layer, key, state, bytes).has_value());
    replaced_[layer][key] = {state, bytes};
  }

  void compare() const {
    auto store = TileStore::open(path_);
    RC_ASSERT(store.has_value());
    std::vector<Error> findings;
    store->check_structure(findings);
    RC_ASSERT(findings.empty());
    for (LayerId layer = 0; layer < 2; ++layer) {
      RC_ASSERT(contents(*store, layer) == kept_[layer]);
      const auto random = *rc::gen::arbitrary<std::uint64_t>();
      for (const auto& [key, bytes] : kept_[layer]) {
        if ((key.index + random) % 7 != 0) continue;
        for (const TileKey near :
             {key, TileKey{key.level, key.index + 1}, TileKey{key.level, key.index - 1}}) {
          const auto found = store->find(layer, near);
          RC_ASSERT(found.has_value());
          const auto expected = kept_[layer].find(near);
          RC_ASSERT((found->state == TileState::missing) == (expected == kept_[layer].end()));
          if (expected == kept_[layer].end()) continue;
          RC_ASSERT(std::ranges::equal(found->payload, expected->second));
        }
      }
    }
  }

 private:
  void take_replaced() {
    for (LayerId layer = 0; layer < 2; ++layer) {
      for (const auto& [key, tile] : replaced_[layer]) {
        if (tile.first == TileState::missing)
          kept_[layer].erase(key);
        else
          kept_[layer][key] = tile.second;
      }
      replaced_[layer].clear();
    }
  }

  void reopen() {
    writer_.reset();
    auto writer = TileWriter::resume(path_);
    RC_ASSERT(writer.has_value());
    writer_ = std::move(*writer);
    for (LayerId layer = 0; layer < 2; ++layer) top_[layer] = writer_->last(layer).value();
  }

  std::string path_;
  std::optional<TileWriter> writer_;
  Model kept_[2];
  Model held_[2];
  std::map<TileKey, std::pair<TileState, Bytes>> replaced_[2];  // not committed
  std::optional<TileKey> top_[2];
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
