// Measures how fast tiles decode, on one thread:
//
//   decode_speed FIELD [EVERY [REPEATS]]
//
// Workload: every EVERY-th (16) stored tile of the finest level, REPEATS (9) times. Tiles that they
// are predicted from are decoded before, in the first round, which is not counted. Reported: the
// median processor time of a round, the decoded samples (RGBA and, in a predictive field, depth)
// in MB per second, and a hash of these samples.

#include <xxhash.h>

#include <cstdio>
#include <cstdlib>

#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "field/tiles/tile_cache.h"

int main(int argc, char** argv) {
  using namespace slf;
  if (argc < 2) {
    std::fprintf(stderr, "Usage: decode_speed FIELD [EVERY [REPEATS]]\n");
    return 1;
  }
  const int every = argc > 2 ? std::atoi(argv[2]) : 16;
  const int repeats = argc > 3 ? std::atoi(argv[3]) : 9;
  const Field field = bench::expect(Field::open(argv[1]));
  const FieldFile& file = field.file();
  const auto finest = static_cast<std::uint8_t>(file.shape().finest_level);

  std::vector<storage::TileRef> tiles;
  std::uint64_t stored = 0, bytes = 0;
  const auto visited = file.store().visit(
      {finest, 0}, {static_cast<std::uint8_t>(finest + 1), 0},
      [&](const storage::TileRef& tile) -> Result<void> {
        if (tile.state != storage::TileState::stored) return {};
        if (stored++ % static_cast<std::uint64_t>(every) != 0) return {};
        tiles.push_back(tile);
        bytes += file.tile_shape(tile.key).bytes();
        return {};
      },
      [](const storage::Damage&) {});
  bench::require(visited.has_value(), "a record is damaged");

  TileCache references(file, 4ull << 30);
  Bytes samples;
  std::uint64_t hash = 0;
  const auto decode_all = [&] {
    hash = 0;
    for (const storage::TileRef& tile : tiles) {
      samples.resize(file.tile_shape(tile.key).bytes());
      bench::expect(file.store().check(tile));
      std::vector<ReferenceSamples> from;
      for (const TileKey reference : bench::expect(file.references(tile)))
        from.push_back({reference, bench::expect(references.load(reference)).samples()});
      bench::expect(file.decode(tile, from, samples));
      hash = XXH3_64bits_withSeed(samples.data(), samples.size(), hash);
    }
  };
  decode_all();
  bench::Times times;
  for (int k = 0; k < repeats; ++k) times.run(decode_all);
  std::printf("%zu tiles, %.1f ms, %.1f MB/s, samples %016llx\n", tiles.size(),
              1e3 * times.median_cpu(), 1e-6 * static_cast<double>(bytes) / times.median_cpu(),
              static_cast<unsigned long long>(hash));
}
