// SceneHandle: a Scene in Python, be it a volume or a function of Python.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "calls.h"
#include "slf/scene.h"

namespace slf::python {

/// Rays of a Python function: fn(origins[n,3], targets[n,3]) -> rgba[n,4] or (rgba, depth[n]). At
/// most `batch` rays at once. Takes the GIL for each call. Unless `concurrent`, a call begins after
/// the one before has returned. It is not asked for rays that end where they begin, which see
/// nothing.
///
/// What the function raises, and what is wrong with its results, is kept: rethrow() throws it as it
/// was. Meanwhile, tracing throws, which ends the work in progress.
class RayScene final : public Scene {
 public:
  RayScene(py::object fn, const Sphere& bounds, std::string provenance, std::size_t batch,
           bool concurrent)
      : fn_(std::move(fn)),
        bounds_(bounds),
        provenance_(std::move(provenance)),
        batch_(batch),
        concurrent_(concurrent) {}

  [[nodiscard]] Sphere bounds() const override { return bounds_; }
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override;
  [[nodiscard]] std::string provenance() const override { return provenance_; }

  /// Throws what the function raised, once. Needs the GIL.
  void rethrow() const;

 private:
  /// Takes the function's turn and the GIL, and asks it.
  void call(std::span<const Segment> rays, std::span<RaySample> out) const;
  void ask(std::span<const Segment> rays, std::span<RaySample> out) const;

  py::object fn_;
  Sphere bounds_;
  std::string provenance_;
  std::size_t batch_;
  bool concurrent_;
  mutable std::mutex turns_;
  mutable std::optional<py::error_already_set> raised_;  ///< guarded by the GIL
};

/// While it lives, takes the progress of light that its thread computes. Scenes keep a callback
/// longer than one call, and several threads may have calls of one scene in progress.
class LightProgress {
 public:
  explicit LightProgress(ProgressCallback to) : before_(std::exchange(current, std::move(to))) {}
  LightProgress(const LightProgress&) = delete;
  LightProgress& operator=(const LightProgress&) = delete;
  ~LightProgress() { current = std::move(before_); }

  /// The callback for scenes.
  static bool report(const Progress& progress) { return !current || current(progress); }

 private:
  static inline thread_local ProgressCallback current;
  ProgressCallback before_;
};

struct SceneHandle {
  std::shared_ptr<const Scene> scene;
  const RayScene* rays = nullptr;  ///< the scene, if it is one
  std::string recipe{};            ///< JSON of how it was made

  /// Runs f, which traces rays, as one long call. Throws what a function of rays raised.
  template <class F>
  auto trace(LongCall& call, F&& f) const {
    auto result = call.without_gil([&] {
      const LightProgress light(call.progress());
      return std::forward<F>(f)();
    });
    if (rays) rays->rethrow();
    return result;
  }
};

}  // namespace slf::python
