// A field's samples as pictures, one for each entry vertex: what other codecs are given.
//
//   entry_pictures FIELD.slf -o FRAMES.rgb
//
// A picture holds what enters at one vertex, by where it leaves: the octahedron of exit vertices
// unfolded into a square of 2 N + 1 pixels an edge, upper half in the middle, without gaps.
// Neighbours among pictures are neighbours among entry vertices, so that they make a smooth film.
// RGB, 8 bits (premultiplied), of the finest level. Prints the number of pictures and their edge as
// JSON.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "benchmarks/storage/expect.h"
#include "field/field_file.h"
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

/// Entry vertices, each once, line by line and back.
std::vector<LatticeVertex> entry_path(std::int32_t n) {
  std::vector<LatticeVertex> path;
  std::unordered_map<std::uint64_t, bool> seen;
  for (std::int32_t y = -n; y <= n; ++y)
    for (std::int32_t k = -n; k <= n; ++k) {
      const LatticeVertex v = unfolded(y % 2 ? -k : k, y, n);
      const auto key = static_cast<std::uint64_t>(v.i + n) << 40 |
                       static_cast<std::uint64_t>(v.j + n) << 20 |
                       static_cast<std::uint64_t>(v.k + n);
      if (seen.emplace(key, true).second) path.push_back(v);
    }
  return path;
}

/// Reads samples tile by tile; keeps what it decoded.
class Reader {
 public:
  explicit Reader(const Field& field)
      : field_(field),
        level_(field.shape().levels),
        geometry_(field.file().geometry(level_)),
        color_(*field.file().layer("color")) {
    if (field.file().manifest().layers[color_].format != codec::SampleFormat::rgba8)
      bench::stop("expected a field with 8-bit colour");
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
    const storage::TileRef ref = expect(field_.file().store().find(color_, key));
    if (ref.state == storage::TileState::missing) bench::stop("the field is incomplete");
    if (ref.state == storage::TileState::stored) {
      found->second.resize(field_.file().tile_shape(color_, key).bytes());
      expect(field_.file().decode(ref, found->second));
    }
    return found->second;
  }

  const Field& field_;
  unsigned level_;
  const LevelGeometry& geometry_;
  storage::LayerId color_;
  std::unordered_map<std::uint64_t, Bytes> tiles_;
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"A field's samples as pictures, one for each entry vertex"};
  std::string path, output;
  app.add_option("field", path)->required();
  app.add_option("-o,--output", output, "Raw RGB, picture after picture")->required();
  CLI11_PARSE(app, argc, argv);

  const auto field = expect(Field::open(path));
  Reader reader(field);
  const auto& geometry = field.file().geometry(field.shape().levels);
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
