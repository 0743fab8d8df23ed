// Shared by the volume readers: bounded reading, checks of dims and axes, header text.
//
// Headers are untrusted. Memory for a stated size is allocated only if the file is long enough to
// hold it; packed voxels have limits of their own, see packing.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/ascii.h"
#include "base/file.h"
#include "base/join.h"
#include "slf/error.h"
#include "slf/volume.h"
#include "source/volume/packing.h"

namespace slf::volume_io {

/// The location of a volume's voxels in a file, or in several.
struct VoxelData {
  /// At least one. Several hold the volumes in parts of equal size, each at `offset` and `skip` of
  /// its own. REQUIRES where there are several: `volumes` is known.
  std::vector<std::string> files{};
  std::uint64_t offset = 0;  ///< bytes of the file before the voxels, or before the packed stream
  bool packed = false;
  Packing packing = Packing::none;  ///< of packed data; none: as their first bytes say, or zlib
  std::uint64_t skip = 0;           ///< further bytes before the voxels: of the stream, unpacked
  bool at_end = false;              ///< not at `offset`: the voxels are the last bytes, not packed
  bool big_endian = false;
  /// The number of components of a voxel, and the one to read.
  std::uint32_t components = 1, component = 0;
  /// The values of a component that are stored together: 1 where components are side by side. It
  /// divides the number of voxels.
  std::uint64_t run = 1;
  /// The number of volumes that are stored one after another, 0 where it is unknown, and the one to
  /// read.
  std::uint64_t volumes = 0, index = 0;
};

/// Reads a file from an offset on, forward only, and unpacks it.
class ByteReader {
 public:
  /// `packing`: of packed data; none: as their first bytes say, or else zlib.
  /// io: missing, a folder or device, unreadable.
  [[nodiscard]] static Result<ByteReader> open(const std::string& path, std::uint64_t offset,
                                               bool packed, Packing packing = Packing::none);

  /// Fills `to` and returns its size, or fewer bytes where the data end.
  /// bad_file: packed data that are damaged or stop before their end.
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> to);
  /// The next `limit` bytes, or fewer where the data end. Errors as read().
  [[nodiscard]] Result<std::string> read_text(std::size_t limit);
  [[nodiscard]] Packing packing() const { return packing_; }

 private:
  ByteReader() = default;
  bool refill();
  bool next_member();
  Result<std::size_t> unpack(std::span<std::byte> to);

  std::string path_;
  std::ifstream file_;
  Packing packing_ = Packing::none;
  std::unique_ptr<Unpacker> unpacker_;  ///< if it is packed
  bool ended_ = false;                  ///< the packed stream is complete
  std::vector<std::byte> chunk_;
  std::span<const std::byte> in_;  ///< what is left of it
  std::uint64_t unpacked_ = 0;
};

/// The first bytes of a file, at most `limit`, unpacked if it is packed.
[[nodiscard]] Result<std::string> read_head(const std::string& path, std::size_t limit);

/// Exactly three extents of at least 2 whose product is a size the machine can count.
/// bad_file: zero or absurd. unsupported: one slice.
[[nodiscard]] Result<std::array<std::uint32_t, 3>> check_dims(
    const std::string& source, const std::vector<std::uint64_t>& sizes);

/// The chosen index among `count`; 0 if there is only one and none is chosen.
/// unsupported: several, and none chosen. usage: beyond the end. `what`: "component", "time point".
[[nodiscard]] Result<std::uint32_t> choose(const std::string& source,
                                           const std::optional<std::uint32_t>& chosen,
                                           std::uint64_t count, std::string_view what);

/// Sets the volume's dims to the first three extents, checked by check_dims(). A fourth is time and
/// a fifth components that are volumes of their own; further ones must be 1. The result has what
/// the options choose of these and of `components`, which are side by side. REQUIRES: the volume
/// has its source.
[[nodiscard]] Result<VoxelData> choose_volume(std::vector<std::uint64_t> sizes,
                                              std::uint32_t components,
                                              const VolumeOptions& options, Volume& volume);

/// bad_file: axes or origin that are not finite, or axes that do not span space.
[[nodiscard]] Result<void> check_axes(const Volume& volume);

/// Whether a file is packed by its content and by its name. Voxels alone may look like a packed
/// file.
[[nodiscard]] bool is_named_and_packed(const std::string& path);

/// Gives the axes the spacing of the options, if they state one, and checks them with check_axes().
/// One axis whose length is 0 or not finite becomes perpendicular to the others; if there are more,
/// the axes become those of the grid, with a note.
[[nodiscard]] Result<void> place(const VolumeOptions& options, Volume& volume);

/// The note on files that state no spacing.
inline constexpr const char* kNoSpacing = "it states no spacing: voxels are taken as 1x1x1";

/// The spacing along an axis: that of the options, else what the file states in `field`.
/// bad_file: that is no positive number.
[[nodiscard]] Result<double> spacing_or(const VolumeOptions& options, std::size_t axis,
                                        double stated, const std::string& source,
                                        const std::string& field);

/// Fills `volume.voxels`, in native byte order, from `from`; dims and type are set. Adds the files
/// that it reads, and a note if they hold more bytes than the volumes need. A file of voxels is
/// unpacked if its name says so, too.
/// bad_file: fewer bytes than the dims need, or damaged packed data.
[[nodiscard]] Result<void> read_voxels(const VoxelData& given, Volume& volume);

/// Bytes the voxels take. REQUIRES: dims that passed check_dims.
[[nodiscard]] std::uint64_t voxel_bytes(const Volume& volume);

/// Reverses the byte order of values in place.
void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value);

/// Floats of half floats, both in native byte order.
[[nodiscard]] std::vector<std::byte> floats_of_halves(std::span<const std::byte> halves);
/// Makes f32 of half floats that were read as u16.
void widen_half_floats(Volume& volume);

// Header text.
using slf::trim;
[[nodiscard]] std::vector<std::string_view> words(std::string_view text);
/// A number may begin with a plus sign or a point. Beyond the range of double it is 0 or infinite.
[[nodiscard]] std::optional<double> parse_number(std::string_view text);
[[nodiscard]] std::optional<std::int64_t> parse_integer(std::string_view text);
/// Appends a number that is text as a value of this type, in native byte order. False, and nothing
/// appended, if it is no such number.
[[nodiscard]] bool append_number(std::string_view word, ScalarType type,
                                 std::vector<std::byte>& bytes);
/// At most 40 bytes of untrusted text, quoted, for a message; what is not printable is \xNN.
[[nodiscard]] std::string in_quotes(std::string_view text);
/// The path of a data file that a header names relative to its own folder.
[[nodiscard]] std::string beside(const std::string& header, std::string_view name);

/// Whether data files may have the number, from a header, as their own or as a step. Sums and
/// differences of a few such numbers do not overflow.
[[nodiscard]] constexpr bool is_file_number(std::int64_t number) {
  constexpr std::int64_t kMost = 1 << 30;
  return number >= -kMost && number <= kMost;
}
/// The names of numbered data files of a header: `pattern` has one %d, or with a width %03d, for
/// the numbers from `first` to `last` in steps. bad_file: another pattern, or numbers that are no
/// range.
[[nodiscard]] Result<std::vector<std::string>> numbered_files(const std::string& header,
                                                              std::string_view pattern,
                                                              std::int64_t first, std::int64_t last,
                                                              std::int64_t step);

/// A path without the ending of a packing, such as ".gz".
[[nodiscard]] std::string without_packing(const std::string& path);
/// The other file of a pair: the path with `ending` (such as ".img") for its own, packed or not,
/// whichever there is. If there is none, that of the plain file.
[[nodiscard]] std::string partner_of(const std::string& path, std::string_view ending);

/// The cells of the next row of a table from `at` on, trimmed; an empty line has one. Double quotes
/// may enclose a cell, and are doubled within it. Moves `at` behind the row, and counts in `line`.
[[nodiscard]] std::vector<std::string> next_row(std::string_view text, std::size_t& at,
                                                std::size_t& line, char separator = ',');

/// The header of NRRD or MetaImage: a field and its value on each line.
struct TextHeader {
  std::string path;  ///< in messages
  std::map<std::string, std::string, std::less<>> fields{};
  std::size_t bytes = 0;              ///< of the header, with the line that ends it
  std::vector<std::string> listed{};  ///< the names of data files, on lines of their own

  /// Takes lines as names of data files.
  void list(std::string_view lines);

  /// The value of a field; null if there is none.
  [[nodiscard]] const std::string* find(std::string_view field) const;

  // All of these: bad_file if the value is something else.

  [[nodiscard]] Result<std::string> required(std::string_view field) const;
  /// From `low` to `high`. Required unless there is an `otherwise`.
  [[nodiscard]] Result<std::int64_t> integer(std::string_view field, std::int64_t low,
                                             std::int64_t high,
                                             std::optional<std::int64_t> otherwise = {}) const;
  /// So many words, or none if the field is missing.
  [[nodiscard]] Result<std::vector<std::string_view>> parts(std::string_view field,
                                                            std::size_t count) const;
  /// So many numbers, or none if the field is missing.
  [[nodiscard]] Result<std::vector<double>> numbers(std::string_view field,
                                                    std::size_t count) const;
  /// So many extents. Required.
  [[nodiscard]] Result<std::vector<std::uint64_t>> sizes(std::string_view field,
                                                         std::size_t count) const;
  /// The paths of data files that it names, as FileFinder finds them; a note says if they were
  /// moved. Those that are nowhere are as stated.
  [[nodiscard]] std::vector<std::string> find_files(std::vector<std::string> names,
                                                    std::vector<std::string>& notes) const;
  /// A file of voxels can be read. Errors as file_size().
  [[nodiscard]] Result<void> check_data_file(const std::string& file) const;
};

/// The greatest number of bytes that headers may state.
inline constexpr std::int64_t kMaxSkip = std::int64_t{1} << 53;

// The readers, one per format; formats.h lists them. `head` is from read_head() and includes the
// whole header.
using Recogniser = bool(std::string_view head);
using FormatReader = Result<Volume>(const std::string& path, std::string_view head,
                                    const VolumeOptions& options);
[[nodiscard]] Recogniser looks_like_nrrd, looks_like_nifti, looks_like_meta, looks_like_mrc,
    looks_like_vti, looks_like_tiff, looks_like_png, looks_like_jpeg, looks_like_npy,
    looks_like_npz, looks_like_mgh, looks_like_vtk;
/// Files may lack the preamble: then they begin with elements.
[[nodiscard]] Recogniser looks_like_dicom;
/// Whether this is a header of NIfTI or Analyze 7.5 whose voxels are in another file.
[[nodiscard]] Recogniser is_header_of_pair;
/// Whether a text header names files of voxels, which then are beside it, packed or not.
[[nodiscard]] Recogniser nrrd_names_files, meta_names_files;
[[nodiscard]] FormatReader read_nrrd, read_nifti, read_meta, read_dicom_file, read_tiff, read_mrc,
    read_vti, read_npy, read_npz, read_mgh, read_vtk;
[[nodiscard]] Result<Volume> read_raw(const std::string& path, const RawLayout& layout,
                                      const VolumeOptions& options);
[[nodiscard]] Result<Volume> read_dicom_folder(const std::string& path,
                                               const VolumeOptions& options);
/// Reads a folder: DICOM if it has any, else its PNGs, JPEGs or TIFFs, one or more slices each.
[[nodiscard]] Result<Volume> read_folder(const std::string& path, const VolumeOptions& options);

}  // namespace slf::volume_io
