#include "slf/build.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "base/parallel.h"
#include "field/build/tile_tracer.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "storage/tile_store.h"
#include "storage/tile_writer.h"

namespace slf {
namespace {

using Clock = std::chrono::steady_clock;
using storage::LayerId;
using storage::TileWriter;

constexpr std::size_t kTrainingTiles = 16;
constexpr std::size_t kTrainingTries = 256;
constexpr std::uint64_t kCommitBytes = 32ull << 20;

std::uint64_t mix(std::uint64_t x) {  // splitmix64
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

/// Traces a few tiles of the finest level, spread over it, that are not empty.
std::vector<TracedTile> training_sample(const TileTracer& tracer, const FieldShape& shape) {
  std::vector<TracedTile> sample;
  const std::uint64_t count = tile_count(shape.levels, shape.entry_extra_levels);
  for (std::uint64_t t = 0; t < kTrainingTries && sample.size() < kTrainingTiles; ++t) {
    TracedTile tile;
    tracer.trace({static_cast<std::uint8_t>(shape.levels), mix(t) % count}, tile);
    if (!tile.empty) sample.push_back(std::move(tile));
  }
  return sample;
}

/// The layers' codecs, with shared tables fitted to the scene.
Result<std::vector<std::unique_ptr<codec::Codec>>> train_codecs(const TileTracer& tracer,
                                                                Manifest& manifest) {
  const auto sample = training_sample(tracer, manifest.shape);
  std::vector<std::unique_ptr<codec::Codec>> codecs;
  for (std::size_t k = 0; k < manifest.layers.size(); ++k) {
    std::vector<codec::TrainingTile> tiles;
    tiles.reserve(sample.size());
    for (const TracedTile& tile : sample)
      tiles.push_back({tracer.shape(tile.key, manifest.layers[k].format), tile.layers[k]});
    auto made = codec::train_codec(manifest.layers[k].codec, manifest.layers[k].format, tiles);
    if (!made) return tl::unexpected(made.error());
    manifest.layers[k].codec = (*made)->spec();
    codecs.push_back(std::move(*made));
  }
  return codecs;
}

ByteSpan text_bytes(const std::string& text) { return as_bytes(std::span<const char>(text)); }

Result<TileWriter> create(const std::string& path, const Manifest& manifest,
                          const std::vector<std::unique_ptr<codec::Codec>>& codecs) {
  std::vector<std::string> names;
  std::vector<std::pair<std::string, Bytes>> blobs;
  const std::string text = manifest.to_json().dump();
  const ByteSpan bytes = text_bytes(text);
  blobs.emplace_back(kManifestBlob, Bytes(bytes.begin(), bytes.end()));
  for (std::size_t k = 0; k < codecs.size(); ++k) {
    names.push_back(manifest.layers[k].name);
    const ByteSpan tables = codecs[k]->tables();
    blobs.emplace_back(kTablesBlobPrefix + manifest.layers[k].name,
                       Bytes(tables.begin(), tables.end()));
  }
  return TileWriter::create(path, names, blobs);
}

/// Which member of the manifest differs first, for the message.
std::string first_difference(const nlohmann::json& a, const nlohmann::json& b) {
  const auto patch = nlohmann::json::diff(a, b);
  return patch.empty() ? "" : patch[0].value("path", "");
}

/// Checks that the field at `path` is this very one, unfinished; returns its codecs.
Result<std::vector<std::unique_ptr<codec::Codec>>> codecs_to_resume(const std::string& path,
                                                                    Manifest& manifest) {
  auto field = FieldFile::open(path);
  if (!field) return tl::unexpected(field.error());
  std::vector<std::unique_ptr<codec::Codec>> codecs;
  for (std::size_t k = 0; k < manifest.layers.size(); ++k) {
    auto plain = codec::make_codec(manifest.layers[k].codec, manifest.layers[k].format);
    if (!plain) return tl::unexpected(plain.error());
    manifest.layers[k].codec = (*plain)->spec();
  }
  const std::string differs = first_difference((*field)->manifest().to_json(), manifest.to_json());
  if (!differs.empty())
    return fail(ErrorCode::usage, path, ": exists and was built with other settings (", differs,
                " differs); choose another output or remove it (-f)");
  const auto content = (*field)->content();
  if (!content) return tl::unexpected(content.error());
  if (content->complete)
    return fail(ErrorCode::usage, path, ": exists and is complete; choose another output or -f");
  for (const Layer& layer : manifest.layers) {
    const auto tables = (*field)->store().blob(kTablesBlobPrefix + layer.name);
    if (!tables) return tl::unexpected(tables.error());
    auto made = codec::make_codec(layer.codec, layer.format, *tables);
    if (!made) return tl::unexpected(made.error());
    codecs.push_back(std::move(*made));
  }
  return codecs;
}

/// A tile on its way from a worker to the writer.
struct Encoded {
  std::vector<Bytes> payloads;  // per layer; all empty for an empty tile
  std::uint64_t rays = 0;       // that it took, about
};

/// What a build works with, once everything is checked.
struct Job {
  const TileTracer& tracer;
  const Manifest& manifest;
  const std::vector<std::unique_ptr<codec::Codec>>& codecs;
  TileOrder order;
  unsigned threads;

  Result<Encoded> make(TileKey key, TracedTile& traced) const {
    Encoded encoded;
    tracer.trace(key, traced);
    encoded.rays = tracer.rays(key);
    encoded.payloads.resize(codecs.size());
    for (std::size_t k = 0; k < codecs.size() && !traced.empty; ++k) {
      auto ok = codecs[k]->encode(tracer.shape(key, manifest.layers[k].format), traced.layers[k],
                                  encoded.payloads[k]);
      if (!ok) return tl::unexpected(std::move(ok.error()));
    }
    return encoded;
  }

  /// Makes the tiles of these numbers, in order, on all threads.
  [[nodiscard]] OrderedPipeline<Encoded> pipeline(
      std::uint64_t count, const std::function<std::uint64_t(std::uint64_t)>& number) const {
    return {count, threads, 4 * threads, [this, number] {
              return [this, number, traced = TracedTile()](std::uint64_t k) mutable {
                return make(order.key(number(k)), traced);
              };
            }};
  }
};

/// What follows each tile handed to the writer: it is counted, and now and then all is committed.
class Steps {
 public:
  Steps(TileWriter& writer, const std::string& path, const BuildOptions& options,
        const ProgressCallback& progress, Progress& state, BuildReport& report)
      : writer_(writer),
        path_(path),
        interval_(options.commit_seconds),
        progress_(progress),
        state_(state),
        report_(report) {}

  /// failed: the progress callback stops the build.
  [[nodiscard]] Result<void> after(const Encoded& tile) {
    ++report_.tiles;
    state_.done += tile.rays;
    if (writer_.pending_bytes() >= kCommitBytes || Clock::now() - committed_at_ >= interval_)
      if (auto ok = commit(); !ok) return ok;
    if (!progress_ || progress_(state_)) return {};
    if (auto ok = commit(); !ok) return ok;
    return fail(ErrorCode::failed, path_, ": interrupted; the same command goes on from here");
  }

 private:
  [[nodiscard]] Result<void> commit() {
    committed_at_ = Clock::now();
    return writer_.commit();
  }

  TileWriter& writer_;
  const std::string& path_;
  std::chrono::duration<double> interval_;
  const ProgressCallback& progress_;
  Progress& state_;
  BuildReport& report_;
  Clock::time_point committed_at_ = Clock::now();
};

/// Appends every tile from number `resumed` on. `begin` says, per layer, where its tiles end.
Result<void> append_tiles(const Job& job, TileWriter& writer,
                          const std::vector<std::uint64_t>& begin, std::uint64_t resumed,
                          Steps& steps) {
  auto pipeline =
      job.pipeline(job.order.count() - resumed, [resumed](std::uint64_t k) { return resumed + k; });
  for (std::uint64_t number = resumed; number < job.order.count(); ++number) {
    const Result<Encoded> tile = pipeline.take();
    if (!tile) return tl::unexpected(tile.error());
    for (std::size_t k = 0; k < begin.size(); ++k) {
      if (number < begin[k]) continue;
      if (auto ok =
              writer.append(static_cast<LayerId>(k), job.order.key(number), tile->payloads[k]);
          !ok)
        return ok;
    }
    if (auto ok = steps.after(*tile); !ok) return ok;
  }
  return {};
}

/// A tile that some layers lack: dropped by verify --fix as damaged.
struct Hole {
  std::uint64_t number = 0;
  std::vector<LayerId> layers;
};

/// The holes below number `end`, in order.
Result<std::vector<Hole>> find_holes(const std::string& path, const TileOrder& order,
                                     std::size_t layers, std::uint64_t end) {
  std::map<std::uint64_t, std::vector<LayerId>> lacking;
  if (end == 0) return std::vector<Hole>();
  const auto field = FieldFile::open(path);
  if (!field) return tl::unexpected(field.error());
  for (LayerId layer = 0; layer < layers; ++layer) {
    std::uint64_t expected = 0;
    const auto missing_before = [&](std::uint64_t number) {
      for (; expected < std::min(number, end); ++expected) lacking[expected].push_back(layer);
    };
    const auto ok = (*field)->store().visit(layer, {0, 0}, {255, 0},
                                            [&](const storage::TileRef& tile) -> Result<void> {
                                              const std::uint64_t number = order.number(tile.key);
                                              missing_before(number);
                                              expected = number + 1;
                                              return {};
                                            });
    if (!ok) return tl::unexpected(ok.error());
    missing_before(end);
  }
  std::vector<Hole> holes;
  for (auto& [number, of] : lacking) holes.push_back({number, std::move(of)});
  return holes;
}

Result<void> fill_holes(const Job& job, TileWriter& writer, const std::vector<Hole>& holes,
                        Steps& steps) {
  auto pipeline = job.pipeline(holes.size(), [&holes](std::uint64_t k) { return holes[k].number; });
  for (const Hole& hole : holes) {
    const Result<Encoded> tile = pipeline.take();
    if (!tile) return tl::unexpected(tile.error());
    for (const LayerId layer : hole.layers) {
      const Bytes& payload = tile->payloads[layer];
      const auto tile_state =
          payload.empty() ? storage::TileState::empty : storage::TileState::stored;
      if (auto ok = writer.replace(layer, job.order.key(hole.number), tile_state, payload); !ok)
        return ok;
    }
    if (auto ok = steps.after(*tile); !ok) return ok;
  }
  return {};
}

}  // namespace

Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                const BuildOptions& options, const ProgressCallback& progress) {
  Manifest manifest;
  manifest.shape = options.shape;
  if (!(manifest.shape.sphere.radius > 0)) manifest.shape.sphere = scene.bounds();
  if (auto ok = manifest.shape.check(); !ok) return tl::unexpected(ok.error());
  manifest.layers.push_back(
      {"color", options.half ? codec::SampleFormat::rgba16f : codec::SampleFormat::rgba8,
       options.color_codec});
  if (!options.depth_codec.empty())
    manifest.layers.push_back({"depth", codec::SampleFormat::depth8, options.depth_codec});
  manifest.provenance = nlohmann::json::parse(scene.provenance(), nullptr, false);
  if (!manifest.provenance.is_object())
    return fail(ErrorCode::usage, "the scene's provenance is not a JSON object");

  const TileTracer tracer(scene, manifest);
  const bool exists = std::filesystem::exists(path);
  auto codecs = exists ? codecs_to_resume(path, manifest) : train_codecs(tracer, manifest);
  if (!codecs) return tl::unexpected(codecs.error());
  auto writer = exists ? TileWriter::resume(path) : create(path, manifest, *codecs);
  if (!writer) return tl::unexpected(writer.error());

  // What is there already, per layer: building goes on after the least of them, and in holes.
  const Job job{tracer, manifest, *codecs, TileOrder(manifest.shape),
                thread_count(options.threads)};
  std::vector<std::uint64_t> begin(codecs->size(), 0);
  for (std::size_t k = 0; k < begin.size(); ++k) {
    const auto last = writer->last(static_cast<LayerId>(k));
    if (!last) return tl::unexpected(last.error());
    if (*last) begin[k] = job.order.number(**last) + 1;
  }
  const std::uint64_t resumed = *std::min_element(begin.begin(), begin.end());
  const auto holes = find_holes(path, job.order, begin.size(), resumed);
  if (!holes) return tl::unexpected(holes.error());

  BuildReport report;
  report.resumed = resumed - holes->size();
  Progress state;
  for (unsigned level = 0; level <= manifest.shape.levels; ++level)
    state.total += tracer.rays(level);
  for (std::uint64_t n = 0; n < resumed; ++n) state.skipped += tracer.rays(job.order.key(n));
  for (const Hole& hole : *holes) state.skipped -= tracer.rays(job.order.key(hole.number));
  state.done = state.skipped;

  Steps steps(*writer, path, options, progress, state, report);
  if (auto ok = fill_holes(job, *writer, *holes, steps); !ok) return tl::unexpected(ok.error());
  if (auto ok = append_tiles(job, *writer, begin, resumed, steps); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = writer->close(); !ok) return tl::unexpected(ok.error());
  return report;
}

}  // namespace slf
