// Our own parser of DICOM elements; dicom_elements.h says why.
#include "source/volume/dicom/dicom_elements.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <utility>

#include "base/bytes.h"
#include "base/try.h"
#include "base/utf8.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::uint32_t kUndefined = 0xffffffff;
constexpr DicomTag kItem = 0xfffee000, kItemEnd = 0xfffee00d, kSequenceEnd = 0xfffee0dd;

constexpr std::string_view kImplicit = "1.2.840.10008.1.2", kBigEndian = "1.2.840.10008.1.2.2",
                           kDeflated = "1.2.840.10008.1.2.1.99";
constexpr std::string_view kLongForms = "OB OD OF OL OV OW SQ SV UC UN UR UT UV";
constexpr std::string_view kShortForms =
    "AE AS AT CS DA DS DT FD FL IS LO LT PN SH SL SS ST TM UI UL US";
constexpr std::size_t kPreamble = 132;
constexpr int kMaxNesting = 32;

/// The sequences whose items are kept. Implicit files do not say which elements are sequences.
constexpr std::array<DicomTag, 26> kSequences = {
    0x00189076,  // DiffusionGradientDirectionSequence
    0x00189112,  // MRTimingAndRelatedParametersSequence
    0x00189114,  // MREchoSequence
    0x00189115,  // MRModifierSequence
    0x00189117,  // MRDiffusionSequence
    0x00189118,  // CardiacSynchronizationSequence
    0x00189226,  // MRImageFrameTypeSequence
    0x00189325,  // CTXRayDetailsSequence
    0x00189329,  // CTImageFrameTypeSequence
    0x00189751,  // PETFrameTypeSequence
    0x00209111,  // FrameContentSequence
    0x00209113,  // PlanePositionSequence
    0x00209116,  // PlaneOrientationSequence
    0x00209222,  // DimensionIndexSequence
    0x00209253,  // RespiratorySynchronizationSequence
    0x0020930e,  // PlanePositionVolumeSequence
    0x0020930f,  // PlaneOrientationVolumeSequence
    0x00209310,  // TemporalPositionSequence
    0x00283000,  // ModalityLUTSequence
    0x00289110,  // PixelMeasuresSequence
    0x00289145,  // PixelValueTransformationSequence
    0x00540022,  // DetectorInformationSequence
    0x00620002,  // SegmentSequence
    0x0062000a,  // SegmentIdentificationSequence
    0x52009229,  // SharedFunctionalGroupsSequence
    0x52009230,  // PerFrameFunctionalGroupsSequence
};

bool is_kept_sequence(DicomTag tag) { return std::ranges::binary_search(kSequences, tag); }

bool is_one_of(std::string_view representation, std::string_view list) {
  return representation.size() == 2 && representation.find(' ') == std::string_view::npos &&
         list.find(representation) != std::string_view::npos;
}

/// Whether two bytes name a value representation.
bool is_representation(std::string_view bytes) {
  return is_one_of(bytes, kShortForms) || is_one_of(bytes, kLongForms);
}

bool has_preamble(std::string_view head) {
  return head.size() >= kPreamble && head.substr(kPreamble - 4, 4) == "DICM";
}

struct Encoding {
  bool is_explicit = false;
  bool big_endian = false;
};

struct Walker {
  const std::string& path;
  std::string_view bytes;
  std::size_t at = 0;
  DicomFile found{};

  template <class T>
  T take(bool big_endian) {
    return Fields{bytes, big_endian}.get<T>(std::exchange(at, at + sizeof(T)));
  }

  DicomTag take_tag(bool big_endian) {
    const DicomTag group = take<std::uint16_t>(big_endian);
    return group << 16 | take<std::uint16_t>(big_endian);
  }

  tl::unexpected<Error> truncated(std::size_t from, std::uint64_t length) const {
    return bad_file(path, "the DICOM element at byte ", from, " claims ", length,
                    " bytes, but the file ends at byte ", bytes.size(),
                    ": it is truncated or damaged, copy it again");
  }

  struct Element {
    DicomTag tag = 0;
    std::string_view representation{};
    std::uint32_t length = 0;
    std::size_t from = 0;
  };

  Result<Element> next(Encoding encoding, std::size_t end) {
    Element e{.from = at};
    if (end - at < 8) return truncated(at, 8);
    e.tag = take_tag(encoding.big_endian);
    if (!encoding.is_explicit || e.tag >> 16 == 0xfffe) {
      e.length = take<std::uint32_t>(encoding.big_endian);
    } else {
      e.representation = bytes.substr(at, 2);
      at += 2;
      if (is_one_of(e.representation, kLongForms)) {
        if (end - at < 6) return truncated(e.from, 12);
        at += 2;
        e.length = take<std::uint32_t>(encoding.big_endian);
      } else {
        e.length = take<std::uint16_t>(encoding.big_endian);
      }
    }
    if (e.length != kUndefined && e.length > end - at) return truncated(e.from, e.length);
    return e;
  }

  /// Parses items up to `end` or, if `open`, up to the delimiter. In encapsulated pixel data an
  /// item is a byte string; elsewhere it is a data set, kept in `into` unless that is null.
  Result<void> items(std::vector<DicomDataSet>* into, Encoding encoding, std::size_t end, bool open,
                     bool of_bytes, int depth) {
    if (depth > kMaxNesting)
      return bad_file(path, "DICOM sequences nested deeper than ", kMaxNesting);
    while (open || at < end) {
      const auto item = SLF_TRY(next(encoding, end));
      if (item.tag == kSequenceEnd && open) return {};
      if (item.tag != kItem || (of_bytes && item.length == kUndefined))
        return bad_file(path, "expected a DICOM item at byte ", item.from);
      if (of_bytes) {
        ++found.fragments;
        at += item.length;
        continue;
      }
      const bool open_item = item.length == kUndefined;
      SLF_TRY(data_set(into ? &into->emplace_back() : nullptr, encoding,
                       open_item ? end : at + item.length, open_item, depth + 1));
    }
    return {};
  }

  Result<void> data_set(DicomDataSet* into, Encoding encoding, std::size_t end, bool open,
                        int depth) {
    while (open || at < end) {
      const auto e = SLF_TRY(next(encoding, end));
      if (e.tag == kItemEnd && open) return {};
      const bool undefined = e.length == kUndefined;
      const bool is_pixel_data = depth == 0 && e.tag == kPixelData;
      if (is_pixel_data) {
        found.encapsulated = undefined;
        found.fragments = 0;
        found.words = e.representation != "OB";
      }
      const bool may_be_sequence =
          !encoding.is_explicit || e.representation == "SQ" || e.representation == "UN";
      const bool kept = into && may_be_sequence && is_kept_sequence(e.tag);
      if (!undefined && !kept) {
        if (into) into->values[e.tag] = bytes.substr(at, e.length);
        at += e.length;
        continue;
      }
      // What was unknown to its writer (UN) has implicit value representations.
      Encoding inner = encoding;
      if (e.representation == "UN") inner = {};
      SLF_TRY(items(kept ? &into->sequences[e.tag] : nullptr, inner,
                    undefined ? end : at + e.length, undefined, undefined && e.tag == kPixelData,
                    depth + 1));
      if (is_pixel_data) into->values[e.tag] = {};
    }
    return {};
  }

  /// Parses the file meta information, which is always explicit. Returns the transfer syntax.
  Result<std::string> meta() {
    at = has_preamble(bytes) ? kPreamble : 0;
    std::string syntax;
    while (bytes.size() - at >= 4 && Fields{bytes, false}.get<std::uint16_t>(at) == 0x0002) {
      const auto e = SLF_TRY(next({.is_explicit = true}, bytes.size()));
      if (e.length == kUndefined) return truncated(e.from, e.length);
      if (e.tag == 0x00020010) syntax = bytes.substr(at, e.length);
      at += e.length;
    }
    while (!syntax.empty() && (syntax.back() == '\0' || syntax.back() == ' ')) syntax.pop_back();
    return syntax;
  }

  /// The encoding of the data set that begins here. Some writers state another transfer syntax than
  /// they use, so the first element decides between implicit and explicit.
  Encoding encoding(std::string_view syntax) const {
    Encoding e{.is_explicit = !syntax.empty() && syntax != kImplicit,
               .big_endian = syntax == kBigEndian};
    if (bytes.size() - at < 8) return e;
    if (syntax.empty()) e.big_endian = Fields{bytes, true}.get<std::uint16_t>(at) == 0x0008;
    e.is_explicit = is_representation(bytes.substr(at + 4, 2));
    return e;
  }
};

/// Inflates a data set of the deflated transfer syntax: deflate without a header. Sets `damage` if
/// that ends early.
std::string inflated(const std::string& path, std::string_view packed,
                     std::optional<Error>& damage) {
  constexpr std::size_t kMaxInflated = std::size_t{1} << 30, kStep = std::size_t{1} << 20;
  const auto error = [&](ErrorCode code, auto&&... parts) {
    damage = fail(code, path, ": its deflated data set ", parts...).value();
  };
  const auto unpacker = Unpacker::make(Packing::deflate);
  auto state = Unpacker::State::more;
  ByteSpan in = bytes_of(packed);
  std::string data;
  for (bool goes_on = true; goes_on && data.size() < kMaxInflated;) {
    const std::size_t from = data.size(), left = in.size();
    data.resize(from + kStep);
    auto out = std::as_writable_bytes(std::span(data).subspan(from));
    state = unpacker->step(in, out);
    data.resize(data.size() - out.size());
    goes_on = state == Unpacker::State::more && (data.size() > from || in.size() < left);
  }
  if (state == Unpacker::State::more && data.size() >= kMaxInflated)
    error(ErrorCode::unsupported, "is larger than 1 GiB");
  else if (state != Unpacker::State::ended)
    error(ErrorCode::bad_file, "is damaged or cut after ", data.size(),
          " inflated bytes: copy the file again");
  return data;
}

Result<std::string> read_whole(const std::string& path) {
  constexpr std::size_t kMaxFile = std::size_t{1} << 30;
  if (packing_of_file(path) != Packing::none) return read_unpacked(path, kMaxFile);
  auto file = SLF_TRY(open_regular(path));
  const auto size = SLF_TRY(file_size(path));
  std::string bytes(size, '\0');
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    return fail(ErrorCode::io, path, ": cannot be read");
  return bytes;
}

/// Whether a file without a preamble begins with two elements in ascending order, the first of
/// group 2 (file meta information) or 8 (identification).
bool begins_with_elements(std::string_view head, bool big_endian) {
  constexpr std::uint32_t kLikely = 1024;
  const std::string unnamed;
  Walker walker{unnamed, head};
  DicomTag last = 0;
  for (int count = 0; count < 2; ++count) {
    if (head.size() - walker.at < 8) return false;
    const bool is_explicit = is_representation(head.substr(walker.at + 4, 2));
    const auto e = walker.next({is_explicit, big_endian}, head.size());
    if (!e || e->length % 2 != 0 || e->length > kLikely) return false;
    const DicomTag group = e->tag >> 16;
    if (count == 0 ? group != 2 && group != 8 : e->tag <= last || group > 0x0020) return false;
    last = e->tag;
    walker.at += e->length;
  }
  return true;
}

}  // namespace

bool looks_like_dicom(std::string_view head) {
  return has_preamble(head) || begins_with_elements(head, false) ||
         begins_with_elements(head, true);
}

Result<DicomBytes> read_dicom_bytes(const std::string& path) {
  auto bytes = SLF_TRY(read_whole(path));
  if (!looks_like_dicom(bytes))
    return bad_file(path,
                    "expected 'DICM' at byte 128, or DICOM elements of group 2 or 8 at its start");
  DicomBytes file{std::move(bytes)};
  Walker walker{path, file.bytes};
  const auto syntax = walker.meta();
  if (!syntax || *syntax != kDeflated) return file;  // parse_dicom reports damage
  const auto data = inflated(path, std::string_view(file.bytes).substr(walker.at), file.damage);
  file.bytes.replace(walker.at, std::string::npos, data);
  return file;
}

DicomFile parse_dicom(const std::string& path, const DicomBytes& file) {
  Walker walker{path, file.bytes};
  DicomFile& found = walker.found;
  found.damage = file.damage;
  const auto syntax = walker.meta();
  if (!syntax) {
    found.damage = syntax.error();
    return std::move(found);
  }
  found.syntax = *syntax;
  const auto encoding = walker.encoding(*syntax);
  found.big_endian = encoding.big_endian;
  const auto parsed = walker.data_set(&found.data, encoding, file.bytes.size(), false, 0);
  // Writers pad files with bytes that are no elements; whatever follows the pixels does not matter.
  if (!parsed && !found.damage && !found.data.values.contains(kPixelData))
    found.damage = parsed.error();
  return std::move(found);
}

const std::vector<DicomDataSet>& DicomDataSet::items(DicomTag sequence) const {
  static const std::vector<DicomDataSet> kNone;
  const auto found = sequences.find(sequence);
  return found == sequences.end() ? kNone : found->second;
}

std::string_view DicomLookup::raw(DicomTag tag) const {
  for (const auto* set : sets_)
    if (const auto found = set->values.find(tag); found != set->values.end()) return found->second;
  return {};
}

std::string DicomLookup::text(DicomTag tag) const {
  const auto value = raw(tag);
  return std::string(trim(value.substr(0, value.find('\0'))));
}

std::string DicomLookup::utf8(DicomTag tag, const std::string& character_set) const {
  std::string own = text(tag);
  if (character_set == "ISO_IR 192") return own;
  const bool latin_1 = character_set.empty() || character_set == "ISO_IR 100";
  std::string result;
  for (const char c : own) {
    const auto code = static_cast<unsigned char>(c);
    append_utf8(latin_1 || code < 128 ? code : '?', result);
  }
  return result;
}

std::vector<double> DicomLookup::numbers(DicomTag tag) const {
  std::vector<double> result;
  std::istringstream parts(text(tag));
  for (std::string part; std::getline(parts, part, '\\');) {
    const auto value = parse_number(part);
    if (!value || !std::isfinite(*value)) return {};
    result.push_back(*value);
  }
  return result;
}

std::optional<double> DicomLookup::number(DicomTag tag) const {
  const auto values = numbers(tag);
  return values.empty() ? std::nullopt : std::optional(values.front());
}

std::vector<std::uint32_t> DicomLookup::integers(DicomTag tag, std::size_t bytes) const {
  std::vector<std::uint32_t> result;
  const Fields value{raw(tag), big_endian_};
  for (std::size_t at = 0; at + bytes <= value.bytes.size(); at += bytes)
    result.push_back(bytes == 2 ? value.get<std::uint16_t>(at) : value.get<std::uint32_t>(at));
  return result;
}

std::optional<std::uint32_t> DicomLookup::integer(DicomTag tag) const {
  const auto values = integers(tag, raw(tag).size() == 4 ? 4 : 2);
  return values.empty() ? std::nullopt : std::optional(values.front());
}

std::vector<double> DicomLookup::reals(DicomTag tag) const {
  std::vector<double> result;
  const Fields value{raw(tag), big_endian_};
  const bool narrow = value.bytes.size() % 8 == 4;
  for (std::size_t at = 0; at + (narrow ? 4 : 8) <= value.bytes.size(); at += narrow ? 4 : 8) {
    result.push_back(narrow ? double{value.get<float>(at)} : value.get<double>(at));
    if (!std::isfinite(result.back())) return {};
  }
  return result;
}

std::optional<double> DicomLookup::real(DicomTag tag) const {
  const auto values = reals(tag);
  return values.empty() ? std::nullopt : std::optional(values.front());
}

void flatten(const DicomDataSet& from, DicomDataSet& into) {
  into.values.insert(from.values.begin(), from.values.end());
  for (const auto& [tag, items] : from.sequences)
    if (!items.empty()) flatten(items.front(), into);
}

}  // namespace slf::volume_io
