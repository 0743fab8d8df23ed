#include "source/raycast/shared_light.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/try.h"
#include "source/light/light_depth.h"
#include "source/raycast/provenance.h"

namespace slf {
namespace {

using nlohmann::json;

/// What scenes with one light may differ by.
constexpr std::string_view kCuts[] = {"clip", "structures"};

/// What a provenance says of a cut. Not null if nothing: manifests store states as merge patches,
/// which would lose it.
json said_of(std::string_view cut, const json& provenance) {
  return provenance.value(std::string(cut), cut == "clip" ? json::array() : json::object());
}

/// A node has its own light, in part, from this difference of optical depths on, and whole from the
/// second one on.
constexpr float kOpened = 0.25f, kOpen = 1;
/// The same for how many times as much light reaches it straight from outside: a cavity with a
/// small hole is not deep, but dark. That much light reaches every node in other ways.
constexpr float kBrightened = 1.1f, kBright = 1.4f, kAnyway = 0.005f;

json without_cuts(const VolumeScene& scene) {
  json key = json::parse(light_key(scene.provenance));
  for (const std::string_view cut : kCuts) key.erase(std::string(cut));
  return key;
}

/// Whether it has no light.
bool dark(const std::uint8_t* node) { return node[kChannels] == 0; }

void blend(std::uint8_t* node, const std::uint8_t* own, float share) {
  if (dark(own)) return;
  if (share >= 1 || dark(node))
    std::copy_n(own, LightGrid::kNodeBytes, node);
  else
    pack_light(((1 - share) * unpack_light(node)) += share * unpack_light(own), node);
}

}  // namespace

Result<void> check_shared_light(const VolumeScene& scene, const VolumeScene& from) {
  const json difference = json::diff(without_cuts(from), without_cuts(scene));
  if (!difference.empty())
    return fail(ErrorCode::usage, "scenes of one light differ only by what is cut away, but ",
                difference[0]["path"].get<std::string>(), " differs");
  if (glm::any(glm::lessThan(scene.grid.visible_low, from.grid.visible_low)) ||
      glm::any(glm::greaterThan(scene.grid.visible_high, from.grid.visible_high)))
    return fail(ErrorCode::usage, "what is visible reaches out of the box of the other light");
  return {};
}

std::string with_light_of(const std::string& provenance, const std::string& from) {
  json own = json::parse(provenance);
  const json other = json::parse(from);
  json& members = own["light_of"] = json::object();
  for (const std::string_view cut : kCuts)
    if (const json theirs = said_of(cut, other); theirs != said_of(cut, own))
      members[std::string(cut)] = theirs;
  return own.dump();
}

Result<LightGrid> shared_light(const LightGrid& lit, const VolumeScene& from,
                               const VolumeScene& scene, const Medium& medium, unsigned threads,
                               const ProgressCallback& progress) {
  const Illumination illumination = illuminate(from.lighting, from.bounds);
  LightComputer computer(medium, illumination, scene.lighting,
                         plan_light(from.grid, illumination, from.lighting), threads);
  SLF_TRY(computer.prepare());
  const Medium before(from.grid);
  const auto extinctions = SLF_TRY(node_extinctions(before, lit, threads));
  const auto depth = depth_from_outside(before, lit, extinctions);
  const auto open_before = openness(before, lit, extinctions);
  const auto extinctions_now = SLF_TRY(node_extinctions(medium, lit, threads));
  const auto open_now = openness(medium, lit, extinctions_now);
  const auto share = [&](std::size_t number) {
    const float opened = std::min(depth[number], kHidden) - computer.depth()[number];
    const float brighter = (open_now[number] + kAnyway) / (open_before[number] + kAnyway);
    return std::clamp(std::max((opened - kOpened) / (kOpen - kOpened),
                               (brighter - kBrightened) / (kBright - kBrightened)),
                      0.f, 1.f);
  };
  LightGrid light = lit, own = computer.blank();
  std::vector<std::size_t> open = computer.nodes();
  std::erase_if(open, [&](std::size_t number) { return share(number) == 0; });
  // Rays see nothing between nodes of which one is dark.
  open = computer.spread(std::move(open), 1);
  std::erase_if(
      open, [&](std::size_t number) { return share(number) == 0 && !dark(light.node(number)); });
  SLF_TRY(computer.compute(own, open, progress));
  for (const std::size_t number : open) blend(light.node(number), own.node(number), share(number));
  return light;
}

}  // namespace slf
