#include "tests/source/volume/dicom_samples.h"

#include <cstring>
#include <sstream>

namespace slf::samples {

namespace {

std::string integer(std::uint64_t value, std::size_t size, bool big) {
  std::string bytes;
  for (std::size_t i = 0; i < size; ++i)
    bytes += static_cast<char>(value >> 8 * (big ? size - 1 - i : i));
  return bytes;
}

std::string tag_bytes(std::uint32_t tag, bool big) {
  return integer(tag >> 16, 2, big) + integer(tag & 0xffff, 2, big);
}

std::string encode_elements(const DicomElements& elements, const DicomForm& form);

std::string encode_items(const DicomValue& value, const DicomForm& form) {
  constexpr std::uint64_t kUndefined = 0xffffffff;
  const bool big = form.big_endian;
  std::string all;
  for (const auto& item : value.items) {
    const std::string inner = encode_elements(item, form);
    all +=
        tag_bytes(0xfffee000, big) + integer(form.open ? kUndefined : inner.size(), 4, big) + inner;
    if (form.open) all += tag_bytes(0xfffee00d, big) + integer(0, 4, big);
  }
  if (form.open) all += tag_bytes(0xfffee0dd, big) + integer(0, 4, big);
  return all;
}

std::string encode_value(const DicomValue& value, const DicomForm& form) {
  std::string bytes = value.text;
  for (const double number : value.numbers) {
    std::uint64_t bits = static_cast<std::uint64_t>(static_cast<std::int64_t>(number));
    if (value.vr == "FD") std::memcpy(&bits, &number, sizeof bits);
    bytes += integer(bits, value.vr == "FD" ? 8 : value.vr == "UL" ? 4 : 2, form.big_endian);
  }
  if (bytes.size() % 2) bytes += value.vr == "UI" || value.vr == "OB" ? '\0' : ' ';
  return bytes;
}

std::string encode_elements(const DicomElements& elements, const DicomForm& form) {
  std::string all;
  const bool big = form.big_endian;
  for (const auto& [tag, value] : elements) {
    const bool is_sequence = value.vr == "SQ";
    DicomForm inner = form;
    std::string vr = value.vr;
    if (is_sequence && form.unknown) {
      vr = "UN";
      inner.is_explicit = false;
      inner.unknown = false;
    }
    const std::string bytes = is_sequence ? encode_items(value, inner) : encode_value(value, form);
    const std::uint64_t length = is_sequence && form.open ? 0xffffffff : bytes.size();
    all += tag_bytes(tag, big);
    if (!form.is_explicit)
      all += integer(length, 4, big);
    else if (vr == "SQ" || vr == "UN" || vr == "OB" || vr == "OW")
      all += vr + std::string(2, '\0') + integer(length, 4, big);
    else
      all += vr + integer(length, 2, big);
    all += bytes;
  }
  return all;
}

std::vector<double> pixels_of(int k) {
  std::vector<double> pixels;
  for (std::uint32_t j = 0; j < kSliceHeight; ++j)
    for (std::uint32_t i = 0; i < kSliceWidth; ++i) pixels.push_back(slice_value(i, j, k));
  return pixels;
}

}  // namespace

DicomValue text(const std::string& vr, const std::string& value) { return {vr, value}; }

DicomValue decimals(const std::vector<double>& values) {
  std::ostringstream all;
  for (const double value : values) all << (all.tellp() > 0 ? "\\" : "") << value;
  return {"DS", all.str()};
}

DicomValue us(const std::vector<double>& values) { return {"US", {}, values}; }
DicomValue ul(const std::vector<double>& values) { return {"UL", {}, values}; }
DicomValue fd(const std::vector<double>& values) { return {"FD", {}, values}; }
DicomValue bytes(const std::string& value) { return {"OB", value}; }
DicomValue sequence(const std::vector<DicomElements>& items) { return {"SQ", {}, {}, items}; }

std::string write_dicom(const DicomElements& elements, const DicomForm& form) {
  std::string file;
  if (form.preamble) file = std::string(128, '\0') + "DICM";
  if (form.meta) {
    DicomElements meta{{0x00020001, bytes(std::string("\0\1", 2))},
                       {0x00020002, text("UI", "1.2.840.10008.5.1.4.1.1.2")},
                       {0x00020003, text("UI", "1.2.3.4")}};
    if (!form.syntax.empty()) meta[0x00020010] = text("UI", form.syntax);
    const std::string all = encode_elements(meta, {});
    file += encode_elements({{0x00020000, ul({static_cast<double>(all.size())})}}, {}) + all;
  }
  return file + encode_elements(elements, form);
}

int slice_value(std::uint32_t i, std::uint32_t j, int k) {
  return static_cast<int>(100 + i + 10 * j) + 50 * k;
}

DicomElements small_slice(int k) {
  return {{0x00080016, text("UI", "1.2.840.10008.5.1.4.1.1.2")},
          {0x00080018, text("UI", "1.2.3." + std::to_string(k + 1))},
          {0x00080060, text("CS", "CT")},
          {0x0008103e, text("LO", "Thorax")},
          {0x0020000e, text("UI", "1.2.3")},
          {0x00200011, text("IS", "3")},
          {0x00200013, text("IS", std::to_string(k + 1))},
          {0x00200032, decimals({-10, -20, 2.0 * k})},
          {0x00200037, decimals({1, 0, 0, 0, 1, 0})},
          {0x00280002, us({1})},
          {0x00280004, text("CS", "MONOCHROME2")},
          {0x00280010, us({kSliceHeight})},
          {0x00280011, us({kSliceWidth})},
          {0x00280030, decimals({0.5, 0.7})},
          {0x00280100, us({16})},
          {0x00280101, us({16})},
          {0x00280102, us({15})},
          {0x00280103, us({1})},
          {0x7fe00010, {"OW", {}, pixels_of(k)}}};
}

DicomElements frame_at(double z) {
  return {{0x00209113, sequence({{{0x00200032, decimals({-10, -20, z})}}})}};
}

DicomElements enhanced_file(const std::vector<DicomElements>& frames, const std::vector<int>& k) {
  DicomElements file = small_slice(0);
  for (const std::uint32_t moved : {0x00200032u, 0x00200037u, 0x00280030u}) file.erase(moved);
  file[0x00280008] = text("IS", std::to_string(frames.size()));
  file[0x52009229] =
      sequence({{{0x00209116, sequence({{{0x00200037, decimals({1, 0, 0, 0, 1, 0})}}})},
                 {0x00289110, sequence({{{0x00280030, decimals({0.5, 0.7})}}})}}});
  file[0x52009230] = sequence(frames);
  DicomValue pixels{"OW", {}, {}};
  for (const int one : k)
    for (const double value : pixels_of(one)) pixels.numbers.push_back(value);
  file[0x7fe00010] = pixels;
  return file;
}

}  // namespace slf::samples
