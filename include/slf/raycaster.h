// Raycaster: colour and depth of rays through a volume; the builder's source and the ground truth.
//
// A ray is composited front to back (Levoy 1990) cell by cell: in the cube between eight voxels,
// the trilinear value along the ray is a cubic polynomial, which is divided into pieces. The
// opacity of a piece is the integral of the transfer function between the values at its ends
// (pre-integration: Engel, Kraus, Ertl 2001), and gradients are evaluated several times in each.
// So a picture is converged: no phase of samples shows as noise. Labels and structures belong to
// the nearest voxel, exactly. Empty space is leapt over, and opaque rays end early.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/light.h"
#include "slf/progress.h"
#include "slf/scene.h"
#include "slf/transfer.h"
#include "slf/volume.h"
#include "slf/volume_parts.h"

namespace slf {

/// What scenes share that are made with the same one: voxels in memory, the parts of a volume, and
/// the light of scenes that differ only by the labels that they show. Thread-safety: none; it may
/// end before the scenes. No scene changes by it.
struct SharedScenes;
[[nodiscard]] std::shared_ptr<SharedScenes> share_scenes();

struct RaycastOptions {
  /// The longest part of a ray that is one sample, in smallest voxel spacings, 0.01 to 100. A
  /// sample is never longer than a cell, so that a smaller step only refines what is converged.
  double step = 2;
  /// Only values with opacity count. Light does not apply: `shade` and `lighting` must be off.
  /// Needs a volume of amounts.
  Projection projection = Projection::none;
  bool shade = true;
  /// World direction towards the light. LPS: above, in front and to the right of the patient.
  glm::dvec3 light{-0.45, -0.65, 0.6};
  float ambient = 0.3f;  ///< share of a colour that needs no light; the rest is Lambert's
  /// Unless its mode is Lighting::direct, it replaces `shade`, `light` and `ambient`.
  LightOptions lighting{};
  VolumeParts parts{};            ///< parts of the volume in colours of their own
  std::vector<ClipPlane> clip{};  ///< each removes what lies beyond it
  /// From which gradient on matter is a surface (light.h), in values per world unit; 0: from 2 % of
  /// the volume's range per voxel on.
  double surface_gradient = 0;
  bool may_be_empty = false;               ///< it is no error that nothing is visible
  std::shared_ptr<SharedScenes> shared{};  ///< null: nothing is shared
};

/// Options of computing a light volume. None of them changes its content.
struct LightVolumeOptions {
  unsigned threads = 0;         ///< 0: all
  ProgressCallback progress{};  ///< counts paths of light
  /// Path of a file for the light volume. It is read if it was computed from the same scene and
  /// options; otherwise the light volume is computed and written there. Replaces only a file that
  /// is a light volume. Empty: no file.
  std::string file{};
  /// prepare() computes the light volume. Rays that are traced before compute the parts that they
  /// need, with the same result.
  bool deferred = false;
};

/// The work of tracing rays.
struct RayCounts {
  std::uint64_t steps = 0;    ///< positions visited: samples, and leaps over empty space
  std::uint64_t samples = 0;  ///< intervals in cells that can be visible
  std::uint64_t visible = 0;  ///< of `samples`: not fully transparent, so composited
};

struct PreparedVolume;  // internal

/// The options recorded in a field's provenance (a JSON object). An option that is missing there,
/// or of another type, has its default.
[[nodiscard]] RaycastOptions raycast_options(std::string_view provenance);

/// trace_many() fills the CPU's vector units; trace(), with one ray, leaves them mostly idle.
/// Thread-safety: immutable; any thread.
class Raycaster final : public Scene {
 public:
  /// Keeps voxels in their type if that is an 8 or 16 bit integer or f32, and converts others to
  /// f32. Renumbers label ids beyond 16 bits. Computes the light volume if the options ask for one
  /// and `light_volume.deferred` is false.
  /// usage: an option out of range; the file of the light volume exists and is something else.
  /// failed: nothing in the volume is visible, and it may not be empty. cancelled: stopped by the
  /// progress callback. io: the file of the light volume cannot be written.
  [[nodiscard]] static Result<std::unique_ptr<Raycaster>> make(
      Volume volume, const TransferFunction& transfer, const RaycastOptions& options = {},
      const LightVolumeOptions& light_volume = {});
  ~Raycaster() override;

  /// Computes the light volume if make() has deferred it. Errors as make().
  [[nodiscard]] Result<void> prepare() const override;
  [[nodiscard]] Result<void> prepare_for(const SomeRays& rays) const override;
  [[nodiscard]] std::vector<std::byte> light() const override;
  /// Has an effect only if make() has deferred the light volume.
  bool set_light(std::span<const std::byte> light) const override;
  /// Both must have a light volume that is not direct, and make() must have deferred it. They may
  /// differ by planes that clip and by structures, where `from` shows all labels, and shows all
  /// that this scene does.
  [[nodiscard]] Result<void> share_light(std::shared_ptr<const Scene> from) const override;
  [[nodiscard]] Sphere bounds() const override;
  [[nodiscard]] double reach(const glm::dvec3& from) const override;
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override;
  [[nodiscard]] std::string provenance() const override;
  [[nodiscard]] std::vector<std::string> files() const override;

  /// As trace_many(); also counts the work.
  RayCounts trace_counted(std::span<const Segment> rays, std::span<RaySample> out) const;

  /// For slf's own libraries; the type is not installed.
  [[nodiscard]] const PreparedVolume& prepared() const;

 private:
  struct State;
  explicit Raycaster(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
