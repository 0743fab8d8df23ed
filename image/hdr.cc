// Radiance HDR (RGBE), a usual format of environment pictures. Reads flat and run-length coded
// pictures of the format 32-bit_rle_rgbe. Ward, "Real pixels", Graphics Gems II, 1991.

#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

#include "base/try.h"
#include "image/formats.h"

namespace slf::image_formats {
namespace {

using Row = std::vector<std::array<std::uint8_t, 4>>;  // red, green, blue, exponent

/// Reads forward through a picture; every function fails at its end.
class Reader {
 public:
  explicit Reader(ByteSpan bytes) : text_(chars_of(bytes)) {}

  std::optional<std::string_view> line() {
    const std::size_t end = text_.find('\n');
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view found = text_.substr(0, end);
    text_.remove_prefix(end + 1);
    return found;
  }

  /// Reads one row. False: the picture ends early, or a run is longer than the row.
  bool row(Row& row) {
    const bool coded = row.size() >= 8 && row.size() < 32768 && text_.size() >= 4 && at(0) == 2 &&
                       at(1) == 2 && (at(2) << 8 | at(3)) == static_cast<int>(row.size());
    if (!coded) return flat_row(row);
    text_.remove_prefix(4);
    for (std::size_t channel = 0; channel < 4; ++channel)
      for (std::size_t x = 0; x < row.size();) {
        if (text_.size() < 2) return false;
        const bool run = at(0) > 128;
        const auto count = static_cast<std::size_t>(run ? at(0) - 128 : at(0));
        text_.remove_prefix(1);
        if (count == 0 || count > row.size() - x || text_.size() < (run ? 1 : count)) return false;
        for (std::size_t k = 0; k < count; ++k)
          row[x++][channel] = static_cast<std::uint8_t>(at(run ? 0 : k));
        text_.remove_prefix(run ? 1 : count);
      }
    return true;
  }

 private:
  [[nodiscard]] int at(std::size_t k) const { return static_cast<unsigned char>(text_[k]); }

  /// Reads a row of single pixels. A pixel 1, 1, 1, n repeats the last one n times; the next such
  /// pixel in sequence, n << 8 times, and so on.
  bool flat_row(Row& row) {
    int shift = 0;
    for (std::size_t x = 0; x < row.size();) {
      if (text_.size() < 4) return false;
      if (at(0) == 1 && at(1) == 1 && at(2) == 1) {
        if (x == 0 || shift > 16) return false;
        const std::size_t count = static_cast<std::size_t>(at(3)) << shift;
        if (count > row.size() - x) return false;
        for (std::size_t k = 0; k < count; ++k, ++x) row[x] = row[x - 1];
        shift += 8;
      } else {
        for (std::size_t c = 0; c < 4; ++c) row[x][c] = static_cast<std::uint8_t>(at(c));
        ++x;
        shift = 0;
      }
      text_.remove_prefix(4);
    }
    return true;
  }

  std::string_view text_;
};

/// Parses "-Y 512 +X 1024", the only order of pixels that is in use.
std::optional<std::array<std::uint64_t, 2>> parse_size(std::string_view line) {
  std::array<std::uint64_t, 2> sides{};
  for (std::size_t k = 0; k < 2; ++k) {
    const std::string_view axis = k == 0 ? "-Y " : "+X ";
    if (!line.starts_with(axis)) return std::nullopt;
    line.remove_prefix(axis.size());
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), sides[k]);
    if (error != std::errc()) return std::nullopt;
    line.remove_prefix(static_cast<std::size_t>(end - line.data()));
    if (k == 0 && line.starts_with(' ')) line.remove_prefix(1);
  }
  return sides;
}

}  // namespace

Result<Image> decode_hdr(const std::string& name, ByteSpan bytes) {
  Reader in(bytes);
  for (;;) {
    const auto line = in.line();
    if (!line) return bad_file(name, "the header of the HDR picture ends early");
    if (line->empty()) break;
    if (line->starts_with("FORMAT=") && *line != "FORMAT=32-bit_rle_rgbe")
      return unsupported(name, "HDR pictures are read in RGBE only, found ", line->substr(0, 40));
  }
  const auto size_line = in.line();
  const auto size = size_line ? parse_size(*size_line) : std::nullopt;
  if (!size) return bad_file(name, "the size of the HDR picture: expected \"-Y HEIGHT +X WIDTH\"");
  const auto [height, width] = *size;
  SLF_TRY(check_size(name, width, height));
  Image image;
  image.width = static_cast<std::uint32_t>(width);
  image.height = static_cast<std::uint32_t>(height);
  Row row(image.width);
  for (std::uint32_t y = 0; y < image.height; ++y) {
    // Memory grows with the pixels that were read, whatever size the file claims.
    if (!in.row(row))
      return bad_file(name, "row ", y, " of ", image.height,
                      " of the HDR picture is damaged or missing");
    for (const auto& p : row) {
      const float unit = p[3] == 0 ? 0 : std::ldexp(1.f, p[3] - 136);
      image.rgba.emplace_back(unit * p[0], unit * p[1], unit * p[2], 1);
    }
  }
  return image;
}

}  // namespace slf::image_formats
