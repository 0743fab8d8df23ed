// Structures: the parts of a volume, by labels on the same grid, in colours of their own.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf {

/// Reads a table of styles, recognised by content: ITK-SNAP's label description (`IDX R G B A VIS
/// MESH "NAME"`, colours 0 to 255, A and VIS 0 to 1), 3D Slicer's colour table (`ID NAME R G B A`,
/// all 0 to 255), or JSON: {"labels": [{"id": 1, "name": "liver", "color": [0.8, 0.3, 0.2],
/// "opacity": 1}, …]}. Lines that begin with # are comments. Input is untrusted.
/// io: unreadable. bad_file: none of these, a number out of range, an id twice; the message names
/// the line or member.
[[nodiscard]] Result<LabelTable> read_label_table(const std::string& path);

/// The table in the bytes of a file; `source` is its name for messages.
[[nodiscard]] Result<LabelTable> parse_label_table(const std::string& bytes,
                                                   const std::string& source);

/// Parts of a grey volume. A sample belongs to the structure whose id its nearest voxel has.
struct Structures {
  std::shared_ptr<const Volume> labels;  ///< ids, on the grid of the grey volume; or null
  /// An id without a style gets a colour derived from the id; id 0 then keeps the transfer
  /// function's colours.
  LabelTable styles{};
  std::shared_ptr<const Volume> mask;  ///< voxels that are 0 are invisible; or null
};

}  // namespace slf
