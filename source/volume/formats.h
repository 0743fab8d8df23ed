// The formats of volumes: those that are read, in one table; and for others, their names and how
// to convert them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "source/volume/io.h"

namespace slf::volume_io {

/// A format that is read.
struct VolumeFormat {
  struct Start {
    std::string_view ending;  ///< of names, such as ".nii"
    std::string_view start;   ///< what files of such names begin with; no voxels without a header
  };
  std::string_view names;  ///< in lists of formats; empty: named in another way
  Recogniser* looks_like;
  FormatReader* read;
  std::vector<Start> starts{};
  bool unpacks_itself = false;        ///< as it reads; for others, packed files are unpacked before
  bool names_arrays = false;          ///< its files hold arrays or images with names
  Recogniser* names_files = nullptr;  ///< whether this header names files, which are beside it
};

/// In the order in which they are recognised: those of the surest signs first.
[[nodiscard]] const std::vector<VolumeFormat>& volume_formats();

/// The format of a file that begins with `head`, unpacked; null: none that is read.
[[nodiscard]] const VolumeFormat* format_of(std::string_view head);

/// Why a file that no reader recognises is no volume. `head`: its first bytes, unpacked.
/// unsupported: a known format; the message names it, and a way to convert it.
/// bad_file: not what its name says. usage: perhaps headerless voxels.
[[nodiscard]] tl::unexpected<Error> refuse_file(const std::string& path, std::string_view head);

/// unsupported: a known format that is not read. Those of cameras and meshes are none, since
/// pictures and meshes are read from them. `head`: the file's first bytes.
[[nodiscard]] Result<void> refuse_known(const std::string& path, std::string_view head);

/// Why a folder without DICOM files and pictures is no volume: what it is (Zarr), or what is in it.
[[nodiscard]] tl::unexpected<Error> refuse_folder(const std::string& path);

/// usage: a series was chosen, of what is not DICOM.
[[nodiscard]] Result<void> refuse_series(const std::string& path, const VolumeOptions& options);

}  // namespace slf::volume_io
