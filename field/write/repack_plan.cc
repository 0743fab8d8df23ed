#include "field/write/repack_plan.h"

#include <algorithm>
#include <vector>

#include "base/half.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

using storage::TileState;

/// Converts colours, and appends them. Premultiplied colours of 8 bits are clamped to alpha.
void append_colors(ByteSpan in, bool from_half, bool to_half, Bytes& out) {
  if (from_half == to_half) {
    out.insert(out.end(), in.begin(), in.end());
  } else if (to_half) {
    out.resize(in.size() * 2);
    for (std::size_t k = 0; k < in.size(); ++k)
      store_le(&out[2 * k], half_from_byte(std::to_integer<std::uint8_t>(in[k])));
  } else {
    out.resize(in.size() / 2);
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = std::byte{byte_from_half(load_le<std::uint16_t>(&in[2 * k]))};
    for (std::size_t k = 0; k < out.size(); k += 4)
      for (std::size_t c = k; c < k + 3; ++c) out[c] = std::min(out[c], out[k + 3]);
  }
}

/// Fits shared tables, if the codec has any that depend on tiles, to a few of the finest level,
/// spread over it.
Result<std::unique_ptr<codec::Codec>> train(TileCache& cache, const RepackPlan& plan,
                                            const std::string& codec) {
  if (!codec::needs_training(codec))
    return codec::train_codec(codec, plan.format, {}, plan.shape.levels);
  const FieldFile& field = cache.field();
  const TileOrder order(plan.shape);
  const std::uint64_t begin = order.first_number(plan.shape.levels);
  const std::uint64_t step = std::max<std::uint64_t>(1, (order.count() - begin) / 256);
  std::vector<TileKey> stored;
  for (std::uint64_t n = begin + step / 2; n < order.count(); n += step) {
    const auto tile = SLF_TRY(field.store().find(order.key(n)));
    if (tile.state == TileState::stored) stored.push_back(tile.key);
  }
  const std::size_t skip = std::max<std::size_t>(1, stored.size() / codec::kTrainingTiles);
  std::vector<Bytes> samples;
  for (std::size_t k = 0; k < stored.size() && samples.size() < codec::kTrainingTiles; k += skip)
    SLF_TRY(convert_samples(cache, plan, stored[k], samples.emplace_back()));
  std::vector<codec::TrainingTile> tiles;
  for (std::size_t k = 0; k < samples.size(); ++k)
    tiles.push_back({plan.tile_shape(field, stored[k * skip]), samples[k]});
  return codec::train_codec(codec, plan.format, tiles, plan.shape.levels);
}

Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options) {
  FieldShape shape = field.shape();
  if (options.levels && *options.levels > shape.levels)
    return misuse(field.path(), "has levels 0 to ", shape.levels, ", not ", *options.levels);
  if (options.levels) shape.levels = *options.levels;
  for (const std::uint8_t subfield : options.subfields)
    if (!field.shape().has({0, std::uint64_t{subfield} << (2 * shape.entry_extra_levels)}))
      return misuse(field.path(), "has no subfield ", int{subfield});
  if (!options.subfields.empty()) shape.subfields = options.subfields;
  SLF_TRY(shape.check());
  return shape;
}

}  // namespace

Result<void> check_not_composed(const Field& field) {
  if (!field.structures()) return {};
  return unsupported(field.path(),
                     "is shown with structures, whose tiles no file has; copy each "
                     "structure instead");
}

Result<ByteSpan> kept_light(const FieldFile& first, const RepackOptions& options) {
  const Result<ByteSpan> light = options.light ? first.light() : ByteSpan();
  if (light) return light;
  return fail(light.error().code, light.error().message, "; a copy can leave the light out");
}

Result<RepackPlan> plan_repack(TileCache& tiles, const RepackOptions& options) {
  const FieldFile& field = tiles.field();
  RepackPlan plan;
  plan.shape = SLF_TRY(plan_shape(field, options));
  plan.format = sample_format(options.half.value_or(is_half(field.format())),
                              options.depth && field.has_depth());
  const codec::Codec& now = field.codec();
  std::string codec = options.codec.empty() ? now.spec() : options.codec;
  auto plain = codec::make_codec(codec, plan.format);
  if (!plain && options.codec.empty() && is_half(plan.format) && !is_half(field.format())) {
    codec = "zstd";  // JPEG stores no half floats
    plain = codec::make_codec(codec, plan.format);
  }
  if (!plain) return tl::unexpected(plain.error());
  // Tiles may be predicted from those of other subfields, or of earlier states.
  const bool has_references =
      !field.predicts() || (plan.shape.subfields == field.shape().subfields && field.state() == 0);
  plan.copy = plan.format == field.format() && (*plain)->spec() == now.spec() && has_references;
  plan.codec = SLF_TRY(plan.copy ? codec::make_codec(now.spec(), plan.format, now.tables())
                                 : train(tiles, plan, codec));
  return plan;
}

Result<void> convert_samples(TileCache& tiles, const RepackPlan& plan, TileKey key,
                             Bytes& samples) {
  const FieldFile& field = tiles.field();
  const auto pin = SLF_TRY(tiles.read(key));
  const ByteSpan in = pin.samples(), colors = in.first(field.tile_shape(key).color_bytes());
  samples.clear();
  append_colors(colors, is_half(field.format()), is_half(plan.format), samples);
  if (has_depth(plan.format))
    samples.insert(samples.end(), in.begin() + static_cast<std::ptrdiff_t>(colors.size()),
                   in.end());
  return {};
}

}  // namespace slf
