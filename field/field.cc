#include "field/field_file.h"

namespace slf {

Result<std::shared_ptr<const FieldFile>> FieldFile::open(const std::string& path) {
  auto store = storage::TileStore::open(path);
  if (!store) return tl::unexpected(store.error());
  const auto text = store->blob(kManifestBlob);
  if (!text) return tl::unexpected(text.error());
  auto manifest =
      Manifest::parse({reinterpret_cast<const char*>(text->data()), text->size()}, path);
  if (!manifest) return tl::unexpected(manifest.error());
  if (manifest->layers.size() != store->layers().size())
    return fail(ErrorCode::bad_file, path, ": the manifest names ", manifest->layers.size(),
                " layers, the container holds ", store->layers().size());

  std::shared_ptr<FieldFile> field(new FieldFile(std::move(*store), std::move(*manifest)));
  for (std::size_t k = 0; k < field->manifest_.layers.size(); ++k) {
    const Layer& layer = field->manifest_.layers[k];
    if (layer.name != field->store_.layers()[k])
      return fail(ErrorCode::bad_file, path, ": layer ", k, " is '", layer.name,
                  "' in the manifest and '", field->store_.layers()[k], "' in the container");
    const auto tables = field->store_.blob(kTablesBlobPrefix + layer.name);
    if (!tables) return tl::unexpected(tables.error());
    auto made = codec::make_codec(layer.codec, layer.format, *tables);
    if (!made)
      return fail(ErrorCode::bad_file, path, ": layer '", layer.name, "': ", made.error().message);
    field->codecs_.push_back(std::move(*made));
  }
  return field;
}

std::optional<storage::LayerId> FieldFile::layer(std::string_view name) const {
  for (std::size_t k = 0; k < manifest_.layers.size(); ++k)
    if (manifest_.layers[k].name == name) return static_cast<storage::LayerId>(k);
  return std::nullopt;
}

const LevelGeometry& FieldFile::geometry(unsigned level) const {
  std::call_once(geometry_once_[level], [&] {
    geometry_[level] = std::make_unique<LevelGeometry>(manifest_.shape, level);
  });
  return *geometry_[level];
}

codec::Tile FieldFile::tile_shape(storage::LayerId layer, TileKey key) const {
  const TileSections sections = sections_of(key, manifest_.shape.entry_extra_levels);
  return geometry(key.level).tile(sections.entry.index, manifest_.layers[layer].format);
}

Result<void> FieldFile::decode(const storage::TileRef& tile, std::span<std::byte> samples) const {
  if (codecs_[tile.layer]->in_place() && tile.payload.size() == samples.size())
    return store_.copy(tile, samples);
  if (auto ok = store_.check(tile); !ok) return ok;
  auto decoded =
      codecs_[tile.layer]->decode(tile_shape(tile.layer, tile.key), tile.payload, samples);
  if (auto ok = unchanged(); !ok) return ok;  // not the codec's fault
  if (!decoded)
    return fail(decoded.error().code, path(), ": layer '", manifest_.layers[tile.layer].name,
                "', tile ", int{tile.key.level}, "/", tile.key.index, ": ", decoded.error().message,
                "; drop the damaged tile and build it again");
  return {};
}

Result<void> FieldFile::unchanged() const {
  if (!store_.changed()) return {};
  return fail(ErrorCode::bad_file, path(), ": changed while it was open; open it again");
}

Result<FieldContent> FieldFile::content() const {
  FieldContent content;
  content.file_bytes = store_.file_bytes();
  content.complete = true;
  for (unsigned level = 0; level <= shape().levels; ++level) {
    LevelContent& at = content.levels.emplace_back();
    at.level = level;
    at.tiles = shape().tiles(level);
    at.slabs = shape().slabs(level);
    at.payload_bytes.resize(manifest_.layers.size());
  }
  for (storage::LayerId layer = 0; layer < manifest_.layers.size(); ++layer) {
    const auto statistics = store_.statistics(layer);
    if (!statistics) return tl::unexpected(statistics.error());
    std::vector<std::uint64_t> built(content.levels.size());
    for (const storage::LevelStatistics& s : *statistics) {
      if (s.level >= content.levels.size()) continue;
      LevelContent& at = content.levels[s.level];
      at.payload_bytes[layer] = s.payload_bytes;
      content.payload_bytes += s.payload_bytes;
      built[s.level] = s.stored + s.empty;
      if (layer == 0) at.stored = s.stored, at.empty = s.empty;
    }
    for (std::size_t l = 0; l < built.size(); ++l)
      if (built[l] != content.levels[l].tiles) content.complete = false;
  }
  return content;
}

Result<Field> Field::open(const std::string& path) {
  auto file = FieldFile::open(path);
  if (!file) return tl::unexpected(file.error());
  return Field(std::move(*file));
}

const std::string& Field::path() const { return file_->path(); }
const FieldShape& Field::shape() const { return file_->shape(); }
const std::vector<Layer>& Field::layers() const { return file_->manifest().layers; }
bool Field::has_layer(std::string_view name) const { return file_->layer(name).has_value(); }
std::string Field::provenance() const { return file_->manifest().provenance.dump(); }
std::string Field::manifest() const { return file_->manifest().to_json().dump(); }
std::uint64_t Field::file_bytes() const { return file_->store().file_bytes(); }
Result<FieldContent> Field::content() const { return file_->content(); }

}  // namespace slf
