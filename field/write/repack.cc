#include "slf/repack.h"

#include <filesystem>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/write/repack_plan.h"
#include "field/write/write_tiles.h"

namespace slf {
namespace {

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
  for (unsigned level = 0; level <= shape.levels; ++level)
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

}  // namespace slf
