#include "slf/build.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "base/join.h"
#include "base/mix.h"
#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/tiles/tile_cache.h"
#include "field/write/encode_tile.h"
#include "field/write/field_writer.h"
#include "field/write/missing_tiles.h"
#include "field/write/repack_plan.h"
#include "field/write/same_tiles.h"
#include "field/write/shard_plan.h"
#include "field/write/tile_tracer.h"
#include "field/write/write_budget.h"

namespace slf {
namespace {

using Clock = std::chrono::steady_clock;
using CodecPointer = std::unique_ptr<codec::Codec>;

constexpr std::size_t kTrainingTries = 256;

/// After so many commits, a build reads the coarser levels from its file opened anew. While the
/// file is open, LMDB reuses no page that later commits free, about four each. Opening it anew
/// empties the cache of references.
constexpr std::uint64_t kCommitsPerReader = 4;

/// Traces up to `wanted` tiles of the finest level, spread over it, that are not empty. Asks at
/// least once whether to go on.
Result<std::vector<TracedTile>> training_sample(const TileTracer& tracer, const FieldShape& shape,
                                                std::size_t wanted, const GoOn& go_on) {
  std::vector<TracedTile> sample;
  const std::uint64_t count = tile_count(shape.levels, shape.entry_extra_levels);
  for (std::uint64_t t = 0;; ++t) {
    if (!go_on()) return fail(ErrorCode::cancelled, "interrupted; nothing was written");
    if (t == kTrainingTries || sample.size() == wanted) return sample;
    TracedTile tile;
    const TileKey key{static_cast<std::uint8_t>(shape.levels), mix(t) % count};
    SLF_TRY(tracer.trace(key, tile));
    if (!tile.empty) sample.push_back(std::move(tile));
  }
}

/// The codec, with shared tables fitted to the scene if it has any that depend on it.
Result<CodecPointer> train_codec(const TileTracer& tracer, const Manifest& manifest,
                                 const GoOn& go_on) {
  const std::size_t wanted = codec::needs_training(manifest.codec) ? codec::kTrainingTiles : 0;
  const auto sample = SLF_TRY(training_sample(tracer, manifest.shape, wanted, go_on));
  std::vector<codec::TrainingTile> tiles;
  tiles.reserve(sample.size());
  for (const TracedTile& tile : sample) tiles.push_back({tracer.shape(tile.key), tile.samples});
  return codec::train_codec(manifest.codec, manifest.format, tiles, manifest.shape.levels);
}

/// The codec of an existing field.
Result<CodecPointer> codec_of(const FieldFile& field) {
  return codec::make_codec(field.codec().spec(), field.format(), field.codec().tables());
}

/// usage: the field at `file` is not the one that this build makes; `cure` says what to do.
Result<void> check_same(const std::string& file, const Manifest& existing, const Manifest& expected,
                        const char* cure) {
  const std::string differs = first_difference(existing, expected);
  if (differs.empty() && existing.part == expected.part) return {};
  if (differs.empty()) return misuse(file, "exists and is another part of the field; ", cure);
  if (differs == "/provenance/content")
    return misuse(file, "exists and was built from other data: what the input holds has changed; ",
                  cure);
  return misuse(file, "exists and was built with other settings (", differs, " differs); ", cure);
}

/// An earlier, incomplete or complete build of the same field.
struct EarlierBuild {
  MissingTiles missing;
  std::uint64_t transaction = 0;  ///< the commit that was read
  CodecPointer codec;
  Bytes light;            ///< that the file keeps; none if it is damaged
  bool in_place = false;  ///< it has the output's name, not that of a draft
};

/// The light that a field keeps; no bytes if it is damaged, since it can be computed again.
Result<Bytes> light_of(const FieldFile& field) {
  const auto light = field.light();
  if (!light && light.error().code != ErrorCode::bad_file) return tl::unexpected(light.error());
  return light ? Bytes(light->begin(), light->end()) : Bytes();
}

/// Finds an earlier build: the output itself if it exists and is to be kept, else its draft. Sets
/// manifest.filtered_levels to that of the build found.
Result<std::optional<EarlierBuild>> find_earlier_build(const FieldOutput& output,
                                                       const TileSelection& selection,
                                                       Manifest& manifest) {
  const bool in_place = output.existing == Existing::keep && output.exists();
  const std::string file = in_place ? output.path : output.unfinished();
  std::error_code ignored;
  if (!in_place && std::filesystem::is_symlink(file, ignored))
    return name_is_taken({ErrorCode::usage, file + ": is a link"});
  if (!in_place && !std::filesystem::exists(file, ignored)) return std::nullopt;
  const auto field = FieldFile::whole(file);
  if (!field && in_place) return tl::unexpected(field.error());
  if (!field) return name_is_taken(field.error());
  const Manifest& existing = (*field)->manifest();
  SLF_TRY(check_same(file, existing, manifest,
                     in_place ? "choose another output, or replace it"
                              : "complete it with its own settings, or move or remove it"));
  manifest.filtered_levels = existing.filtered_levels;
  auto missing = SLF_TRY(MissingTiles::of(**field, TileOrder(manifest.shape), selection));
  auto codec = SLF_TRY(codec_of(**field));
  auto light = SLF_TRY(light_of(**field));
  return EarlierBuild{std::move(missing), (*field)->store().transaction(), std::move(codec),
                      std::move(light), in_place};
}

/// Whether tiles are predicted from those of coarser levels.
bool predicts(const Manifest& manifest) { return codec::is_predictive(manifest.codec); }

/// Opens the part that has the coarser levels, if `options` name one, and limits the shard to the
/// next level. usage: it is another field, or its part is not levels 0 to some level.
Result<std::shared_ptr<const FieldFile>> open_coarser(const Manifest& expected,
                                                      ShardOptions& options) {
  if (options.coarser.empty()) return std::shared_ptr<const FieldFile>();
  const auto refuse = [&](const auto&... what) { return misuse(options.coarser, what...); };
  if (!predicts(expected))
    return refuse("is not needed: with this codec no tile is predicted from coarser ones");
  auto field = SLF_TRY(FieldFile::whole(options.coarser));
  if (const std::string differs = first_difference(field->manifest(), expected); !differs.empty())
    return refuse("was built with other settings (", differs, " differs)");
  const std::optional<TileRange> part = field->manifest().part;
  if (!part || part->begin != TileKey{} || part->end.index != 0)
    return refuse("does not hold just some levels from 0 on");
  const auto content = SLF_TRY(field->content());
  if (!content.complete) return refuse("is not finished");
  const unsigned next = part->end.level;
  if (options.first_level.value_or(next) != next || options.last_level.value_or(next) != next)
    return refuse("can only be used to build level ", next);
  options.first_level = options.last_level = next;
  return field;
}

/// The rays of the tiles with these numbers, approximately.
std::uint64_t count_rays(const TileTracer& tracer, const TileOrder& order, const FieldShape& shape,
                         const TileSelection& numbers) {
  std::uint64_t rays = 0;
  for (const NumberRange& range : numbers.ranges())
    for (unsigned level = 0; level <= shape.levels; ++level) {
      const NumberRange all = order.level(level), part = range.within(all);
      if (part == all && shape.subfields.empty()) {
        rays += shape.states * tracer.rays(level);
        continue;
      }
      for (std::uint64_t n = part.begin; n < part.end; ++n) rays += tracer.rays(order.key(n));
    }
  return rays;
}

/// A tile that a worker made.
struct EncodedTile {
  Bytes payload;           ///< none for an empty tile
  std::uint64_t back = 0;  ///< if it is the same as one of an earlier state: how many states back
};

/// The tiles of the file that is being written, or none. Workers read them while the writer
/// replaces the file. A mutex guards it, because the load() of libstdc++ 12's atomic shared_ptr
/// does not release.
class WrittenTiles {
 public:
  [[nodiscard]] std::optional<TileReader> get() const {
    const std::lock_guard lock(mutex_);
    return tiles_;
  }
  void set(std::optional<TileReader> tiles) {
    const std::lock_guard lock(mutex_);
    tiles_.swap(tiles);  // the last user of the old one closes it
  }

 private:
  mutable std::mutex mutex_;
  std::optional<TileReader> tiles_;
};

/// Null: none. `memory`: of decoded tiles.
std::optional<TileReader> tiles_of(std::shared_ptr<const FieldFile> file, std::uint64_t memory) {
  if (!file) return std::nullopt;
  return TileReader(Field::of(std::move(file)), {.memory = memory});
}

/// The checked inputs of a build.
struct BuildJob {
  const TileTracer& tracer;
  const codec::Codec& codec;
  const MissingTiles& missing;
  TileOrder order;
  const WriteBudget budget;
  SameTiles& same;
  const std::optional<TileReader> coarser;  ///< if another file has the coarser levels
  const bool reads_own_file;                ///< to predict tiles
  WrittenTiles written{};

  Result<EncodedTile> make(TileKey key, TracedTile& traced) const {
    EncodedTile encoded;
    SLF_TRY(tracer.trace(key, traced));
    encoded.back = SLF_TRY(same.find(traced));
    if (traced.empty || encoded.back > 0) return encoded;
    const auto own = written.get();
    const auto& from = coarser ? coarser : own;
    const FieldFile* const earlier = own ? &own->field().file() : nullptr;
    SLF_TRY(from ? encode_tile(from->cache(), earlier, key, traced.samples, encoded.payload)
                 : codec.encode(tracer.shape(key), traced.samples, nullptr, encoded.payload));
    return encoded;
  }

  [[nodiscard]] TileKey key(std::uint64_t k) const { return order.key(missing.number(k)); }

  /// The first missing tile behind the level and state of the k-th one.
  [[nodiscard]] std::uint64_t end_of_part(std::uint64_t k) const {
    const auto part = [&](std::uint64_t of) { return std::pair{key(of).level, state_of(key(of))}; };
    std::uint64_t same_part = k, later = missing.count();
    while (later - same_part > 1) {
      const std::uint64_t middle = same_part + (later - same_part) / 2;
      (part(middle) == part(k) ? same_part : later) = middle;
    }
    return later;
  }

  /// Opens the file that is being written as of the last commit, if it is read, and was not opened
  /// for some commits.
  Result<void> follow(const FieldWriter& writer) {
    const auto own = written.get();
    const auto read = [&] { return own->field().file().store().transaction(); };
    if (!reads_own_file || (own && writer.transaction() < read() + kCommitsPerReader)) return {};
    auto opened = SLF_TRY(FieldFile::whole(writer.file()));
    written.set(tiles_of(std::move(opened), budget.cache));
    return {};
  }
};

/// Makes and writes the missing tiles [begin, end). Commits every options.commit_seconds. Progress
/// counts rays.
Result<void> write_missing(BuildJob& job, std::uint64_t begin, std::uint64_t end,
                           FieldWriter& writer, const std::string& path,
                           const BuildOptions& options, Reporter& progress) {
  const std::chrono::duration<double> interval(options.commit_seconds);
  auto committed_at = Clock::now();
  const auto new_maker = [&] {
    return [&, traced = TracedTile()](std::uint64_t k) mutable {
      return at_place(guarded([&] { return job.make(job.key(begin + k), traced); }), path);
    };
  };
  const auto put = [&](std::uint64_t k, EncodedTile tile) -> Result<void> {
    const TileKey key = job.key(begin + k);
    SLF_TRY(writer.put(key, std::move(tile.payload), tile.back));
    auto go_on = progress.add(job.tracer.rays(key));
    if (!go_on || Clock::now() - committed_at >= interval) {
      SLF_TRY(writer.commit());
      SLF_TRY(job.follow(writer));
      committed_at = Clock::now();
    }
    return go_on;
  };
  return make_in_order(end - begin, job.budget.threads, job.budget.window, new_maker, put);
}

/// Makes all missing tiles. If tiles are predicted, goes level by level and state by state, because
/// each is predicted from the committed file.
Result<void> write_levels(BuildJob& job, FieldWriter& writer, const std::string& path,
                          const BuildOptions& options, Reporter& progress) {
  for (std::uint64_t begin = 0, end = 0; begin < job.missing.count(); begin = end) {
    end = job.missing.count();
    if (job.reads_own_file) {
      end = job.end_of_part(begin);
      // While a reader is open, each of many commits would take new pages.
      if (state_of(job.key(begin)) > 0) job.written.set({});
      SLF_TRY(writer.commit_level());
      job.written.set({});  // it lacks the level or state before
      SLF_TRY(job.follow(writer));
    }
    SLF_TRY(write_missing(job, begin, end, writer, path, options, progress));
  }
  job.written.set({});
  return {};
}

std::string text_of(const glm::dvec3& v) { return concat(v.x, ",", v.y, ",", v.z); }

/// usage: a state has no name, or that of another.
Result<void> check_names(std::span<const std::pair<std::string, OwnedJson>> states) {
  std::set<std::string> names;
  for (std::size_t k = 0; k < states.size() && states.size() > 1; ++k)
    if (const std::string& name = states[k].first; name.empty() || !names.insert(name).second)
      return fail(ErrorCode::usage, "state ", k, " has ",
                  name.empty() ? "no name" : "the name of another: ", name);
  return {};
}

/// The provenance of a scene.
Result<OwnedJson> provenance_of(const Scene& scene) {
  OwnedJson json = nlohmann::json::parse(scene.provenance(), nullptr, /*allow_exceptions=*/false);
  if (json->is_object()) return json;
  return fail(ErrorCode::usage, "the scene's provenance is not a JSON object");
}

/// The manifest of a new field. usage: a setting, or a scene's bounds or provenance, is invalid.
Result<Manifest> plan(std::span<const FieldState> states, const BuildOptions& options) {
  Manifest manifest;
  manifest.shape = options.shape;
  const bool scene_bounds = manifest.shape.sphere.radius == 0;
  if (scene_bounds) manifest.shape.sphere = bounds_of(states);
  const auto& [center, radius] = manifest.shape.sphere;
  if (auto ok = manifest.shape.check(); !ok)
    return fail(ok.error().code, scene_bounds ? "around the scene's bounds: " : "",
                ok.error().message);
  for (const FieldState& state : states)
    if (const Sphere visible = state.scene->bounds();
        !(glm::distance(center, visible.center) < radius + visible.radius))
      return fail_without(
          "center", ErrorCode::usage, "a sphere of radius ", radius, " around ", text_of(center),
          " misses all that is visible", state.name.empty() ? "" : " of state ", state.name,
          ", which lies around ", text_of(visible.center), " within ", visible.radius);
  manifest.filtered_levels = manifest.shape.levels;
  manifest.format = sample_format(options.half, options.depth);
  const auto plain = SLF_TRY(codec::make_codec(options.codec, manifest.format));
  manifest.codec = plain->spec();
  std::vector<std::pair<std::string, OwnedJson>> provenances;
  for (const FieldState& state : states) {
    auto own = SLF_TRY(provenance_of(*state.scene));
    provenances.emplace_back(state.name, std::move(own));
  }
  SLF_TRY(check_names(provenances));
  manifest.set_states(provenances);
  return manifest;
}

/// What tiles are made of.
struct TileSource {
  std::vector<const Scene*> scenes;  ///< of the states; none if tiles are read
  TileTracer::Read read;
  CodecPointer codec;               ///< if tiles are read
  ByteSpan light;                   ///< that the field keeps, if tiles are read
  std::vector<std::string> inputs;  ///< files that must not be replaced

  [[nodiscard]] TileTracer tracer(const Manifest& manifest) const {
    return scenes.empty() ? TileTracer(read, manifest) : TileTracer(scenes, manifest);
  }
};

Result<BuildReport> build(TileSource source, Manifest manifest, const std::string& path,
                          const BuildOptions& options, const ProgressCallback& progress) {
  std::vector<std::string> inputs = source.inputs;
  inputs.push_back(options.shard.coarser);
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, inputs));
  const auto budget = SLF_TRY(
      WriteBudget::divide(options.memory, manifest.shape, thread_count(options.threads), path));
  const TileOrder order(manifest.shape);
  ShardOptions shard = options.shard;
  const auto coarser = SLF_TRY(open_coarser(manifest, shard));
  const auto plan = SLF_TRY(
      plan_shard(source.tracer(manifest), manifest.shape, shard, predicts(manifest) && !coarser));
  if (plan.part != all_keys(manifest.shape)) manifest.part = plan.part;
  std::optional<EarlierBuild> earlier;
  if (!source.read) earlier = SLF_TRY(find_earlier_build(output, plan.tiles, manifest));

  const TileTracer tracer = source.tracer(manifest);
  BuildReport report;
  if (earlier) {
    report.resumed = plan.tiles.count() - earlier->missing.count();
    if (earlier->in_place && earlier->missing.count() == 0) return report;
  }
  const MissingTiles missing = earlier ? std::move(earlier->missing) : MissingTiles(plan.tiles);
  Progress state;
  state.total = count_rays(tracer, order, manifest.shape, plan.tiles);
  state.skipped = state.total - count_rays(tracer, order, manifest.shape, missing.numbers());
  state.done = state.skipped;
  const std::string file = earlier && earlier->in_place ? output.target : output.unfinished();
  Reporter reporter(
      progress, state,
      path + (source.read ? ": repack interrupted; nothing was written"
                          : ": interrupted; the same build goes on from here (" + file + ")"));
  const GoOn go_on = [&] { return reporter.go_on(); };
  // Light is computed once, and kept in the file from its first commit on.
  bool has_light = source.scenes.empty();
  Bytes light(source.light.begin(), source.light.end());
  if (!has_light) {
    const Scene& first = *source.scenes[0];
    has_light = earlier && first.set_light(earlier->light);
    const Bytes known = SLF_TRY(coarser ? light_of(*coarser) : Bytes());
    if (!has_light) first.set_light(known);
    for (const Scene* scene : source.scenes) SLF_TRY(scene->prepare());
    if (!has_light) light = first.light();
  }
  if (earlier) source.codec = std::move(earlier->codec);
  const auto codec = SLF_TRY(source.codec ? Result<CodecPointer>(std::move(source.codec))
                             : coarser    ? codec_of(*coarser)
                                          : train_codec(tracer, manifest, go_on));
  const auto draft = source.read ? FieldWriter::Draft::discard : FieldWriter::Draft::keep;
  auto writer =
      SLF_TRY(!earlier ? FieldWriter::create(output, draft, manifest, codec->tables(), light)
              : earlier->in_place ? FieldWriter::edit(path, earlier->transaction)
                                  : FieldWriter::resume(output, earlier->transaction));
  writer.set_pending_limit(budget.pending);
  if (earlier && !light.empty()) SLF_TRY(writer.put_light(light));

  SameTiles same(tracer, order, plan.tiles, manifest.shape.states);
  BuildJob job{tracer,
               *codec,
               missing,
               order,
               budget,
               same,
               tiles_of(coarser, budget.cache),
               predicts(manifest) && (!coarser || manifest.shape.states > 1)};
  auto written = write_levels(job, writer, path, options, reporter);
  // What was written in place ends with an index even so.
  if (!written && written.error().code == ErrorCode::cancelled && earlier && earlier->in_place)
    SLF_TRY(writer.finish());
  SLF_TRY(std::move(written));
  SLF_TRY(writer.finish(go_on));
  report.tiles = missing.count();
  return report;
}

}  // namespace

Sphere bounds_of(std::span<const FieldState> states) {
  const Sphere first = states[0].scene->bounds();
  if (states.size() == 1) return first;
  Sphere all = first;  // around the spheres of all
  for (const FieldState& state : states.subspan(1)) {
    const auto [center, radius] = state.scene->bounds();
    const double apart = glm::distance(all.center, center);
    if (apart + all.radius <= radius) {
      all = {center, radius};
    } else if (apart + radius > all.radius) {
      const double half = (apart + all.radius + radius) / 2;
      all = {all.center + (half - all.radius) / apart * (center - all.center), half};
    }
  }
  const auto around = [&](const glm::dvec3& center) {
    double reach = 0;
    for (const FieldState& state : states) reach = std::max(reach, state.scene->reach(center));
    return Sphere{center, reach};
  };
  const Sphere same_center = around(first.center);
  if (same_center.radius <= first.radius) return first;
  const Sphere between = around(all.center);
  return same_center.radius <= between.radius ? same_center : between;
}

Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                const BuildOptions& options, const ProgressCallback& progress) {
  const FieldState state{"", &scene};
  return build_field({&state, 1}, path, options, progress);
}

Result<BuildReport> build_field(std::span<const FieldState> states, const std::string& path,
                                const BuildOptions& options, const ProgressCallback& progress) {
  try {
    if (states.empty()) return misuse(path, "no state to build");
    auto manifest = SLF_TRY(plan(states, options));
    TileSource source;
    for (const FieldState& state : states) {
      source.scenes.push_back(state.scene);
      for (const std::string& file : state.scene->files()) source.inputs.push_back(file);
    }
    return build(std::move(source), std::move(manifest), path, options, progress);
  } catch (...) {  // from the scene, or std::bad_alloc
    const Error error = error_of_exception();
    return fail(error.code, path, ": ", error.message);
  }
}

namespace {

/// What two fields must have in common to be states of one.
OwnedJson rays_of(const FieldFile& field) {
  Manifest manifest = field.manifest();
  manifest.states.clear();
  manifest.provenance = nlohmann::json::object();
  manifest.codec.clear();
  manifest.part.reset();
  return manifest.to_json();
}

/// All states of the one field that these are, in this order, if it has this manifest; else null.
Result<std::shared_ptr<const FieldFile>> whole_of(std::span<const StateSource> states,
                                                  const Manifest& manifest) {
  const auto& first = states[0].field.file().store();
  for (unsigned k = 0; k < states.size(); ++k)
    if (const FieldFile& file = states[k].field.file();
        file.path() != first.path() || file.store().transaction() != first.transaction() ||
        file.state() != k)
      return nullptr;
  auto whole = SLF_TRY(FieldFile::open(first, FieldFile::kAllStates));
  return whole->manifest().to_json() == manifest.to_json() ? whole : nullptr;
}

/// The decoded tiles of the states that are read. They are read one after the other, so two caches
/// are enough: the threads that are ahead may have begun the next state.
class StateTiles {
 public:
  StateTiles(std::span<const StateSource> states, std::uint64_t memory)
      : states_(states), memory_(memory) {}

  [[nodiscard]] std::shared_ptr<TileCache> of(std::size_t state) {
    const FieldFile& field = states_[state].field.file();
    const std::lock_guard lock(mutex_);
    auto& cache = caches_[state % caches_.size()];
    if (!cache || &cache->field() != &field)
      cache = std::make_shared<TileCache>(field, memory_ / 12 / caches_.size());
    return cache;
  }

 private:
  const std::span<const StateSource> states_;
  const std::uint64_t memory_;
  std::mutex mutex_;
  std::array<std::shared_ptr<TileCache>, 2> caches_;
};

Result<RepackReport> join(std::span<const StateSource> states, const std::string& path,
                          const RepackOptions& options, const ProgressCallback& progress) {
  if (states.empty()) return misuse(path, "no state to copy");
  TileSource source;
  std::vector<std::pair<std::string, OwnedJson>> provenances;
  for (const StateSource& state : states) {
    SLF_TRY(check_not_composed(state.field));
    const FieldFile& field = state.field.file();
    const FieldFile& first = states[0].field.file();
    if (rays_of(field) != rays_of(first))
      return misuse(field.path(), "has another sphere, lattice or format than ", first.path());
    if (field.manifest().part)
      return misuse(field.path(), "is a part of a field; merge the parts first");
    source.inputs.push_back(field.path());
    provenances.emplace_back(state.name, field.manifest().provenance_of(field.state()));
  }
  SLF_TRY(check_names(provenances));
  StateTiles inputs(states, options.memory);
  auto planned = SLF_TRY(plan_repack(*inputs.of(0), options));
  const FieldFile& first = states[0].field.file();
  Manifest manifest = first.manifest();
  manifest.shape = planned.shape;
  manifest.format = planned.format;
  manifest.codec = planned.codec->spec();
  manifest.set_states(provenances);
  const auto whole = SLF_TRY(whole_of(states, manifest));
  if (whole) return repack_file(*whole, path, options, progress);
  source.light = SLF_TRY(kept_light(first, options));
  source.codec = std::move(planned.codec);
  source.read = [&](TileKey key, TracedTile& tile) -> Result<void> {
    const auto cache = inputs.of(state_of(key));
    const TileKey own = in_state(key, 0);
    tile.key = key;
    const FieldFile& field = cache->field();
    const auto found = SLF_TRY(field.store().find(own));
    if (found.state == TileState::missing)
      return fail(ErrorCode::tile_missing, field.place(own), " is missing; build it first");
    tile.empty = found.state == TileState::empty;
    return tile.empty ? Result<void>() : convert_samples(*cache, planned, own, tile.samples);
  };
  BuildOptions build_options;
  build_options.memory = options.memory;
  build_options.threads = options.threads;
  build_options.replace = options.replace;
  const auto built =
      SLF_TRY(build(std::move(source), std::move(manifest), path, build_options, progress));
  const auto written = SLF_TRY(FieldFile::whole(path));
  const auto content = SLF_TRY(written->content());
  return RepackReport{built.tiles + built.resumed, 0, built.tiles, 0, content.payload_bytes,
                      content.file_bytes};
}

}  // namespace

Result<RepackReport> join_states(std::span<const StateSource> states, const std::string& path,
                                 const RepackOptions& options, const ProgressCallback& progress) {
  if (states.size() == 1) return repack_field(states.front().field, path, options, progress);
  return guarded([&] { return join(states, path, options, progress); });
}

}  // namespace slf
