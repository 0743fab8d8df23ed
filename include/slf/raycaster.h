// Raycaster: colour and depth of rays through a volume; the builder's source and the ground truth.
//
// Front-to-back compositing (Levoy 1990) at a fixed step, trilinear (labels: nearest), with opacity
// corrected for the step, gradient shading under one fixed light, empty-space leaping and early
// termination. Leaping never moves a sample position, so it does not change a result.
#pragma once

#include <cstddef>
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
#include "slf/structures.h"
#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

struct RaycastOptions {
  double step = 0.7;  ///< distance between samples, in smallest voxel spacings; positive
  bool shade = true;
  /// World direction towards the light. LPS: above, in front and to the right of the patient.
  glm::dvec3 light{-0.45, -0.65, 0.6};
  float ambient = 0.3f;  ///< share of a colour that needs no light; the rest is Lambert's
  bool leap = true;      ///< off only to test that leaping changes nothing
  /// Unless its mode is Lighting::direct, it replaces `shade`, `light` and `ambient`.
  LightOptions lighting{};
  Structures structures{};  ///< parts of the volume in colours of their own
};

/// Options of computing a light volume. None of them changes its content.
struct LightVolumeOptions {
  unsigned threads = 0;         ///< 0: all
  ProgressCallback progress{};  ///< counts paths of light
  /// Path of a file for the light volume. It is read if it was computed from the same scene and
  /// options; otherwise the light volume is computed and written there. Empty: no file.
  std::string file{};
  bool deferred = false;  ///< prepare(), called before the first ray, computes the light volume
};

/// The work of tracing rays.
struct RayCounts {
  std::uint64_t steps = 0;    ///< positions visited: samples, and leaps over empty space
  std::uint64_t samples = 0;  ///< values interpolated
  std::uint64_t visible = 0;  ///< of `samples`: not fully transparent, so shaded and composited
};

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
  /// usage: an option out of range. failed: nothing in the volume is visible; stopped by the
  /// progress callback. io: the file of the light volume cannot be written.
  [[nodiscard]] static Result<std::unique_ptr<Raycaster>> make(
      Volume volume, const TransferFunction& transfer, const RaycastOptions& options = {},
      const LightVolumeOptions& light_volume = {});
  ~Raycaster() override;

  /// Computes the light volume if make() has deferred it. Errors as make().
  [[nodiscard]] Result<void> prepare() const override;
  [[nodiscard]] std::vector<std::byte> light() const override;
  /// Has an effect only if make() has deferred the light volume.
  bool set_light(std::span<const std::byte> light) const override;
  [[nodiscard]] Sphere bounds() const override;
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override;
  [[nodiscard]] std::string provenance() const override;
  [[nodiscard]] std::vector<std::string> files() const override;

  /// As trace_many(); also counts the work.
  RayCounts trace_counted(std::span<const Segment> rays, std::span<RaySample> out) const;

 private:
  struct State;
  explicit Raycaster(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
