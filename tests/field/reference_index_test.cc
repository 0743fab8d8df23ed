// The list of what tiles are predicted from: what was written is found again, and damage is no
// harm.
#include "field/reference_index.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "base/file.h"
#include "field/field_file.h"
#include "field/write/field_writer.h"
#include "storage/internal/file_index.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

std::vector<ReferenceIndex::Tile> random_tiles(unsigned level, std::mt19937_64& random) {
  std::vector<ReferenceIndex::Tile> tiles;
  const std::uint64_t coarser = std::uint64_t{64} << 4 * (level - 1);
  for (std::uint64_t index = 0; index < 16 * coarser; index += 1 + random() % 40) {
    ReferenceIndex::Tile tile{{static_cast<std::uint8_t>(level), index}, {}};
    for (std::uint64_t r = random() % 30; r > 0; --r)
      tile.references.push_back({static_cast<std::uint8_t>(level - 1), random() % coarser});
    tiles.push_back(tile);
  }
  return tiles;
}

std::set<TileKey> as_set(const std::vector<TileKey>& keys) { return {keys.begin(), keys.end()}; }

TEST(ReferenceIndex, FindsWhatWasWritten) {
  std::mt19937_64 random(3);
  for (const unsigned level : {1u, 2u}) {
    const auto tiles = random_tiles(level, random);
    const auto index = ReferenceIndex::parse(ReferenceIndex::encode(tiles), level);
    ASSERT_TRUE(index) << index.error().message;
    for (const auto& tile : tiles) {
      std::vector<TileKey> found;
      index->append_references(tile.key, found);
      EXPECT_EQ(as_set(found), as_set(tile.references)) << tile.key.index;
      found.clear();
      index->append_references(in_state(tile.key, 5), found);  // each state has the same
      for (TileKey& key : found) key = in_state(key, key.state - 5);
      EXPECT_EQ(as_set(found), as_set(tile.references)) << tile.key.index;
    }
    std::vector<TileKey> none;
    index->append_references({static_cast<std::uint8_t>(level), ~std::uint64_t{0}}, none);
    EXPECT_TRUE(none.empty());
  }
}

TEST(ReferenceIndex, AncestorsAreThoseOfAllLevels) {
  std::mt19937_64 random(5);
  std::vector<ReferenceIndex> indices;
  std::map<TileKey, std::vector<TileKey>> references;
  for (const unsigned level : {1u, 2u}) {
    const auto tiles = random_tiles(level, random);
    for (const auto& tile : tiles) references[tile.key] = tile.references;
    indices.push_back(*ReferenceIndex::parse(ReferenceIndex::encode(tiles), level));
  }
  std::set<TileKey> expected;
  const std::function<void(TileKey)> add = [&](TileKey key) {
    if (!expected.insert(key).second) return;
    for (const TileKey reference : references[key]) add(reference);
  };
  std::vector<TileKey> tiles;
  for (const auto& [key, of] : references)
    if (key.level == 2 && random() % 8 == 0) tiles.push_back(key);
  for (const TileKey key : tiles) add(key);
  append_ancestors(indices, tiles);
  EXPECT_EQ(tiles, std::vector<TileKey>(expected.begin(), expected.end()));
}

TEST(ReferenceIndex, DamageIsRefusedOrHarmless) {
  std::mt19937_64 random(7);
  const Bytes sound = ReferenceIndex::encode(random_tiles(1, random));
  for (std::size_t size = 0; size < sound.size(); ++size)
    (void)ReferenceIndex::parse(ByteSpan(sound).first(size), 1);
  for (int trial = 0; trial < 2000; ++trial) {
    Bytes damaged = sound;
    damaged[random() % damaged.size()] ^= static_cast<std::byte>(1 << random() % 8);
    const auto index = ReferenceIndex::parse(damaged, 1);
    std::vector<TileKey> found;
    for (std::uint64_t k = 0; index && k < 1024; ++k) index->append_references({1, k}, found);
  }
}

TEST(ReferenceIndex, AFieldsIndexListsWhatPayloadsName) {
  const testing::TemporaryFolder folder;
  const std::string path = folder / "field.slf";
  BuildOptions options = testing::lossless_options(4, 16, 2);
  options.codec = "predictive:90";
  ASSERT_TRUE(build_field(**make_analytic_scene("balls"), path, options));
  const auto field = FieldFile::open(path);
  ASSERT_TRUE(field);
  const auto bytes = read_file(path, 1 << 30);
  ASSERT_TRUE(bytes);
  const ByteSpan file(*bytes);
  const std::uint64_t size =
      storage::internal::FileIndex::size(file.last(storage::internal::kIndexFooter));
  ASSERT_GT(size, 0u) << "a build ends with an index";
  const auto found = storage::internal::FileIndex::parse(file.last(size), file.size());
  ASSERT_TRUE(found);
  unsigned sections = 0;
  for (const auto& section : found->sections) {
    for (const std::uint8_t level : {1, 2}) {
      if (section.id != reference_section(level)) continue;
      ++sections;
      const auto index = ReferenceIndex::parse(
          file.subspan(section.range.begin, section.range.end - section.range.begin), level);
      ASSERT_TRUE(index);
      for (std::uint64_t k = 0; k < std::uint64_t{64} << 4 * level; ++k) {
        const auto tile = (*field)->store().find({level, k});
        ASSERT_TRUE(tile);
        if (tile->state != storage::TileState::stored) continue;
        std::vector<TileKey> listed;
        index->append_references(tile->key, listed);
        std::set<TileKey> named;
        const auto of_payload = (*field)->references(*tile);
        for (const TileKey reference : *of_payload) named.insert(reference);
        ASSERT_EQ(as_set(listed), named) << k;
      }
    }
  }
  EXPECT_EQ(sections, 2u);
}

}  // namespace
}  // namespace slf
