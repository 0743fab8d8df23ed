// https://pkware.cachefly.net/webdocs/casestudies/APPNOTE.TXT, sections 4.3 and 4.5.3.
//
// Debian's libzip would do, but npz files need only the list of members, and their data are read by
// ByteReader, whose memory is bounded.
#include "field/volume/zip.h"

#include <algorithm>

#include "base/try.h"
#include "field/volume/fields.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

using namespace std::string_view_literals;

constexpr std::size_t kMaxMembers = 1024;
constexpr std::uint64_t kMaxDirectory = std::uint64_t{1} << 24;
constexpr std::size_t kEndBytes = 22, kMaxComment = 0xffff, kLocatorBytes = 20;

tl::unexpected<Error> damaged(const std::string& path, std::string_view what) {
  return bad_file(path, "a ZIP file whose ", what, ": it is truncated or damaged, copy it again");
}

Result<std::string> read_at(const std::string& path, std::uint64_t offset, std::size_t size) {
  auto reader = SLF_TRY(ByteReader::open(path, offset, false));
  return reader.read_text(size);
}

struct Directory {
  std::uint64_t offset = 0, bytes = 0;
};

/// Finds the directory by the record at the end of the file.
Result<Directory> find_directory(const std::string& path, std::uint64_t size) {
  const std::size_t tail_bytes =
      std::min<std::uint64_t>(size, kEndBytes + kMaxComment + kLocatorBytes);
  const auto tail = SLF_TRY(read_at(path, size - tail_bytes, tail_bytes));
  const auto end = tail.rfind("PK\5\6"sv);
  if (end == std::string::npos || tail.size() - end < kEndBytes)
    return damaged(path, "directory is not at its end");
  const Fields record{tail, false};
  Directory directory{record.get<std::uint32_t>(end + 16), record.get<std::uint32_t>(end + 12)};
  if (end >= kLocatorBytes && tail.substr(end - kLocatorBytes, 4) == "PK\6\7"sv) {
    const auto wide =
        SLF_TRY(read_at(path, record.get<std::uint64_t>(end - kLocatorBytes + 8), 56));
    if (wide.size() < 56 || !wide.starts_with("PK\6\6"sv))
      return damaged(path, "directory cannot be found");
    const Fields of_wide{wide, false};
    directory = {of_wide.get<std::uint64_t>(48), of_wide.get<std::uint64_t>(40)};
  }
  if (directory.bytes > size || directory.offset > size - directory.bytes ||
      directory.bytes > kMaxDirectory)
    return damaged(path, "directory is said to be beyond its end");
  return directory;
}

/// The offset of a member's local header, from the extra fields if it does not fit 32 bits.
std::uint64_t local_offset(const Fields& entry, std::size_t extra_at, std::size_t extra_bytes) {
  constexpr std::uint32_t kInExtra = 0xffffffff;
  const auto offset = entry.get<std::uint32_t>(42);
  if (offset != kInExtra) return offset;
  for (std::size_t at = extra_at; at + 4 <= extra_at + extra_bytes;) {
    const auto length = entry.get<std::uint16_t>(at + 2);
    // Sizes that do not fit stand before the offset.
    const std::size_t before = (entry.get<std::uint32_t>(24) == kInExtra ? 8 : 0) +
                               (entry.get<std::uint32_t>(20) == kInExtra ? 8 : 0);
    if (entry.get<std::uint16_t>(at) == 1 && length >= before + 8 &&
        at + 4 + length <= extra_at + extra_bytes)
      return entry.get<std::uint64_t>(at + 4 + before);
    at += 4 + std::size_t{length};
  }
  return offset;
}

}  // namespace

std::string_view first_zip_member(std::string_view head) {
  if (!head.starts_with("PK\3\4"sv) || head.size() < 30) return {};
  return head.substr(30, Fields{head, false}.get<std::uint16_t>(26));
}

Result<std::vector<ZipMember>> read_zip_members(const std::string& path) {
  const auto size = SLF_TRY(file_size(path));
  const auto directory = SLF_TRY(find_directory(path, size));
  const auto text = SLF_TRY(read_at(path, directory.offset, directory.bytes));
  std::vector<ZipMember> members;
  constexpr std::size_t kEntry = 46, kLocal = 30;
  for (std::size_t at = 0; at < text.size();) {
    const Fields entry{std::string_view(text).substr(at), false};
    if (entry.bytes.size() < kEntry || !entry.bytes.starts_with("PK\1\2"sv))
      return damaged(path, "directory holds something else");
    const std::size_t name_bytes = entry.get<std::uint16_t>(28);
    const std::size_t extra_bytes = entry.get<std::uint16_t>(30);
    const std::size_t bytes = kEntry + name_bytes + extra_bytes + entry.get<std::uint16_t>(32);
    if (bytes > entry.bytes.size()) return damaged(path, "directory ends early");
    ZipMember member{.name = std::string(entry.bytes.substr(kEntry, name_bytes))};
    const auto method = entry.get<std::uint16_t>(10);
    if ((entry.get<std::uint16_t>(8) & 1) != 0 || (method != 0 && method != 8))
      return unsupported(path, "its member ", in_quotes(member.name),
                         " is encrypted, or packed by another method than deflate: unpack it, and "
                         "give the file in it");
    member.packed = method == 8;
    const std::uint64_t local = local_offset(entry, kEntry + name_bytes, extra_bytes);
    const auto header = SLF_TRY(local < size ? read_at(path, local, kLocal) : std::string());
    if (header.size() < kLocal || !header.starts_with("PK\3\4"sv))
      return damaged(path, "member " + in_quotes(member.name) + " is not where it should be");
    const Fields fields{header, false};
    member.offset = local + kLocal + fields.get<std::uint16_t>(26) + fields.get<std::uint16_t>(28);
    if (members.size() == kMaxMembers)
      return unsupported(path, "more than ", kMaxMembers,
                         " members: unpack it, and give the file in it");
    members.push_back(std::move(member));
    at += bytes;
  }
  return members;
}

}  // namespace slf::volume_io
