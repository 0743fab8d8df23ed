// The container's own blob: the number of records, and the last tile.
//
// Every commit rewrites it. So a reader knows the last tile, and detects a lost branch of the tree
// or a root page of an older commit. For the bytes see FORMAT.md, "Container blob".
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

inline constexpr std::string_view kManifest = "manifest";    ///< name of the tree of blobs
inline constexpr std::string_view kTiles = "tiles";          ///< name of the tree of records
inline constexpr std::string_view kContainer = "container";  ///< name of the container's own blob
inline constexpr std::size_t kMaxBlobName = 255;

/// The records as of a commit.
struct Container {
  std::uint64_t transaction = 0;  ///< the one that wrote the blob; equals the meta page's
  std::uint64_t records = 0;
  std::optional<TileKey> last;
};

[[nodiscard]] Bytes encode_container(const Container& container);

/// bad_file: not a container blob. unsupported: of another version.
[[nodiscard]] Result<Container> decode_container(ByteSpan blob);

/// A blob as stored: XXH3-64 of its bytes, seeded with the XXH3-64 of its name, then its bytes.
[[nodiscard]] Bytes seal_blob(std::string_view name, ByteSpan bytes);

/// The bytes of a sealed blob. bad_file: they do not match the checksum.
[[nodiscard]] Result<ByteSpan> open_blob(std::string_view name, ByteSpan sealed);

}  // namespace slf::storage::internal
