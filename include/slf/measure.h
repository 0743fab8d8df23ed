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

struct MeanAndMax {
  double mean = 0, max = 0;

  static constexpr const char* kPython = "MeanAndMax";
  void describe(auto& member) const {
    member("mean", mean, "over the views", R"("minimum": 0)");
    member("max", max, "over the views", R"("minimum": 0)");
  }
};

/// What views of one level need, or of all levels together.
struct LevelMeasure {
  std::optional<unsigned> level{};
  std::uint64_t tiles = 0;
  MeanAndMax tiles_touched, pairs_crossed, compressed_bytes, map_pages, cached_pages, mapped_pages,
      decoded_peak_bytes, fraction, pair_fraction;

  static constexpr const char* kPython = "LevelMeasure";
  void describe(auto& member) const {
    member("level", level ? &*level : nullptr, "0 is the coarsest; none: the sum over all");
    member("tiles", tiles, "of the level, in all subfields");
    member("tiles_touched", tiles_touched, "tiles, with neighbours that interpolation reads");
    member("pairs_crossed", pairs_crossed, "pairs of sections that rays pass through");
    member("compressed_bytes", compressed_bytes,
           "payloads, also of tiles that those are predicted from");
    member("map_pages", map_pages, "4 KiB pages of the file, by the engine's count");
    member("decoded_peak_bytes", decoded_peak_bytes, "decoded samples");
    member("fraction", fraction, "tiles_touched / tiles");
    member("pair_fraction", pair_fraction, "pairs_crossed / tiles");
    member("cached_pages", cached_pages, "4 KiB pages that came from the disk (mincore)");
    member("mapped_pages", mapped_pages, "4 KiB pages that the process has mapped (smaps)");
  }
};

struct MeasureOptions {
  std::vector<Camera> cameras;
  RenderMode mode = RenderMode::bitri;
  std::vector<unsigned> levels;  ///< empty: all
  RendererOptions renderer;
  std::vector<ClipPlane> clip{};  ///< as in ViewOptions
  std::shared_ptr<const Scene> cap{};
};

struct Measurement {
  std::vector<LevelMeasure> levels;
  LevelMeasure total;
  /// The kernel does not drop a file from its cache if another process maps it, or on tmpfs.
  bool kernel_counted = true;
  std::uint64_t rss_anon_peak = 0, rss_file_peak = 0;

  static constexpr const char* kPython = "Measurement";
  void describe(auto& member) const {
    member("levels", levels, "by level");
    member("total", total, "the sum over the levels of each view");
    member({"rss_anon_peak_bytes", "rss_anon_peak"}, rss_anon_peak, "bytes: anonymous memory");
    member({"rss_file_peak_bytes", "rss_file_peak"}, rss_file_peak, "bytes: mapped pages of files");
    member("kernel_counted", kernel_counted,
           "cached_pages and mapped_pages count each view alone: the kernel dropped the file from "
           "its cache before each");
  }
};

/// Renders every camera at every level and measures the memory that each view needs. Each view
/// starts with an empty tile cache and, where the kernel permits, with the file not in memory.
/// Progress counts views, at each level. usage: no cameras. cancelled: stopped by `progress`.
/// Else errors as Renderer::render().
[[nodiscard]] Result<Measurement> measure_views(const Field& field, const MeasureOptions& options,
                                                const ProgressCallback& progress = {});

/// Of a view, compared with what it should show.
using ViewQuality = ImageDifference;

/// The mean of views.
struct Evaluation : ViewQuality {
  std::vector<ViewQuality> views;
  /// Empty: nowhere, but for the step of rays.
  std::string differs;

  static constexpr const char* kPython = "Evaluation";
  void describe(auto& member) const {
    ViewQuality::describe(member);
    member({"per_view", "views"}, views, "in the order of the views");
    member({nullptr, "differs"}, differs,
           "where the provenances of field and scene differ, which then show two different "
           "objects, as a JSON pointer; else empty");
    member({"same_source", nullptr}, differs.empty(), "the field was built from it");
  }
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
  std::string name{};
  ViewQuality whole{}, inside{};

  void describe(auto& member) const {
    member("picture", name, "its name in the file of cameras");
    describe_means(member);
  }
  void describe_means(auto& member) const {
    whole.describe(member);
    member("psnr_inside", inside.psnr, "dB, of the pixels whose rays cross the sphere",
           R"("type": ["number", "null"])");
    member("ssim_inside", inside.ssim, "of the windows around those pixels");
  }
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
