#include "codec/jpeg_codec.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>
#include <limits>
#include <vector>

#include "base/per_thread.h"
#include "base/try.h"
#include "base/varint.h"
#include "codec/color_kernel.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "codec/jpeg_pictures.h"
#include "codec/lane_samples.h"
#include "codec/mosaic.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// From this quality on, alpha is exact.
constexpr int kExactAlphaQuality = 95;
// Finer depth does not show in views.
constexpr int kDepthQuality = 75;

std::span<const std::uint8_t> bytes_of(ByteSpan span) {
  return {reinterpret_cast<const std::uint8_t*>(span.data()), span.size()};
}

// The value of the first byte that means a gray JPEG. 1..255 is the number of steps.
constexpr std::uint8_t kInJpeg = 0;

// JPEG adds noise where alpha is 0 or 255. Values this close to either are rounded to it.
constexpr std::uint8_t kNoise = 2;

// Of alpha in steps.
constexpr int kZstdLevel = 9;

// Steps 0..top are evenly spaced from transparent to opaque.
std::uint8_t to_steps(std::uint8_t alpha, int top) {
  return static_cast<std::uint8_t>((alpha * top * 2 + 255) / 510);
}
std::uint8_t from_steps(std::uint8_t step, int top) {
  return static_cast<std::uint8_t>(std::min((step * 510 + top) / (2 * top), 255));
}

struct Candidate {
  Bytes payload;
  std::vector<std::uint8_t> alpha;
};

// `steps` and `shown` are those of each alpha.
using Table = std::array<std::uint8_t, 256>;
Result<Candidate> in_steps(const TileShape& tile, int top, const Table& steps, const Table& shown,
                           std::span<const std::uint8_t> alpha) {
  Candidate result{{static_cast<std::byte>(top)}, {alpha.begin(), alpha.end()}};
  for (std::uint8_t& value : result.alpha) value = steps[value];
  SLF_TRY(append_bytes(tile, std::as_bytes(std::span(result.alpha)), kZstdLevel, result.payload));
  for (std::size_t i = 0; i < alpha.size(); ++i) result.alpha[i] = shown[alpha[i]];
  return result;
}

/// Fills `alpha` from the start of `payload` and removes the bytes it read; untrusted.
Result<void> read_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic, const JpegTables& tables,
                             ByteSpan& payload, std::span<std::uint8_t> alpha) {
  if (payload.empty()) return bad_file("JPEG", "the tile is cut short");
  const auto top = std::to_integer<std::uint8_t>(payload[0]);
  payload = payload.subspan(1);
  if (top != kInJpeg) {
    SLF_TRY(read_bytes(tile, payload, std::as_writable_bytes(alpha)));
    if (top == 255) return {};
    std::uint8_t opacity[256];
    for (int i = 0; i < 256; ++i) opacity[i] = from_steps(static_cast<std::uint8_t>(i), top);
    for (std::uint8_t& value : alpha) value = opacity[value];
    return {};
  }
  if (payload.size() < 4) return bad_file("JPEG", "the tile is cut short");
  const std::size_t size = load_le<std::uint32_t>(payload.data());
  if (size > payload.size() - 4) return bad_file("JPEG", "the tile is cut short");
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const auto pixels = scratch.take(mosaic.pixels());
  SLF_TRY(decode_scan(tables, shape_of(mosaic, JpegColor::gray), payload.subspan(4, size), pixels));
  payload = payload.subspan(4 + size);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    const std::uint8_t value = pixels[pixel];
    alpha[sample] = value <= kNoise ? 0 : value >= 255 - kNoise ? 255 : value;
  });
  return {};
}

Result<Candidate> as_jpeg(const TileShape& tile, const Mosaic& mosaic, const JpegTables& tables,
                          std::span<const std::uint8_t> alpha) {
  Candidate result;
  result.payload.assign(5, static_cast<std::byte>(kInJpeg));
  encode_scan(tables, JpegCoefficients(gray_picture(tile, mosaic, alpha, true)), &result.payload,
              nullptr);
  store_le(&result.payload[1], static_cast<std::uint32_t>(result.payload.size() - 5));
  result.alpha.resize(alpha.size());
  ByteSpan rest = result.payload;
  SLF_TRY(read_jpeg_alpha(tile, mosaic, tables, rest, result.alpha));
  return result;
}

std::uint64_t squared(int a, int b) {
  const std::int64_t difference = a - b;
  return static_cast<std::uint64_t>(difference * difference);
}

/// Encodes the alpha of a tile, one byte per sample: exact, in steps, or as a grey JPEG, whichever
/// costs least; and appends it to `payload`. Replaces `alpha` by the values that read_jpeg_alpha
/// will decode. With `exact` the coding is lossless.
Result<void> append_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic,
                               const JpegTables& tables, bool exact, std::span<std::uint8_t> alpha,
                               Bytes& payload) {
  // An error in alpha also causes an error in the colour under it.
  const double error_of_a_byte = 8 * error_per_bit(tables.quantisation[0]) / 2;
  Candidate best;
  double min_cost = std::numeric_limits<double>::max();
  const auto consider = [&](Candidate candidate, std::uint64_t error) {
    const double cost = static_cast<double>(error) +
                        error_of_a_byte * static_cast<double>(candidate.payload.size());
    if (cost < min_cost) best = std::move(candidate), min_cost = cost;
  };
  std::array<std::uint64_t, 256> counts{};
  for (const std::uint8_t value : alpha) ++counts[value];
  for (const int top : {255, 85, 51, 15}) {
    if (exact && top != 255) break;
    Table steps, shown;
    std::uint64_t error = 0;
    for (std::size_t value = 0; value < 256; ++value) {
      steps[value] = to_steps(static_cast<std::uint8_t>(value), top);
      shown[value] = from_steps(steps[value], top);
      error += counts[value] * squared(static_cast<int>(value), shown[value]);
    }
    if (static_cast<double>(error) >= min_cost) continue;
    Candidate candidate = SLF_TRY(in_steps(tile, top, steps, shown, alpha));
    consider(std::move(candidate), error);
  }
  if (!exact && alpha.size() - counts[0] - counts[255] > alpha.size() / 8) {
    Candidate candidate = SLF_TRY(as_jpeg(tile, mosaic, tables, alpha));
    std::uint64_t error = 0;
    for (std::size_t i = 0; i < alpha.size(); ++i) error += squared(alpha[i], candidate.alpha[i]);
    consider(std::move(candidate), error);
  }
  payload.insert(payload.end(), best.payload.begin(), best.payload.end());
  std::copy(best.alpha.begin(), best.alpha.end(), alpha.begin());
  return {};
}

class JpegCodec final : public Codec {
 public:
  JpegCodec(SampleFormat format, const JpegOptions& options, const JpegTileTables& tables)
      : format_(format),
        options_(options),
        tables_(tables),
        table_bytes_(to_bytes(tables.color)),
        can_encode_(is_complete(tables.color) && is_complete(tables.depth)) {
    if (!has_depth(format)) return;
    const Bytes depth = to_bytes(tables.depth);
    table_bytes_.insert(table_bytes_.end(), depth.begin(), depth.end());
  }

  std::string spec() const override {
    std::string text = "jpeg:" + std::to_string(options_.quality);
    if (options_.color == JpegColor::ycbcr_444) text += ":444";
    return text;
  }
  bool lossless() const override { return false; }
  ByteSpan tables() const override { return table_bytes_; }

  Result<void> encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                      Bytes& payload) const override;
  Result<void> decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                      std::span<std::byte> samples) const override;

 private:
  Result<void> decode_depth(const TileShape& tile, ByteSpan& payload,
                            std::span<std::byte> depths) const;
  Result<void> decode_color(const TileShape& tile, const Mosaic& mosaic, ByteSpan payload,
                            std::span<std::byte> colors) const;

  SampleFormat format_;
  JpegOptions options_;
  JpegTileTables tables_;
  Bytes table_bytes_;
  bool can_encode_;
};

Result<void> JpegCodec::encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                               Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  if (!can_encode_) return bad_file("JPEG", "the shared tables lack codes");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(options_.color));
  if (!fits_jpeg(mosaic))
    return fail(ErrorCode::unsupported, "JPEG: a tile of ", tile.rows(), " pictures of side ",
                tile.side, " is too large");
  const auto colors = bytes_of(samples).first(tile.color_bytes());
  if (has_depth(format_)) {
    const Mosaic depth_mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
    const auto depths = bytes_of(samples).subspan(tile.color_bytes());
    Bytes scan;
    encode_scan(tables_.depth, JpegCoefficients(gray_picture(tile, depth_mosaic, depths, false)),
                &scan, nullptr);
    append_varint(payload, scan.size());
    payload.insert(payload.end(), scan.begin(), scan.end());
  }
  std::vector<std::uint8_t> alpha = alpha_of(colors);
  const bool exact = options_.quality >= kExactAlphaQuality;
  SLF_TRY(append_jpeg_alpha(tile, mosaic, tables_.color, exact, alpha, payload));
  if (std::all_of(alpha.begin(), alpha.end(), [](auto a) { return a == 0; })) return {};
  encode_scan(tables_.color,
              JpegCoefficients(color_picture(tile, mosaic, options_.color, colors, alpha)),
              &payload, nullptr);
  return {};
}

// Computes samples from the pixels of a mosaic and the alpha of each sample.
void blend(const TileShape& tile, const Mosaic& mosaic, std::span<const std::uint8_t> pixels,
           std::span<const std::uint8_t> alpha, std::span<std::byte> samples) {
  auto& scratch = per_thread<Scratch<std::uint32_t>>([] {});  // `samples` may have any alignment
  const auto words = scratch.take(alpha.size());
  const ByteSpan from = std::as_bytes(pixels);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    std::memcpy(&words[sample], &from[pixel * 4], 4);
  });
  premultiply(words, alpha);
  std::memcpy(samples.data(), words.data(), samples.size());
}

Result<void> JpegCodec::decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return bad_file("JPEG", "bytes for a tile without rows");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(options_.color));
  if (!fits_jpeg(mosaic))
    return bad_file("JPEG", "no tile of ", tile.rows(), " pictures of side ", tile.side, " fits");
  if (has_depth(format_)) SLF_TRY(decode_depth(tile, payload, samples.subspan(tile.color_bytes())));
  return decode_color(tile, mosaic, payload, samples.first(tile.color_bytes()));
}

Result<void> JpegCodec::decode_depth(const TileShape& tile, ByteSpan& payload,
                                     std::span<std::byte> depths) const {
  const Mosaic mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
  const auto size = take_varint(payload);
  if (!size || *size > payload.size()) return bad_file("JPEG", "the tile is cut short");
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const auto pixels = scratch.take(mosaic.pixels());
  SLF_TRY(
      decode_scan(tables_.depth, shape_of(mosaic, JpegColor::gray), payload.first(*size), pixels));
  payload = payload.subspan(*size);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    depths[sample] = static_cast<std::byte>(pixels[pixel]);
  });
  return {};
}

Result<void> JpegCodec::decode_color(const TileShape& tile, const Mosaic& mosaic, ByteSpan payload,
                                     std::span<std::byte> colors) const {
  auto& pixel_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  auto& alpha_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::size_t bytes = mosaic.pixels() * pixel_bytes(options_.color);
  // libjpeg-turbo writes rows that begin at multiples of 32 past the caches, where they are read
  // next: decoding would take a third longer.
  const auto space = pixel_scratch.take(bytes + 32);
  const auto pixels =
      space.subspan((48 - reinterpret_cast<std::uintptr_t>(space.data()) % 32) % 32, bytes);
  const auto alpha = alpha_scratch.take(tile.samples());
  SLF_TRY(read_jpeg_alpha(tile, mosaic, tables_.color, payload, alpha));
  if (payload.empty()) {
    // Only a tile that is transparent everywhere has no picture.
    if (std::any_of(alpha.begin(), alpha.end(), [](auto a) { return a != 0; }))
      return bad_file("JPEG", "the tile is cut short");
    std::fill(colors.begin(), colors.end(), std::byte{0});
    return {};
  }
  SLF_TRY(decode_scan(tables_.color, shape_of(mosaic, options_.color), payload, pixels));
  blend(tile, mosaic, pixels, alpha, colors);
  return {};
}

// Fits the Huffman codes of tables to pictures.
void fit_codes(const std::vector<JpegCoefficients>& pictures, JpegTables& tables) {
  if (pictures.empty()) return;
  // The best levels depend on the code and the best code on the levels, so iterate a few times.
  for (int round = 0; round < 3; ++round) {
    JpegCounts counts;
    for (const JpegCoefficients& picture : pictures) encode_scan(tables, picture, nullptr, &counts);
    for (std::size_t i = 0; i < 2; ++i) {
      tables.dc[i] = optimal_huffman(counts.dc[i], is_dc_symbol);
      tables.ac[i] = optimal_huffman(counts.ac[i], is_ac_symbol);
    }
  }
}

}  // namespace

JpegTileTables standard_tables(const JpegOptions& options) {
  return {standard_tables(options.quality), standard_tables(kDepthQuality)};
}

std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format, const JpegOptions& options,
                                       const JpegTileTables& tables) {
  return std::make_unique<JpegCodec>(format, options, tables);
}

JpegTileTables train_tables(SampleFormat format, const JpegOptions& options,
                            std::span<const TrainingTile> sample) {
  const JpegColor color = options.color;
  std::vector<JpegCoefficients> colors, depths;
  for (const TrainingTile& training : sample) {
    const TileShape& tile = training.tile;
    if (tile.bytes() == 0) continue;
    const Mosaic mosaic(tile.rows(), tile.side, alignment(color));
    if (!fits_jpeg(mosaic)) continue;
    const auto from = bytes_of(training.samples), rgba = from.first(tile.color_bytes());
    colors.emplace_back(color_picture(tile, mosaic, color, rgba, alpha_of(rgba)));
    if (!has_depth(format)) continue;
    const Mosaic depth_mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
    depths.emplace_back(gray_picture(tile, depth_mosaic, from.subspan(tile.color_bytes()), false));
  }
  JpegTileTables tables = standard_tables(options);
  fit_codes(colors, tables.color);
  fit_codes(depths, tables.depth);
  return tables;
}

}  // namespace slf::codec
