// Shared by the volume readers: bounded reading, checks of dims and axes, header text.
//
// Headers are untrusted. Memory for a stated size is allocated only if the file is long enough to
// hold it. Deflate expands at most 1032:1, so the same check works for packed voxels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

/// The location of a volume's voxels in a file.
struct VoxelData {
  std::string path;
  std::uint64_t offset = 0;  ///< first byte in the file, of the voxels or of their packed stream
  bool packed = false;       ///< gzip or zlib
  std::uint64_t skip = 0;    ///< bytes before the voxels, counted once unpacked
  bool big_endian = false;
  /// The number of components of a voxel, stored side by side, and the one to read.
  std::uint32_t components = 1, component = 0;
};

/// Reads a file from an offset on, forward only. Unpacks gzip and zlib.
class ByteReader {
 public:
  /// io: missing, a folder or device, unreadable.
  [[nodiscard]] static Result<ByteReader> open(const std::string& path, std::uint64_t offset,
                                               bool packed);
  ByteReader(ByteReader&&) noexcept;
  ByteReader& operator=(ByteReader&&) noexcept;
  ~ByteReader();

  /// Fills `to` and returns its size, or fewer bytes where the data end.
  /// bad_file: packed data that are damaged or stop before their end.
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> to);

 private:
  struct State;
  explicit ByteReader(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// io: missing or not a regular file.
[[nodiscard]] Result<std::uint64_t> file_size(const std::string& path);

/// The first bytes of a file, at most `limit`, unpacked if they are gzip.
[[nodiscard]] Result<std::string> read_head(const std::string& path, std::size_t limit);

/// Exactly three extents of at least 2 whose product is a size the machine can count.
/// bad_file: zero or absurd. unsupported: one slice.
[[nodiscard]] Result<std::array<std::uint32_t, 3>> check_dims(const std::string& source,
                                                              std::span<const std::uint64_t> sizes);

/// The chosen index among `count`; 0 if there is only one and none is chosen.
/// unsupported: several, and none chosen. usage: beyond the end. `what`: "component", "time point".
[[nodiscard]] Result<std::uint32_t> choose(const std::string& source,
                                           const std::optional<std::uint32_t>& chosen,
                                           std::uint64_t count, std::string_view what);

/// usage: a component or time was chosen, for a format that has one.
[[nodiscard]] Result<void> expect_one_number(const std::string& source,
                                             const VolumeOptions& options);

/// Three extents, and the index of the chosen volume if several of this size follow each other.
struct ChosenVolume {
  std::array<std::uint32_t, 3> dims{};
  std::uint64_t index = 0;
  bool by_component = false;  ///< components are volumes of their own: the index chooses one
};

/// Checks the first three extents with check_dims(). A fourth is time and a fifth components, from
/// which the options choose. Further ones must be 1.
[[nodiscard]] Result<ChosenVolume> choose_volume(const std::string& source,
                                                 std::vector<std::uint64_t> sizes,
                                                 const VolumeOptions& options);

/// bad_file: axes or origin that are not finite, or axes that do not span space.
[[nodiscard]] Result<void> check_axes(const Volume& volume);

/// Fills `volume.voxels`, in native byte order, from `from`; dims and type are set.
/// bad_file: fewer bytes than the dims need, or damaged packed data.
[[nodiscard]] Result<void> read_voxels(const VoxelData& from, Volume& volume);

/// Skips `index` volumes of this size and of the components in `from`.
/// bad_file: more bytes than there can be.
[[nodiscard]] Result<void> skip_volumes(std::uint64_t index, const Volume& volume, VoxelData& from);

/// Bytes the voxels take. REQUIRES: dims that passed check_dims.
[[nodiscard]] std::uint64_t voxel_bytes(const Volume& volume);

/// Reverses the byte order of values in place.
void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value);

// Header text.
[[nodiscard]] std::string_view trim(std::string_view text);
[[nodiscard]] std::string lower(std::string_view text);
[[nodiscard]] std::vector<std::string_view> words(std::string_view text);
[[nodiscard]] std::optional<double> parse_number(std::string_view text);
[[nodiscard]] std::optional<std::int64_t> parse_integer(std::string_view text);
/// At most 40 printable characters of untrusted text, quoted, for a message.
[[nodiscard]] std::string in_quotes(std::string_view text);
/// The path of a data file that a header names relative to its own folder.
[[nodiscard]] std::string beside(const std::string& header, std::string_view name);

/// The next line of `text` from `at` on, without its end. Moves `at` to the line after it.
[[nodiscard]] std::string_view next_line(std::string_view text, std::size_t& at);

// The readers, one per format. `head` is from read_head() and includes the whole header.
[[nodiscard]] bool looks_like_nifti(std::string_view head);
[[nodiscard]] bool looks_like_meta(std::string_view head);
/// Files may lack the preamble: then they begin with elements.
[[nodiscard]] bool looks_like_dicom(std::string_view head);
[[nodiscard]] bool looks_like_mrc(std::string_view head);
[[nodiscard]] bool looks_like_vti(std::string_view head);
[[nodiscard]] bool looks_like_tiff(std::string_view head);
[[nodiscard]] bool looks_like_png(std::string_view head);
[[nodiscard]] Result<Volume> read_nifti(const std::string& path, std::string_view head,
                                        const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_nrrd(const std::string& path, std::string_view head,
                                       const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_meta(const std::string& path, std::string_view head,
                                       const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_mrc(const std::string& path, std::string_view head,
                                      const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_vti(const std::string& path, const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_tiff(const std::string& path, const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_raw(const std::string& path, const RawLayout& layout,
                                      const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_dicom_folder(const std::string& path,
                                               const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_dicom_file(const std::string& path, const VolumeOptions& options);
/// Reads a folder: DICOM if it has any, else its PNGs or TIFFs, one or more slices each.
[[nodiscard]] Result<Volume> read_folder(const std::string& path, const VolumeOptions& options);

}  // namespace slf::volume_io
