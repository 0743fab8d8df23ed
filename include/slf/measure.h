// Measuring: what views of a field cost in memory, and how close they come to the truth.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/render.h"
#include "slf/scene.h"

namespace slf {

/// What tiles take in the file.
struct Footprint {
  std::uint64_t stored_tiles = 0;      ///< not empty
  std::uint64_t compressed_bytes = 0;  ///< payloads, in the layers used
  /// Numbers of the 4 KiB pages that finding and reading them touches, ascending: of the tree, of
  /// the records' tables, of the payloads.
  std::vector<std::uint64_t> pages;
};

/// Looks tiles up in the color layer, or with_depth in both. bad_file: the file is damaged.
[[nodiscard]] Result<Footprint> footprint(const Field& field, std::span<const TileKey> tiles,
                                          bool with_depth);

/// Mean and maximum over views.
struct MeanAndMax {
  double mean = 0;
  double max = 0;
};

struct LevelMeasure {
  unsigned level = 0;
  std::uint64_t tiles = 0;      ///< of the level, with all subfields
  MeanAndMax tiles_touched;     ///< neighbouring owners included
  MeanAndMax pairs_crossed;     ///< (entry section, exit section) pairs that rays pass through
  MeanAndMax compressed_bytes;  ///< of the touched tiles, in the layers the mode uses
  MeanAndMax map_pages;         ///< distinct 4 KiB pages of the map, as the engine counts them
  MeanAndMax cached_pages;      ///< the kernel's count: pages that came from the disk (mincore)
  MeanAndMax mapped_pages;      ///< and those that this process has mapped (smaps)
  MeanAndMax decoded_peak_bytes;
  MeanAndMax fraction;       ///< tiles_touched / tiles
  MeanAndMax pair_fraction;  ///< pairs_crossed / tiles
};

struct MeasureOptions {
  std::vector<Camera> cameras;
  RenderMode mode = RenderMode::bitri;
  std::vector<unsigned> levels;  ///< empty: all
  RendererOptions renderer;
};

struct Measurement {
  std::vector<LevelMeasure> levels;
  LevelMeasure total;  ///< each view's levels together, as when all are drawn
  /// Whether the kernel forgot the file before each view, so that its counts mean these views:
  /// not where others use the file, or it lives in memory.
  bool kernel_counted = true;
  std::uint64_t rss_anon_peak = 0;  ///< bytes, of this process while it rendered
  std::uint64_t rss_file_peak = 0;  ///< bytes, mapped pages of files
};

/// Renders every camera at every level, from a cold cache and where possible from the disk, and
/// counts.
[[nodiscard]] Result<Measurement> measure_views(const Field& field, const MeasureOptions& options);

struct ViewQuality {
  double psnr = 0;
  double ssim = 0;
};

struct Evaluation {
  std::vector<ViewQuality> views;
  double psnr = 0;  ///< mean of the views' PSNR
  double ssim = 0;
};

/// Compares views of the field with views of the scene it was built from: RGB over black at
/// 8 bits. Of the scene, a pixel is the mean of `supersample`² rays.
[[nodiscard]] Result<Evaluation> evaluate_views(const Field& field, const Scene& scene,
                                                const std::vector<Camera>& cameras,
                                                const ViewOptions& view,
                                                const RendererOptions& renderer,
                                                std::uint32_t supersample = 1);

/// Asks the kernel to forget what it caches of a file, so that reads come from the disk. Pages that
/// are mapped anywhere stay. io: cannot open or sync.
[[nodiscard]] Result<void> drop_page_cache(const std::string& path);

/// Resident memory of this process in bytes, from /proc/self/status.
struct ResidentMemory {
  std::uint64_t anonymous = 0;
  std::uint64_t file = 0;
};
[[nodiscard]] ResidentMemory resident_memory();

}  // namespace slf
