#include "codec/jpeg_alpha.h"

#include <algorithm>
#include <vector>

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

Result<Candidate> in_steps(const TileShape& tile, int top, std::span<const std::uint8_t> alpha) {
  Candidate result;
  result.payload.push_back(static_cast<std::byte>(top));
  result.alpha.resize(alpha.size());
  for (std::size_t i = 0; i < alpha.size(); ++i) result.alpha[i] = to_steps(alpha[i], top);
  SLF_TRY(append_bytes(tile, std::as_bytes(std::span(result.alpha)), kZstdLevel, result.payload));
  for (std::uint8_t& value : result.alpha) value = from_steps(value, top);
  return result;
}

Result<Candidate> as_jpeg(const TileShape& tile, const Mosaic& mosaic, const JpegTables& tables,
                          std::span<const std::uint8_t> alpha) {
  Candidate result;
  result.payload.assign(5, static_cast<std::byte>(kInJpeg));
  encode_scan(tables, JpegCoefficients(alpha_picture(tile, mosaic, alpha)), &result.payload,
              nullptr);
  store_le(&result.payload[1], static_cast<std::uint32_t>(result.payload.size() - 5));
  result.alpha.resize(alpha.size());
  ByteSpan rest = result.payload;
  SLF_TRY(read_jpeg_alpha(tile, mosaic, tables, rest, result.alpha));
  return result;
}

double squared_error(std::span<const std::uint8_t> a, std::span<const std::uint8_t> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double difference = int{a[i]} - int{b[i]};
    sum += difference * difference;
  }
  return sum;
}

}  // namespace

Result<void> append_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic,
                               const JpegTables& tables, bool exact, std::span<std::uint8_t> alpha,
                               Bytes& payload) {
  std::vector<Result<Candidate>> candidates;
  candidates.push_back(in_steps(tile, 255, alpha));
  if (!exact) {
    for (const int top : {85, 51, 15}) candidates.push_back(in_steps(tile, top, alpha));
    const auto soft = std::count_if(alpha.begin(), alpha.end(),
                                    [](auto value) { return value != 0 && value != 255; });
    if (static_cast<std::size_t>(soft) > alpha.size() / 8)
      candidates.push_back(as_jpeg(tile, mosaic, tables, alpha));
  }
  // An error in alpha also causes an error in the colour under it.
  const double error_of_a_byte = 8 * error_per_bit(tables.quantisation[0]) / 2;
  const Candidate* best = nullptr;
  double min_cost = 0;
  for (const auto& candidate : candidates) {
    if (!candidate) return tl::unexpected(candidate.error());
    const double cost = squared_error(alpha, candidate->alpha) +
                        error_of_a_byte * static_cast<double>(candidate->payload.size());
    if (best && cost >= min_cost) continue;
    best = &*candidate;
    min_cost = cost;
  }
  payload.insert(payload.end(), best->payload.begin(), best->payload.end());
  std::copy(best->alpha.begin(), best->alpha.end(), alpha.begin());
  return {};
}

Result<void> read_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic, const JpegTables& tables,
                             ByteSpan& payload, std::span<std::uint8_t> alpha) {
  if (payload.empty()) return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
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
  if (payload.size() < 4) return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
  const std::size_t size = load_le<std::uint32_t>(payload.data());
  if (size > payload.size() - 4) return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
  thread_local Scratch<std::uint8_t> scratch;
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
