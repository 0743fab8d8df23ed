#include "benchmarks/storage/tile_set.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "benchmarks/storage/expect.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "slf/field.h"

namespace slf::bench {
namespace {

constexpr std::uint32_t kSide = 32;
constexpr std::size_t kPictures = 64;  // distinct ones; more would only take longer to make

struct Positions {
  std::vector<codec::LocalPoint> points;
};

std::shared_ptr<Positions> positions(std::size_t rows) {
  auto made = std::make_shared<Positions>();
  const auto edge = static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(rows))));
  for (std::size_t i = 0; i < rows; ++i)
    made->points.push_back(
        {static_cast<std::uint16_t>(i % edge), static_cast<std::uint16_t>(i / edge)});
  return made;
}

// An opaque picture of waves and a little noise. JPEG needs about as many bytes as for the most
// detailed tiles of a rendered volume.
Bytes picture(const TileShape& tile, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Bytes samples(tile.bytes());
  const double phase = static_cast<double>(seed % 97);
  const std::size_t columns = tile.columns();
  for (std::size_t i = 0; i < samples.size() / 4; ++i) {
    const double x = static_cast<double>(i % columns), y = static_cast<double>(i / columns);
    const double wave = 128 + 60 * std::sin(x * 0.05 + phase) + 30 * std::sin(y * 0.3 + phase);
    for (std::size_t c = 0; c < 3; ++c)
      samples[4 * i + c] =
          static_cast<std::byte>(std::clamp(wave + static_cast<double>(random() % 24), 0.0, 255.0));
    samples[4 * i + 3] = std::byte{255};
  }
  return samples;
}

Bytes encode(const codec::Codec& codec, const TileShape& tile, std::uint64_t seed) {
  Bytes payload;
  expect(codec.encode(tile, picture(tile, seed), nullptr, payload));
  return payload;
}

}  // namespace

std::uint64_t TileSet::bytes() const {
  std::uint64_t sum = 0;
  for (const Bytes& payload : payloads) sum += payload.size();
  return sum;
}

bool TileSet::jpeg_color() const {
  return codec && codec->spec().starts_with("jpeg") && !shapes.empty() &&
         shapes.front().format == codec::SampleFormat::rgba8;
}

void TileSet::decode(std::size_t tile, ByteSpan payload, Bytes& samples) const {
  samples.resize(shapes[tile].bytes());
  expect(codec->decode(shapes[tile], payload, nullptr, samples));
}

TileSet tiles_of_field(const std::string& path, std::size_t max_tiles) {
  const auto field = std::make_shared<const Field>(expect(Field::open(path)));
  TileSet set;
  set.level = static_cast<std::uint8_t>(field->shape().finest_level);
  std::vector<storage::TileRef> stored;
  expect(field->file().store().visit(first_key(set.level), first_key(set.level + 1u),
                                     [&](const storage::TileRef& tile) -> Result<void> {
                                       if (tile.state == storage::TileState::stored)
                                         stored.push_back(tile);
                                       return {};
                                     }));
  const std::size_t count = std::min(max_tiles, stored.size());
  require(count > 0, path + ": its finest level has no stored tiles");
  for (std::size_t i = 0; i < count; ++i) {
    const storage::TileRef& tile = stored[i * stored.size() / count];
    set.keys.push_back(tile.key.index);
    set.payloads.emplace_back(tile.payload.begin(), tile.payload.end());
    set.shapes.push_back(field->file().tile_shape(tile.key));
  }
  set.codec = std::shared_ptr<const codec::Codec>(field, &field->file().codec());
  set.owner = field;
  set.name = "field, " + std::to_string(set.bytes() / count) + " B";
  return set;
}

TileSet repeated(TileSet set, std::uint64_t bytes) {
  const std::size_t once = set.size();
  const std::uint64_t stride = set.keys.back() + 1, one = set.bytes();
  const std::size_t times = std::max<std::uint64_t>(1, bytes / one);
  for (std::size_t k = 1; k < times; ++k)
    for (std::size_t i = 0; i < once; ++i) {
      set.keys.push_back(k * stride + set.keys[i]);
      set.payloads.push_back(set.payloads[i]);
      set.shapes.push_back(set.shapes[i]);
    }
  set.name += ", " + std::to_string(times) + " times";
  return set;
}

TileSet synthetic_tiles(std::size_t payload_bytes, std::size_t count) {
  TileSet set;
  set.name = "synthetic, " + std::to_string(payload_bytes >> 10) + " KiB";
  set.codec = expect(codec::make_codec("jpeg:75", codec::SampleFormat::rgba8));
  // Encode one tile, to find the number of pictures that gives payloads of the requested size.
  constexpr std::size_t kTrial = 64;
  const auto few = positions(kTrial);
  const std::size_t bytes =
      encode(*set.codec, {codec::SampleFormat::rgba8, kSide, few->points}, 0).size();
  const auto rows = positions(std::max<std::size_t>(1, payload_bytes * kTrial / bytes));
  const TileShape shape{codec::SampleFormat::rgba8, kSide, rows->points};
  std::vector<Bytes> distinct;
  for (std::size_t i = 0; i < std::min(kPictures, count); ++i)
    distinct.push_back(encode(*set.codec, shape, i));
  for (std::size_t i = 0; i < count; ++i) {
    set.keys.push_back(i);
    set.payloads.push_back(distinct[i % distinct.size()]);
    set.shapes.push_back(shape);
  }
  set.owner = rows;
  return set;
}

TileSet opaque_tiles(std::size_t payload_bytes, std::size_t count) {
  TileSet set;
  set.name = std::to_string(count) + " tiles";
  std::mt19937_64 random(count);
  for (std::size_t i = 0; i < count; ++i) {
    set.keys.push_back(i);
    Bytes& payload = set.payloads.emplace_back(payload_bytes);
    for (std::size_t k = 0; k + 8 <= payload_bytes; k += 8)
      store_le<std::uint64_t>(&payload[k], random());
  }
  return set;
}

}  // namespace slf::bench
