// The index of a complete field, for readers of remote files (doc/format/optional.md, "Index").
#pragma once

#include <string>

#include "base/go_on.h"
#include "slf/error.h"

namespace slf {

/// Writes the index of a complete, closed field after its last page, and replaces whatever follows
/// that page. The same pages give the same index. Errors as FieldFile::open(), or io.
/// cancelled: stopped by `go_on`; the field has no index then.
[[nodiscard]] Result<void> index_field(const std::string& path, const GoOn& go_on = {});

}  // namespace slf
