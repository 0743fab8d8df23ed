#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/guarded.h"
#include "base/try.h"
#include "slf/mesh.h"
#include "slf/tone.h"
#include "source/mesh/surface.h"
#include "source/mesh/surface_light.h"
#include "source/raycast/provenance.h"

namespace slf {
namespace {

constexpr int kMaxLayers = 32;         // translucent surfaces that one ray shows
constexpr float kHidden = 1.f / 1024;  // what shows through at most when a ray ends
constexpr double kStep = 1e-6;         // beyond a translucent surface

std::string describe(const Mesh& mesh, const MeshOptions& options) {
  nlohmann::json out =
      describe_shading(options.shade, options.light, options.ambient, options.lighting);
  out["kind"] = "mesh";
  out["source"] = valid_utf8(mesh.source);
  out["content"] = content_hash(mesh);
  out["triangles"] = mesh.triangles.size();
  return out.dump();
}

}  // namespace

struct MeshScene::State {
  std::unique_ptr<MeshSurface> surface;
  std::optional<SurfaceLight> surface_light;
  MeshOptions options;
  glm::dvec3 toward_light;  // unit
  ToneMapper tone;
  ToneMapper encode{{.exposure = 0, .curve = ToneCurve::srgb}};
  std::string provenance;
  std::vector<std::string> files;

  /// The colour of a surface: radiance, or without a rig of lights an sRGB colour.
  [[nodiscard]] glm::vec3 shade(const SurfacePoint& point, const glm::vec3& color) const {
    if (surface_light) return color * surface_light->at(point);
    const glm::vec3 coded = encode(glm::vec4(color, 1));
    if (!options.shade) return coded;
    const auto lambert = static_cast<float>(
        std::max(0.0, glm::dot(toward_light, glm::dvec3(surface->normal(point)))));
    return (options.ambient + (1 - options.ambient) * lambert) * coded;
  }
};

MeshScene::MeshScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
MeshScene::~MeshScene() = default;

Result<std::unique_ptr<MeshScene>> MeshScene::make(Mesh mesh, const MeshOptions& options) {
  return guarded([&]() -> Result<std::unique_ptr<MeshScene>> {
    const LightOptions& lighting = options.lighting;
    SLF_TRY(check_light(lighting));
    const double length = glm::length(options.light);
    if (!(length > 0) || !std::isfinite(length))
      return fail(ErrorCode::usage, "direction to the light: expected not zero and finite");
    if (!(options.ambient >= 0 && options.ambient <= 1))
      return fail(ErrorCode::usage, "ambient ", options.ambient, ": expected 0 to 1");
    std::string provenance = describe(mesh, options);
    std::vector<std::string> files = mesh.files;
    auto surface = SLF_TRY(MeshSurface::make(std::move(mesh)));
    auto state = std::make_unique<State>(State{.surface = std::move(surface),
                                               .surface_light = {},
                                               .options = options,
                                               .toward_light = options.light / length,
                                               .tone = ToneMapper(lighting.tone),
                                               .provenance = std::move(provenance),
                                               .files = std::move(files)});
    if (lighting.mode != Lighting::direct) state->surface_light.emplace(*state->surface, lighting);
    return std::unique_ptr<MeshScene>(new MeshScene(std::move(state)));
  });
}

Sphere MeshScene::bounds() const { return state_->surface->bounds(); }
std::string MeshScene::provenance() const { return state_->provenance; }
std::vector<std::string> MeshScene::files() const { return state_->files; }

RaySample MeshScene::trace(const glm::dvec3& from, const glm::dvec3& to) const {
  const MeshSurface& surface = *state_->surface;
  const glm::dvec3 start = surface.to_local(from), whole = surface.to_local(to) - start;
  const double length = glm::length(whole);
  if (!(length > 0) || !std::isfinite(length)) return {};
  const glm::dvec3 direction = whole / length;
  glm::vec4 sum(0);
  double depth = 0, near = 0;
  for (int layer = 0; layer < kMaxLayers && near < length; ++layer) {
    const auto point = surface.first(start, direction, near, length);
    if (!point) break;
    const glm::vec4 color = surface.color(*point);
    const float share = (1 - sum.a) * color.a;
    sum += glm::vec4(share * state_->shade(*point, glm::vec3(color)), share);
    depth += share * point->distance;
    if (1 - sum.a < kHidden) break;
    near = point->distance + kStep;
  }
  if (!(sum.a > 0)) return {};
  const bool mapped = state_->surface_light && !state_->options.lighting.linear;
  return {mapped ? state_->tone(sum) : sum, static_cast<float>(depth / sum.a / length)};
}

}  // namespace slf
