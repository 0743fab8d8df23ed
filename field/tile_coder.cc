#include "field/tile_coder.h"

#include <algorithm>

#include "base/half.h"
#include "base/per_thread.h"
#include "base/try.h"
#include "base/varint.h"
#include "codec/kept_rays.h"
#include "codec/log_colors.h"
#include "codec/prediction.h"
#include "field/predict/predictor.h"

namespace slf {
namespace {

/// The fewest look-ups for which a tile becomes a reference. For fewer, reading it costs more than
/// it saves.
constexpr std::uint32_t kMinUses = 6;

tl::unexpected<Error> damaged(const char* what) { return fail(ErrorCode::bad_file, what); }

/// Samples as 8-bit numbers; `converted` holds them if they are half floats.
ByteSpan as_bytes(ByteSpan samples, bool half, Bytes& converted) {
  if (half) converted = codec::to_rgba8_depth8(samples);
  return half ? ByteSpan(converted) : samples;
}

}  // namespace

/// What comes before the codec's payload in fields of several states (FORMAT.md, "States in
/// payloads").
struct TileCoder::Head {
  std::uint64_t back = 0;             ///< to the earlier state, whose tile is used; 0: none
  bool keeps_rays = false;            ///< whether rays of that are kept; else it predicts blocks
  std::vector<std::uint8_t> earlier;  ///< for each block, 1 if it is predicted from that

  [[nodiscard]] TileKey tile(TileKey key) const { return in_state(key, key.state - back); }
  /// The bytes before the codec's payload.
  [[nodiscard]] Bytes encode() const {
    Bytes bytes;
    append_varint(bytes, back + (keeps_rays ? kMaxStates : 0));
    std::uint8_t value = 1;
    for (std::size_t at = 0; at < earlier.size(); value ^= 1) {
      const std::size_t begin = at;
      while (at < earlier.size() && earlier[at] == value) ++at;
      append_varint(bytes, at - begin);
    }
    return bytes;
  }
};

struct TileCoder::Relation {
  Relation(const TileCoder& coder, TileKey key)
      : coarser(coder.geometries_(key.level - 1u)),
        finer(coder.geometries_(key.level)),
        sections(sections_of(key, coder.shape_.entry_extra_levels)),
        rows(find_references(coarser, finer, sections.entry.index)),
        candidates(coarser, rows, sections, key.state),
        // NOLINTNEXTLINE(clang-analyzer-optin.cplusplus.UninitializedObject): initialized there
        four_taps(coder.codec_.four_taps()) {}

  /// Predicts the tile, lets `adjust` change that, and calls `code` with the result. Colours of
  /// half floats are converted. `earlier` is that of codec::Predicted.
  template <class Adjust, class Code>
  Result<void> predict(std::span<const ReferenceSamples> from, bool half, const Adjust& adjust,
                       const Code& code, ByteSpan earlier = {}) const {
    std::vector<ReferenceTile> tiles(candidates.size());
    std::vector<std::uint8_t> used(candidates.size());
    std::vector<Bytes> converted(from.size());
    for (std::size_t i = 0; i < from.size(); ++i) {
      const auto k = candidates.find(from[i].tile);
      if (!k) continue;
      used[*k] = 1;
      if (from[i].samples.empty()) continue;
      const ByteSpan bytes = as_bytes(from[i].samples, half, converted[i]);
      tiles[*k] = {bytes.data(), bytes.data() + bytes.size() / 5 * 4};
    }
    auto& predicted = per_thread<PredictedSamples>([] {});
    TilePredictor(coarser, finer, sections, rows).predict(tiles, four_taps, predicted);
    adjust(predicted);
    const codec::Predicted told{finer.level(),    candidates.kinds(),   used,
                                predicted.view(), step_scale(sections), earlier};
    return code(&told);
  }

  const LevelGeometry& coarser;
  const LevelGeometry& finer;
  const TileSections sections;
  const References rows;
  const Candidates candidates;
  const bool four_taps;
};

std::pair<std::vector<std::uint32_t>, std::uint32_t> TileCoder::blocks(TileKey key) const {
  auto of = codec_.blocks(tile_shape(key));
  const auto last = std::max_element(of.begin(), of.end());
  const std::uint32_t count = last == of.end() ? 0 : *last + 1;
  return {std::move(of), count};
}

Result<TileCoder::Head> TileCoder::take_head(TileKey key, ByteSpan& payload) const {
  Head head;
  if (!several_states_) return head;
  const auto back = take_varint(payload);
  if (!back || *back >= (keeps_rays_ ? 2 : 1) * kMaxStates || *back == kMaxStates)
    return damaged("the payload names no state");
  head.back = *back % kMaxStates, head.keeps_rays = *back > kMaxStates;
  if (head.back == 0 || head.keeps_rays) return head;
  const std::size_t count = blocks(key).second;
  for (std::uint8_t value = 1; head.earlier.size() < count; value ^= 1) {
    const auto run = take_varint(payload);
    if (!run || *run > count - head.earlier.size() || (*run == 0 && !head.earlier.empty()))
      return damaged("the payload does not say which state predicts its blocks");
    head.earlier.insert(head.earlier.end(), *run, value);
    if (*run == 0 && value == 0) return damaged("the payload has an empty run of blocks");
  }
  return head;
}

std::vector<TileKey> TileCoder::references(TileKey key, ByteSpan payload) const {
  std::vector<TileKey> named;
  const auto head = take_head(key, payload);
  if (!head) return named;  // decode() tells why
  if (head->back > 0) named.push_back(head->tile(key));
  if (!predicts(key)) return named;
  const Relation to(*this, key);
  const auto used = codec_.references(key.level, to.candidates.kinds(), payload);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) named.push_back(to.candidates[k]);
  return named;
}

Result<ByteSpan> TileCoder::without_states(TileKey key, ByteSpan payload) const {
  const Head head = SLF_TRY(take_head(key, payload));
  if (head.back > 0) return damaged("the payload names a state before the first");
  return payload;
}

template <class Code>
Result<void> TileCoder::predict(TileKey key, const Head& head,
                                std::span<const ReferenceSamples> from, const Code& code) const {
  const auto keep = [](PredictedSamples&) {};
  const bool half = is_half(format_);
  if (head.back == 0 && !predicts(key)) return code(nullptr);
  if (head.back == 0) return Relation(*this, key).predict(from, half, keep, code);
  const auto found = std::find_if(from.begin(), from.end(), [&](const ReferenceSamples& one) {
    return one.tile == head.tile(key);
  });
  const TileShape shape = tile_shape(key);
  if (found == from.end() || found->samples.size() != shape.bytes())
    return damaged("the tile of another state that it is predicted from has no samples");
  Bytes converted;
  const ByteSpan earlier = as_bytes(found->samples, half, converted);
  const auto of = blocks(key).first;
  const auto adjust = [&](PredictedSamples& predicted) {
    for (std::size_t s = 0; s < of.size(); ++s) {
      if (head.keeps_rays || !head.earlier[of[s]]) continue;
      const auto rgba = load_le<std::uint32_t>(&earlier[4 * s]);
      predicted.alpha[s] = static_cast<std::uint8_t>(rgba >> 24);
      predicted.depth[s] = std::to_integer<std::uint8_t>(earlier[4 * of.size() + s]);
      predicted.color[s] = codec::straight(rgba);
    }
  };
  const ByteSpan kept = head.keeps_rays ? earlier : ByteSpan();
  if (predicts(key)) return Relation(*this, key).predict(from, half, adjust, code, kept);
  auto& predicted = per_thread<PredictedSamples>([] {});
  predicted.alpha.assign(of.size(), codec::kUnpredictedAlpha);
  predicted.depth.assign(of.size(), codec::kUnpredictedDepth);
  predicted.color.assign(of.size(), codec::kUnpredictedColor);
  adjust(predicted);
  const codec::Predicted told{0, {}, {}, predicted.view(), codec::kPlainScale, kept};
  return code(&told);
}

Result<void> TileCoder::decode(TileKey key, ByteSpan payload,
                               std::span<const ReferenceSamples> from,
                               std::span<std::byte> samples) const {
  const Head head = SLF_TRY(take_head(key, payload));
  return predict(key, head, from, [&](const codec::Predicted* predicted) {
    return codec_.decode(tile_shape(key), payload, predicted, samples);
  });
}

std::vector<TileKey> TileCoder::choose(TileKey key, ByteSpan samples) const {
  std::vector<TileKey> chosen;
  if (!predicts(key) || samples.empty()) return chosen;
  const Relation to(*this, key);
  const std::size_t count = samples.size() / sample_bytes(format_), step = color_bytes(format_);
  std::vector<std::uint8_t> alpha(count), depth(count);
  for (std::size_t s = 0; s < count; ++s) {
    const std::byte* const color = &samples[s * step];
    alpha[s] = is_half(format_) ? byte_from_half(load_le<std::uint16_t>(color + 6))
                                : std::to_integer<std::uint8_t>(color[3]);
    depth[s] = std::to_integer<std::uint8_t>(samples[count * step + s]);
  }
  const auto uses = TilePredictor(to.coarser, to.finer, to.sections, to.rows).uses(alpha, depth);
  for (std::size_t k = 0; k < uses.size(); ++k)
    if (uses[k] >= kMinUses && shape_.has(to.candidates[k])) chosen.push_back(to.candidates[k]);
  return chosen;
}

/// Chooses, for each block, what differs less from the samples: what coarser tiles predict, or the
/// tile of an earlier state.
std::vector<std::uint8_t> TileCoder::choose_blocks(TileKey key, ByteSpan samples, ByteSpan earlier,
                                                   const codec::Predicted* predicted) const {
  Bytes converted[2];
  const bool half = is_half(format_);
  const ByteSpan own = as_bytes(samples, half, converted[0]),
                 other = as_bytes(earlier, half, converted[1]);
  const auto blocks_of = blocks(key);
  const auto& of = blocks_of.first;
  std::vector<std::int64_t> gain(blocks_of.second);  // of the earlier state
  for (std::size_t s = 0; s < of.size(); ++s) {
    const auto rgba = load_le<std::uint32_t>(&own[4 * s]),
               there = load_le<std::uint32_t>(&other[4 * s]);
    const auto depth = [&](ByteSpan in) {
      return std::to_integer<std::uint8_t>(in[4 * of.size() + s]);
    };
    const auto alpha = static_cast<std::uint8_t>(there >> 24);
    gain[of[s]] +=
        predicted
            ? codec::difference(rgba, depth(own), predicted->prediction.alpha[s],
                                predicted->prediction.depth[s], predicted->prediction.color[s])
            : codec::difference(rgba, depth(own), codec::kUnpredictedAlpha,
                                codec::kUnpredictedDepth, codec::kUnpredictedColor);
    gain[of[s]] -= codec::difference(rgba, depth(own), alpha, depth(other), codec::straight(there));
  }
  std::vector<std::uint8_t> better(gain.size());
  for (std::size_t b = 0; b < gain.size(); ++b)  // blocks that show nothing lengthen a run
    better[b] = gain[b] == 0 && b > 0 ? better[b - 1] : gain[b] >= 0 ? 1 : 0;
  return better;
}

Result<void> TileCoder::encode(TileKey key, ByteSpan samples,
                               std::span<const ReferenceSamples> from, Bytes& payload) const {
  std::vector<ReferenceSamples> used(from.begin(), from.end());
  std::erase_if(used, [](const ReferenceSamples& one) { return one.samples.empty(); });
  Head head;
  const auto earlier = std::find_if(used.begin(), used.end(), [&](const ReferenceSamples& one) {
    return one.tile.level == key.level;
  });
  if (earlier != used.end()) {
    head.back = key.state - earlier->tile.state;
    head.keeps_rays = keeps_rays_;
  }
  if (head.back > 0 && !head.keeps_rays) {
    SLF_TRY(predict(key, {}, used, [&](const codec::Predicted* predicted) -> Result<void> {
      head.earlier = choose_blocks(key, samples, earlier->samples, predicted);
      return {};
    }));
    if (std::count(head.earlier.begin(), head.earlier.end(), 0) == 0)
      used = std::vector{ReferenceSamples(*earlier)};
  }
  SLF_TRY(predict(key, head, used, [&](const codec::Predicted* predicted) {
    return codec_.encode(tile_shape(key), samples, predicted, payload);
  }));
  const Bytes start = several_states_ && !payload.empty() ? head.encode() : Bytes();
  payload.insert(payload.begin(), start.begin(), start.end());
  return {};
}

}  // namespace slf
