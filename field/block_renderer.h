// BlockRenderer: gives the rays of a block of pixels their colours. Private to field/.
//
// All modes are passes of the same three steps: each ray's entry vertices are aimed at an exit
// point, the taps are gathered, the values blended. The first pass aims where the ray itself
// leaves; mode depth aims anew, twice, at what the pass before saw.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "field/camera.h"
#include "field/render.h"
#include "field/taps.h"

namespace slf {

/// A pixel's ray where it crosses the plenoptic sphere, in coordinates where that is the unit
/// sphere around the origin.
struct Ray {
  glm::dvec3 enter{0.0};
  glm::dvec3 leave{0.0};

  /// The point at depth t.
  [[nodiscard]] glm::dvec3 at(double t) const { return enter + t * (leave - enter); }
};

/// False where the pixel's ray misses the sphere or has it behind the eye.
[[nodiscard]] bool cross_sphere(const Sphere& sphere, const PixelRay& pixel, Ray& ray);

/// One of a ray's three entry vertices.
struct EntryCorner {
  EntryRow row;
  glm::dvec3 point{0.0};  ///< on the unit sphere
  float weight = 0;
  glm::dvec3 aim{0.0};    ///< exit point, on the unit sphere
  std::uint32_t tap = 0;  ///< its tap in the pass under way; meaningless where weight is 0
};

/// One pixel on the way through the passes.
struct Pixel {
  Ray ray;
  std::uint32_t index = 0;  ///< in the picture
  std::array<EntryCorner, 3> corners{};
  glm::vec4 rgba{0};
  float t = 0;  ///< depth along the ray, where a pass with depth saw something
  bool missing = false;
};

/// Reused from block to block. Thread-safety: one thread.
class BlockRenderer {
 public:
  BlockRenderer(const Field& field, TileCache& cache, const ViewOptions& options)
      : field_(field), options_(options), gatherer_(field, cache) {}

  /// Sets rgba, and t where there is depth, of every pixel. Pixels that need a missing tile are
  /// drawn from the next coarser level, and counted in `fallback`, once for each level.
  [[nodiscard]] Result<void> draw(std::vector<Pixel>& pixels, std::uint64_t& fallback);

  /// Tiles touched since this was last cleared; with repetitions.
  [[nodiscard]] std::vector<TileKey>& touched() { return gatherer_.touched(); }

 private:
  using Indices = std::vector<std::uint32_t>;

  Result<void> draw_level(std::vector<Pixel>& pixels, const LevelGeometry& geometry);
  Result<void> pass(std::vector<Pixel>& pixels, const LevelGeometry& geometry, const Indices& which,
                    bool with_depth);
  void blend(Pixel& pixel, bool with_depth) const;

  const Field& field_;
  const ViewOptions& options_;
  TapGatherer gatherer_;
  Indices active_, followed_;
  std::vector<Tap> taps_;
  std::vector<TapValue> values_;
};

}  // namespace slf
