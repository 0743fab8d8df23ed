// MRIcroGL's .clut: an INI file of at most 256 colours over 0 to 255, with the range they stand
// for. Reads what MRIcroGL reads: sections in any order, other sections and lines, 256 for 255,
// three digits, nodes that end before 255.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "base/try.h"
#include "source/transfer/transfer_formats.h"
#include "source/volume/io.h"

namespace slf::transfer_formats {

using volume_io::in_quotes;

namespace {

struct Node {
  double intensity = 0;  ///< 0 to 1
  glm::dvec4 rgba{0.0};
};

/// red|green|blue|alpha; more is ignored. MRIcroGL takes what is above 255 as 255.
std::optional<glm::dvec4> parse_rgba(std::string_view text) {
  std::string channels(text);
  std::ranges::replace(channels, '|', ' ');
  const auto parts = volume_io::words(channels);
  if (parts.size() < 4) return std::nullopt;
  glm::dvec4 rgba;
  for (std::size_t channel = 0; channel < 4; ++channel) {
    const auto value = volume_io::parse_number(parts[channel]);
    if (!value || !(*value >= 0)) return std::nullopt;
    rgba[static_cast<int>(channel)] = std::min(*value, 255.0) / 255;
  }
  return rgba;
}

/// MRIcroGL writes decimal commas where the system does.
std::string with_point(std::string_view number) {
  std::string text(number);
  if (text.find('.') == std::string::npos) std::ranges::replace(text, ',', '.');
  return text;
}

}  // namespace

bool looks_like_clut(std::string_view text) {
  // The first line that is no comment is the header of a section. (In JSON, [ precedes no name.)
  while (!text.empty()) {
    const auto line = trim(next_line(text));
    if (line.empty() || line.starts_with(';') || line.starts_with('#')) continue;
    return line.size() > 2 && line.starts_with('[') && line.ends_with(']') &&
           std::isalpha(static_cast<unsigned char>(line[1])) &&
           std::ranges::all_of(line.substr(1, line.size() - 2),
                               [](unsigned char c) { return std::isalnum(c) || c == '_'; });
  }
  return false;
}

Presets parse_clut(std::string_view text, const std::string& source) {
  std::map<std::string, std::string_view> entries;
  while (!text.empty()) {
    const auto line = trim(next_line(text));
    const auto equals = line.find('=');
    if (equals == std::string_view::npos || line.starts_with(';')) continue;
    entries[lower_case(trim(line.substr(0, equals)))] = trim(line.substr(equals + 1));
  }
  const auto number = [&](const std::string& key, double min, double max) -> Result<double> {
    const auto found = entries.find(key);
    if (found == entries.end()) return bad_file(source, key, " is missing");
    const auto value = volume_io::parse_number(with_point(found->second));
    if (!value || !(*value >= min && *value <= max))
      return bad_file(source, key, " is ", in_quotes(found->second), ", expected a number from ",
                      min, " to ", max);
    return *value;
  };

  const auto count = SLF_TRY(number("numnodes", 1, 256));
  double from = 0, to = 0;
  for (const auto& [key, value] : {std::pair{"min", &from}, std::pair{"max", &to}}) {
    if (!entries.contains(key)) continue;
    const auto read = SLF_TRY(number(key, -1e300, 1e300));
    *value = read;
  }
  std::vector<Node> nodes;
  for (int i = 0; i < static_cast<int>(count); ++i) {
    const std::string index = std::to_string(i);
    const auto intensity = SLF_TRY(number("nodeintensity" + index, 0, 256));
    const auto found = entries.find("nodergba" + index);
    if (found == entries.end()) return bad_file(source, "nodergba", index, " is missing");
    const auto rgba = parse_rgba(found->second);
    if (!rgba)
      return bad_file(source, "nodergba", index, " is ", in_quotes(found->second),
                      ", expected red|green|blue|alpha, each 0 to 255");
    nodes.push_back({std::min(intensity, 255.0) / 255, *rgba});
  }
  std::ranges::stable_sort(nodes, {}, &Node::intensity);
  // The nodes stand for all of the range, also where they do not reach its ends.
  if (nodes.size() > 1) nodes.back().intensity = 1;
  if (nodes.front().intensity > 0) nodes.insert(nodes.begin(), {0, nodes.front().rgba});

  TransferPreset preset;
  preset.values = from < to ? TransferPreset::Values::absolute : TransferPreset::Values::relative;
  if (!(from < to)) from = 0, to = 1;
  preset.has_unit_distance = false;  // the file's opacity is per sample, not per millimetre
  preset.has_opacity = std::ranges::any_of(nodes, [](const Node& n) { return n.rgba.a > 0; });
  for (const auto& [intensity, rgba] : nodes) {
    const double value = std::lerp(from, to, intensity);
    preset.function.colors.push_back({value, glm::dvec3(rgba)});
    preset.function.opacities.push_back({value, rgba.a, 0.5, 0});
  }
  if (!preset.has_opacity) preset.function.opacities = opacity_ramp(from, to);
  return std::vector{std::move(preset)};
}

}  // namespace slf::transfer_formats
