// Reading files of cameras. Internal.
#pragma once

#include <string>
#include <string_view>

#include "base/bytes.h"
#include "slf/pictures.h"

namespace slf::cameras {

inline constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 31;
inline constexpr std::size_t kMaxPictures = 100000;

/// Parses transforms.json (untrusted). Paths of pictures are relative to `folder`; sizes and
/// extensions that are not stated are those of the files. Errors as read_pictures().
[[nodiscard]] Result<PictureSet> parse_transforms(std::string_view json, const std::string& name,
                                                  const std::string& folder);

/// Parses the table of a Cinema database of specification D (untrusted). Paths of pictures are
/// relative to `folder`; their sizes are read. Errors as read_pictures().
[[nodiscard]] Result<PictureSet> parse_cinema(std::string_view csv, const std::string& name,
                                              const std::string& folder);

/// The bytes of COLMAP's three files, all binary or all text, untrusted.
struct ColmapModel {
  std::string folder;  ///< in messages
  bool text = false;
  Bytes cameras, images, points;
};
/// Lenses and places only: files and sizes of pictures are not looked at. `image_folder` becomes
/// the folder of Picture::file.
[[nodiscard]] Result<PictureSet> parse_colmap(const ColmapModel& model,
                                              const std::string& image_folder);
/// Whether a folder has a model, and as text.
enum class ColmapForm { none, binary, text };
[[nodiscard]] ColmapForm colmap_form(const std::string& folder);
[[nodiscard]] Result<ColmapModel> read_colmap(const std::string& folder);

/// Compares the sizes of pictures with those of their cameras: a picture of the same shape but
/// another size scales the camera, with a note. bad_file: other shapes; transposed ones are named.
/// io: a picture is missing.
[[nodiscard]] Result<void> check_sizes(PictureSet& set);

}  // namespace slf::cameras
