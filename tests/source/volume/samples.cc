#include "tests/source/volume/samples.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <bit>
#include <cstring>
#include <fstream>
#include <sstream>

#include "source/volume/voxels.h"

namespace slf::samples {

namespace {

template <class T>
std::string encode(T value, bool big_endian) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big))
    bytes.assign(bytes.rbegin(), bytes.rend());
  return bytes;
}

std::string encode(double value, ScalarType type, bool big) {
  switch (type) {
    case ScalarType::u8:
      return encode(static_cast<std::uint8_t>(value), big);
    case ScalarType::i8:
      return encode(static_cast<std::int8_t>(value), big);
    case ScalarType::u16:
      return encode(static_cast<std::uint16_t>(value), big);
    case ScalarType::i16:
      return encode(static_cast<std::int16_t>(value), big);
    case ScalarType::u32:
      return encode(static_cast<std::uint32_t>(value), big);
    case ScalarType::i32:
      return encode(static_cast<std::int32_t>(value), big);
    case ScalarType::u64:
      return encode(static_cast<std::uint64_t>(value), big);
    case ScalarType::i64:
      return encode(static_cast<std::int64_t>(value), big);
    case ScalarType::f32:
      return encode(static_cast<float>(value), big);
    case ScalarType::f64:
      return encode(value, big);
  }
  return {};
}

std::string numbers(std::initializer_list<double> values, const char* between) {
  std::ostringstream text;
  text.precision(17);
  for (const double value : values) text << (text.tellp() > 0 ? between : "") << value;
  return text.str();
}

std::string deflate_with(const std::string& bytes, int window) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, window, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&stream, bytes.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

}  // namespace

std::string Folder::path(const std::string& name) const { return folder_ / name; }
std::string Folder::write(const std::string& name, const std::string& bytes) const {
  const std::filesystem::path file = path(name);
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << bytes;
  return file;
}

double phantom_value(std::uint32_t i, std::uint32_t j, std::uint32_t k) {
  return std::array{i, j, k} == kMarker ? kMarkerValue : 1 + i + 5 * j + 20 * k;
}

std::string phantom_bytes(ScalarType type, bool big_endian) {
  std::string bytes;
  for (std::uint32_t k = 0; k < kDims[2]; ++k)
    for (std::uint32_t j = 0; j < kDims[1]; ++j)
      for (std::uint32_t i = 0; i < kDims[0]; ++i)
        bytes += encode(phantom_value(i, j, k), type, big_endian);
  return bytes;
}

double value_at(const Volume& volume, std::uint32_t i, std::uint32_t j, std::uint32_t k) {
  const std::size_t at = i + std::size_t{volume.dims[0]} * (j + std::size_t{volume.dims[1]} * k);
  return visit_voxels(volume, [&](auto voxels) {
    return volume.slope * static_cast<double>(voxels[at]) + volume.intercept;
  });
}

glm::dvec3 world_of(const Volume& volume, std::uint32_t i, std::uint32_t j, std::uint32_t k) {
  return volume.origin + volume.axes * glm::dvec3(i, j, k);
}

// A turn by acos(0.8) about z, and the third axis reversed.
glm::dmat3 phantom_axes() {
  return {glm::dvec3(0.8, 0.6, 0) * 1.5, glm::dvec3(-0.6, 0.8, 0) * 2.0,
          glm::dvec3(0, 0, -1) * 3.0};
}
glm::dvec3 phantom_origin() { return {-12.5, 7.25, 40}; }

std::array<double, 12> phantom_srow() {
  std::array<double, 12> srow{};
  for (int row = 0; row < 3; ++row) {
    const double flip = row < 2 ? -1 : 1;
    for (int column = 0; column < 3; ++column)
      srow[static_cast<std::size_t>(4 * row + column)] = flip * phantom_axes()[column][row];
    srow[static_cast<std::size_t>(4 * row + 3)] = flip * phantom_origin()[row];
  }
  return srow;
}

std::string nifti(const Nifti& h) {
  static const std::array<int, 10> kCodes = {2, 256, 512, 4, 768, 8, 1280, 1024, 16, 64};
  const auto t = static_cast<std::size_t>(h.type);
  const int code = h.datatype ? h.datatype : kCodes[t];
  const bool big = h.big_endian;
  const std::size_t size = h.version == 1 ? 348 : 540;
  std::string header(size + 4, '\0');
  const auto put = [&](std::size_t at, const std::string& bytes) {
    header.replace(at, bytes.size(), bytes);
  };
  const auto real = [&](double v) {
    return h.version == 1 ? encode(static_cast<float>(v), big) : encode(v, big);
  };
  const std::size_t width = h.version == 1 ? 4 : 8;
  put(0, encode(static_cast<std::int32_t>(size), big));
  put(h.version == 1 ? 344 : 4, std::string("n").append(h.magic).append(std::to_string(h.version)));
  put(h.version == 1 ? 70 : 12, encode(static_cast<std::int16_t>(code), big));
  for (std::size_t i = 0; i <= h.dim.size(); ++i) {
    const int extent = i == 0 ? static_cast<int>(h.dim.size()) : h.dim[i - 1];
    if (h.version == 1)
      put(40 + 2 * i, encode(static_cast<std::int16_t>(extent), big));
    else
      put(16 + 8 * i, encode(static_cast<std::int64_t>(extent), big));
  }
  for (std::size_t i = 0; i < 8; ++i)
    put((h.version == 1 ? 76 : 104) + width * i, real(h.pixdim[i]));
  const double offset = h.vox_offset < 0 ? static_cast<double>(size + 4) : h.vox_offset;
  if (h.version == 1)
    put(108, real(offset));
  else
    put(168, encode(static_cast<std::int64_t>(offset), big));
  put(h.version == 1 ? 112 : 176, real(h.slope) + real(h.intercept));
  if (h.version == 1) {
    header[123] = static_cast<char>(h.units);
    put(252, encode(static_cast<std::int16_t>(h.qform), big) +
                 encode(static_cast<std::int16_t>(h.sform), big));
  } else {
    put(500, encode(static_cast<std::int32_t>(h.units), big));
    put(344, encode(static_cast<std::int32_t>(h.qform), big) +
                 encode(static_cast<std::int32_t>(h.sform), big));
  }
  const std::size_t q = h.version == 1 ? 256 : 352;
  for (std::size_t i = 0; i < 6; ++i) put(q + width * i, real(h.quaternion[i]));
  for (std::size_t i = 0; i < 12; ++i) put(q + width * (6 + i), real(h.srow[i]));
  return header + phantom_bytes(h.type, big);
}

std::string nrrd_type(ScalarType type) {
  static const std::array<std::string, 10> kNames = {
      "uchar", "signed char", "unsigned short", "short", "uint",
      "int",   "ulonglong",   "long long",      "float", "double"};
  return kNames[static_cast<std::size_t>(type)];
}

std::string meta_type(ScalarType type) {
  static const std::array<std::string, 10> kNames = {
      "MET_UCHAR", "MET_CHAR",       "MET_USHORT",    "MET_SHORT", "MET_UINT",
      "MET_INT",   "MET_ULONG_LONG", "MET_LONG_LONG", "MET_FLOAT", "MET_DOUBLE"};
  return kNames[static_cast<std::size_t>(type)];
}

std::string nrrd(const std::string& lines, const std::string& data) {
  return "NRRD0004\n# a comment\n" + lines + "\n" + data;
}

std::string phantom_nrrd(ScalarType type, bool big_endian, const std::string& space) {
  const glm::dvec3 flip = space == "RAS"   ? glm::dvec3(-1, -1, 1)
                          : space == "LAS" ? glm::dvec3(1, -1, 1)
                                           : glm::dvec3(1, 1, 1);
  const auto vector = [&](const glm::dvec3& v) {
    std::string text = "(";
    return text.append(numbers({flip.x * v.x, flip.y * v.y, flip.z * v.z}, ",")).append(")");
  };
  const auto axes = phantom_axes();
  return nrrd("type: " + nrrd_type(type) + "\ndimension: 3\nspace: " + space +
                  "\nsizes: 5 4 3\nspace directions: " + vector(axes[0]) + " " + vector(axes[1]) +
                  " " + vector(axes[2]) +
                  "\nkinds: domain domain domain\nendian: " + (big_endian ? "big" : "little") +
                  "\nencoding: raw\nspace origin: " + vector(phantom_origin()) + "\n",
              phantom_bytes(type, big_endian));
}

std::string phantom_meta(ScalarType type, bool big_endian, bool packed) {
  const auto axes = phantom_axes();
  const auto direction = [&](int i) {
    const auto v = glm::normalize(axes[i]);
    return numbers({v.x, v.y, v.z}, " ");
  };
  const auto origin = phantom_origin();
  const std::string data = phantom_bytes(type, big_endian);
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = " +
         std::string(big_endian ? "True" : "False") +
         "\nCompressedData = " + (packed ? "True" : "False") +
         "\nTransformMatrix = " + direction(0) + " " + direction(1) + " " + direction(2) +
         "\nOffset = " + numbers({origin.x, origin.y, origin.z}, " ") +
         "\nElementSpacing = 1.5 2 3\nDimSize = 5 4 3\nElementType = " + meta_type(type) +
         "\nElementDataFile = LOCAL\n" + (packed ? zlib(data) : data);
}

std::string gzip(const std::string& bytes) { return deflate_with(bytes, 15 + 16); }
std::string zlib(const std::string& bytes) { return deflate_with(bytes, 15); }

std::string dicom(const Dicom& d) {
  const bool implicit = d.syntax == "1.2.840.10008.1.2";
  const auto element = [](std::uint16_t group, std::uint16_t id, const std::string& vr,
                          std::string value, bool explicit_vr) {
    if (value.size() % 2) value += vr == "UI" || vr == "OW" ? '\0' : ' ';
    std::string bytes = encode(group, false) + encode(id, false);
    const auto length = static_cast<std::uint32_t>(value.size());
    if (!explicit_vr) return bytes + encode(length, false) + value;
    if (vr == "OW" || vr == "OB" || vr == "SQ")
      return bytes + vr + std::string(2, '\0') + encode(length, false) + value;
    return bytes + vr + encode(static_cast<std::uint16_t>(length), false) + value;
  };
  const auto us = [](int value) { return encode(static_cast<std::uint16_t>(value), false); };
  std::string body;
  const auto add = [&](std::uint16_t group, std::uint16_t id, const char* vr,
                       const std::string& value) {
    body += element(group, id, vr, value, !implicit);
  };
  const auto axes = phantom_axes();
  const glm::dvec3 row = glm::normalize(axes[0]), column = glm::normalize(axes[1]);
  const glm::dvec3 at =
      phantom_origin() + axes[2] * double(d.k) + glm::dvec3(d.shift[0], d.shift[1], d.shift[2]);
  add(0x0008, 0x0016, "UI", "1.2.840.10008.5.1.4.1.1.2");
  add(0x0008, 0x0018, "UI", d.series + "." + std::to_string(d.k + 1));
  add(0x0008, 0x0060, "CS", "CT");
  add(0x0020, 0x000d, "UI", "1.2");
  add(0x0020, 0x000e, "UI", d.series);
  if (d.placed) {
    add(0x0020, 0x0032, "DS", numbers({at.x, at.y, at.z}, "\\"));
    add(0x0020, 0x0037, "DS", numbers({row.x, row.y, row.z, column.x, column.y, column.z}, "\\"));
  }
  add(0x0028, 0x0002, "US", us(d.samples));
  add(0x0028, 0x0004, "CS", d.samples == 1 ? "MONOCHROME2" : "RGB");
  if (!d.frames.empty()) add(0x0028, 0x0008, "IS", d.frames);
  add(0x0028, 0x0010, "US", us(4));
  add(0x0028, 0x0011, "US", us(5));
  add(0x0028, 0x0030, "DS", "2\\1.5");
  for (const int id : {0x0100, 0x0101}) add(0x0028, static_cast<std::uint16_t>(id), "US", us(16));
  add(0x0028, 0x0102, "US", us(15));
  add(0x0028, 0x0103, "US", us(1));
  if (d.scaled) {
    add(0x0028, 0x1052, "DS", numbers({d.intercept}, ""));
    add(0x0028, 0x1053, "DS", numbers({d.slope}, ""));
  }
  std::string pixels;
  for (std::uint32_t j = 0; j < kDims[1]; ++j)
    for (std::uint32_t i = 0; i < kDims[0]; ++i)
      for (int s = 0; s < d.samples; ++s)
        pixels += encode(phantom_value(i, j, d.k), ScalarType::i16, false);
  add(0x7fe0, 0x0010, "OW", pixels);
  const std::string meta = element(0x0002, 0x0001, "OB", std::string("\0\1", 2), true) +
                           element(0x0002, 0x0002, "UI", "1.2.840.10008.5.1.4.1.1.2", true) +
                           element(0x0002, 0x0003, "UI", "1.2.3.4", true) +
                           element(0x0002, 0x0010, "UI", d.syntax, true);
  return std::string(128, '\0') + "DICM" +
         element(0x0002, 0x0000, "UL", encode(static_cast<std::uint32_t>(meta.size()), false),
                 true) +
         meta + body;
}

std::string integer_bytes(std::uint64_t value, bool wide, bool big) {
  std::string bytes;
  const int width = wide ? 8 : 4;
  for (int i = 0; i < width; ++i)
    bytes += static_cast<char>(value >> 8 * (big ? width - 1 - i : i));
  return bytes;
}

Volume expect_read(const std::string& path, const VolumeOptions& options) {
  auto volume = read_volume(path, options);
  EXPECT_TRUE(volume) << (volume ? "" : volume.error().message);
  return volume ? *volume : Volume{};
}

void expect_error(const std::string& path, ErrorCode code, const std::string& part,
                  const VolumeOptions& options) {
  const auto volume = read_volume(path, options);
  ASSERT_FALSE(volume) << part;
  EXPECT_EQ(volume.error().code, code) << volume.error().message;
  EXPECT_THAT(volume.error().message, ::testing::HasSubstr(part));
}

void expect_cuts_refused(const Folder& folder, const std::string& file, const std::string& bytes) {
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const auto path = folder.write(file, bytes.substr(0, length));
    const auto volume = read_volume(path);
    ASSERT_FALSE(volume) << file << " cut to " << length << " of " << bytes.size();
    ASSERT_THAT(volume.error().message, ::testing::StartsWith(path));
  }
}

void expect_phantom(const Volume& volume, ScalarType type) {
  ASSERT_EQ(volume.dims, kDims);
  EXPECT_EQ(volume.type, type);
  for (std::uint32_t k = 0; k < kDims[2]; ++k)
    for (std::uint32_t j = 0; j < kDims[1]; ++j)
      for (std::uint32_t i = 0; i < kDims[0]; ++i)
        ASSERT_EQ(value_at(volume, i, j, k), phantom_value(i, j, k)) << i << j << k;
}

}  // namespace slf::samples
