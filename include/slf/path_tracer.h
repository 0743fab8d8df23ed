// PathTracer: the reference for light volumes, slow and simple.
//
// Estimates the radiance of each ray by following paths of light through the volume, as in Kroes,
// Post, Botha, "Exposure Render: an interactive photo-realistic volume rendering framework", PLoS
// ONE 7(7), 2012, with the model of slf/light.h. No light volume, no fixed steps, no filter:
// unbiased for that model, but noisy.
#pragma once

#include <memory>

#include "slf/raycaster.h"

namespace slf {

struct PathTraceOptions {
  std::uint32_t samples = 64;  ///< paths per ray, at least 1
  std::uint64_t seed = 1;
};

/// A Scene, so trace_view() draws with it and evaluate_views() compares with it. Results depend on
/// the ray and the seed only. Thread-safety: immutable; any thread.
class PathTracer final : public Scene {
 public:
  /// usage: an option out of range; Lighting::direct, which has no model of light transport.
  /// Other errors as Raycaster::make.
  [[nodiscard]] static Result<std::unique_ptr<PathTracer>> make(Volume volume,
                                                                const TransferFunction& transfer,
                                                                const RaycastOptions& options,
                                                                const PathTraceOptions& paths = {});
  ~PathTracer() override;

  [[nodiscard]] Sphere bounds() const override;
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  /// The provenance of a Raycaster with the same options.
  [[nodiscard]] std::string provenance() const override;
  [[nodiscard]] std::vector<std::string> files() const override;

 private:
  struct State;
  explicit PathTracer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
