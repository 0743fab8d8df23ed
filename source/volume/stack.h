// Volumes as stacks of pictures: TIFF pages, or the pictures of a folder.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "source/volume/io.h"

namespace slf::volume_io {

/// The properties that all slices of a volume share.
struct SliceKind {
  std::uint32_t width = 0, height = 0;
  std::uint32_t components = 1;
  ScalarType type = ScalarType::u8;
  bool alpha = false;               ///< the last component is opacity
  double slope = 1, intercept = 0;  ///< of values
  bool operator==(const SliceKind&) const = default;
};

/// "512x512 u8, 3 components".
[[nodiscard]] std::string describe(const SliceKind& kind);

/// The first slice sets `kind`. unsupported: `here`, that of a later one, is another.
[[nodiscard]] Result<void> same_kind(const std::string& source, const SliceKind& here,
                                     std::optional<SliceKind>& kind);

/// Appends one component of each voxel to a volume.
class ComponentSelector {
 public:
  /// Chooses the component: that of the options, or the first of up to four that are equal, opacity
  /// left out. Errors as choose().
  [[nodiscard]] static Result<ComponentSelector> make(const std::string& source,
                                                      const SliceKind& kind,
                                                      const VolumeOptions& options);
  [[nodiscard]] std::uint32_t component() const { return component_; }
  /// The number of components, from the first on, that must be equal.
  [[nodiscard]] std::uint32_t equal() const { return equal_; }
  /// unsupported: components differ, and none was chosen.
  [[nodiscard]] Result<void> differ() const;
  /// `samples`: whole voxels, components side by side, native byte order.
  /// Errors as differ().
  [[nodiscard]] Result<void> append(std::span<const std::byte> samples,
                                    std::vector<std::byte>& voxels) const;

 private:
  std::string source_;
  std::uint32_t components_ = 1, component_ = 0, equal_ = 1;
  std::size_t width_ = 1;
};

/// Appends the slices of a file to `voxels` and returns their number: one, but for TIFF, of one
/// channel and one time point where its metadata state several. The first slice sets `kind`, which
/// all others must have.
using SliceReader = Result<std::uint64_t>(const std::string& path, const VolumeOptions& options,
                                          std::optional<SliceKind>& kind,
                                          std::vector<std::byte>& voxels);
[[nodiscard]] SliceReader append_png, append_jpeg, append_tiff;

/// Reads all samples of a PNG, of a palette the indices. bad_file: damaged.
[[nodiscard]] Result<SliceKind> read_png_as_stored(const std::string& path,
                                                   std::vector<std::byte>& samples);

/// The names of the files, all in one folder, that a TIFF file's OME metadata say its pictures are
/// in. Often it is that file only; empty if there are no such metadata.
[[nodiscard]] Result<std::set<std::string>> files_of_tiff_set(const std::string& path);

/// Whether so few files are strays beside so many, and may be left out: a thumbnail, a scout.
[[nodiscard]] constexpr bool are_strays(std::size_t few, std::size_t all) { return 4 * few <= all; }

}  // namespace slf::volume_io
