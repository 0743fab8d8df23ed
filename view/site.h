// Site: exports a field together with the page that shows it, as one file or a folder.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/file.h"
#include "slf/error.h"
#include "slf/progress.h"
#include "view/views.h"

namespace slf::view {

/// The largest field in bytes for an export as one file. Browsers would not load larger pages.
inline constexpr std::uint64_t kMaxEmbeddedBytes = std::uint64_t{1} << 30;

/// The size of the largest field, with its index, whose export as one HTML file or as a folder has
/// at most `max_bytes` bytes; 0 if the page alone is larger.
[[nodiscard]] std::uint64_t room_for_field(std::uint64_t max_bytes, bool one_file);

/// Whether export_field() writes one file: `output` ends in .html or .htm.
[[nodiscard]] bool is_page_name(std::string_view output);

/// Text as HTML has it in a quoted attribute.
[[nodiscard]] std::string escape_html(std::string_view text);

/// The page's index.html. Its element has these attributes, in place of its own, and content before
/// its own.
[[nodiscard]] std::string page_with(std::string_view attributes, std::string_view content);

/// Writes the field `field` with the page that shows it, and with views: one HTML file, which opens
/// from disk, or a folder for any host of static files that serves ranges. In a folder, the field
/// gets an index (doc/format/optional.md, "Index"). After an error, an HTML file is unchanged, and
/// so is the field in a folder. `input` is a file that must not be replaced: `field`, or what it
/// was made of. usage: `existing` is keep, and the HTML file exists or the folder has files in it
/// (Error::choice is then "replace" or "replace in"); or a file to write is `input`. io: a file
/// cannot be read or written. bad_file: `field` is no field. unsupported: the field is larger than
/// kMaxEmbeddedBytes, for one file; or slf was built without the page. cancelled: stopped by
/// `progress`, which counts bytes.
[[nodiscard]] Result<void> export_field(const std::string& field, const std::string& input,
                                        const std::string& output, const Views& views,
                                        Existing existing, const ProgressCallback& progress = {});

/// The errors of export_field() that can be found before any work.
[[nodiscard]] Result<void> check_export(const std::string& input, const std::string& output,
                                        Existing existing);

}  // namespace slf::view
