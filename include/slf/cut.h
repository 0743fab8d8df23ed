// Cuts: the reveal of a volume (reveal.h), and the scene that shows what planes lay open of it.
//
//   const auto reveal = field.reveal();
//   view.clip = {{point, normal}};
//   view.cap = *slf::make_cap(**reveal, field.provenance(), view.clip);
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "slf/error.h"
#include "slf/reveal.h"
#include "slf/scene.h"
#include "slf/volume.h"

namespace slf {

struct RevealOptions {
  std::uint32_t side = 192;  ///< voxels along the longest side, 16 to Reveal::kMaxSide
  /// Values to keep, all of them, in the volume's units. None: voxels that touch nothing visible
  /// are left out.
  std::optional<std::array<double, 2>> window{};
  std::uint32_t loss = 0;  ///< Reveal::loss, of amounts
  unsigned threads = 0;    ///< 0: all
};

/// The reveal of the volume of the first scene, as far as any of the scenes shows it that are of
/// the same volume. Along axes that have fewer voxels than it may have, it has those of the volume.
/// usage: an option out of range, or the first scene is no Raycaster. unsupported: over 256 labels.
[[nodiscard]] Result<Reveal> make_reveal(std::span<const Scene* const> scenes,
                                         const RevealOptions& options = {});

/// A reveal as a volume, in the volume's values.
[[nodiscard]] Volume volume_of(const Reveal& reveal);

/// What the faces of a cut show.
enum class Cap : std::uint8_t {
  shaded,  ///< matter, under its own light
  slice,   ///< the scan's values, in grey; what lies behind is shaded
};

struct CapOptions {
  Cap cap = Cap::shaded;
  std::optional<std::array<double, 2>> window{};  ///< of values, from black to white
  bool coarse_light = false;                      ///< by a tenth of the work, for a first look
  std::uint64_t memory = 1ull << 30;              ///< for all of it; little makes light coarser
  unsigned threads = 0;                           ///< of light; 0: all
  ProgressCallback progress{};                    ///< of light
};

/// The scene that a field shows beyond planes, for ViewOptions::cap. `provenance`: of the field,
/// which has the colours and the light, and planes of its own. Light is computed where rays need
/// it. usage: `memory` is too little. unsupported: the field was lit by a picture, which it does
/// not keep. failed: the planes leave nothing. Else errors as Raycaster::make().
[[nodiscard]] Result<std::shared_ptr<const Scene>> make_cap(const Reveal& reveal,
                                                            const std::string& provenance,
                                                            std::span<const ClipPlane> clip,
                                                            const CapOptions& options = {});

}  // namespace slf
