// The members of a ZIP file, as NumPy and others use it: stored or deflated, also larger than 4
// GiB.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"

namespace slf::volume_io {

struct ZipMember {
  std::string name;
  std::uint64_t offset = 0;  ///< of its data
  bool packed = false;       ///< deflate, without a header
};

/// The name of the first member, by the first bytes of the file; empty if it is no ZIP.
[[nodiscard]] std::string_view first_zip_member(std::string_view head);

/// bad_file: damaged or truncated. unsupported: encrypted, or packed in another way.
[[nodiscard]] Result<std::vector<ZipMember>> read_zip_members(const std::string& path);

}  // namespace slf::volume_io
