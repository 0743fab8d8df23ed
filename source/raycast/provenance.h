// The record of a scene in a field's manifest. Internal.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "slf/raycaster.h"

namespace slf {

/// The names of values, in records of scenes and in recipes.
template <class T>
using Named = std::pair<const char*, T>;
inline constexpr Named<Projection> kProjections[] = {
    {"mip", Projection::maximum}, {"minip", Projection::minimum}, {"mean", Projection::mean}};
inline constexpr Named<Lighting> kLightings[] = {
    {"direct", Lighting::direct}, {"shadowed", Lighting::shadowed}, {"global", Lighting::global}};
inline constexpr Named<ToneCurve> kToneCurves[] = {
    {"neutral", ToneCurve::neutral}, {"srgb", ToneCurve::srgb}, {"none", ToneCurve::none}};

/// Scene::provenance() of a volume: a JSON object of every setting that changes its rays.
/// raycast_options() reads the options back.
[[nodiscard]] std::string describe(const Volume& volume, const TransferFunction& transfer,
                                   const RaycastOptions& options);

/// The text with bytes that are not UTF-8 replaced by U+FFFD, because JSON holds UTF-8 only. (File
/// names may have any bytes.)
[[nodiscard]] nlohmann::json valid_utf8(const std::string& text);

/// The members of such an object that describe light, with the meaning of those of RaycastOptions:
/// `lighting`, or if its mode is direct the others. raycast_options() reads them back.
[[nodiscard]] nlohmann::json describe_shading(bool shade, const glm::dvec3& light, float ambient,
                                              const LightOptions& lighting);

/// The members of such an object on which a light volume depends: not the source's path, nor tone
/// mapping.
[[nodiscard]] std::string light_key(const std::string& provenance);

}  // namespace slf
