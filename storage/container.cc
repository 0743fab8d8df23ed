#include "storage/internal/container.h"

#include <algorithm>

#include "storage/internal/record.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint32_t kMagic = 0x434C53;  // "SLC", below the version
constexpr std::uint8_t kVersion = 1;
constexpr std::size_t kHeader = 16;
constexpr std::size_t kLayerHeader = 18;

ByteSpan bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

tl::unexpected<Error> damaged(const char* what) {
  return tl::unexpected(Error{ErrorCode::bad_file, what});
}

}  // namespace

Bytes encode_container(std::uint64_t transaction, std::span<const LayerInfo> layers) {
  Bytes blob;
  append_le<std::uint32_t>(blob, kMagic | std::uint32_t{kVersion} << 24);
  append_le<std::uint32_t>(blob, static_cast<std::uint32_t>(layers.size()));
  append_le<std::uint64_t>(blob, transaction);
  for (const LayerInfo& layer : layers) {
    append_le<std::uint64_t>(blob, layer.records);
    append_le<std::uint64_t>(blob, layer.last ? layer.last->index : 0);
    append_le<std::uint8_t>(blob, layer.last ? layer.last->level : kNoLevel);
    append_le<std::uint8_t>(blob, static_cast<std::uint8_t>(layer.name.size()));
    const ByteSpan name = bytes_of(layer.name);
    blob.insert(blob.end(), name.begin(), name.end());
  }
  return blob;
}

Result<Container> decode_container(ByteSpan blob) {
  if (blob.size() < kHeader) return damaged("too short");
  const auto magic = load_le<std::uint32_t>(blob.data());
  if ((magic & 0xFFFFFF) != kMagic)
    return damaged("the list of its layers is damaged, or from another program");
  if (magic >> 24 != kVersion)
    return fail(ErrorCode::unsupported, "container version ", magic >> 24, ", expected ",
                int{kVersion});
  const auto count = load_le<std::uint32_t>(blob.data() + 4);
  if (count == 0 || count > kMaxLayers) return damaged("the number of layers is damaged");
  Container container;
  container.transaction = load_le<std::uint64_t>(blob.data() + 8);
  std::size_t at = kHeader;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (blob.size() - at < kLayerHeader) return damaged("the list of layers is cut short");
    LayerInfo layer;
    layer.records = load_le<std::uint64_t>(blob.data() + at);
    const auto index = load_le<std::uint64_t>(blob.data() + at + 8);
    const auto level = static_cast<std::uint8_t>(blob[at + 16]);
    const auto name = static_cast<std::size_t>(blob[at + 17]);
    at += kLayerHeader;
    if (blob.size() - at < name) return damaged("the list of layers is cut short");
    if ((level == kNoLevel) != (layer.records == 0)) return damaged("a layer's end is damaged");
    if (level != kNoLevel) layer.last = TileKey{level, index};
    layer.name.assign(reinterpret_cast<const char*>(blob.data() + at), name);
    at += name;
    container.layers.push_back(std::move(layer));
  }
  if (at != blob.size()) return damaged("bytes after the list of layers");
  return container;
}

Result<void> check_layer_names(std::span<const std::string> names) {
  if (names.empty() || names.size() > kMaxLayers)
    return fail(ErrorCode::usage, names.size(), " layers, expected 1 to ", kMaxLayers);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string& name = names[i];
    if (name.empty() || name.size() > kMaxLayerName || name.find('\0') != std::string::npos)
      return fail(ErrorCode::usage, "layer name '", name, "': expected 1 to ", kMaxLayerName,
                  " characters");
    if (name == kManifest || std::find(names.begin(), names.begin() + static_cast<long>(i), name) !=
                                 names.begin() + static_cast<long>(i))
      return fail(ErrorCode::usage, "layer name '", name, "' is taken");
  }
  return {};
}

Bytes seal_blob(std::string_view name, ByteSpan bytes) {
  Bytes sealed;
  sealed.reserve(8 + bytes.size());
  append_le<std::uint64_t>(sealed, checksum(bytes, checksum(bytes_of(name))));
  sealed.insert(sealed.end(), bytes.begin(), bytes.end());
  return sealed;
}

Result<ByteSpan> open_blob(std::string_view name, ByteSpan sealed) {
  if (sealed.size() < 8) return damaged("too short");
  const ByteSpan bytes = sealed.subspan(8);
  if (checksum(bytes, checksum(bytes_of(name))) != load_le<std::uint64_t>(sealed.data()))
    return damaged("does not match its checksum");
  return bytes;
}

}  // namespace slf::storage::internal
