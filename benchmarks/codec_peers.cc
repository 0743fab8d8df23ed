// Compares our codecs with others on the tiles of a field: ratio, error and speed, in one run.
//
//   codec_peers FIELD.slf [--tiles N] [--level L] [--views V] [--codec SPEC]... [--json]
//
// The tiles are an even sample of one level (the finest by default), or of those tiles of the level
// that V random views of 512² from 3 radii need. The field must be lossless, since a lossy one
// lacks the detail that codecs are compared on. Ratios are against 3 bytes per sample for colour
// and 1 for depth. Our colour payloads include alpha; the bytes of lossless alpha are also shown
// separately. The peers encode only the RGB planes, as mirrored mosaics (codec/mosaic.h). Speeds
// are these bytes over the processor time of one thread, warm; for decoding, of the best of 5
// rounds. PSNR is over RGB, or over depth where the colour is not transparent. libjpeg writes every
// tile as a whole file with its own standard tables. The saving of jpeg:75 against it is at equal
// PSNR, interpolated between libjpeg's sizes at several qualities.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/sort_unique.h"
#include "benchmarks/codec_contenders.h"
#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "field/geometry/tile_order.h"
#include "field/tiles/tile_cache.h"
#include "slf/render.h"

namespace {

using namespace slf;
using namespace slf::bench;

struct Row {
  std::string name;
  double ratio = 0, bytes_per_tile = 0, bits_per_slab = 0;
  double psnr = 0;                            // infinity when lossless
  double encode_speed = 0, decode_speed = 0;  // MB/s
};

double cpu_seconds() { return seconds_of(CLOCK_THREAD_CPUTIME_ID); }

constexpr int kRounds = 5;

Row run(const Contender& contender, const std::vector<Sample>& samples) {
  std::vector<Bytes> payloads(samples.size());
  double slabs = 0, bytes = 0;
  double begin = cpu_seconds();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    contender.encode(samples[i], payloads[i]);
    slabs += static_cast<double>(samples[i].color.size() / 4);
    bytes += static_cast<double>(payloads[i].size());
  }
  const double encode_seconds = cpu_seconds() - begin;
  double decode_seconds = 1e9;
  Bytes decoded;
  for (int round = 0; round < kRounds; ++round) {
    begin = cpu_seconds();
    for (std::size_t i = 0; i < samples.size(); ++i)
      contender.decode(samples[i], payloads[i], decoded);
    decode_seconds = std::min(decode_seconds, cpu_seconds() - begin);
  }
  double squared = 0, count = 0;
  for (std::size_t i = 0; i < samples.size() && !contender.lossless; ++i) {
    contender.decode(samples[i], payloads[i], decoded);
    const Bytes& truth = samples[i].color;
    for (std::size_t k = 0; k < truth.size(); ++k) {
      if (k % 4 == 3) continue;
      const double error = std::to_integer<int>(truth[k]) - std::to_integer<int>(decoded[k]);
      squared += error * error;
      ++count;
    }
  }
  const double raw = slabs * 3;
  return {contender.name,
          raw / bytes,
          bytes / static_cast<double>(samples.size()),
          bytes * 8 / slabs,
          squared > 0 ? 10 * std::log10(255 * 255 * count / squared) : INFINITY,
          raw / encode_seconds / 1e6,
          raw / decode_seconds / 1e6};
}

// How much smaller `row` is than the smallest libjpeg tile of the same PSNR. Log sizes are
// interpolated linearly between qualities. NaN if no quality reaches the PSNR.
double saved_against_libjpeg(const std::vector<Row>& rows, const Row& row) {
  double min_bytes = NAN;
  for (std::size_t k = 0; k + 1 < rows.size(); ++k) {
    const Row &a = rows[k], &b = rows[k + 1];
    const bool chroma = a.name.ends_with(":444");
    if (!a.name.starts_with("libjpeg") || !b.name.starts_with("libjpeg")) continue;
    if (chroma != b.name.ends_with(":444") || row.psnr < a.psnr || row.psnr > b.psnr) continue;
    const double u = (row.psnr - a.psnr) / (b.psnr - a.psnr);
    min_bytes =
        std::fmin(min_bytes, a.bytes_per_tile * std::pow(b.bytes_per_tile / a.bytes_per_tile, u));
  }
  return 1 - row.bytes_per_tile / min_bytes;
}

std::vector<TileKey> stored_tiles(const Field& field, unsigned level) {
  std::vector<TileKey> keys;
  expect(field.file().store().visit(first_key(level), first_key(level + 1),
                                    [&](const storage::TileRef& tile) -> Result<void> {
                                      if (tile.state == storage::TileState::stored)
                                        keys.push_back(tile.key);
                                      return {};
                                    }));
  return keys;
}

std::vector<TileKey> touched_tiles(const Field& field, unsigned level, std::uint32_t views) {
  std::vector<TileKey> keys;
  Renderer renderer(field);
  for (const Camera& camera : random_cameras(field.shape().sphere, 3, views, 1, 512, 512)) {
    ViewStatistics statistics;
    expect(renderer.render(camera, {RenderMode::bitri, level, false}, &statistics));
    for (const TileKey& key : statistics.tiles)
      if (expect(field.file().store().find(key)).state == storage::TileState::stored)
        keys.push_back(key);
  }
  sort_unique(keys);
  return keys;
}

std::vector<Sample> read_samples(const Field& field, const std::vector<TileKey>& keys,
                                 std::size_t wanted) {
  TileCache cache(field.file(), 64 << 20);
  std::vector<Sample> samples;
  for (std::size_t i = 0; i < std::min(wanted, keys.size()); ++i) {
    Sample sample{keys[i * keys.size() / std::min(wanted, keys.size())], {}};
    const TileShape shape = field.file().tile_shape(sample.key);
    sample.color.resize(shape.bytes());
    expect(cache.read(sample.key, sample.color));
    sample.color.resize(shape.color_bytes());
    samples.push_back(std::move(sample));
  }
  return samples;
}

void print_table(const std::vector<Row>& rows) {
  std::printf("%-18s %8s %8s %8s %9s %10s %10s\n", "codec", "ratio", "B/tile", "bit/slab",
              "PSNR dB", "enc MB/s", "dec MB/s");
  for (const Row& row : rows)
    std::printf("%-18s %6.2f:1 %8.0f %8.3f %9.2f %10.1f %10.1f\n", row.name.c_str(), row.ratio,
                row.bytes_per_tile, row.bits_per_slab, row.psnr, row.encode_speed,
                row.decode_speed);
}

void print_json(const std::string& path, std::size_t tiles, const std::vector<Row>& rows) {
  nlohmann::json json{{"field", path}, {"tiles", tiles}, {"rows", nlohmann::json::array()}};
  for (const Row& row : rows) {
    nlohmann::json item{{"codec", row.name},
                        {"ratio", row.ratio},
                        {"bytes_per_tile", row.bytes_per_tile},
                        {"bits_per_slab", row.bits_per_slab},
                        {"encode_mb_per_s", row.encode_speed},
                        {"decode_mb_per_s", row.decode_speed}};
    item["psnr_db"] = std::isfinite(row.psnr) ? nlohmann::json(row.psnr) : nlohmann::json();
    json["rows"].push_back(item);
  }
  std::printf("%s\n", json.dump(2).c_str());
}

}  // namespace

int main(int argc, char** argv) {
  std::string path;
  std::size_t tiles = 200;
  int level = -1;
  std::uint32_t views = 0;
  bool as_json = false;
  std::vector<std::string> specs{"raw",     "zstd:1",  "zstd:9",      "zstd:19",
                                 "jpeg:50", "jpeg:75", "jpeg:75:444", "jpeg:90"};
  CLI::App app{"Codecs against their peers, on the tiles of a field"};
  app.add_option("field", path, "A field with lossless colour")->required();
  app.add_option("--tiles", tiles, "How many tiles, taken evenly")->check(CLI::PositiveNumber);
  app.add_option("--level", level, "Their level; default: the finest");
  app.add_option("--views", views, "Only tiles that this many random views touch; 0: all");
  app.add_option("--codec", specs, "Codecs of ours to run");
  app.add_flag("--json", as_json, "JSON instead of a table");
  CLI11_PARSE(app, argc, argv);

  const std::optional<Field> field = expect(Field::open(path));
  if (!field->file().codec().lossless()) stop("the field's colour has lost what is measured here");
  if (is_half(field->format())) stop("the field's colour does not have 8 bits");
  const unsigned at = level < 0 ? field->shape().finest_level : static_cast<unsigned>(level);
  const std::vector<Sample> samples = read_samples(
      *field, views > 0 ? touched_tiles(*field, at, views) : stored_tiles(*field, at), tiles);
  if (samples.empty()) stop("no stored tiles at that level");

  std::vector<Row> rows;
  for (const Contender& peer : {png(*field), plain_zstd(*field, 19), median_zstd(*field, 3),
                                median_zstd(*field, 19), webp(*field, 6)})
    rows.push_back(run(peer, samples));
  for (const bool full_chroma : {false, true})
    for (const int quality : {50, 60, 70, 75, 80, 85, 90, 95})
      rows.push_back(run(libjpeg(*field, quality, full_chroma), samples));
  rows.push_back(run(alpha_of_zstd(*field), samples));
  for (const std::string& spec : specs) rows.push_back(run(ours(*field, spec, samples), samples));
  if (as_json) {
    print_json(path, samples.size(), rows);
    return 0;
  }
  print_table(rows);
  for (const Row& row : rows)
    if (row.name.starts_with("jpeg:"))
      std::printf("%s: %.1f %% smaller than libjpeg at the same PSNR\n", row.name.c_str(),
                  100 * saved_against_libjpeg(rows, row));
  return 0;
}
