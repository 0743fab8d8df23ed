// Renderer: draws views of a field, within a memory budget.
//
// A picture is drawn in blocks of pixels. Within a block rays are grouped by tile: the tiles are
// pinned, as many at a time as the budget allows, each found, checked and decoded once (or taken
// from the cache), and all their samples taken. Pictures depend on the field, camera, mode and
// level only, never on threads or budget; those that do not wait, on what the cache holds, too.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string_view>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"

namespace slf {

/// No limit on a number of bytes.
inline constexpr std::uint64_t kUnlimited = ~std::uint64_t{0};

/// How a ray between samples gets its colour. The first four are the paper's (section 3, Figure 8).
enum class RenderMode {
  nearest,  ///< the closest slab
  uv,       ///< interpolated between entry vertices, nearest exit
  st,       ///< interpolated between exit vertices, nearest entry
  bitri,    ///< bi-triangle: both, 9 samples (eq. 2)
  depth,    ///< bi-triangle on rays corrected by the depth layer (needs one)
};

[[nodiscard]] const char* name(RenderMode mode);
/// usage: unknown; the message lists the modes.
[[nodiscard]] Result<RenderMode> parse_render_mode(std::string_view text);
/// depth where the field has a depth layer, bitri otherwise.
[[nodiscard]] RenderMode default_mode(const Field& field);

struct RendererOptions {
  /// Bytes of decoded tiles and scratch. Beside it come pictures and the field's tables of each
  /// level: about 32 N² bytes for an entry lattice of N cells.
  std::uint64_t memory = 256ull << 20;
  unsigned threads = 0;  ///< 0: all
  /// Resident bytes of the map, from 512 KiB. Tiles of an in-place codec (raw) that are in use may
  /// exceed it.
  std::uint64_t map_budget = kUnlimited;
  bool in_place = true;  ///< use raw tiles where they are mapped; else copy them, within `memory`
};

/// Stands for the level that matches the camera.
inline constexpr unsigned kMatchingLevel = ~0u;

struct ViewOptions {
  RenderMode mode = RenderMode::bitri;
  unsigned level = 0;       ///< of the tile pyramid, or kMatchingLevel
  bool with_depth = false;  ///< also fill Image::depth (needs a depth layer)
  bool wait = true;         ///< for tiles to load; else the cache and level 0 must do

  [[nodiscard]] bool needs_depth() const { return mode == RenderMode::depth || with_depth; }
};

/// What drawing one view took (see measure.h for what its tiles take in the file).
struct ViewStatistics {
  std::vector<TileKey> tiles;               ///< touched: sorted, stored or empty, any layer
  std::vector<TileKey> wanted;              ///< of tiles: not waited for, sorted
  std::vector<std::uint64_t> level_pixels;  ///< pixels for which a level had all tiles, by level
  std::uint64_t decodes = 0;                ///< tiles decoded for this view
  std::uint64_t decoded_peak_bytes = 0;     ///< most bytes of decoded tiles at any time
  std::uint64_t pixels_hit = 0;             ///< pixels whose ray crosses the sphere

  /// Pixels for which the level asked for lacked a tile: never built, or not waited for.
  [[nodiscard]] std::uint64_t fallback_pixels() const {
    return level_pixels.empty() ? 0 : pixels_hit - level_pixels.back();
  }
};

/// Thread-safety: one render() at a time; it uses the threads of its options itself.
class Renderer {
 public:
  /// Keeps a copy of the handle.
  explicit Renderer(const Field& field, const RendererOptions& options = {});
  /// Draws with the cache of another, which must outlive it.
  Renderer(const Renderer& other, unsigned threads);
  ~Renderer();

  /// usage: a bad camera or level, or a mode the field has no layer for. bad_file: a damaged tile.
  /// Rays are whole chords of the sphere: from an eye inside it, what lies between the sphere and
  /// the eye is drawn as well, so the eye may come as close as the object.
  [[nodiscard]] Result<Image> render(const Camera& camera, const ViewOptions& options,
                                     ViewStatistics* statistics = nullptr);
  /// The same into a picture whose memory is used again; after an error it is part drawn.
  [[nodiscard]] Result<void> render(const Camera& camera, const ViewOptions& options, Image& image,
                                    ViewStatistics* statistics = nullptr);

  /// Called with each picture; false stops drawing.
  using Show = std::function<bool(const Image& image, unsigned level)>;
  /// Draws level after level into `image`, the coarsest first, and shows each picture: something is
  /// seen at once, and the last is what render() draws. Stops early, without an error, when `show`
  /// returns false.
  [[nodiscard]] Result<void> render_progressively(const Camera& camera, const ViewOptions& options,
                                                  Image& image, const Show& show);

 private:
  friend class Player;
  struct State;
  std::unique_ptr<State> state_;
};

/// The coarsest level whose samples lie as close as the camera's pixels: where the ray through the
/// centre of the sphere passes it, lines between an entry vertex and neighbouring exit vertices, or
/// an exit vertex and neighbouring entry vertices, are no further apart than the rays of
/// neighbouring pixels; the latter twice as far in mode depth. The finest where none is.
[[nodiscard]] unsigned matching_level(const FieldShape& shape, const Camera& camera,
                                      RenderMode mode);

/// What Renderer::render() checks. usage: a level or mode the field does not have.
[[nodiscard]] Result<void> check_view(const Field& field, const ViewOptions& options);

/// The (entry section, exit section) pairs that a view's rays pass through, neighbouring owners
/// not counted: the paper's measure of how much of a field a view needs. Sorted keys.
[[nodiscard]] Result<std::vector<TileKey>> crossed_pairs(const FieldShape& shape,
                                                         const Camera& camera, unsigned level);

}  // namespace slf
