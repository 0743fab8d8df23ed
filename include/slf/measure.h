// Measuring: how much memory views of a field need, and how close they are to ray-cast ones.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/pictures.h"
#include "slf/progress.h"
#include "slf/render.h"
#include "slf/scene.h"

namespace slf {

/// The bytes and pages of a file that a reader of a set of tiles needs: those of the tiles, and of
/// all tiles that they are predicted from.
struct Footprint {
  std::uint64_t stored_tiles = 0;      ///< tiles of the set with a payload
  std::uint64_t compressed_bytes = 0;  ///< payloads
  /// Numbers of the 4 KiB pages, ascending: those of the tree, of the records' tables and of the
  /// payloads.
  std::vector<std::uint64_t> pages;
};

/// The footprint of tiles. bad_file: the file
/// is damaged.
[[nodiscard]] Result<Footprint> footprint(const Field& field, std::span<const TileKey> tiles);

/// Mean and maximum over the views.
struct MeanAndMax {
  double mean = 0;
  double max = 0;
};

struct LevelMeasure {
  unsigned level = 0;
  std::uint64_t tiles = 0;      ///< of the level, in all subfields
  MeanAndMax tiles_touched;     ///< including neighbours that interpolation reads
  MeanAndMax pairs_crossed;     ///< (entry section, exit section) pairs that rays pass through
  MeanAndMax compressed_bytes;  ///< as Footprint, of the touched tiles
  MeanAndMax map_pages;         ///< distinct 4 KiB pages of the map, as the engine counts them
  MeanAndMax cached_pages;      ///< the kernel's count: pages that came from the disk (mincore)
  MeanAndMax mapped_pages;      ///< the kernel's count: pages that this process has mapped (smaps)
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
  LevelMeasure total;  ///< the sum over the levels of each view
  /// Whether cached_pages and mapped_pages count each view alone: the kernel dropped the file from
  /// its cache before each. It does not if another process maps the file, or on tmpfs.
  bool kernel_counted = true;
  std::uint64_t rss_anon_peak = 0;  ///< bytes, of this process while it rendered
  std::uint64_t rss_file_peak = 0;  ///< bytes, mapped pages of files
};

/// Renders every camera at every level and measures the memory that each view needs. Each view
/// starts with an empty tile cache and, where the kernel permits, with the file not in memory.
/// Progress counts views, at each level. usage: no cameras. cancelled: stopped by `progress`.
/// Else errors as Renderer::render().
[[nodiscard]] Result<Measurement> measure_views(const Field& field, const MeasureOptions& options,
                                                const ProgressCallback& progress = {});

/// Of a view, compared with what it should show.
using ViewQuality = ImageDifference;

struct Evaluation {
  std::vector<ViewQuality> views;
  double psnr = 0;  ///< mean of the views' PSNR, in dB
  double ssim = 0;  ///< mean of the views' SSIM
  /// Where the field's provenance differs from the scene's, as a JSON pointer: then they show two
  /// different objects. Empty: nowhere, but for the step of rays.
  std::string differs;
};

struct EvaluateOptions {
  std::vector<Camera> cameras;
  ViewOptions view = {};
  RendererOptions renderer = {};
  std::uint32_t supersample = 1;  ///< a pixel of a ray-cast view is the mean of supersample² rays
};

/// Compares views of the field with ray-cast views of its scene: RGB over black, 8 bits, with the
/// default tone mapping if the field is linear. Prepares the scene, with the light that
/// the field keeps. Progress counts rows of ray-cast pictures. usage: no cameras. cancelled:
/// stopped by `progress`. Else errors as Renderer::render() and trace_view(). REQUIRES: supersample
/// is at least 1.
[[nodiscard]] Result<Evaluation> evaluate_views(const Field& field, const Scene& scene,
                                                const EvaluateOptions& options,
                                                const ProgressCallback& progress = {});

struct PictureQuality {
  std::string name;    ///< of the picture
  ViewQuality whole;   ///< of the whole picture
  ViewQuality inside;  ///< of the pixels whose rays cross the field's sphere
};

/// Compares views of the field with pictures: RGB over black, 8 bits. A view has the lens of its
/// picture; a picture through a lens that distorts is compared with a resampled view. Progress
/// counts pictures. usage: no pictures. unsupported: a lens that sees further than 80 degrees from
/// its axis. Else errors as Renderer::render() and load_picture().
[[nodiscard]] Result<std::vector<PictureQuality>> evaluate_pictures(
    const Field& field, const std::vector<Picture>& pictures, const ViewOptions& view,
    const RendererOptions& renderer, const ProgressCallback& progress = {});

/// A camera that sees all that the picture shows; exactly its pixels if the lens is undistorted
/// with square pixels and the principal point is in the middle. unsupported: as above.
[[nodiscard]] Result<Camera> camera_of(const Picture& picture);

/// The picture's pixels of a view from camera_of().
[[nodiscard]] Image through_lens(const Picture& picture, const Camera& camera, Image view);

}  // namespace slf
