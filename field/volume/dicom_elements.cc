// Our own parser of DICOM elements; dicom.h says why.
#include <zlib.h>

#include <algorithm>
#include <array>
#include <fstream>

#include "base/bytes.h"
#include "field/volume/dicom.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::uint32_t kUndefined = 0xffffffff;
constexpr std::uint32_t kItem = 0xfffee000, kItemEnd = 0xfffee00d, kSequenceEnd = 0xfffee0dd;
constexpr std::uint32_t kPixelData = 0x7fe00010;
constexpr std::uint32_t kSharedGroups = 0x52009229, kFrameGroups = 0x52009230;
constexpr std::string_view kDeflated = "1.2.840.10008.1.2.1.99", kBigEndian = "1.2.840.10008.1.2.2";
constexpr int kMaxNesting = 32;

/// Whether `parent` is the sequence of the functional groups that holds `tag`: plane position,
/// plane orientation, pixel measures, pixel value transformation.
bool is_of_group(std::uint32_t parent, std::uint32_t tag) {
  constexpr std::array<std::array<std::uint32_t, 2>, 5> kPlaces = {{{0x00209113, 0x00200032},
                                                                    {0x00209116, 0x00200037},
                                                                    {0x00289110, 0x00280030},
                                                                    {0x00289145, 0x00281052},
                                                                    {0x00289145, 0x00281053}}};
  for (const auto& [sequence, element] : kPlaces)
    if (sequence == parent && element == tag) return true;
  return false;
}

struct Walker {
  const std::string& path;
  std::string_view bytes;
  std::size_t at = 0;
  DicomElements found{};
  // Within functional groups: where their elements are stored, and the current sequence.
  DicomValues* groups = nullptr;
  std::uint32_t parent = 0;

  template <class T>
  T take() {
    const auto value = load_le<T>(reinterpret_cast<const std::byte*>(bytes.data()) + at);
    at += sizeof(T);
    return value;
  }

  std::uint32_t take_tag() {
    const std::uint32_t group = take<std::uint16_t>();
    return group << 16 | take<std::uint16_t>();
  }

  tl::unexpected<Error> truncated(std::size_t from, std::uint64_t length) const {
    return fail(ErrorCode::bad_file, path, ": the DICOM element at byte ", from, " claims ", length,
                " bytes, but the file ends at byte ", bytes.size(),
                ": it is truncated or damaged, copy it again");
  }

  struct Element {
    std::uint32_t tag = 0;
    std::string_view vr{};
    std::uint32_t length = 0;
    std::size_t from = 0;
  };

  Result<Element> next(bool is_explicit, std::size_t end) {
    Element e{.from = at};
    if (end - at < 8) return truncated(at, 8);
    e.tag = take_tag();
    if (!is_explicit || e.tag >> 16 == 0xfffe) {
      e.length = take<std::uint32_t>();
    } else {
      e.vr = bytes.substr(at, 2);
      at += 2;
      constexpr std::string_view kLong = "OB OD OF OL OV OW SQ SV UC UN UR UT UV";
      if (kLong.find(e.vr) != std::string_view::npos) {
        if (end - at < 6) return truncated(e.from, 12);
        at += 2;
        e.length = take<std::uint32_t>();
      } else {
        e.length = take<std::uint16_t>();
      }
    }
    if (e.length != kUndefined && e.length > end - at) return truncated(e.from, e.length);
    return e;
  }

  /// Parses items up to `end` or, if `open`, up to the delimiter. In encapsulated pixel data an
  /// item is a byte string; elsewhere it is a data set.
  Result<void> items(bool is_explicit, std::size_t end, bool open, bool of_bytes, int depth) {
    if (depth > kMaxNesting)
      return fail(ErrorCode::bad_file, path, ": DICOM sequences nested deeper than ", kMaxNesting);
    while (open || at < end) {
      const auto item = next(is_explicit, end);
      if (!item) return tl::unexpected(item.error());
      if (item->tag == kSequenceEnd && open) return {};
      if (item->tag != kItem || (of_bytes && item->length == kUndefined))
        return fail(ErrorCode::bad_file, path, ": expected a DICOM item at byte ", item->from);
      if (of_bytes) {
        at += item->length;
        continue;
      }
      if (depth == 1 && parent == kFrameGroups) groups = &found.frames.emplace_back();
      const bool open_item = item->length == kUndefined;
      auto inner = data_set(is_explicit, open_item ? end : at + item->length, open_item, depth + 1);
      if (!inner) return inner;
    }
    return {};
  }

  /// Parses the items of a sequence, with `parent` and `groups` for their elements.
  Result<void> sequence(std::uint32_t tag, bool is_explicit, std::size_t end, bool open,
                        int depth) {
    const auto outer_groups = groups;
    const auto outer_parent = parent;
    parent = tag;
    if (depth == 1) groups = tag == kSharedGroups ? &found.shared : nullptr;
    auto inner = items(is_explicit, end, open, open && tag == kPixelData, depth);
    groups = outer_groups;
    parent = outer_parent;
    return inner;
  }

  Result<void> data_set(bool is_explicit, std::size_t end, bool open, int depth) {
    while (open || at < end) {
      const auto e = next(is_explicit, end);
      if (!e) return tl::unexpected(e.error());
      if (e->tag == kItemEnd && open) return {};
      const bool undefined = e->length == kUndefined;
      // A private or unknown element of undefined length has implicit value representations.
      const bool inner_explicit = is_explicit && e->vr != "UN";
      if (depth == 0 && !undefined) found.values[e->tag] = bytes.substr(at, e->length);
      if (depth == 0 && e->tag == kPixelData) found.encapsulated = undefined;
      if (groups && !undefined && is_of_group(parent, e->tag))
        (*groups)[e->tag] = bytes.substr(at, e->length);
      if (undefined || e->vr == "SQ") {
        const std::size_t stop = undefined ? end : at + e->length;
        auto inner = sequence(e->tag, inner_explicit, stop, undefined, depth + 1);
        if (!inner) return inner;
      } else {
        at += e->length;
      }
    }
    return {};
  }

  /// Parses the file meta information, which is always explicit. Returns the transfer syntax.
  Result<std::string> meta() {
    std::string syntax;
    while (at < bytes.size()) {
      const std::size_t from = at;
      if (bytes.size() - at >= 4 && take_tag() >> 16 != 0x0002) {
        at = from;
        break;
      }
      at = from;
      const auto e = next(true, bytes.size());
      if (!e) return tl::unexpected(e.error());
      if (e->length == kUndefined) return truncated(from, e->length);
      if (e->tag == 0x00020010) syntax = bytes.substr(at, e->length);
      at += e->length;
    }
    while (!syntax.empty() && (syntax.back() == '\0' || syntax.back() == ' ')) syntax.pop_back();
    return syntax;
  }
};

/// Inflates a data set of the deflated transfer syntax: deflate without a header.
Result<std::string> inflated(const std::string& path, std::string_view packed) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30, kStep = std::size_t{1} << 20;
  z_stream stream{};
  if (inflateInit2(&stream, -15) != Z_OK)
    return fail(ErrorCode::failed, path, ": no memory to inflate it");
  std::string data;
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  int status = Z_OK;
  // zlib's lengths have 32 bits, so feed longer data in parts.
  for (std::size_t left = packed.size(); status == Z_OK && data.size() < kMaxBytes;) {
    if (stream.avail_in == 0) {
      stream.avail_in = static_cast<uInt>(std::min(left, kStep));
      left -= stream.avail_in;
    }
    const std::size_t from = data.size();
    data.resize(from + kStep);
    stream.next_out = reinterpret_cast<Bytef*>(data.data() + from);
    stream.avail_out = kStep;
    status = inflate(&stream, Z_NO_FLUSH);
    data.resize(from + kStep - stream.avail_out);
  }
  inflateEnd(&stream);
  if (status == Z_STREAM_END) return data;
  if (status == Z_OK)
    return fail(ErrorCode::unsupported, path, ": its deflated data set is larger than 1 GiB");
  return fail(ErrorCode::bad_file, path, ": its deflated data set is damaged or cut after ",
              data.size(), " inflated bytes: copy the file again");
}

Result<std::string> read_whole(const std::string& path) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
  if (packing_of_file(path) != Packing::none) return read_unpacked(path, kMaxBytes);
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  std::string bytes(*size, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    return fail(ErrorCode::io, path, ": cannot be read");
  return bytes;
}

Result<void> check_magic(const std::string& path, std::string_view bytes) {
  if (looks_like_dicom(bytes)) return {};
  return fail(ErrorCode::bad_file, path, ": expected 'DICM' at byte 128");
}

}  // namespace

bool looks_like_dicom(std::string_view head) {
  return head.size() >= 132 && head.substr(128, 4) == "DICM";
}

Result<std::string> read_dicom_bytes(const std::string& path) {
  auto bytes = read_whole(path);
  if (!bytes) return bytes;
  if (auto r = check_magic(path, *bytes); !r) return tl::unexpected(r.error());
  Walker walker{path, *bytes, 132};
  const auto syntax = walker.meta();
  if (!syntax) return tl::unexpected(syntax.error());
  if (*syntax != kDeflated) return bytes;
  auto data = inflated(path, std::string_view(*bytes).substr(walker.at));
  if (!data) return data;
  return bytes->substr(0, walker.at) + *data;
}

Result<DicomElements> parse_dicom(const std::string& path, std::string_view bytes) {
  if (auto r = check_magic(path, bytes); !r) return tl::unexpected(r.error());
  Walker walker{path, bytes, 132};
  const auto syntax = walker.meta();
  if (!syntax) return tl::unexpected(syntax.error());
  if (*syntax == kBigEndian)
    return fail(ErrorCode::unsupported, path, ": big endian DICOM (transfer syntax ", *syntax,
                "): convert it, `gdcmconv --raw IN OUT`");
  const bool is_explicit = *syntax != "1.2.840.10008.1.2";
  if (auto r = walker.data_set(is_explicit, bytes.size(), false, 0); !r)
    return tl::unexpected(r.error());
  walker.found.syntax = *syntax;
  return std::move(walker.found);
}

}  // namespace slf::volume_io
