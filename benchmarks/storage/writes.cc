#include <algorithm>
#include <ctime>
#include <filesystem>

#include "base/parallel.h"
#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/page_cache.h"
#include "benchmarks/storage/scenarios.h"
#include "field/tiles/tile_cache.h"
#include "slf/field.h"
#include "slf/repack.h"
#include "storage/tile_writer.h"

namespace slf::bench {
namespace {

constexpr std::size_t kTiles = 4000;
constexpr std::uint64_t kCommitBytes = 32ull << 20;

// Samples of the tiles, all in memory, and a codec to encode them with.
struct Work {
  TileSet set;
  std::vector<Bytes> samples;
};

Work work_of(const Settings& settings) {
  Work work{tiles_of_field(settings.field, kTiles), {}};
  work.samples.resize(work.set.size());
  expect(parallel_for(work.set.size(), 0, [&](std::uint64_t i) {
    work.set.decode(i, work.set.payloads[i], work.samples[i]);
  }));
  return work;
}

// The cost of some work, in seconds of the wall clock, including the disk, and of the processor.
struct Cost {
  double wall = 1e9;
  double cpu = 1e9;
};

// Runs work(), and returns the smaller of its cost and of `before`, separately for both clocks.
template <class Work>
Cost cheaper(const Cost& before, const Work& work) {
  const double wall = now();
  const std::clock_t cpu = std::clock();
  work();
  return {std::min(before.wall, now() - wall),
          std::min(before.cpu, static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC)};
}

void encode_alone(const Work& work, unsigned threads) {
  std::atomic<std::uint64_t> next{0};
  expect(on_threads(threads, [&] {
    Bytes payload;
    for (std::uint64_t i; (i = next.fetch_add(1)) < work.set.size();)
      expect(work.set.codec->encode(work.set.shapes[i], work.samples[i], nullptr, payload));
  }));
}

// As build_field does it: encoders on all threads, one writer, a commit every 32 MiB.
void encode_and_store(const Work& work, unsigned threads, const std::string& path) {
  auto writer = expect(storage::TileWriter::create(path, {}));
  const auto encode = [&](std::uint64_t i) -> Result<Bytes> {
    Bytes payload;
    expect(work.set.codec->encode(work.set.shapes[i], work.samples[i], nullptr, payload));
    return payload;
  };
  const auto append = [&](std::uint64_t i, Bytes payload) -> Result<void> {
    expect(writer.append({work.set.level, work.set.keys[i]}, std::move(payload)));
    return writer.pending_bytes() >= kCommitBytes ? writer.commit() : Result<void>();
  };
  expect(make_in_order(
      work.set.size(), threads, 8 * threads, [&] { return encode; }, append));
  expect(writer.close());
}

// Decodes every stored tile of the field and encodes it with another codec, in memory.
void recode_alone(const Field& field, const codec::Codec& codec, unsigned threads) {
  std::vector<storage::TileRef> tiles;
  expect(field.file().store().visit({0, 0}, {255, 0},
                                    [&](const storage::TileRef& tile) -> Result<void> {
                                      if (tile.state == storage::TileState::stored)
                                        tiles.push_back(tile);
                                      return {};
                                    }));
  TileCache cache(field.file(), 64 << 20);
  std::atomic<std::uint64_t> next{0};
  expect(on_threads(threads, [&] {
    Bytes samples, payload;
    for (std::uint64_t i; (i = next.fetch_add(1)) < tiles.size();) {
      const TileShape shape = field.file().tile_shape(tiles[i].key);
      samples.resize(shape.bytes());
      expect(cache.read(tiles[i].key, samples));
      expect(codec.encode(shape, samples, nullptr, payload));
    }
  }));
}

Row row(const std::string& what, const Cost& alone, const Cost& whole) {
  return {{"what", what},
          {"codec alone s", alone.wall},
          {"with the store s", whole.wall},
          {"above", whole.wall / alone.wall - 1},
          {"codec alone cpu s", alone.cpu},
          {"with the store cpu s", whole.cpu},
          {"above, cpu", whole.cpu / alone.cpu - 1}};
}

}  // namespace

void measure_writes(const Settings& settings, Report& report) {
  const unsigned threads = thread_count(0);
  const std::string path = settings.folder + "/written.slf";
  const auto fresh = [&] { std::filesystem::remove(path); };

  Cost encode, build;
  {
    const Work work = work_of(settings);
    for (int round = 0; round < settings.rounds; ++round) {
      encode = cheaper(encode, [&] { encode_alone(work, threads); });
      fresh();
      build = cheaper(build, [&] { encode_and_store(work, threads, path); });
    }
  }

  const auto field = expect(Field::open(settings.field));
  RepackOptions options;
  options.codec = "jpeg:60";
  options.threads = threads;
  const auto codec = expect(codec::make_codec(options.codec, field.format()));
  Cost recode, repack;
  for (int round = 0; round < std::min(settings.rounds, 3); ++round) {
    recode = cheaper(recode, [&] { recode_alone(field, *codec, threads); });
    fresh();
    repack = cheaper(repack, [&] { (void)expect(repack_field(field, path, options)); });
  }
  fresh();
  report.table(
      "bulk writes, " + std::to_string(threads) + " threads, to the disk and synced",
      {row("build: encode", encode, build), row("repack: decode, encode", recode, repack)});
  report.target("build: time above encoding alone", build.wall / encode.wall - 1, 0.15, false);
  report.target("repack: time above recoding alone", repack.wall / recode.wall - 1, 0.15, false);
}

}  // namespace slf::bench
