// A file that keeps estimated depths for the next run. Internal.
//
// It begins with kDepthCacheMagic and a key of what the depths were made from. A zstd frame of the
// depths of all views follows, and an XXH3 of all before.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slf/shape.h"
#include "source/pictures/views.h"

namespace slf {

inline constexpr const char* kDepthCacheMagic = "SLF picture depths ";

/// Of all that decides what estimate_depth() finds. A hull follows from the views and the number of
/// its voxels; 0: there is none.
[[nodiscard]] std::string depth_key(const std::vector<SmallView>& views, const Sphere& sphere,
                                    std::uint32_t hull_voxels);

/// Fills `depth` and `confirmed` of all views; false, and nothing is changed, if there is no such
/// file, it is damaged, or its key is another. Input is untrusted.
[[nodiscard]] bool read_depth_cache(const std::string& path, const std::string& key,
                                    std::vector<SmallView>& views);

/// usage: there is a file that slf did not write. io: cannot be written.
[[nodiscard]] Result<void> write_depth_cache(const std::string& path, const std::string& key,
                                             const std::vector<SmallView>& views);

}  // namespace slf
