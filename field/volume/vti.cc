// VTK ImageData (.vti), https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html.
//
// Expat parses the XML; this file interprets it. Why not VTK's own reader? It allocates by extents
// that it does not check, and reports on stderr.
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/bytes.h"
#include "field/volume/io.h"
#include "field/volume/xml.h"

namespace slf::volume_io {

namespace {

struct Array {
  bool found = false;
  std::string name, type, format;
  std::uint32_t components = 1;
  std::uint64_t offset = 0;
  std::string text{};  ///< content of the element: numbers, or base64
};

struct Document {
  std::string type, compressor;
  bool big_endian = false, wide_header = false;
  std::string extent, origin, spacing, direction;
  int pieces = 0;
  std::string piece_extent;
  std::string scalars;    ///< the array that the file calls its scalars
  bool of_cells = false;  ///< no point data: values belong to cells
  Array array{};
  int others = 0;  ///< other arrays
  bool appended_raw = false;
  std::uint64_t appended = 0;  ///< byte after the tag of the appended data; 0: none
};

std::string get(const XmlAttributes& attributes, std::string_view key) {
  const auto found = attributes.find(key);
  return found == attributes.end() ? "" : found->second;
}

Result<Document> read_document(const std::string& path) {
  Document d;
  std::string inside;       // "PointData" or "CellData"
  bool collecting = false;  // the text of the chosen array
  std::string problem;
  const auto take_array = [&](const XmlAttributes& attributes) {
    const std::string name = get(attributes, "Name");
    const bool preferred = !d.scalars.empty() && name == d.scalars;
    if (inside.empty() || (d.array.found && !preferred)) {
      d.others += inside.empty() ? 0 : 1;
      return;
    }
    d.others += d.array.found ? 1 : 0;
    d.array = {.found = true,
               .name = name,
               .type = get(attributes, "type"),
               .format = lower(get(attributes, "format"))};
    d.of_cells = inside == "CellData";
    const auto components = attributes.contains("NumberOfComponents")
                                ? parse_integer(get(attributes, "NumberOfComponents"))
                                : 1;
    const auto offset =
        attributes.contains("offset") ? parse_integer(get(attributes, "offset")) : 0;
    if (!components || *components < 1 || *components > 4096 || !offset || *offset < 0)
      problem = "components or offset of the array " + in_quotes(name);
    d.array.components = static_cast<std::uint32_t>(components.value_or(1));
    d.array.offset = static_cast<std::uint64_t>(offset.value_or(0));
    collecting = true;
  };
  const XmlHandler handler{
      .start =
          [&](std::string_view name, const XmlAttributes& a) {
            if (name == "VTKFile") {
              d.type = get(a, "type");
              d.compressor = get(a, "compressor");
              d.big_endian = get(a, "byte_order") == "BigEndian";
              d.wide_header = get(a, "header_type") == "UInt64";
            } else if (name == "ImageData") {
              d.extent = get(a, "WholeExtent");
              d.origin = get(a, "Origin");
              d.spacing = get(a, "Spacing");
              d.direction = get(a, "Direction");
            } else if (name == "Piece") {
              ++d.pieces;
              d.piece_extent = get(a, "Extent");
            } else if (name == "PointData" || (name == "CellData" && !d.array.found)) {
              inside = name;
              d.scalars = get(a, "Scalars");
            } else if (name == "DataArray") {
              take_array(a);
            } else if (name == "AppendedData") {
              d.appended_raw = lower(get(a, "encoding")) == "raw";
              return false;  // what follows need not be XML
            }
            return true;
          },
      .end =
          [&](std::string_view name) {
            if (name == "PointData" || name == "CellData") inside.clear();
            if (name == "DataArray") collecting = false;
          },
      .text =
          [&](std::string_view text) {
            if (collecting) d.array.text += text;
          }};
  const auto end = read_xml(path, handler);
  if (!end) return tl::unexpected(end.error());
  if (!problem.empty()) return fail(ErrorCode::bad_file, path, ": absurd ", problem);
  d.appended = *end;
  return d;
}

Result<std::vector<double>> numbers(const std::string& path, const char* what,
                                    const std::string& text, std::size_t count, double otherwise) {
  if (text.empty()) return std::vector<double>(count, otherwise);
  std::vector<double> result;
  for (const auto word : words(text)) {
    const auto value = parse_number(word);
    if (!value || !std::isfinite(*value) || result.size() == count)
      return fail(ErrorCode::bad_file, path, ": ", what, " is ", in_quotes(text), ", expected ",
                  count, " numbers");
    result.push_back(*value);
  }
  if (result.size() != count)
    return fail(ErrorCode::bad_file, path, ": ", what, " is ", in_quotes(text), ", expected ",
                count, " numbers");
  return result;
}

/// Sets dims and position from the extent of the one piece.
Result<void> set_position(const Document& d, Volume& volume) {
  const std::string& path = volume.source;
  const auto extent =
      numbers(path, "Extent", d.piece_extent.empty() ? d.extent : d.piece_extent, 6, 0);
  if (!extent) return tl::unexpected(extent.error());
  const auto origin = numbers(path, "Origin", d.origin, 3, 0);
  if (!origin) return tl::unexpected(origin.error());
  const auto spacing = numbers(path, "Spacing", d.spacing, 3, 1);
  if (!spacing) return tl::unexpected(spacing.error());
  auto direction = numbers(path, "Direction", d.direction, 9, 0);
  if (!direction) return tl::unexpected(direction.error());
  if (d.direction.empty())
    for (const std::size_t i : {0, 4, 8}) (*direction)[i] = 1;

  std::vector<std::uint64_t> sizes;
  glm::dvec3 first;
  for (std::size_t i = 0; i < 3; ++i) {
    const double low = (*extent)[2 * i], high = (*extent)[2 * i + 1];
    const double size = high - low + (d.of_cells ? 0 : 1);
    if (!(std::abs(low) < 0x1p31) || !(std::abs(high) < 0x1p31) || !(size >= 1))
      return fail(ErrorCode::bad_file, path, ": Extent ", low, " to ", high, " along ", "xyz"[i],
                  " holds no voxels");
    sizes.push_back(static_cast<std::uint64_t>(size));
    first[static_cast<int>(i)] = low + (d.of_cells ? 0.5 : 0);
    if (!((*spacing)[i] > 0))
      return fail(ErrorCode::bad_file, path, ": Spacing ", (*spacing)[i], " along ", "xyz"[i],
                  ", expected a positive number");
  }
  const auto dims = check_dims(path, sizes);
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t row = 0; row < 3; ++row)  // the matrix is written row by row
      volume.axes[static_cast<int>(axis)][static_cast<int>(row)] =
          (*direction)[3 * row + axis] * (*spacing)[axis];
  volume.origin = glm::dvec3((*origin)[0], (*origin)[1], (*origin)[2]) + volume.axes * first;
  return check_axes(volume);
}

/// A stream of bytes, from a file or from base64 text.
class Source {
 public:
  virtual ~Source() = default;
  /// Fills `to`, or returns how many bytes there were.
  [[nodiscard]] virtual Result<std::size_t> read(std::span<std::byte> to) = 0;
  /// Call where a new base64 sequence begins.
  virtual void begin_sequence() {}
};

class FileSource final : public Source {
 public:
  explicit FileSource(ByteReader reader) : reader_(std::move(reader)) {}
  Result<std::size_t> read(std::span<std::byte> to) override { return reader_.read(to); }

 private:
  ByteReader reader_;
};

class Base64Source final : public Source {
 public:
  explicit Base64Source(std::string_view text) : text_(text) {}

  Result<std::size_t> read(std::span<std::byte> to) override {
    std::size_t done = 0;
    while (done < to.size()) {
      if (used_ == decoded_.size() && !decode()) break;
      to[done++] = decoded_[used_++];
    }
    return done;
  }
  void begin_sequence() override { used_ = decoded_.size(); }

 private:
  static int value_of(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
  }

  /// The next four characters; false at the end, or at one that is not base64.
  bool decode() {
    unsigned bits = 0;
    int count = 0, padding = 0;
    for (; count < 4 && at_ < text_.size(); ++at_) {
      const char c = text_[at_];
      if (c == ' ' || c == '\t' || c == '\r' || c == '\n') continue;
      const int value = c == '=' ? 0 : value_of(c);
      if (value < 0 || (padding > 0 && c != '=')) return false;
      padding += c == '=';
      bits = bits << 6 | static_cast<unsigned>(value);
      ++count;
    }
    if (count < 4 || padding > 2) return false;
    decoded_.clear();
    used_ = 0;
    for (int i = 0; i < 3 - padding; ++i)
      decoded_.push_back(static_cast<std::byte>(bits >> (16 - 8 * i) & 0xff));
    return true;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  std::vector<std::byte> decoded_;
  std::size_t used_ = 0;
};

/// Reads one of the integers before the data.
Result<std::uint64_t> read_count(const Document& d, Source& source, const std::string& path) {
  std::array<std::byte, 8> bytes{};
  const std::size_t width = d.wide_header ? 8 : 4;
  const auto got = source.read(std::span(bytes).first(width));
  if (!got) return tl::unexpected(got.error());
  if (*got != width)
    return fail(ErrorCode::bad_file, path, ": its data end before their own length");
  if (width == 8)
    return d.big_endian ? load_be<std::uint64_t>(bytes.data())
                        : load_le<std::uint64_t>(bytes.data());
  return d.big_endian ? load_be<std::uint32_t>(bytes.data()) : load_le<std::uint32_t>(bytes.data());
}

/// Decodes blocks of zlib into `to`, which grows with the decoded data.
Result<void> read_blocks(const Document& d, Source& source, const std::string& path,
                         std::uint64_t needed, std::vector<std::byte>& to) {
  std::array<std::uint64_t, 3> head{};  // blocks, bytes of a block, bytes of the last
  for (auto& count : head) {
    const auto read = read_count(d, source, path);
    if (!read) return tl::unexpected(read.error());
    count = *read;
  }
  const auto [blocks, block, last] = head;
  constexpr std::uint64_t kMaxBlockBytes = std::uint64_t{1} << 30;
  if (blocks == 0 || block == 0 || block > kMaxBlockBytes || last > block ||
      blocks > needed / block + 1 || (blocks - (last ? 1 : 0)) * block + last != needed)
    return fail(ErrorCode::bad_file, path, ": ", blocks, " packed blocks of ", block,
                " bytes (the "
                "last of ",
                last, "), expected ", needed, " bytes");
  std::vector<std::uint64_t> packed;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    const auto size = read_count(d, source, path);
    if (!size) return tl::unexpected(size.error());
    packed.push_back(*size);
  }
  source.begin_sequence();
  std::vector<std::byte> in, out;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    const std::uint64_t size = i + 1 == blocks && last ? last : block;
    if (packed[i] > kMaxBlockBytes || size > packed[i] * 1032 + 1032)
      return fail(ErrorCode::bad_file, path, ": packed block ", i, " of ", packed[i],
                  " bytes cannot hold ", size);
    in.resize(packed[i]);
    const auto got = source.read(in);
    if (!got) return tl::unexpected(got.error());
    out.resize(size);
    uLongf length = static_cast<uLongf>(size);
    if (*got != in.size() ||
        uncompress(reinterpret_cast<Bytef*>(out.data()), &length,
                   reinterpret_cast<const Bytef*>(in.data()),
                   static_cast<uLong>(in.size())) != Z_OK ||
        length != size)
      return fail(ErrorCode::bad_file, path, ": packed block ", i, " of ", blocks,
                  " is damaged or cut off");
    to.insert(to.end(), out.begin(), out.end());
  }
  return {};
}

/// Reads all numbers of the array as bytes, in native order, components side by side.
Result<std::vector<std::byte>> read_packed(const Document& d, Source& source, const Volume& volume,
                                           std::uint64_t needed) {
  const std::string& path = volume.source;
  std::vector<std::byte> bytes;
  if (!d.compressor.empty()) {
    if (auto ok = read_blocks(d, source, path, needed, bytes); !ok)
      return tl::unexpected(ok.error());
  } else {
    const auto count = read_count(d, source, path);
    if (!count) return tl::unexpected(count.error());
    if (*count != needed)
      return fail(ErrorCode::bad_file, path, ": the array ", in_quotes(d.array.name), " holds ",
                  *count, " bytes, expected ", needed);
    bytes.resize(needed);
    const auto got = source.read(bytes);
    if (!got) return tl::unexpected(got.error());
    if (*got != needed)
      return fail(ErrorCode::bad_file, path, ": expected ", needed, " bytes of voxels, found ",
                  *got, ": the file is truncated");
  }
  if (d.big_endian != (std::endian::native == std::endian::big))
    swap_bytes(bytes, bytes_per_voxel(volume.type));
  return bytes;
}

template <class T>
bool append_number(std::string_view word, std::vector<std::byte>& bytes) {
  const auto value = parse_number(word);
  if (!value) return false;
  if constexpr (std::is_integral_v<T>) {
    if (!(*value >= static_cast<double>(std::numeric_limits<T>::lowest())) ||
        !(*value <= static_cast<double>(std::numeric_limits<T>::max())))
      return false;
  }
  const T number = static_cast<T>(*value);
  const auto* from = reinterpret_cast<const std::byte*>(&number);
  bytes.insert(bytes.end(), from, from + sizeof number);
  return true;
}

Result<std::vector<std::byte>> read_ascii(const Document& d, const Volume& volume,
                                          std::uint64_t needed) {
  std::vector<std::byte> bytes;
  for (const auto word : words(d.array.text)) {
    bool ok = false;
    switch (volume.type) {
      case ScalarType::u8:
        ok = append_number<std::uint8_t>(word, bytes);
        break;
      case ScalarType::i8:
        ok = append_number<std::int8_t>(word, bytes);
        break;
      case ScalarType::u16:
        ok = append_number<std::uint16_t>(word, bytes);
        break;
      case ScalarType::i16:
        ok = append_number<std::int16_t>(word, bytes);
        break;
      case ScalarType::u32:
        ok = append_number<std::uint32_t>(word, bytes);
        break;
      case ScalarType::i32:
        ok = append_number<std::int32_t>(word, bytes);
        break;
      case ScalarType::f32:
        ok = append_number<float>(word, bytes);
        break;
      case ScalarType::f64:
        ok = append_number<double>(word, bytes);
        break;
      case ScalarType::u64:
      case ScalarType::i64:
        if (const auto value = parse_integer(word); value) {
          const auto* from = reinterpret_cast<const std::byte*>(&*value);
          bytes.insert(bytes.end(), from, from + sizeof *value);
          ok = true;
        }
        break;
    }
    if (!ok)
      return fail(ErrorCode::bad_file, volume.source, ": the array ", in_quotes(d.array.name),
                  " holds ", in_quotes(word), ", expected numbers of type ", name(volume.type));
    if (bytes.size() > needed) break;
  }
  if (bytes.size() != needed)
    return fail(ErrorCode::bad_file, volume.source, ": the array ", in_quotes(d.array.name),
                " holds another count of numbers than its extent");
  return bytes;
}

/// The offset of the appended data, after an underscore that blanks may precede.
Result<std::uint64_t> find_appended(const std::string& path, std::uint64_t from) {
  auto reader = ByteReader::open(path, from, false);
  if (!reader) return tl::unexpected(reader.error());
  std::array<std::byte, 256> bytes{};
  const auto got = reader->read(bytes);
  if (!got) return tl::unexpected(got.error());
  for (std::size_t i = 0; i < *got; ++i)
    if (static_cast<char>(bytes[i]) == '_') return from + i + 1;
  return fail(ErrorCode::bad_file, path, ": its appended data do not begin with '_'");
}

Result<std::vector<std::byte>> read_bytes(const Document& d, const Volume& volume,
                                          std::uint64_t needed) {
  const std::string& path = volume.source;
  if (d.array.format == "ascii") return read_ascii(d, volume, needed);
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  const std::uint64_t max_bytes = d.compressor.empty() ? *size : *size * 1032;
  if (needed > max_bytes)
    return fail(ErrorCode::bad_file, path, ": its extent needs ", needed,
                " bytes of voxels, but the file holds ", *size,
                d.compressor.empty() ? "" : " packed", ": it is truncated, or its extent is wrong");
  if (d.array.format == "binary") {
    Base64Source source(d.array.text);
    return read_packed(d, source, volume, needed);
  }
  const auto begin = find_appended(path, d.appended);
  if (!begin) return tl::unexpected(begin.error());
  if (d.array.offset > *size - *begin)
    return fail(ErrorCode::bad_file, path, ": the array ", in_quotes(d.array.name), " begins ",
                d.array.offset, " bytes into the appended data, beyond the end of the file");
  auto reader = ByteReader::open(path, *begin + d.array.offset, false);
  if (!reader) return tl::unexpected(reader.error());
  if (d.appended_raw) {
    FileSource source(std::move(*reader));
    return read_packed(d, source, volume, needed);
  }
  std::string text(*size - *begin - d.array.offset, '\0');
  const auto got = reader->read(std::as_writable_bytes(std::span(text)));
  if (!got) return tl::unexpected(got.error());
  text.resize(*got);
  Base64Source source(text);
  return read_packed(d, source, volume, needed);
}

}  // namespace

bool looks_like_vti(std::string_view head) { return head.find("<VTKFile") < 4096; }

Result<Volume> read_vti(const std::string& path, const VolumeOptions& options) {
  const auto document = read_document(path);
  if (!document) return tl::unexpected(document.error());
  const Document& d = *document;
  Volume volume;
  volume.source = path;
  if (d.type != "ImageData")
    return fail(ErrorCode::unsupported, path, ": a VTK file of ", in_quotes(d.type),
                ", expected ImageData: resample it to an image");
  if (d.pieces > 1)
    return fail(ErrorCode::unsupported, path, ": ", d.pieces,
                " pieces, expected one: save it in one piece");
  if (!d.compressor.empty() && d.compressor != "vtkZLibDataCompressor")
    return fail(ErrorCode::unsupported, path, ": packed by ", in_quotes(d.compressor),
                ", expected vtkZLibDataCompressor or none: save it with ZLib or without "
                "compression");
  if (!d.array.found) return fail(ErrorCode::bad_file, path, ": it holds no array of data");
  const auto type = parse_scalar_type(d.array.type);
  if (!type)
    return fail(ErrorCode::bad_file, path, ": the array ", in_quotes(d.array.name), " has type ",
                in_quotes(d.array.type), ", expected Int8 to UInt64, Float32 or Float64");
  volume.type = *type;
  if (d.others > 0)
    volume.notes.push_back("of its " + std::to_string(d.others + 1) + " arrays, " +
                           in_quotes(d.array.name) + " is read");
  if (auto done = set_position(d, volume); !done) return tl::unexpected(done.error());
  const auto component = choose(path, options.component, d.array.components, "component");
  if (!component) return tl::unexpected(component.error());
  if (const auto ok = choose(path, options.time, 1, "time point"); !ok)
    return tl::unexpected(ok.error());
  const std::size_t width = bytes_per_voxel(*type);
  std::uint64_t needed = 0;
  if (__builtin_mul_overflow(voxel_bytes(volume), d.array.components, &needed))
    return fail(ErrorCode::bad_file, path, ": absurd extent and components");
  auto bytes = read_bytes(d, volume, needed);
  if (!bytes) return tl::unexpected(bytes.error());
  for (std::size_t from = *component * width, to = 0;
       d.array.components > 1 && from < bytes->size();
       from += width * d.array.components, to += width)
    std::memmove(&(*bytes)[to], &(*bytes)[from], width);
  bytes->resize(voxel_bytes(volume));
  volume.voxels = std::move(*bytes);
  return volume;
}

}  // namespace slf::volume_io
