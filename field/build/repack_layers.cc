#include "field/build/repack_layers.h"

#include <algorithm>

#include "base/half.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

using codec::SampleFormat;
using storage::LayerId;
using storage::TileState;

constexpr std::size_t kTrainingTiles = 16;

/// Copies samples and converts colour between formats. Premultiplied colours of 8 bits are clamped
/// to alpha.
void convert(SampleFormat from, SampleFormat to, std::span<const std::byte> in, Bytes& out) {
  if (from == to) {
    out.assign(in.begin(), in.end());
  } else if (to == SampleFormat::rgba16f) {
    out.resize(in.size() * 2);
    for (std::size_t k = 0; k < in.size(); ++k)
      store_le(&out[2 * k], half_from_byte(std::to_integer<std::uint8_t>(in[k])));
  } else {
    out.resize(in.size() / 2);
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = std::byte{byte_from_half(load_le<std::uint16_t>(&in[2 * k]))};
    for (std::size_t k = 0; k < out.size(); k += 4)
      for (std::size_t c = k; c < k + 3; ++c) out[c] = std::min(out[c], out[k + 3]);
  }
}

}  // namespace

Result<void> InputTile::samples(const FieldFile& field, const OutputLayer& out, Bytes& samples) {
  samples.clear();
  Bytes part;
  for (const LayerId from : out.from) {
    const auto decoded = SLF_TRY(layer(field, from));
    const ByteSpan in = *decoded;
    const SampleFormat input = field.manifest().layers[from].format, output = out.layer.format;
    const std::size_t count = in.size() / sample_bytes(input);
    if (input != SampleFormat::depth8 && output != SampleFormat::depth8) {
      convert(color_format(input), color_format(output),
              in.first(count * sample_bytes(color_format(input))), part);
      samples.insert(samples.end(), part.begin(), part.end());
    }
    const auto depths = [](SampleFormat of) {
      return of == SampleFormat::depth8 || has_color_and_depth(of);
    };
    if (depths(input) && depths(output)) samples.insert(samples.end(), in.end() - count, in.end());
  }
  return {};
}

Result<const Bytes*> InputTile::layer(const FieldFile& field, LayerId id) {
  const auto [place, added] = decoded_.try_emplace(id);
  if (!added) return &place->second;
  const auto tile = SLF_TRY(field.store().find(id, key_));
  place->second.resize(field.tile_shape(id, key_).bytes());
  SLF_TRY(field.decode(tile, place->second));
  return &place->second;
}

Result<TileState> state_of(const FieldFile& field, const OutputLayer& out, TileKey key) {
  TileState state = TileState::empty;
  for (const LayerId from : out.from) {
    const auto tile = SLF_TRY(field.store().find(from, key));
    if (tile.state == TileState::missing) return TileState::missing;
    state = tile.state;
  }
  return state;
}

namespace {

/// Fits shared tables to a few tiles spread over the finest level.
Result<std::unique_ptr<codec::Codec>> train(const FieldFile& field, const FieldShape& shape,
                                            const OutputLayer& out) {
  const TileOrder order(shape);
  std::vector<Bytes> samples;
  std::vector<codec::TrainingTile> tiles;
  InputTile input;
  const std::uint64_t begin = order.first_number(shape.levels);
  const std::uint64_t step = std::max<std::uint64_t>(1, (order.count() - begin) / 256);
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin + step / 2; n < order.count(); n += step) {
    const auto state = SLF_TRY(state_of(field, out, order.key(n)));
    if (state == TileState::stored) keys.push_back(order.key(n));
  }
  const std::size_t skip = std::max<std::size_t>(1, keys.size() / kTrainingTiles);
  for (std::size_t k = 0; k < keys.size() && samples.size() < kTrainingTiles; k += skip) {
    input.begin(keys[k]);
    SLF_TRY(input.samples(field, out, samples.emplace_back()));
  }
  for (std::size_t k = 0; k < samples.size(); ++k) {
    codec::Tile tile = field.tile_shape(out.from[0], keys[k * skip]);
    tile.format = out.layer.format;
    tiles.push_back({tile, samples[k]});
  }
  return codec::train_codec(out.layer.codec, out.layer.format, tiles, shape.levels);
}

/// The layers of the output, with the codecs of the options, or none yet where these are empty.
Result<std::vector<OutputLayer>> choose_layers(const FieldFile& field,
                                               const RepackOptions& options) {
  const auto& layers = field.manifest().layers;
  const LayerId color = field.layer("color").value();
  const bool together = has_color_and_depth(layers[color].format);
  const std::optional<LayerId> depth = together ? color : field.layer("depth");
  const auto selected = [&](const std::string& name) {
    return options.layers.empty() ||
           std::find(options.layers.begin(), options.layers.end(), name) != options.layers.end();
  };
  for (const std::string& name : options.layers)
    if (!(field.layer(name) || (name == "depth" && depth)))
      return fail(ErrorCode::usage, field.path(), ": has no layer '", name, "'");
  if (!selected("color"))
    return fail(ErrorCode::usage, field.path(), ": a field needs its color layer");

  const bool half =
      options.half.value_or(color_format(layers[color].format) == SampleFormat::rgba16f);
  const std::string& color_codec =
      options.color_codec.empty() ? layers[color].codec : options.color_codec;
  std::vector<OutputLayer> outputs;
  if (codec::is_predictive(color_codec)) {
    if (!depth || !selected("depth"))
      return fail(ErrorCode::usage, field.path(), ": codec \"", color_codec,
                  "\" needs depths, too; choose another codec of colour");
    if (!options.depth_codec.empty())
      return fail(ErrorCode::usage, "codec \"", color_codec,
                  "\" codes depth together with colour; choose another codec of colour, or leave "
                  "out that of depth");
    OutputLayer& out = outputs.emplace_back();
    out.from = together ? std::vector<LayerId>{color} : std::vector<LayerId>{color, *depth};
    out.layer = {"color", half ? SampleFormat::rgba16f_depth8 : SampleFormat::rgba8_depth8,
                 color_codec};
    return outputs;
  }
  for (LayerId id = 0; id < layers.size(); ++id) {
    if (!selected(layers[id].name)) continue;
    OutputLayer& out = outputs.emplace_back();
    out.from = {id};
    out.layer = layers[id];
    if (id == color) {
      out.layer.format = half ? SampleFormat::rgba16f : SampleFormat::rgba8;
      out.layer.codec = color_codec;
    } else if (layers[id].format == SampleFormat::depth8 && !options.depth_codec.empty()) {
      out.layer.codec = options.depth_codec;
    }
  }
  if (together && selected("depth")) {
    OutputLayer& out = outputs.emplace_back();
    out.from = {color};
    out.layer = {"depth", SampleFormat::depth8,
                 options.depth_codec.empty() ? "jpeg:75" : options.depth_codec};
  }
  return outputs;
}

}  // namespace

Result<std::vector<OutputLayer>> plan_layers(const FieldFile& field, const FieldShape& shape,
                                             const RepackOptions& options) {
  auto outputs = choose_layers(field, options);
  if (!outputs) return outputs;
  for (OutputLayer& out : *outputs) {
    const Layer& in = field.manifest().layers[out.from[0]];
    auto plain = codec::make_codec(out.layer.codec, out.layer.format);
    if (!plain && out.layer.codec == in.codec && plain.error().code == ErrorCode::unsupported) {
      out.layer.codec = "zstd";  // JPEG stores no half floats
      plain = codec::make_codec(out.layer.codec, out.layer.format);
    }
    if (!plain) return tl::unexpected(plain.error());
    const codec::Codec& now = field.codec(out.from[0]);
    // Tiles may be predicted from those of other subfields.
    const bool whole = !now.predictive() || shape.subfields == field.shape().subfields;
    out.copy = out.layer.format == in.format && (*plain)->spec() == now.spec() && whole;
    out.codec = SLF_TRY(out.copy ? codec::make_codec(in.codec, in.format, now.tables())
                                 : train(field, shape, out));
    out.layer.codec = out.codec->spec();
  }
  return outputs;
}

Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options) {
  FieldShape shape = field.shape();
  if (options.levels && *options.levels > shape.levels)
    return fail(ErrorCode::usage, field.path(), ": has levels 0 to ", shape.levels, ", not ",
                *options.levels);
  if (options.levels) shape.levels = *options.levels;
  for (const std::uint8_t subfield : options.subfields)
    if (!field.shape().has({0, std::uint64_t{subfield} << (2 * shape.entry_extra_levels)}))
      return fail(ErrorCode::usage, field.path(), ": has no subfield ", int{subfield});
  if (!options.subfields.empty()) shape.subfields = options.subfields;
  SLF_TRY(shape.check());
  return shape;
}

}  // namespace slf
