// MRIcroGL's .clut: an INI file of at most 256 colours over 0 to 255, with the range they stand
// for.
#include <cmath>
#include <map>

#include "field/volume/io.h"
#include "field/volume/transfer_formats.h"

namespace slf::transfer_formats {

using volume_io::in_quotes;

bool looks_like_clut(std::string_view text) {
  const auto first = volume_io::lower(volume_io::trim(text.substr(0, 64)));
  return first.starts_with("[flt]") || first.starts_with("[int]") || first.starts_with("[byt]") ||
         first.starts_with("[rgba255]");
}

Presets parse_clut(std::string_view text, const std::string& source) {
  std::map<std::string, std::string_view> entries;
  for (std::size_t at = 0; at < text.size();) {
    const auto line = volume_io::trim(volume_io::next_line(text, at));
    const auto equals = line.find('=');
    if (equals == std::string_view::npos) continue;
    entries[volume_io::lower(volume_io::trim(line.substr(0, equals)))] =
        volume_io::trim(line.substr(equals + 1));
  }
  const auto number = [&](const std::string& key, double min, double max) -> Result<double> {
    const auto found = entries.find(key);
    if (found == entries.end()) return fail(ErrorCode::bad_file, source, ": ", key, " is missing");
    const auto value = volume_io::parse_number(found->second);
    if (!value || !(*value >= min && *value <= max))
      return fail(ErrorCode::bad_file, source, ": ", key, " is ", in_quotes(found->second),
                  ", expected a number from ", min, " to ", max);
    return *value;
  };

  const auto count = number("numnodes", 1, 256);
  if (!count) return tl::unexpected(count.error());
  double from = 0, to = 0;
  for (const auto& [key, value] : {std::pair{"min", &from}, std::pair{"max", &to}}) {
    if (!entries.contains(key)) continue;
    const auto read = number(key, -1e300, 1e300);
    if (!read) return tl::unexpected(read.error());
    *value = *read;
  }
  TransferPreset preset;
  preset.values = from < to ? TransferPreset::Values::absolute : TransferPreset::Values::relative;
  if (!(from < to)) from = 0, to = 1;
  preset.has_unit_distance = false;  // the file's opacity is per sample, not per millimetre
  bool any_opacity = false;
  double before = -1;
  for (int i = 0; i < static_cast<int>(*count); ++i) {
    const std::string index = std::to_string(i);
    const auto intensity = number("nodeintensity" + index, 0, 255);
    if (!intensity) return tl::unexpected(intensity.error());
    if (*intensity < before)
      return fail(ErrorCode::bad_file, source, ": nodeintensity", index, " is ", *intensity,
                  ", below the one before it (", before, "): nodes must ascend");
    before = *intensity;
    const auto found = entries.find("nodergba" + index);
    if (found == entries.end())
      return fail(ErrorCode::bad_file, source, ": nodergba", index, " is missing");
    std::string channels(found->second);
    for (char& c : channels) c = c == '|' ? ' ' : c;
    const auto parts = volume_io::words(channels);
    std::array<double, 4> rgba{};
    for (std::size_t channel = 0; channel < 4; ++channel) {
      const auto value = parts.size() == 4 ? volume_io::parse_number(parts[channel]) : std::nullopt;
      if (!value || !(*value >= 0 && *value <= 255))
        return fail(ErrorCode::bad_file, source, ": nodergba", index, " is ",
                    in_quotes(found->second), ", expected red|green|blue|alpha, each 0 to 255");
      rgba[channel] = *value / 255;
    }
    const double value = std::lerp(from, to, *intensity / 255);
    preset.function.colors.push_back({value, {rgba[0], rgba[1], rgba[2]}});
    preset.function.opacities.push_back({value, rgba[3], 0.5, 0});
    any_opacity = any_opacity || rgba[3] > 0;
  }
  preset.has_opacity = any_opacity;
  if (!any_opacity) preset.function.opacities = opacity_ramp(from, to);
  return std::vector{std::move(preset)};
}

}  // namespace slf::transfer_formats
