// Reading a mesh in a child process, because a hostile file can make Assimp abort. Private to
// field/mesh.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "slf/mesh.h"

namespace slf {

/// Calls `read` in a child process, which may use `bytes` of memory and `seconds` of processor
/// time, and returns its result, checked: counts, indices, finite coordinates. bad_file: the child
/// crashed, took too long, or sent something else. failed: no child can be started, or it was
/// killed. Else errors of `read`, whose exceptions become errors.
[[nodiscard]] Result<Mesh> read_isolated(const std::string& path, std::uint64_t bytes,
                                         std::uint64_t seconds,
                                         const std::function<Result<Mesh>()>& read);

/// As read_mesh(), with another limit of processor time than a minute, and a second for each MiB.
[[nodiscard]] Result<Mesh> read_mesh_within(const std::string& path, UpAxis up,
                                            std::uint64_t seconds);

}  // namespace slf
