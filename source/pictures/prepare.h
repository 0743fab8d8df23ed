// Reads the pictures of a set, and finds what must be known of them before rays can be traced:
// sphere, depths and surface. Internal.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "slf/image.h"
#include "slf/pictures.h"
#include "source/pictures/distance_field.h"
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

struct Prepared {
  PictureSet set;  ///< without those that are held out
  Loaded loaded;   ///< a view for each picture; their depths may be empty
  Sphere sphere;
  DistanceField surface;
  std::optional<DistanceField> hull;  ///< the silhouettes', if depths were estimated within it
  std::string depth;                  ///< as DepthSheet::source
};

/// Errors as make_picture_scene().
[[nodiscard]] Result<Prepared> prepare_pictures(PictureSet set, const PictureSceneOptions& options);

}  // namespace slf
