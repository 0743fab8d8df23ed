// OpenField: a Field with the renderer that draws it; and structures of Python.
#pragma once

#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <atomic>
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
#include "base/try.h"
#include "calls.h"
#include "field/structure_looks.h"
#include "slf/field.h"
#include "slf/raycaster.h"
#include "slf/recipe.h"
#include "slf/render.h"

namespace slf::python {

/// The renderer of a file's states and compositions: of what was drawn last, so that they share its
/// memory. What threads drew with when this process was forked stays as they left it.
struct Drawing {
  std::mutex mutex{};
  std::unique_ptr<Renderer> renderer{};
  std::uint64_t of = 0;  ///< the number of an OpenField; 0: none
  unsigned forks = torn_forks();
};

/// Thread-safety: any thread; one view is drawn at a time.
class OpenField {
 public:
  OpenField(Field field, const RendererOptions& options,
            std::shared_ptr<Drawing> drawing = std::make_shared<Drawing>())
      : field_(std::move(field)), options_(options), drawing_(std::move(drawing)) {}

  [[nodiscard]] const Field& field() const { return field_; }
  [[nodiscard]] const RendererOptions& options() const { return options_; }
  /// Something else of the same file.
  [[nodiscard]] std::unique_ptr<OpenField> with(Field field) const {
    return std::make_unique<OpenField>(std::move(field), options_, drawing_);
  }

  /// Call it before what follows, with the GIL: after a fork, a new renderer draws.
  OpenField& renewed() {
    Drawing& drawing = *drawing_;
    if (std::exchange(drawing.forks, torn_forks()) == drawing.forks) return *this;
    new (&drawing.mutex) std::mutex;
    (void)drawing.renderer.release();
    drawing.of = 0;
    return *this;
  }

  /// f(renderer), while no other thread draws.
  template <class F>
  auto drawn(F&& f) {
    const AtWork at_work;
    const std::lock_guard lock(drawing_->mutex);
    if (drawing_->of != number_) {
      drawing_->of = 0;
      drawing_->renderer.reset();
      drawing_->renderer = std::make_unique<Renderer>(field_, options_);
      drawing_->of = number_;
    }
    return std::forward<F>(f)(*drawing_->renderer);
  }
  /// With `memory`, by a renderer for this view only, which keeps at most so many bytes of decoded
  /// tiles.
  [[nodiscard]] Result<Image> render(const Camera& camera, const ViewOptions& view,
                                     std::optional<std::uint64_t> memory,
                                     const ProgressCallback& progress) {
    const auto draw = [&](Renderer& by) { return by.render(camera, view, nullptr, progress); };
    if (!memory) return drawn(draw);
    const AtWork at_work;
    Renderer own(field_, {*memory, options_.threads});
    return draw(own);
  }
  /// Adds planes to a view, but for those that the field was built with, and named_cap(). The last
  /// cap is kept.
  [[nodiscard]] Result<void> cut(ViewOptions& view, std::vector<ClipPlane> clip,
                                 const std::string& cap) {
    if (!clip.empty())
      std::erase_if(clip, [built = raycast_options(field_.provenance()).clip](const auto& plane) {
        return std::ranges::find(built, plane) != built.end();
      });
    const std::lock_guard lock(cutting_);
    if (!(clip == clip_ && cap == cap_name_)) {
      cap_ = SLF_TRY(
          named_cap(field_, clip, cap, {.memory = options_.memory, .threads = options_.threads}));
      clip_ = std::move(clip), cap_name_ = cap;
    }
    view.clip = clip_, view.cap = cap_;
    return {};
  }

 private:
  static std::uint64_t next_number() {
    static std::atomic<std::uint64_t> last{0};
    return ++last;
  }

  Field field_;
  RendererOptions options_;
  std::shared_ptr<Drawing> drawing_;
  std::uint64_t number_ = next_number();
  std::mutex cutting_;  // guards what follows
  std::vector<ClipPlane> clip_;
  std::string cap_name_;
  std::shared_ptr<const Scene> cap_;
};

/// Planes: a point and a normal of each, together or six numbers.
using PlaneTuples = std::vector<std::variant<std::pair<Triple, Triple>, std::array<double, 6>>>;
std::vector<ClipPlane> planes_of(const PlaneTuples& planes);

/// A field, or the name of a state or file; its opacity and its tint.
using LookTuple = std::tuple<std::variant<const OpenField*, Text>, float, std::array<float, 3>>;
/// Structures, also as texts for parse_structure().
using LookTuples = std::vector<std::variant<LookTuple, Text>>;
/// `names`: of the states, as for parse_structure().
std::vector<StructureLook> looks_of(const LookTuples& structures,
                                    std::span<const std::string> names = {});

}  // namespace slf::python
