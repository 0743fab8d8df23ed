// The container's own blob: the list of layers, and the last tile of each.
//
// Every commit rewrites it. So a reader knows the last tile of every layer, and detects a lost
// branch of a tree or a root page of an older commit. For the bytes see FORMAT.md, "Container
// blob".
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

inline constexpr std::string_view kManifest = "manifest";    ///< name of the tree of blobs
inline constexpr std::string_view kContainer = "container";  ///< name of the container's own blob
inline constexpr std::size_t kMaxLayers = 64;
inline constexpr std::size_t kMaxLayerName = 64;
inline constexpr std::size_t kMaxBlobName = 255;

/// One layer as of the last commit.
struct LayerInfo {
  std::string name;
  std::uint64_t records = 0;
  std::optional<TileKey> last;
};

struct Container {
  std::uint64_t transaction = 0;  ///< the one that wrote the blob; equals the meta page's
  std::vector<LayerInfo> layers;
};

/// REQUIRES: layers that check_layer_names() accepts.
[[nodiscard]] Bytes encode_container(std::uint64_t transaction, std::span<const LayerInfo> layers);

/// bad_file: not a container blob. unsupported: of another version.
[[nodiscard]] Result<Container> decode_container(ByteSpan blob);

/// usage: no names or too many; a name is empty, too long, repeated, or reserved.
[[nodiscard]] Result<void> check_layer_names(std::span<const std::string> names);

/// A blob as stored: XXH3-64 of its bytes, seeded with the XXH3-64 of its name, then its bytes.
[[nodiscard]] Bytes seal_blob(std::string_view name, ByteSpan bytes);

/// The bytes of a sealed blob. bad_file: they do not match the checksum.
[[nodiscard]] Result<ByteSpan> open_blob(std::string_view name, ByteSpan sealed);

}  // namespace slf::storage::internal
