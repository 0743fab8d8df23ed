// OpenField: a Field with the renderer that draws it; and structures of Python.
#pragma once

#include <pybind11/stl.h>

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "base/fork.h"
#include "calls.h"
#include "field/structure_looks.h"
#include "slf/field.h"
#include "slf/render.h"

namespace slf::python {

/// Thread-safety: any thread; one view is drawn at a time.
class OpenField {
 public:
  OpenField(Field field, const RendererOptions& options)
      : field_(std::move(field)), options_(options) {}

  [[nodiscard]] const Field& field() const { return field_; }
  [[nodiscard]] const RendererOptions& options() const { return options_; }

  /// Call it before what follows, with the GIL. What threads drew with when this process was forked
  /// stays as they left it; a new renderer draws.
  OpenField& renewed() {
    if (std::exchange(forks_, torn_forks()) == forks_) return *this;
    new (&mutex_) std::mutex;
    (void)renderer_.release();
    return *this;
  }

  /// With `memory`, by a renderer for this view only, which keeps at most so many bytes of decoded
  /// tiles, and as many of the mapped file.
  [[nodiscard]] Result<Image> render(const Camera& camera, const ViewOptions& view,
                                     std::optional<std::uint64_t> memory,
                                     const ProgressCallback& progress) {
    const AtWork at_work;
    if (memory)
      return Renderer(field_, {*memory, options_.threads, *memory})
          .render(camera, view, nullptr, progress);
    const std::lock_guard lock(mutex_);
    return renderer().render(camera, view, nullptr, progress);
  }
  [[nodiscard]] Result<std::optional<PickedPoint>> pick(const Camera& camera, double x, double y) {
    const AtWork at_work;
    const std::lock_guard lock(mutex_);
    return slf::pick(renderer(), camera, x, y);
  }
  /// The tiles that render() draws from.
  [[nodiscard]] TileReader tiles() {
    const AtWork at_work;
    const std::lock_guard lock(mutex_);
    return renderer().tiles();
  }

 private:
  [[nodiscard]] Renderer& renderer() {
    if (!renderer_) renderer_ = std::make_unique<Renderer>(field_, options_);
    return *renderer_;
  }

  Field field_;
  RendererOptions options_;
  unsigned forks_ = torn_forks();
  std::mutex mutex_;
  std::unique_ptr<Renderer> renderer_;
};

/// A field, or the name of a state or file; its opacity and its tint.
using LookTuple = std::tuple<std::variant<const OpenField*, Text>, float, std::array<float, 3>>;
/// Structures, also as texts for parse_structure().
using LookTuples = std::vector<std::variant<LookTuple, Text>>;
/// `names`: of the states, as for parse_structure().
std::vector<StructureLook> looks_of(const LookTuples& structures,
                                    std::span<const std::string> names = {});

}  // namespace slf::python
