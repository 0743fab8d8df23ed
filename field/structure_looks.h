// Structures by name: texts such as "left *:0.3:#ffd0b0", as slf render --structure takes them.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/field.h"

namespace slf {

/// How structures are shown. `name` is that of a state or a pattern (fnmatch), or of a file.
struct StructureLook {
  std::string name;
  float opacity = 1;
  std::array<float, 3> tint{1, 1, 1};  ///< sRGB
};

/// Parses NAME[:OPACITY][:#RRGGBB]; one of `names` may have colons. usage: what follows a colon
/// begins with #, but is no colour.
[[nodiscard]] Result<StructureLook> parse_structure(std::string_view text,
                                                    std::span<const std::string> names = {});

/// Whether the states of a field are structures of one volume, which are drawn together.
[[nodiscard]] bool has_structures(const Field& field);

/// The states of `field` that texts show, for compose(): in their order, without hidden ones. The
/// name of a state is no pattern. Of several texts for one state, the last counts. Adds to `others`
/// what names no state. usage: as parse_structure().
[[nodiscard]] Result<std::vector<Structure>> structures_of(const Field& field,
                                                           std::span<const std::string> texts,
                                                           std::vector<StructureLook>& others);

}  // namespace slf
