// The array of a VTK ImageData file: text, base64 or raw bytes, plain or in packed blocks.
#include <lz4.h>

#include <algorithm>
#include <array>
#include <bit>
#include <functional>

#include "base/base64.h"
#include "base/bytes.h"
#include "base/try.h"
#include "source/volume/io.h"
#include "source/volume/vtk/vti_file.h"

namespace slf::volume_io {
namespace {

/// Fills `to` with the next bytes of the data, or returns how many there were.
using Source = std::function<Result<std::size_t>(std::span<std::byte> to)>;

Source from_base64(std::string_view text) {
  return [bytes = decode_base64(text, true), at = std::size_t{0}](std::span<std::byte> to) mutable {
    const std::size_t count = std::min(to.size(), bytes.size() - at);
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), count, to.begin());
    at += count;
    return Result<std::size_t>(count);
  };
}

/// Reads one of the integers before the data.
Result<std::uint64_t> read_count(const VtiDocument& d, const Source& source,
                                 const std::string& path) {
  std::array<std::byte, 8> bytes{};
  const std::size_t width = d.wide_header ? 8 : 4;
  const auto got = SLF_TRY(source(std::span(bytes).first(width)));
  if (got != width) return bad_file(path, "its data end before their own length");
  if (width == 8)
    return d.big_endian ? load_be<std::uint64_t>(bytes.data())
                        : load_le<std::uint64_t>(bytes.data());
  return d.big_endian ? load_be<std::uint32_t>(bytes.data()) : load_le<std::uint32_t>(bytes.data());
}

/// Unpacks a block. False: it is damaged, or has another size.
using Unpack = bool (*)(std::span<const std::byte> in, std::span<std::byte> out);

template <Packing packing>
bool unpack_stream(std::span<const std::byte> in, std::span<std::byte> out) {
  const auto unpacker = Unpacker::make(packing);
  auto state = Unpacker::State::more;
  // The second step reads the checksum, if the first filled `out` before.
  for (int step = 0; step < 2 && state == Unpacker::State::more; ++step)
    state = unpacker->step(in, out);
  return state == Unpacker::State::ended && out.empty();
}

bool unpack_lz4(std::span<const std::byte> in, std::span<std::byte> out) {
  return LZ4_decompress_safe(reinterpret_cast<const char*>(in.data()),
                             reinterpret_cast<char*>(out.data()), static_cast<int>(in.size()),
                             static_cast<int>(out.size())) == static_cast<int>(out.size());
}

struct Compressor {
  const char* name;
  Unpack unpack;
  std::uint64_t max_expansion;  ///< the most bytes that one can become, by the format
};

constexpr std::array<Compressor, 3> kCompressors = {
    {{"vtkZLibDataCompressor", unpack_stream<Packing::zlib>, 1032},
     {"vtkLZ4DataCompressor", unpack_lz4, 255},
     {"vtkLZMADataCompressor", unpack_stream<Packing::xz>, 8192}}};

/// Decodes packed blocks into `to`, which grows with the decoded data.
Result<void> read_blocks(const VtiDocument& d, const Compressor& compressor, const Source& source,
                         std::uint64_t needed, std::vector<std::byte>& to) {
  const std::string& path = d.path;
  std::array<std::uint64_t, 3> head{};  // blocks, bytes of a block, bytes of the last
  for (auto& count : head) {
    count = SLF_TRY(read_count(d, source, path));
  }
  const auto [blocks, block, last] = head;
  constexpr std::uint64_t kMaxBlockBytes = std::uint64_t{1} << 30;
  const auto file_bytes = SLF_TRY(file_size(path));
  if (blocks == 0 || block == 0 || block > kMaxBlockBytes || last > block ||
      blocks > needed / block + 1 || (blocks - (last ? 1 : 0)) * block + last != needed)
    return bad_file(path, blocks, " packed blocks of ", block, " bytes (the last of ", last,
                    "), expected ", needed, " bytes");
  std::vector<std::uint64_t> packed;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    const auto size = SLF_TRY(read_count(d, source, path));
    packed.push_back(size);
  }
  std::vector<std::byte> in, out;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    const std::uint64_t size = i + 1 == blocks && last ? last : block;
    if (packed[i] > std::min(kMaxBlockBytes, file_bytes) ||
        size > (packed[i] + 1) * compressor.max_expansion)
      return bad_file(path, "packed block ", i, " of ", packed[i], " bytes cannot hold ", size);
    in.resize(packed[i]);
    const auto got = SLF_TRY(source(in));
    out.resize(size);
    if (got != in.size() || !compressor.unpack(in, out))
      return bad_file(path, "packed block ", i, " of ", blocks, " is damaged or cut off");
    to.insert(to.end(), out.begin(), out.end());
  }
  return {};
}

/// Reads all numbers of the array as bytes, in native order, components side by side.
Result<std::vector<std::byte>> read_packed(const VtiDocument& d, const VtiArray& array,
                                           const Compressor* compressor, const Source& source,
                                           ScalarType type, std::uint64_t needed) {
  const std::string& path = d.path;
  std::vector<std::byte> bytes;
  if (compressor) {
    SLF_TRY(read_blocks(d, *compressor, source, needed, bytes));
  } else {
    const auto count = SLF_TRY(read_count(d, source, path));
    if (count != needed)
      return bad_file(path, "the array ", in_quotes(array.name), " holds ", count,
                      " bytes, expected ", needed);
    bytes.resize(needed);
    const auto got = SLF_TRY(source(bytes));
    if (got != needed)
      return bad_file(path, "expected ", needed, " bytes of voxels, found ", got,
                      ": the file is truncated");
  }
  if (d.big_endian != (std::endian::native == std::endian::big))
    swap_bytes(bytes, bytes_per_voxel(type));
  return bytes;
}

Result<std::vector<std::byte>> read_ascii(const VtiDocument& d, const VtiArray& array,
                                          ScalarType type, std::uint64_t needed) {
  std::vector<std::byte> bytes;
  for (const auto word : words(array.text)) {
    if (!append_number(word, type, bytes))
      return bad_file(d.path, "the array ", in_quotes(array.name), " holds ", in_quotes(word),
                      ", expected numbers of type ", name(type));
    if (bytes.size() > needed) break;
  }
  if (bytes.size() != needed)
    return bad_file(d.path, "the array ", in_quotes(array.name),
                    " holds another count of numbers than its extent");
  return bytes;
}

/// The offset of the appended data, after an underscore that blanks may precede.
Result<std::uint64_t> find_appended(const std::string& path, std::uint64_t from) {
  auto reader = SLF_TRY(ByteReader::open(path, from, false));
  const auto text = SLF_TRY(reader.read_text(256));
  const auto underscore = text.find('_');
  if (underscore != std::string::npos) return from + underscore + 1;
  return bad_file(path, "its appended data do not begin with '_'");
}

}  // namespace

Result<std::vector<std::byte>> read_vti_data(const VtiDocument& d, const VtiArray& array,
                                             ScalarType type, std::uint64_t needed) {
  const std::string& path = d.path;
  if (array.format == "ascii") return read_ascii(d, array, type, needed);
  const Compressor* compressor = nullptr;
  for (const auto& known : kCompressors)
    if (d.compressor == known.name) compressor = &known;
  if (!compressor && !d.compressor.empty())
    return unsupported(
        path, "packed by ", in_quotes(d.compressor),
        ", expected ZLib, LZ4 or LZMA: save it with one of these, or without compression");
  const auto size = SLF_TRY(file_size(path));
  if (needed / (compressor ? compressor->max_expansion : 1) > size)
    return bad_file(path, "its extent needs ", needed, " bytes of voxels, but the file holds ",
                    size, compressor ? " packed" : "", ": it is truncated, or its extent is wrong");
  if (array.format == "binary")
    return read_packed(d, array, compressor, from_base64(array.text), type, needed);
  const auto begin = SLF_TRY(find_appended(path, d.appended));
  if (array.offset > size - begin)
    return bad_file(path, "the array ", in_quotes(array.name), " begins ", array.offset,
                    " bytes into the appended data, beyond the end of the file");
  auto reader = SLF_TRY(ByteReader::open(path, begin + array.offset, false));
  if (d.appended_raw)
    return read_packed(
        d, array, compressor, [&](std::span<std::byte> to) { return reader.read(to); }, type,
        needed);
  const auto text = SLF_TRY(reader.read_text(size - begin - array.offset));
  return read_packed(d, array, compressor, from_base64(text), type, needed);
}

}  // namespace slf::volume_io
