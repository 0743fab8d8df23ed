#include "field/build.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "field/field.h"
#include "field/parallel.h"
#include "field/tile_tracer.h"
#include "storage/tile_store.h"

namespace slf {
namespace {

using Clock = std::chrono::steady_clock;
using storage::LayerId;
using storage::TileWriter;

constexpr std::size_t kTrainingTiles = 16;
constexpr std::size_t kTrainingTries = 256;
constexpr std::uint64_t kCommitBytes = 32ull << 20;
constexpr auto kCommitInterval = std::chrono::seconds(1);  // what a kill can cost

/// All tiles of a field in key order, numbered through the levels.
class TileOrder {
 public:
  explicit TileOrder(const FieldShape& shape) : shape_(shape) {
    for (unsigned level = 0; level <= shape.levels; ++level) {
      first_.push_back(count_);
      count_ += tile_count(level, shape.entry_depth);
    }
  }
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] TileKey key(std::uint64_t number) const {
    std::size_t level = first_.size() - 1;
    while (first_[level] > number) --level;
    return {static_cast<std::uint8_t>(level), number - first_[level]};
  }
  [[nodiscard]] std::uint64_t number(TileKey key) const { return first_[key.level] + key.index; }

 private:
  FieldShape shape_;
  std::vector<std::uint64_t> first_;
  std::uint64_t count_ = 0;
};

std::uint64_t mix(std::uint64_t x) {  // splitmix64
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

/// Traces a few tiles of the finest level, spread over it, that are not empty.
std::vector<TracedTile> training_sample(const TileTracer& tracer, const FieldShape& shape) {
  std::vector<TracedTile> sample;
  const std::uint64_t count = tile_count(shape.levels, shape.entry_depth);
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
  auto field = Field::open(path);
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
  std::uint64_t slabs = 0;
  std::optional<Error> error;
  bool ready = false;
};

/// Traces and encodes tiles on all cores; hands them out in order, never more than a window ahead.
class TilePipeline {
 public:
  TilePipeline(const TileTracer& tracer, const TileOrder& order, const Manifest& manifest,
               const std::vector<std::unique_ptr<codec::Codec>>& codecs,
               std::vector<std::uint64_t> numbers, unsigned threads)
      : tracer_(tracer),
        order_(order),
        manifest_(manifest),
        codecs_(codecs),
        numbers_(std::move(numbers)),
        slots_(4 * threads) {
    for (unsigned t = 0; t < threads; ++t) workers_.emplace_back([this] { work(); });
  }
  ~TilePipeline() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    for (auto& worker : workers_) worker.join();
  }

  /// The next tile in order. REQUIRES: called at most numbers.size() times.
  Encoded take() {
    std::unique_lock lock(mutex_);
    Encoded& slot = slots_[taken_ % slots_.size()];
    changed_.wait(lock, [&] { return slot.ready; });
    Encoded tile = std::exchange(slot, {});
    ++taken_;
    lock.unlock();
    changed_.notify_all();
    return tile;
  }

 private:
  void work() {
    TracedTile traced;
    for (;;) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] {
        return stop_ || next_ == numbers_.size() || next_ < taken_ + slots_.size();
      });
      if (stop_ || next_ == numbers_.size()) return;
      const std::size_t mine = next_++;
      lock.unlock();
      Encoded encoded = encode(order_.key(numbers_[mine]), traced);
      encoded.ready = true;
      lock.lock();
      slots_[mine % slots_.size()] = std::move(encoded);
      lock.unlock();
      changed_.notify_all();
    }
  }

  Encoded encode(TileKey key, TracedTile& traced) const {
    Encoded encoded;
    tracer_.trace(key, traced);
    encoded.slabs = traced.slabs;
    encoded.payloads.resize(codecs_.size());
    for (std::size_t k = 0; k < codecs_.size() && !traced.empty; ++k) {
      const auto ok = codecs_[k]->encode(tracer_.shape(key, manifest_.layers[k].format),
                                         traced.layers[k], encoded.payloads[k]);
      if (!ok) encoded.error = ok.error();
    }
    return encoded;
  }

  const TileTracer& tracer_;
  const TileOrder& order_;
  const Manifest& manifest_;
  const std::vector<std::unique_ptr<codec::Codec>>& codecs_;
  std::vector<std::uint64_t> numbers_;
  std::vector<Encoded> slots_;
  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t next_ = 0;
  std::size_t taken_ = 0;
  bool stop_ = false;
};

}  // namespace

Result<BuildReport> build_field(const Scene& scene, const std::string& path, BuildOptions options,
                                const ProgressCallback& progress) {
  Manifest manifest;
  manifest.shape = options.shape;
  if (!(manifest.shape.sphere.radius > 0)) manifest.shape.sphere = scene.bounds();
  if (auto ok = manifest.shape.check(); !ok) return tl::unexpected(ok.error());
  manifest.layers.push_back(
      {"color", options.half ? codec::SampleFormat::rgba16f : codec::SampleFormat::rgba8,
       options.color_codec});
  if (!options.depth_codec.empty())
    manifest.layers.push_back({"depth", codec::SampleFormat::depth8, options.depth_codec});
  manifest.provenance = scene.provenance();

  const TileTracer tracer(scene, manifest);
  const bool exists = std::filesystem::exists(path);
  auto codecs = exists ? codecs_to_resume(path, manifest) : train_codecs(tracer, manifest);
  if (!codecs) return tl::unexpected(codecs.error());
  auto writer = exists ? TileWriter::resume(path) : create(path, manifest, *codecs);
  if (!writer) return tl::unexpected(writer.error());

  // What is there already, per layer: building goes on after the least of them.
  const TileOrder order(manifest.shape);
  std::vector<std::uint64_t> begin(codecs->size(), 0);
  for (std::size_t k = 0; k < begin.size(); ++k) {
    const auto last = writer->last(static_cast<LayerId>(k));
    if (!last) return tl::unexpected(last.error());
    if (*last) begin[k] = order.number(**last) + 1;
  }
  BuildReport report;
  report.resumed = *std::min_element(begin.begin(), begin.end());

  Progress state;
  for (unsigned level = 0; level <= manifest.shape.levels; ++level)
    state.total += tracer.slabs(level);
  for (std::uint64_t n = 0; n < report.resumed; ++n) state.skipped += tracer.slabs(order.key(n));
  state.done = state.skipped;

  const unsigned threads = thread_count(options.threads);
  std::vector<std::uint64_t> numbers;
  for (std::uint64_t n = report.resumed; n < order.count(); ++n) numbers.push_back(n);
  TilePipeline pipeline(tracer, order, manifest, *codecs, numbers, threads);

  std::uint64_t uncommitted = 0;
  auto committed_at = Clock::now();
  for (const std::uint64_t number : numbers) {
    const TileKey key = order.key(number);
    const Encoded tile = pipeline.take();
    if (tile.error) return tl::unexpected(*tile.error);
    for (std::size_t k = 0; k < begin.size(); ++k) {
      if (number < begin[k]) continue;
      if (auto ok = writer->append(static_cast<LayerId>(k), key, tile.payloads[k]); !ok)
        return tl::unexpected(ok.error());
      uncommitted += tile.payloads[k].size();
    }
    ++report.tiles;
    report.slabs += tile.slabs;
    state.done += tile.slabs;
    if (uncommitted >= kCommitBytes || Clock::now() - committed_at >= kCommitInterval) {
      if (auto ok = writer->commit(); !ok) return tl::unexpected(ok.error());
      uncommitted = 0;
      committed_at = Clock::now();
    }
    if (progress && !progress(state)) {
      if (auto ok = writer->commit(); !ok) return tl::unexpected(ok.error());
      return fail(ErrorCode::failed, path, ": interrupted; the same command goes on from here");
    }
  }
  if (auto ok = writer->close(); !ok) return tl::unexpected(ok.error());
  return report;
}

}  // namespace slf
