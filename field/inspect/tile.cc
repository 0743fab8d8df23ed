#include <algorithm>

#include "base/try.h"
#include "field/inspect/channel.h"
#include "slf/inspect.h"

namespace slf {

namespace {
constexpr std::uint64_t kMemory = 32ull << 20;  // for the tiles that it is predicted from
}

Result<TileSampleSet> read_tile(const Field& handle, TileKey key, const std::string& name) {
  const FieldFile& field = handle.file();
  if (!has_channel(field, name))
    return fail(ErrorCode::usage, field.path(), ": has no channel '", name, "'");
  const auto tile = SLF_TRY(field.store().find(key));
  if (tile.state == storage::TileState::missing)
    return fail(ErrorCode::failed, field.path(), ": tile ", int{key.level}, "/", key.index,
                " is missing; the build command that made the field builds it");
  Bytes samples;
  TileCache tiles(field, kMemory);
  SLF_TRY(read_samples(tiles, tile, samples));

  const bool depth = name == "depth";
  const codec::Tile shape = field.tile_shape(key);
  TileSampleSet set;
  set.numbers = depth ? 1 : 4;
  set.half = !depth && is_half(field.format());
  set.side = shape.side;
  set.empty = tile.state == storage::TileState::empty;
  for (const codec::LocalPoint& position : shape.positions)
    set.entries.push_back({position.p, position.q});
  const ByteSpan channel = channel_of(shape, samples, depth);
  set.samples.assign(channel.begin(), channel.end());
  return set;
}

Result<Image> tile_picture(const Field& field, TileKey key, const std::string& channel) {
  const auto set = SLF_TRY(read_tile(field, key, channel));
  std::vector<float> numbers;
  to_floats(set.half, set.samples, numbers);

  // A transparent line separates the pictures.
  const std::uint32_t cell = set.side + 2;
  Image image;
  for (const TileSampleSet::Place& entry : set.entries) {
    image.width = std::max(image.width, (entry.p + 1) * cell - 1);
    image.height = std::max(image.height, (entry.q + 1) * cell - 1);
  }
  image.rgba.assign(std::size_t{image.width} * image.height, glm::vec4(0));
  const float* number = numbers.data();
  for (const TileSampleSet::Place& entry : set.entries)
    for (std::uint32_t q = 0; q <= set.side; ++q)
      for (std::uint32_t p = 0; p + q <= set.side; ++p) {
        const std::size_t x = entry.p * cell + p, y = entry.q * cell + q;
        glm::vec4& pixel = image.rgba[y * image.width + x];
        pixel = set.numbers == 1 ? glm::vec4(*number, *number, *number, 1)
                                 : glm::vec4(number[0], number[1], number[2], number[3]);
        number += set.numbers;
      }
  return image;
}

}  // namespace slf
