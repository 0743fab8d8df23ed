// Packed streams: gzip, zlib, bzip2, xz and zstd, recognised by their first bytes.
//
// Packed input is untrusted. The memory for unpacking is limited (256 MiB for the dictionary of xz,
// 128 MiB for the window of zstd), and a few bytes may not unpack to much more than a volume needs:
// see max_unpacked().
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "base/file.h"
#include "slf/error.h"

namespace slf::volume_io {

enum class Packing { none, gzip, zlib, deflate, bzip2, xz, zstd };

/// By the first bytes of a file. Never zlib or deflate, which begin like anything else.
[[nodiscard]] Packing packing_of(std::string_view head);
/// Whether another member of a stream may begin with this byte.
[[nodiscard]] bool begins_member(Packing packing, std::byte first);
/// The packing of a file by its bytes from `offset` on; none if it cannot be read.
[[nodiscard]] Packing packing_of_file(const std::string& path, std::uint64_t offset = 0);
[[nodiscard]] const char* name(Packing packing);

/// The most bytes that `packed` bytes of a file may become. Deflate cannot expand more than 1032:1.
/// The others can, by far: theirs may become 4 GiB, or as much as deflate.
[[nodiscard]] std::uint64_t max_unpacked(Packing packing, std::uint64_t packed);

/// Unpacks a stream piece by piece.
class Unpacker {
 public:
  enum class State { more, ended, damaged };
  [[nodiscard]] static std::unique_ptr<Unpacker> make(Packing packing);
  Unpacker() = default;
  Unpacker(const Unpacker&) = delete;
  Unpacker& operator=(const Unpacker&) = delete;
  virtual ~Unpacker() = default;
  /// Consumes bytes from the front of `in` and fills the front of `out`, and moves both past them.
  /// `ended`: this was the last byte of the stream; restart() makes ready for another.
  virtual State step(std::span<const std::byte>& in, std::span<std::byte>& out) = 0;
  [[nodiscard]] virtual bool restart() = 0;
  /// Why the data are damaged.
  [[nodiscard]] virtual std::string problem() const = 0;
};

/// The content of a packed file, at most `limit` bytes.
/// bad_file: damaged, or cut off. unsupported: longer.
[[nodiscard]] Result<std::string> read_unpacked(const std::string& path, std::size_t limit);

/// The content of a packed file as a file without a name, which exists as long as this object: for
/// readers that need to seek, or whose library opens files.
class UnpackedFile {
 public:
  /// bad_file: damaged, or cut off. unsupported: more than 1 GiB and 100 times its size. io: there
  /// is no room in the folder for temporary files.
  [[nodiscard]] static Result<UnpackedFile> make(const std::string& path);
  /// A path that opens it in this process and its children.
  [[nodiscard]] std::string path() const;

 private:
  explicit UnpackedFile(Descriptor file) : file_(std::move(file)) {}
  Descriptor file_;
};

}  // namespace slf::volume_io
