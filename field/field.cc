#include "field/field_file.h"

#include <algorithm>
#include <set>

#include "base/ascii.h"
#include "base/guarded.h"
#include "base/sort_unique.h"
#include "base/try.h"

namespace slf {

Result<std::shared_ptr<const FieldFile>> FieldFile::open(const std::string& path, unsigned state) {
  const auto store = SLF_TRY(storage::TileStore::open(path));
  return open(store, state);
}

Result<std::shared_ptr<const FieldFile>> FieldFile::open(const storage::TileStore& opened,
                                                         unsigned state) {
  const std::string& path = opened.path();
  const auto text = SLF_TRY(opened.blob(kManifestBlob));
  auto shared = std::make_shared<Shared>();
  Manifest& manifest = shared->manifest;
  manifest = SLF_TRY(Manifest::parse(chars_of(text), path));
  const bool whole = state == kAllStates || manifest.states.empty();
  if (!whole) manifest.shape.states = 1;
  auto store = whole ? opened.all_states() : opened.in_state(state);
  const auto tables = SLF_TRY(store.blob(kTablesBlob));
  auto codec = codec::make_codec(manifest.codec, manifest.format, tables);
  if (!codec && codec.error().code == ErrorCode::usage)
    return unsupported(path, "this program does not know its codec \"", manifest.codec,
                       "\"; update slf");
  if (!codec) return bad_file(path, codec.error().message);
  shared->codec = std::move(*codec);
  shared->coder.emplace(
      manifest.shape, manifest.format, *shared->codec,
      [of = shared.get()](unsigned level) -> const LevelGeometry& { return of->geometry(level); },
      !manifest.states.empty());
  if (shared->coder->predicts()) shared->read_reference_index(store);
  return std::shared_ptr<const FieldFile>(
      new FieldFile(std::move(store), whole ? 0 : state, std::move(shared)));
}

Result<std::shared_ptr<const FieldFile>> FieldFile::in_state(unsigned state) const {
  if (shape().states > 1 || manifest().states.empty()) return open(store_, state);
  return std::shared_ptr<const FieldFile>(new FieldFile(store_.in_state(state), state, shared_));
}

bool FieldFile::can_have(TileKey key) const {
  return state_of(store_.in_file(key)) < std::max<std::size_t>(1, manifest().states.size()) &&
         shape().has(slf::in_state(key, 0));
}

std::string FieldFile::place(TileKey key) const {
  return path() + ": tile " + storage::name(store_.in_file(key));
}

void FieldFile::Shared::read_reference_index(const storage::TileStore& store) {
  for (unsigned level = 1; level <= manifest.shape.levels; ++level) {
    const Bytes section = store.section(reference_section(level));
    auto index = ReferenceIndex::parse(section, level);
    if (section.empty() || !index) return;
    reference_index.push_back(std::move(*index));
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
    if (!can_have(reference))
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
    if (advise && (first || coder().uses_states()) && !shared_->reference_index.empty())
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
  append_ancestors(shared_->reference_index, keys);
  std::erase_if(keys, [&](TileKey key) { return !can_have(key); });
  for (const auto& tile : store_.find_all(keys))
    if (tile) tiles.push_back(*tile);
  store_.advise(tiles);
}

const LevelGeometry& FieldFile::Shared::geometry(unsigned level) const {
  std::call_once(geometry_once[level], [&] {
    geometries[level] = std::make_unique<LevelGeometry>(manifest.shape, level);
  });
  return *geometries[level];
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

Result<TileSelection> FieldFile::recorded(const TileOrder& order) const {
  const auto ranges = SLF_TRY(store_.covered());
  TileSelection tiles;
  for (const TileRange& range : ranges)
    tiles.add({order.number(range.begin), order.number(range.end)});
  return tiles;
}

Result<FieldContent> FieldFile::content() const {
  FieldContent content;
  content.file_bytes = store_.file_bytes();
  content.complete = true;
  for (unsigned level = 0; level <= shape().levels; ++level) {
    LevelContent& at = content.levels.emplace_back();
    at.level = level;
    at.entry_resolution = shape().entry_resolution(level);
    at.exit_resolution = shape().exit_resolution(level);
    if (!manifest().states.empty()) at.same = 0;
    at.tiles = shape().tiles(level);
    at.slabs = shape().states * shape().slabs(level);
  }
  if (manifest().part) {
    content.complete = SLF_TRY(part_is_complete());
  }
  const auto statistics = SLF_TRY(store_.statistics());
  for (const storage::LevelStatistics& s : statistics) {
    if (s.level >= content.levels.size()) continue;
    LevelContent& at = content.levels[s.level];
    at.payload_bytes = s.payload_bytes;
    content.payload_bytes += s.payload_bytes;
    at.stored = s.stored, at.empty = s.empty;
    if (at.same) at.same = s.same;
  }
  for (const LevelContent& at : content.levels)
    if (!manifest().part && at.stored + at.empty + at.same.value_or(0) != at.tiles)
      content.complete = false;
  return content;
}

Result<bool> FieldFile::part_is_complete() const {
  std::uint64_t expected = 0;
  for (unsigned level = 0; level <= shape().levels; ++level) expected += manifest().tiles(level);
  std::uint64_t found = 0;
  SLF_TRY(store_.visit({0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
    found += manifest().holds(tile.key) ? 1 : 0;
    return {};
  }));
  return found == expected;
}

Result<ByteSpan> FieldFile::light() const {
  if (state_ > 0) return ByteSpan();  // that of the first state is kept
  const auto kept = SLF_TRY(store_.has_blob(kLightBlob));
  return kept ? store_.blob(kLightBlob) : Result<ByteSpan>();
}

Result<Field> Field::open(const std::string& path) {
  return guarded([&] { return FieldFile::open(path); }).map([](auto file) {
    return Field(std::move(file));
  });
  // The analyzer loses sight of the shared pointer.
  // NOLINTNEXTLINE(clang-analyzer-cplusplus.NewDeleteLeaks)
}

const std::string& Field::path() const { return file_->path(); }
const FieldShape& Field::shape() const { return file_->shape(); }
SampleFormat Field::format() const { return file_->format(); }
const std::string& Field::codec() const { return file_->manifest().codec; }
std::optional<TileRange> Field::part() const { return file_->manifest().part; }
std::string Field::provenance() const {
  OwnedJson own = file_->manifest().provenance_of(file_->state());
  if (!structures_ || structures_->empty()) return own->dump();
  // Parts of one volume, together, are some of its labels.
  std::set<std::int64_t> labels;
  const nlohmann::json* added = nullptr;  // the last list: that of many states may be one
  for (const Structure& one : *structures_) {
    const FieldFile& file = one.field.file();
    const auto* only = file.manifest().provenance_at(file.state(), {"structures", "only"});
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
unsigned Field::state() const { return file_->state(); }
std::vector<std::string> Field::states() const {
  std::vector<std::string> names;
  for (const Manifest::State& state : file_->manifest().states) names.push_back(state.name);
  return names;
}
Result<Field> Field::in_state(unsigned state) const {
  if (const std::size_t count = std::max<std::size_t>(1, file_->manifest().states.size());
      state >= count)
    return fail_without("state", ErrorCode::usage, path(), ": has no state ", state,
                        count > 1 ? "; its states are 0 to " : "; it has one state, ", count - 1);
  return guarded([&] { return file_->in_state(state); }).map([](auto file) {
    return Field(std::move(file));
  });
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
    const auto* at = file_->manifest().provenance_at(file_->state(), {"lighting", member});
    return at && *at == value;
  };
  return is("linear", true) && (is("mode", "shadowed") || is("mode", "global"));
}
Result<std::vector<std::byte>> Field::light() const {
  return guarded([&]() -> Result<std::vector<std::byte>> {
    const auto light = SLF_TRY(file_->light());
    return std::vector<std::byte>(light.begin(), light.end());
  });
}
std::string Field::manifest() const { return file_->manifest().to_json()->dump(); }
std::uint64_t Field::file_bytes() const { return file_->store().file_bytes(); }
Result<FieldContent> Field::content() const {
  return guarded([&] { return file_->content(); });
}

std::vector<const FieldFile*> files_of(const Field& field) {
  if (!field.structures()) return {&field.file()};
  std::vector<const FieldFile*> files;
  for (const Structure& one : *field.structures()) files.push_back(&one.field.file());
  return files;
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
  if (a.levels != b.levels) return differs("finest level", a.levels, b.levels);
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
    Field composed(field.file_);
    composed.structures_ = std::make_shared<const std::vector<Structure>>(std::move(structures));
    return composed;
  });
}

}  // namespace slf
