// TIFF files through libtiff, for pictures here and for stacks in source/volume. Internal.
//
// Only the encodings that are usual reach libtiff's decoders. The size of each buffer is checked
// against the size of the file before it is allocated.
#pragma once

#include <tiffio.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::image_formats {

/// Whether a file that begins so is a TIFF, or a BigTIFF.
[[nodiscard]] bool looks_like_tiff(std::string_view head);

/// A TIFF file at one of its pages. Thread-safety: none; one thread.
class TiffFile {
 public:
  /// Opens a file at its first page. not_found: no such file. io: not a regular file, or cannot be
  /// read. bad_file: damaged.
  [[nodiscard]] static Result<std::unique_ptr<TiffFile>> open(const std::string& path);
  /// The same of a copy of bytes; `name` is for messages. out_of_memory: none for the copy.
  [[nodiscard]] static Result<std::unique_ptr<TiffFile>> open(const std::string& name,
                                                              ByteSpan bytes);

  /// What libtiff said last, as an error that names the page.
  [[nodiscard]] tl::unexpected<Error> damaged() const;
  template <class T>
  T tag(std::uint32_t id, T otherwise) const {
    T value{};
    return TIFFGetFieldDefaulted(tiff.get(), id, &value) ? value : otherwise;
  }
  [[nodiscard]] std::string text(std::uint32_t id) const;
  /// The next page; false at the end. bad_file: a page that cannot be read.
  Result<bool> next();
  /// Moves to the page whose directory is at `offset` of the file.
  Result<void> go_to(std::uint64_t offset);
  /// Moves to the first page that is no thumbnail; false, and to the last one, if there is none.
  Result<bool> skip_thumbnails();
  /// A reduced copy of another page, or its mask, which some writers add.
  [[nodiscard]] bool is_thumbnail() const;

  struct Close {
    void operator()(TIFF* handle) const { TIFFClose(handle); }
  };
  std::string path;  ///< or name
  std::uint64_t bytes = 0;
  std::uint32_t page = 0;
  std::array<char, 512> message{};
  std::unique_ptr<TIFF, Close> tiff;
};

/// unsupported: the page is compressed in a way that is not read.
[[nodiscard]] Result<void> check_compression(const TiffFile& file);

/// Whether each component of a page is stored as a plane of its own.
[[nodiscard]] bool has_planes(const TiffFile& file);

/// How the samples of a page lie in memory.
struct TiffRows {
  std::uint32_t width = 0, height = 0;  ///< above 0
  std::uint64_t pixel = 0;              ///< bytes, of all samples that lie side by side
};
using TakeRows = std::function<Result<void>(std::span<const std::byte>)>;

/// Calls `take` with the rows of a plane of this page, by strips or by rows of tiles, so that
/// memory grows with the data that were decoded. JPEG becomes RGB.
[[nodiscard]] Result<void> read_rows(TiffFile& file, const TiffRows& rows, std::uint32_t plane,
                                     const TakeRows& take);

}  // namespace slf::image_formats
