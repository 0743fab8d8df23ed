// 3D Slicer's volume property, .vp: nine lines. The seventh has opacities, a count and then pairs;
// the ninth has colours, a count and then groups of four. The others are about lighting.
#include <cctype>
#include <cmath>

#include "base/try.h"
#include "source/transfer/transfer_formats.h"
#include "source/volume/io.h"

namespace slf::transfer_formats {

namespace {

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const auto line = trim(next_line(text));
    if (!line.empty()) lines.push_back(line);
  }
  return lines;
}

/// Reads text: a count of numbers, then the numbers, `stride` per point. The first number of each
/// point ascends; the others are in 0..1. `place` begins messages.
Result<std::vector<double>> read_points(std::string_view text, std::size_t stride,
                                        const std::string& place) {
  const auto bad = [&](const auto&... parts) { return bad_file(place, parts...); };
  const auto words = volume_io::words(text);
  if (words.empty()) return bad("is empty, expected a count of numbers and the numbers");
  const auto count = volume_io::parse_integer(words.front());
  if (!count || *count < static_cast<std::int64_t>(stride) ||
      *count % static_cast<std::int64_t>(stride) != 0)
    return bad("begins with ", volume_io::in_quotes(words.front()),
               ", expected a count of numbers, ", stride, " a point");
  // A comment may follow ("=> ...").
  if (words.size() - 1 < static_cast<std::size_t>(*count))
    return bad("has ", words.size() - 1, " numbers, expected ", *count);
  std::vector<double> numbers;
  for (std::size_t i = 0; i < static_cast<std::size_t>(*count); ++i) {
    const auto value = volume_io::parse_number(words[i + 1]);
    if (!value || !std::isfinite(*value))
      return bad(volume_io::in_quotes(words[i + 1]), " is not a number");
    if (i % stride == 0 ? i > 0 && *value < numbers[i - stride] : !(*value >= 0 && *value <= 1))
      return bad("number ", i + 1, " is ", *value,
                 i % stride == 0 ? ", below the point before it: points must ascend in value"
                                 : ", expected 0 to 1");
    numbers.push_back(*value);
  }
  return numbers;
}

}  // namespace

Result<TransferPreset> points_of(std::string_view opacities, const std::string& place_of_opacities,
                                 std::string_view colors, const std::string& place_of_colors) {
  const auto opacity = SLF_TRY(read_points(opacities, 2, place_of_opacities));
  const auto color = SLF_TRY(read_points(colors, 4, place_of_colors));
  TransferPreset preset;
  for (auto p = opacity.begin(); p != opacity.end(); p += 2)
    preset.function.opacities.push_back({p[0], p[1], 0.5, 0});
  for (auto p = color.begin(); p != color.end(); p += 4)
    preset.function.colors.push_back({p[0], {p[1], p[2], p[3]}});
  return preset;
}

bool looks_like_vp(std::string_view text) {
  const auto lines = lines_of(text.substr(0, 65536));
  return lines.size() >= 7 && std::isdigit(static_cast<unsigned char>(lines[0].front())) &&
         volume_io::words(lines[6]).size() >= 3;
}

Presets parse_vp(std::string_view text, const std::string& source) {
  const auto lines = lines_of(text);
  if (lines.size() < 9)
    return bad_file(
        source, lines.size(),
        " lines, expected the 9 of a volume property: opacities in the 7th, colours in the 9th");
  auto preset = SLF_TRY(points_of(lines[6], source + ": line 7", lines[8], source + ": line 9"));
  return std::vector{std::move(preset)};
}

}  // namespace slf::transfer_formats
