#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "base/try.h"
#include "base/utf8.h"
#include "slf/volume_parts.h"
#include "source/volume/io.h"

namespace slf {
namespace {

using nlohmann::json;
using volume_io::in_quotes;

/// A row of a table, its numbers as they are there.
struct Entry {
  std::int64_t id = 0;
  std::string name{};
  glm::dvec3 color{0.0};
  std::optional<double> opacity{};
  bool visible = true;
};

/// A number from 0 to `max`.
std::optional<double> number(std::string_view word, double max) {
  const auto value = volume_io::parse_number(word);
  if (!value || !(*value >= 0 && *value <= max)) return std::nullopt;
  return value;
}

std::optional<std::int64_t> parse_id(std::string_view word) {
  constexpr double kMaxId = 0x1p53;
  const auto value = volume_io::parse_number(word);
  if (!value || !(std::abs(*value) <= kMaxId) || *value != std::floor(*value)) return std::nullopt;
  return static_cast<std::int64_t>(*value);
}

std::optional<glm::dvec3> parse_color(std::string_view r, std::string_view g, std::string_view b) {
  const auto red = number(r, 255), green = number(g, 255), blue = number(b, 255);
  if (!red || !green || !blue) return std::nullopt;
  return glm::dvec3(*red, *green, *blue);
}

template <class... Parts>
tl::unexpected<Error> bad_line(const std::string& source, std::size_t line, const Parts&... parts) {
  return fail(ErrorCode::bad_file, source, ", line ", line, ": ", parts...);
}

/// The rows of a text, by line.
using Rows = std::vector<std::pair<std::size_t, Entry>>;

/// Colours and opacities run to 255, or to 1 where none in the table is more, but for rounding.
Result<LabelTable> table_of(const Rows& rows, const std::string& source, bool last_wins = false) {
  double color = 0, opacity = 0;
  for (const auto& [line, entry] : rows) {
    color = std::max({color, entry.color.x, entry.color.y, entry.color.z});
    opacity = std::max(opacity, entry.opacity.value_or(0));
  }
  const auto scale = [](double largest) { return largest > 2 ? 255.0 : 1.0; };
  LabelTable table;
  for (const auto& [line, entry] : rows) {
    const double own = entry.opacity   ? std::min(*entry.opacity / scale(opacity), 1.0)
                       : entry.id == 0 ? 0
                                       : 1;
    const LabelStyle style{entry.name, glm::min(entry.color / scale(color), 1.0),
                           entry.visible ? own : 0};
    const bool added = table.insert_or_assign(entry.id, style).second;
    if (!added && !last_wins) return bad_line(source, line, "the id ", entry.id, " occurs twice");
  }
  if (table.empty()) return bad_file(source, "a table without labels");
  return table;
}

// ---- lines of words: ITK-SNAP, 3D Slicer, FreeSurfer --------------------------------------------

using Words = std::vector<std::string_view>;

/// The words of a line. Text in double quotes is one word; # begins a comment.
Words words_of(std::string_view line) {
  constexpr const char* kBlank = " \t";
  Words words;
  for (std::size_t at = 0;;) {
    at = line.find_first_not_of(kBlank, at);
    if (at == std::string_view::npos || line[at] == '#') return words;
    const bool quoted = line[at] == '"';
    const std::size_t end = quoted ? line.find('"', at + 1) : line.find_first_of(kBlank, at);
    const std::size_t begin = quoted ? at + 1 : at;
    words.push_back(line.substr(begin, end == std::string_view::npos ? end : end - begin));
    if (end == std::string_view::npos) return words;
    at = quoted ? end + 1 : end;
  }
}

/// Not "inf" or "nan", which may be names.
bool is_number(std::string_view word) {
  const auto value = volume_io::parse_number(word);
  return value && std::isfinite(*value);
}

/// The text from one word of a line to another, without the ticks that some tables have around it.
std::string name_from(std::string_view first, std::string_view last) {
  std::string_view name(first.data(),
                        static_cast<std::size_t>(last.data() + last.size() - first.data()));
  while (name.size() > 1 && name.front() == '\'' && name.back() == '\'')
    name = name.substr(1, name.size() - 2);
  return std::string(name);
}

/// ITK-SNAP's lines have six numbers after the id, and the name last.
bool is_snap(const Words& words) {
  return words.size() >= 7 && std::all_of(words.begin() + 1, words.begin() + 7, is_number);
}

std::optional<Entry> parse_snap(const Words& words) {
  if (!is_snap(words)) return std::nullopt;
  const auto id = parse_id(words[0]);
  const auto color = parse_color(words[1], words[2], words[3]);
  const auto opacity = number(words[4], 1), visible = number(words[5], 1);
  if (!id || !color || !opacity || !visible || *visible != std::floor(*visible))
    return std::nullopt;
  Entry entry{.id = *id, .color = *color, .opacity = opacity, .visible = *visible != 0};
  if (words.size() > 7) entry.name = name_from(words[7], words.back());
  return entry;
}

/// Which program a comment names: the columns of Slicer and FreeSurfer are the same, but the last
/// one of FreeSurfer is no opacity.
enum class Origin { unknown, slicer, freesurfer, slicer_scale };

Origin origin_of(std::string_view comment) {
  const std::string text = lower_case(trim(comment));
  if (text.starts_with("color table file")) return Origin::slicer;
  if (text.starts_with("color procedural file")) return Origin::slicer_scale;
  const bool freesurfer = text.find("label name") != std::string::npos ||
                          text.find("freesurfercolorlut") != std::string::npos;
  return freesurfer ? Origin::freesurfer : Origin::unknown;
}

/// `ID NAME R G B`, mostly with an opacity and maybe further columns, which are ignored. Blanks in
/// a name are allowed; a name that is a number is not, except the id itself, since that may well be
/// a table without names.
std::optional<Entry> parse_named(const Words& words, Origin origin) {
  const auto count_at = [&](std::size_t first) {
    const auto end =
        std::find_if_not(words.begin() + std::ptrdiff_t(first), words.end(), is_number);
    return static_cast<std::size_t>(end - words.begin()) - first;
  };
  std::size_t red = 2;
  while (red < words.size() && count_at(red) < 3) ++red;
  if (red >= words.size()) return std::nullopt;
  std::size_t numbers = count_at(red);
  // Names that end with a number, as in "Area 4".
  if (origin == Origin::unknown && numbers > 4 && red + numbers == words.size() &&
      words.back() == "255")
    red += numbers - 4, numbers = 4;
  if (is_number(words[1]) && (red != 2 || numbers < 4 || words[1] != words[0])) return std::nullopt;
  const auto id = parse_id(words[0]);
  const auto color = parse_color(words[red], words[red + 1], words[red + 2]);
  const auto opacity = numbers > 3 ? number(words[red + 3], 255) : std::nullopt;
  if (!id || !color || (numbers > 3 && !opacity)) return std::nullopt;
  return Entry{*id, name_from(words[1], words[red - 1]), *color, opacity};
}

Result<LabelTable> parse_lines(std::string_view text, const std::string& source) {
  Rows rows;
  Origin origin = Origin::unknown;
  bool snap = false;
  for (std::size_t number = 1; !text.empty(); ++number) {
    const auto line = next_line(text);
    const auto words = words_of(line);
    if (const auto hash = line.find('#');
        words.empty() && hash != std::string_view::npos && origin == Origin::unknown)
      origin = origin_of(line.substr(hash + 1));
    if (origin == Origin::slicer_scale)
      return bad_line(source, number,
                      "a continuous scale of colours (3D Slicer's), which has no labels");
    if (words.empty()) continue;
    if (rows.empty()) snap = is_snap(words);
    auto entry = snap ? parse_snap(words) : parse_named(words, origin);
    if (!entry)
      return bad_line(source, number, "expected ",
                      rows.empty() || snap ? "ITK-SNAP's `ID R G B A VIS MESH \"NAME\"`" : "",
                      rows.empty() ? " or " : "",
                      rows.empty() || !snap ? "3D Slicer's or FreeSurfer's `ID NAME R G B A`" : "",
                      ", found ", in_quotes(trim(line)));
    rows.emplace_back(number, std::move(*entry));
  }
  if (snap) return table_of(rows, source);
  // Nobody makes a table to hide every label: then the last column is no opacity, as FreeSurfer's.
  const bool all_clear = std::ranges::all_of(
      rows, [](const auto& row) { return row.second.id == 0 || row.second.opacity == 0; });
  const bool freesurfer = origin == Origin::freesurfer || (origin == Origin::unknown && all_clear);
  for (auto& [line, entry] : rows)
    if (freesurfer) entry.opacity.reset();
  return table_of(rows, source, freesurfer);
}

// ---- 3D Slicer's CSV ----------------------------------------------------------------------------

constexpr std::string_view kIdColumn = "labelvalue";

/// The separator of a CSV whose first column is LabelValue.
std::optional<char> csv_separator(std::string_view text) {
  std::string header;
  while (header.empty() && !text.empty()) header = lower_case(trim(next_line(text)));
  std::erase(header, '"');
  if (!header.starts_with(kIdColumn) || header.size() == kIdColumn.size()) return std::nullopt;
  const char separator = header[kIdColumn.size()];
  if (separator != ',' && separator != ';' && separator != '\t') return std::nullopt;
  return separator;
}

Result<LabelTable> parse_csv(std::string_view text, char separator, const std::string& source) {
  Rows rows;
  std::map<std::string, std::size_t> columns;
  std::size_t line = 1;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t first = line;
    const auto cells = volume_io::next_row(text, at, line, separator);
    if (std::ranges::all_of(cells, &std::string::empty)) continue;
    if (columns.empty()) {
      for (std::size_t k = 0; k < cells.size(); ++k) columns.emplace(lower_case(cells[k]), k);
      for (const char* name : {"Color_R", "Color_G", "Color_B"})
        if (!columns.contains(lower_case(name)))
          return bad_line(source, first, "the column ", name,
                          " is missing; 3D Slicer's color tables have LabelValue, Name, Color_R, "
                          "Color_G, Color_B and Color_A");
      continue;
    }
    const auto field = [&](const std::string& name) -> std::string_view {
      const auto column = columns.find(name);
      if (column == columns.end() || column->second >= cells.size()) return {};
      return cells[column->second];
    };
    const auto id = parse_id(field(std::string(kIdColumn)));
    const auto color = parse_color(field("color_r"), field("color_g"), field("color_b"));
    const auto stated = field("color_a");
    const auto opacity = number(stated, 255);
    if (!id)
      return bad_line(source, first, "LabelValue is ", in_quotes(field(std::string(kIdColumn))),
                      ", expected an integer");
    if (!color || (!opacity && !stated.empty()))
      return bad_line(source, first,
                      "expected 0 to 255 as each of Color_R, Color_G, Color_B and Color_A");
    rows.emplace_back(first, Entry{*id, std::string(field("name")), *color, opacity});
  }
  return table_of(rows, source);
}

// ---- JSON ---------------------------------------------------------------------------------------

Result<LabelTable> parse_json(std::string_view text, const std::string& source) {
  const json all = json::parse(text, nullptr, /*allow_exceptions=*/false);
  const auto bad = [&](const std::string& what) {
    return bad_file(source, "not a table of labels: ", what);
  };
  if (!all.is_object() || !all.contains("labels") || !all["labels"].is_array())
    return bad("expected {\"labels\": [...]}");
  LabelTable table;
  const auto share = [](const json& v) {
    return v.is_number() && v.get<double>() >= 0 && v.get<double>() <= 1;
  };
  for (std::size_t k = 0; k < all["labels"].size(); ++k) {
    const json& label = all["labels"][k];
    const std::string place = "labels[" + std::to_string(k) + "]";
    if (!label.is_object() || !label.contains("id") || !label["id"].is_number_integer())
      return bad(place + ".id: expected an integer");
    LabelStyle style;
    if (const auto name = label.find("name"); name != label.end() && name->is_string())
      style.name = name->get<std::string>();
    if (const auto color = label.find("color"); color != label.end()) {
      if (!color->is_array() || color->size() != 3 || !std::ranges::all_of(*color, share))
        return bad(place + ".color: expected three numbers from 0 to 1");
      style.color = glm::dvec3((*color)[0].get<double>(), (*color)[1].get<double>(),
                               (*color)[2].get<double>());
    }
    if (const auto opacity = label.find("opacity"); opacity != label.end()) {
      if (!share(*opacity)) return bad(place + ".opacity: expected 0 to 1");
      style.opacity = opacity->get<double>();
    }
    if (!table.emplace(label["id"].get<std::int64_t>(), style).second)
      return bad(place + ".id: occurs twice");
  }
  if (table.empty()) return bad("no labels");
  return table;
}

}  // namespace

Result<LabelTable> parse_label_table(const std::string& bytes, const std::string& source) try {
  std::string made;
  const std::string_view text = as_utf8(bytes, made);
  if (trim(text).starts_with('{')) return parse_json(text, source);
  if (const auto separator = csv_separator(text)) return parse_csv(text, *separator, source);
  return parse_lines(text, source);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<LabelTable> read_label_table(const std::string& path) try {
  if (path.starts_with('{')) return parse_json(path, "label table");
  constexpr std::uint64_t kMaxBytes = 16 << 20;
  const auto bytes = SLF_TRY(read_file(path, kMaxBytes));
  return parse_label_table(std::string(chars_of(bytes)), path);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
