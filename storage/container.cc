#include "storage/internal/container.h"

#include "storage/internal/record.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint32_t kMagic = 0x434C53;  // "SLC", below the version
constexpr std::uint8_t kVersion = 2;
constexpr std::size_t kBytes = 32;

}  // namespace

Bytes encode_container(const Container& container) {
  Bytes blob;
  append_le<std::uint32_t>(blob, kMagic | std::uint32_t{kVersion} << 24);
  append_le<std::uint32_t>(blob, container.last ? container.last->level : kNoLevel);
  append_le<std::uint64_t>(blob, container.transaction);
  append_le<std::uint64_t>(blob, container.records);
  append_le<std::uint64_t>(blob, container.last ? packed_index(*container.last) : 0);
  return blob;
}

Result<Container> decode_container(ByteSpan blob) {
  if (blob.size() < 4) return fail(ErrorCode::bad_file, "too short");
  const auto magic = load_le<std::uint32_t>(blob.data());
  if ((magic & 0xFFFFFF) != kMagic)
    return fail(ErrorCode::bad_file, "is damaged, or from another program");
  if (const std::uint32_t version = magic >> 24; version != kVersion)
    return fail(ErrorCode::unsupported, "version ", version, ", this program reads version ",
                int{kVersion},
                version > kVersion ? "; update slf" : "; slf 0.2 or older wrote it: build it anew");
  if (blob.size() != kBytes) return fail(ErrorCode::bad_file, "has the wrong size");
  Container container{load_le<std::uint64_t>(blob.data() + 8),
                      load_le<std::uint64_t>(blob.data() + 16), std::nullopt};
  const auto level = load_le<std::uint32_t>(blob.data() + 4);
  if (level > kNoLevel || (level == kNoLevel) != (container.records == 0))
    return fail(ErrorCode::bad_file, "the last tile is damaged");
  if (level != kNoLevel)
    container.last =
        unpacked_key(static_cast<std::uint8_t>(level), load_le<std::uint64_t>(blob.data() + 24));
  return container;
}

Bytes seal_blob(std::string_view name, ByteSpan bytes) {
  Bytes sealed;
  sealed.reserve(8 + bytes.size());
  append_le<std::uint64_t>(sealed, checksum(bytes, checksum(bytes_of(name))));
  sealed.insert(sealed.end(), bytes.begin(), bytes.end());
  return sealed;
}

Result<ByteSpan> open_blob(std::string_view name, ByteSpan sealed) {
  if (sealed.size() < 8) return fail(ErrorCode::bad_file, "too short");
  const ByteSpan bytes = sealed.subspan(8);
  if (checksum(bytes, checksum(bytes_of(name))) != load_le<std::uint64_t>(sealed.data()))
    return fail(ErrorCode::bad_file, "does not match its checksum");
  return bytes;
}

}  // namespace slf::storage::internal
