// The index of a complete field, for readers of remote files (FORMAT.md, "Index").
#pragma once

#include <string>

#include "slf/error.h"

namespace slf {

/// Writes the index of a field that is complete and closed behind its last page, in place of what
/// follows there. The same pages give the same index. Errors as FieldFile::open(), or io.
[[nodiscard]] Result<void> index_field(const std::string& path);

}  // namespace slf
