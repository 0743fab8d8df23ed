// What must be found of pictures before rays can be traced: sphere, depths and surface. Internal.
#pragma once

#include <optional>
#include <string>

#include "slf/pictures.h"
#include "source/pictures/loading.h"
#include "source/pictures/surface.h"

namespace slf {

struct Prepared {
  PictureSet set;  ///< without those that are held out
  Loaded loaded;   ///< a view for each picture; their depths may be empty
  Sphere sphere;
  Surface surface;
  std::optional<Surface> hull;  ///< the silhouettes', if depths were estimated within it
  std::string depth;            ///< as DepthSheet::source
};

/// Errors as make_picture_scene().
[[nodiscard]] Result<Prepared> prepare_pictures(PictureSet set, const PictureSceneOptions& options);

}  // namespace slf
