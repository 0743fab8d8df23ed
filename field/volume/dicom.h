// One DICOM file: its elements, where its slices lie, its pixels.
//
// Two readers, by what is at stake. Elements, places and uncompressed pixels are read by our own
// parser, in this process. Compressed pixels are decoded by GDCM, in a child process only
// (volume_dicom_decode.h), after our parser has accepted the file.
//
// Why our own: Debian builds GDCM with its assertions, and on a damaged file gdcm::Reader aborts
// the process, or allocates up to 4 GiB by a length that lies. ITK's reader is GDCM as well, and
// rescales pixels as it reads, so that both the 16 bits and the slope are lost.
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

/// What is read of a file's elements.
/// REQUIRES: the bytes it was parsed from outlive it.
struct DicomElements {
  std::string syntax;         ///< transfer syntax UID
  DicomValues values{};       ///< of the outermost data set
  bool encapsulated = false;  ///< pixel data are a sequence of encoded fragments
  /// The functional groups of a multi-frame file, place and scale only: for all its frames, and
  /// for each.
  DicomValues shared{};
  std::vector<DicomValues> frames{};
};

/// The bytes of a file, its data set inflated where the transfer syntax is deflated.
/// io: unreadable. bad_file: damaged deflated data. unsupported: they inflate beyond 1 GiB.
[[nodiscard]] Result<std::string> read_dicom_bytes(const std::string& path);

/// Walks every element, nested ones too, and holds its length against the bytes there are.
/// `bytes` are what read_dicom_bytes gave.
/// bad_file: a length that leaves its parent. unsupported: big endian transfer syntax.
[[nodiscard]] Result<DicomElements> parse_dicom(const std::string& path, std::string_view bytes);

/// Where a slice lies and how its pixels are stored and scaled.
struct DicomSlice {
  std::string path;
  std::uint32_t frame = 0, frames = 1;  ///< which of the file's
  std::string series;
  std::string syntax;       ///< transfer syntax UID
  bool compressed = false;  ///< needs GDCM
  glm::dvec3 position{0.0};
  glm::dvec3 row{0.0}, column{0.0};  ///< directions in which x and y of the picture grow
  glm::dvec2 spacing{0.0};           ///< along row, along column
  double slope = 1, intercept = 0;
  std::uint32_t width = 0, height = 0;
  ScalarType type = ScalarType::u8;
  unsigned bits_stored = 8, high_bit = 7;

  /// Bytes of its pixels, decoded. At most 2^34.
  [[nodiscard]] std::uint64_t bytes() const;
  /// Path and, where the file has several, frame, for messages.
  [[nodiscard]] std::string label() const;
};

/// "JPEG 2000 (transfer syntax 1.2.840.10008.1.2.4.91)"; empty for a syntax we cannot decode.
[[nodiscard]] std::string name_of_compression(std::string_view syntax);

/// The slices of a file, one a frame, in the file's order. None where it is DICOM but no picture
/// (a DICOMDIR, a report), or of another series than `series`, where that is given.
/// unsupported: colour, palettes, a compression or pixel size we do not know, frames without
/// functional groups.
[[nodiscard]] Result<std::vector<DicomSlice>> read_dicom_slices(
    const std::string& path, const std::optional<std::string>& series = {});

class DicomDecoder;

/// The pixels of files, in the order they are given. Not thread-safe.
class DicomPixelReader {
 public:
  /// `files`: any slice of each.
  explicit DicomPixelReader(std::vector<DicomSlice> files);
  DicomPixelReader(DicomPixelReader&&) noexcept;
  DicomPixelReader& operator=(DicomPixelReader&&) noexcept;
  ~DicomPixelReader();

  /// All frames of the next file, each slice.bytes() long, in native byte order and before slope
  /// and intercept. Bits beside the stored ones are cleared, the sign extended. MONOCHROME1 (least
  /// is white) stays the numbers it is.
  /// bad_file: too few pixels, or compressed ones that cannot be decoded.
  /// REQUIRES: a file is left.
  [[nodiscard]] Result<std::vector<std::byte>> next();

 private:
  std::vector<DicomSlice> files_;
  std::size_t at_ = 0;
  std::unique_ptr<DicomDecoder> decoder_;  ///< started for the first compressed file
};

}  // namespace slf::volume_io
