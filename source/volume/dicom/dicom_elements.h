// The elements of a DICOM file: data sets, their sequences, and typed look-ups.
//
// Why our own parser? Debian builds GDCM with its assertions. On a damaged file gdcm::Reader aborts
// the process, or allocates up to 4 GiB because of a wrong length. ITK's reader is GDCM too, and it
// rescales pixels, so that both the 16 bits and the slope are lost.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"

namespace slf::volume_io {

/// Group << 16 | element.
using DicomTag = std::uint32_t;
inline constexpr DicomTag kCharacterSet = 0x00080005, kPixelData = 0x7fe00010;

/// The elements of a data set. Values view the bytes of the file, which must outlive them.
struct DicomDataSet {
  std::map<DicomTag, std::string_view> values{};
  /// Only sequences that the readers use: functional groups, segments, dimensions, detectors.
  std::map<DicomTag, std::vector<DicomDataSet>> sequences{};

  /// The items of a sequence; none if it is absent.
  [[nodiscard]] const std::vector<DicomDataSet>& items(DicomTag sequence) const;
};

/// The parsed elements of a file.
struct DicomFile {
  std::string syntax;         ///< transfer syntax UID; empty if the file states none
  bool big_endian = false;    ///< elements and pixels
  bool encapsulated = false;  ///< pixel data are a sequence of encoded fragments
  std::size_t fragments = 0;  ///< how many
  bool words = false;         ///< pixel data are 16-bit words (VR OW)
  DicomDataSet data{};
  /// If the file is damaged: where. `data` then holds the elements before that place.
  std::optional<Error> damage{};
};

/// The bytes of a file, with the data set inflated if the transfer syntax is deflated.
struct DicomBytes {
  std::string bytes;
  std::optional<Error> damage{};  ///< the deflated data end early, or inflate to more than 1 GiB
};
/// io: the file cannot be read. bad_file: no DICOM.
[[nodiscard]] Result<DicomBytes> read_dicom_bytes(const std::string& path);

/// Walks every element and checks its length against the file's. A file may lack the preamble, the
/// meta elements or the transfer syntax, whose default is implicit little endian.
[[nodiscard]] DicomFile parse_dicom(const std::string& path, const DicomBytes& file);

/// Finds elements in several data sets: the first that has the element counts.
class DicomLookup {
 public:
  DicomLookup(bool big_endian, std::vector<const DicomDataSet*> sets)
      : big_endian_(big_endian), sets_(std::move(sets)) {}

  /// The value as stored; empty if there is none.
  [[nodiscard]] std::string_view raw(DicomTag tag) const;
  /// Text without padding.
  [[nodiscard]] std::string text(DicomTag tag) const;
  /// The same as UTF-8. Characters of sets other than Latin-1 and UTF-8 become '?'.
  [[nodiscard]] std::string utf8(DicomTag tag, const std::string& character_set) const;
  /// Decimal strings (DS, IS) separated by backslashes. Empty if they are missing or no numbers.
  [[nodiscard]] std::vector<double> numbers(DicomTag tag) const;
  [[nodiscard]] std::optional<double> number(DicomTag tag) const;
  /// Binary unsigned integers (US, UL, AT's halves): `bytes` is the size of one.
  [[nodiscard]] std::vector<std::uint32_t> integers(DicomTag tag, std::size_t bytes) const;
  /// A binary unsigned integer of 2 or 4 bytes, by the length of the value.
  [[nodiscard]] std::optional<std::uint32_t> integer(DicomTag tag) const;
  /// Binary doubles (FD), or an odd number of floats (FL). Empty if they are missing or not finite.
  [[nodiscard]] std::vector<double> reals(DicomTag tag) const;
  [[nodiscard]] std::optional<double> real(DicomTag tag) const;

 private:
  bool big_endian_;
  std::vector<const DicomDataSet*> sets_;
};

/// Copies the elements of `from`, and those of the first item of each of its sequences, to `into`,
/// except those that it has already. So functional groups become one data set.
void flatten(const DicomDataSet& from, DicomDataSet& into);

}  // namespace slf::volume_io
