// Site: a field and the page that shows it, as files for others.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"

namespace slf::view {

/// Fields above this size do not fit into one page: browsers would not load it.
inline constexpr std::uint64_t kMostInside = std::uint64_t{1} << 30;

/// How large a field may be in a result of `most` bytes: one HTML file, or a folder.
[[nodiscard]] std::uint64_t room_for_field(std::uint64_t most, bool one_file);

/// Writes one HTML file that holds the page and the field, and opens from disk. Replaces `output`,
/// or leaves it as it was. io: a file cannot be read or written. bad_file: `field` is no field.
/// unsupported: the field is larger than kMostInside. REQUIRES: page_files() is not empty.
[[nodiscard]] Result<void> export_page(const std::string& field, const std::string& output);

/// Writes a folder with the page and the field, for any host of static files that serves ranges.
/// The field gets an index (FORMAT.md, "Index"). usage: the folder has files in it and `force` is
/// false. Others as export_page().
[[nodiscard]] Result<void> export_site(const std::string& field, const std::string& folder,
                                       bool force);

}  // namespace slf::view
