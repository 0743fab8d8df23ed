// Light: what illuminates a volume, and how accurately its way through the volume is computed.
//
// If the material scatters equally in all directions, the light that arrives at a point does not
// depend on the view. So it is computed once, into a light volume, which rays sample.
//
// Model. Extinction comes from the transfer function's opacity. A point x with albedo c shows the
// radiance
//
//   c ∫ K(ω) L(x + h, ω) dω,    K(ω) = s max(0, n·ω)/π + (1 - s)/4π
//
// of the light L that arrives from all directions ω: a mixture of a Lambertian surface with the
// normal n = -∇v/|∇v| and an isotropic phase function. As in Kroes, Post, Botha, "Exposure Render:
// an interactive photo-realistic volume rendering framework", PLoS ONE 7(7), 2012, the share of the
// surface is s = a (1 - exp(-|∇v| / g)): a is the opacity over the two voxels across which the
// gradient is measured, and g is 2 % of the value range per voxel; less if the range extends far
// beyond the values at which opacity rises. A gradient spreads a surface over about two voxels,
// which must not shadow it: h = 1.5 s n voxels. ∫ K dω ≤ 1 and c ≤ 1, so nothing becomes brighter
// than the brightest direction it is lit from.
//
// The transfer function's colour C (decoded from sRGB) is the colour of a thick, evenly lit piece
// of the material. So c = s C + (1 - s) a(C), where a is the single-scattering albedo that gives
// the colour C (Chiang, Kutz, Burley, "Practical and controllable subsurface scattering for
// production path tracing", SIGGRAPH Talks 2016).
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/image.h"
#include "slf/tone.h"

namespace slf {

enum class Lighting : std::uint8_t {
  direct,    ///< one directional light without shadows, shaded by the gradient; no light volume
  shadowed,  ///< lights and surroundings, attenuated by the volume on their way to each point
  global,    ///< and light that the volume scatters
};

/// A light that shines on the scene and is itself invisible: a disc that faces the centre of the
/// scene's bounds, or a direction if its size is 0.
struct Light {
  glm::dvec3 direction{0, 0, 1};  ///< world direction from the centre to the light; any length
  /// Linear RGB times intensity is the radiance of a white surface that faces the light at the
  /// centre. Not negative.
  glm::vec3 color{1};
  float intensity = 1;
  float size = 0;      ///< apparent diameter from the centre, in degrees, 0 to 120
  float distance = 0;  ///< from the centre, in radii of the bounds, above 1; 0: infinitely far
};

/// The surroundings, if there is no environment picture: radiance straight up (+z), at the horizon
/// and straight down, interpolated linearly in z.
struct Sky {
  glm::vec3 up{0}, horizon{0}, down{0};
};

struct LightRig {
  std::string name;
  std::string description{};  ///< built-in rigs only
  std::vector<Light> lights;
  Sky sky{};
};

/// The rigs that come with the library; the first is the default. Static lifetime.
[[nodiscard]] std::span<const LightRig> built_in_rigs();

/// A built-in rig by name, or a JSON file: {"name": TEXT, "lights": [{"direction": [x,y,z],
/// "color": [r,g,b], "intensity": 1, "size": 0, "distance": 0}, …], "sky": {"up": [r,g,b],
/// "horizon": [r,g,b], "down": [r,g,b]}}; all members are optional but `direction`. Input is
/// untrusted.
/// usage: neither a built-in rig nor a file; the message lists the rigs. bad_file: not such a file,
/// a number out of range; the message names the member. io: unreadable.
[[nodiscard]] Result<LightRig> read_rig(const std::string& reference);

/// The JSON of a rig, which read_rig reads back.
[[nodiscard]] std::string to_json(const LightRig& rig);

struct LightOptions {
  Lighting mode = Lighting::direct;
  LightRig rig = built_in_rigs().front();
  /// Latitude-longitude picture of linear radiance that replaces the rig's sky. The top row is up
  /// (+z), the middle column in front of the patient (-y), columns left of it to the patient's
  /// right (-x).
  std::shared_ptr<const Image> environment;
  float environment_gain = 1;  ///< factor of the picture's radiance, not negative

  std::uint32_t samples = 16;  ///< paths of light per node of the light volume, 1 to 65536
  std::uint32_t bounces = 32;  ///< how often light may scatter (global), 0 to 1000
  double spacing = 2;          ///< between nodes, in voxels, 0.5 to 16
  /// Approximate limit, in bytes, of the memory for computing the light volume, estimated from its
  /// number of nodes. If `spacing` would need more, a larger spacing is used.
  std::uint64_t memory = std::uint64_t{1} << 30;
  std::uint64_t seed = 1;  ///< of the random numbers: another seed gives other noise

  ToneMapping tone{};   ///< of the rays' colours
  bool linear = false;  ///< rays get linear radiance, which is tone-mapped later
};

}  // namespace slf
