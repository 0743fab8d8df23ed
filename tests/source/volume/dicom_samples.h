// DICOM files of any elements, written here from the standard and independently of the reader.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "tests/source/volume/samples.h"

namespace slf::samples {

struct DicomValue;
/// Elements by tag (group << 16 | element).
using DicomElements = std::map<std::uint32_t, DicomValue>;

/// The value of an element, encoded when the file is written.
struct DicomValue {
  std::string vr{};
  std::string text{};             ///< or bytes as they are
  std::vector<double> numbers{};  ///< of US, UL, SS, FD and of the pixels of OW
  std::vector<DicomElements> items{};
};

DicomValue text(const std::string& vr, const std::string& value);
/// Decimal strings.
DicomValue decimals(const std::vector<double>& values);
DicomValue us(const std::vector<double>& values);
DicomValue ul(const std::vector<double>& values);
DicomValue fd(const std::vector<double>& values);
DicomValue bytes(const std::string& value);
DicomValue sequence(const std::vector<DicomElements>& items);

/// How a file is written.
struct DicomForm {
  std::string syntax = "1.2.840.10008.1.2.1";  ///< stated; empty: none
  bool is_explicit = true, big_endian = false;
  bool preamble = true, meta = true;
  bool open = false;     ///< sequences and items of undefined length
  bool unknown = false;  ///< sequences are written as UN, as by who does not know them
};

std::string write_dicom(const DicomElements& elements, const DicomForm& form = {});

inline constexpr std::uint32_t kSliceWidth = 4, kSliceHeight = 3;
/// The value of a pixel of small_slice().
int slice_value(std::uint32_t i, std::uint32_t j, int k);
/// A CT slice of 4×3 pixels of 0.7 by 0.5 mm at z = 2 k, series "1.2.3" with the number 3.
DicomElements small_slice(int k);

/// The functional groups of a frame: its position.
DicomElements frame_at(double z);
/// An enhanced file with these functional groups by frame, orientation and spacing shared, and the
/// pixels of small_slice(k).
DicomElements enhanced_file(const std::vector<DicomElements>& frames, const std::vector<int>& k);

}  // namespace slf::samples
