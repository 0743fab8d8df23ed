// What the tests of the container share: a folder that goes away, and tiles one can recognise.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "storage/tile_store.h"
#include "storage/tile_writer.h"
#include "tests/temporary_folder.h"

namespace slf::storage::testing {

using slf::testing::TemporaryFolder;

/// Bytes that depend on the place and the seed, so that no two tiles are alike.
inline Bytes tile_bytes(TileKey key, std::size_t size, std::uint64_t seed = 0) {
  std::mt19937_64 random(key.index * 0x9E3779B97F4A7C15u + key.level * 1000003u + seed);
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; i += 8) {
    const std::uint64_t word = random();
    for (std::size_t k = i; k < size && k < i + 8; ++k)
      bytes[k] = static_cast<std::byte>(word >> (8 * (k - i)));
  }
  return bytes;
}

inline Bytes bytes_of(std::string_view text) {
  const auto span = std::as_bytes(std::span(text.data(), text.size()));
  return {span.begin(), span.end()};
}

inline Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(in)), {});
  return bytes_of(text);
}

inline void write_file(const std::string& path, ByteSpan bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
}

/// What a container holds: empty bytes stand for an empty tile.
using Model = std::map<TileKey, Bytes>;

template <class T>
::testing::AssertionResult ok(const Result<T>& result) {
  if (result) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << result.error().message;
}

inline TileWriter create(const std::string& path) {
  const std::vector<std::pair<std::string, Bytes>> blobs = {{"manifest.json", bytes_of("{}")}};
  auto writer = TileWriter::create(path, blobs);
  EXPECT_TRUE(ok(writer));
  return std::move(writer.value());
}

/// A tile whose payload is whole, if it has one.
inline Result<TileRef> find_whole(const TileStore& store, TileKey key) {
  auto tile = store.find(key);
  if (tile)
    if (auto good = store.check(*tile); !good) return tl::unexpected(good.error());
  return tile;
}

/// Everything it gives when visited, payloads checked.
inline Model contents(const TileStore& store) {
  Model model;
  const auto visited = store.visit({0, 0}, {255, 0}, [&](const TileRef& tile) {
    EXPECT_NE(tile.state, TileState::missing);
    EXPECT_TRUE(ok(store.check(tile)));
    EXPECT_TRUE(model.empty() || model.rbegin()->first < tile.key);
    const auto same = find_whole(store, tile.key);
    EXPECT_TRUE(ok(same));
    EXPECT_TRUE(tile.state == TileState::same || same->payload.data() == tile.payload.data());
    model[tile.key] = Bytes(same->payload.begin(), same->payload.end());
    return Result<void>();
  });
  EXPECT_TRUE(ok(visited));
  return model;
}

/// find_all() gives, for the tiles of the model and some that are not there, in any order and
/// repeatedly, exactly what find() gives. In a damaged file it may find more: a record that was
/// reached by another of its tiles.
inline void expect_finds_alike(const TileStore& store, const Model& model) {
  std::vector<TileKey> keys{{0, 0}, {7, 7}, {254, ~std::uint64_t{0}}};
  for (const auto& [key, bytes] : model) {
    keys.push_back(key);
    if (key.index % 5 == 0) keys.insert(keys.end(), {key, {key.level, key.index + 1}});
  }
  std::shuffle(keys.begin(), keys.end(), std::mt19937_64(keys.size()));
  const auto all = store.find_all(keys);
  ASSERT_EQ(all.size(), keys.size());
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const auto one = store.find(keys[i]);
    if (!one && all[i]) {
      const auto held = model.find(keys[i]);
      ASSERT_EQ(all[i]->state == TileState::missing, held == model.end());
      if (held == model.end() || !store.check(*all[i])) continue;
      EXPECT_TRUE(std::ranges::equal(all[i]->payload, held->second));
      continue;
    }
    ASSERT_EQ(all[i].has_value(), one.has_value());
    if (!one) continue;
    EXPECT_EQ(all[i]->state, one->state);
    EXPECT_EQ(all[i]->key, keys[i]);
    EXPECT_EQ(all[i]->payload.data(), one->payload.data());
    EXPECT_EQ(all[i]->payload.size(), one->payload.size());
    EXPECT_EQ(all[i]->checksum, one->checksum);
    EXPECT_EQ(all[i]->source, one->source);
  }
}

/// The tiles of one state, with the keys that its readers use.
inline Model of_state(const Model& model, std::uint64_t state) {
  Model own;
  for (const auto& [key, bytes] : model)
    if (key.state == state) own[in_state(key, 0)] = bytes;
  return own;
}

/// No finding, and find() agrees with the model for its tiles.
inline void expect_holds(const std::string& path, const Model& model) {
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  std::vector<Error> findings;
  store->check_structure(findings);
  for (const Error& finding : findings) ADD_FAILURE() << finding.message;
  EXPECT_EQ(contents(*store), model);
  expect_finds_alike(*store, model);
  for (const auto& [key, bytes] : model) {
    const auto tile = find_whole(*store, key);
    ASSERT_TRUE(ok(tile));
    EXPECT_EQ(tile->state, bytes.empty() ? TileState::empty : TileState::stored);
    EXPECT_EQ(Bytes(tile->payload.begin(), tile->payload.end()), bytes);
  }
}

}  // namespace slf::storage::testing
