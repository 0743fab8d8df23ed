#include "cli/drawing.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace slf::cli {
namespace {

constexpr unsigned kFinestDrawn = 4;  // section level; finer ones would be dots
constexpr int kArcSteps = 6;          // lines an arc of a section is drawn with
constexpr double kRadius = 190;       // of a sphere in the picture
constexpr const char* kColors[] = {"#1f5fa8", "#c8502d", "#3b8a3e", "#7b4ba0", "#8a6d1c"};

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<')
      out += "&lt;";
    else if (c == '&')
      out += "&amp;";
    else
      out += c;
  }
  return out;
}

std::string svg(int width, int height, const std::string& body) {
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{}\" height=\"{}\" "
      "font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" "
      "fill=\"white\"/>\n{}</svg>\n",
      width, height, width, height, body);
}

std::string text_at(double x, double y, const std::string& text, const char* anchor = "middle") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>\n", x, y, anchor,
                     escaped(text));
}

/// The axes of the picture plane, and the direction towards the eye.
struct Frame {
  glm::dvec3 right, up, toward;

  explicit Frame(const Sphere& sphere, const Camera& camera) {
    toward = glm::normalize(camera.eye - sphere.center);
    right = glm::normalize(glm::cross(camera.up, toward));
    up = glm::cross(toward, right);
  }
};

/// A section's outline, as the points of a polygon around (x, y).
std::string outline(Section section, const Frame& frame, double x, double y) {
  std::string points;
  const auto add = [&](int p, int q) {
    const LocalPoint local{static_cast<std::uint16_t>(p), static_cast<std::uint16_t>(q)};
    const glm::dvec3 d = direction(vertex_at(section, local, kArcSteps));
    points += fmt::format("{:.1f},{:.1f} ", x + kRadius * glm::dot(d, frame.right),
                          y - kRadius * glm::dot(d, frame.up));
  };
  for (int k = 0; k < kArcSteps; ++k) add(k, 0);
  for (int k = 0; k < kArcSteps; ++k) add(kArcSteps - k, k);
  for (int k = 0; k < kArcSteps; ++k) add(0, kArcSteps - k);
  return points;
}

/// A section's ancestor that is still drawn.
Section drawn(Section section) {
  while (section.level > kFinestDrawn) section = section.parent();
  return section;
}

/// One side of the sphere, around (x, y): all sections of a level there, shaded by their counts.
std::string draw_side(const std::map<Section, std::size_t>& counts, unsigned level,
                      const Frame& frame, bool front, double x, double y) {
  std::size_t most = 1;
  for (const auto& [section, count] : counts) most = std::max(most, count);
  std::string body;
  for (std::uint32_t index = 0; index < section_count(level); ++index) {
    const Section section{static_cast<std::uint8_t>(level), index};
    const glm::dvec3 middle = direction(vertex_at(section, {1, 1}, 3));
    if ((glm::dot(middle, frame.toward) > 0) != front) continue;
    const auto found = counts.find(section);
    const double share =
        found == counts.end() ? 0 : static_cast<double>(found->second) / static_cast<double>(most);
    body += fmt::format(
        "<polygon points=\"{}\" fill=\"{}\" fill-opacity=\"{:.2f}\" stroke=\"#999\" "
        "stroke-width=\"0.5\"/>\n",
        outline(section, frame, x, y), found == counts.end() ? "#f4f4f4" : kColors[front ? 0 : 1],
        found == counts.end() ? 1 : 0.25 + 0.75 * share);
  }
  return body;
}

}  // namespace

std::string draw_sections(const FieldShape& shape, const Camera& camera, unsigned level,
                          std::span<const TileKey> tiles) {
  std::map<Section, std::size_t> entries, exits;
  for (const TileKey& key : tiles) {
    if (key.level != level) continue;
    const TileSections sections = sections_of(key, shape.entry_extra_levels);
    ++entries[drawn(sections.entry)];
    ++exits[drawn(sections.exit)];
  }
  const Frame frame(shape.sphere, camera);
  const double left = 30 + kRadius, right = 60 + 3 * kRadius, y = 70 + kRadius;
  const auto caption = [&](const char* what, const std::map<Section, std::size_t>& counts,
                           unsigned section_level) {
    return fmt::format("{}: {} of {} sections", what, counts.size(),
                       section_count(std::min(section_level, kFinestDrawn)));
  };
  const unsigned entry_level = level + shape.entry_extra_levels;
  std::string body = text_at((left + right) / 2, 24,
                             fmt::format("Level {}: {} tiles touched, of {}", level, tiles.size(),
                                         tile_count(level, shape.entry_extra_levels)));
  body += text_at(left, 48, caption("Entry, the near side", entries, entry_level));
  body += text_at(right, 48, caption("Exit, the far side seen through", exits, level));
  body += draw_side(entries, std::min(entry_level, kFinestDrawn), frame, true, left, y);
  body += draw_side(exits, std::min(level, kFinestDrawn), frame, false, right, y);
  return svg(static_cast<int>(90 + 4 * kRadius), static_cast<int>(90 + 2 * kRadius), body);
}

std::string draw_plot(const std::string& title, const std::string& x_label,
                      const std::string& y_label, const std::vector<Series>& series) {
  constexpr double kLeft = 80, kTop = 40, kWidth = 460, kHeight = 320;
  double x_low = 1e300, x_high = -1e300, y_low = 1e300, y_high = -1e300;
  for (const Series& s : series)
    for (const auto& [x, y] : s.points) {
      x_low = std::min(x_low, x), x_high = std::max(x_high, x);
      y_low = std::min(y_low, std::log10(y)), y_high = std::max(y_high, std::log10(y));
    }
  y_low = std::floor(y_low), y_high = std::max(std::ceil(y_high), y_low + 1);
  x_high = std::max(x_high, x_low + 1);
  const auto at_x = [&](double x) { return kLeft + kWidth * (x - x_low) / (x_high - x_low); };
  const auto at_y = [&](double log) { return kTop + kHeight * (y_high - log) / (y_high - y_low); };
  const auto line = [](double x1, double y1, double x2, double y2) {
    return fmt::format(
        "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"#ddd\"/>\n", x1, y1,
        x2, y2);
  };
  std::string body = text_at(kLeft + kWidth / 2, 22, title);
  for (double x = std::ceil(x_low); x <= x_high; ++x) {
    body += line(at_x(x), kTop, at_x(x), kTop + kHeight);
    body += text_at(at_x(x), kTop + kHeight + 20, fmt::format("{}", x));
  }
  for (double log = y_low; log <= y_high; ++log) {
    body += line(kLeft, at_y(log), kLeft + kWidth, at_y(log));
    body += text_at(kLeft - 8, at_y(log) + 4, fmt::format("{:g}", std::pow(10, log)), "end");
  }
  body += text_at(kLeft + kWidth / 2, kTop + kHeight + 42, x_label);
  body += fmt::format(
      "<text transform=\"translate(18 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
      kTop + kHeight / 2, escaped(y_label));
  for (std::size_t k = 0; k < series.size(); ++k) {
    const char* color = kColors[k % std::size(kColors)];
    std::string points;
    for (const auto& [x, y] : series[k].points)
      points += fmt::format("{:.1f},{:.1f} ", at_x(x), at_y(std::log10(y)));
    body +=
        fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>\n",
                    points, color);
    for (const auto& [x, y] : series[k].points)
      body += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.5\" fill=\"{}\"/>\n", at_x(x),
                          at_y(std::log10(y)), color);
    const double row = kTop + 16 + 20 * static_cast<double>(k);
    body += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"14\" height=\"4\" fill=\"{}\"/>\n",
                        kLeft + kWidth + 12, row - 6, color);
    body += text_at(kLeft + kWidth + 32, row, series[k].name, "start");
  }
  return svg(860, 430, body);
}

}  // namespace slf::cli
