// VolumeParts: the parts of a volume, by a volume of labels, in colours of their own. What is drawn
// together is a Structure (slf/field.h).
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf {

/// Reads a table of styles, recognised by content:
///  - ITK-SNAP's label description: `ID R G B A VIS MESH "NAME"`, A and VIS 0 to 1;
///  - 3D Slicer's color table (.ctbl): `ID NAME R G B A`, all 0 to 255, or without A;
///  - FreeSurfer's, as FreeSurferColorLUT.txt: the same columns, but the last one is no opacity. Id
///    0 is clear and the others opaque. Comments tell which of both a table is; without any, a
///    table that would hide every label is FreeSurfer's;
///  - 3D Slicer's CSV with the columns LabelValue, Color_R, Color_G, Color_B and, optionally, Name
///    and Color_A, in any order after the first;
///  - JSON: {"labels": [{"id": 1, "name": "liver", "color": [0.8, 0.3, 0.2], "opacity": 1}, …]}.
///
/// Colours are 0 to 255, except in JSON. In text, # begins a comment. Input is untrusted.
/// io: unreadable. bad_file: none of these, a number out of range, an id twice (FreeSurfer: the
/// last one holds); the message names the line or member.
[[nodiscard]] Result<LabelTable> read_label_table(const std::string& path);

/// The table in the bytes of a file; `source` is its name for messages.
[[nodiscard]] Result<LabelTable> parse_label_table(const std::string& bytes,
                                                   const std::string& source);

/// Parts of a grey volume. A sample belongs to the part whose id its nearest voxel has.
/// Labels and mask may be on another grid: each voxel of the grey volume takes the value of theirs
/// that is nearest by world position, and 0 outside of them.
struct VolumeParts {
  std::shared_ptr<const Volume> labels;  ///< ids; or null
  /// An id without a style gets a colour derived from the id; id 0 then keeps the transfer
  /// function's colours.
  LabelTable styles{};
  std::shared_ptr<const Volume> mask;  ///< where it is 0, the volume is invisible; or null
  /// The ids to show, of `labels` or of a volume of labels; empty: all. Others are hidden, but a
  /// light volume, and Scene::bounds(), are those of all: what is hidden keeps its shadows.
  std::set<std::int64_t> only{};
};

/// Whether the voxels of two volumes are the same points of the world, to half a voxel.
[[nodiscard]] bool same_grid(const Volume& a, const Volume& b);

}  // namespace slf
