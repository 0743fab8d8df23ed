#include <cctype>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "slf/structures.h"

namespace slf {
namespace {

using nlohmann::json;

/// The words of a line. Text in quotes is one word.
std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::size_t at = 0;;) {
    at = line.find_first_not_of(" \t\r", at);
    if (at == std::string_view::npos) return words;
    const bool quoted = line[at] == '"';
    const std::size_t end = quoted ? line.find('"', at + 1) : line.find_first_of(" \t\r", at);
    const std::size_t begin = quoted ? at + 1 : at;
    words.push_back(line.substr(begin, end == std::string_view::npos ? end : end - begin));
    if (end == std::string_view::npos) return words;
    at = quoted ? end + 1 : end;
  }
}

std::optional<double> number(std::string_view word) {
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

struct Entry {
  std::int64_t id;
  LabelStyle style;
};

/// A line of either table; nothing if it is neither.
std::optional<Entry> parse_line(const std::vector<std::string_view>& words) {
  const bool snap = words.size() == 8 && number(words[1]);
  const bool slicer = words.size() == 6 && !number(words[1]);
  if (!snap && !slicer) return std::nullopt;
  const std::size_t red = snap ? 1 : 2;
  std::vector<double> numbers;
  for (const std::size_t k : {std::size_t{0}, red, red + 1, red + 2, red + 3}) {
    const auto value = number(words[k]);
    if (!value) return std::nullopt;
    numbers.push_back(*value);
  }
  const double full = snap ? 1 : 255;  // of opacity
  for (std::size_t k = 1; k < 5; ++k)
    if (numbers[k] < 0 || numbers[k] > (k < 4 ? 255 : full)) return std::nullopt;
  if (std::abs(numbers[0]) > 1e9 || numbers[0] != std::floor(numbers[0])) return std::nullopt;
  Entry entry{static_cast<std::int64_t>(numbers[0]), {}};
  entry.style.name = std::string(words[snap ? 7 : 1]);
  entry.style.color = glm::dvec3(numbers[1], numbers[2], numbers[3]) / 255.0;
  entry.style.opacity = numbers[4] / full;
  if (!snap) return entry;
  const auto visible = number(words[5]);
  if (!visible || (*visible != 0 && *visible != 1)) return std::nullopt;
  entry.style.opacity *= *visible;
  return entry;
}

Result<LabelTable> parse_lines(std::string_view text, const std::string& source) {
  LabelTable table;
  for (std::size_t line = 1; !text.empty(); ++line) {
    const std::size_t end = text.find('\n');
    const auto words = words_of(text.substr(0, end));
    text = end == std::string_view::npos ? "" : text.substr(end + 1);
    if (words.empty() || words[0].starts_with('#')) continue;
    const auto entry = parse_line(words);
    if (!entry)
      return fail(
          ErrorCode::bad_file, source, ", line ", line,
          ": expected ITK-SNAP's `ID R G B A VIS MESH \"NAME\"` or 3D Slicer's `ID NAME R G "
          "B A`");
    if (!table.emplace(entry->id, entry->style).second)
      return fail(ErrorCode::bad_file, source, ", line ", line, ": the id ", entry->id,
                  " occurs twice");
  }
  if (table.empty()) return fail(ErrorCode::bad_file, source, ": a table without labels");
  return table;
}

Result<LabelTable> parse_json(const std::string& text, const std::string& source) {
  const json all = json::parse(text, nullptr, /*allow_exceptions=*/false);
  const auto bad = [&](const std::string& what) {
    return fail(ErrorCode::bad_file, source, ": not a table of labels: ", what);
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
      if (!color->is_array() || color->size() != 3 || !share((*color)[0]) || !share((*color)[1]) ||
          !share((*color)[2]))
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

Result<LabelTable> parse_label_table(const std::string& bytes, const std::string& source) {
  const std::size_t first = bytes.find_first_not_of(" \t\r\n");
  const bool is_json = first != std::string::npos && bytes[first] == '{';
  return is_json ? parse_json(bytes, source) : parse_lines(bytes, source);
}

Result<LabelTable> read_label_table(const std::string& path) {
  constexpr std::uint64_t kMaxBytes = 16 << 20;
  const auto bytes = read_file(path, kMaxBytes);
  if (!bytes) return tl::unexpected(bytes.error());
  return parse_label_table({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path);
}

}  // namespace slf
