#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/write/repack_plan.h"
#include "field/write/size_estimate.h"
#include "field/write/write_budget.h"
#include "slf/repack.h"

namespace slf {
namespace {

using storage::TileState;

constexpr std::uint64_t kSample = 400;  // tiles that are encoded per level

/// The exact size of copied tiles, from the tables of the records.
Result<SizeEstimate> count(const Field& handle, const FieldShape& shape) {
  const FieldFile& field = handle.file();
  SizeEstimate sum;
  const auto add = [&](const storage::TileRef& found) -> Result<void> {
    if (!shape.has(in_state(found.key, 0))) return {};
    const auto tile =
        SLF_TRY(found.state == TileState::same ? field.store().find(found.key) : found);
    if (tile.state != TileState::stored) return {};
    sum.bytes += static_cast<double>(tile.payload.size() - (field.coder().uses_states() ? 1 : 0));
    ++sum.stored;
    return {};
  };
  for (unsigned level = 0; level <= shape.levels; ++level) {
    const auto [begin, end] = keys_of(level, handle.state());
    SLF_TRY(field.store().visit(begin, end, add));
  }
  return sum;
}

}  // namespace

Result<RepackEstimate> estimate_repack(const Field& handle, const RepackOptions& options,
                                       const ProgressCallback& progress) try {
  const StateSource state{"", handle};
  const auto plan = SLF_TRY(plan_repack({&state, 1}, options, 4 * cache_share(options.memory)));
  const FieldShape& shape = plan.manifest.shape;
  const TileOrder order(shape);
  Progress work;
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level)
    work.total += std::min(kSample, shape.tiles(level));
  Reporter reporter(progress, work, "estimate interrupted");
  const auto codec =
      SLF_TRY(plan.codec(thread_count(options.threads), [&] { return reporter.go_on(); }));
  const TileCoder coder(shape, plan.manifest.format, *codec, plan.geometries());

  SizeEstimate total;
  if (plan.copy) total = SLF_TRY(count(handle, shape));
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level) {
    const auto sampled =
        SLF_TRY(at_place(sample_tiles(*plan.source, coder, order, order.level(level), kSample,
                                      thread_count(options.threads), reporter),
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
