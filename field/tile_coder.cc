#include "field/tile_coder.h"

#include <algorithm>
#include <bit>
#include <optional>

#include "base/half.h"
#include "base/try.h"
#include "codec/predictive_channels.h"
#include "codec/premultiply.h"
#include "codec/reference_coder.h"
#include "field/predict/log_colors.h"
#include "field/predict/predictor.h"

namespace slf {
namespace {

using codec::ChannelValues;

/// The fewest look-ups for which a tile becomes a reference. For fewer, reading it costs more than
/// it saves.
constexpr std::uint32_t kMinUses = 6;

/// The prediction of a sample without references.
constexpr std::uint8_t kMiddle = 128;
constexpr std::uint32_t kGray = 0xFF808080u;

/// The channels of colour, and their positions in RGBA.
constexpr std::pair<codec::TileChannel, std::size_t> kColors[] = {
    {codec::kRedChannel, 0}, {codec::kGreenChannel, 1}, {codec::kBlueChannel, 2}};

}  // namespace

/// The tiles that a tile may refer to: none at level 0.
struct Candidates {
  References references;
  std::vector<TileSections> sections;
  std::vector<TileKey> keys;
  std::vector<std::uint8_t> kinds;

  Candidates(const TileCoder::Geometries& geometries, unsigned level, const TileSections& tile) {
    if (level == 0) return;
    const LevelGeometry& coarser = geometries(level - 1);
    references = find_references(coarser, geometries(level), tile.entry.index);
    sections = candidates_of(coarser, references);
    for (const TileSections& candidate : sections) {
      keys.push_back(tile_key(candidate));
      const bool far_entry = candidate.entry != tile.entry.parent();
      const bool far_exit = candidate.exit.octant() != tile.exit.octant();
      kinds.push_back(static_cast<std::uint8_t>((far_entry ? 2 : 0) + (far_exit ? 1 : 0)));
    }
  }
};

/// Working memory that a thread keeps. It is in use from predict() on, because the tiles that a
/// tile refers to are decoded before, maybe on the same thread.
struct Scratch {
  PredictedSamples predicted;
  std::vector<std::uint8_t> depth;  // decoded
  std::vector<std::uint32_t> rgba;

  static Scratch& of_thread() {
    thread_local Scratch scratch;
    return scratch;
  }
};

/// The state of a tile that is being encoded or decoded.
struct TileCoder::Work {
  const codec::PredictiveCodec& codec;
  codec::Tile tile;
  const codec::PredictiveLevel& level;
  std::size_t samples;
  Candidates candidates;
  std::optional<TilePredictor> predictor;  // none at level 0
  Scratch& scratch;
  std::vector<Bytes> converted;  // from half floats; what `from` views
  std::vector<ReferenceTile> from;

  Work(const TileCoder& tiles, TileKey key)
      : Work(tiles, key, sections_of(key, tiles.shape_.entry_extra_levels)) {}
  Work(const TileCoder& tiles, TileKey key, const TileSections& sections)
      : codec(*tiles.predictive_),
        tile(tiles.tile_shape(key)),
        level(codec.level(key.level)),
        samples(tile.rows() * tile.columns()),
        candidates(tiles.geometries_, key.level, sections),
        scratch(Scratch::of_thread()) {
    if (key.level == 0) return;
    predictor.emplace(tiles.geometries_(key.level - 1u), tiles.geometries_(key.level), sections,
                      std::move(candidates.references));
    from.resize(candidates.keys.size());
  }

  [[nodiscard]] bool half() const { return is_half(tile.format); }
  [[nodiscard]] std::uint8_t alpha_byte(std::int32_t value) const {
    return half() ? byte_from_half(codec::half_of_ordered(value))
                  : static_cast<std::uint8_t>(value);
  }

  /// Makes candidate `k` a reference. Returns false if its tile is empty, and so predicts nothing.
  Result<bool> use(std::size_t k, const ReferenceSource& source) {
    ByteSpan found = SLF_TRY(source(candidates.keys[k]));
    if (found.empty()) return false;
    if (half()) found = converted.emplace_back(to_rgba8_depth8(found));
    from[k] = {found.data(), found.data() + found.size() / 5 * 4};
    return true;
  }

  template <class Decoder>
  Result<void> read_references(Decoder& decoder, const ReferenceSource& source) {
    std::vector<std::uint8_t> used(candidates.keys.size());
    decoder.references(candidates.kinds, used);
    for (std::size_t k = 0; k < used.size(); ++k)
      if (used[k]) SLF_TRY(use(k, source));
    return {};
  }

  /// Chooses the candidates that predict enough of the samples, and codes the choice.
  template <class Encoder>
  Result<void> choose_references(Encoder& encoder, const FieldShape& shape,
                                 std::span<const std::uint8_t> true_alpha,
                                 std::span<const std::uint8_t> true_depth,
                                 const ReferenceSource& source) {
    std::vector<std::uint8_t> used(candidates.keys.size());
    if (predictor) {
      const auto uses = predictor->uses(true_alpha, true_depth);
      for (std::size_t k = 0; k < uses.size(); ++k) {
        if (uses[k] < kMinUses || !shape.has(candidates.keys[k])) continue;
        const auto has = use(k, source);
        if (!has && has.error().code != ErrorCode::tile_missing) return tl::unexpected(has.error());
        used[k] = has && *has ? 1 : 0;
      }
    }
    encoder.references(candidates.kinds, used);
    return {};
  }

  const PredictedSamples& predict() {
    PredictedSamples& predicted = scratch.predicted;
    if (predictor) {
      predictor->predict(from, predicted);
    } else {
      predicted.alpha.assign(samples, 0);
      predicted.depth.assign(samples, kMiddle);
      predicted.color.assign(samples, kGray);
    }
    return predicted;
  }

  /// Decodes a tile that is coded with a transform.
  Result<void> decode(codec::PredictiveDecoder decoder, const ReferenceSource& source,
                      std::span<std::byte> to);
  Result<void> encode(codec::PredictiveEncoder& encoder, const FieldShape& shape, ByteSpan from,
                      const ReferenceSource& source);

  /// Decodes a tile that is coded sample by sample.
  Result<void> decode(codec::ChannelDecoder decoder, const ReferenceSource& source,
                      std::span<std::byte> to);
  Result<void> encode(codec::ChannelEncoder& encoder, const FieldShape& shape, ByteSpan from,
                      const ReferenceSource& source);
  template <class Coder>
  void code_channels(Coder& coder, ChannelValues& values);
  [[nodiscard]] ChannelValues channels_of(ByteSpan from) const;
  void store(const ChannelValues& values, std::span<std::byte> to) const;
};

Result<void> TileCoder::Work::decode(codec::PredictiveDecoder decoder,
                                     const ReferenceSource& source, std::span<std::byte> to) {
  SLF_TRY(read_references(decoder, source));
  std::vector<std::uint8_t>& depth = scratch.depth;
  std::vector<std::uint32_t>& rgba = scratch.rgba;
  depth.resize(samples), rgba.resize(samples);
  SLF_TRY(decoder.decode(predict().view(), depth, rgba));
  if constexpr (std::endian::native == std::endian::little) {
    const ByteSpan colors = std::as_bytes(std::span(rgba));
    std::copy(colors.begin(), colors.end(), to.begin());
  } else
    for (std::size_t s = 0; s < samples; ++s) store_le(to.data() + 4 * s, rgba[s]);
  const ByteSpan depths = std::as_bytes(std::span(depth));
  std::copy(depths.begin(), depths.end(), to.begin() + static_cast<std::ptrdiff_t>(4 * samples));
  return {};
}

Result<void> TileCoder::Work::encode(codec::PredictiveEncoder& encoder, const FieldShape& shape,
                                     ByteSpan of, const ReferenceSource& source) {
  std::vector<std::uint32_t> rgba(samples);
  std::vector<std::uint8_t> true_alpha(samples), true_depth(samples);
  for (std::size_t s = 0; s < samples; ++s) {
    rgba[s] = load_le<std::uint32_t>(of.data() + 4 * s);
    true_alpha[s] = static_cast<std::uint8_t>(rgba[s] >> 24);
    true_depth[s] = std::to_integer<std::uint8_t>(of[4 * samples + s]);
  }
  SLF_TRY(choose_references(encoder, shape, true_alpha, true_depth, source));
  encoder.encode(predict().view(), true_depth, rgba);
  return {};
}

Result<void> TileCoder::Work::decode(codec::ChannelDecoder decoder, const ReferenceSource& source,
                                     std::span<std::byte> to) {
  SLF_TRY(read_references(decoder, source));
  ChannelValues values;
  for (auto& channel : values) channel.resize(samples);
  code_channels(decoder, values);
  store(values, to);
  return decoder.finish();
}

Result<void> TileCoder::Work::encode(codec::ChannelEncoder& encoder, const FieldShape& shape,
                                     ByteSpan of, const ReferenceSource& source) {
  ChannelValues values = channels_of(of);
  std::vector<std::uint8_t> true_alpha(samples), true_depth(samples);
  for (std::size_t s = 0; s < samples; ++s) {
    true_alpha[s] = alpha_byte(values[codec::kAlphaChannel][s]);
    true_depth[s] = static_cast<std::uint8_t>(values[codec::kDepthChannel][s]);
  }
  SLF_TRY(choose_references(encoder, shape, true_alpha, true_depth, source));
  code_channels(encoder, values);
  encoder.finish();
  return {};
}

ChannelValues TileCoder::Work::channels_of(ByteSpan of) const {
  ChannelValues values;
  for (auto& channel : values) channel.resize(samples);
  const auto value = [&](std::size_t s, std::size_t c) -> std::int32_t {
    const std::byte* const at = of.data() + s * color_bytes(tile.format);
    return half() ? codec::ordered_half(load_le<std::uint16_t>(at + 2 * c))
                  : std::to_integer<std::int32_t>(at[c]);
  };
  for (std::size_t s = 0; s < samples; ++s) {
    for (const auto& [channel, place] : kColors) values[channel][s] = value(s, place);
    values[codec::kAlphaChannel][s] = value(s, 3);
    values[codec::kDepthChannel][s] =
        std::to_integer<std::int32_t>(of[color_bytes(tile.format) * samples + s]);
  }
  return values;
}

void TileCoder::Work::store(const ChannelValues& values, std::span<std::byte> to) const {
  const auto put = [&](std::size_t s, std::size_t c, std::int32_t value) {
    std::byte* const at = to.data() + s * color_bytes(tile.format);
    if (half())
      store_le(at + 2 * c, codec::half_of_ordered(value));
    else
      at[c] = static_cast<std::byte>(value);
  };
  for (std::size_t s = 0; s < samples; ++s) {
    for (const auto& [channel, place] : kColors) put(s, place, values[channel][s]);
    put(s, 3, values[codec::kAlphaChannel][s]);
    to[color_bytes(tile.format) * samples + s] =
        static_cast<std::byte>(values[codec::kDepthChannel][s]);
  }
}

template <class Coder>
void TileCoder::Work::code_channels(Coder& coder, ChannelValues& values) {
  const PredictedSamples& predicted = predict();
  ChannelValues expected;
  for (auto& channel : expected) channel.resize(samples);
  for (std::size_t s = 0; s < samples; ++s) {
    const std::uint8_t alpha = predicted.alpha[s];
    expected[codec::kAlphaChannel][s] = half() ? codec::ordered_half(half_from_byte(alpha)) : alpha;
    expected[codec::kDepthChannel][s] = predicted.depth[s];
  }
  coder.code(codec::kAlphaChannel, expected, values);
  coder.code(codec::kDepthChannel, expected, values);
  for (std::size_t s = 0; s < samples; ++s) {
    const std::int32_t alpha = values[codec::kAlphaChannel][s];
    for (const auto& [channel, place] : kColors) {
      const auto full = static_cast<std::uint8_t>(predicted.color[s] >> (8 * place));
      expected[channel][s] =
          half() ? codec::ordered_half(half_from_log_color(full, codec::half_of_ordered(alpha)))
                 : static_cast<std::int32_t>(codec::premultiplied(full, alpha_byte(alpha)));
    }
  }
  coder.code(codec::kGreenChannel, expected, values);
  coder.code(codec::kRedChannel, expected, values);
  coder.code(codec::kBlueChannel, expected, values);
}

std::vector<TileKey> TileCoder::references(TileKey key, ByteSpan payload) const {
  std::vector<TileKey> keys;
  if (!predicts() || key.level == 0) return keys;
  const TileSections sections = sections_of(key, shape_.entry_extra_levels);
  const Candidates candidates(geometries_, key.level, sections);
  std::vector<std::uint8_t> used(candidates.keys.size());
  codec::decode_references(predictive_->level(key.level), predictive_->settings().by_sample(),
                           payload, candidates.kinds, used);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) keys.push_back(candidates.keys[k]);
  return keys;
}

Result<void> TileCoder::decode(TileKey key, ByteSpan payload, const ReferenceSource& source,
                               std::span<std::byte> samples) const {
  if (!predicts()) return codec_.decode(tile_shape(key), payload, samples);
  Work work(*this, key);
  if (predictive_->settings().by_sample())
    return work.decode(codec::ChannelDecoder(work.level, work.tile, payload), source, samples);
  return work.decode({work.level, predictive_->picture(work.tile), payload}, source, samples);
}

Result<void> TileCoder::encode(TileKey key, ByteSpan samples, const ReferenceSource& source,
                               Bytes& payload, codec::TileSymbols* symbols) const {
  if (!predicts()) return codec_.encode(tile_shape(key), samples, payload);
  payload.clear();
  Work work(*this, key);
  if (predictive_->settings().by_sample()) {
    codec::ChannelEncoder encoder(work.level, work.tile, payload);
    SLF_TRY(work.encode(encoder, shape_, samples, source));
  } else {
    codec::PredictiveEncoder encoder(work.level, predictive_->picture(work.tile), payload);
    encoder.collect(symbols);
    SLF_TRY(work.encode(encoder, shape_, samples, source));
  }
  // A payload of no bytes would mean an empty tile.
  if (payload.empty()) payload.push_back(std::byte{0});
  return {};
}

}  // namespace slf
