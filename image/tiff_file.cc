#include "image/tiff_file.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <new>
#include <vector>

#include "base/file.h"
#include "base/try.h"

namespace slf::image_formats {
namespace {

// The largest expansion by an encoding that we read: that of runs by zstd. Only bounds buffers.
constexpr std::uint64_t kMaxExpansion = 4096;
constexpr std::uint32_t kMaxPages = 1u << 20;

int on_error(TIFF*, void* user, const char* module, const char* format, va_list arguments) {
  // Nothing here may throw: no exception may pass through libtiff.
  auto& text = *static_cast<decltype(TiffFile::message)*>(user);
  if (text[0] != 0) return 1;  // keep the first message, which is the most specific
  const int name = std::snprintf(text.data(), text.size() / 2, "%s: ", module ? module : "");
  const std::size_t at = std::min(static_cast<std::size_t>(std::max(name, 0)), text.size() / 2 - 1);
  std::vsnprintf(text.data() + at, text.size() - at, format, arguments);
  for (char& c : text)
    if (c != 0 && (c < 0x20 || c > 0x7e)) c = '?';
  return 1;
}

int on_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

using Options = std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)>;

Options options_for(TiffFile& file) {
  Options options(TIFFOpenOptionsAlloc(), &TIFFOpenOptionsFree);
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), on_error, &file.message);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), on_warning, nullptr);
  TIFFOpenOptionsSetMaxSingleMemAlloc(
      options.get(), static_cast<tmsize_t>(std::min<std::uint64_t>(
                         file.bytes * kMaxExpansion + (1u << 20), std::uint64_t{1} << 40)));
  return options;
}

/// A buffer for decoded rows. bad_file: the file is too short to expand to this size.
Result<std::vector<std::byte>> buffer(const TiffFile& file, std::uint64_t size) {
  if (size > file.bytes * kMaxExpansion)
    return bad_file(file.path, "page ", file.page, " claims ", size,
                    " bytes in a strip or tile, more than its ", file.bytes, " bytes can hold");
  return std::vector<std::byte>(size);
}

}  // namespace

bool looks_like_tiff(std::string_view head) {
  for (const std::string_view magic : {std::string_view("II*\0", 4), std::string_view("MM\0*", 4),
                                       std::string_view("II+\0", 4), std::string_view("MM\0+", 4)})
    if (head.starts_with(magic)) return true;
  return false;
}

Result<std::unique_ptr<TiffFile>> TiffFile::open(const std::string& path) {
  auto file = std::make_unique<TiffFile>();
  file->path = path;
  file->bytes = SLF_TRY(file_size(path));
  file->tiff.reset(TIFFOpenExt(path.c_str(), "rm", options_for(*file).get()));
  if (!file->tiff) return file->damaged();
  return file;
}

Result<std::unique_ptr<TiffFile>> TiffFile::open(const std::string& name, ByteSpan bytes) {
  auto file = std::make_unique<TiffFile>();
  file->path = name;
  file->bytes = bytes.size();
  const int memory = ::memfd_create("tiff", MFD_CLOEXEC);
  if (memory < 0 || write_all(memory, bytes, 0) != 0) {
    if (memory >= 0) ::close(memory);
    return fail(ErrorCode::out_of_memory, name, ": no memory to read it");
  }
  file->tiff.reset(TIFFFdOpenExt(memory, name.c_str(), "rm", options_for(*file).get()));
  if (file->tiff) return file;
  ::close(memory);
  return file->damaged();
}

tl::unexpected<Error> TiffFile::damaged() const {
  return bad_file(path, "page ", page,
                  ": damaged TIFF: ", message[0] == 0 ? "cannot be decoded" : message.data());
}

std::string TiffFile::text(std::uint32_t id) const {
  char* value = nullptr;
  return TIFFGetField(tiff.get(), id, &value) && value ? value : "";
}

Result<bool> TiffFile::next() {
  message[0] = 0;
  if (TIFFLastDirectory(tiff.get())) return false;
  if (++page >= kMaxPages) return unsupported(path, "more than ", kMaxPages, " pages");
  if (!TIFFReadDirectory(tiff.get())) return damaged();
  return true;
}

Result<void> TiffFile::go_to(std::uint64_t offset) {
  message = {};
  page = 0;
  if (!TIFFSetSubDirectory(tiff.get(), offset)) return damaged();
  return {};
}

Result<bool> TiffFile::skip_thumbnails() {
  while (is_thumbnail()) {
    const auto more = SLF_TRY(next());
    if (!more) return false;
  }
  return true;
}

bool TiffFile::is_thumbnail() const {
  return (tag<std::uint32_t>(TIFFTAG_SUBFILETYPE, 0) & (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) !=
         0;
}

Result<void> check_compression(const TiffFile& file) {
  const auto compression = file.tag<std::uint16_t>(TIFFTAG_COMPRESSION, COMPRESSION_NONE);
  for (const int read :
       {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_JPEG, COMPRESSION_ADOBE_DEFLATE,
        COMPRESSION_DEFLATE, COMPRESSION_PACKBITS, COMPRESSION_LZMA, COMPRESSION_ZSTD,
        COMPRESSION_CCITTRLE, COMPRESSION_CCITTFAX3, COMPRESSION_CCITTFAX4})
    if (compression == read) return {};
  return unsupported(file.path, "compression ", compression,
                     ", expected none, LZW, deflate, PackBits, JPEG, LZMA, zstd or CCITT fax");
}

bool has_planes(const TiffFile& file) {
  return file.tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL, 1) > 1 &&
         file.tag<std::uint16_t>(TIFFTAG_PLANARCONFIG, 1) == PLANARCONFIG_SEPARATE;
}

Result<void> read_rows(TiffFile& file, const TiffRows& rows, std::uint32_t plane_index,
                       const TakeRows& take) {
  TIFF* tiff = file.tiff.get();
  if (file.tag<std::uint16_t>(TIFFTAG_COMPRESSION, COMPRESSION_NONE) == COMPRESSION_JPEG)
    TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
  const std::uint64_t row = rows.pixel * rows.width;
  const auto plane = static_cast<std::uint16_t>(plane_index);
  if (!TIFFIsTiled(tiff)) {
    const std::uint32_t strip = std::clamp<std::uint32_t>(
        file.tag<std::uint32_t>(TIFFTAG_ROWSPERSTRIP, rows.height), 1, rows.height);
    for (std::uint32_t y = 0; y < rows.height; y += strip) {
      const std::uint32_t count = std::min(strip, rows.height - y);
      auto band = SLF_TRY(buffer(file, row * count));
      const auto got = TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y, plane), band.data(),
                                            static_cast<tmsize_t>(band.size()));
      if (got != static_cast<tmsize_t>(band.size())) return file.damaged();
      SLF_TRY(take(band));
    }
    return {};
  }
  const auto across = file.tag<std::uint32_t>(TIFFTAG_TILEWIDTH, 0);
  const auto down = file.tag<std::uint32_t>(TIFFTAG_TILELENGTH, 0);
  if (across == 0 || down == 0 || across > (1u << 20) || down > (1u << 20))
    return bad_file(file.path, "tiles of ", across, "x", down, " pixels");
  auto tile = SLF_TRY(buffer(file, rows.pixel * across * down));
  if (TIFFTileSize(tiff) != static_cast<tmsize_t>(tile.size())) return file.damaged();
  for (std::uint32_t y = 0; y < rows.height; y += down) {
    const std::uint32_t count = std::min(down, rows.height - y);
    auto band = SLF_TRY(buffer(file, row * count));
    for (std::uint32_t x = 0; x < rows.width; x += across) {
      if (TIFFReadEncodedTile(tiff, TIFFComputeTile(tiff, x, y, 0, plane), tile.data(),
                              static_cast<tmsize_t>(tile.size())) < 0)
        return file.damaged();
      const std::size_t part = std::min(across, rows.width - x) * rows.pixel;
      for (std::uint32_t r = 0; r < count; ++r)
        std::copy_n(tile.data() + r * across * rows.pixel, part,
                    band.data() + r * row + x * rows.pixel);
    }
    SLF_TRY(take(band));
  }
  return {};
}

}  // namespace slf::image_formats
