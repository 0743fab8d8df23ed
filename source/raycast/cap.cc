#include <algorithm>
#include <cmath>

#include "base/try.h"
#include "slf/cut.h"
#include "slf/raycaster.h"
#include "source/raycast/cap_settings.h"
#include "source/raycast/prepared_volume.h"

namespace slf {
namespace {

/// Where a ray enters what planes leave, 0 to 1 along it; nothing: from no plane.
std::optional<double> entry_of(std::span<const ClipPlane> clip, const Segment& ray) {
  double enter = 0, leave = 1;
  for (const ClipPlane& plane : clip) {
    const double at = glm::dot(plane.normal, ray.from - plane.point);
    const double rate = glm::dot(plane.normal, ray.to - ray.from);
    if (rate < 0) enter = std::max(enter, -at / rate);
    if (at > 0 && rate >= 0) return std::nullopt;
    if (rate > 0) leave = std::min(leave, -at / rate);
  }
  return enter > 0 && enter < leave ? std::optional(enter) : std::nullopt;
}

/// Shows the values of a volume on the faces of a cut, and behind them another scene.
class Slice final : public Scene {
 public:
  Slice(std::shared_ptr<const Raycaster> behind, Volume volume, std::span<const ClipPlane> clip,
        const TransferFunction& transfer, const std::array<double, 2>& window, double matter,
        bool linear)
      : behind_(std::move(behind)),
        volume_(std::move(volume)),
        to_index_(glm::inverse(volume_.axes)),
        clip_(clip.begin(), clip.end()),
        transfer_(transfer),
        window_(window),
        matter_(matter),
        linear_(linear) {}

  [[nodiscard]] Result<void> prepare_for(const SomeRays& rays) const override {
    return behind_->prepare_for(rays);
  }
  [[nodiscard]] Sphere bounds() const override { return behind_->bounds(); }
  [[nodiscard]] std::string provenance() const override { return behind_->provenance(); }
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    const Segment ray{from, to};
    RaySample sample;
    trace_many({&ray, 1}, {&sample, 1});
    return sample;
  }
  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override {
    behind_->trace_many(rays, out);
    for (std::size_t k = 0; k < rays.size(); ++k) {
      const auto& [from, to] = rays[k];
      const auto entry = entry_of(clip_, rays[k]);
      if (!entry) continue;
      if (const auto color = color_at(from + *entry * (to - from)))
        out[k] = {glm::vec4(*color, 1), static_cast<float>(*entry)};
    }
  }

 private:
  /// Of a place on a face; none: there is nothing.
  [[nodiscard]] std::optional<glm::vec3> color_at(const glm::dvec3& world) const {
    const glm::dvec3 at = to_index_ * (world - volume_.origin);
    const glm::ivec3 last(volume_.dims[0] - 1, volume_.dims[1] - 1, volume_.dims[2] - 1);
    if (glm::any(glm::lessThan(at, glm::dvec3(0))) ||
        glm::any(glm::greaterThan(at, glm::dvec3(last))))
      return std::nullopt;
    glm::dvec3 color;
    if (volume_.labels) {
      const glm::dvec4 shown = transfer_(value(glm::ivec3(at + 0.5)));
      if (!(shown.a > 0)) return std::nullopt;
      color = glm::dvec3(shown);
    } else {
      const glm::ivec3 cell = glm::min(glm::ivec3(at), last - 1);
      const glm::dvec3 f = at - glm::dvec3(cell);
      double sum = 0;
      for (int k = 0; k < 8; ++k) {
        const glm::ivec3 corner(k & 1, k >> 1 & 1, k >> 2);
        const glm::dvec3 w = glm::mix(1.0 - f, f, glm::dvec3(corner));
        sum += w.x * w.y * w.z * value(cell + corner);
      }
      if (!(sum > matter_)) return std::nullopt;
      color = glm::dvec3(std::clamp((sum - window_[0]) / (window_[1] - window_[0]), 0.0, 1.0));
    }
    if (linear_)
      for (int c = 0; c < 3; ++c) color[c] = linear_from_srgb(static_cast<float>(color[c]));
    return glm::vec3(color);
  }
  [[nodiscard]] double value(const glm::ivec3& at) const {
    const std::size_t number = (std::size_t{volume_.dims[1]} * static_cast<std::size_t>(at.z) +
                                static_cast<std::size_t>(at.y)) *
                                   volume_.dims[0] +
                               static_cast<std::size_t>(at.x);
    if (volume_.labels) return reinterpret_cast<const double*>(volume_.bytes().data())[number];
    return volume_.slope * std::to_integer<int>(volume_.bytes()[number]) + volume_.intercept;
  }

  std::shared_ptr<const Raycaster> behind_;
  Volume volume_;
  glm::dmat3 to_index_;
  std::vector<ClipPlane> clip_;
  TransferFunction transfer_;
  std::array<double, 2> window_;
  double matter_;
  bool linear_;
};

}  // namespace

Result<std::shared_ptr<const Scene>> make_cap(const Reveal& reveal, const std::string& provenance,
                                              std::span<const ClipPlane> clip,
                                              const CapOptions& asked) try {
  CapSettings settings = SLF_TRY(cap_settings(reveal, provenance, clip, asked));
  Volume volume = std::move(settings.volume);
  volume.share();
  const RaycastOptions& options = settings.options;
  LightVolumeOptions computing;
  computing.threads = asked.threads;
  computing.progress = asked.progress;
  computing.deferred = true;
  std::shared_ptr<const Raycaster> lit =
      SLF_TRY(Raycaster::make(volume, settings.transfer, options, computing));
  if (asked.cap == Cap::shaded) return std::shared_ptr<const Scene>(std::move(lit));
  const auto window = asked.window.value_or(reveal.greys);
  if (!(window[0] < window[1]))
    return fail_without("cap", ErrorCode::usage, "window ", window[0], ",", window[1],
                        ": expected two ascending numbers");
  return std::shared_ptr<const Scene>(
      std::make_shared<Slice>(std::move(lit), std::move(volume), options.clip, settings.transfer,
                              window, reveal.greys[0], options.lighting.linear));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
