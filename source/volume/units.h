// Units of length, as files name them.
#pragma once

#include <optional>
#include <string_view>

namespace slf::volume_io {

/// A unit in micrometres, by its symbol in OME or another usual name; nullopt: no length, or an
/// unknown one. Prefixes have their case: Mm is no mm.
[[nodiscard]] std::optional<double> micrometres(std::string_view unit);

}  // namespace slf::volume_io
