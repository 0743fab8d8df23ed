// Site: exports a field together with the page that shows it, as one file or a folder.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"
#include "slf/progress.h"

namespace slf::view {

/// The largest field in bytes for export_page(). Browsers would not load larger pages.
inline constexpr std::uint64_t kMaxEmbeddedBytes = std::uint64_t{1} << 30;

/// The size of the largest field, with its index, whose export as one HTML file or as a folder has
/// at most `max_bytes` bytes; 0 if the page alone is larger.
[[nodiscard]] std::uint64_t room_for_field(std::uint64_t max_bytes, bool one_file);

/// Writes one HTML file with the page and the field, which opens from disk. Replaces `output`;
/// after an error, `output` is unchanged. usage: `output` is the field. io: a file cannot be read
/// or written. bad_file: `field` is no field. unsupported: the field is larger than
/// kMaxEmbeddedBytes. REQUIRES: page_files() is not empty.
/// Progress counts bytes of the field. cancelled: stopped by `progress`.
[[nodiscard]] Result<void> export_page(const std::string& field, const std::string& output,
                                       const ProgressCallback& progress = {});

/// Writes a folder with the page and the field, for any host of static files that serves ranges.
/// The field gets an index (doc/format/optional.md, "Index"). usage: the folder has files in it and
/// `force` is false, or the field is a file that the page needs to write. Others as export_page().
/// Progress counts bytes of the field. cancelled: stopped by `progress`; the field is not written.
[[nodiscard]] Result<void> export_site(const std::string& field, const std::string& folder,
                                       bool force, const ProgressCallback& progress = {});

}  // namespace slf::view
