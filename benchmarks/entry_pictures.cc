// Converts a field's samples to pictures for other codecs, one for each entry vertex, and back.
//
//   entry_pictures FIELD.slf -o FRAMES.rgb
//   entry_pictures FIELD.slf --colors FRAMES.rgb -o OTHER.slf
//
// The second form writes a copy of the field with the colours of such pictures, so that views can
// be rendered from the output of another codec. Opacity and depth do not change.
//
// A picture has the rays from one entry vertex, arranged by exit vertex: the octahedron of exit
// vertices is unfolded into a square of 2 N + 1 pixels along an edge, upper half in the middle,
// without gaps. Successive pictures belong to neighbouring entry vertices, as in a smooth film.
// RGB, 8 bits (premultiplied), of the finest level. Prints the number of pictures and their edge as
// JSON.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "benchmarks/storage/expect.h"
#include "field/geometry/tile_order.h"
#include "field/tiles/tile_cache.h"
#include "field/write/field_writer.h"
#include "slf/field.h"

namespace {

using namespace slf;
using bench::expect;

/// The vertex at a pixel of the unfolded octahedron; x and y from -n to n.
LatticeVertex unfolded(std::int32_t x, std::int32_t y, std::int32_t n) {
  const std::int32_t ax = std::abs(x), ay = std::abs(y);
  if (ax + ay <= n) return {x, y, n - ax - ay};
  const std::int32_t i = n - ay, j = n - ax;
  return {x < 0 ? -i : i, y < 0 ? -j : j, i + j - n};
}

/// The index of a vertex's pixel in the square of 2 n + 1 pixels per edge. Inverts unfolded(); if
/// two pixels on the edge of the square have this vertex, returns one of them.
std::size_t folded(const LatticeVertex& v, std::int32_t n) {
  std::int32_t x = v.i, y = v.j;
  if (v.k < 0) {
    x = v.i < 0 ? std::abs(v.j) - n : n - std::abs(v.j);
    y = v.j < 0 ? std::abs(v.i) - n : n - std::abs(v.i);
  }
  return static_cast<std::size_t>(y + n) * static_cast<std::size_t>(2 * n + 1) +
         static_cast<std::size_t>(x + n);
}

/// A vertex as a number.
std::uint64_t packed(const LatticeVertex& v, std::int32_t n) {
  return static_cast<std::uint64_t>(v.i + n) << 40 | static_cast<std::uint64_t>(v.j + n) << 20 |
         static_cast<std::uint64_t>(v.k + n);
}

/// All entry vertices, each once, along lines of alternating direction.
std::vector<LatticeVertex> entry_path(std::int32_t n) {
  std::vector<LatticeVertex> path;
  std::unordered_map<std::uint64_t, bool> seen;
  for (std::int32_t y = -n; y <= n; ++y)
    for (std::int32_t k = -n; k <= n; ++k) {
      const LatticeVertex v = unfolded(y % 2 ? -k : k, y, n);
      if (seen.emplace(packed(v, n), true).second) path.push_back(v);
    }
  return path;
}

/// Reads samples, and keeps all tiles that it has decoded.
class Reader {
 public:
  explicit Reader(const Field& field)
      : field_(field),
        level_(field.shape().finest_level),
        geometry_(field.file().geometry(level_)) {
    if (is_half(field.format())) bench::stop("expected a field with 8-bit colour");
  }

  void read(const LatticeVertex& entry, const LatticeVertex& exit, std::uint8_t* rgb) {
    const Section section = owner_of(exit, level_);
    const EntryRow row = geometry_.entry_row(octant_of(entry), to_octant_point(entry));
    const Bytes& samples = tile(tile_key({geometry_.entry_section(row.section), section}));
    if (samples.empty()) {
      rgb[0] = rgb[1] = rgb[2] = 0;
      return;
    }
    const std::uint32_t side = geometry_.exit_side();
    const LocalPoint local = to_local(to_octant_point(exit), section, side);
    const std::size_t at = std::size_t{row.row} * triangle_size(side) +
                           triangle_index(side, static_cast<std::uint32_t>(local.p),
                                          static_cast<std::uint32_t>(local.q));
    for (std::size_t c = 0; c < 3; ++c) rgb[c] = std::to_integer<std::uint8_t>(samples[4 * at + c]);
  }

 private:
  const Bytes& tile(TileKey key) {
    const auto [found, is_new] = tiles_.try_emplace(key.index);
    if (!is_new) return found->second;
    const storage::TileRef ref = expect(field_.file().store().find(key));
    if (ref.state == storage::TileState::missing) bench::stop("the field is incomplete");
    if (ref.state == storage::TileState::stored) {
      found->second.resize(field_.file().tile_shape(key).bytes());
      expect(cache_.read(ref.key, found->second));
    }
    return found->second;
  }

  const Field& field_;
  TileCache cache_{field_.file(), 64 << 20};
  unsigned level_;
  const LevelGeometry& geometry_;
  std::unordered_map<std::uint64_t, Bytes> tiles_;
};

/// The colours of pictures, by vertex.
class Pictures {
 public:
  Pictures(const std::string& path, const LevelGeometry& geometry)
      : entry_resolution_(geometry.entry_resolution()),
        exit_resolution_(geometry.exit_resolution()),
        edge_(static_cast<std::size_t>(2 * geometry.exit_resolution() + 1)) {
    const auto entries = entry_path(entry_resolution_);
    for (std::size_t k = 0; k < entries.size(); ++k)
      number_[packed(entries[k], entry_resolution_)] = k;
    rgb_.resize(entries.size() * edge_ * edge_ * 3);
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char*>(rgb_.data()), static_cast<std::streamsize>(rgb_.size()));
    bench::require(file.good() && file.peek() == EOF,
                   path + ": expected " + std::to_string(rgb_.size()) + " bytes");
  }

  [[nodiscard]] const std::uint8_t* at(const LatticeVertex& entry,
                                       const LatticeVertex& exit) const {
    const std::size_t picture = number_.at(packed(entry, entry_resolution_));
    return &rgb_[(picture * edge_ * edge_ + folded(exit, exit_resolution_)) * 3];
  }

 private:
  std::int32_t entry_resolution_, exit_resolution_;
  std::size_t edge_;
  std::unordered_map<std::uint64_t, std::size_t> number_;
  std::vector<std::uint8_t> rgb_;
};

/// Replaces the colours in the samples of a tile of the finest level by those of pictures.
void recolor(const FieldFile& field, TileKey key, const Pictures& pictures, Bytes& samples) {
  const FieldShape& shape = field.shape();
  const LevelGeometry& geometry = field.geometry(key.level);
  const TileSections sections = sections_of(key, shape.entry_extra_levels);
  const std::uint32_t entry_side = shape.entry_section_side(), exit_side = geometry.exit_side();
  std::byte* to = samples.data();
  for (const LocalPoint& row : geometry.rows(sections.entry.index)) {
    const LatticeVertex entry = vertex_at(sections.entry, row, entry_side);
    for (const LocalPoint& column : triangle_points(exit_side)) {
      const std::uint8_t* const rgb =
          pictures.at(entry, vertex_at(sections.exit, column, exit_side));
      const auto alpha = std::to_integer<std::uint8_t>(to[3]);
      for (std::size_t c = 0; c < 3; ++c) to[c] = std::byte{std::min(rgb[c], alpha)};
      to += 4;
    }
  }
}

/// Writes the field again, with the colours of pictures at the finest level.
void write_recolored(const Field& field, const std::string& pictures_path,
                     const std::string& path) {
  const FieldFile& file = field.file();
  const unsigned finest = file.shape().finest_level;
  const Pictures pictures(pictures_path, file.geometry(finest));
  auto writer = expect(FieldWriter::create(expect(FieldOutput::at(path, Existing::replace, {})),
                                           FieldWriter::Draft::discard, file.manifest(),
                                           file.codec().tables()));
  const TileOrder order(file.shape());
  TileCache cache(file, 64 << 20);
  Bytes samples, payload;
  for (std::uint64_t n = 0; n < order.count(); ++n) {
    const storage::TileRef ref = expect(file.store().find(order.key(n)));
    payload.assign(ref.payload.begin(), ref.payload.end());
    if (ref.state == storage::TileState::stored && order.key(n).level == finest) {
      const TileShape tile = file.tile_shape(order.key(n));
      samples.resize(tile.bytes());
      expect(cache.read(ref.key, samples));
      recolor(file, order.key(n), pictures, samples);
      expect(file.codec().encode(tile, samples, nullptr, payload));
    }
    expect(writer.put(order.key(n), payload));
  }
  expect(writer.finish());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"A field's samples as pictures, one for each entry vertex"};
  std::string path, colors, output;
  app.add_option("field", path)->required();
  app.add_option("--colors", colors, "Pictures whose colours the field gets");
  app.add_option("-o,--output", output, "Raw RGB, picture after picture; or a field")->required();
  CLI11_PARSE(app, argc, argv);

  const auto field = expect(Field::open(path));
  if (!colors.empty()) {
    write_recolored(field, colors, output);
    return 0;
  }
  Reader reader(field);
  const auto& geometry = field.file().geometry(field.shape().finest_level);
  const std::int32_t n = geometry.exit_resolution();
  const auto edge = static_cast<std::size_t>(2 * n + 1);
  const auto entries = entry_path(geometry.entry_resolution());
  std::ofstream file(output, std::ios::binary);
  std::vector<std::uint8_t> picture(3 * edge * edge);
  for (const LatticeVertex& entry : entries) {
    std::uint8_t* to = picture.data();
    for (std::int32_t y = -n; y <= n; ++y)
      for (std::int32_t x = -n; x <= n; ++x, to += 3) reader.read(entry, unfolded(x, y, n), to);
    file.write(reinterpret_cast<const char*>(picture.data()),
               static_cast<std::streamsize>(picture.size()));
  }
  file.close();
  bench::require(file.good(), output + ": cannot write");
  std::printf("%s\n", nlohmann::json{{"pictures", entries.size()}, {"edge", edge}}.dump().c_str());
  return 0;
}
