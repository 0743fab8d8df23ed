// The pixels of DICOM files: our own parser reads plain ones, DicomDecoder compressed ones.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <type_traits>

#include "base/try.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/dicom/dicom_decode.h"
#include "source/volume/dicom/dicom_elements.h"
#include "source/volume/io.h"
#include "source/volume/voxels.h"

namespace slf::volume_io {

namespace {

/// Clears the bits that are not stored (old files have overlays there) and extends the sign.
void keep_stored_bits(std::vector<std::byte>& pixels, const DicomSlice& slice) {
  with_type(slice.type, [&]<class T>(T) {
    if constexpr (std::is_integral_v<T>) {
      using Bits = std::make_unsigned_t<T>;
      constexpr unsigned kBits = 8 * sizeof(T);
      if (slice.bits_stored == kBits) return;
      const unsigned left = kBits - 1 - slice.high_bit;
      const unsigned right = kBits - slice.bits_stored;
      for (std::size_t at = 0; at + sizeof(T) <= pixels.size(); at += sizeof(T)) {
        Bits raw;
        std::memcpy(&raw, pixels.data() + at, sizeof(T));
        const T kept = static_cast<T>(static_cast<T>(static_cast<Bits>(raw << left)) >> right);
        std::memcpy(pixels.data() + at, &kept, sizeof(T));
      }
    }
  });
}

/// One byte per pixel from bits, the lowest first, from pixel `first` on.
std::vector<std::byte> unpacked(std::span<const std::byte> bits, std::uint64_t first,
                                std::uint64_t count) {
  std::vector<std::byte> pixels(count);
  for (std::uint64_t i = 0; i < count; ++i)
    pixels[i] = (bits[(first + i) / 8] >> ((first + i) % 8)) & std::byte{1};
  return pixels;
}

/// Puts the samples of a pixel side by side, which were in planes.
std::vector<std::byte> interleaved(std::span<const std::byte> planes, const DicomSlice& slice) {
  const std::size_t width = bytes_per_voxel(slice.type);
  const std::size_t plane = planes.size() / slice.samples;
  std::vector<std::byte> pixels(planes.size());
  auto to = pixels.begin();
  for (std::size_t at = 0; at < plane; at += width)
    for (std::size_t s = 0; s < slice.samples; ++s)
      to = std::copy_n(planes.begin() + static_cast<std::ptrdiff_t>(s * plane + at), width, to);
  return pixels;
}

/// Repeats the chroma that two pixels share: Y Y Cb Cr to Y Cb Cr, Y Cb Cr.
std::vector<std::byte> with_full_chroma(std::span<const std::byte> shared, std::uint64_t count) {
  std::vector<std::byte> pixels;
  pixels.reserve(3 * count);
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto* pair = &shared[i / 2 * 4];
    pixels.insert(pixels.end(), {pair[i % 2], pair[2], pair[3]});
  }
  return pixels;
}

/// Red, green and blue of luma and chroma with 8 bits and full range (PS3.3 C.7.6.3.1.2).
void to_rgb(std::vector<std::byte>& pixels) {
  for (std::size_t at = 0; at + 3 <= pixels.size(); at += 3) {
    const double y = std::to_integer<int>(pixels[at]);
    const double cb = std::to_integer<int>(pixels[at + 1]) - 128.0;
    const double cr = std::to_integer<int>(pixels[at + 2]) - 128.0;
    const double rgb[3] = {y + 1.402 * cr, y - 0.344136 * cb - 0.714136 * cr, y + 1.772 * cb};
    for (std::size_t i = 0; i < 3; ++i)
      pixels[at + i] = static_cast<std::byte>(std::lround(std::clamp(rgb[i], 0.0, 255.0)));
  }
}

/// The colours or values that a palette gives to indices.
std::vector<std::byte> looked_up(const std::vector<std::byte>& indices, const DicomSlice& slice) {
  const DicomPalette& palette = *slice.palette;
  const auto last = static_cast<std::int64_t>(palette.channels[0].size()) - 1;
  Volume one;
  one.type = slice.type;
  one.voxels = indices;
  std::vector<std::byte> colors;
  visit_voxels(one, [&](auto voxels) {
    for (const auto index : voxels) {
      const auto entry = static_cast<std::size_t>(
          std::clamp<std::int64_t>(static_cast<std::int64_t>(index) - palette.first, 0, last));
      for (const auto& channel : palette.channels) {
        const auto* from = reinterpret_cast<const std::byte*>(&channel[entry]);
        const std::uint8_t narrow = static_cast<std::uint8_t>(channel[entry]);
        if (palette.wide)
          colors.insert(colors.end(), from, from + 2);
        else
          colors.push_back(static_cast<std::byte>(narrow));
      }
    }
  });
  return colors;
}

Result<std::vector<std::byte>> read_plain(const DicomSlice& file) {
  const auto bytes = SLF_TRY(read_dicom_bytes(file.path));
  const DicomFile elements = parse_dicom(file.path, bytes);
  const auto data = DicomLookup(elements.big_endian, {&elements.data}).raw(file.pixels_at);
  if (data.size() < file.file_bytes())
    return bad_file(file.path, "it has changed while it was read");
  const auto* from = reinterpret_cast<const std::byte*>(data.data());
  return std::vector<std::byte>(from, from + file.file_bytes());
}

/// A frame of a file with these pixels, as stored: what for_each_frame() visits.
std::vector<std::byte> frame_of(const DicomSlice& slice, std::span<const std::byte> file) {
  const std::uint64_t count = std::uint64_t{slice.width} * slice.height;
  if (slice.one_bit) return unpacked(file, slice.frame * count, count);
  const auto stored = file.subspan(slice.frame * slice.bytes(), slice.bytes());
  std::vector<std::byte> pixels(stored.begin(), stored.end());
  if (!slice.compressed && (slice.swapped > 1) == (std::endian::native == std::endian::little))
    swap_bytes(pixels, slice.swapped > 1 ? slice.swapped : bytes_per_voxel(slice.type));
  keep_stored_bits(pixels, slice);
  if (slice.palette) return looked_up(pixels, slice);
  if (slice.color == DicomColor::ybr_full_422 && !slice.compressed)
    pixels = with_full_chroma(pixels, count);
  else if (slice.planar)
    pixels = interleaved(pixels, slice);
  if (slice.color != DicomColor::grey && slice.color != DicomColor::rgb) to_rgb(pixels);
  return pixels;
}

}  // namespace

Result<void> for_each_frame(
    const std::vector<DicomSlice>& slices,
    const std::function<Result<void>(std::size_t, const std::vector<std::byte>&)>& visit) {
  std::map<std::string, std::vector<std::size_t>> by_file;
  for (std::size_t i = 0; i < slices.size(); ++i) by_file[slices[i].path].push_back(i);
  std::vector<DicomSlice> compressed;  // any slice of each such file
  for (const auto& [path, of_file] : by_file)
    if (slices[of_file.front()].compressed) compressed.push_back(slices[of_file.front()]);
  std::unique_ptr<DicomDecoder> decoder;
  for (const auto& [path, of_file] : by_file) {
    const DicomSlice& file = slices[of_file.front()];
    if (file.compressed && !decoder) decoder = SLF_TRY(DicomDecoder::start(compressed));
    const auto pixels = SLF_TRY(file.compressed ? decoder->read(file) : read_plain(file));
    for (const std::size_t i : of_file) SLF_TRY(visit(i, frame_of(slices[i], pixels)));
  }
  return {};
}

}  // namespace slf::volume_io
