#include <algorithm>

#include "base/try.h"
#include "field/field_file.h"
#include "field/inspect/channel.h"
#include "slf/inspect.h"

namespace slf {

Result<TileSampleSet> read_tile(const TileReader& tiles, TileKey key, const std::string& name) try {
  const FieldFile& field = tiles.field().file();
  const bool depth = name == "depth";
  if (depth ? !field.has_depth() : name != "color")
    return misuse(field.path(), "has no channel '", name, "'");
  auto read = SLF_TRY(tiles.read(key));
  auto tile = std::make_shared<TileReader::Tile>(std::move(read));
  if (tile->missing())
    return fail(ErrorCode::tile_missing, field.place(in_state(key, tiles.field().state())),
                " is missing; the build command that made the field builds it");

  const TileShape shape = field.tile_shape(key);
  TileSampleSet set;
  set.numbers = depth ? 1 : 4;
  set.half = !depth && is_half(field.format());
  set.side = shape.side;
  set.empty = tile->colors().empty();
  for (const LocalPoint& position : shape.positions)
    set.entries.push_back({position.p, position.q});
  if (set.empty) {
    const auto zeros =
        std::make_shared<Bytes>(depth ? shape.samples() : shape.color_bytes(), std::byte{0});
    set.samples = *zeros;
    set.owner = zeros;
  } else {
    set.samples = depth ? tile->depths() : tile->colors();
    set.owner = std::move(tile);
  }
  return set;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

TileRays tile_rays(const Field& field, TileKey key) {
  const FieldShape& shape = field.shape();
  const TileSections sections = sections_of(key, shape.entry_extra_levels);
  const auto points = [&](Section section, std::uint32_t side, std::span<const LocalPoint> locals) {
    return world_points(shape.sphere, vertices_at(section, side, locals));
  };
  return {
      points(sections.entry, shape.entry_section_side(), field.file().tile_shape(key).positions),
      points(sections.exit, shape.exit_side, triangle_points(shape.exit_side))};
}

Result<Image> tile_picture(const TileReader& tiles, TileKey key, const std::string& channel) try {
  const auto set = SLF_TRY(read_tile(tiles, key, channel));
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
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
