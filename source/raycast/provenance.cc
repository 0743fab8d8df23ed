#include "source/raycast/provenance.h"

#include <xxhash.h>

#include <algorithm>
#include <iomanip>
#include <nlohmann/json.hpp>

#include "source/light/light_rig.h"
#include "source/volume/content.h"

namespace slf {
namespace {

using nlohmann::json;

template <class T, std::size_t N>
const char* name_of(T value, const Named<T> (&names)[N]) {
  return std::ranges::find_if(names, [=](const auto& one) { return one.second == value; })->first;
}

std::string hash(const Image& picture) {
  const XXH64_hash_t seed = std::uint64_t{picture.width} << 32 | picture.height;
  return concat(
      "xxh3-64:", std::hex, std::setw(16), std::setfill('0'),
      XXH3_64bits_withSeed(picture.rgba.data(), picture.rgba.size() * sizeof(glm::vec4), seed));
}

json describe(const LightOptions& options) {
  json out{{"mode", name_of(options.mode, kLightings)},
           {"rig", json::parse(to_json(options.rig))},
           {"samples", options.samples},
           {"bounces", options.bounces},
           {"spacing", options.spacing},
           {"memory", options.memory},
           {"seed", options.seed},
           {"linear", options.linear}};
  out["rig"]["name"] = valid_utf8(options.rig.name);
  if (options.environment) {
    out["environment"] = hash(*options.environment);
    out["environment_gain"] = options.environment_gain;
  }
  if (!options.linear)
    out["tone"] = {{"exposure", options.tone.exposure},
                   {"curve", name_of(options.tone.curve, kToneCurves)}};
  return out;
}

template <class T>
void number(const json& object, const char* name, T& to) {
  const auto found = object.find(name);
  if (found != object.end() && found->is_number()) to = found->get<T>();
}

/// The value with this name, or `otherwise`.
template <class T, std::size_t N>
T choice(const json& object, const char* member, const Named<T> (&names)[N], T otherwise) {
  const auto found = object.find(member);
  for (const auto& [name, value] : names)
    if (found != object.end() && *found == name) return value;
  return otherwise;
}

LightOptions light_options(const json& from) {
  LightOptions options;
  options.mode = choice(from, "mode", kLightings, options.mode);
  if (const auto rig = from.find("rig"); rig != from.end())
    if (auto parsed = parse_rig(rig->dump(), "provenance")) options.rig = std::move(*parsed);
  number(from, "samples", options.samples);
  number(from, "bounces", options.bounces);
  number(from, "spacing", options.spacing);
  number(from, "memory", options.memory);
  number(from, "seed", options.seed);
  number(from, "environment_gain", options.environment_gain);
  if (const auto linear = from.find("linear"); linear != from.end() && linear->is_boolean())
    options.linear = linear->get<bool>();
  if (const auto tone = from.find("tone"); tone != from.end() && tone->is_object()) {
    number(*tone, "exposure", options.tone.exposure);
    options.tone.curve = choice(*tone, "curve", kToneCurves, options.tone.curve);
  }
  return options;
}

}  // namespace

json valid_utf8(const std::string& text) {
  return json::parse(json(text).dump(-1, ' ', false, json::error_handler_t::replace));
}

json describe_shading(bool shade, const glm::dvec3& light, float ambient,
                      const LightOptions& lighting) {
  if (lighting.mode != Lighting::direct) return {{"lighting", describe(lighting)}};
  return {{"shade", shade}, {"light", {light.x, light.y, light.z}}, {"ambient", ambient}};
}

std::string describe(const Volume& volume, const TransferFunction& transfer,
                     const RaycastOptions& options) {
  json out{{"kind", "volume"},
           {"source", volume.private_name ? "DICOM" : valid_utf8(volume.source)},
           {"content", content_hash(volume)},
           {"dims", volume.dims},
           {"type", name(volume.type)},
           {"labels", volume.labels},
           {"origin", {volume.origin.x, volume.origin.y, volume.origin.z}},
           {"spacing", {volume.spacing().x, volume.spacing().y, volume.spacing().z}},
           {"transfer", json::parse(to_json(transfer))},
           {"step", options.step}};
  if (!volume.unit.empty()) out["unit"] = volume.unit;
  if (volume.patient_axes) out["space"] = "LPS";
  if (options.projection != Projection::none)
    out["projection"] = name_of(options.projection, kProjections);
  for (const auto& [point, normal] : options.clip)
    out["clip"].push_back({point.x, point.y, point.z, normal.x, normal.y, normal.z});
  out.update(describe_shading(options.shade, options.light, options.ambient, options.lighting));
  if (const VolumeParts& parts = options.parts; parts.labels || parts.mask || !parts.only.empty()) {
    json& recorded = out["structures"] = json::object();
    if (parts.labels) recorded["labels"] = content_hash(*parts.labels);
    if (parts.mask) recorded["mask"] = content_hash(*parts.mask);
    if (!parts.only.empty()) recorded["only"] = parts.only;
    for (const auto& [id, style] : parts.styles) {
      json one{{"id", id}, {"name", valid_utf8(style.name)}, {"opacity", style.opacity}};
      if (style.color) one["color"] = {style.color->r, style.color->g, style.color->b};
      recorded["styles"].push_back(one);
    }
  }
  return out.dump();
}

std::string light_key(const std::string& provenance) {
  json key = json::parse(provenance);
  for (const char* member : {"source", "space", "step", "unit"}) key.erase(member);
  if (const auto lighting = key.find("lighting"); lighting != key.end())
    for (const char* shown : {"linear", "tone"}) lighting->erase(shown);
  key["method"] = 3;  // of computing light and looking it up; others have other numbers
  return key.dump();
}

RaycastOptions raycast_options(std::string_view text) {
  const auto provenance = json::parse(text, nullptr, /*allow_exceptions=*/false);
  RaycastOptions options;
  if (!provenance.is_object()) return options;
  number(provenance, "step", options.step);
  number(provenance, "ambient", options.ambient);
  options.projection = choice(provenance, "projection", kProjections, options.projection);
  const json shade = provenance.value("shade", json());
  if (shade.is_boolean()) options.shade = shade.get<bool>();
  const json light = provenance.value("light", json());
  for (int axis = 0; light.is_array() && light.size() == 3 && axis < 3; ++axis)
    if (const json& v = light[static_cast<std::size_t>(axis)]; v.is_number())
      options.light[axis] = v.get<double>();
  const json clip = provenance.value("clip", json());
  for (const json& plane : clip.is_array() ? clip : json::array()) {
    std::array<double, 6> v{};
    for (std::size_t k = 0; plane.is_array() && k < std::min(v.size(), plane.size()); ++k)
      if (plane[k].is_number()) v[k] = plane[k].get<double>();
    options.clip.push_back({{v[0], v[1], v[2]}, {v[3], v[4], v[5]}});
  }
  const json lighting = provenance.value("lighting", json());
  if (lighting.is_object()) options.lighting = light_options(lighting);
  return options;
}

}  // namespace slf
