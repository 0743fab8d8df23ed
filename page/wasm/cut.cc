// The project's C++ code for cuts in the page: a module that a worker loads for the first cut of a
// field with a reveal. It decodes the reveal, makes what the shader marches through, and computes
// the light of what planes lay open. page/web/cut.js calls it.
#include <array>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "base/half.h"
#include "base/try.h"
#include "page/wasm/exchange.h"
#include "source/raycast/cap_settings.h"
#include "source/raycast/light_on_demand.h"
#include "source/raycast/provenance.h"

/// Exceptions end the module.
extern "C" void* __cxa_allocate_exception(std::size_t) { __builtin_trap(); }
extern "C" void __cxa_throw(void*, void*, void (*)(void*)) { __builtin_trap(); }

namespace {

using namespace slf;
using nlohmann::json;

constexpr std::size_t kMaxTable = 1 << 20;  // entries

struct Cut {
  Reveal reveal;
  std::string provenance;                      // of the state that is shown
  std::unique_ptr<PreparedVolume> shown, lit;  // `lit` has the light; null: it is that of `shown`
  std::unique_ptr<LightOnDemand> light;        // of `lit` or `shown`
  Bytes part;                                  // that JavaScript takes
};

Cut& cut() {
  static Cut instance;
  return instance;
}

json list_of(const glm::dvec3& v) { return {v.x, v.y, v.z}; }
template <class Matrix>
json columns_of(const Matrix& m) {
  json all = json::array();
  for (int column = 0; column < 3; ++column)
    for (int k = 0; k < 3; ++k) all.push_back(m[static_cast<std::size_t>(column)][k]);
  return all;
}

/// The surroundings in evenly spread directions: direction and radiance.
json sky_of(const Environment& environment) {
  constexpr int kDirections = 256;
  json sky = json::array();
  for (int k = 0; k < kDirections; ++k) {
    const double z = 1 - (2 * k + 1.0) / kDirections,
                 around = k * std::numbers::pi * (3 - 2.2360679775);
    const double r = std::sqrt(1 - z * z);
    const glm::dvec3 direction(r * std::cos(around), r * std::sin(around), z);
    const glm::vec3 radiance = environment.radiance(direction);
    sky.push_back({direction.x, direction.y, direction.z, radiance.r, radiance.g, radiance.b});
  }
  return sky;
}

/// What the shader needs of a scene, but for its arrays.
json describe(const PreparedVolume& scene) {
  const RayGrid& grid = scene.grid;
  const TransferTable& table = grid.table;
  const bool lit = scene.lighting.mode != Lighting::direct;
  const json built = json::parse(scene.provenance);
  const nlohmann::json::json_pointer at("/lighting/tone/curve");
  const json curve = built.contains(at) ? built[at] : json("none");  // value() would throw
  json lights = json::array(), sky = json::array();
  if (lit) {
    const Illumination illumination = illuminate(scene.lighting, scene.bounds);
    for (const PlacedLight& light : illumination.lights) {
      if (lights.size() == kGridLights) break;
      const GridLight of = light.seen_from(grid.origin);
      lights.push_back({{"irradiance", list_of(of.irradiance)},
                        {"direction", list_of(of.direction)},
                        {"place", list_of(glm::dvec3(of.place) + grid.origin)},
                        {"distance", of.distance}});
    }
    sky = sky_of(illumination.environment);
  }
  return {{"dims", grid.dims},
          {"toIndex", columns_of(grid.world_to_index)},
          {"axes", columns_of(grid.index_to_world)},
          {"origin", list_of(grid.origin)},
          {"unit", grid.unit},
          {"gradient", columns_of(grid.gradient_to_world)},
          {"surface", grid.inverse_gradient_floor},
          {"leaps", grid.bricks},
          {"entries", table.entries},
          {"low", table.low},
          {"scale", table.scale},
          {"labels", grid.labels},
          {"rows", grid.labels || !grid.rows.empty()},
          {"clip", built.value("clip", json::array())},
          {"greys", cut().reveal.greys},
          {"range", {cut().reveal.low, cut().reveal.high}},
          {"lit", lit},
          {"linear", lit && scene.lighting.linear},
          {"curve", curve},
          {"exposure", scene.lighting.tone.exposure},
          {"shade", grid.shade},
          {"toLight", list_of(grid.light)},
          {"ambient", grid.ambient},
          {"lights", lights},
          {"sky", sky}};
}

/// Three texels for each entry: colour and extinction up to the next; albedo and the share of the
/// surface; the integral of extinction before it.
Bytes table_of(const PreparedVolume& scene) {
  const TransferTable& table = scene.grid.table;
  const std::vector<glm::vec4> albedos = Medium(scene.grid).albedos();
  std::vector<glm::vec4> texels;
  for (std::size_t k = 0; k < table.colors.size(); ++k) {
    const auto [before, extinction] = table.integrals[k];
    texels.emplace_back(glm::vec3(table.colors[k]), extinction);
    texels.push_back(albedos[k]);
    texels.emplace_back(before, table.extinctions[k], 0, 0);
  }
  const auto bytes = std::as_bytes(std::span(texels));
  return {bytes.begin(), bytes.end()};
}

/// What is interpolated: amounts; of labels, which of them are visible.
Bytes voxels_of(const PreparedVolume& scene) {
  const RayGrid& grid = scene.grid;
  const std::size_t count = cut().reveal.voxels.size();
  if (!grid.labels) return cut().reveal.voxels;
  Bytes visible(count);
  const auto* numbers = reinterpret_cast<const std::uint16_t*>(grid.voxels);
  for (std::size_t k = 0; k < count; ++k)
    visible[k] =
        std::byte{grid.table.extinctions[numbers[k]] > 0 ? std::uint8_t{255} : std::uint8_t{0}};
  return visible;
}

/// The row of the table that each voxel uses; none: they all use the first one.
Bytes rows_of(const PreparedVolume& scene) {
  const RayGrid& grid = scene.grid;
  const auto bytes = std::as_bytes(grid.rows);
  Bytes rows(bytes.begin(), bytes.end());
  const auto* numbers = reinterpret_cast<const std::uint16_t*>(grid.voxels);
  for (std::size_t k = 0; grid.labels && k < cut().reveal.voxels.size(); ++k)
    rows.push_back(static_cast<std::byte>(numbers[k]));
  return rows;
}

/// The light that is known, in half floats, as three grids of four channels: mean and 1; change and
/// the first of `arrives`; red and blue of the tint and the rest. All are 0 where it is not known.
Bytes light_of(const LightGrid& light) {
  const std::size_t count = light.size();
  std::vector<std::uint16_t> grids(12 * count);
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint8_t* node = light.node(k);
    if (node[kChannels] == kMissingNode) continue;
    const ArrivingLight at = unpack_light(node);
    const bool dark = node[kChannels] == 0;
    const std::array<float, 12> values{at.mean.r,   at.mean.g,   at.mean.b,    1,
                                       at.change.x, at.change.y, at.change.z,  at.arrives.x,
                                       at.tint.r,   at.tint.b,   at.arrives.y, at.arrives.z};
    for (std::size_t c = 0; c < 12; ++c)
      grids[4 * (c / 4 * count + k) + c % 4] = half_from_float(dark && c != 3 ? 0 : values[c]);
  }
  const auto bytes = std::as_bytes(std::span(grids));
  return {bytes.begin(), bytes.end()};
}

Result<std::unique_ptr<PreparedVolume>> scene_of(std::span<const ClipPlane> clip, bool coarse,
                                                 bool whole) {
  CapOptions asked;
  asked.coarse_light = coarse;
  auto settings = SLF_TRY(cap_settings(cut().reveal, cut().provenance, clip, asked));
  if (whole) settings.options.parts.only.clear();
  return prepare_volume(std::move(settings.volume), settings.transfer, settings.options);
}

Result<void> begin() {
  Cut& c = cut();
  c.reveal = SLF_TRY(decode_reveal(taken_buffer(), RevealPart::all, 1));
  return {};
}

/// Shows a state whose provenance is in the buffer.
Result<void> show() {
  Cut& c = cut();
  c.light.reset();
  c.lit.reset();
  c.provenance = chars_of(taken_buffer());
  if (c.reveal.content != content_of(c.provenance))
    return fail(ErrorCode::unsupported, "this state is of another volume than the reveal");
  c.shown = SLF_TRY(scene_of({}, false, false));
  const RayGrid& grid = c.shown->grid;
  if (grid.projection != Projection::none || grid.table.logarithmic ||
      grid.table.colors.size() > kMaxTable)
    return fail(ErrorCode::unsupported, "what this field shows cannot be marched in a page");
  exchange().text = describe(*c.shown).dump();
  return {};
}

/// Begins with other planes, which the buffer holds: six numbers each.
Result<void> light(bool coarse) {
  Cut& c = cut();
  const Bytes bytes = taken_buffer();
  std::vector<ClipPlane> clip(bytes.size() / sizeof(ClipPlane));
  std::memcpy(clip.data(), bytes.data(), clip.size() * sizeof(ClipPlane));
  c.light.reset();
  c.lit = SLF_TRY(scene_of(clip, coarse, true));
  c.light = std::make_unique<LightOnDemand>(*c.lit, 1);
  return c.light->prepare();
}

/// Computes the light that rays need; the buffer holds the six numbers of each.
Result<void> add_rays() {
  Cut& c = cut();
  const Bytes bytes = taken_buffer();
  std::vector<Segment> rays(bytes.size() / sizeof(Segment));
  std::memcpy(rays.data(), bytes.data(), rays.size() * sizeof(Segment));
  std::vector<RaySample> samples(rays.size());
  RayCounts counts;
  c.light->trace(rays, samples, counts);
  SLF_TRY(c.light->compute_missed({}));
  const LightGrid& of = *c.lit->grid.light_volume;
  exchange().text =
      json{{"dims", of.dims}, {"low", list_of(of.low)}, {"spacing", of.spacing}}.dump();
  return {};
}

int status(const Result<void>& result) { return result ? kDone : failed(result.error()); }

}  // namespace

/// Decodes the reveal in the buffer.
SLF_EXPORT(slf_reveal) int slf_reveal() { return status(begin()); }
SLF_EXPORT(slf_show) int slf_show() { return status(show()); }
SLF_EXPORT(slf_light) int slf_light(int coarse) { return status(light(coarse != 0)); }
SLF_EXPORT(slf_light_rays) int slf_light_rays() { return status(add_rays()); }

/// Makes an array: 0 voxels, 1 rows, 2 distances of empty bricks, 3 table, 4 light.
SLF_EXPORT(slf_part) const std::byte* slf_part(int which) {
  Cut& c = cut();
  const auto leaps = std::as_bytes(std::span(c.shown->grid.distance));
  c.part = which == 0   ? voxels_of(*c.shown)
           : which == 1 ? rows_of(*c.shown)
           : which == 2 ? Bytes(leaps.begin(), leaps.end())
           : which == 3 ? table_of(*c.shown)
                        : light_of(*c.lit->grid.light_volume);
  return c.part.data();
}
SLF_EXPORT(slf_part_bytes) std::size_t slf_part_bytes() { return cut().part.size(); }
