#include "field/write/shard_plan.h"

#include "field/predict/references.h"

namespace slf {
namespace {

/// Wide enough for the rays of all tiles times a number of shards.
__extension__ using Wide = unsigned __int128;

/// The positions of a shard. It begins at the first that has at least (index - 1) / count of all
/// rays before it, and ends before the first that has at least index / count before it.
NumberRange cut(const TileTracer& tracer, const TileOrder& order, NumberRange all,
                const ShardOptions& options) {
  if (options.count == 1) return all;
  Wide total = 0;
  for (std::uint64_t n = all.begin; n < all.end; ++n) total += tracer.rays(order.key(n));
  NumberRange shard{all.end, all.end};
  Wide before = 0;
  for (std::uint64_t n = all.begin; n < all.end; ++n) {
    if (shard.begin == all.end && before * options.count >= total * (options.index - 1))
      shard.begin = n;
    if (options.index < options.count && before * options.count >= total * options.index) {
      shard.end = n;
      break;
    }
    before += tracer.rays(order.key(n));
  }
  return shard;
}

/// The positions of tiles from which those of a part may be predicted: on each level, those of
/// certain entry sections.
class NeededTiles {
 public:
  NeededTiles(const TileTracer& tracer, const TileOrder& order, const FieldShape& shape,
              NumberRange part)
      : order_(order), shape_(shape), part_(part), entered_(shape.levels + 1) {
    for (unsigned level = shape.levels; level > 0; --level) {
      const std::vector<bool> dependent = entries(level);
      std::vector<bool>& needed = entered_[level - 1];
      needed.resize(section_count(level - 1 + shape.entry_extra_levels));
      for (std::uint32_t entry = 0; entry < dependent.size(); ++entry)
        if (dependent[entry])
          for (const std::uint32_t section :
               find_references(tracer.geometry(level - 1), tracer.geometry(level), entry).sections)
            needed[section] = true;
    }
  }

  /// These and those of the part.
  [[nodiscard]] TileSelection with_part() const {
    TileSelection tiles;
    for (unsigned level = 0; level <= shape_.levels; ++level) {
      const NumberRange all = order_.level(level);
      const bool some = std::ranges::find(entered_[level], true) != entered_[level].end();
      for (std::uint64_t n = all.begin; some && n < all.end; ++n)
        if (in_part(n) || entered_[level][entry_of(n)]) tiles.add({n, n + 1});
      if (!some) tiles.add(part_.within(all));
    }
    return tiles;
  }

 private:
  [[nodiscard]] bool in_part(std::uint64_t n) const { return n >= part_.begin && n < part_.end; }
  [[nodiscard]] std::uint32_t entry_of(std::uint64_t n) const {
    return sections_of(order_.key(n), shape_.entry_extra_levels).entry.index;
  }

  /// The entry sections of the tiles of a level that are built.
  [[nodiscard]] std::vector<bool> entries(unsigned level) const {
    std::vector<bool> found = entered_[level];
    found.resize(section_count(level + shape_.entry_extra_levels));
    const NumberRange own = part_.within(order_.level(level));
    for (std::uint64_t n = own.begin; n < own.end; ++n) found[entry_of(n)] = true;
    return found;
  }

  const TileOrder& order_;
  const FieldShape& shape_;
  NumberRange part_;
  std::vector<std::vector<bool>> entered_;  ///< per level: whether an entry section is needed
};

}  // namespace

Result<ShardPlan> plan_shard(const TileTracer& tracer, const FieldShape& shape,
                             const ShardOptions& options, bool predicted) {
  if (options.count == 0 || options.index == 0 || options.index > options.count)
    return fail(ErrorCode::usage, "shard ", options.index, "/", options.count,
                ": expected K/N with K from 1 to N");
  const unsigned first = options.first_level.value_or(0);
  const unsigned last = options.last_level.value_or(shape.levels);
  if (first > last || last > shape.levels)
    return fail(ErrorCode::usage, "levels ", first, " to ", last, ": the field has levels 0 to ",
                shape.levels);
  const TileOrder order(one_state(shape));
  const NumberRange levels{order.first_number(first), order.first_number(last + 1)};
  const NumberRange part = cut(tracer, order, levels, options);
  ShardPlan plan;
  plan.part = {order.key_or_end(part.begin), order.key_or_end(part.end)};
  TileSelection positions;
  if (predicted)
    positions = NeededTiles(tracer, order, shape, part).with_part();
  else
    positions.add(part);
  for_each_state(shape, positions.ranges(),
                 [&](std::size_t, NumberRange numbers) { plan.tiles.add(numbers); });
  return plan;
}

}  // namespace slf
