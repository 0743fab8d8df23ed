#include "source/volume/zip.h"

#include <minizip/unzip.h>

#include <algorithm>
#include <array>
#include <memory>

#include "base/try.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

using namespace std::string_view_literals;

constexpr std::size_t kMaxMembers = 1024;

tl::unexpected<Error> damaged(const std::string& path, std::string_view what) {
  return bad_file(path, "a ZIP file whose ", what, ": it is truncated or damaged, copy it again");
}

}  // namespace

std::string_view first_zip_member(std::string_view head) {
  if (!head.starts_with("PK\3\4"sv) || head.size() < 30) return {};
  return head.substr(30, Fields{head, false}.get<std::uint16_t>(26));
}

Result<std::vector<ZipMember>> read_zip_members(const std::string& path) {
  // minizip does not notice that the record at the end is cut.
  constexpr std::uint64_t kRecord = 22, kMaxTail = kRecord + 0xffff;
  const std::uint64_t size = SLF_TRY(file_size(path));
  auto reader = SLF_TRY(ByteReader::open(path, size - std::min(size, kMaxTail), false));
  const auto tail = SLF_TRY(reader.read_text(kMaxTail));
  const bool ends = tail.size() - std::min(tail.rfind("PK\5\6"sv), tail.size()) >= kRecord;
  const std::unique_ptr<void, decltype(&unzClose)> zip(unzOpen64(path.c_str()), &unzClose);
  if (!zip || !ends) return damaged(path, "directory cannot be found");
  std::vector<ZipMember> members;
  int at = unzGoToFirstFile(zip.get());
  for (; at == UNZ_OK; at = unzGoToNextFile(zip.get())) {
    std::array<char, 1024> name{};
    unz_file_info64 info{};
    if (unzGetCurrentFileInfo64(zip.get(), &info, name.data(), name.size() - 1, nullptr, 0, nullptr,
                                0) != UNZ_OK)
      return damaged(path, "directory ends early");
    ZipMember member{.name = name.data(), .packed = info.compression_method == Z_DEFLATED};
    if ((info.flag & 1) != 0 || (info.compression_method != 0 && !member.packed))
      return unsupported(path, "its member ", in_quotes(member.name),
                         " is encrypted, or packed by another method than deflate: unpack it, and "
                         "give the file in it");
    // Not to read it, but to find its data.
    if (unzOpenCurrentFile2(zip.get(), nullptr, nullptr, /*raw=*/1) != UNZ_OK)
      return damaged(path, "member " + in_quotes(member.name) + " is not where it should be");
    member.offset = unzGetCurrentFileZStreamPos64(zip.get());
    unzCloseCurrentFile(zip.get());
    if (members.size() == kMaxMembers)
      return unsupported(path, "more than ", kMaxMembers,
                         " members: unpack it, and give the file in it");
    members.push_back(std::move(member));
  }
  if (at != UNZ_END_OF_LIST_OF_FILE) return damaged(path, "directory holds something else");
  return members;
}

}  // namespace slf::volume_io
