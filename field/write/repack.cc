#include "slf/repack.h"

#include <filesystem>
#include <memory>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/write/size_estimate.h"
#include "field/write/train_codec.h"
#include "field/write/write_budget.h"
#include "field/write/write_tiles.h"

namespace slf {
namespace {

/// What a repack makes of some states, and how.
struct RepackPlan {
  const FieldFile& first;  ///< of the first state
  Manifest manifest;
  std::unique_ptr<TileSource> source;
  bool copy = false;  ///< payloads are copied, not encoded again
  KeptBlobs kept;     ///< by the copy

  [[nodiscard]] TileCoder::Geometries geometries() const {
    return
        [&first = first](unsigned level) -> const LevelGeometry& { return first.geometry(level); };
  }
  /// The codec of the copy. Errors of train_codec().
  [[nodiscard]] Result<std::unique_ptr<codec::Codec>> codec(unsigned threads,
                                                            const GoOn& go_on) const {
    if (copy) return codec::make_codec(manifest.codec, manifest.format, first.codec().tables());
    return train_codec(*source, geometries(), manifest, threads, go_on);
  }
};

Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options) {
  FieldShape shape = field.shape();
  if (options.finest_level && *options.finest_level > shape.finest_level)
    return misuse(field.path(), "has levels 0 to ", shape.finest_level, ", not ",
                  *options.finest_level);
  if (options.finest_level) shape.finest_level = *options.finest_level;
  for (const std::uint8_t subfield : options.subfields)
    if (!field.shape().has({0, std::uint64_t{subfield} << (2 * shape.entry_extra_levels)}))
      return misuse(field.path(), "has no subfield ", int{subfield});
  if (!options.subfields.empty()) shape.subfields = options.subfields;
  SLF_TRY(shape.check());
  return shape;
}

/// The codec's specification.
Result<std::string> plan_codec(const FieldFile& field, SampleFormat format,
                               const RepackOptions& options) {
  const std::string codec = options.codec.empty() ? field.codec().spec() : options.codec;
  auto plain = codec::make_codec(codec, format);
  if (!plain && options.codec.empty() && is_half(format) && !is_half(field.format()))
    plain = codec::make_codec("zstd", format);  // JPEG stores no half floats
  return plain.map([](const auto& made) { return made->spec(); });
}

/// What fields must have in common to be states of one.
OwnedJson rays_of(const FieldFile& field) {
  Manifest rays;
  rays.shape = field.shape();
  rays.filtered_levels = field.manifest().filtered_levels;
  rays.format = field.format();
  return rays.to_json();
}

Result<void> check_joinable(std::span<const StateSource> states) {
  const FieldFile& first = states[0].field.file();
  for (const StateSource& state : states) {
    const FieldFile& field = state.field.file();
    if (rays_of(field) != rays_of(first))
      return misuse(field.path(), "has another sphere, lattice or format than ", first.path());
    if (field.manifest().part)
      return misuse(field.path(), "is a part of a field; merge the parts first");
  }
  return {};
}

/// Whether these are all states of one field, in its order.
bool are_one_field(std::span<const StateSource> states) {
  const FieldFile& first = states[0].field.file();
  for (std::size_t k = 0; k < states.size(); ++k)
    if (const FieldFile& file = states[k].field.file();
        states[k].field.structures() || file.path() != first.path() ||
        states[k].field.state() != k || file.store().transaction() != first.store().transaction())
      return false;
  return states.size() == first.manifest().states.size();
}

/// Whether payloads can be copied: one file has them, and the tiles that they are predicted from.
bool can_copy(std::span<const StateSource> states, const FieldShape& shape) {
  const FieldFile& first = states[0].field.file();
  const bool several = states.size() > 1;
  if (states[0].field.structures() || (several && !are_one_field(states))) return false;
  if (!first.predicts()) return true;
  const bool whole_levels = shape.subfields == first.shape().subfields;
  return whole_levels && (several ? shape.finest_level == first.shape().finest_level
                                  : states[0].field.state() == 0);
}

/// The code of the first reveal of what one of the states shows: others are not to be published.
Result<ByteSpan> revealed(std::span<const StateSource> states) {
  for (const StateSource& state : states) {
    const auto reveal = SLF_TRY(state.field.reveal(RevealPart::head));
    if (reveal) return state.field.file().reveal();
  }
  return ByteSpan();
}

/// Plans a repack of a state, or of several to one field. They must outlive the plan. `memory`:
/// bytes of decoded tiles. Errors as join_states().
Result<RepackPlan> plan_repack(std::span<const StateSource> states, const RepackOptions& options,
                               std::uint64_t memory) {
  const Field& handle = states[0].field;
  RepackPlan plan{handle.file(), handle.file().manifest(), nullptr, false, {}};
  const FieldFile& first = plan.first;
  Manifest& manifest = plan.manifest;
  if (states.size() > 1) SLF_TRY(check_joinable(states));
  manifest.shape = SLF_TRY(plan_shape(first, options));
  manifest.format = sample_format(options.half.value_or(is_half(first.format())),
                                  options.depth && first.has_depth());
  manifest.codec = SLF_TRY(plan_codec(first, manifest.format, options));
  std::vector<std::pair<std::string, OwnedJson>> provenances;
  for (const StateSource& state : states)
    provenances.emplace_back(state.name, nlohmann::json::parse(state.field.provenance()));
  SLF_TRY(manifest.set_states(provenances));
  plan.copy = manifest.format == first.format() && manifest.codec == first.codec().spec() &&
              can_copy(states, manifest.shape);
  if (plan.copy) manifest.keeps_rays &= first.manifest().keeps_rays;
  const bool alone = states.size() == 1 && !first.manifest().states.empty();
  if (plan.copy && alone)
    plan.source = std::make_unique<StoredTiles>(first.store(), &first.coder(), handle.state());
  else if (plan.copy)
    plan.source = std::make_unique<StoredTiles>(first.store());
  else
    plan.source = std::make_unique<DecodedTiles>(states, manifest.format, memory);
  const auto keep = [&](const char* blob, const Result<ByteSpan>& bytes) -> Result<void> {
    if (!bytes)
      return fail(bytes.error().code, bytes.error().message, "; a copy can leave the ", blob,
                  " out");
    plan.kept[blob].assign(bytes->begin(), bytes->end());
    return {};
  };
  if (options.light && !handle.structures() && handle.state() == 0)
    SLF_TRY(keep(kLightBlob, first.light()));
  if (options.reveal) SLF_TRY(keep(kRevealBlob, revealed(states)));
  return plan;
}

/// The tiles of a field of these states that there are records of; all others are missing. Those
/// of a composed field are in each of its structures.
Result<TileSelection> recorded(std::span<const StateSource> states, const FieldShape& shape) {
  const TileOrder order(shape), positions(one_state(shape));
  std::vector<TileSelection> of_states;
  for (const StateSource& state : states) {
    const auto sources = sources_of(state.field);
    const Field& source = sources.empty() ? state.field : sources.front();
    auto own = SLF_TRY(source.file().recorded(positions, source.state()));
    of_states.push_back(std::move(own));
  }
  TileSelection tiles;
  for (unsigned level = 0; level <= shape.finest_level; ++level)
    for (std::size_t state = 0; state < states.size(); ++state) {
      const NumberRange all = positions.level(level);
      const std::uint64_t first = order.number(in_state(first_key(level), state));
      for (const NumberRange& range : of_states[state].ranges()) {
        const NumberRange own = range.within(all);
        tiles.add({first + (own.begin - all.begin), first + (own.end - all.begin)});
      }
    }
  return tiles;
}

constexpr std::uint64_t kSample = 400;  // tiles that are encoded per level

/// The exact size of copied tiles, from the tables of the records.
Result<SizeEstimate> count(const Field& handle, const FieldShape& shape) {
  const FieldFile& field = handle.file();
  SizeEstimate sum;
  const auto add = [&](const storage::TileRef& found) -> Result<void> {
    if (!shape.has(in_state(found.key, 0))) return {};
    const auto tile =
        SLF_TRY(found.state == storage::TileState::same ? field.store().find(found.key) : found);
    if (tile.state != storage::TileState::stored) return {};
    sum.bytes += static_cast<double>(tile.payload.size() - (field.coder().uses_states() ? 1 : 0));
    ++sum.stored;
    return {};
  };
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    const auto [begin, end] = keys_of(level, handle.state());
    SLF_TRY(field.store().visit(begin, end, add));
  }
  return sum;
}

Result<RepackReport> repack(std::span<const StateSource> states, const std::string& path,
                            const RepackOptions& options, const ProgressCallback& progress) {
  if (states.empty()) return misuse(path, "no state to copy");
  std::vector<std::string> inputs;
  for (const StateSource& state : states) {
    inputs.push_back(state.field.path());
    for (const Field& source : sources_of(state.field)) inputs.push_back(source.path());
  }
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, inputs));
  const auto plan = SLF_TRY(plan_repack(states, options, cache_share(options.memory)));
  const Manifest& manifest = plan.manifest;
  const auto budget = SLF_TRY(WriteBudget::divide(
      options.memory, manifest.shape, thread_count(options.threads), plan.copy, inputs.front()));
  const auto tiles = SLF_TRY(recorded(states, manifest.shape));
  Reporter reporter(progress, {0, tiles.count(), 0},
                    inputs.front() + ": repack interrupted; nothing was written");
  const GoOn go_on = [&] { return reporter.go_on(); };
  SLF_TRY(reporter.add(0));
  const auto codec = SLF_TRY(plan.codec(budget.threads, go_on));
  auto writer = SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, manifest,
                                            codec->tables(), plan.kept));
  const TileCoder coder(manifest.shape, manifest.format, *codec, plan.geometries(),
                        states.size() > 1, manifest.keeps_rays);
  const auto written =
      SLF_TRY(write_tiles(*plan.source, {manifest, budget, plan.copy ? nullptr : &coder, tiles},
                          tiles, writer, reporter));
  SLF_TRY(writer.finish(go_on));
  RepackReport report;
  report.tiles = written.tiles;
  (plan.copy ? report.copied : report.recoded) = written.tiles;
  report.missing = TileOrder(manifest.shape).count() - written.tiles;
  report.payload_bytes = written.payload_bytes;
  report.file_bytes = file_size(output.target).value_or(0);
  report.input_bytes = states.front().field.file_bytes();
  report.memory = budget.memory;
  return report;
}

}  // namespace

Result<RepackReport> join_states(std::span<const StateSource> states, const std::string& path,
                                 const RepackOptions& options, const ProgressCallback& progress) {
  return guarded([&] { return repack(states, path, options, progress); });
}

Result<RepackReport> repack_field(const Field& field, const std::string& path,
                                  const RepackOptions& options, const ProgressCallback& progress) {
  return guarded([&] {
    const StateSource state{"", field};
    return repack({&state, 1}, path, options, progress);
  });
}

Result<std::vector<StateSource>> state_sources(const Field& field,
                                               std::span<const std::string> chosen) try {
  const std::vector<std::string> names = field.states();
  std::vector<StateSource> states;
  if (chosen.empty() && (names.empty() || field.structures()))
    states.push_back({std::filesystem::path(field.path()).stem(), field});
  else if (field.structures())
    return misuse(field.path(), "is shown with structures, which have states of their own");
  else
    for (const std::string& name : chosen.empty() ? std::span<const std::string>(names) : chosen) {
      const auto one = SLF_TRY(field.in_state(name));
      states.push_back({names.empty() ? "" : names[one.state()], one});
    }
  return states;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<RepackEstimate> estimate_repack(const Field& handle, const RepackOptions& options,
                                       const ProgressCallback& progress) try {
  const StateSource state{"", handle};
  const auto plan = SLF_TRY(plan_repack({&state, 1}, options, 4 * cache_share(options.memory)));
  const FieldShape& shape = plan.manifest.shape;
  const TileOrder order(shape);
  Progress work;
  for (unsigned level = 0; !plan.copy && level <= shape.finest_level; ++level)
    work.total += std::min(kSample, shape.tiles(level));
  Reporter reporter(progress, work, "estimate interrupted");
  const auto codec =
      SLF_TRY(plan.codec(thread_count(options.threads), [&] { return reporter.go_on(); }));
  const TileCoder coder(shape, plan.manifest.format, *codec, plan.geometries());

  const CodedTiles coarser(*plan.source, coder);
  SizeEstimate total;
  if (plan.copy) total = SLF_TRY(count(handle, shape));
  for (unsigned level = 0; !plan.copy && level <= shape.finest_level; ++level) {
    const auto sampled =
        SLF_TRY(at_place(sample_tiles(*plan.source, coarser, coder, order, order.level(level),
                                      kSample, thread_count(options.threads), reporter),
                         handle.path()));
    total += sampled;
  }
  std::size_t kept = codec->tables().size();
  for (const auto& [name, bytes] : plan.kept) kept += bytes.size();
  const FileEstimate file = file_estimate(shape, total, kept);
  RepackEstimate estimate;
  estimate.tiles = order.count();
  estimate.sampled = total.sampled;
  estimate.payload_bytes = static_cast<std::uint64_t>(total.bytes);
  estimate.payload_error_bytes = static_cast<std::uint64_t>(total.error());
  estimate.file_bytes = file.bytes;
  estimate.file_error_bytes = file.error_bytes;
  estimate.input_bytes = handle.file_bytes();
  return estimate;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
