// Renderer: draws views of a field, within a memory budget.
//
// A picture is drawn in blocks of pixels. The renderer pins the tiles that a block's rays need, as
// many at a time as the budget allows; a tile that is not in the cache is found, checked and
// decoded once. Then it reads all samples of the pinned tiles. Pictures depend on the field,
// camera, mode and level only, never on threads or budget. Views that do not wait for tiles also
// depend on the content of the cache.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/progress.h"
#include "slf/scene.h"
#include "slf/tile_reader.h"
#include "slf/tone.h"

namespace slf {

class Reporter;  // internal

/// How the colour of a ray is interpolated from stored ones. The first four modes are the paper's
/// (section 3, Figure 8).
enum class RenderMode {
  nearest,  ///< the closest slab
  uv,       ///< interpolated between entry vertices, nearest exit
  st,       ///< interpolated between exit vertices, nearest entry
  bitri,    ///< bi-triangle: both, 9 samples (eq. 2)
  depth,    ///< bi-triangle on rays corrected by depth (needs a field with depth)
};

[[nodiscard]] const char* name(RenderMode mode);
/// The mode with a name. usage: unknown; the message lists the modes.
[[nodiscard]] Result<RenderMode> parse_render_mode(std::string_view text);
/// RenderMode::depth if the field has depths, bitri otherwise.
[[nodiscard]] RenderMode default_mode(const Field& field);

struct RendererOptions {
  std::uint64_t memory = 256ull << 20;  ///< bytes of decoded tiles and scratch, without pictures
  unsigned threads = 0;                 ///< 0: all
};

/// Stands for the level that matches the camera.
inline constexpr unsigned kMatchingLevel = ~0u;

struct ViewOptions {
  RenderMode mode = RenderMode::bitri;
  unsigned level = 0;       ///< of the tile pyramid, or kMatchingLevel
  bool with_depth = false;  ///< also fill Image::depth (needs a field with depth)
  bool wait = true;         ///< wait for tiles; false: use only cached ones and those of level 0
  /// Planes, up to kMaxClip, each of which removes what lies beyond it; only in mode depth.
  std::vector<ClipPlane> clip{};
  /// What they lay open: rays that begin where all is removed are traced through this scene, which
  /// must have the same planes (make_cap() in cut.h). Null: the cut is hollow, and rays show what
  /// is stored of what they hit first, if that is kept.
  std::shared_ptr<const Scene> cap{};

  static constexpr std::size_t kMaxClip = 6;

  [[nodiscard]] bool needs_depth() const { return mode == RenderMode::depth || with_depth; }
};

/// The work of drawing one view. footprint() in measure.h gives its tiles' bytes in the file.
struct ViewStatistics {
  std::vector<TileKey> tiles;   ///< tiles needed, stored or empty; sorted
  std::vector<TileKey> misses;  ///< of `tiles`: not in the cache, not waited for; sorted
  std::vector<std::uint64_t> level_pixels;  ///< by level: pixels for which it had all tiles
  std::uint64_t decodes = 0;                ///< tiles decoded for this view
  std::uint64_t decoded_peak_bytes = 0;     ///< most bytes of decoded tiles at any time
  std::uint64_t pixels_hit = 0;             ///< pixels whose ray crosses the sphere

  /// Pixels for which a tile of the requested level was missing in the field or not waited for.
  [[nodiscard]] std::uint64_t fallback_pixels() const {
    return level_pixels.empty() ? 0 : pixels_hit - level_pixels.back();
  }
};

/// Draws views of one field. Thread-safety: one render() at a time; it uses threads of its own, as
/// many as its options say.
class Renderer {
 public:
  /// Reads the field's tiles with a reader of its own. Scratch comes out of the memory, which few
  /// bytes limit to few threads.
  explicit Renderer(const Field& field, const RendererOptions& options = {});
  /// Shares the reader with whoever else has it. Scratch, up to 64 bytes for each sample of the
  /// largest tile and thread, comes on top of its memory. threads: 0 for all.
  explicit Renderer(TileReader tiles, unsigned threads = 0);
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;
  ~Renderer();

  /// The reader of its tiles, for others to share.
  [[nodiscard]] const TileReader& tiles() const;

  /// Draws a view. Rays are whole chords of the sphere, so from an eye inside the sphere, objects
  /// behind the eye show, too, unless there are planes. Progress counts blocks of pixels. usage: an
  /// invalid camera or level, or mode depth of a field without depths. bad_file: a damaged tile.
  /// cancelled: stopped by `progress`.
  [[nodiscard]] Result<Image> render(const Camera& camera, const ViewOptions& options,
                                     ViewStatistics* statistics = nullptr,
                                     const ProgressCallback& progress = {});
  /// The same into `image`, whose memory is reused. After an error it is partly drawn.
  [[nodiscard]] Result<void> render(const Camera& camera, const ViewOptions& options, Image& image,
                                    ViewStatistics* statistics = nullptr,
                                    const ProgressCallback& progress = {});

 private:
  friend class Player;
  struct State;
  [[nodiscard]] Result<void> draw(const Camera& camera, const ViewOptions& requested, Image& image,
                                  ViewStatistics* statistics, const ProgressCallback& progress);
  [[nodiscard]] Result<void> fetch(const Camera& camera, ViewOptions options, Image& picture,
                                   ViewStatistics& statistics, Reporter& progress);
  std::unique_ptr<State> state_;
};

/// A point of the surface that a picture shows.
struct PickedPoint {
  glm::dvec3 point{0.0};
  double depth = 0;
  /// From the steps of stored depths, and from how much the depths of rays differ that are one
  /// sample apart.
  double uncertainty = 0;

  static constexpr const char* kPython = "PickedPoint";
  void describe(auto& member) const {
    member("point", point, "in world units");
    member("depth", depth, "distance of the point from the eye, in world units");
    member("uncertainty", uncertainty, "standard deviation of the depth, in world units");
  }
};

/// The point that a camera's picture shows at (x, y), in pixels from its upper left corner: centres
/// of pixels are at halves. None if the picture is less than half opaque there. Reads the finest
/// level. Of `cut`, the planes and the cap count. usage: an invalid camera, a place outside the
/// picture, or a field without depths. bad_file: a damaged tile.
[[nodiscard]] Result<std::optional<PickedPoint>> pick(Renderer& renderer, const Camera& camera,
                                                      double x, double y,
                                                      const ViewOptions& cut = {});

/// The coarsest level whose samples are at least as dense as the camera's pixels, or the finest
/// level if none is. Densities are compared at the centre of the sphere: there, the lines from a
/// vertex to two neighbouring vertices on the other side must be no further apart than the rays of
/// two neighbouring pixels. In mode depth, lines to entry vertices may be twice as far apart.
[[nodiscard]] unsigned matching_level(const FieldShape& shape, const Camera& camera,
                                      RenderMode mode);

/// The checks of Renderer::render() on `options`. usage: the field does not have the level, or the
/// depths that the mode needs; planes are too many, none, or not for this mode.
[[nodiscard]] Result<void> check_view(const Field& field, const ViewOptions& options);

/// Tone-maps a picture of the field if its colours are linear radiance: as `tone` says; if that is
/// none, by default for a `display`, else not at all. usage: `tone`, but no linear radiance.
[[nodiscard]] Result<void> map_tones(const Field& field, const std::optional<ToneMapping>& tone,
                                     bool display, Image& image);

/// The (entry section, exit section) pairs that a view's rays pass through, as sorted keys: the
/// paper's measure of how much of a field a view needs. The tiles of neighbouring sections, which
/// interpolation reads as well, are not counted. usage: an invalid camera.
[[nodiscard]] Result<std::vector<TileKey>> crossed_pairs(const FieldShape& shape,
                                                         const Camera& camera, unsigned level);

}  // namespace slf
