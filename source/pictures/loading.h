// Reads the pictures of a set, and what they say of the object: silhouettes and depths. Internal.
#pragma once

#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "slf/image.h"
#include "slf/pictures.h"
#include "source/pictures/views.h"

namespace slf {

/// The largest file of a picture.
inline constexpr std::uint64_t kMaxPictureBytes = std::uint64_t{1} << 31;

/// What all pictures of a set show, once each was decoded.
struct Loaded {
  std::vector<SmallView> views;
  std::vector<std::uint64_t> hashes;  ///< of the files of colours, masks and depths
  bool masks = false;                 ///< some pixels are transparent
  bool depths = false;                ///< at least half of the pictures have depth
  DepthKind kind = DepthKind::unknown;
  double disagreement = 0;  ///< relative, of depths in pairs of pictures
};

/// Decodes a picture, with its mask, and depths as they are in the file. bad_file: it is damaged,
/// or mask, depths and camera are of other sizes.
[[nodiscard]] Result<Image> decode_picture(const Picture& picture, ByteSpan bytes);

/// A sphere that holds the object, before anything of it is known but the cameras. usage: they do
/// not show where it is.
[[nodiscard]] Result<Sphere> first_sphere(const PictureSet& set);

/// Decodes all pictures, and takes those that are damaged out of the set, with a note. `sphere`
/// says how fine views must be. Errors of decode_picture(), if fewer than two pictures remain;
/// cancelled: stopped by the options' progress.
[[nodiscard]] Result<Loaded> load_views(const Sphere& sphere, const PictureSceneOptions& options,
                                        PictureSet& set);

/// Finds the kind of depths, and converts them to depths along z in world units. usage: depths of
/// neighbouring pictures disagree.
[[nodiscard]] Result<void> settle_depths(const PictureSet& set, const PictureSceneOptions& options,
                                         Loaded& loaded);

}  // namespace slf
