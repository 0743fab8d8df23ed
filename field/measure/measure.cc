#include "slf/measure.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "base/file.h"
#include "base/guarded.h"
#include "base/reporter.h"
#include "base/sort_unique.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/measure/process_memory.h"

namespace slf {
namespace {

/// Records the peak of the process's resident memory during its lifetime.
class PeakMemoryMonitor {
 public:
  PeakMemoryMonitor() : thread_([this] { watch(); }) {}
  ~PeakMemoryMonitor() {
    stop_ = true;
    thread_.join();
  }
  [[nodiscard]] ResidentMemory peak() {
    update();
    return {anonymous_, file_};
  }

 private:
  void watch() {
    while (!stop_) {
      (void)guarded([this] { update(); });
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  void update() {
    const ResidentMemory now = resident_memory();
    raise(anonymous_, now.anonymous);
    raise(file_, now.file);
  }
  static void raise(std::atomic<std::uint64_t>& to, std::uint64_t value) {
    for (std::uint64_t old = to; old < value && !to.compare_exchange_weak(old, value);) continue;
  }

  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> anonymous_{0}, file_{0};
  std::thread thread_;
};

/// The cost of one view at one level, in the order of LevelMeasure's members.
enum Cost : std::size_t { kTiles, kPairs, kBytes, kPages, kCached, kMapped, kPeak, kCosts };
using ViewCost = std::array<double, kCosts>;

/// The files that a field is read from, each once, though several states are in it.
std::vector<const FieldFile*> distinct_files(const Field& field) {
  std::vector<const FieldFile*> files;
  for (const Field& source : sources_of(field))
    if (const FieldFile* file = &source.file(); std::ranges::find(files, file) == files.end())
      files.push_back(file);
  return files;
}

std::uint64_t pages_of(const FieldFile& field) {
  return (field.store().file_bytes() + 4095) / 4096;
}

/// The kernel's counts of a field's pages. Those of several files follow each other.
class PageCacheCounter {
 public:
  explicit PageCacheCounter(const Field& field) : files_(distinct_files(field)) {}

  /// Drops all pages from memory, and records which of them stay there.
  void begin() {
    dropped_ = true;
    for (const FieldFile* file : files_) {
      (void)madvise(map_of(*file), file->store().file_bytes(), MADV_DONTNEED);
      dropped_ = drop_page_cache(file->path()).has_value() && dropped_;
    }
    before_ = cached();
  }
  /// Whether the needed pages were read into memory since begin(): then the counts are right.
  [[nodiscard]] bool counts(std::span<const std::uint64_t> needed) const {
    return dropped_ && !before_.empty() &&
           std::ranges::none_of(needed, [&](std::uint64_t page) { return before_[page] & 1; });
  }
  /// Pages that were read into the page cache since begin().
  [[nodiscard]] std::uint64_t pages_read() const {
    const std::vector<unsigned char> now = cached();
    std::uint64_t count = 0;
    for (std::size_t page = 0; page < now.size(); ++page) count += now[page] & ~before_[page] & 1;
    return count;
  }
  /// Pages of the map that this process has mapped, from /proc/self/smaps.
  [[nodiscard]] std::uint64_t mapped() const {
    std::ifstream smaps("/proc/self/smaps");
    std::uint64_t kib = 0;
    bool ours = false;
    for (std::string line; std::getline(smaps, line);) {
      std::uintptr_t begin = 0, end = 0;
      unsigned long long rss = 0;
      if (std::sscanf(line.c_str(), "%lx-%lx ", &begin, &end) == 2)
        ours = std::ranges::any_of(files_, [&](const FieldFile* file) {
          const auto first = reinterpret_cast<std::uintptr_t>(map_of(*file));
          return begin < first + file->store().file_bytes() && end > first;
        });
      else if (ours && std::sscanf(line.c_str(), "Rss: %llu kB", &rss) == 1)
        kib += rss;
    }
    return kib / 4;
  }

 private:
  /// One byte per page, nonzero if it is in the page cache; empty if the kernel does not report it.
  [[nodiscard]] std::vector<unsigned char> cached() const {
    std::vector<unsigned char> pages;
    for (const FieldFile* file : files_) {
      const std::size_t first = pages.size();
      pages.resize(first + pages_of(*file));
      if (mincore(map_of(*file), file->store().file_bytes(), &pages[first]) != 0) return {};
    }
    return pages;
  }
  static std::byte* map_of(const FieldFile& file) {
    return const_cast<std::byte*>(file.store().map());
  }

  const std::vector<const FieldFile*> files_;
  bool dropped_ = false;
  std::vector<unsigned char> before_;
};

LevelMeasure summarize(unsigned level, std::uint64_t tiles, const std::vector<ViewCost>& views) {
  const auto spread = [&](Cost cost, double scale = 1) {
    MeanAndMax s;
    for (const ViewCost& view : views) {
      s.mean += view[cost] * scale / static_cast<double>(views.size());
      s.max = std::max(s.max, view[cost] * scale);
    }
    return s;
  };
  const double share = 1 / static_cast<double>(tiles);
  return {level,
          tiles,
          spread(kTiles),
          spread(kPairs),
          spread(kBytes),
          spread(kPages),
          spread(kCached),
          spread(kMapped),
          spread(kPeak),
          spread(kTiles, share),
          spread(kPairs, share)};
}

/// Evaluation::differs
std::string difference(const Field& field, std::span<const ClipPlane> clip, const Scene& scene) {
  auto built = nlohmann::json::parse(field.provenance(), nullptr, /*allow_exceptions=*/false);
  auto now = nlohmann::json::parse(scene.provenance(), nullptr, /*allow_exceptions=*/false);
  for (auto* json : {&built, &now})
    for (const char* member : {"source", "space", "step", "recipe"})
      if (json->is_object()) json->erase(member);
  for (const auto& [p, n] : clip)  // cut when it is drawn
    if (built.is_object()) built["clip"].push_back({p.x, p.y, p.z, n.x, n.y, n.z});
  const auto differences = nlohmann::json::diff(built, now);
  if (differences.empty()) return {};
  const std::string place = differences[0].value("path", "");
  return place.empty() ? "/" : place;
}

/// Adds the footprint of tiles in one file, whose first page has a number.
Result<void> add_footprint(const FieldFile& field, std::span<const TileKey> tiles,
                           std::uint64_t first_page, Footprint& sum) {
  for (const auto& tile : field.store().find_all(tiles)) {
    if (!tile) return tl::unexpected(tile.error());
    sum.stored_tiles += tile->state == storage::TileState::stored ? 1 : 0;
  }
  std::vector<TileKey> read(tiles.begin(), tiles.end());
  for (const auto& [key, tile] : field.find(tiles, {}, /*advise=*/false))
    read.insert(read.end(), tile.references.begin(), tile.references.end());
  sort_unique(read);
  for (const auto& tile : field.store().find_all(read)) {
    if (!tile) return tl::unexpected(tile.error());
    sum.compressed_bytes += tile->payload.size();
  }
  const auto pages = SLF_TRY(field.store().pages(read));
  for (const std::uint64_t page : pages) sum.pages.push_back(first_page + page);
  return {};
}

}  // namespace

Result<Footprint> footprint(const Field& field, std::span<const TileKey> tiles) try {
  Footprint sum;
  const auto distinct = distinct_files(field);
  for (const Field& source : sources_of(field)) {
    std::uint64_t first_page = 0;
    for (auto at = distinct.begin(); *at != &source.file(); ++at) first_page += pages_of(**at);
    SLF_TRY(add_footprint(source.file(), in_state(tiles, source.state()), first_page, sum));
  }
  sort_unique(sum.pages);
  return sum;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> drop_page_cache(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  // Dirty pages are not dropped.
  if (file.get() >= 0 && ::fsync(file.get()) == 0 &&
      ::posix_fadvise(file.get(), 0, 0, POSIX_FADV_DONTNEED) == 0)
    return {};
  return io_error(path, "cannot drop its cached pages");
}

ResidentMemory resident_memory() {
  ResidentMemory memory;
  std::ifstream status("/proc/self/status");
  for (std::string key; status >> key;) {
    std::uint64_t kib = 0;
    if (key == "RssAnon:" && status >> kib) memory.anonymous = kib << 10;
    if (key == "RssFile:" && status >> kib) memory.file = kib << 10;
  }
  return memory;
}

Result<Measurement> measure_views(const Field& field, const MeasureOptions& options,
                                  const ProgressCallback& progress) try {
  if (options.cameras.empty()) return fail(ErrorCode::usage, "views 0: expected at least one");
  std::vector<unsigned> levels = options.levels;
  if (levels.empty()) {
    levels.resize(field.shape().finest_level + 1);
    std::iota(levels.begin(), levels.end(), 0u);
  }
  Measurement result;
  Reporter reporter(progress, {0, levels.size() * options.cameras.size(), 0},
                    "measure interrupted");
  PeakMemoryMonitor watch;
  PageCacheCounter kernel(field);
  std::vector<ViewCost> total(options.cameras.size());
  std::uint64_t total_tiles = 0;
  for (const unsigned level : levels) {
    std::vector<ViewCost> views;
    for (std::size_t v = 0; v < options.cameras.size(); ++v) {
      kernel.begin();
      Renderer renderer(field, options.renderer);
      ViewStatistics statistics;
      ViewOptions view{options.mode, level};
      view.clip = options.clip, view.cap = options.cap;
      SLF_TRY(renderer.render(options.cameras[v], view, &statistics));
      const std::uint64_t read = kernel.pages_read(), mapped = kernel.mapped();
      const auto pairs = SLF_TRY(crossed_pairs(field.shape(), options.cameras[v], level));
      const auto file = SLF_TRY(footprint(field, statistics.tiles));
      const ViewCost cost{static_cast<double>(statistics.tiles.size()),
                          static_cast<double>(pairs.size()),
                          static_cast<double>(file.compressed_bytes),
                          static_cast<double>(file.pages.size()),
                          static_cast<double>(read),
                          static_cast<double>(mapped),
                          static_cast<double>(statistics.decoded_peak_bytes)};
      views.push_back(cost);
      result.kernel_counted = result.kernel_counted && kernel.counts(file.pages);
      for (std::size_t k = 0; k < kPeak; ++k) total[v][k] += cost[k];
      total[v][kPeak] = std::max(total[v][kPeak], cost[kPeak]);
      SLF_TRY(reporter.add(1));
    }
    const std::uint64_t tiles = tile_count(level, field.shape().entry_extra_levels);
    total_tiles += tiles;
    result.levels.push_back(summarize(level, tiles, views));
  }
  result.total = summarize(field.shape().finest_level, total_tiles, total);
  const ResidentMemory peak = watch.peak();
  result.rss_anon_peak = peak.anonymous;
  result.rss_file_peak = peak.file;
  return result;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<Evaluation> evaluate_views(const Field& field, const Scene& scene,
                                  const EvaluateOptions& options,
                                  const ProgressCallback& progress) try {
  const auto& cameras = options.cameras;
  const std::uint32_t supersample = options.supersample;
  if (cameras.empty()) return fail(ErrorCode::usage, "views 0: expected at least one");
  if (const auto light = field.light()) scene.set_light(*light);
  SLF_TRY(scene.prepare());
  Renderer renderer(field, options.renderer);
  Evaluation result;
  result.differs = difference(field, options.view.clip, scene);
  Progress all;
  for (const Camera& camera : cameras) all.total += std::uint64_t{supersample} * camera.height;
  const auto report = [&](const Progress& rows) {
    return !progress || progress({all.done + rows.done, all.total, 0});
  };
  for (const Camera& camera : cameras) {
    Camera finer = camera;
    finer.width *= supersample, finer.height *= supersample;
    const auto truth =
        SLF_TRY(trace_view(scene, field.shape().sphere, finer, options.renderer.threads, report));
    all.done += finer.height;
    auto image = SLF_TRY(renderer.render(camera, options.view));
    Image expected = shrink(truth, supersample);
    for (Image* picture : {&expected, &image})
      SLF_TRY(map_tones(field, std::nullopt, /*display=*/true, *picture));
    const ViewQuality& view = result.views.emplace_back(compare(expected, image));
    result.psnr += view.psnr / static_cast<double>(cameras.size());
    result.ssim += view.ssim / static_cast<double>(cameras.size());
  }
  return result;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
