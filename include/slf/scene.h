// Scene: gives the colour and depth of any ray. Fields are built from scenes and compared with
// them.
//
// Implementations: Raycaster (a volume, raycaster.h), MeshScene (mesh.h) and the analytic scenes
// below. Programs may add their own; examples/scene.cc is one.
#pragma once

#include <cstddef>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/image.h"
#include "slf/progress.h"
#include "slf/shape.h"

namespace slf {

/// A ray, between two world points.
struct Segment {
  glm::dvec3 from{0.0};
  glm::dvec3 to{0.0};
};

/// Colour and depth along a ray between two points.
struct RaySample {
  glm::vec4 rgba{0};  ///< premultiplied by opacity; 0 where nothing is visible
  float depth = 0;    ///< opacity-weighted mean position, 0 at the first point, 1 at the second;
                      ///< 0 where nothing is visible
};

/// A source of rays. What implementations must know:
///
/// - Threads. build_field() and trace_view() call trace_many() from several threads at once, and
///   bounds(), provenance() and files() from one. prepare() or prepare_for() returns before the
///   first ray is traced.
/// - Batches. The rays of a call to trace_many() are of one tile, or of one row of a picture.
///   Results must not depend on how rays are divided into calls, nor on their order: fields that
///   are resumed, or built in shards, are divided in another way.
/// - Exceptions. trace(), trace_many() and prepare() may throw; the function that called them ends
///   with the error `failed` and the text of what(). Tiles that were committed stay.
/// - Numbers. Colours and depth must be finite. Nothing checks them, and with NaN the content of
///   the field is undefined: return an empty RaySample instead. Opacity is 0 to 1, depth is 0 to 1,
///   and RGB, which is premultiplied, is 0 to opacity; fields of half floats may hold brighter
///   colours.
/// - Rays. Both points lie on the sphere of the field, or the first one at an eye inside it. They
///   differ. Matter outside of the two points must not show.
class Scene {
 public:
  virtual ~Scene() = default;

  /// Does work that rays need, and that a build without rays to trace can skip. build_field() calls
  /// this before it traces the first ray. Other programs need to call it only if the scene's
  /// documentation says so. Not thread-safe; a second call does nothing.
  [[nodiscard]] virtual Result<void> prepare() const { return {}; }

  /// Does what prepare() does as far as the rays that `rays` returns, and those between them, need
  /// it; does not call that if it need not. trace_view() calls this before it traces the first ray.
  /// Not thread-safe.
  using SomeRays = std::function<std::vector<Segment>()>;
  [[nodiscard]] virtual Result<void> prepare_for(const SomeRays& /*rays*/) const {
    return prepare();
  }

  /// The result of prepare(), coded, for fields to keep (doc/format/optional.md, "Light"); empty if
  /// there is none.
  [[nodiscard]] virtual std::vector<std::byte> light() const { return {}; }

  /// Takes the light() of an equal scene, which prepare() then need not compute. Call it before
  /// prepare(); not thread-safe. False if the bytes are something else, or damaged: they are
  /// untrusted.
  virtual bool set_light(std::span<const std::byte> /*light*/) const { return false; }

  /// Takes the light of another scene of the same volume, but for what this one lays open: what is
  /// cut away in this scene alone keeps its shadows. Adds to provenance(). Call it before
  /// prepare(); not thread-safe. usage: this scene cannot have that light.
  [[nodiscard]] virtual Result<void> share_light(std::shared_ptr<const Scene> from) const;

  /// A sphere around everything visible.
  [[nodiscard]] virtual Sphere bounds() const = 0;
  /// How far from a point anything visible lies; at most this. By default as far as bounds().
  [[nodiscard]] virtual double reach(const glm::dvec3& from) const;

  /// The ray from one world point to another, front to back. Deterministic; any thread.
  [[nodiscard]] virtual RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const = 0;

  /// Traces many rays at once; fastest if neighbouring rays follow each other. out[k] has the same
  /// bits as the result of trace() for rays[k]. REQUIRES: equal sizes.
  virtual void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const;

  /// A JSON object for the manifest: the scene's source and every setting that changes its
  /// pictures, so equal provenance means equal samples. If it has a member `content`, a hash of the
  /// data, the member `source` is for people only and may differ.
  [[nodiscard]] virtual std::string provenance() const = 0;

  /// The files that the scene was read from. build_field() refuses to replace them.
  [[nodiscard]] virtual std::vector<std::string> files() const { return {}; }
};

/// The names of the analytic scenes:
///   balls    opaque, textured, shaded spheres of several sizes
///   globe    one finely textured opaque sphere that fills most of the bounds
///   fog      overlapping translucent balls: opacity 1 - exp(-density × path)
[[nodiscard]] std::vector<std::string> analytic_scene_names();

/// usage: unknown name; the message lists the known ones.
[[nodiscard]] Result<std::unique_ptr<Scene>> make_analytic_scene(std::string_view name);

/// Traces every pixel's ray through `sphere`, from the eye where that is inside it, on `threads`
/// threads (0: all). Image::depth is filled. The result does not depend on the threads. Progress
/// counts rows. usage: a bad camera. cancelled: stopped by `progress`.
[[nodiscard]] Result<Image> trace_view(const Scene& scene, const Sphere& sphere,
                                       const Camera& camera, unsigned threads = 0,
                                       const ProgressCallback& progress = {});

}  // namespace slf
