// The project's C++ code in the page. It reads a container from ranges of bytes, and decodes tiles.
// page/web/module.js calls it. The page's thread has one instance of the module, which reads; each
// worker has another, which decodes.
//
// Numbers that need more than 32 bits are doubles. A call that fails stores a message, for
// slf_text(). A call that needs more bytes stores their ranges, for slf_ranges(). JavaScript writes
// bytes for the module to the memory that slf_buffer() returns. In tiles that go in and out, the
// bits of a level from 8 on are the state of the object that the tile shows.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "base/try.h"
#include "base/wildcard.h"
#include "codec/codec.h"
#include "field/geometry/level_geometry.h"
#include "field/manifest.h"
#include "field/reference_index.h"
#include "field/tile_coder.h"
#include "field/tiles/compose_samples.h"
#include "page/wasm/exchange.h"
#include "storage/ranged_store.h"

namespace {

using namespace slf;

struct FoundTile {
  double state;  ///< 0 missing, 1 empty, 2 stored, 3 needs more bytes, 4 damaged
  double begin, end;
  std::uint64_t checksum;
  /// The tile that has the payload, of an earlier state if this one is the same as that: level,
  /// entry section, exit section; and 0.
  std::array<std::uint32_t, 4> source;
};

struct Module {
  std::string& text = exchange().text;
  Bytes& buffer = exchange().buffer;
  std::string name;  // of the file
  std::unique_ptr<storage::RangedStore> store;
  std::vector<double> ranges;  // begin, end, begin, end, …
  std::vector<FoundTile> found;
  std::vector<ReferenceIndex> reference_indexes;  // [level - 1], of the levels that have one
  std::vector<std::uint32_t> tiles;               // as triple_of() has them
  std::optional<Manifest> manifest;
  std::vector<std::unique_ptr<LevelGeometry>> geometry;  // by level, made when needed
  std::unique_ptr<codec::Codec> codec;
  std::unique_ptr<TileCoder> coder;     // with the codec
  std::map<TileKey, Bytes> references;  // for the next tile to decode
  // For the next tile to compose: what each structure that is shown has of it.
  std::vector<std::pair<Bytes, glm::vec4>> layers;
  Bytes samples;
};

Module& module() {
  static Module instance;
  return instance;
}

/// The status for an error of the store: kNeedsBytes if it only needs more bytes.
int needs_bytes_or_failed(const Error& error) {
  Module& m = module();
  m.ranges.clear();
  for (const storage::FileRange& range : m.store->take_needed_ranges()) {
    m.ranges.push_back(static_cast<double>(range.begin));
    m.ranges.push_back(static_cast<double>(range.end));
  }
  return m.ranges.empty() ? failed(error) : kNeedsBytes;
}

const LevelGeometry& geometry(unsigned level) {
  Module& m = module();
  level &= 255;
  if (m.geometry.size() <= level) m.geometry.resize(level + 1);
  if (!m.geometry[level])
    m.geometry[level] = std::make_unique<LevelGeometry>(m.manifest->shape, level);
  return *m.geometry[level];
}

TileKey key_of(unsigned level, std::uint32_t entry, std::uint32_t exit) {
  const auto plain = static_cast<std::uint8_t>(level);
  const auto deeper =
      static_cast<std::uint8_t>(plain + module().manifest->shape.entry_extra_levels);
  return in_state(tile_key({{deeper, entry}, {plain, exit}}), level >> 8);
}

/// A tile as JavaScript has it: its level with its state, and its entry and exit sections.
std::array<std::uint32_t, 3> triple_of(TileKey key) {
  const TileSections of = sections_of(key, module().manifest->shape.entry_extra_levels);
  return {key.level | static_cast<std::uint32_t>(key.state) << 8, of.entry.index, of.exit.index};
}

/// The tiles that the buffer holds: (level, entry section, exit section), u32 each.
std::vector<TileKey> keys_in_buffer() {
  const Bytes& buffer = module().buffer;
  std::vector<TileKey> keys;
  for (std::size_t at = 0; at + 12 <= buffer.size(); at += 12) {
    const auto word = [&](std::size_t i) {
      return load_le<std::uint32_t>(buffer.data() + at + 4 * i);
    };
    keys.push_back(key_of(word(0), word(1), word(2)));
  }
  return keys;
}

/// Lists tiles in the same form, those that the field's shape has.
const std::uint32_t* list(std::span<const TileKey> keys) {
  Module& m = module();
  m.tiles.assign(3, 0);  // never null
  m.tiles.clear();
  for (const TileKey key : keys) {
    if (!m.manifest->shape.has(key)) continue;
    const auto triple = triple_of(key);
    m.tiles.insert(m.tiles.end(), triple.begin(), triple.end());
  }
  return m.tiles.data();
}

/// Adds the tiles of level 0 that a ray needs, wherever on its chord it meets something.
void add_first_tiles(const glm::dvec3& eye, const glm::dvec3& along, std::set<TileKey>& tiles) {
  const Chord chord = intersect(Sphere{}, eye, along);
  if (!chord.hit || chord.leave <= 0) return;
  const LevelGeometry& level = geometry(0);
  const auto at = [&](double t) {
    return eye + (chord.enter + t * (chord.leave - chord.enter)) * along;
  };
  const Cell entry = locate(at(0), level.entry_resolution());
  const auto add = [&](std::uint32_t section, const glm::dvec3& exit) {
    tiles.insert(
        key_of(0, section, level.exit_cell(locate(exit, level.exit_resolution())).section));
  };
  for (std::size_t k = 0; k < 3; ++k) {
    const OctantPoint corner = entry.corners()[k];
    const std::uint32_t section = level.entry_row(entry.octant, corner).section;
    const glm::dvec3 from = direction(to_vertex(entry.octant, corner, level.entry_resolution()));
    add(section, at(1));
    for (const double t : {0.1, 0.3, 0.5, 0.7, 0.9}) {
      const glm::dvec3 v = at(t) - from;
      add(section, from - 2 * dot(from, v) / dot(v, v) * v);
    }
  }
}

Result<void> parse_manifest(ByteSpan bytes, const std::string& name) {
  auto manifest = SLF_TRY(Manifest::parse(chars_of(bytes), name));
  module().manifest = std::move(manifest);
  return {};
}

}  // namespace

// ---- reading ------------------------------------------------------------------------------------

/// Begins to read a file of `file_bytes` bytes; the buffer holds its name.
SLF_EXPORT(slf_begin) void slf_begin(double file_bytes) {
  Module& m = module();
  m.name = chars_of(m.buffer);
  m.store = std::make_unique<storage::RangedStore>(m.name, static_cast<std::uint64_t>(file_bytes));
}

/// Adds the content of the buffer, which are the file's bytes at `offset`.
SLF_EXPORT(slf_add) void slf_add(double offset) {
  Module& m = module();
  m.store->add(static_cast<std::uint64_t>(offset), std::move(m.buffer));
  m.buffer = {};
}

/// Opens the field. When that is done, the text is the manifest.
SLF_EXPORT(slf_open) int slf_open() {
  Module& m = module();
  if (auto open = m.store->open(); !open) return needs_bytes_or_failed(open.error());
  const auto blob = m.store->blob("field");
  if (!blob) return needs_bytes_or_failed(blob.error());
  if (auto taken = parse_manifest(*blob, m.name); !taken) return failed(taken.error());
  m.text = chars_of(*blob);
  return kDone;
}

/// Reads the shared tables of the codec. When that is done, the text holds them.
SLF_EXPORT(slf_tables) int slf_tables() {
  Module& m = module();
  const auto blob = m.store->blob("tables");
  if (!blob) return needs_bytes_or_failed(blob.error());
  m.text = chars_of(*blob);
  return kDone;
}

/// Reads the reveal. When that is done, the text is its code, which is empty if there is none.
SLF_EXPORT(slf_reveal) int slf_reveal() {
  Module& m = module();
  const auto blob = m.store->blob("reveal");
  if (!blob && needs_bytes_or_failed(blob.error()) == kNeedsBytes) return kNeedsBytes;
  m.text = blob ? chars_of(*blob) : "";
  return kDone;
}
/// The text is then the provenance of a state.
SLF_EXPORT(slf_provenance) void slf_provenance(unsigned state) {
  module().text = module().manifest->provenance_of(state)->dump();
}

SLF_EXPORT(slf_ranges) const double* slf_ranges() { return module().ranges.data(); }
SLF_EXPORT(slf_range_count) std::size_t slf_range_count() { return module().ranges.size() / 2; }

/// Finds tiles. The buffer holds (level, entry section, exit section), u32 each. Returns
/// one FoundTile per tile, and stores the ranges of the bytes that any of them still need.
SLF_EXPORT(slf_find) const FoundTile* slf_find() {
  Module& m = module();
  m.found.clear();
  std::string damage;
  for (const TileKey key : keys_in_buffer()) {
    const auto tile = m.store->find(key);
    if (!tile) {
      m.found.push_back({tile.error().code == ErrorCode::io ? 3.0 : 4.0, 0, 0, 0, {}});
      if (tile.error().code != ErrorCode::io) damage = tile.error().message;
      continue;
    }
    const auto [level, entry, exit] = triple_of(tile->source);
    m.found.push_back({static_cast<double>(tile->state),
                       static_cast<double>(tile->payload.begin),
                       static_cast<double>(tile->payload.end),
                       tile->checksum,
                       {level, entry, exit, 0}});
  }
  (void)needs_bytes_or_failed({ErrorCode::bad_file, damage});
  return m.found.data();
}

/// Reads the tables and indexes that finding tiles needs, up to a level.
SLF_EXPORT(slf_prepare) int slf_prepare(std::uint32_t levels) {
  Module& m = module();
  std::vector<ReferenceIndex> references;
  std::optional<Error> error;
  for (std::uint32_t level = 1; level <= levels; ++level) {
    if (auto found = m.store->find(key_of(level, 0, 0)); !found) error = found.error();
    auto section = m.store->section(reference_section(level));
    if (!section) error = section.error();
    if (error || section->empty() || references.size() + 1 != level) continue;
    if (auto index = ReferenceIndex::parse(*section, level))
      references.push_back(std::move(*index));
  }
  if (error) return needs_bytes_or_failed(*error);
  if (m.reference_indexes.size() < references.size()) m.reference_indexes = std::move(references);
  return kDone;
}

/// Returns the tiles in the buffer, and all tiles that they are predicted from, directly
/// or indirectly, as far as slf_prepare() has read an index: slf_tile_count() tiles. The buffer and
/// the result hold (level, entry section, exit section), u32 each.
SLF_EXPORT(slf_with_ancestors) const std::uint32_t* slf_with_ancestors() {
  std::vector<TileKey> keys = keys_in_buffer();
  append_ancestors(module().reference_indexes, keys);
  return list(keys);
}
SLF_EXPORT(slf_tile_count) std::size_t slf_tile_count() { return module().tiles.size() / 3; }

/// Returns a byte for each state of the object: whether its name fits the pattern in the buffer.
SLF_EXPORT(slf_fitting) const std::byte* slf_fitting() {
  Module& m = module();
  const std::string pattern(chars_of(m.buffer));
  m.buffer.clear();
  for (const auto& state : m.manifest->states)
    m.buffer.push_back(std::byte{fits_pattern(pattern, state.name)});
  return m.buffer.data();
}

// ---- geometry, for the GPU ----------------------------------------------------------------------

/// LevelGeometry's tables of a level, as u32.
SLF_EXPORT(slf_entry_rows) const std::uint32_t* slf_entry_rows(unsigned level) {
  return geometry(level).entry_rows().data();
}
SLF_EXPORT(slf_entry_row_count) std::size_t slf_entry_row_count(unsigned level) {
  return geometry(level).entry_rows().size();
}
SLF_EXPORT(slf_row_bits) unsigned slf_row_bits(unsigned level) {
  return geometry(level).row_bits();
}
SLF_EXPORT(slf_exit_paths) const std::uint32_t* slf_exit_paths(unsigned level) {
  return geometry(level).exit_paths().data();
}
SLF_EXPORT(slf_exit_path_count) std::size_t slf_exit_path_count(unsigned level) {
  return geometry(level).exit_paths().size();
}

SLF_EXPORT(slf_matching_level) unsigned slf_matching_level(double spacing, int aims) {
  return matching_level(module().manifest->shape, spacing, aims != 0);
}

/// Lists the tiles of level 0 that a view needs first, as slf_with_ancestors() does: those of
/// `across` × `across` rays. The buffer holds four vectors of three f64, in radii from the sphere's
/// centre: the eye, the direction of the picture's centre, and what leads from there to its right
/// and to its lower edge.
SLF_EXPORT(slf_first_tiles) const std::uint32_t* slf_first_tiles(std::uint32_t across) {
  std::array<glm::dvec3, 4> view;
  std::memcpy(view.data(), module().buffer.data(), sizeof view);
  const auto& [eye, forward, right, down] = view;
  const auto place = [&](std::uint32_t at) { return (2.0 * at + 1) / across - 1; };
  std::set<TileKey> tiles;
  for (std::uint32_t y = 0; y < across; ++y)
    for (std::uint32_t x = 0; x < across; ++x)
      add_first_tiles(eye, forward + place(x) * right + place(y) * down, tiles);
  return list(std::vector(tiles.begin(), tiles.end()));
}

/// The sample of a level that is nearest to a ray: its entry section, exit section, row and column.
/// The buffer holds two vectors of three f64, in radii from the sphere's centre: the eye, and where
/// the ray meets the surface.
SLF_EXPORT(slf_sample) const std::uint32_t* slf_sample(std::uint32_t level) {
  std::array<glm::dvec3, 2> given;
  std::memcpy(given.data(), module().buffer.data(), sizeof given);
  const auto& [eye, point] = given;
  const LevelGeometry& at = geometry(level);
  const auto nearest = [](const Cell& cell) {
    return std::max_element(cell.weights.begin(), cell.weights.end()) - cell.weights.begin();
  };
  const Chord chord = intersect(Sphere{}, eye, point - eye);
  const Cell entry = locate(eye + chord.enter * (point - eye), at.entry_resolution());
  const OctantPoint corner = entry.corners()[nearest(entry)];
  const EntryRow row = at.entry_row(entry.octant, corner);
  const glm::dvec3 from = direction(to_vertex(entry.octant, corner, at.entry_resolution()));
  const glm::dvec3 v = point - from;
  const Cell exit = locate(from - 2 * dot(from, v) / dot(v, v) * v, at.exit_resolution());
  const auto cell = at.exit_cell(exit);
  static std::array<std::uint32_t, 4> found;
  found = {row.section, cell.section, row.row, cell.columns[nearest(exit)]};
  return found.data();
}

// ---- decoding -----------------------------------------------------------------------------------

/// Parses the manifest in the buffer. A module that only decodes calls this instead of slf_open().
SLF_EXPORT(slf_manifest) int slf_manifest() {
  const auto taken = parse_manifest(module().buffer, "field");
  return taken ? kDone : failed(taken.error());
}

/// Makes the codec, with the tables in the buffer.
SLF_EXPORT(slf_codec) int slf_codec() {
  Module& m = module();
  auto made = codec::make_codec(m.manifest->codec, m.manifest->format, m.buffer);
  if (!made) return failed(made.error());
  m.codec = std::move(*made);
  m.coder = std::make_unique<TileCoder>(m.manifest->shape, m.manifest->format, *m.codec, geometry,
                                        !m.manifest->states.empty(), m.manifest->keeps_rays);
  return kDone;
}

/// Verifies the payload in the buffer.
SLF_EXPORT(slf_check)
int slf_check(std::uint32_t level, std::uint32_t entry, std::uint32_t exit,
              std::uint32_t checksum_low, std::uint32_t checksum_high) {
  const std::uint64_t checksum = std::uint64_t{checksum_high} << 32 | checksum_low;
  const TileKey key = key_of(level, entry, exit);
  if (storage::payload_checksum(key, module().buffer) == checksum) return kDone;
  return failed({ErrorCode::bad_file, "the payload does not match its checksum"});
}

/// Lists the tiles that the payload in the buffer is predicted from, as slf_with_ancestors() does.
/// REQUIRES: slf_check() has verified the payload.
SLF_EXPORT(slf_references)
const std::uint32_t* slf_references(std::uint32_t level, std::uint32_t entry, std::uint32_t exit) {
  return list(module().coder->references(key_of(level, entry, exit), module().buffer));
}

/// Adds a tile that the next tile to decode is predicted from. The buffer holds its samples, or no
/// bytes if nothing is visible in it.
SLF_EXPORT(slf_add_reference)
int slf_add_reference(std::uint32_t level, std::uint32_t entry, std::uint32_t exit) {
  Module& m = module();
  const TileShape shape = geometry(level).tile(entry, m.manifest->format);
  if (!m.buffer.empty() && m.buffer.size() != shape.bytes())
    return failed({ErrorCode::usage, "a reference has another size"});
  m.references[key_of(level, entry, exit)] = std::move(m.buffer);
  m.buffer = {};
  return kDone;
}

/// Decodes the payload in the buffer, which slf_check() has verified. Drops the references.
SLF_EXPORT(slf_decode)
int slf_decode(std::uint32_t level, std::uint32_t entry, std::uint32_t exit) {
  Module& m = module();
  const TileKey key = key_of(level, entry, exit);
  m.samples.resize(m.coder->tile_shape(key).bytes());
  const auto references = std::exchange(m.references, {});
  std::vector<ReferenceSamples> from;
  for (const auto& [of, samples] : references) from.push_back({of, samples});
  const auto decoded = m.coder->decode(key, m.buffer, from, m.samples);
  return decoded ? kDone : failed(decoded.error());
}

/// Adds a structure to the next tile to compose, in front of those that follow at one depth. The
/// buffer holds the samples of its tile. Its opacity and sRGB tint are from 0 to 1; `linear`: its
/// colours are radiance.
SLF_EXPORT(slf_add_layer)
void slf_add_layer(float opacity, float red, float green, float blue, int linear) {
  Module& m = module();
  m.layers.emplace_back(std::move(m.buffer),
                        layer_factor(opacity, {red, green, blue}, linear != 0));
  m.buffer = {};
}

/// Composes the layers, at least one and all of one size, and drops them.
SLF_EXPORT(slf_compose) void slf_compose() {
  Module& m = module();
  const auto added = std::exchange(m.layers, {});
  std::vector<TileLayer> layers;
  for (const auto& [samples, factor] : added) layers.push_back({samples, factor});
  m.samples.resize(added.front().first.size());
  compose_samples(layers, m.manifest->format, m.samples);
}
SLF_EXPORT(slf_samples) const std::byte* slf_samples() { return module().samples.data(); }
SLF_EXPORT(slf_sample_bytes) std::size_t slf_sample_bytes() { return module().samples.size(); }
