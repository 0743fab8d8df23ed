// Views: saved views and notes that the page shows with a field, from a file such as
//
//   {"views": [{"title": "From the left", "text": "See https://example.org", "orbit": [90, 0, 3],
//               "target": [0, 16, 8], "structures": ["stem:0.3"],
//               "clip": [[0, 0, 40, 0, 0, 1]], "cap": "slice:-100,300"}],
//    "notes": [{"label": "Frontal lobe", "text": "…", "point": [1.5, -60, 20]}],
//    "about": {"title": "A brain", "author": "A. Author", "licence": "CC BY 4.0"}}
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/shape.h"

namespace slf::page {

struct ViewsFile {
  std::string name;  ///< for messages
  std::string text;  ///< empty: no views
};

/// io: the file cannot be read.
[[nodiscard]] Result<ViewsFile> read_views(const std::string& path);

/// What a page says of itself, as plain text; empty: nothing.
struct About {
  std::string title{}, description{}, author{}, licence{};
  std::string source{};  ///< an address, https://…
};

/// Views that were checked.
struct Views {
  std::string json{};            ///< without '<'; empty if there are none
  std::vector<double> camera{};  ///< of the first view, as the page's address has it; may be empty
  std::optional<std::vector<std::string>> structures{};  ///< that the first view shows
  std::string state{};  ///< of the object, that is shown first; empty: state 0
  bool cut = false;     ///< whether planes cut the first view
  About about{};
  std::string attributes{};  ///< of the page's element for the first view, each after a space
};

/// Whether a link may lead there: only to pages.
[[nodiscard]] bool is_address(std::string_view text);

/// Checks a file of views and notes (schemas/views.json) for a field with this sphere. bad_file: it
/// is something else; the message names the place, such as views[1].orbit, and what is expected
/// there.
[[nodiscard]] Result<Views> parse_views(const ViewsFile& file, const Sphere& sphere);

/// The camera of a view as the page's address has it: azimuth, elevation, distance and target, of
/// which the last two are in radii.
[[nodiscard]] Camera page_camera(const Sphere& sphere, const std::array<double, 6>& view,
                                 std::uint32_t width, std::uint32_t height);

/// What the page of a field shows first, in place of what its views say.
struct First {
  std::string state{};                    ///< of the object, by its name or number; empty: state 0
  std::vector<std::string> structures{};  ///< that are shown; none: as the views say, or all
};
/// Adds what is shown first to views. usage: the field has no such state or structure, or not those
/// that the views show.
[[nodiscard]] Result<void> begin_with(const First& first, const Field& field, Views& views);

}  // namespace slf::page
