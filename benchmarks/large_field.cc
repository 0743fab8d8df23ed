// Writes a field of any number of tiles quickly, whole or in parts, without tracing a ray: for
// benchmarks of what lists and copies tiles. Its payloads are random bytes, which do not decode,
// but with --raw they are the samples themselves, and the field can be drawn.
//
//   large_field big.slf --levels 4 --subfields 15 --payload 4096
//   large_field 'big-{K}.slf' --levels 4 --subfields 15 --payload 4096 --parts 8
//   large_field big.slf --raw --entry 8 --exit 24 --levels 3
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>

#include "field/geometry/level_geometry.h"
#include "field/geometry/tile_order.h"
#include "field/write/field_writer.h"

namespace {

using namespace slf;

struct Settings {
  std::string output;
  unsigned levels = 4, subfields = 15;
  std::uint32_t entry = 1, exit = 4;
  std::size_t payload = 4096;
  bool raw = false;
  std::uint64_t parts = 1;
};

/// Unless raw, the codec does not matter, because whatever copies or lists tiles does not decode
/// them.
Manifest manifest_of(const Settings& settings) {
  Manifest manifest;
  FieldShape& shape = manifest.shape;
  shape.sphere.radius = 1;
  shape.finest_level = settings.levels;
  shape.entry_side = settings.entry, shape.exit_side = settings.exit;
  for (std::uint8_t k = 0; settings.subfields < 64 && k < settings.subfields; ++k)
    shape.subfields.push_back(k);
  manifest.filtered_levels = settings.levels;
  manifest.codec = settings.raw ? "raw" : "zstd:1";
  manifest.provenance = {{"kind", "random"}};
  return manifest;
}

/// Fills `payload` with random bytes that depend on the tile's number only.
void fill(std::uint64_t number, std::span<std::byte> payload) {
  std::uint64_t state = number * 0x9E3779B97F4A7C15u + 1;
  for (std::size_t k = 0; k + 8 <= payload.size(); k += 8) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    store_le(&payload[k], state);
  }
}

Result<void> write(const Settings& settings, const TileOrder& order, std::uint64_t part) {
  Manifest manifest = manifest_of(settings);
  const std::uint64_t begin = order.count() * part / settings.parts;
  const std::uint64_t end = order.count() * (part + 1) / settings.parts;
  if (settings.parts > 1) manifest.part = {order.key(begin), order.key_or_end(end)};
  std::string path = settings.output;
  if (const std::size_t at = path.find("{K}"); at != std::string::npos)
    path.replace(at, 3, std::to_string(part + 1));
  const auto output = FieldOutput::at(path, Existing::replace, {});
  if (!output) return tl::unexpected(output.error());
  auto writer = FieldWriter::create(*output, FieldWriter::Draft::discard, manifest, {});
  if (!writer) return tl::unexpected(writer.error());
  std::vector<LevelGeometry> levels;
  for (unsigned level = 0; level <= settings.levels; ++level)
    levels.emplace_back(manifest.shape, level);
  Bytes payload(settings.payload);
  for (std::uint64_t n = begin; n < end; ++n) {
    if (settings.raw) {
      const TileKey key = order.key(n);
      const std::uint32_t section = sections_of(key, 0).entry.index;
      payload.resize(levels[key.level].tile(section, SampleFormat::rgba8).bytes());
    }
    fill(n, payload);
    if (auto ok = writer->put(order.key(n), payload); !ok) return ok;
  }
  return writer->finish();
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  CLI::App app("Writes a field of random bytes");
  app.add_option("OUTPUT", settings.output, "{K} in it stands for the number of the part")
      ->required();
  app.add_option("--levels", settings.levels)->capture_default_str();
  app.add_option("--subfields", settings.subfields, "How many of 64")->capture_default_str();
  app.add_option("--entry", settings.entry, "Cells at level 0")->capture_default_str();
  app.add_option("--exit", settings.exit, "Cells at level 0")->capture_default_str();
  app.add_option("--payload", settings.payload, "Bytes of a tile")->capture_default_str();
  app.add_flag("--raw", settings.raw, "Samples that can be drawn, whatever --payload says");
  app.add_option("--parts", settings.parts)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const TileOrder order(manifest_of(settings).shape);
  for (std::uint64_t part = 0; part < settings.parts; ++part)
    if (const auto done = write(settings, order, part); !done) {
      std::cerr << done.error().message << "\n";
      return 1;
    }
  std::printf("%llu tiles\n", static_cast<unsigned long long>(order.count()));
}
