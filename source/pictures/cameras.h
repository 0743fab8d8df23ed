// Reading files of cameras. Internal.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/file_finder.h"
#include "image/formats.h"
#include "slf/pictures.h"

namespace slf::cameras {

inline constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 31;
inline constexpr std::size_t kMaxPictures = 100000;

/// Finds the pictures that a file of cameras names, masks and depths too.
class PictureFinder {
 public:
  /// `folder`: names are relative to it.
  explicit PictureFinder(const std::string& folder);
  /// As FileFinder; if there is none, the path as stated.
  [[nodiscard]] std::string find(const std::string& stated);
  /// Says how many are elsewhere than stated.
  void add_notes(std::vector<std::string>& notes) const;

 private:
  std::string folder_;
  FileFinder finder_;
};

/// The pictures of a set that cannot be used: other readers leave them out, too.
class LeftOut {
 public:
  /// Counts a picture that is missing, damaged or of an unknown kind. Other errors, as of a disk,
  /// come back.
  [[nodiscard]] Result<void> add(Error why);
  /// Appends notes that count them. The first error, if fewer than two pictures remain.
  [[nodiscard]] Result<void> settle(std::size_t remaining, std::vector<std::string>& notes) const;

 private:
  struct Reason {
    std::size_t count = 0;
    std::string first;
  };
  std::optional<Error> first_;
  std::map<ErrorCode, Reason> reasons_;
};

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

/// The size of a picture. not_found: there is no regular file; the message names `source` and the
/// camera. Other errors as image_formats::read_image_size().
[[nodiscard]] Result<image_formats::ImageSize> size_of(const std::string& source,
                                                       const Picture& picture);

/// A lens without distortion whose height has this angle of view, in degrees.
[[nodiscard]] Lens pinhole_lens(std::uint32_t width, std::uint32_t height, double angle);

/// Compares the sizes of pictures with those of their cameras: a picture of the same shape but
/// another size scales the camera, with a note. Pictures that are missing, damaged or of another
/// shape are left out, with a note; the first of these errors, if fewer than two remain.
[[nodiscard]] Result<void> check_sizes(PictureSet& set);

}  // namespace slf::cameras
