#include "slf/repack.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/write/encode_tile.h"
#include "field/write/field_writer.h"
#include "field/write/repack_plan.h"
#include "field/write/write_budget.h"

namespace slf {
namespace {

using storage::TileState;

constexpr std::uint64_t kAdvised = 64;  // tiles per call of advise()

/// An encoded tile, for the writer.
struct RecodedTile {
  TileState state = TileState::missing;
  Bytes payload{};
  std::uint64_t back = 0;  ///< if it is the same as one of an earlier state: how many states back
};

/// Makes a tile of the output. If tiles are predicted, `coarser` has the levels written before.
Result<RecodedTile> recode(TileCache& tiles, TileCache* coarser, const RepackPlan& plan,
                           TileKey key, Bytes& samples) {
  const FieldFile& field = tiles.field();
  const auto found = SLF_TRY(field.store().find(key));
  const bool all_states = plan.shape.states > 1;
  RecodedTile tile{found.state};
  if (all_states) tile.back = state_of(key) - state_of(found.source);
  if (found.state != TileState::stored || tile.back > 0) return tile;
  if (plan.copy) {
    SLF_TRY(field.store().check(found));
    const ByteSpan payload =
        SLF_TRY(all_states ? found.payload : field.coder().without_states(key, found.payload));
    tile.payload.assign(payload.begin(), payload.end());
    return tile;
  }
  auto ok = convert_samples(tiles, plan, key, samples);
  if (!ok && ok.error().code == ErrorCode::tile_missing)  // it is predicted from that
    return RecodedTile{};
  if (ok)
    ok = coarser ? encode_tile(*coarser, nullptr, key, samples, tile.payload)
                 : plan.codec->encode(plan.tile_shape(field, key), samples, nullptr, tile.payload);
  if (!ok) return tl::unexpected(ok.error());
  return tile;
}

/// Prefetches the tiles [begin, end) of `all`, for an input that is not in memory.
void advise(const FieldFile& field, const TileOrder& order, const TileSelection& all,
            std::uint64_t begin, std::uint64_t end) {
  std::vector<TileKey> keys;
  for (std::uint64_t k = begin; k < std::min(end, all.count()); ++k)
    keys.push_back(order.key(all.number(k)));
  (void)field.find(keys);
}

/// Writes the tiles of an output.
class Repacker {
 public:
  Repacker(TileCache& tiles, const RepackPlan& plan, const TileOrder& order, TileSelection all,
           const WriteBudget& budget, FieldWriter& writer, Reporter& progress, RepackReport& report)
      : field_(tiles.field()),
        tiles_(tiles),
        plan_(plan),
        writer_(writer),
        progress_(progress),
        report_(report),
        order_(order),
        all_(std::move(all)),
        predicts_(codec::is_predictive(plan.codec->spec()) && !plan.copy),
        budget_(budget) {
    report.missing = order.count() - all_.count();
    writer.set_pending_limit(budget.pending);
  }

  Result<void> write() {
    for (std::uint64_t begin = 0, end = 0; begin < all_.count(); begin = end) {
      end = all_.count();
      std::optional<TileReader> coarser;
      if (predicts_) {  // level by level: each is predicted from the one written before
        end = all_.rank(order_.first_number(key(begin).level + 1u));
        SLF_TRY(writer_.commit_level());
        const auto written = SLF_TRY(Field::open(writer_.file()));
        coarser.emplace(written, TileReaderOptions{.memory = tiles_.budget()});
      }
      SLF_TRY(write(begin, end, coarser ? &coarser->cache() : nullptr));
    }
    return writer_.finish([&] { return progress_.go_on(); });
  }

 private:
  [[nodiscard]] TileKey key(std::uint64_t k) const { return order_.key(all_.number(k)); }

  /// Recodes the tiles [begin, end) on all threads and appends them in order.
  Result<void> write(std::uint64_t begin, std::uint64_t end, TileCache* coarser) {
    const auto new_maker = [&] {
      return [&, samples = Bytes()](std::uint64_t k) mutable {
        return recode(tiles_, coarser, plan_, key(begin + k), samples);
      };
    };
    advise(field_, order_, all_, begin, begin + budget_.window + 2 * kAdvised);
    return make_in_order(end - begin, budget_.threads, budget_.window, new_maker,
                         [&](std::uint64_t k, RecodedTile tile) -> Result<void> {
                           SLF_TRY(put(key(begin + k), std::move(tile)));
                           if ((k + 1) % kAdvised == 0) advise_next(begin + k + 1);
                           return progress_.add(1);
                         });
  }

  /// Tile `k` is written next.
  void advise_next(std::uint64_t k) {
    field_.store().release_all();  // pages that were read stay in the kernel's cache
    k += budget_.window + kAdvised;
    advise(field_, order_, all_, k, k + kAdvised);
  }

  Result<void> put(TileKey key, RecodedTile tile) {
    if (tile.state == TileState::missing) {
      ++report_.missing;
      return field_.manifest().holds(key) ? writer_.put_missing(key) : Result<void>();
    }
    ++report_.tiles;
    ++(plan_.copy ? report_.copied : report_.recoded);
    report_.payload_bytes += tile.payload.size();
    return writer_.put(key, std::move(tile.payload), tile.back);
  }

  const FieldFile& field_;
  TileCache& tiles_;
  const RepackPlan& plan_;
  FieldWriter& writer_;
  Reporter& progress_;
  RepackReport& report_;
  const TileOrder& order_;
  const TileSelection all_;  // that the input has records of
  const bool predicts_;
  const WriteBudget budget_;
};

}  // namespace

Result<RepackReport> repack_file(const FieldFile& field, const std::string& path,
                                 const RepackOptions& options, const ProgressCallback& progress) {
  const auto output = SLF_TRY(FieldOutput::at(
      path, options.replace ? Existing::replace : Existing::keep, std::span(&field.path(), 1)));
  const auto budget = SLF_TRY(WriteBudget::divide(options.memory, field.shape(),
                                                  thread_count(options.threads), field.path()));
  TileCache tiles(field, budget.cache);
  const auto plan = SLF_TRY(plan_repack(tiles, options));
  Manifest manifest = field.manifest();
  if (plan.shape.states == 1)
    manifest.set_states(
        std::array{std::pair{std::string(), field.manifest().provenance_of(field.state())}});
  manifest.shape = plan.shape;
  manifest.format = plan.format;
  manifest.codec = plan.codec->spec();
  const TileOrder order(plan.shape);
  auto all = SLF_TRY(field.recorded(order));
  Reporter reporter(progress, {0, all.count(), 0},
                    field.path() + ": repack interrupted; nothing was written");
  SLF_TRY(reporter.add(0));
  const auto light = SLF_TRY(kept_light(field, options));
  auto writer = SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, manifest,
                                            plan.codec->tables(), light));

  RepackReport report;
  Repacker repacker(tiles, plan, order, std::move(all), budget, writer, reporter, report);
  SLF_TRY(repacker.write());
  report.file_bytes = file_size(output.target).value_or(0);
  return report;
}

Result<RepackReport> repack_field(const Field& field, const std::string& path,
                                  const RepackOptions& options, const ProgressCallback& progress) {
  SLF_TRY(check_not_composed(field));
  return guarded([&] { return repack_file(field.file(), path, options, progress); });
}

Result<std::vector<StateSource>> state_sources(const Field& field,
                                               std::span<const std::string> chosen) {
  SLF_TRY(check_not_composed(field));
  const std::vector<std::string> names = field.states();
  std::vector<StateSource> states;
  if (chosen.empty() && names.empty())
    states.push_back({std::filesystem::path(field.path()).stem(), field});
  for (const std::string& name : chosen.empty() ? std::span<const std::string>(names) : chosen) {
    const auto one = SLF_TRY(field.in_state(name));
    states.push_back({names.empty() ? "" : names[one.state()], one});
  }
  return states;
}

}  // namespace slf
