// Raycaster: colour and depth of rays through a volume; the builder's source and the ground truth.
//
// Front-to-back compositing (Levoy 1990) at a fixed step, trilinear (labels: nearest), with opacity
// corrected for the step, gradient shading under one fixed light, empty-space leaping and early
// termination. Leaping never moves a sample position, so it does not change a result.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

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

/// How a light volume is computed, without any influence on what it holds.
struct LightWork {
  unsigned threads = 0;         ///< 0: all
  ProgressCallback progress{};  ///< counts paths of light
  /// Where the light volume is kept: read from there if it was computed from the same scene and
  /// options, else computed and written. Empty: nowhere.
  std::string file{};
};

/// What tracing took.
struct RayCounts {
  std::uint64_t steps = 0;    ///< positions visited: samples, and leaps over empty space
  std::uint64_t samples = 0;  ///< values interpolated
  std::uint64_t visible = 0;  ///< of those, with any opacity: shaded and composited
};

/// The options that a field's provenance (a JSON object) records; the default for each that is
/// missing or of another type.
[[nodiscard]] RaycastOptions raycast_options(std::string_view provenance);

/// Thread-safety: immutable; trace() and trace_many() from any thread. Many rays at a time fill the
/// vector units; one leaves them mostly idle.
class Raycaster final : public Scene {
 public:
  /// Takes the volume's voxels as they are; types other than 8 and 16 bit integers and f32 are
  /// converted to f32. Label ids beyond 16 bits are renumbered.
  /// Computes the light volume if the options ask for one.
  /// usage: an option out of range. failed: nothing in the volume is visible; stopped by the
  /// progress callback. io: the file of the light volume cannot be written.
  [[nodiscard]] static Result<std::unique_ptr<Raycaster>> make(Volume volume,
                                                               const TransferFunction& transfer,
                                                               const RaycastOptions& options = {},
                                                               const LightWork& work = {});
  ~Raycaster() override;

  [[nodiscard]] Sphere bounds() const override;
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override;
  [[nodiscard]] std::string provenance() const override;
  [[nodiscard]] std::vector<std::string> files() const override;

  /// As trace_many(), and says what it took.
  RayCounts trace_counted(std::span<const Segment> rays, std::span<RaySample> out) const;

 private:
  struct State;
  explicit Raycaster(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
