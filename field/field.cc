#include "field/field_file.h"

#include <algorithm>
#include <set>

#include "base/ascii.h"
#include "base/guarded.h"
#include "base/sort_unique.h"
#include "base/try.h"

namespace slf {

Result<std::shared_ptr<const FieldFile>> FieldFile::open(const std::string& path) {
  auto store = SLF_TRY(storage::TileStore::open(path));
  return open(std::move(store));
}

Result<std::shared_ptr<const FieldFile>> FieldFile::open(storage::TileStore store) {
  const std::string& path = store.path();
  const auto text = SLF_TRY(store.blob(kManifestBlob));
  const auto tables = SLF_TRY(store.blob(kTablesBlob));
  std::shared_ptr<FieldFile> file(new FieldFile(std::move(store)));
  Manifest& manifest = file->manifest_;
  manifest = SLF_TRY(Manifest::parse(chars_of(text), path));
  file->shape_of_state_ = one_state(manifest.shape);
  auto codec = codec::make_codec(manifest.codec, manifest.format, tables);
  if (!codec && codec.error().code == ErrorCode::usage)
    return unsupported(path, "this program does not know its codec \"", manifest.codec,
                       "\"; update slf");
  if (!codec) return bad_file(path, codec.error().message);
  file->codec_ = std::move(*codec);
  file->coder_.emplace(
      manifest.shape, manifest.format, *file->codec_,
      [of = file.get()](unsigned level) -> const LevelGeometry& { return of->geometry(level); },
      !manifest.states.empty(), manifest.keeps_rays);
  if (file->predicts()) file->read_reference_index();
  return file;
}

void FieldFile::read_reference_index() {
  for (unsigned level = 1; level <= shape().finest_level; ++level) {
    const Bytes section = store_.section(reference_section(level));
    auto index = ReferenceIndex::parse(section, level);
    if (section.empty() || !index) return;
    reference_index_.push_back(std::move(*index));
  }
}

namespace {

/// The same tile of an earlier state among the references of a tile; none: it is none of them.
std::optional<TileKey> earlier_of(TileKey key, std::span<const TileKey> references) {
  for (const TileKey reference : references)
    if (reference.level == key.level) return reference;
  return std::nullopt;
}

}  // namespace

Result<std::vector<TileKey>> FieldFile::references(const storage::TileRef& tile) const {
  auto named = SLF_TRY(listed(tile));
  if (earlier_of(tile.key, named)) SLF_TRY(chain(tile));
  return named;
}

Result<unsigned> FieldFile::chain(storage::TileRef tile) const {
  const TileKey key = tile.key;
  for (unsigned length = 0; length <= kMaxChain; ++length) {
    const auto named = SLF_TRY(listed(tile));
    const auto earlier = earlier_of(tile.key, named);
    if (!earlier) return length;
    tile = SLF_TRY(store_.find(*earlier));
  }
  return fail(ErrorCode::bad_file, place(key), kChained);
}

Result<std::vector<TileKey>> FieldFile::listed(const storage::TileRef& tile) const {
  if (!predicts() || tile.state != storage::TileState::stored) return std::vector<TileKey>();
  SLF_TRY(store_.fetch(tile));
  auto named = coder().references(tile.source, tile.payload);
  for (const TileKey reference : named)
    if (!shape().has(reference))
      return fail(ErrorCode::bad_file, place(reference),
                  ", from which others are predicted, is not in the field");
  return named;
}

FoundTiles FieldFile::find(std::span<const TileKey> keys, const Skip& skip, bool advise) const {
  FoundTiles found;
  std::vector<TileKey> level(keys.begin(), keys.end());
  for (bool first = true; !level.empty(); first = false) {
    sort_unique(level);
    std::erase_if(level, [&](TileKey key) { return found.contains(key) || (skip && skip(key)); });
    std::vector<storage::TileRef> refs;
    for (const auto& tile : store_.find_all(level))
      if (tile) refs.push_back(*tile);
    if (advise && (first || coder().uses_states()) && !reference_index_.empty())
      advise_together(refs);
    else if (advise)
      store_.advise(refs);
    level.clear();
    for (const storage::TileRef& ref : refs) {
      auto named = listed(ref);
      if (!named) continue;
      level.insert(level.end(), named->begin(), named->end());
      found.emplace(ref.key, FoundTile{ref, std::move(*named)});
    }
  }
  const auto is_too_long = [&](const auto& tile) {
    unsigned length = 0;
    for (auto at = found.find(tile.first); at != found.end() && length <= kMaxChain; ++length) {
      const auto earlier = earlier_of(at->first, at->second.references);
      if (!earlier) return false;
      at = found.find(*earlier);
    }
    return length > kMaxChain;
  };
  if (coder().uses_states()) std::erase_if(found, is_too_long);
  return found;
}

void FieldFile::advise_together(std::vector<storage::TileRef> tiles) const {
  std::vector<TileKey> keys;
  for (const storage::TileRef& tile : tiles)
    if (tile.state == storage::TileState::stored) keys.push_back(tile.source);
  append_ancestors(reference_index_, keys);
  std::erase_if(keys, [&](TileKey key) { return !shape().has(key); });
  for (const auto& tile : store_.find_all(keys))
    if (tile) tiles.push_back(*tile);
  store_.advise(tiles);
}

const LevelGeometry& FieldFile::geometry(unsigned level) const {
  std::call_once(geometry_once_[level],
                 [&] { geometries_[level] = std::make_unique<LevelGeometry>(shape(), level); });
  return *geometries_[level];
}

Result<void> FieldFile::decode(const storage::TileRef& tile, std::span<const ReferenceSamples> from,
                               std::span<std::byte> samples) const {
  const auto decoded = coder().decode(tile.source, tile.payload, from, samples);
  SLF_TRY(store_.unchanged());  // not the codec's fault
  if (!decoded)
    return fail(decoded.error().code, place(tile.source), ": ", decoded.error().message,
                "; drop the damaged tile and build it again");
  return {};
}

Result<TileSelection> FieldFile::recorded(const TileOrder& order,
                                          std::optional<unsigned> state) const {
  TileSelection tiles;
  const auto add = [&](const TileRange& keys) -> Result<void> {
    const auto ranges = SLF_TRY(store_.covered(keys));
    for (const auto& [begin, end] : ranges)
      tiles.add({order.number(in_state(begin, begin.state - state.value_or(0))),
                 order.number(in_state(end, end.state - state.value_or(0)))});
    return {};
  };
  if (!state) SLF_TRY(add(all_keys(shape())));
  for (unsigned level = 0; state && level <= shape().finest_level; ++level)
    SLF_TRY(add(keys_of(level, *state)));
  return tiles;
}

Result<FieldContent> FieldFile::content(std::optional<unsigned> state) const {
  FieldContent content;
  content.file_bytes = store_.file_bytes();
  content.complete = true;
  const FieldShape& shown = state ? shape_of_state() : shape();
  for (unsigned level = 0; level <= shape().finest_level; ++level) {
    const TileRange keys =
        state ? keys_of(level, *state) : TileRange{first_key(level), first_key(level + 1)};
    const auto found = SLF_TRY(store_.statistics(keys));
    LevelContent& at = content.levels.emplace_back();
    at.level = level;
    at.entry_resolution = shape().entry_resolution(level);
    at.exit_resolution = shape().exit_resolution(level);
    at.tiles = shown.tiles(level);
    at.slabs = shown.states * shown.slabs(level);
    at.stored = found.stored, at.empty = found.empty;
    if (!manifest().states.empty()) at.same = found.same;
    at.payload_bytes = found.payload_bytes;
    content.payload_bytes += found.payload_bytes;
    std::uint64_t held = found.stored + found.empty + found.same;
    if (manifest().part) {
      held = 0;
      SLF_TRY(store_.visit(keys.begin, keys.end, [&](const storage::TileRef& tile) -> Result<void> {
        held += manifest().holds(tile.key) ? 1 : 0;
        return {};
      }));
    }
    if (held != manifest().tiles(level) / shape().states * shown.states) content.complete = false;
  }
  return content;
}

Result<ByteSpan> FieldFile::light() const { return kept(kLightBlob); }

Result<ByteSpan> FieldFile::kept(const char* blob) const {
  const auto any = SLF_TRY(store_.has_blob(blob));
  return any ? store_.blob(blob) : Result<ByteSpan>();
}

Result<Field> Field::open(const std::string& path) {
  return guarded([&]() -> Result<Field> {
    auto file = SLF_TRY(FieldFile::open(path));
    return Field(std::move(file));
  });  // NOLINT(clang-analyzer-cplusplus.NewDeleteLeaks): the Field has it
}

const std::string& Field::path() const { return file_->path(); }
const FieldShape& Field::shape() const { return file_->shape_of_state(); }
SampleFormat Field::format() const { return file_->format(); }
const std::string& Field::codec() const { return file_->manifest().codec; }
std::optional<TileRange> Field::part() const { return file_->manifest().part; }
std::string Field::provenance() const {
  OwnedJson own = file_->manifest().provenance_of(state_);
  if (!structures_ || structures_->empty()) return own->dump();
  // Parts of one volume, together, are some of its labels.
  std::set<std::int64_t> labels;
  const nlohmann::json* added = nullptr;  // the last list: that of many states may be one
  for (const Structure& one : *structures_) {
    const auto* only =
        one.field.file().manifest().provenance_at(one.field.state(), {"structures", "only"});
    const bool plain = one.opacity == 1 && one.tint == Structure{one.field}.tint;
    if (!plain || !only) {
      (*own)["composed"] = structures_->size();  // no scene has this
      return own->dump();
    }
    if (only == std::exchange(added, only)) continue;
    for (const nlohmann::json& id : *only)
      if (id.is_number_integer()) labels.insert(id.get<std::int64_t>());
  }
  if (nlohmann::json& parts = (*own)["structures"]; !parts.is_object())  // another state's are
    parts = nlohmann::json::object();
  (*own)["structures"]["only"] = labels;
  return own->dump();
}
std::vector<std::string> Field::states() const {
  std::vector<std::string> names;
  for (const Manifest::State& state : file_->manifest().states) names.push_back(state.name);
  return names;
}
Result<Field> Field::in_state(unsigned state) const try {
  if (const std::size_t count = std::max<std::size_t>(1, file_->manifest().states.size());
      state >= count)
    return fail_without("state", ErrorCode::usage, path(), ": has no state ", state,
                        count > 1 ? "; its states are 0 to " : "; it has one state, ", count - 1);
  Field other(file_);
  other.state_ = state;
  return other;
} catch (...) {
  return tl::unexpected(error_of_exception());
}
Result<Field> Field::in_state(const std::string& name) const try {
  const std::vector<std::string> names = states();
  const auto named = std::find(names.begin(), names.end(), name);
  if (named != names.end()) return in_state(static_cast<unsigned>(named - names.begin()));
  if (const auto number = parse_number<unsigned>(name)) return in_state(*number);
  std::string listed;
  for (const std::string& known : names) {
    listed += (listed.empty() ? "" : ", ") + known;
    if (listed.size() > 200) listed += ", …";
    if (listed.size() > 200) break;
  }
  return fail_without(
      "state", ErrorCode::usage, path(), ": has no state '", name, "'",
      names.empty() ? "; it has just one, without a name" : "; its states are: ", listed);
} catch (...) {
  return tl::unexpected(error_of_exception());
}
bool Field::linear() const {
  const auto is = [&](const char* member, const nlohmann::json& value) {
    const auto* at = file_->manifest().provenance_at(state_, {"lighting", member});
    return at && *at == value;
  };
  return is("linear", true) && (is("mode", "shadowed") || is("mode", "global"));
}
Result<std::vector<std::byte>> Field::light() const {
  return guarded([&]() -> Result<std::vector<std::byte>> {
    if (state_ > 0) return std::vector<std::byte>();  // that of the first state is kept
    const auto light = SLF_TRY(file_->light());
    return std::vector<std::byte>(light.begin(), light.end());
  });
}
Result<std::optional<Reveal>> Field::reveal(RevealPart part) const {
  return guarded([&]() -> Result<std::optional<Reveal>> {
    const auto code = SLF_TRY(file_->reveal());
    if (code.empty()) return std::nullopt;
    auto reveal = decode_reveal(code, part);
    if (!reveal) return fail(reveal.error().code, path(), ": ", reveal.error().message);
    if (reveal->content != content_of(provenance())) return std::nullopt;
    return std::optional(std::move(*reveal));
  });
}
std::string Field::manifest() const { return file_->manifest().to_json()->dump(); }
std::uint64_t Field::file_bytes() const { return file_->store().file_bytes(); }
Result<FieldContent> Field::content() const {
  return guarded([&] { return file_->content(state_); });
}

std::vector<Field> sources_of(const Field& field) {
  if (!field.structures()) return {field};
  std::vector<Field> sources;
  for (const Structure& one : *field.structures()) sources.push_back(one.field);
  return sources;
}

namespace {

/// usage: the structure cannot be drawn in place of the field.
Result<void> check_structure(const Structure& structure, const Field& field) {
  const Field& one = structure.field;
  const auto refuse = [&](const auto&... why) -> Result<void> {
    return misuse(one.path(), why...);
  };
  for (const float share :
       {structure.opacity, structure.tint[0], structure.tint[1], structure.tint[2]})
    if (!(share >= 0 && share <= 1)) return refuse("opacity or tint ", share, ": expected 0 to 1");
  if (one.structures()) return refuse("is composed itself");
  if (!one.has_depth()) return refuse("has no depth, by which structures are composed");
  const auto differs = [&](const char* what, const auto& its, const auto& other) {
    return refuse("has ", what, " ", its, ", but ", field.path(), " has ", other,
                  "; structures need equal ones");
  };
  const FieldShape &a = one.shape(), &b = field.shape();
  for (int axis = 0; axis < 3; ++axis)
    if (a.sphere.center[axis] != b.sphere.center[axis])
      return differs("a sphere around", a.sphere.center[axis], b.sphere.center[axis]);
  if (a.sphere.radius != b.sphere.radius)
    return differs("a sphere of radius", a.sphere.radius, b.sphere.radius);
  if (a.entry_side != b.entry_side) return differs("entry cells", a.entry_side, b.entry_side);
  if (a.exit_side != b.exit_side) return differs("exit cells", a.exit_side, b.exit_side);
  if (a.finest_level != b.finest_level)
    return differs("finest level", a.finest_level, b.finest_level);
  if (a.entry_extra_levels != b.entry_extra_levels)
    return differs("entry depth", a.entry_extra_levels, b.entry_extra_levels);
  if (one.format() != field.format())
    return differs("samples", name(one.format()), name(field.format()));
  if (one.linear() != field.linear())
    return refuse(one.linear() ? "has" : "has no", " linear radiance, unlike ", field.path());
  return {};
}

}  // namespace

Result<Field> compose(const Field& field, std::vector<Structure> structures) {
  return guarded([&]() -> Result<Field> {
    for (const Structure& one : structures) SLF_TRY(check_structure(one, field));
    std::erase_if(structures, [](const Structure& one) { return one.opacity == 0; });
    Field composed = field;
    composed.structures_ = std::make_shared<const std::vector<Structure>>(std::move(structures));
    return composed;
  });
}

}  // namespace slf
