// LightOnDemand: the light volume of a scene, of which nodes are computed when rays need them.
// Private to source/raycast and page/wasm.
#pragma once

#include <mutex>
#include <optional>
#include <shared_mutex>
#include <span>

#include "source/light/light_volume.h"
#include "source/raycast/prepared_volume.h"

namespace slf {

[[nodiscard]] inline LightGrid plan_of(const PreparedVolume& scene) {
  return plan_light(scene.grid, illuminate(scene.lighting, scene.bounds), scene.lighting);
}

/// Thread-safety: any thread, except prepare(). The scene must outlive it.
class LightOnDemand {
 public:
  LightOnDemand(PreparedVolume& scene, unsigned threads)
      : scene_(scene),
        medium_(scene.grid, threads),
        illumination_(illuminate(scene.lighting, scene.bounds)),
        computer_(medium_, illumination_, scene.lighting, plan_of(scene), threads) {}

  [[nodiscard]] Result<void> prepare() {
    SLF_TRY(computer_.prepare());
    missed_.emplace(computer_.blank().size());
    LightGrid light = computer_.blank();
    light.missed = &*missed_;
    scene_.grid.light_volume = std::make_shared<LightGrid>(std::move(light));
    scene_.grid.table.albedos = medium_.albedos();
    return {};
  }

  /// Whether the light of all these rays was known.
  bool trace(std::span<const Segment> rays, std::span<RaySample> out, RayCounts& counts) {
    const std::shared_lock lock(mutex_);
    counts = trace_rays(scene_.grid, rays, out);
    return !missed_->any();
  }

  /// Computes what rays missed, and the nodes around: near rays will need them.
  [[nodiscard]] Result<void> compute_missed(const ProgressCallback& progress) {
    const std::lock_guard lock(mutex_);
    if (!missed_->any()) return {};
    return computer_.compute(*scene_.grid.light_volume, computer_.spread(missed_->take(), 1),
                             progress);
  }

 private:
  PreparedVolume& scene_;
  const Medium medium_;
  const Illumination illumination_;
  LightComputer computer_;
  std::optional<MissedNodes> missed_;
  std::shared_mutex mutex_;  // of the light: read while rays are traced
};

}  // namespace slf
