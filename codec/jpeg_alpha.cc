#include "codec/jpeg_alpha.h"

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "base/per_thread.h"
#include "base/try.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "codec/jpeg_pictures.h"
#include "codec/lane_samples.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

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

}  // namespace

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

}  // namespace slf::codec
