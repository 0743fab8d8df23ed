// What the pages of a TIFF stack are, as OME and ImageJ describe it in the first page.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <string>
#include <string_view>

#include "slf/error.h"

namespace slf::volume_io {

/// A page of a file. Pages are counted from 0, thumbnails left out.
struct TiffPlace {
  std::string path;
  std::uint64_t page = 0;
};

/// Counts of slices, channels and times, their order, and the spacing. Pictures are numbered in
/// this order.
struct TiffDescription {
  std::uint64_t z = 0, channels = 1, times = 1;
  std::string order = "ZCT";  ///< the fastest first
  glm::dvec3 spacing{0.0};    ///< micrometres, or pixels where micrometres are unknown; 0: unknown
  std::string origin{};       ///< "OME" or "ImageJ"

  /// Pictures with consecutive numbers on consecutive pages.
  struct Run {
    std::string file;  ///< in the folder of the file with the description; empty: that file
    std::uint64_t page = 0, count = 0;
  };
  std::map<std::uint64_t, Run> runs{};  ///< by their first number, where OME states their places

  /// Whether it names the files that its pictures are in.
  [[nodiscard]] bool names_files() const;
  /// The place of a picture according to OME. `path`: the described file. bad_file: none is stated.
  [[nodiscard]] Result<TiffPlace> place_of(std::uint64_t picture, const std::string& path) const;
};

/// The number of the picture of slice z, channel c and time t.
[[nodiscard]] std::uint64_t page_of(const TiffDescription& d, std::uint64_t z, std::uint64_t c,
                                    std::uint64_t t);

[[nodiscard]] bool looks_like_ome(std::string_view text);
/// `components`: of a pixel in the file at `path`. bad_file: not OME's metadata, or absurd.
[[nodiscard]] Result<TiffDescription> parse_ome(std::string_view text, const std::string& path,
                                                std::uint32_t components);

[[nodiscard]] bool looks_like_imagej(std::string_view text);
/// `resolution`: pixels per unit along x and y, from the tags of the file.
[[nodiscard]] TiffDescription parse_imagej(std::string_view text, std::array<float, 2> resolution);

}  // namespace slf::volume_io
