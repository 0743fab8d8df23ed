#include "field/inspect/channel.h"

#include "base/half.h"
#include "base/try.h"

namespace slf {

std::optional<Channel> find_channel(const FieldFile& field, const std::string& name) {
  const std::vector<Layer>& layers = field.manifest().layers;
  if (const auto layer = field.layer(name)) {
    const SampleFormat format = layers[*layer].format;
    return Channel{*layer, color_format(format)};
  }
  const auto color = field.layer("color");
  if (name == "depth" && color && has_color_and_depth(layers[*color].format))
    return Channel{*color, SampleFormat::depth8};
  return std::nullopt;
}

Result<ByteSpan> ChannelReader::read(const Channel& channel, const storage::TileRef& tile) {
  const codec::Tile shape = field_.tile_shape(channel.layer, tile.key);
  const std::size_t count = shape.rows() * shape.columns();
  const std::size_t bytes = count * sample_bytes(channel.format);
  if (tile.state != storage::TileState::stored) {
    zeros_.assign(bytes, std::byte{0});
    return ByteSpan(zeros_);
  }
  if (decoded_ != std::pair(channel.layer, tile.key)) {
    decoded_.reset();
    samples_.resize(shape.bytes());
    SLF_TRY(field_.decode(tile, samples_));
    decoded_ = {channel.layer, tile.key};
  }
  const bool second = channel.format == SampleFormat::depth8 && has_color_and_depth(shape.format);
  return ByteSpan(samples_).subspan(second ? shape.bytes() - count : 0, bytes);
}

void to_floats(SampleFormat format, ByteSpan samples, std::vector<float>& numbers) {
  if (format == SampleFormat::rgba16f) {
    numbers.resize(samples.size() / 2);
    for (std::size_t k = 0; k < numbers.size(); ++k)
      numbers[k] = half_to_float(load_le<std::uint16_t>(samples.data() + 2 * k));
    return;
  }
  numbers.resize(samples.size());
  for (std::size_t k = 0; k < numbers.size(); ++k)
    numbers[k] = static_cast<float>(std::to_integer<int>(samples[k])) / 255.F;
}

}  // namespace slf
