#include "codec/predictive_codec.h"

#include <bit>
#include <cassert>
#include <cstring>

#include "base/per_thread.h"
#include "base/try.h"
#include "codec/kept_rays.h"
#include "codec/predictive_channels.h"
#include "codec/reference_coder.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

/// Of a tile of level 0: the same of every sample. Valid until the thread calls it again.
Predicted unpredicted(std::size_t samples) {
  auto& alpha = per_thread<std::vector<std::uint8_t>>([] {});
  auto& depth = per_thread<std::vector<std::uint8_t>>([] {});
  auto& color = per_thread<std::vector<std::uint32_t>>([] {});
  alpha.assign(samples, kUnpredictedAlpha), depth.assign(samples, kUnpredictedDepth);
  color.assign(samples, kUnpredictedColor);
  return {0, {}, {}, {alpha, depth, color}};
}

}  // namespace

PredictiveCodec::PredictiveCodec(PredictiveSettings settings, PredictiveTables tables,
                                 Observer observer)
    : settings_(settings),
      tables_(std::move(tables)),
      bytes_(to_bytes(tables_)),
      observer_(std::move(observer)) {}

std::string PredictiveCodec::spec() const {
  return "predictive:" + (lossless() ? "lossless" : std::to_string(settings_.quality));
}

const TilePicture& PredictiveCodec::picture(const TileShape& tile) const {
  const std::lock_guard lock(mutex_);
  auto& picture = pictures_[{tile.rows(), tile.side}];
  if (!picture) picture = std::make_unique<TilePicture>(tile);
  return *picture;
}

std::vector<std::uint8_t> PredictiveCodec::references(unsigned level,
                                                      std::span<const std::uint8_t> kinds,
                                                      ByteSpan payload) const {
  std::vector<std::uint8_t> used(kinds.size());
  LevelModels::Used models = tables_.level(level).level_models().used;
  const auto decode = [&](auto decoder) { code_references(decoder, models, kinds, used); };
  if (settings_.by_sample())
    decode(RangeDecoder(payload));
  else
    decode(RansDecoder(payload));
  return used;
}

std::vector<std::uint32_t> PredictiveCodec::blocks(const TileShape& tile) const {
  std::vector<std::uint32_t> blocks;
  if (tile.bytes() == 0) return blocks;
  const TilePicture& in = picture(tile);
  for (const std::size_t pixel : in.pixel_of())
    blocks.push_back(static_cast<std::uint32_t>(pixel / in.width() / 8 * (in.width() / 8) +
                                                pixel % in.width() / 8));
  return blocks;
}

Result<void> PredictiveCodec::encode(const TileShape& tile, ByteSpan samples,
                                     const Predicted* predicted, Bytes& payload) const {
  assert(tile.format == settings_.format && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  const Predicted from = predicted ? *predicted : unpredicted(tile.samples());
  if (settings_.by_sample())
    encode_channels(tables_.level(from.level), tile, samples, from, payload);
  else
    encode_blocks(tile, samples, from, payload);
  // A payload of no bytes would mean an empty tile.
  if (payload.empty()) payload.push_back(std::byte{0});
  return {};
}

Result<void> PredictiveCodec::decode(const TileShape& tile, ByteSpan payload,
                                     const Predicted* predicted,
                                     std::span<std::byte> samples) const {
  assert(tile.format == settings_.format && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return bad_file("predictive", "bytes for a tile without rows");
  const Predicted from = predicted ? *predicted : unpredicted(tile.samples());
  return settings_.by_sample()
             ? decode_channels(tables_.level(from.level), tile, payload, from, samples)
             : decode_blocks(tile, payload, from, samples);
}

void PredictiveCodec::encode_blocks(const TileShape& tile, ByteSpan samples, const Predicted& from,
                                    Bytes& payload) const {
  const std::size_t count = tile.samples();
  std::vector<std::uint32_t> rgba(count);
  for (std::size_t s = 0; s < count; ++s) rgba[s] = load_le<std::uint32_t>(samples.data() + 4 * s);
  std::vector<std::uint8_t> depth(count);
  std::memcpy(depth.data(), &samples[4 * count], count);
  TileSymbols symbols;
  PredictiveEncoder encoder(tables_.level(from.level), scale(from), picture(tile), payload);
  if (observer_) encoder.collect(&symbols);
  encoder.references(from.kinds, from.used);
  if (from.earlier.empty()) {
    encoder.encode(from.prediction, depth, rgba);
  } else {
    KeptRays rays;
    rays.begin(tile, from);
    rays.choose(tables_.level(from.level), scale(from), picture(tile), depth, rgba);
    rays.restore(depth, rgba);
    encoder.keep(rays);
    encoder.encode(rays.prediction(), depth, rgba);
  }
  if (observer_) observer_(symbols);
}

Result<void> PredictiveCodec::decode_blocks(const TileShape& tile, ByteSpan payload,
                                            const Predicted& from,
                                            std::span<std::byte> samples) const {
  PredictiveDecoder decoder(tables_.level(from.level), scale(from), picture(tile), payload);
  SLF_TRY(pass_references(decoder, from));
  auto& rgba_scratch =
      per_thread<Scratch<std::uint32_t>>([] {});  // `samples` may have any alignment
  const auto rgba = rgba_scratch.take(tile.samples());
  const auto depths = samples.subspan(tile.color_bytes());
  const std::span depth(reinterpret_cast<std::uint8_t*>(depths.data()), depths.size());
  if (from.earlier.empty()) {
    SLF_TRY(decoder.decode(from.prediction, depth, rgba));
  } else {
    auto& rays = per_thread<KeptRays>([] {});
    rays.begin(tile, from);
    decoder.keep(rays);
    SLF_TRY(decoder.decode(rays.prediction(), depth, rgba));
    rays.restore(depth, rgba);
  }
  if constexpr (std::endian::native == std::endian::little)
    std::memcpy(samples.data(), rgba.data(), tile.color_bytes());
  else
    for (std::size_t s = 0; s < rgba.size(); ++s) store_le(samples.data() + 4 * s, rgba[s]);
  return {};
}

}  // namespace slf::codec
