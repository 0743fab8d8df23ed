#include <algorithm>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/page_cache.h"
#include "benchmarks/storage/scenarios.h"
#include "benchmarks/storage/store_peer.h"
#include "field/field_file.h"
#include "slf/field.h"
#include "storage/tile_writer.h"

namespace slf::bench {
namespace {

constexpr std::size_t kCounts[] = {1000, 32'000, 1'000'000};
constexpr std::size_t kPayload = 256;
constexpr int kOpens = 101;
constexpr std::uint64_t kCommitBytes = 32ull << 20;

template <class Open>
std::vector<double> milliseconds(int opens, const Open& open) {
  std::vector<double> times;
  for (int i = 0; i < opens; ++i) {
    const double begin = now();
    open();
    times.push_back((now() - begin) * 1e3);
  }
  return times;
}

// Writes a field with a manifest and the tiles of `set`. Opening it reads no tile.
void write_field(const TileSet& set, const std::string& path) {
  Manifest manifest;
  manifest.shape.sphere.radius = 1;
  manifest.shape.finest_level = 4;
  manifest.codec = "jpeg:75";
  manifest.provenance = {{"scene", "none"}};
  const auto codec = expect(codec::make_codec("jpeg:75", codec::SampleFormat::rgba8));
  const std::string text = manifest.to_json()->dump();
  const ByteSpan bytes = as_bytes(std::span<const char>(text));
  const std::vector<std::pair<std::string, Bytes>> blobs{
      {kManifestBlob, {bytes.begin(), bytes.end()}},
      {kTablesBlob, {codec->tables().begin(), codec->tables().end()}}};
  auto writer = expect(storage::TileWriter::create(path, blobs));
  for (std::size_t i = 0; i < set.size(); ++i) {
    expect(writer.append({4, set.keys[i]}, set.payloads[i]));
    if (writer.pending_bytes() >= kCommitBytes) expect(writer.commit());
  }
  expect(writer.close());
}

}  // namespace

void measure_opens(const Settings& settings, Report& report) {
  std::vector<Row> rows;
  std::vector<double> store_p50, field_p50;
  const std::string path = settings.folder + "/opened";
  const auto add = [&](const std::string& what, std::size_t tiles, std::vector<double> times) {
    rows.push_back({{"open", what},
                    {"tiles", tiles},
                    {"p50 ms", percentile(times, 0.5)},
                    {"p99 ms", percentile(times, 0.99)}});
    return percentile(times, 0.5);
  };
  for (const std::size_t count : kCounts) {
    const TileSet set = opaque_tiles(kPayload, count);
    remove_files(path);
    write_field(set, path);
    (void)drop_from_cache(path);  // else dirty pages would be written during measurements
    store_p50.push_back(add("slf TileStore", count, milliseconds(kOpens, [&] {
                              (void)expect(storage::TileStore::open(path));
                            })));
    field_p50.push_back(
        add("slf Field", count, milliseconds(kOpens, [&] { (void)expect(Field::open(path)); })));
    for (const auto& peer : store_peers()) {
      if (!peer->can_store(set) || peer->is_bound() || peer->name() == "slf") continue;
      remove_files(path);
      peer->write(set, path);
      (void)drop_from_cache(path);
      add(peer->name(), count, milliseconds(kOpens / 5, [&] { (void)peer->open(set, path); }));
    }
  }
  remove_files(path);
  report.table("opening, hot, payloads of 256 B", rows);
  report.target("TileStore::open, 1 M tiles / 1 k tiles", store_p50.back() / store_p50.front(), 1.5,
                false);
  report.target("Field::open, 1 M tiles / 1 k tiles", field_p50.back() / field_p50.front(), 1.5,
                false);
  report.target("Field::open, 1 M tiles, ms", field_p50.back(), 5, false);
}

}  // namespace slf::bench
