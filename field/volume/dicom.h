// One DICOM file: its elements, the positions of its slices, its pixels.
//
// Our own parser reads elements, positions and uncompressed pixels, in this process. GDCM decodes
// compressed pixels, but only in a child process (dicom_decode.h), and only after our parser has
// accepted the file.
//
// Why our own parser? Debian builds GDCM with its assertions. On a damaged file gdcm::Reader aborts
// the process, or allocates up to 4 GiB because of a wrong length. ITK's reader is GDCM too, and it
// rescales pixels, so that both the 16 bits and the slope are lost.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

/// Elements by tag (group << 16 | element).
using DicomValues = std::map<std::uint32_t, std::string_view>;

/// The parsed elements of a file. Views the bytes of the file, which must outlive it.
struct DicomElements {
  std::string syntax;         ///< transfer syntax UID
  DicomValues values{};       ///< elements of the outermost data set
  bool encapsulated = false;  ///< pixel data are a sequence of encoded fragments
  /// The functional groups of a multi-frame file, only those for position and scale: the shared
  /// ones, and those of each frame.
  DicomValues shared{};
  std::vector<DicomValues> frames{};
};

/// The bytes of a file, with the data set inflated if the transfer syntax is deflated.
/// io: the file cannot be read. bad_file: the deflated data are damaged. unsupported: they inflate
/// to more than 1 GiB.
[[nodiscard]] Result<std::string> read_dicom_bytes(const std::string& path);

/// Walks every element, including nested ones, and checks its length against the file's. `bytes`
/// are those of read_dicom_bytes. bad_file: an element extends beyond its parent. unsupported:
/// big-endian transfer syntax.
[[nodiscard]] Result<DicomElements> parse_dicom(const std::string& path, std::string_view bytes);

/// The position of a slice, and how its pixels are stored and scaled.
struct DicomSlice {
  std::string path;
  std::uint32_t frame = 0, frames = 1;  ///< its frame, and how many the file has
  std::string series;
  std::string syntax;       ///< transfer syntax UID
  bool compressed = false;  ///< needs GDCM
  glm::dvec3 position{0.0};
  glm::dvec3 row{0.0}, column{0.0};  ///< world directions of the picture's x and y
  glm::dvec2 spacing{0.0};           ///< along row, along column
  double slope = 1, intercept = 0;
  std::uint32_t width = 0, height = 0;
  ScalarType type = ScalarType::u8;
  unsigned bits_stored = 8, high_bit = 7;

  /// Bytes of its pixels, decoded. At most 2^34.
  [[nodiscard]] std::uint64_t bytes() const;
  /// The path and, if the file has several frames, the frame, for messages.
  [[nodiscard]] std::string label() const;
};

/// The name of a compression, as "JPEG 2000 (transfer syntax 1.2.840.10008.1.2.4.91)"; empty for
/// one that we cannot decode.
[[nodiscard]] std::string name_of_compression(std::string_view syntax);

/// The slices of a file, one per frame, in file order. None if the file is DICOM but no picture (a
/// DICOMDIR, a report), or belongs to another series than `series`, if that is given.
/// unsupported: colour, palettes, an unknown compression or pixel size, frames without functional
/// groups.
[[nodiscard]] Result<std::vector<DicomSlice>> read_dicom_slices(
    const std::string& path, const std::optional<std::string>& series = {});

class DicomDecoder;

/// Reads the pixels of files, in the given order. Not thread-safe.
class DicomPixelReader {
 public:
  /// `files`: any slice of each.
  explicit DicomPixelReader(std::vector<DicomSlice> files);
  DicomPixelReader(DicomPixelReader&&) noexcept;
  DicomPixelReader& operator=(DicomPixelReader&&) noexcept;
  ~DicomPixelReader();

  /// All frames of the next file, each slice.bytes() long, in native byte order, before slope and
  /// intercept. Bits that are not stored are cleared, and the sign is extended. The values of
  /// MONOCHROME1 (least is white) do not change.
  /// bad_file: too few pixels, or compressed ones that cannot be decoded.
  /// REQUIRES: there is a next file.
  [[nodiscard]] Result<std::vector<std::byte>> next();

 private:
  std::vector<DicomSlice> files_;
  std::size_t at_ = 0;
  std::unique_ptr<DicomDecoder> decoder_;  ///< started for the first compressed file
};

}  // namespace slf::volume_io
