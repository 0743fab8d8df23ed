// What the pages of a TIFF stack are, as OME, ImageJ and tifffile describe it in the first page.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "slf/error.h"

namespace slf::volume_io {

/// A page of a file. Pages are counted from 0, thumbnails left out.
struct TiffPlace {
  std::string path;
  std::uint64_t page = 0;
  auto operator<=>(const TiffPlace&) const = default;
};

/// Counts of slices, channels and times, their order, and the spacing. Pictures are numbered in
/// this order.
struct TiffDescription {
  std::uint64_t z = 0, channels = 1, times = 1;
  std::string order = "ZCT";  ///< the fastest first
  glm::dvec3 spacing{0.0};    ///< 0: unknown
  bool has_unit = true;       ///< of the spacing: micrometres; else in a unit that is not stated
  double slope = 1, intercept = 0;  ///< of values, as ImageJ calibrates them
  std::string origin{};  ///< "OME", "ImageJ" or "tifffile"; empty: there is no description

  /// Pictures with consecutive numbers on consecutive pages.
  struct Run {
    std::string file;  ///< in the folder of the file with the description; empty: that file
    std::uint64_t page = 0, count = 0;
  };
  std::map<std::uint64_t, Run> runs{};  ///< by their first number, where OME states their places

  /// Whether it names the files that its pictures are in.
  [[nodiscard]] bool names_files() const;
  bool of_several = false;  ///< the file holds other images, too: only `runs` say where this one is
  /// Whether OME gives each of as many pictures as there are pages another page of a single file.
  [[nodiscard]] bool places_pages(std::uint64_t pages) const;
  /// The place of a picture according to OME. `path`: the described file. bad_file: none is stated.
  [[nodiscard]] Result<TiffPlace> place_of(std::uint64_t picture, const std::string& path) const;
};

/// The number of the picture of slice z, channel c and time t.
[[nodiscard]] std::uint64_t page_of(const TiffDescription& d, std::uint64_t z, std::uint64_t c,
                                    std::uint64_t t);

[[nodiscard]] bool looks_like_ome(std::string_view text);
/// `components`: of a pixel in the file at `path`. `image`: which of several images, by its name,
/// ID or number. bad_file: not OME's metadata, or absurd. unsupported: several images, none chosen.
/// usage: no such image.
[[nodiscard]] Result<TiffDescription> parse_ome(std::string_view text, const std::string& path,
                                                std::uint32_t components,
                                                const std::optional<std::string>& image);

/// The names of the files that OME metadata, those of the file at `path`, say their pictures are
/// in.
[[nodiscard]] Result<std::set<std::string>> files_of_ome(std::string_view text,
                                                         const std::string& path);

/// The resolution that the tags of a page state: pixels per unit along x and y.
struct TiffResolution {
  std::array<float, 2> pixels{};
  int unit = 1;  ///< RESUNIT_NONE, or _INCH 2, _CENTIMETER 3
};

[[nodiscard]] bool looks_like_imagej(std::string_view text);
[[nodiscard]] TiffDescription parse_imagej(std::string_view text, const TiffResolution& resolution);

/// Whether it is the JSON that Python's tifffile writes: the shape of an array.
[[nodiscard]] bool looks_like_shape(std::string_view text);
/// Axes before the last two, and components, are slices, times before them, or what it names them.
/// Empty: other JSON, or a single stack.
[[nodiscard]] TiffDescription parse_shape(std::string_view text, std::uint32_t components);

}  // namespace slf::volume_io
