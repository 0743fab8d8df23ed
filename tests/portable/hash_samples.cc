// Prints two hashes (FNV-1a) for each field FILE.slf...: of the decoded samples of all tiles, and,
// where tiles are predicted, of what their samples are encoded to again. They must be the same for
// every compiler, instruction set and processor.
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "codec/codec.h"
#include "codec/predictive_codec.h"
#include "field/geometry/level_geometry.h"
#include "field/geometry/section.h"
#include "field/manifest.h"
#include "field/tile_coder.h"
#include "storage/ranged_store.h"

namespace {

using namespace slf;

template <class T>
T expect(Result<T> result) {
  if (result) return std::move(*result);
  std::fprintf(stderr, "hash_samples: %s\n", result.error().message.c_str());
  std::exit(4);
}
void expect(const Result<void>& result) {
  if (!result) expect(Result<int>(tl::unexpected(result.error())));
}

class Hash {
 public:
  void add(ByteSpan bytes) {
    for (const std::byte byte : bytes)
      hash_ = (hash_ ^ std::to_integer<std::uint64_t>(byte)) * 0x100000001B3u;
  }
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xCBF29CE484222325u;
};

Bytes read_file(const char* path) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> chars{std::istreambuf_iterator<char>(file), {}};
  const ByteSpan bytes = std::as_bytes(std::span(chars));
  return {bytes.begin(), bytes.end()};
}

/// The result of `call`, which is repeated until `store` has all the bytes that it needs.
template <class Call>
auto with_bytes(storage::RangedStore& store, ByteSpan file, Call call) {
  while (true) {
    auto result = call();
    const auto needed = store.take_needed_ranges();
    if (needed.empty()) return result;
    for (const storage::FileRange& range : needed) {
      const ByteSpan bytes = file.subspan(range.begin, range.end - range.begin);
      store.add(range.begin, {bytes.begin(), bytes.end()});
    }
  }
}

void hash_field(const char* path) {
  const Bytes bytes = read_file(path);
  storage::RangedStore store(path, bytes.size());
  const auto fetch = [&](auto call) { return with_bytes(store, bytes, call); };
  expect(fetch([&] { return store.open(); }));
  const ByteSpan text = expect(fetch([&] { return store.blob("field"); }));
  const Manifest manifest =
      expect(Manifest::parse({reinterpret_cast<const char*>(text.data()), text.size()}, path));
  std::vector<std::unique_ptr<LevelGeometry>> levels;
  for (unsigned level = 0; level <= manifest.shape.finest_level; ++level)
    levels.push_back(std::make_unique<LevelGeometry>(manifest.shape, level));
  const auto geometry = [&](unsigned level) -> const LevelGeometry& { return *levels[level]; };

  Hash samples_hash, payload_hash;
  const auto tables = fetch([&] { return store.blob("tables"); });
  const auto codec =
      expect(codec::make_codec(manifest.codec, manifest.format, tables ? *tables : ByteSpan()));
  const TileCoder coder(manifest.shape, manifest.format, *codec, geometry);
  std::map<TileKey, Bytes> decoded;
  const auto samples_of = [&](const std::vector<TileKey>& references) {
    std::vector<ReferenceSamples> from;
    for (const TileKey reference : references) from.push_back({reference, decoded.at(reference)});
    return from;
  };
  for (unsigned level = 0; level <= manifest.shape.finest_level; ++level)
    for (std::uint64_t index = 0; index < manifest.shape.tiles(level); ++index) {
      const TileKey key{static_cast<std::uint8_t>(level), index};
      const auto tile = expect(fetch([&] { return store.find(key); }));
      decoded[key];
      if (tile.state != storage::TileState::stored) continue;
      const ByteSpan payload =
          ByteSpan(bytes).subspan(tile.payload.begin, tile.payload.end - tile.payload.begin);
      Bytes samples(coder.tile_shape(key).bytes());
      expect(coder.decode(key, payload, samples_of(coder.references(key, payload)), samples));
      samples_hash.add(samples);
      if (coder.predicts()) {
        Bytes again;
        expect(coder.encode(key, samples, samples_of(coder.choose(key, samples)), again));
        payload_hash.add(again);
      }
      decoded[key] = std::move(samples);
    }
  const char* const slash = std::strrchr(path, '/');
  std::printf("%-24s %016" PRIx64 " %016" PRIx64 "\n", slash ? slash + 1 : path,
              samples_hash.value(), payload_hash.value());
}

}  // namespace

int main(int argc, char** argv) {
  for (int k = 1; k < argc; ++k) hash_field(argv[k]);
}
