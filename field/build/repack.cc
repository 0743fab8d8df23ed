#include "slf/repack.h"

#include <Imath/half.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "base/parallel.h"
#include "field/build/field_writer.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

using codec::SampleFormat;
using storage::LayerId;
using storage::TileState;

constexpr std::size_t kTrainingTiles = 16;
constexpr std::uint64_t kAdvised = 64;  // tiles that are asked for together

/// One layer of the output and where it comes from.
struct OutputLayer {
  LayerId from = 0;
  Layer layer;
  std::unique_ptr<codec::Codec> codec;
  bool copy = false;  ///< payloads need no recoding
};

std::byte eight_bits(std::uint16_t bits) {
  Imath::half value;
  value.setBits(bits);
  const float v = value;
  return static_cast<std::byte>(std::lround(v > 0 ? std::min(v, 1.f) * 255 : 0.f));  // NaN: 0
}

std::uint16_t half_bits(std::byte value) {
  return Imath::half(static_cast<float>(std::to_integer<int>(value)) / 255).bits();
}

/// Copies samples, colour from one format to the other. Eight bits of premultiplied colour are at
/// most those of alpha.
void convert(SampleFormat from, SampleFormat to, std::span<const std::byte> in, Bytes& out) {
  if (from == to) {
    out.assign(in.begin(), in.end());
  } else if (to == SampleFormat::rgba16f) {
    out.resize(in.size() * 2);
    for (std::size_t k = 0; k < in.size(); ++k) store_le(&out[2 * k], half_bits(in[k]));
  } else {
    out.resize(in.size() / 2);
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = eight_bits(load_le<std::uint16_t>(&in[2 * k]));
    for (std::size_t k = 0; k < out.size(); k += 4)
      for (std::size_t c = k; c < k + 3; ++c) out[c] = std::min(out[c], out[k + 3]);
  }
}

/// A tile's samples in the output's format. REQUIRES: tile is stored.
Result<void> decode_converted(const FieldFile& field, const storage::TileRef& tile, SampleFormat to,
                              Bytes& scratch, Bytes& samples) {
  const codec::Tile shape = field.tile_shape(tile.layer, tile.key);
  scratch.resize(shape.bytes());
  if (auto ok = field.decode(tile, scratch); !ok) return ok;
  convert(shape.format, to, scratch, samples);
  return {};
}

/// Fits shared tables to a few tiles spread over the finest level.
Result<std::unique_ptr<codec::Codec>> train(const FieldFile& field, const FieldShape& shape,
                                            const OutputLayer& out) {
  const TileOrder order(shape);
  std::vector<Bytes> samples;
  std::vector<codec::TrainingTile> tiles;
  Bytes scratch;
  const std::uint64_t begin = order.number({static_cast<std::uint8_t>(shape.levels), 0});
  const std::uint64_t step = std::max<std::uint64_t>(1, (order.count() - begin) / 256);
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin + step / 2; n < order.count(); n += step) {
    const auto tile = field.store().find(out.from, order.key(n));
    if (!tile) return tl::unexpected(tile.error());
    if (tile->state == TileState::stored) keys.push_back(tile->key);
  }
  const std::size_t skip = std::max<std::size_t>(1, keys.size() / kTrainingTiles);
  for (std::size_t k = 0; k < keys.size() && samples.size() < kTrainingTiles; k += skip) {
    const auto tile = field.store().find(out.from, keys[k]);
    if (!tile) return tl::unexpected(tile.error());
    if (auto ok = decode_converted(field, *tile, out.layer.format, scratch, samples.emplace_back());
        !ok)
      return tl::unexpected(ok.error());
  }
  for (std::size_t k = 0; k < samples.size(); ++k) {
    codec::Tile tile = field.tile_shape(out.from, keys[k * skip]);
    tile.format = out.layer.format;
    tiles.push_back({tile, samples[k]});
  }
  return codec::train_codec(out.layer.codec, out.layer.format, tiles);
}

Result<std::vector<OutputLayer>> plan_layers(const FieldFile& field, const FieldShape& shape,
                                             const RepackOptions& options) {
  std::vector<OutputLayer> outputs;
  for (const std::string& name : options.layers)
    if (!field.layer(name))
      return fail(ErrorCode::usage, field.path(), ": has no layer '", name, "'");
  for (LayerId id = 0; id < field.manifest().layers.size(); ++id) {
    const Layer& in = field.manifest().layers[id];
    if (!options.layers.empty() &&
        std::find(options.layers.begin(), options.layers.end(), in.name) == options.layers.end())
      continue;
    OutputLayer out{id, in, nullptr, false};
    const bool is_depth = in.format == SampleFormat::depth8;
    const std::string& wanted = is_depth ? options.depth_codec : options.color_codec;
    if (!is_depth && options.half)
      out.layer.format = *options.half ? SampleFormat::rgba16f : SampleFormat::rgba8;
    if (!wanted.empty()) out.layer.codec = wanted;
    auto plain = codec::make_codec(out.layer.codec, out.layer.format);
    if (!plain && wanted.empty() && plain.error().code == ErrorCode::unsupported) {
      out.layer.codec = "zstd";  // what JPEG cannot hold
      plain = codec::make_codec(out.layer.codec, out.layer.format);
    }
    if (!plain) return tl::unexpected(plain.error());
    out.copy = out.layer.format == in.format && (*plain)->spec() == field.codec(id).spec();
    auto made = out.copy ? codec::make_codec(in.codec, in.format, field.codec(id).tables())
                         : train(field, shape, out);
    if (!made) return tl::unexpected(made.error());
    out.codec = std::move(*made);
    out.layer.codec = out.codec->spec();
    outputs.push_back(std::move(out));
  }
  if (std::none_of(outputs.begin(), outputs.end(),
                   [](const OutputLayer& o) { return o.layer.name == "color"; }))
    return fail(ErrorCode::usage, field.path(), ": a field needs its color layer");
  return outputs;
}

/// A tile on its way to the writer.
struct Recoded {
  std::vector<Bytes> payloads;
  std::vector<TileState> states;
};

Result<Recoded> recode(const FieldFile& field, const std::vector<OutputLayer>& outputs, TileKey key,
                       Bytes& scratch, Bytes& samples) {
  Recoded tile;
  for (const OutputLayer& out : outputs) {
    Bytes& payload = tile.payloads.emplace_back();
    const auto found = field.store().find(out.from, key);
    if (!found) return tl::unexpected(found.error());
    tile.states.push_back(found->state);
    if (found->state != TileState::stored) continue;
    if (out.copy) {
      if (auto ok = field.store().check(*found); !ok) return tl::unexpected(ok.error());
      payload.assign(found->payload.begin(), found->payload.end());
      continue;
    }
    auto ok = decode_converted(field, *found, out.layer.format, scratch, samples);
    codec::Tile shape = field.tile_shape(out.from, key);
    shape.format = out.layer.format;
    if (ok) ok = out.codec->encode(shape, samples, payload);
    if (!ok) return tl::unexpected(ok.error());
  }
  return tile;
}

/// Asks for the tiles with numbers in [begin, end), for an input that is not in memory.
void advise(const FieldFile& field, const std::vector<OutputLayer>& outputs, const TileOrder& order,
            std::uint64_t begin, std::uint64_t end) {
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin; n < std::min(end, order.count()); ++n) keys.push_back(order.key(n));
  for (const OutputLayer& out : outputs) {
    std::vector<storage::TileRef> tiles;
    for (const auto& tile : field.store().find_all(out.from, keys))
      if (tile) tiles.push_back(*tile);
    field.store().advise(tiles);
  }
}

/// The shape of the output, checked.
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
  if (auto ok = shape.check(); !ok) return tl::unexpected(ok.error());
  return shape;
}

/// Recodes every tile on all threads and appends them in order.
Result<void> write_tiles(const FieldFile& field, const FieldShape& shape,
                         const std::vector<OutputLayer>& outputs, const RepackOptions& options,
                         FieldWriter& writer, const ProgressCallback& progress,
                         RepackReport& report) {
  // A third of the budget for tiles under way, each at most decoded twice and encoded once per
  // layer; a third for records waiting for their commit; a third for LMDB's copies of their pages.
  const TileOrder order(shape);
  const std::uint64_t share = options.memory / 3;
  writer.set_pending_limit(share);
  const std::uint64_t tile_cost = shape.largest_tile() * 24 + 4096;
  const auto threads = static_cast<unsigned>(
      std::clamp<std::uint64_t>(share / tile_cost, 1, thread_count(options.threads)));
  const std::size_t window = std::clamp<std::uint64_t>(share / tile_cost, 1, 8 * threads);
  OrderedPipeline<Recoded> pipeline(order.count(), threads, window, [&] {
    return [&, scratch = Bytes(), samples = Bytes()](std::uint64_t n) mutable {
      return recode(field, outputs, order.key(n), scratch, samples);
    };
  });

  Progress state;
  state.total = order.count();
  advise(field, outputs, order, 0, window + kAdvised);
  for (std::uint64_t n = 0; n < order.count(); ++n) {
    if (n % kAdvised == 0) {
      field.store().release_all();  // what was read; the kernel still has it for who needs it again
      advise(field, outputs, order, n + window + kAdvised, n + window + 2 * kAdvised);
    }
    const Result<Recoded> tile = pipeline.take();
    if (!tile) return tl::unexpected(tile.error());
    for (std::size_t k = 0; k < tile->payloads.size(); ++k) {
      if (tile->states[k] == TileState::missing) {
        ++report.missing;
        continue;
      }
      if (auto ok = writer.put(static_cast<LayerId>(k), order.key(n), tile->payloads[k]); !ok)
        return ok;
      ++report.tiles;
      ++(outputs[k].copy ? report.copied : report.recoded);
      report.payload_bytes += tile->payloads[k].size();
    }
    ++state.done;
    if (progress && !progress(state))
      return fail(ErrorCode::failed, field.path(), ": repack interrupted; nothing was written");
  }
  return writer.finish();
}

}  // namespace

Result<RepackReport> repack_field(const Field& handle, const std::string& path,
                                  const RepackOptions& options, const ProgressCallback& progress) {
  const FieldFile& field = handle.file();
  const auto output = FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep,
                                      std::span(&field.path(), 1));
  if (!output) return tl::unexpected(output.error());
  Manifest manifest = field.manifest();
  auto shape = plan_shape(field, options);
  if (!shape) return tl::unexpected(shape.error());
  manifest.shape = std::move(*shape);
  // What was the finest level may be left out: say what those below it hold.
  manifest.filtered_levels = field.manifest().filtered_levels.value_or(field.shape().levels);
  const auto outputs = plan_layers(field, manifest.shape, options);
  if (!outputs) return tl::unexpected(outputs.error());
  std::vector<ByteSpan> tables;
  manifest.layers.clear();
  for (const OutputLayer& out : *outputs) {
    manifest.layers.push_back(out.layer);
    tables.push_back(out.codec->tables());
  }
  auto writer = FieldWriter::create(*output, FieldWriter::Draft::discard, manifest, tables);
  if (!writer) return tl::unexpected(writer.error());

  RepackReport report;
  if (auto ok = write_tiles(field, manifest.shape, *outputs, options, *writer, progress, report);
      !ok)
    return tl::unexpected(ok.error());
  std::error_code ignored;
  report.file_bytes = std::filesystem::file_size(output->target, ignored);
  return report;
}

}  // namespace slf
