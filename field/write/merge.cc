#include "slf/merge.h"

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/write/merge_plan.h"
#include "field/write/write_tiles.h"

namespace slf {

Result<MergeReport> merge_fields(const std::vector<std::string>& parts, const std::string& path,
                                 const MergeOptions& options,
                                 const ProgressCallback& progress) try {
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, parts));
  const auto plan = SLF_TRY(plan_merge(parts, options.part));
  const auto budget = SLF_TRY(WriteBudget::divide(
      options.memory, plan.manifest.shape, thread_count(options.threads), /*copies=*/true, path));
  Progress begin;
  for (const MergeSegment& segment : plan.segments) begin.total += segment.tiles.count();
  Reporter reporter(progress, begin, "merge interrupted; nothing was written");
  SLF_TRY(reporter.add(0));
  auto writer = SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, plan.manifest,
                                            plan.tables, plan.kept));
  MergeReport report{.parts = parts.size()};
  for (const MergeSegment& segment : plan.segments) {
    const std::string& part = parts[segment.source];
    const auto store = SLF_TRY(storage::TileStore::open(part));
    if (store.transaction() != plan.commits[segment.source])
      return fail(ErrorCode::failed, part, ": was changed while it was merged; merge again");
    TileSelection tiles;
    tiles.add(segment.tiles);
    const auto written = SLF_TRY(write_tiles(
        StoredTiles(store), {plan.manifest, budget, nullptr, tiles}, tiles, writer, reporter));
    if (written.missing > 0)
      return fail(ErrorCode::failed, part, ": ", written.missing, " of its tiles are missing");
    SLF_TRY(store.unchanged());
    report.tiles += written.tiles;
    report.payload_bytes += written.payload_bytes;
  }
  SLF_TRY(writer.finish([&] { return reporter.go_on(); }));
  report.file_bytes = file_size(output.target).value_or(0);
  report.memory = budget.memory;
  return report;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
