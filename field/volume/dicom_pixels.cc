// The pixels of DICOM files: our own parser reads plain ones, DicomDecoder compressed ones.
#include <bit>
#include <cstring>
#include <type_traits>

#include "field/volume/dicom.h"
#include "field/volume/dicom_decode.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::uint32_t kPixelData = 0x7fe00010;

/// Clears the bits that are not stored (old files have overlays there) and extends the sign.
template <class T>
void keep_stored_bits_of(std::vector<std::byte>& pixels, const DicomSlice& slice) {
  constexpr unsigned kBits = 8 * sizeof(T);
  if (slice.bits_stored == kBits) return;
  const unsigned left = kBits - 1 - slice.high_bit;
  const unsigned right = kBits - slice.bits_stored;
  for (std::size_t at = 0; at < pixels.size(); at += sizeof(T)) {
    std::make_unsigned_t<T> raw;
    std::memcpy(&raw, pixels.data() + at, sizeof(T));
    const T kept =
        static_cast<T>(static_cast<T>(static_cast<std::make_unsigned_t<T>>(raw << left)) >> right);
    std::memcpy(pixels.data() + at, &kept, sizeof(T));
  }
}

void keep_stored_bits(std::vector<std::byte>& pixels, const DicomSlice& slice) {
  switch (slice.type) {
    case ScalarType::u8:
      return keep_stored_bits_of<std::uint8_t>(pixels, slice);
    case ScalarType::i8:
      return keep_stored_bits_of<std::int8_t>(pixels, slice);
    case ScalarType::u16:
      return keep_stored_bits_of<std::uint16_t>(pixels, slice);
    case ScalarType::i16:
      return keep_stored_bits_of<std::int16_t>(pixels, slice);
    case ScalarType::u32:
      return keep_stored_bits_of<std::uint32_t>(pixels, slice);
    default:
      return keep_stored_bits_of<std::int32_t>(pixels, slice);
  }
}

Result<std::vector<std::byte>> read_plain(const DicomSlice& file) {
  const auto bytes = read_dicom_bytes(file.path);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto elements = parse_dicom(file.path, *bytes);
  if (!elements) return tl::unexpected(elements.error());
  const auto found = elements->values.find(kPixelData);
  const std::string_view data = found == elements->values.end() ? "" : found->second;
  const std::uint64_t needed = file.bytes() * file.frames;
  if (data.size() < needed)
    return fail(ErrorCode::bad_file, file.path, ": ", file.frames, " frames of ", file.height, "x",
                file.width, " pixels of ", name(file.type), " need ", needed,
                " bytes, PixelData holds ", data.size());
  const auto* from = reinterpret_cast<const std::byte*>(data.data());
  std::vector<std::byte> pixels(from, from + needed);
  if (std::endian::native == std::endian::big) swap_bytes(pixels, bytes_per_voxel(file.type));
  return pixels;
}

}  // namespace

DicomPixelReader::DicomPixelReader(std::vector<DicomSlice> files) : files_(std::move(files)) {}
DicomPixelReader::DicomPixelReader(DicomPixelReader&&) noexcept = default;
DicomPixelReader& DicomPixelReader::operator=(DicomPixelReader&&) noexcept = default;
DicomPixelReader::~DicomPixelReader() = default;

Result<std::vector<std::byte>> DicomPixelReader::next() {
  const DicomSlice& file = files_[at_++];
  if (file.compressed && !decoder_) {
    std::vector<DicomSlice> compressed;
    for (const auto& each : files_)
      if (each.compressed) compressed.push_back(each);
    auto decoder = DicomDecoder::start(compressed);
    if (!decoder) return tl::unexpected(decoder.error());
    decoder_ = std::move(*decoder);
  }
  auto pixels = file.compressed ? decoder_->read(file) : read_plain(file);
  if (pixels) keep_stored_bits(*pixels, file);
  return pixels;
}

}  // namespace slf::volume_io
