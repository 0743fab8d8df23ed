// Structures by name: texts such as "left *:0.3:#ffd0b0", as slf render --structure takes them.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/field.h"

namespace slf {

/// How structures are shown. `name` is that of a state, a pattern (base/wildcard.h), or a file's.
struct StructureLook {
  std::string name;
  float opacity = 1;
  std::array<float, 3> tint{1, 1, 1};  ///< sRGB
  std::optional<Field> field{};        ///< that of `name`, if it is open
};

/// Parses NAME[:OPACITY][:#RRGGBB]. The names of states, `names`, may end as looks do. usage: what
/// follows a colon begins with #, but is no colour.
[[nodiscard]] Result<StructureLook> parse_structure(std::string_view text,
                                                    std::span<const std::string> names = {});
[[nodiscard]] Result<std::vector<StructureLook>> parse_structures(
    std::span<const std::string> texts, std::span<const std::string> names);
/// The text of a look.
[[nodiscard]] std::string text_of(const StructureLook& look);

/// Whether the states of a field are structures of one volume, which are drawn together.
[[nodiscard]] bool has_structures(const Field& field);

/// The states of `field` that looks show, for compose(): in their order, without hidden ones. The
/// name of a state is no pattern. Of several looks of one state, the last counts. Adds to `others`
/// what names no state.
[[nodiscard]] Result<std::vector<Structure>> structures_of(const Field& field,
                                                           std::span<const StructureLook> looks,
                                                           std::vector<StructureLook>& others);

/// compose() of structures_of() and, behind them at one depth, the other fields in the order of
/// their looks. `open` opens those that are not, unless they are hidden. usage: no file has the
/// name of a look, nor a state. Else errors as `open` and compose().
[[nodiscard]] Result<Field> compose_looks(
    const Field& field, std::span<const StructureLook> looks,
    const std::function<Result<Field>(const std::string&)>& open);
/// What is shown of a field if nothing is chosen: all structures if it has them, else itself.
[[nodiscard]] Result<Field> all_structures(const Field& field);

}  // namespace slf
