// Volumes as stacks of pictures: TIFF pages, or the pictures of a folder.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "field/volume/io.h"

namespace slf::volume_io {

/// The properties that all slices of a volume share.
struct SliceKind {
  std::uint32_t width = 0, height = 0;
  std::uint32_t components = 1;
  ScalarType type = ScalarType::u8;
  bool operator==(const SliceKind&) const = default;
};

/// "512x512 u8, 3 components".
[[nodiscard]] std::string describe(const SliceKind& kind);

/// Appends one component of each voxel to a volume.
class ComponentSelector {
 public:
  /// Chooses the component: that of the options, or the first of grey with alpha and of colours
  /// whose channels are equal. Errors as choose().
  [[nodiscard]] static Result<ComponentSelector> make(const std::string& source,
                                                      const SliceKind& kind,
                                                      const VolumeOptions& options);
  [[nodiscard]] std::uint32_t component() const { return component_; }
  /// `samples`: whole voxels, components side by side, native byte order.
  /// unsupported: colours that differ, and none was chosen.
  [[nodiscard]] Result<void> append(std::span<const std::byte> samples,
                                    std::vector<std::byte>& voxels) const;

 private:
  std::string source_;
  std::uint32_t components_ = 1, component_ = 0;
  std::size_t width_ = 1;
  bool require_grey_ = false;
};

/// Appends a PNG to `voxels`. The first one sets `kind`, which all others must have.
[[nodiscard]] Result<void> append_png(const std::string& path, const VolumeOptions& options,
                                      std::optional<SliceKind>& kind,
                                      std::vector<std::byte>& voxels);

/// Appends all pages of a TIFF file in the same way. Returns their number.
[[nodiscard]] Result<std::uint32_t> append_tiff(const std::string& path,
                                                const VolumeOptions& options,
                                                std::optional<SliceKind>& kind,
                                                std::vector<std::byte>& voxels);

}  // namespace slf::volume_io
