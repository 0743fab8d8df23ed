// Reveal: the small copy of its volume that a field may keep, to show what planes lay open
// (doc/cut.md). The bytes are in doc/format/optional.md, "Reveal".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"

namespace slf {

/// How each value is shown is not in it, but in the provenance of each state of the field.
struct Reveal {
  static constexpr std::uint32_t kMaxSide = 512, kMaxLoss = 16;

  std::array<std::uint32_t, 3> dims{};  ///< 2 to kMaxSide
  glm::dvec3 origin{0.0};               ///< world position of the first voxel's centre
  glm::dmat3 axes{1.0};                 ///< columns: from a voxel to the next one along x, y, z
  double low = 0, high = 1;             ///< the values of bytes 0 and 255
  /// What a slice shows by default as black, below which it shows nothing, and as white.
  std::array<double, 2> greys{0, 1};
  double gradient = 1;        ///< RaycastOptions::surface_gradient of the volume
  double unit = 1;            ///< the smallest distance between the volume's own voxels
  std::vector<double> ids{};  ///< of a volume of labels: what each byte stands for
  std::uint32_t loss = 0;     ///< by how much its code changes bytes of amounts, 0 to kMaxLoss
  std::vector<std::byte> voxels{};  ///< x fastest, then y, then z
  /// The structure of each voxel: 0, or 1 + the number of its id. None: the volume has no parts.
  std::vector<std::byte> parts{};
  std::vector<double> part_ids{};
  bool masked = false;    ///< the last structure, which has no id, is what a mask hides
  std::string content{};  ///< what it is a copy of: content_of() some provenance
};

/// The code of a reveal, on `threads` threads (0: all), on which it does not depend. usage: members
/// contradict each other.
[[nodiscard]] Result<std::vector<std::byte>> encode(const Reveal& reveal, unsigned threads = 0);

/// Input is untrusted. Without `voxels`, they and `parts` stay empty. bad_file: it is damaged.
/// unsupported: of a later version.
enum class RevealPart { head, all };
[[nodiscard]] Result<Reveal> decode_reveal(std::span<const std::byte> code,
                                           RevealPart part = RevealPart::all, unsigned threads = 0);

/// The hashes of a volume, of its labels and of its mask in a provenance, a JSON object: equal for
/// scenes that can have one reveal. Empty: it is of no volume.
[[nodiscard]] std::string content_of(std::string_view provenance);

}  // namespace slf
