// What a container gives back: order, presence, blobs, ranges, and what it refuses.
#include "storage/tile_store.h"
#include "storage/tile_writer.h"

#include <gmock/gmock.h>

#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

using ::testing::HasSubstr;

TEST(TileStore, GivesBackTilesAndBlobs) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 300; ++i) {
      const TileKey key{static_cast<std::uint8_t>(i / 100), i % 100 * 3};
      model[key] = i % 7 == 0 ? Bytes{} : tile_bytes(key, 100 + 37 * i);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
    }
    ASSERT_TRUE(ok(writer.set_blob("notes", bytes_of("of a builder"))));
    ASSERT_TRUE(ok(writer.close()));
  }
  expect_holds(path, model);
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  EXPECT_EQ(store->path(), path);
  EXPECT_EQ(store->file_bytes(), std::filesystem::file_size(path));
  const auto notes = store->blob("notes");
  ASSERT_TRUE(ok(notes));
  EXPECT_EQ(Bytes(notes->begin(), notes->end()), bytes_of("of a builder"));
  EXPECT_TRUE(ok(store->blob("manifest.json")));
  EXPECT_EQ(store->blob("other").error().code, ErrorCode::bad_file);
  EXPECT_FALSE(std::filesystem::exists(path + "-lock"));
  EXPECT_FALSE(std::filesystem::exists(path + ".new"));
}

TEST(TileStore, TellsMissingFromEmpty) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    ASSERT_TRUE(ok(writer.append({1, 10}, {})));
    ASSERT_TRUE(ok(writer.append({1, 12}, tile_bytes({1, 12}, 5))));
    ASSERT_TRUE(ok(writer.append({1, 5000}, {})));
    ASSERT_TRUE(ok(writer.append({3, 0}, {})));
    ASSERT_TRUE(ok(writer.close()));
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  const auto state = [&](TileKey key) { return store->find(key)->state; };
  EXPECT_EQ(state({1, 10}), TileState::empty);
  EXPECT_EQ(state({1, 12}), TileState::stored);
  EXPECT_EQ(state({1, 5000}), TileState::empty);
  EXPECT_EQ(state({3, 0}), TileState::empty);
  for (const TileKey key : {TileKey{0, 0}, TileKey{1, 0}, TileKey{1, 9}, TileKey{1, 11},
                            TileKey{1, 13}, TileKey{1, 4999}, TileKey{1, 5001}, TileKey{2, 0},
                            TileKey{3, 1}, TileKey{255, ~std::uint64_t{0}}})
    EXPECT_EQ(state(key), TileState::missing) << int{key.level} << "/" << key.index;
}

TEST(TileStore, HoldsIndexesOf50BitsInAnyState) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    constexpr std::uint64_t kTop = (std::uint64_t{1} << 50) - 1;
    constexpr std::uint16_t kLast = (1 << 14) - 1;
    for (const TileKey key :
         {TileKey{0, 0}, TileKey{0, 1u << 31}, TileKey{0, std::uint64_t{1} << 32},
          TileKey{0, kTop - 1}, TileKey{0, kTop}, TileKey{0, 0, 1}, TileKey{0, kTop, kLast - 1},
          TileKey{0, 0, kLast}, TileKey{0, kTop, kLast}, TileKey{1, 0},
          TileKey{254, kTop, kLast}}) {
      model[key] = tile_bytes(key, 33);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  expect_holds(path, model);
}

TEST(TileStore, HoldsTilesOfSeveralStates) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    const auto append = [&](TileKey key, std::size_t size) {
      model[key] = tile_bytes(key, size);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
    };
    const auto append_same = [&](TileKey key, std::uint64_t back) {
      model[key] = model[in_state(key, key.state - back)];
      ASSERT_TRUE(ok(writer.append(key, {}, back)));
    };
    for (const std::uint8_t level : {std::uint8_t{0}, std::uint8_t{3}}) {
      for (std::uint64_t i = 0; i < 3000; ++i) append({level, i}, i % 7 == 0 ? 0 : 20 + i % 90);
      for (std::uint64_t i = 0; i < 3000; ++i)
        if (i % 7 == 0 || i % 3 == 0)
          append(in_state({level, i}, 1), 300);
        else if (i % 3 == 1)
          append_same(in_state({level, i}, 1), 1);
      for (std::uint64_t i = 0; i < 3000; ++i)
        if (i % 3 == 0)
          append_same(in_state({level, i}, 4095), 4094);
        else if (i % 7 != 0)
          append_same(in_state({level, i}, 4095), 4095);
    }
    const TileKey key = in_state({4, 0}, 1);
    EXPECT_EQ(writer.append(key, {}, 2).error().code, ErrorCode::usage);
    EXPECT_EQ(writer.append(key, tile_bytes(key, 9), 1).error().code, ErrorCode::usage);
    ASSERT_TRUE(ok(writer.close()));
  }
  expect_holds(path, model);
  const auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  std::uint64_t payloads = 0;
  for (const unsigned state : {0u, 1u, 4095u}) {
    const auto keys_of = [&](std::uint8_t level) {
      return TileRange{in_state({level, 0}, state), in_state({level, 0}, state + 1)};
    };
    const Model own = of_state(model, state);
    for (const std::uint8_t level : {std::uint8_t{0}, std::uint8_t{3}}) {
      const auto found = store->statistics(keys_of(level));
      ASSERT_TRUE(ok(found));
      EXPECT_EQ(found->stored + found->empty + found->same, own.size() / 2);
      if (level == 0) payloads += found->payload_bytes;
    }
    const auto covered = store->covered(keys_of(3));
    ASSERT_TRUE(ok(covered));
    const TileKey last = in_state(std::prev(own.end())->first, state);
    EXPECT_EQ(covered->back().end, (TileKey{3, last.index + 1, last.state}));
    std::size_t visited = 0;
    const auto [begin, end] = keys_of(3);
    ASSERT_TRUE(ok(store->visit(begin, end, [&](const TileRef& tile) -> Result<void> {
      EXPECT_EQ(tile.key.state, state);
      EXPECT_EQ(own.count(in_state(tile.key, 0)), 1u);
      ++visited;
      return {};
    })));
    EXPECT_EQ(visited, own.size() / 2);
    // What a reader of a tile touches is that of its own state, and of the one that it names.
    const TileKey key = in_state({3, 2998}, state);
    const auto pages = store->pages(std::vector<TileKey>{key});
    const auto range = store->range(*store->find(key));
    ASSERT_TRUE(ok(pages));
    EXPECT_TRUE(std::ranges::binary_search(*pages, range.begin / 4096));
  }
  const auto all = store->statistics({{0, 0}, {1, 0}});
  ASSERT_TRUE(ok(all));
  EXPECT_EQ(all->payload_bytes, payloads);
}

TEST(TileStore, ATileThatIsTheSameAsNoneThatIsStoredIsMissing) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    ASSERT_TRUE(ok(writer.append({0, 1}, {})));
    ASSERT_TRUE(ok(writer.append({0, 2}, bytes_of("two"))));
    for (std::uint64_t i = 0; i < 3; ++i)
      ASSERT_TRUE(ok(writer.append(in_state({0, i}, 1), {}, 1)));
    ASSERT_TRUE(ok(writer.append(in_state({0, 2}, 2), {}, 1)));
    ASSERT_TRUE(ok(writer.close()));
  }
  const auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  const TileRef found = *store->find(in_state({0, 2}, 1));
  EXPECT_EQ(found.source, (TileKey{0, 2}));
  EXPECT_TRUE(std::ranges::equal(found.payload, bytes_of("two")));
  for (const TileKey key : {in_state({0, 0}, 1), in_state({0, 1}, 1), in_state({0, 2}, 2)})
    EXPECT_EQ(store->find(key)->state, TileState::missing) << name(key);
}

TEST(TileStore, HoldsTilesOfAllSizes) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    std::uint64_t index = 0;
    for (const std::size_t size : {0u, 1u, 7u, 8u, 9u, 126u, 127u, 128u, 2000u, 4079u, 4080u, 4081u,
                                   16382u, 16383u, 65520u, 65536u, 262128u, 262129u, 1u << 20})
      for (int repeat = 0; repeat < 3; ++repeat) {
        const TileKey key{0, index++};
        model[key] = tile_bytes(key, size);
        ASSERT_TRUE(ok(writer.append(key, model[key])));
      }
    ASSERT_TRUE(ok(writer.close()));
  }
  expect_holds(path, model);
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  for (const auto& [key, bytes] : model)
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(store->find(key)->payload.data()) % 8, 0u);
}

TEST(TileStore, VisitsHalfOpenRanges) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 5000; ++i)
      ASSERT_TRUE(ok(writer.append({2, i}, tile_bytes({2, i}, 50))));
    ASSERT_TRUE(ok(writer.close()));
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  const auto count = [&](TileKey from, TileKey to) {
    std::uint64_t n = 0;
    EXPECT_TRUE(ok(store->visit(from, to, [&](const TileRef& tile) {
      EXPECT_TRUE(from <= tile.key && tile.key < to);
      ++n;
      return Result<void>();
    })));
    return n;
  };
  EXPECT_EQ(count({2, 100}, {2, 4000}), 3900u);
  EXPECT_EQ(count({2, 1023}, {2, 1025}), 2u);
  EXPECT_EQ(count({0, 0}, {2, 1}), 1u);
  EXPECT_EQ(count({2, 4999}, {9, 0}), 1u);
  EXPECT_EQ(count({2, 5000}, {9, 0}), 0u);
  EXPECT_EQ(count({2, 7}, {2, 7}), 0u);
  const auto stopped = store->visit({0, 0}, {9, 0}, [](const TileRef&) -> Result<void> {
    return fail(ErrorCode::failed, "enough");
  });
  EXPECT_EQ(stopped.error().message, "enough");
}

TEST(TileStore, CountsTilesPerLevel) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    for (std::uint8_t level = 0; level < 3; ++level)
      for (std::uint64_t i = 0; i < 100u * (level + 1u); ++i)
        ASSERT_TRUE(ok(writer.append({level, i}, Bytes(i % 4 * 10, std::byte{1}))));
    ASSERT_TRUE(ok(writer.close()));
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  for (std::uint8_t level = 0; level < 3; ++level) {
    const auto found = store->statistics({{level, 0}, {static_cast<std::uint8_t>(level + 1), 0}});
    ASSERT_TRUE(ok(found));
    const std::uint64_t tiles = 100u * (level + 1u);
    EXPECT_EQ(found->empty, tiles / 4);
    EXPECT_EQ(found->stored, tiles * 3 / 4);
    EXPECT_EQ(found->payload_bytes, tiles * 15);
    EXPECT_EQ(found->records, 1u);
  }
}

TEST(TileStore, RangeAdviseAndReleaseConcernThePayload) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  const Bytes payload = tile_bytes({0, 1}, 30000);
  {
    TileWriter writer = create(path);
    ASSERT_TRUE(ok(writer.append({0, 0}, {})));
    ASSERT_TRUE(ok(writer.append({0, 1}, payload)));
    ASSERT_TRUE(ok(writer.append({0, 2}, payload)));
    ASSERT_TRUE(ok(writer.close()));
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  std::vector<TileRef> tiles;
  for (std::uint64_t i = 3; i-- > 0;) tiles.push_back(*store->find({0, i}));
  const FileRange range = store->range(tiles[1]);
  EXPECT_EQ(range.end - range.begin, payload.size());
  const Bytes file = read_file(path);
  EXPECT_TRUE(
      std::equal(payload.begin(), payload.end(), file.begin() + static_cast<long>(range.begin)));
  EXPECT_EQ(store->range(tiles[2]).end, 0u);
  store->advise(tiles);
  store->release(tiles);
  EXPECT_TRUE(ok(store->check(tiles[1])));
}

TEST(TileStore, SaysWhatIsWrongWithAFile) {
  TemporaryFolder folder;
  const auto missing = TileStore::open(folder / "none.slf");
  EXPECT_EQ(missing.error().code, ErrorCode::not_found);
  EXPECT_THAT(missing.error().message, HasSubstr("none.slf"));
  EXPECT_EQ(TileStore::open(folder.path()).error().code, ErrorCode::io);
  write_file(folder / "text", bytes_of("not a field, but a text that is long enough to be one"));
  EXPECT_EQ(TileStore::open(folder / "text").error().code, ErrorCode::bad_file);
  write_file(folder / "empty", {});
  EXPECT_EQ(TileStore::open(folder / "empty").error().code, ErrorCode::bad_file);

  (void)create(folder / "a.slf");
  Bytes file = read_file(folder / "a.slf");
  file[20] = std::byte{2};
  write_file(folder / "newer.slf", file);
  EXPECT_EQ(TileStore::open(folder / "newer.slf").error().code, ErrorCode::unsupported);
  file[20] = std::byte{1};
  for (const std::uint32_t page : {512u, 8192u, 16384u, 65536u}) {
    store_le<std::uint32_t>(file.data() + 40, page);
    write_file(folder / "pages.slf", file);
    const auto other = TileStore::open(folder / "pages.slf");
    EXPECT_EQ(other.error().code, ErrorCode::unsupported);
    EXPECT_THAT(other.error().message, HasSubstr("pages of " + std::to_string(page)));
    EXPECT_EQ(TileWriter::resume(folder / "pages.slf").error().code, ErrorCode::unsupported);
  }
}

TEST(TileStore, FindsAPayloadThatMoved) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  const Bytes one = tile_bytes({0, 0}, 64);
  {
    TileWriter writer = create(path);
    ASSERT_TRUE(ok(writer.append({0, 0}, one)));
    ASSERT_TRUE(ok(writer.append({0, 1}, one)));
    ASSERT_TRUE(ok(writer.close()));
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  TileRef first = *store->find({0, 0});
  const TileRef second = *store->find({0, 1});
  EXPECT_NE(first.checksum, second.checksum);
  first.payload = second.payload;
  EXPECT_TRUE(ok(store->check(first)));  // the same bytes at the same place
  first.checksum = second.checksum;
  const auto moved = store->check(first);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().code, ErrorCode::bad_file);
  EXPECT_THAT(moved.error().message, HasSubstr("tile 0/0"));
}

}  // namespace
}  // namespace slf::storage::testing
