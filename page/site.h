// Site: exports a field together with the page that shows it, as one file or a folder.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/file.h"
#include "page/views.h"
#include "slf/error.h"
#include "slf/progress.h"
#include "slf/repack.h"

namespace slf::page {

/// The largest field in bytes for an export as one file. Browsers would not load larger pages.
inline constexpr std::uint64_t kMaxEmbeddedBytes = std::uint64_t{1} << 30;

/// Text as HTML has it in a quoted attribute.
[[nodiscard]] std::string escape_html(std::string_view text);

/// The page's index.html, which says what it is about. Its element has these attributes, in place
/// of its own, and content before its own.
[[nodiscard]] std::string page_with(const About& about, std::string_view attributes,
                                    std::string_view content);

struct ExportOptions {
  std::vector<std::string> states{};  ///< to keep, by their names or numbers; none: all
  RepackOptions repack{};             ///< codec, levels and depths to keep, threads
  std::uint64_t max_size = 0;         ///< bytes of all that is written; 0: no limit
  ViewsFile views{};
  std::string title{};  ///< in place of that of the views
  std::string url{};    ///< where the page will be, for those who show links to it
  First first{};
  Existing existing = Existing::keep;
};

struct ExportReport {
  std::string output{};
  std::uint64_t field_bytes = 0;
  unsigned level = 0;

  static constexpr const char* kPython = "ExportReport";
  void describe(auto& member) const {
    member({"output", nullptr}, output, "the page or the folder that was written");
    member("field_bytes", field_bytes, "length of the field in it");
    member({"level", "finest_level"}, level, "its finest level");
  }
};

/// Writes the field at `input` with the page that shows it, and with views: one HTML file, which
/// opens from disk, if `output` ends in .html or .htm, or else a folder for any host of static
/// files that serves ranges. The field loses its light, unless it has several states, which would
/// be encoded again; and is repacked as `options` request, with the best quality that fits. In a
/// folder, it gets an index (doc/format/optional.md, "Index"). After an error, an HTML file is
/// unchanged, and so is the field in a folder. usage: `existing` is keep, and the HTML file exists
/// or the folder has files in it (Error::choice is then "replace" or "replace in"); a file to write
/// is `input`; `options` name a state or structure that is not there; nothing fits. io: a file
/// cannot be read or written. bad_file: `input` is no field, or `views` are none. unsupported: the
/// field is larger than kMaxEmbeddedBytes, for one file; or slf was built without the page.
/// cancelled: stopped by `tiles`, which counts those that are encoded, or by `bytes`, which counts
/// those of the field.
[[nodiscard]] Result<ExportReport> export_field(const std::string& input, const std::string& output,
                                                const ExportOptions& options,
                                                const ProgressCallback& tiles = {},
                                                const ProgressCallback& bytes = {});

}  // namespace slf::page
