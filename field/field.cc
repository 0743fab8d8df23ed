#include "field/field_file.h"

#include <algorithm>

#include "base/sort_unique.h"
#include "base/try.h"

namespace slf {

Result<std::shared_ptr<const FieldFile>> FieldFile::open(const std::string& path) {
  auto store = SLF_TRY(storage::TileStore::open(path));
  return open(std::move(store));
}

Result<std::shared_ptr<const FieldFile>> FieldFile::open(storage::TileStore store) {
  const std::string path = store.path();
  const auto text = SLF_TRY(store.blob(kManifestBlob));
  auto manifest =
      SLF_TRY(Manifest::parse({reinterpret_cast<const char*>(text.data()), text.size()}, path));
  if (manifest.layers.size() != store.layers().size())
    return fail(ErrorCode::bad_file, path, ": the manifest names ", manifest.layers.size(),
                " layers, the container holds ", store.layers().size());

  std::shared_ptr<FieldFile> field(new FieldFile(std::move(store), std::move(manifest)));
  for (std::size_t k = 0; k < field->manifest_.layers.size(); ++k) {
    const Layer& layer = field->manifest_.layers[k];
    if (layer.name != field->store_.layers()[k])
      return fail(ErrorCode::bad_file, path, ": layer ", k, " is '", layer.name,
                  "' in the manifest and '", field->store_.layers()[k], "' in the container");
    const auto tables = SLF_TRY(field->store_.blob(kTablesBlobPrefix + layer.name));
    auto made = codec::make_codec(layer.codec, layer.format, tables);
    if (!made)
      return fail(ErrorCode::bad_file, path, ": layer '", layer.name, "': ", made.error().message);
    field->codecs_.push_back(std::move(*made));
    field->predict(static_cast<storage::LayerId>(k));
  }
  return field;
}

std::optional<storage::LayerId> FieldFile::layer(std::string_view name) const {
  for (std::size_t k = 0; k < manifest_.layers.size(); ++k)
    if (manifest_.layers[k].name == name) return static_cast<storage::LayerId>(k);
  return std::nullopt;
}

bool FieldFile::has_depth() const {
  return std::any_of(manifest_.layers.begin(), manifest_.layers.end(), [](const Layer& layer) {
    return layer.name == "depth" || has_color_and_depth(layer.format);
  });
}

bool FieldFile::predicts() const {
  return std::any_of(predictions_.begin(), predictions_.end(),
                     [](const auto& prediction) { return prediction != nullptr; });
}

void FieldFile::predict(storage::LayerId layer) {
  auto& prediction = predictions_.emplace_back();
  const codec::PredictiveCodec* const codec = codecs_[layer]->predictive();
  if (!codec) return;
  const auto geometries = [this](unsigned level) -> const LevelGeometry& {
    return geometry(level);
  };
  const auto load = [this, layer](TileKey key) { return reference(layer, key); };
  prediction.reset(new Prediction{{manifest_.shape, *codec, geometries}, ReferenceCache(load), {}});
  for (unsigned level = 1; level <= shape().levels; ++level) {
    const Bytes section = store_.section(reference_section(layer, level));
    auto index = ReferenceIndex::parse(section, level);
    if (section.empty() || !index) return;
    prediction->index.push_back(std::move(*index));
  }
}

Result<TileSamples> FieldFile::reference(storage::LayerId layer, TileKey key) const {
  const auto named = [&](ErrorCode code, const char* what) {
    return fail(code, path(), ": layer '", manifest_.layers[layer].name, "', tile ", int{key.level},
                "/", key.index, ", from which others are predicted, ", what);
  };
  if (!shape().has(key)) return named(ErrorCode::bad_file, "is not in the field");
  const auto tile = SLF_TRY(store_.find(layer, key));
  if (tile.state == storage::TileState::missing)
    return named(ErrorCode::tile_missing, "is missing; build the field again");
  if (tile.state == storage::TileState::empty) return TileSamples();
  const auto samples = std::make_shared<Bytes>(tile_shape(layer, key).bytes());
  SLF_TRY(decode_payload(tile, *samples));
  return TileSamples(samples);
}

std::vector<TileKey> FieldFile::references(const storage::TileRef& tile) const {
  if (!predictions_[tile.layer]) return {};
  return predictions_[tile.layer]->tiles.references(tile.key, tile.payload);
}

Result<std::vector<TileKey>> FieldFile::with_references(storage::LayerId layer,
                                                        std::span<const TileKey> keys) const {
  std::vector<TileKey> all(keys.begin(), keys.end());
  std::vector<TileKey> dependants;
  if (predictions_[layer]) dependants = all;
  while (!dependants.empty()) {
    std::vector<TileKey> found;
    for (const auto& tile : store_.find_all(layer, dependants)) {
      if (!tile) return tl::unexpected(tile.error());
      if (tile->state != storage::TileState::stored) continue;
      for (const TileKey key : references(*tile))
        if (shape().has(key)) found.push_back(key);
    }
    sort_unique(found);
    all.insert(all.end(), found.begin(), found.end());
    dependants = std::move(found);
  }
  sort_unique(all);
  return all;
}

void FieldFile::advise_together(std::span<const storage::TileRef> tiles) const {
  std::vector<storage::TileRef> all(tiles.begin(), tiles.end());
  for (storage::LayerId layer = 0; layer < predictions_.size(); ++layer) {
    if (!predictions_[layer]) continue;
    std::vector<TileKey> keys;
    for (const storage::TileRef& tile : tiles)
      if (tile.layer == layer && tile.state == storage::TileState::stored) keys.push_back(tile.key);
    append_ancestors(predictions_[layer]->index, keys);
    std::erase_if(keys, [&](TileKey key) { return !shape().has(key); });
    for (const auto& tile : store_.find_all(layer, keys))
      if (tile && tile->state == storage::TileState::stored) all.push_back(*tile);
  }
  store_.advise(all);
}

void FieldFile::advise(std::span<const storage::TileRef> tiles, const IsLoaded& loaded) const {
  if (std::any_of(predictions_.begin(), predictions_.end(),
                  [](const auto& prediction) { return prediction && !prediction->index.empty(); }))
    advise_together(tiles);
  else
    store_.advise(tiles);
  for (storage::LayerId layer = 0; layer < predictions_.size(); ++layer) {
    if (!predictions_[layer]) continue;
    std::vector<storage::TileRef> dependants;
    for (const storage::TileRef& tile : tiles)
      if (tile.layer == layer && tile.state == storage::TileState::stored)
        dependants.push_back(tile);
    while (!dependants.empty()) {
      std::vector<TileKey> keys;
      for (const storage::TileRef& tile : dependants)
        for (const TileKey key : references(tile))
          if (shape().has(key) && !(loaded && loaded(key))) keys.push_back(key);
      sort_unique(keys);
      dependants.clear();
      for (const auto& tile : store_.find_all(layer, keys))
        if (tile && tile->state == storage::TileState::stored) dependants.push_back(*tile);
      store_.advise(dependants);
    }
  }
}

Result<void> FieldFile::encode(storage::LayerId layer, TileKey key, ByteSpan samples,
                               Bytes& payload) const {
  std::vector<TileSamples> kept;
  return predictions_[layer]->tiles.encode(key, samples, cached(layer, kept), payload);
}

ReferenceSource FieldFile::cached(storage::LayerId layer, std::vector<TileSamples>& kept) const {
  return [this, layer, &kept](TileKey key) -> Result<ByteSpan> {
    const TileSamples& found = kept.emplace_back(SLF_TRY(predictions_[layer]->references.get(key)));
    return found ? ByteSpan(*found) : ByteSpan();
  };
}

void FieldFile::set_reference_budget(std::uint64_t bytes) const {
  for (const auto& prediction : predictions_)
    if (prediction) prediction->references.set_budget(bytes);
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
  Prediction* const prediction = predictions_[tile.layer].get();
  if (!prediction || tile.key.level == shape().levels) return decode_payload(tile, samples);
  // Finer tiles may be predicted from this one, so it is decoded once for both purposes.
  const auto shared = SLF_TRY(prediction->references.get(tile.key));
  if (!shared) return changed();  // the tile was not empty before
  std::copy_n(shared->begin(), samples.size(), samples.begin());
  return {};
}

Result<void> FieldFile::decode_payload(const storage::TileRef& tile,
                                       std::span<std::byte> samples) const {
  std::vector<TileSamples> kept;
  return decode(tile, cached(tile.layer, kept), samples);
}

Result<void> FieldFile::decode(const storage::TileRef& tile, const ReferenceSource& references,
                               std::span<std::byte> samples) const {
  decoded_bytes_ += tile.payload.size();
  if (codecs_[tile.layer]->in_place() && tile.payload.size() == samples.size())
    return store_.copy(tile, samples);
  SLF_TRY(store_.check(tile));
  Prediction* const prediction = predictions_[tile.layer].get();
  std::optional<Error> of_reference;
  const auto source = [&](TileKey key) {
    auto found = references(key);
    if (!found) of_reference = found.error();
    return found;
  };
  auto decoded = prediction ? prediction->tiles.decode(tile.key, tile.payload, source, samples)
                            : codecs_[tile.layer]->decode(tile_shape(tile.layer, tile.key),
                                                          tile.payload, samples);
  if (of_reference) return tl::unexpected(*of_reference);
  SLF_TRY(unchanged());  // not the codec's fault
  if (!decoded)
    return fail(decoded.error().code, path(), ": layer '", manifest_.layers[tile.layer].name,
                "', tile ", int{tile.key.level}, "/", tile.key.index, ": ", decoded.error().message,
                "; drop the damaged tile and build it again");
  return {};
}

Result<void> FieldFile::unchanged() const {
  if (!store_.changed()) return {};
  return changed();
}

tl::unexpected<Error> FieldFile::changed() const {
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
  if (manifest_.part) {
    content.complete = SLF_TRY(part_is_complete());
  }
  for (storage::LayerId layer = 0; layer < manifest_.layers.size(); ++layer) {
    const auto statistics = SLF_TRY(store_.statistics(layer));
    std::vector<std::uint64_t> built(content.levels.size());
    for (const storage::LevelStatistics& s : statistics) {
      if (s.level >= content.levels.size()) continue;
      LevelContent& at = content.levels[s.level];
      at.payload_bytes[layer] = s.payload_bytes;
      content.payload_bytes += s.payload_bytes;
      built[s.level] = s.stored + s.empty;
      if (layer == 0) at.stored = s.stored, at.empty = s.empty;
    }
    for (std::size_t l = 0; l < built.size(); ++l)
      if (!manifest_.part && built[l] != content.levels[l].tiles) content.complete = false;
  }
  return content;
}

Result<bool> FieldFile::part_is_complete() const {
  std::uint64_t expected = 0;
  for (unsigned level = 0; level <= shape().levels; ++level) expected += manifest_.tiles(level);
  for (storage::LayerId layer = 0; layer < manifest_.layers.size(); ++layer) {
    std::uint64_t found = 0;
    SLF_TRY(store_.visit(layer, manifest_.part->begin, manifest_.part->end,
                         [&](const storage::TileRef& tile) -> Result<void> {
                           found += shape().has(tile.key) ? 1 : 0;
                           return {};
                         }));
    if (found != expected) return false;
  }
  return true;
}

Result<ByteSpan> FieldFile::light() const {
  const auto kept = SLF_TRY(store_.has_blob(kLightBlob));
  return kept ? store_.blob(kLightBlob) : Result<ByteSpan>();
}

Result<Field> Field::open(const std::string& path) {
  auto file = SLF_TRY(FieldFile::open(path));
  return Field(std::move(file));
}

const std::string& Field::path() const { return file_->path(); }
const FieldShape& Field::shape() const { return file_->shape(); }
const std::vector<Layer>& Field::layers() const { return file_->manifest().layers; }
bool Field::has_layer(std::string_view name) const { return file_->layer(name).has_value(); }
bool Field::has_depth() const { return file_->has_depth(); }
std::optional<TileRange> Field::part() const { return file_->manifest().part; }
std::string Field::provenance() const { return file_->manifest().provenance.dump(); }
Result<std::vector<std::byte>> Field::light() const {
  const auto light = SLF_TRY(file_->light());
  return std::vector<std::byte>(light.begin(), light.end());
}
std::string Field::manifest() const { return file_->manifest().to_json().dump(); }
std::uint64_t Field::file_bytes() const { return file_->store().file_bytes(); }
Result<FieldContent> Field::content() const { return file_->content(); }

}  // namespace slf
