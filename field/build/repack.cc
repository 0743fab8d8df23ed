#include "slf/repack.h"

#include <Imath/half.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

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
  std::vector<LayerId> from;  ///< of colour, of depth or, for both together, of both
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

/// A tile of the input, each layer of which is decoded at most once.
class InputTile {
 public:
  /// From here on it is another tile.
  void begin(TileKey key) {
    key_ = key;
    decoded_.clear();
  }

  /// Its samples in the format of an output. REQUIRES: all layers that it comes from are stored.
  Result<void> samples(const FieldFile& field, const OutputLayer& out, Bytes& samples) {
    samples.clear();
    Bytes part;
    for (const LayerId from : out.from) {
      const auto decoded = layer(field, from);
      if (!decoded) return tl::unexpected(decoded.error());
      const SampleFormat has = field.manifest().layers[from].format, wants = out.layer.format;
      ByteSpan in = **decoded;
      SampleFormat in_format = has, out_format = wants;
      if (has != wants && has == SampleFormat::rgba8_depth8) {
        const std::size_t color = in.size() / 5 * 4;
        in = wants == SampleFormat::depth8 ? in.subspan(color) : in.first(color);
        in_format = wants == SampleFormat::depth8 ? wants : SampleFormat::rgba8;
      }
      if (has != wants && wants == SampleFormat::rgba8_depth8)
        out_format = has == SampleFormat::depth8 ? has : SampleFormat::rgba8;
      convert(in_format, out_format, in, part);
      samples.insert(samples.end(), part.begin(), part.end());
    }
    return {};
  }

 private:
  Result<const Bytes*> layer(const FieldFile& field, LayerId id) {
    const auto [place, added] = decoded_.try_emplace(id);
    if (!added) return &place->second;
    const auto tile = field.store().find(id, key_);
    if (!tile) return tl::unexpected(tile.error());
    place->second.resize(field.tile_shape(id, key_).bytes());
    if (auto ok = field.decode(*tile, place->second); !ok) return tl::unexpected(ok.error());
    return &place->second;
  }

  TileKey key_;
  std::map<LayerId, Bytes> decoded_;
};

/// Whether an output's tile is stored, empty, or missing as long as one is that it comes from.
Result<TileState> state_of(const FieldFile& field, const OutputLayer& out, TileKey key) {
  TileState state = TileState::empty;
  for (const LayerId from : out.from) {
    const auto tile = field.store().find(from, key);
    if (!tile) return tl::unexpected(tile.error());
    if (tile->state == TileState::missing) return TileState::missing;
    state = tile->state;
  }
  return state;
}

/// Fits shared tables to a few tiles spread over the finest level.
Result<std::unique_ptr<codec::Codec>> train(const FieldFile& field, const FieldShape& shape,
                                            const OutputLayer& out) {
  const TileOrder order(shape);
  std::vector<Bytes> samples;
  std::vector<codec::TrainingTile> tiles;
  InputTile input;
  const std::uint64_t begin = order.number({static_cast<std::uint8_t>(shape.levels), 0});
  const std::uint64_t step = std::max<std::uint64_t>(1, (order.count() - begin) / 256);
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin + step / 2; n < order.count(); n += step) {
    const auto state = state_of(field, out, order.key(n));
    if (!state) return tl::unexpected(state.error());
    if (*state == TileState::stored) keys.push_back(order.key(n));
  }
  const std::size_t skip = std::max<std::size_t>(1, keys.size() / kTrainingTiles);
  for (std::size_t k = 0; k < keys.size() && samples.size() < kTrainingTiles; k += skip) {
    input.begin(keys[k]);
    if (auto ok = input.samples(field, out, samples.emplace_back()); !ok)
      return tl::unexpected(ok.error());
  }
  for (std::size_t k = 0; k < samples.size(); ++k) {
    codec::Tile tile = field.tile_shape(out.from[0], keys[k * skip]);
    tile.format = out.layer.format;
    tiles.push_back({tile, samples[k]});
  }
  return codec::train_codec(out.layer.codec, out.layer.format, tiles, shape.levels);
}

bool is_predictive(const std::string& codec) { return codec.starts_with("predictive"); }

/// The layers that the output is to have, their codecs as specified; empty: any that holds them.
Result<std::vector<OutputLayer>> choose_layers(const FieldFile& field,
                                               const RepackOptions& options) {
  const auto& layers = field.manifest().layers;
  const LayerId color = field.layer("color").value();
  const bool together = layers[color].format == SampleFormat::rgba8_depth8;
  const std::optional<LayerId> depth = together ? color : field.layer("depth");
  const auto wanted = [&](const std::string& name) {
    return options.layers.empty() ||
           std::find(options.layers.begin(), options.layers.end(), name) != options.layers.end();
  };
  for (const std::string& name : options.layers)
    if (!(field.layer(name) || (name == "depth" && depth)))
      return fail(ErrorCode::usage, field.path(), ": has no layer '", name, "'");
  if (!wanted("color"))
    return fail(ErrorCode::usage, field.path(), ": a field needs its color layer");

  const bool half = options.half.value_or(false);
  const std::string color_codec =
      options.color_codec.empty() && !half ? layers[color].codec : options.color_codec;
  std::vector<OutputLayer> outputs;
  if (is_predictive(color_codec)) {
    if (half)
      return fail(ErrorCode::unsupported, "codec \"", color_codec,
                  "\": holds colour of 8 bits; use zstd for half floats");
    if (!depth || !wanted("depth"))
      return fail(ErrorCode::usage, field.path(), ": codec \"", color_codec,
                  "\" needs depths, too; choose another codec of colour");
    if (!options.depth_codec.empty())
      return fail(ErrorCode::usage, "codec \"", color_codec,
                  "\" codes depth together with colour; choose another codec of colour, or leave "
                  "out that of depth");
    OutputLayer& out = outputs.emplace_back();
    out.from = together ? std::vector<LayerId>{color} : std::vector<LayerId>{color, *depth};
    out.layer = {"color", SampleFormat::rgba8_depth8, color_codec};
    return outputs;
  }
  for (LayerId id = 0; id < layers.size(); ++id) {
    if (!wanted(layers[id].name)) continue;
    OutputLayer& out = outputs.emplace_back();
    out.from = {id};
    out.layer = layers[id];
    if (id == color) {
      if (together) out.layer.format = SampleFormat::rgba8;
      if (options.half)
        out.layer.format = *options.half ? SampleFormat::rgba16f : SampleFormat::rgba8;
      if (!options.color_codec.empty()) out.layer.codec = options.color_codec;
      if (is_predictive(out.layer.codec)) out.layer.codec = "zstd";  // half floats
    } else if (layers[id].format == SampleFormat::depth8 && !options.depth_codec.empty()) {
      out.layer.codec = options.depth_codec;
    }
  }
  if (together && wanted("depth")) {
    OutputLayer& out = outputs.emplace_back();
    out.from = {color};
    out.layer = {"depth", SampleFormat::depth8,
                 options.depth_codec.empty() ? "jpeg:75" : options.depth_codec};
  }
  return outputs;
}

/// Chooses the layers and makes their codecs.
Result<std::vector<OutputLayer>> plan_layers(const FieldFile& field, const FieldShape& shape,
                                             const RepackOptions& options) {
  auto outputs = choose_layers(field, options);
  if (!outputs) return outputs;
  for (OutputLayer& out : *outputs) {
    const Layer& in = field.manifest().layers[out.from[0]];
    auto plain = codec::make_codec(out.layer.codec, out.layer.format);
    if (!plain && out.layer.codec == in.codec && plain.error().code == ErrorCode::unsupported) {
      out.layer.codec = "zstd";  // what JPEG cannot hold
      plain = codec::make_codec(out.layer.codec, out.layer.format);
    }
    if (!plain) return tl::unexpected(plain.error());
    const codec::Codec& now = field.codec(out.from[0]);
    // Tiles may be predicted from those of other subfields.
    const bool whole = !now.predictive() || shape.subfields == field.shape().subfields;
    out.copy = out.layer.format == in.format && (*plain)->spec() == now.spec() && whole;
    auto made =
        out.copy ? codec::make_codec(in.codec, in.format, now.tables()) : train(field, shape, out);
    if (!made) return tl::unexpected(made.error());
    out.codec = std::move(*made);
    out.layer.codec = out.codec->spec();
  }
  return outputs;
}

/// A tile on its way to the writer.
struct Recoded {
  std::vector<Bytes> payloads;
  std::vector<TileState> states;
};

/// `coarser` has what was written of the levels before, where tiles are predicted from it.
Result<Recoded> recode(const FieldFile& field, const FieldFile* coarser,
                       const std::vector<OutputLayer>& outputs, TileKey key, InputTile& input,
                       Bytes& samples) {
  Recoded tile;
  input.begin(key);
  for (std::size_t k = 0; k < outputs.size(); ++k) {
    const OutputLayer& out = outputs[k];
    Bytes& payload = tile.payloads.emplace_back();
    const auto state = state_of(field, out, key);
    if (!state) return tl::unexpected(state.error());
    tile.states.push_back(*state);
    if (*state != TileState::stored) continue;
    if (out.copy) {
      const auto found = field.store().find(out.from[0], key);
      if (!found) return tl::unexpected(found.error());
      if (auto ok = field.store().check(*found); !ok) return tl::unexpected(ok.error());
      payload.assign(found->payload.begin(), found->payload.end());
      continue;
    }
    auto ok = input.samples(field, out, samples);
    if (!ok && ok.error().code == ErrorCode::failed) {  // what it is predicted from is missing
      tile.states.back() = TileState::missing;
      continue;
    }
    codec::Tile shape = field.tile_shape(out.from[0], key);
    shape.format = out.layer.format;
    if (ok)
      ok = coarser && out.codec->predictive()
               ? coarser->encode(static_cast<LayerId>(k), key, samples, payload)
               : out.codec->encode(shape, samples, payload);
    if (!ok) return tl::unexpected(ok.error());
  }
  return tile;
}

/// Asks for the tiles with numbers in [begin, end), for an input that is not in memory.
void advise(const FieldFile& field, const std::vector<OutputLayer>& outputs, const TileOrder& order,
            std::uint64_t begin, std::uint64_t end) {
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin; n < std::min(end, order.count()); ++n) keys.push_back(order.key(n));
  std::vector<LayerId> layers;
  for (const OutputLayer& out : outputs)
    layers.insert(layers.end(), out.from.begin(), out.from.end());
  std::sort(layers.begin(), layers.end());
  layers.erase(std::unique(layers.begin(), layers.end()), layers.end());
  for (const LayerId layer : layers) {
    std::vector<storage::TileRef> tiles;
    for (const auto& tile : field.store().find_all(layer, keys))
      if (tile) tiles.push_back(*tile);
    field.advise(tiles);
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

/// Writes the tiles of an output.
class Repacking {
 public:
  Repacking(const FieldFile& field, const FieldShape& shape,
            const std::vector<OutputLayer>& outputs, const RepackOptions& options,
            FieldWriter& writer, const ProgressCallback& progress, RepackReport& report)
      : field_(field),
        outputs_(outputs),
        writer_(writer),
        progress_(progress),
        report_(report),
        order_(shape) {
    // A third of the budget for tiles under way, each at most decoded twice and encoded once per
    // layer; a third for records waiting for their commit; a third for LMDB's copies of their
    // pages. Tiles that others are predicted from take half of the first, in and out.
    predicts_ = std::any_of(outputs.begin(), outputs.end(), [](const OutputLayer& out) {
      return out.codec->predictive() && !out.copy;
    });
    const std::uint64_t share = options.memory / 3;
    references_ = share / 4;
    field.limit_references(references_);
    writer.set_pending_limit(share);
    const std::uint64_t under_way = field.predicts() || predicts_ ? share / 2 : share;
    const std::uint64_t tile_cost = shape.largest_tile() * 24 + 4096;
    threads_ = static_cast<unsigned>(
        std::clamp<std::uint64_t>(under_way / tile_cost, 1, thread_count(options.threads)));
    window_ = std::clamp<std::uint64_t>(under_way / tile_cost, 1, 8 * threads_);
    state_.total = order_.count();
  }

  Result<void> write() {
    for (std::uint64_t begin = 0, end = 0; begin < order_.count(); begin = end) {
      end = order_.count();
      std::shared_ptr<const FieldFile> written;
      if (predicts_) {  // level by level: from what is written
        end = order_.number({static_cast<std::uint8_t>(order_.key(begin).level + 1), 0});
        if (auto ok = writer_.commit_level(); !ok) return ok;
        auto opened = FieldFile::open(writer_.file());
        if (!opened) return tl::unexpected(opened.error());
        written = std::move(*opened);
        written->limit_references(references_);
      }
      if (auto ok = write(begin, end, written.get()); !ok) return ok;
    }
    return writer_.finish();
  }

 private:
  /// Recodes the tiles with numbers in [begin, end) on all threads and appends them in order.
  Result<void> write(std::uint64_t begin, std::uint64_t end, const FieldFile* coarser) {
    OrderedPipeline<Recoded> pipeline(end - begin, threads_, window_, [&] {
      return [&, input = InputTile(), samples = Bytes()](std::uint64_t n) mutable {
        return recode(field_, coarser, outputs_, order_.key(begin + n), input, samples);
      };
    });
    advise(field_, outputs_, order_, begin, begin + window_ + kAdvised);
    for (std::uint64_t n = begin; n < end; ++n) {
      if ((n - begin) % kAdvised == 0) {
        field_.store().release_all();  // what was read; the kernel still has it
        advise(field_, outputs_, order_, n + window_ + kAdvised, n + window_ + 2 * kAdvised);
      }
      const Result<Recoded> tile = pipeline.take();
      if (!tile) return tl::unexpected(tile.error());
      if (auto ok = put(order_.key(n), *tile); !ok) return ok;
      ++state_.done;
      if (progress_ && !progress_(state_))
        return fail(ErrorCode::failed, field_.path(), ": repack interrupted; nothing was written");
    }
    return {};
  }

  Result<void> put(TileKey key, const Recoded& tile) {
    for (std::size_t k = 0; k < tile.payloads.size(); ++k) {
      if (tile.states[k] == TileState::missing) {
        ++report_.missing;
        continue;
      }
      if (auto ok = writer_.put(static_cast<LayerId>(k), key, tile.payloads[k]); !ok) return ok;
      ++report_.tiles;
      ++(outputs_[k].copy ? report_.copied : report_.recoded);
      report_.payload_bytes += tile.payloads[k].size();
    }
    return {};
  }

  const FieldFile& field_;
  const std::vector<OutputLayer>& outputs_;
  FieldWriter& writer_;
  const ProgressCallback& progress_;
  RepackReport& report_;
  TileOrder order_;
  Progress state_;
  bool predicts_ = false;
  std::uint64_t references_ = 0;
  unsigned threads_ = 1;
  std::size_t window_ = 1;
};

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
  Repacking repacking(field, manifest.shape, *outputs, options, *writer, progress, report);
  if (auto ok = repacking.write(); !ok) return tl::unexpected(ok.error());
  std::error_code ignored;
  report.file_bytes = std::filesystem::file_size(output->target, ignored);
  return report;
}

}  // namespace slf
