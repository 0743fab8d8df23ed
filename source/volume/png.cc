// PNG slices through libpng, all bits as they are stored.
#include <png.h>

#include <array>
#include <bit>
#include <csetjmp>
#include <cstdio>
#include <fstream>

#include "base/try.h"
#include "source/volume/stack.h"

namespace slf::volume_io {

namespace {

/// libpng reports errors by longjmp. All objects that must be freed or filled are in this struct,
/// outside of the frames that a longjmp skips.
struct Reader {
  std::ifstream file;
  std::uint64_t bytes = 0;  ///< of the file
  std::array<char, 128> message{};
  png_structp png = nullptr;
  png_infop info = nullptr;
  SliceKind kind;
  std::vector<std::byte> samples;
  std::vector<png_bytep> rows;

  Reader() = default;
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
};

void on_error(png_structp png, png_const_charp message) {
  auto& to = static_cast<Reader*>(png_get_error_ptr(png))->message;
  std::snprintf(to.data(), to.size(), "%s", message);  // a std::string might throw
  png_longjmp(png, 1);
}

void on_warning(png_structp, png_const_charp) {}

void on_read(png_structp png, png_bytep to, std::size_t count) {
  auto& reader = *static_cast<Reader*>(png_get_io_ptr(png));
  if (!reader.file.read(reinterpret_cast<char*>(to), static_cast<std::streamsize>(count)))
    png_error(png, "the file ends early");
}

/// Reads the header, and requests pixels of 8 or 16 bits with 1 to 4 channels. Unless `as_stored`,
/// palettes become colours, and few bits 8.
bool read_header(Reader& reader, bool as_stored) {
  if (setjmp(png_jmpbuf(reader.png))) return false;
  png_read_info(reader.png, reader.info);
  if (as_stored)
    png_set_packing(reader.png);
  else
    png_set_expand(reader.png);
  if constexpr (std::endian::native == std::endian::little) png_set_swap(reader.png);
  png_set_interlace_handling(reader.png);
  png_read_update_info(reader.png, reader.info);
  reader.kind = {
      .width = png_get_image_width(reader.png, reader.info),
      .height = png_get_image_height(reader.png, reader.info),
      .components = png_get_channels(reader.png, reader.info),
      .type = png_get_bit_depth(reader.png, reader.info) == 16 ? ScalarType::u16 : ScalarType::u8,
      .alpha = (png_get_color_type(reader.png, reader.info) & PNG_COLOR_MASK_ALPHA) != 0};
  return true;
}

bool read_pixels(Reader& reader) {
  if (setjmp(png_jmpbuf(reader.png))) return false;
  png_read_image(reader.png, reader.rows.data());
  png_read_end(reader.png, nullptr);
  return true;
}

tl::unexpected<Error> damaged(const std::string& path, const Reader& reader) {
  return bad_file(path, "damaged PNG: ", reader.message.data());
}

/// Reads a file up to its pixels.
Result<void> begin_png(const std::string& path, bool as_stored, Reader& reader) {
  reader.bytes = SLF_TRY(file_size(path));
  reader.file = SLF_TRY(open_regular(path));
  reader.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reader, on_error, on_warning);
  if (reader.png) reader.info = png_create_info_struct(reader.png);
  if (!reader.info) return fail(ErrorCode::out_of_memory, path, ": no memory to read it");
  png_set_read_fn(reader.png, &reader, on_read);
  if (!read_header(reader, as_stored)) return damaged(path, reader);
  return {};
}

/// Reads the pixels.
Result<void> finish_png(const std::string& path, Reader& reader) {
  const SliceKind& kind = reader.kind;
  const std::size_t row = std::size_t{kind.width} * kind.components * bytes_per_voxel(kind.type);
  // Deflate packs at most 1032:1, and few bits were expanded at most 8 times, palettes 4 times
  // more.
  if (row > reader.bytes * 1032 * 32 / kind.height + 1)
    return bad_file(path, describe(kind), " cannot be in ", reader.bytes, " bytes");
  reader.samples.resize(row * kind.height);
  for (std::uint32_t y = 0; y < kind.height; ++y)
    reader.rows.push_back(reinterpret_cast<png_bytep>(reader.samples.data() + y * row));
  if (!read_pixels(reader)) return damaged(path, reader);
  return {};
}

}  // namespace

bool looks_like_png(std::string_view head) { return head.starts_with("\x89PNG\r\n\x1a\n"); }

Result<std::uint64_t> append_png(const std::string& path, const VolumeOptions& options,
                                 std::optional<SliceKind>& kind, std::vector<std::byte>& voxels) {
  Reader reader;
  SLF_TRY(begin_png(path, options.labels, reader));
  SLF_TRY(same_kind(path, reader.kind, kind));
  const auto taker = SLF_TRY(ComponentSelector::make(path, *kind, options));
  SLF_TRY(finish_png(path, reader));
  SLF_TRY(taker.append(reader.samples, voxels));
  return 1;
}

Result<SliceKind> read_png_as_stored(const std::string& path, std::vector<std::byte>& samples) {
  Reader reader;
  SLF_TRY(begin_png(path, true, reader));
  SLF_TRY(finish_png(path, reader));
  samples = std::move(reader.samples);
  return reader.kind;
}

}  // namespace slf::volume_io
