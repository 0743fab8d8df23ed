// Names the format of a file or folder that no reader here reads, and how to convert it.
#pragma once

#include <string>
#include <string_view>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

/// Why a file that no reader recognises is no volume. `head`: its first bytes, unpacked.
/// unsupported: a known format; the message names it, and a way to convert it.
/// bad_file: not what its name says. usage: perhaps headerless voxels.
[[nodiscard]] Error refuse_file(const std::string& path, std::string_view head);

/// Why a folder without DICOM files and pictures is no volume: what it is (Zarr), or what is in it.
[[nodiscard]] Error refuse_folder(const std::string& path);

/// usage: a series was chosen, of what is not DICOM.
[[nodiscard]] Result<void> refuse_series(const std::string& path, const VolumeOptions& options);

}  // namespace slf::volume_io
