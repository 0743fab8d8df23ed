#include "slf/build.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/predict/references.h"
#include "field/write/plan_build.h"
#include "field/write/tile_tracer.h"
#include "field/write/train_codec.h"
#include "field/write/write_tiles.h"

namespace slf {
namespace {

/// The tiles that one of several builds of a field makes.
///
/// The positions of a field's tiles in key order are cut into ranges of equal work, counted in
/// rays. The cuts depend on the settings alone, so builds on different machines agree on them, and
/// the cuts of N ranges are among those of 2N: a range can be built as two halves. A shard has the
/// tiles of all states at its positions, so the tiles that one equals or is predicted from are with
/// it.
///
/// A tile of a predictive codec is predicted from tiles of the next coarser level. A build that has
/// no other file to read these from also makes all of them that it may need. It stores them in its
/// file, but they do not belong to its part (doc/decisions/cluster.md).
struct ShardPlan {
  TileRange part;       ///< the part of the field that the build is for
  TileSelection tiles;  ///< all tiles to build: the part, and those it is predicted from
};

/// Calls f for each number of a range. There may be billions: asks now and then whether to go on.
template <class F>
Result<void> for_each_number(NumberRange range, const GoOn& go_on, const F& f) {
  constexpr std::uint64_t kAsks = 1 << 16;
  for (std::uint64_t n = range.begin; n < range.end; ++n) {
    if ((n - range.begin) % kAsks == kAsks - 1 && !go_on())
      return fail(ErrorCode::cancelled, "interrupted; nothing was written");
    f(n);
  }
  return {};
}

/// Wide enough for the rays of all tiles times a number of shards.
__extension__ using Wide = unsigned __int128;

/// More make no sense: the largest level of a predictive codec has a quarter of them.
constexpr std::uint64_t kMaxTiles = std::uint64_t{1} << 32;

/// The positions of a shard. It begins at the first that has at least (index - 1) / count of all
/// rays before it, and ends before the first that has at least index / count before it.
Result<NumberRange> cut(const TileTracer& tracer, const TileOrder& order, NumberRange all,
                        const ShardOptions& options, const GoOn& go_on) {
  if (options.count == 1) return all;
  Wide total = 0;
  SLF_TRY(
      for_each_number(all, go_on, [&](std::uint64_t n) { total += tracer.rays(order.key(n)); }));
  NumberRange shard{all.end, all.end};
  Wide before = 0;
  SLF_TRY(for_each_number(all, go_on, [&](std::uint64_t n) {
    if (shard.begin == all.end && before * options.count >= total * (options.index - 1))
      shard.begin = n;
    if (shard.end == all.end && options.index < options.count &&
        before * options.count >= total * options.index)
      shard.end = n;
    before += tracer.rays(order.key(n));
  }));
  return shard;
}

/// The positions of a part, and of all tiles from which its tiles may be predicted: on each level,
/// those of certain entry sections.
Result<TileSelection> with_needed(const TileTracer& tracer, const TileOrder& order,
                                  const FieldShape& shape, NumberRange part, const GoOn& go_on) {
  const auto entry_of = [&](std::uint64_t n) {
    return sections_of(order.key(n), shape.entry_extra_levels).entry.index;
  };
  std::vector<std::vector<bool>> needed(shape.finest_level + 1);  // per level and entry section
  for (unsigned level = shape.finest_level; level > 0; --level) {
    std::vector<bool> dependent = needed[level];
    dependent.resize(section_count(level + shape.entry_extra_levels));
    SLF_TRY(for_each_number(part.within(order.level(level)), go_on,
                            [&](std::uint64_t n) { dependent[entry_of(n)] = true; }));
    needed[level - 1].resize(section_count(level - 1 + shape.entry_extra_levels));
    for (std::uint32_t entry = 0; entry < dependent.size(); ++entry)
      if (dependent[entry])
        for (const std::uint32_t section :
             find_references(tracer.geometry(level - 1), tracer.geometry(level), entry).sections)
          needed[level - 1][section] = true;
  }
  TileSelection tiles;
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    const NumberRange all = order.level(level), own = part.within(all);
    if (std::ranges::find(needed[level], true) == needed[level].end())
      tiles.add(own);
    else
      SLF_TRY(for_each_number(all, go_on, [&](std::uint64_t n) {
        if ((n >= own.begin && n < own.end) || needed[level][entry_of(n)]) tiles.add({n, n + 1});
      }));
  }
  return tiles;
}

/// usage: no such shard or level, or levels with more tiles than anybody builds.
Result<void> check_shard(const FieldShape& shape, const ShardOptions& options) {
  if (options.count == 0 || options.index == 0 || options.index > options.count)
    return fail(ErrorCode::usage, "shard ", options.index, "/", options.count,
                ": expected K/N with K from 1 to N");
  const unsigned first = options.first_level.value_or(0);
  const unsigned last = options.last_level.value_or(shape.finest_level);
  if (first > last || last > shape.finest_level)
    return fail(ErrorCode::usage, "levels ", first, " to ", last, ": the field has levels 0 to ",
                shape.finest_level);
  const std::uint64_t tiles = TileOrder(one_state(shape)).count();
  if (tiles > kMaxTiles / shape.states)
    return fail_without("levels", ErrorCode::usage, "levels ", shape.finest_level, ": ", tiles,
                        " tiles of each state, expected at most ", kMaxTiles / shape.states,
                        "; choose fewer levels, and tiles of more samples");
  return {};
}

/// `predicted`: tiles are predicted from tiles that the same build makes. cancelled: stopped by
/// `go_on`. REQUIRES: check_shard().
Result<ShardPlan> plan_shard(const TileTracer& tracer, const FieldShape& shape,
                             const ShardOptions& options, bool predicted, const GoOn& go_on) {
  const TileOrder order(one_state(shape));
  const NumberRange levels{order.first_number(options.first_level.value_or(0)),
                           order.first_number(options.last_level.value_or(shape.finest_level) + 1)};
  const NumberRange part = SLF_TRY(cut(tracer, order, levels, options, go_on));
  ShardPlan plan;
  plan.part = {order.key_or_end(part.begin), order.key_or_end(part.end)};
  TileSelection positions;
  if (predicted && part.begin > 0)
    positions = SLF_TRY(with_needed(tracer, order, shape, part, go_on));
  else  // the part has all coarser levels, if they are needed
    positions.add(part);
  for_each_state(shape, positions.ranges(),
                 [&](std::size_t, NumberRange numbers) { plan.tiles.add(numbers); });
  return plan;
}

using CodecPointer = std::unique_ptr<codec::Codec>;

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
  TileSelection missing;
  std::uint64_t transaction = 0;  ///< the commit that was read
  CodecPointer codec;
  KeptBlobs kept;         ///< by the file, but for what is damaged
  bool in_place = false;  ///< it has the output's name, not that of a draft
};

/// What a field keeps, but for what is damaged, since that can be made again.
Result<KeptBlobs> kept_of(const FieldFile& field) {
  KeptBlobs kept;
  for (const char* blob : {kLightBlob, kRevealBlob}) {
    const auto bytes = field.kept(blob);
    if (!bytes && bytes.error().code != ErrorCode::bad_file) return tl::unexpected(bytes.error());
    if (bytes) kept[blob].assign(bytes->begin(), bytes->end());
  }
  return kept;
}

/// The selected tiles that are missing in a field. bad_file: a record cannot be read.
Result<TileSelection> missing_tiles(const FieldFile& field, const TileSelection& selection) {
  const TileOrder order(field.shape());
  TileSelection found;
  SLF_TRY(field.store().visit({0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
    const std::uint64_t number = order.number(tile.key);
    if (field.shape().has(tile.key)) found.add({number, number + 1});
    return {};
  }));
  return selection.without(found);
}

/// Finds an earlier build: the output itself if it exists and is to be kept, else its draft. Sets
/// manifest.filtered_levels and keeps_rays to those of the build found.
Result<std::optional<EarlierBuild>> find_earlier_build(const FieldOutput& output,
                                                       const TileSelection& selection,
                                                       Manifest& manifest) {
  const bool in_place = output.existing == Existing::keep && output.exists();
  const std::string file = in_place ? output.path : output.unfinished();
  std::error_code ignored;
  if (!in_place && std::filesystem::is_symlink(file, ignored))
    return name_is_taken({ErrorCode::usage, file + ": is a link"});
  if (!in_place && !std::filesystem::exists(file, ignored)) return std::nullopt;
  const auto field = FieldFile::open(file);
  if (!field && field.error().code == ErrorCode::not_found) return std::nullopt;  // by now
  if (!field && in_place) return tl::unexpected(field.error());
  if (!field) return name_is_taken(field.error());
  const Manifest& existing = (*field)->manifest();
  SLF_TRY(check_same(file, existing, manifest,
                     in_place ? "choose another output, or replace it"
                              : "complete it with its own settings, or move or remove it"));
  manifest.filtered_levels = existing.filtered_levels;
  manifest.keeps_rays = existing.keeps_rays;
  auto missing = SLF_TRY(missing_tiles(**field, selection));
  auto codec = SLF_TRY(codec_of(**field));
  auto kept = SLF_TRY(kept_of(**field));
  return EarlierBuild{std::move(missing), (*field)->store().transaction(), std::move(codec),
                      std::move(kept), in_place};
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
  auto field = SLF_TRY(FieldFile::open(options.coarser));
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

/// Computes the scenes' light, unless an earlier build or another part kept it. Returns what is to
/// be kept; none if the earlier build has it.
Result<Bytes> prepare(std::span<const FieldState> states, bool keep, EarlierBuild* earlier,
                      const FieldFile* coarser) {
  const Scene& first = *states[0].scene;
  const bool kept = earlier && first.set_light(earlier->kept[kLightBlob]);
  if (coarser && !kept) {
    auto others = SLF_TRY(kept_of(*coarser));
    first.set_light(others[kLightBlob]);
  }
  for (const FieldState& state : states) SLF_TRY(state.scene->prepare());
  return keep && !kept ? first.light() : Bytes();
}

Result<BuildReport> build(std::span<const FieldState> states, const std::string& path,
                          const BuildOptions& options, const ProgressCallback& progress) {
  if (states.empty()) return misuse(path, "no state to build");
  auto manifest = SLF_TRY(plan_build(states, options));
  std::vector<const Scene*> scenes;
  std::vector<std::string> inputs{options.shard.coarser};
  for (const FieldState& state : states) {
    scenes.push_back(state.scene);
    std::ranges::move(state.scene->files(), std::back_inserter(inputs));
  }
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, inputs));
  const auto budget =
      SLF_TRY(WriteBudget::divide(options.memory, manifest.shape, thread_count(options.threads),
                                  /*copies=*/false, path));
  ShardOptions shard = options.shard;
  const auto coarser = SLF_TRY(open_coarser(manifest, shard));
  SLF_TRY(check_shard(manifest.shape, shard));
  const auto [part, tiles] = SLF_TRY(plan_shard(TileTracer(scenes, manifest), manifest.shape, shard,
                                                predicts(manifest) && !coarser, [&] {
                                                  return !progress || progress({0, 1});
                                                }));
  if (part != all_keys(manifest.shape)) manifest.part = part;
  auto earlier = SLF_TRY(find_earlier_build(output, tiles, manifest));
  const bool in_place = earlier && earlier->in_place;
  const TileSelection missing = earlier ? earlier->missing : tiles;
  BuildReport report{.memory = budget.memory};
  report.resumed = tiles.count() - missing.count();
  const bool reveals =
      !options.reveal.empty() && !(earlier && earlier->kept[kRevealBlob] == options.reveal);
  if (in_place && missing.count() == 0) {
    if (reveals) SLF_TRY(set_reveal(path, options.reveal));
    return report;
  }

  const TileTracer tracer(scenes, manifest, path);
  const TileOrder order(manifest.shape);
  Progress begin;
  begin.total = count_rays(tracer, order, manifest.shape.finest_level, tiles);
  begin.skipped = begin.total - count_rays(tracer, order, manifest.shape.finest_level, missing);
  begin.done = begin.skipped;
  const std::string file = in_place ? output.target : output.unfinished();
  Reporter reporter(progress, begin,
                    path + ": interrupted; the same build goes on from here (" + file + ")");
  const GoOn go_on = [&] { return reporter.go_on(); };
  auto light =
      SLF_TRY(prepare(states, options.keep_light, earlier ? &*earlier : nullptr, coarser.get()));
  const KeptBlobs kept{{kLightBlob, std::move(light)},
                       {kRevealBlob, reveals ? options.reveal : Bytes()}};
  const auto geometries = [&](unsigned level) -> const LevelGeometry& {
    return tracer.geometry(level);
  };
  KeptTiles source(tracer, budget.cache);  // with what others would use for a field as input
  const auto codec =
      SLF_TRY(earlier   ? Result<CodecPointer>(std::move(earlier->codec))
              : coarser ? codec_of(*coarser)
                        : train_codec(source, geometries, manifest, budget.threads, go_on));
  source.stop_keeping();
  auto writer = SLF_TRY(!earlier   ? FieldWriter::create(output, FieldWriter::Draft::keep, manifest,
                                                         codec->tables(), kept)
                        : in_place ? FieldWriter::edit(path, earlier->transaction)
                                   : FieldWriter::resume(output, earlier->transaction));
  for (const auto& [blob, bytes] : kept)
    if (earlier && !bytes.empty()) SLF_TRY(writer.keep(blob, bytes));

  const TileCoder coder(manifest.shape, manifest.format, *codec, geometries, states.size() > 1,
                        manifest.keeps_rays);
  WritePlan plan{manifest, budget, &coder, tiles, {}, options.commit_seconds};
  if (coarser) plan.coarser.emplace(Field::of(coarser), TileReaderOptions{budget.cache});
  const auto written = write_tiles(source, plan, missing, writer, reporter);
  // What was written in place ends with an index even so.
  if (!written && written.error().code == ErrorCode::cancelled && in_place)
    SLF_TRY(writer.finish());
  if (!written) return tl::unexpected(written.error());
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

Result<void> set_reveal(const std::string& path, std::span<const std::byte> code) {
  return guarded([&]() -> Result<void> {
    auto field = SLF_TRY(FieldFile::open(path));
    const std::uint64_t transaction = field->store().transaction();
    field.reset();
    auto writer = SLF_TRY(FieldWriter::edit(path, transaction));
    SLF_TRY(writer.keep(kRevealBlob, code));
    return writer.finish();
  });
}

Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                const BuildOptions& options, const ProgressCallback& progress) try {
  const FieldState state{"", &scene};
  return build_field({&state, 1}, path, options, progress);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<BuildReport> build_field(std::span<const FieldState> states, const std::string& path,
                                const BuildOptions& options, const ProgressCallback& progress) try {
  return build(states, path, options, progress);
} catch (...) {  // from the scene, or std::bad_alloc
  return tl::unexpected(error_of_exception(path));
}

}  // namespace slf
