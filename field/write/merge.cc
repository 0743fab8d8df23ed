#include "slf/merge.h"

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/write/field_writer.h"
#include "field/write/merge_plan.h"
#include "field/write/write_budget.h"

namespace slf {
namespace {

using storage::TileRef;
using storage::TileState;

constexpr std::uint64_t kBatch = 128;  // tiles that a thread takes at a time

/// Of a tile in the map, at most.
std::uint64_t mapped_bytes(const FieldShape& shape) { return shape.max_tile_samples() * 8 + 4096; }

/// Copies the tiles of a plan to a writer. Threads check the tiles in the map; the writer then
/// copies them from the map into the pages that it writes.
class Merger {
 public:
  Merger(const MergePlan& plan, const std::vector<std::string>& paths, const MergeOptions& options,
         FieldWriter& writer, Reporter& progress)
      : plan_(plan),
        paths_(paths),
        writer_(writer),
        progress_(progress),
        order_(plan.manifest.shape) {
    // A third of the budget each: mapped tiles in progress; records waiting for their commit, which
    // are mapped as well; LMDB's copies of their pages.
    const std::uint64_t share = options.memory / 3;
    writer.set_pending_limit(share);
    mapped_limit_ = share / 2;
    const std::uint64_t tile_cost = mapped_bytes(plan.manifest.shape);
    batch_ = std::clamp<std::uint64_t>(share / tile_cost / 4, 1, kBatch);
    const std::uint64_t batches = std::max<std::uint64_t>(1, share / (batch_ * tile_cost));
    threads_ =
        static_cast<unsigned>(std::min<std::uint64_t>(batches, thread_count(options.threads)));
    window_ = std::min<std::uint64_t>(batches, 4 * threads_);
  }

  Result<void> write() {
    for (const MergeSegment& segment : plan_.segments) SLF_TRY(write(segment));
    return writer_.finish([&] { return progress_.go_on(); });
  }

  [[nodiscard]] const MergeReport& report() const { return report_; }

 private:
  Result<void> write(const MergeSegment& segment) {
    const std::string& path = paths_[segment.source];
    const auto part = SLF_TRY(storage::TileStore::open(path));
    if (part.transaction() != plan_.commits[segment.source])
      return fail(ErrorCode::failed, path, ": was changed while it was merged; merge again");
    const NumberRange all = segment.tiles;
    const std::uint64_t batches = (all.count() + batch_ - 1) / batch_;
    const auto new_maker = [&] {
      return [&](std::uint64_t k) {
        const std::uint64_t begin = all.begin + k * batch_;
        return checked(part, {begin, std::min(begin + batch_, all.end)});
      };
    };
    std::uint64_t mapped = 0;
    const auto put = [&](std::uint64_t, const std::vector<TileRef>& tiles) -> Result<void> {
      for (const TileRef& tile : tiles) {
        ++report_.tiles;
        SLF_TRY(writer_.put_view(tile));
        if (tile.source != tile.key) continue;
        report_.payload_bytes += tile.payload.size();
        mapped += tile.payload.size();
      }
      if (mapped > mapped_limit_) {
        part.release_all();  // pages that were read stay in the kernel's cache
        mapped = 0;
      }
      return progress_.add(tiles.size());
    };
    SLF_TRY(make_in_order(batches, threads_, window_, new_maker, put));
    writer_.copy_viewed_payloads();  // `part` is closed on return
    return part.unchanged();
  }

  /// The tiles of a range, checked.
  [[nodiscard]] Result<std::vector<TileRef>> checked(const storage::TileStore& part,
                                                     NumberRange range) const {
    std::vector<TileKey> keys;
    for (std::uint64_t n = range.begin; n < range.end; ++n) keys.push_back(order_.key(n));
    std::vector<TileRef> tiles;
    for (const auto& found : part.find_all(keys)) {
      if (!found) return tl::unexpected(found.error());
      if (found->state == TileState::missing)
        return fail(ErrorCode::failed, part.path(), ": tile ", storage::name(found->key),
                    " is missing");
      tiles.push_back(*found);
    }
    part.advise(tiles);
    for (const TileRef& tile : tiles)
      if (tile.source == tile.key) SLF_TRY(part.check(tile));
    return tiles;
  }

  const MergePlan& plan_;
  const std::vector<std::string>& paths_;
  FieldWriter& writer_;
  Reporter& progress_;
  TileOrder order_;
  MergeReport report_;
  std::uint64_t mapped_limit_ = 0;
  std::uint64_t batch_ = 1;
  std::size_t window_ = 1;
  unsigned threads_ = 1;
};

}  // namespace

Result<MergeReport> merge_fields(const std::vector<std::string>& parts, const std::string& path,
                                 const MergeOptions& options, const ProgressCallback& progress) {
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, parts));
  const auto plan = SLF_TRY(plan_merge(parts, options.part));
  SLF_TRY(check_memory(options.memory, 3 * mapped_bytes(plan.manifest.shape), path));
  Progress begin;
  for (const MergeSegment& segment : plan.segments) begin.total += segment.tiles.count();
  Reporter reporter(progress, begin, "merge interrupted; nothing was written");
  SLF_TRY(reporter.add(0));
  auto writer = SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, plan.manifest,
                                            plan.tables, plan.light));
  Merger merger(plan, parts, options, writer, reporter);
  SLF_TRY(merger.write());
  MergeReport report = merger.report();
  report.file_bytes = file_size(output.target).value_or(0);
  return report;
}

}  // namespace slf
