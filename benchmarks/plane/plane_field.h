// PlaneField: the traditional light field, between pairs of parallel planes, in memory.
//
// The peer of slf's sphere light field. It is built by tracing the same Scene, drawn from the same
// cameras, and engineered alike: it has tiles of 8-bit RGBA, whose rows are entry samples that one
// tile owns and whose columns are exit samples with shared edges, and it renders blocks of pixels
// in vectors of rays, on threads. Rendering is quadrilinear, with 16 samples per ray.
//
// Tiles are traced when a view first needs them (prepare), so that a field of any size can be
// measured by a few views; drawing touches no others.
#pragma once

#include <sys/mman.h>

#include <cstdint>
#include <cstdlib>
#include <new>
#include <vector>

#include "benchmarks/plane/plane_kernel.h"
#include "benchmarks/plane/slabs.h"
#include "slf/camera.h"
#include "slf/image.h"
#include "slf/scene.h"

namespace slf::bench {

/// Allocates huge pages, if the system provides them, as slf does for decoded tiles.
template <class T>
struct HugePageAllocator {
  using value_type = T;

  HugePageAllocator() = default;
  template <class U>
  explicit HugePageAllocator(const HugePageAllocator<U>&) {}
  T* allocate(std::size_t n) {
    constexpr std::size_t kHugePage = 2 << 20;
    const std::size_t bytes = (n * sizeof(T) + kHugePage - 1) / kHugePage * kHugePage;
    void* const at = std::aligned_alloc(kHugePage, bytes);
    if (!at) throw std::bad_alloc();
    madvise(at, bytes, MADV_HUGEPAGE);
    return static_cast<T*>(at);
  }
  void deallocate(T* from, std::size_t) { std::free(from); }
  friend bool operator==(const HugePageAllocator&, const HugePageAllocator&) { return true; }
};

/// Thread-safety: one call at a time; render() uses threads itself.
class PlaneField {
 public:
  /// Borrows the scene.
  PlaneField(const Scene& scene, const Sphere& sphere, const PlaneShape& shape)
      : scene_(scene),
        sphere_(sphere),
        shape_(shape),
        grid_(shape),
        tiles_(grid_.tiles(), kUnknown) {}

  /// Traces the tiles that a view needs and that no view needed before.
  void prepare(const Camera& camera);

  /// Draws a view into a picture, whose memory is reused. REQUIRES: prepare() for this camera.
  void render(const Camera& camera, unsigned threads, Image& image) const;

  [[nodiscard]] const PlaneShape& shape() const { return shape_; }
  /// Tiles traced so far.
  [[nodiscard]] std::size_t tiles() const { return samples_.size() / kTileSamples; }
  [[nodiscard]] std::size_t all_tiles() const { return tiles_.size(); }

 private:
  static constexpr std::uint32_t kUnknown = ~0u;

  [[nodiscard]] PlaneBasis basis(const Camera& camera) const;
  void trace(std::size_t tile, std::uint32_t* samples) const;

  const Scene& scene_;
  Sphere sphere_;
  PlaneShape shape_;
  TileGrid grid_;
  std::vector<std::uint32_t> tiles_;  ///< index of each tile in samples_, or kUnknown
  std::vector<std::uint32_t, HugePageAllocator<std::uint32_t>> samples_;
};

}  // namespace slf::bench
