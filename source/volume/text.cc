// Parsing of header text, as in NRRD and MetaImage.
#include <array>
#include <cctype>
#include <charconv>
#include <limits>

#include "base/ascii.h"
#include "base/try.h"
#include "base/utf8.h"
#include "source/volume/io.h"
#include "source/volume/voxels.h"

namespace slf::volume_io {

std::vector<std::string_view> words(std::string_view text) {
  std::vector<std::string_view> result;
  for (text = trim(text); !text.empty(); text = trim(text)) {
    const auto word = text.substr(0, text.find_first_of(" \t\r\n\v\f"));
    result.push_back(word);
    text.remove_prefix(word.size());
  }
  return result;
}

namespace {

template <class T>
std::optional<T> parse(std::string_view text) {
  text = trim(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (end != text.data() + text.size() || text.empty()) return std::nullopt;
  // Beyond the range of double: zero, or infinity.
  if (std::is_floating_point_v<T> && error == std::errc::result_out_of_range)
    return text.find("e-") != text.npos || text.find("E-") != text.npos
               ? T{0}
               : std::numeric_limits<T>::infinity();
  return error == std::errc() ? std::optional(value) : std::nullopt;
}

}  // namespace

std::optional<double> parse_number(std::string_view text) { return parse<double>(text); }
std::optional<std::int64_t> parse_integer(std::string_view text) {
  return parse<std::int64_t>(text);
}

bool append_number(std::string_view word, ScalarType type, std::vector<std::byte>& bytes) {
  return with_type(type, [&]<class T>(T number) {
    // Doubles would lose digits of the longest integers.
    constexpr bool kLong = std::is_integral_v<T> && sizeof(T) == 8;
    const auto value = parse<std::conditional_t<kLong, std::int64_t, double>>(word);
    if (!value || (std::is_unsigned_v<T> && *value < 0)) return false;
    using Limits = std::numeric_limits<T>;
    if constexpr (std::is_integral_v<T> && !kLong)
      if (!(*value >= Limits::lowest() && *value <= Limits::max())) return false;
    number = static_cast<T>(*value);
    const auto* from = reinterpret_cast<const std::byte*>(&number);
    bytes.insert(bytes.end(), from, from + sizeof number);
    return true;
  });
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t kMost = 40;
  std::string result = "'";
  for (std::string_view rest = text.substr(0, kMost); !rest.empty();) {
    const std::size_t length = utf8_length(rest);
    const auto character = rest.substr(0, std::max<std::size_t>(length, 1));
    const bool shown =
        length > 0 && !is_control(character) && character != "\n" && character != "\t";
    result += shown ? std::string(character) : escaped(character);
    rest.remove_prefix(character.size());
  }
  return result + (text.size() > kMost ? "...'" : "'");
}

std::vector<std::string> next_row(std::string_view text, std::size_t& at, std::size_t& line,
                                  char separator) {
  std::vector<std::string> cells{""};
  for (bool quoted = false; at < text.size();) {
    char c = text[at++];
    if (c == '\r' && text.substr(at, 1) != "\n") c = '\n';
    if (c == '\n') ++line;
    if (c == '"' && quoted && at < text.size() && text[at] == '"') {
      cells.back() += text[at++];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == '\n' && !quoted) {
      break;
    } else if (c == separator && !quoted) {
      cells.emplace_back();
    } else if (quoted || c != '\r') {
      cells.back() += c;
    }
  }
  for (std::string& cell : cells) cell = trim(cell, " \t");
  return cells;
}

void TextHeader::list(std::string_view lines) {
  while (!lines.empty())
    if (const auto name = trim(next_line(lines)); !name.empty()) listed.emplace_back(name);
}

const std::string* TextHeader::find(std::string_view field) const {
  const auto found = fields.find(field);
  return found == fields.end() ? nullptr : &found->second;
}

Result<std::string> TextHeader::required(std::string_view field) const {
  if (const std::string* text = find(field)) return *text;
  return bad_file(path, "the header has no '", field, ":' line");
}

Result<std::int64_t> TextHeader::integer(std::string_view field, std::int64_t low,
                                         std::int64_t high,
                                         std::optional<std::int64_t> otherwise) const {
  if (otherwise && !find(field)) return *otherwise;
  const auto text = SLF_TRY(required(field));
  const auto value = parse_integer(text);
  if (value && *value >= low && *value <= high) return *value;
  return bad_file(path, "'", field, "' is ", in_quotes(text), ", expected ", low, " to ", high);
}

Result<std::vector<std::string_view>> TextHeader::parts(std::string_view field,
                                                        std::size_t count) const {
  const std::string* text = find(field);
  if (!text) return std::vector<std::string_view>{};
  auto parts = words(*text);
  if (parts.size() == count) return parts;
  return bad_file(path, "'", field, ": ", in_quotes(*text), "' has ", parts.size(),
                  " values, expected ", count);
}

Result<std::vector<double>> TextHeader::numbers(std::string_view field, std::size_t count) const {
  std::vector<double> numbers;
  const auto texts = SLF_TRY(parts(field, count));
  for (const auto text : texts) {
    const auto number = parse_number(text);
    if (!number)
      return bad_file(path, "'", field, "' ", numbers.size(), " is ", in_quotes(text),
                      ", expected a number");
    numbers.push_back(*number);
  }
  return numbers;
}

Result<std::vector<std::uint64_t>> TextHeader::sizes(std::string_view field,
                                                     std::size_t count) const {
  SLF_TRY(required(field));
  std::vector<std::uint64_t> sizes;
  const auto texts = SLF_TRY(parts(field, count));
  for (const auto text : texts) {
    const auto size = parse_integer(text);
    if (!size || *size < 1)
      return bad_file(path, "'", field, "' ", sizes.size(), " is ", in_quotes(text),
                      ", expected a positive integer");
    sizes.push_back(static_cast<std::uint64_t>(*size));
  }
  return sizes;
}

Result<void> TextHeader::check_data_file(const std::string& file) const {
  const auto size = file_size(file);
  if (size) return {};
  return fail_in(size.error(), path, ": its data file cannot be read: ");
}

}  // namespace slf::volume_io
