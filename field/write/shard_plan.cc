#include "field/write/shard_plan.h"

#include "base/try.h"
#include "field/predict/references.h"

namespace slf {
namespace {

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
  std::vector<std::vector<bool>> needed(shape.levels + 1);  // per level and entry section
  for (unsigned level = shape.levels; level > 0; --level) {
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
  for (unsigned level = 0; level <= shape.levels; ++level) {
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

}  // namespace

Result<void> check_shard(const FieldShape& shape, const ShardOptions& options) {
  if (options.count == 0 || options.index == 0 || options.index > options.count)
    return fail(ErrorCode::usage, "shard ", options.index, "/", options.count,
                ": expected K/N with K from 1 to N");
  const unsigned first = options.first_level.value_or(0);
  const unsigned last = options.last_level.value_or(shape.levels);
  if (first > last || last > shape.levels)
    return fail(ErrorCode::usage, "levels ", first, " to ", last, ": the field has levels 0 to ",
                shape.levels);
  const std::uint64_t tiles = TileOrder(one_state(shape)).count();
  if (tiles > kMaxTiles / shape.states)
    return fail_without("levels", ErrorCode::usage, "levels ", shape.levels, ": ", tiles,
                        " tiles of each state, expected at most ", kMaxTiles / shape.states,
                        "; choose fewer levels, and tiles of more samples");
  return {};
}

Result<ShardPlan> plan_shard(const TileTracer& tracer, const FieldShape& shape,
                             const ShardOptions& options, bool predicted, const GoOn& go_on) {
  const TileOrder order(one_state(shape));
  const NumberRange levels{order.first_number(options.first_level.value_or(0)),
                           order.first_number(options.last_level.value_or(shape.levels) + 1)};
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

}  // namespace slf
