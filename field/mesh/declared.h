// What mesh files declare, checked before Assimp believes it. Private to field/mesh.
#pragma once

#include <string>

#include "slf/error.h"

namespace slf {

/// Checks the header of a PLY or STL file against the file's size, and of a glTF file that its
/// nodes form trees, its accessors lie in their buffers, and that it requires no unknown extension;
/// an attack could otherwise make Assimp use any amount of memory. Accepts other files.
/// bad_file: the file is truncated or contradicts itself. unsupported: an extension. io:
/// unreadable.
[[nodiscard]] Result<void> check_declared(const std::string& path);

}  // namespace slf
