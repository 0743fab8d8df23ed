#include "field/inspect/channel.h"

#include "base/half.h"

namespace slf {

bool has_channel(const FieldFile& field, const std::string& name) {
  return name == "color" || (name == "depth" && field.has_depth());
}

ByteSpan channel_of(const TileShape& shape, ByteSpan samples, bool depth) {
  return depth ? samples.subspan(shape.color_bytes()) : samples.first(shape.color_bytes());
}

void to_floats(bool half, ByteSpan channel, std::vector<float>& numbers) {
  numbers.resize(channel.size() / (half ? 2 : 1));
  for (std::size_t k = 0; k < numbers.size(); ++k)
    numbers[k] = half ? half_to_float(load_le<std::uint16_t>(channel.data() + 2 * k))
                      : static_cast<float>(std::to_integer<int>(channel[k])) / 255.F;
}

}  // namespace slf
