// Parsing of header text, as in NRRD and MetaImage.
#include <array>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <limits>

#include "base/lower_case.h"
#include "base/utf8.h"
#include "field/volume/io.h"

namespace slf::volume_io {

std::string_view trim(std::string_view text) {
  constexpr std::string_view kSpace = " \t\r\n\v\f";
  const auto first = text.find_first_not_of(kSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpace) - first + 1);
}

std::string lower(std::string_view text) { return lower_case(std::string(text)); }

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

constexpr std::array<std::string_view, 5> kPackedEndings{"", ".gz", ".bz2", ".xz", ".zst"};

template <class T>
std::optional<T> parse(std::string_view text) {
  text = trim(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

std::optional<double> parse_number(std::string_view text) { return parse<double>(text); }
std::optional<std::int64_t> parse_integer(std::string_view text) {
  return parse<std::int64_t>(text);
}

namespace {

template <class T>
bool append_as(std::string_view word, std::vector<std::byte>& bytes) {
  const auto value = parse_number(word);
  if (!value) return false;
  if constexpr (std::is_integral_v<T>) {
    if (!(*value >= static_cast<double>(std::numeric_limits<T>::lowest())) ||
        !(*value <= static_cast<double>(std::numeric_limits<T>::max())))
      return false;
  }
  const T number = static_cast<T>(*value);
  const auto* from = reinterpret_cast<const std::byte*>(&number);
  bytes.insert(bytes.end(), from, from + sizeof number);
  return true;
}

}  // namespace

bool append_number(std::string_view word, ScalarType type, std::vector<std::byte>& bytes) {
  switch (type) {
    case ScalarType::u8:
      return append_as<std::uint8_t>(word, bytes);
    case ScalarType::i8:
      return append_as<std::int8_t>(word, bytes);
    case ScalarType::u16:
      return append_as<std::uint16_t>(word, bytes);
    case ScalarType::i16:
      return append_as<std::int16_t>(word, bytes);
    case ScalarType::u32:
      return append_as<std::uint32_t>(word, bytes);
    case ScalarType::i32:
      return append_as<std::int32_t>(word, bytes);
    case ScalarType::f32:
      return append_as<float>(word, bytes);
    case ScalarType::f64:
      return append_as<double>(word, bytes);
    case ScalarType::u64:
    case ScalarType::i64:
      break;
  }
  // Doubles would lose digits.
  const auto value = parse_integer(word);
  if (!value || (type == ScalarType::u64 && *value < 0)) return false;
  const auto* from = reinterpret_cast<const std::byte*>(&*value);
  bytes.insert(bytes.end(), from, from + sizeof *value);
  return true;
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

std::string beside(const std::string& header, std::string_view name) {
  const std::filesystem::path path(name);
  if (path.is_absolute()) return path.string();
  return (std::filesystem::path(header).parent_path() / path).lexically_normal().string();
}

Result<std::vector<std::string>> numbered_files(const std::string& header, std::string_view pattern,
                                                std::int64_t first, std::int64_t last,
                                                std::int64_t step) {
  // Not by printf: the pattern is untrusted.
  const auto percent = pattern.find('%');
  std::size_t end = percent == std::string_view::npos ? pattern.size() : percent + 1;
  const bool zeros = end < pattern.size() && pattern[end] == '0';
  std::size_t width = 0;
  for (; end < pattern.size() && pattern[end] >= '0' && pattern[end] <= '9' && width < 100; ++end)
    width = 10 * width + static_cast<std::size_t>(pattern[end] - '0');
  const bool known =
      end < pattern.size() && std::string_view("diu").find(pattern[end]) != std::string_view::npos;
  if (!known || width > 20 || pattern.find('%', end) != std::string_view::npos)
    return fail(ErrorCode::bad_file, header, ": the data files ", in_quotes(pattern),
                ", expected one %d for their numbers, as %03d");
  constexpr std::int64_t kMaxFiles = 1 << 20;
  if (!is_file_number(first) || !is_file_number(last) || !is_file_number(step) || step == 0 ||
      (step > 0) != (last >= first) || (last - first) / step >= kMaxFiles)
    return fail(ErrorCode::bad_file, header, ": data files numbered ", first, " to ", last,
                " in steps of ", step, ", expected at most ", kMaxFiles);
  std::vector<std::string> files;
  for (std::int64_t number = first; step > 0 ? number <= last : number >= last; number += step) {
    std::string digits = std::to_string(number);
    if (digits.size() < width) digits.insert(0, width - digits.size(), zeros ? '0' : ' ');
    files.push_back(beside(header, std::string(pattern.substr(0, percent)) + digits +
                                       std::string(pattern.substr(end + 1))));
  }
  return files;
}

std::string without_packing(const std::string& path) {
  const std::string file = lower(path);
  for (const std::string_view ending : kPackedEndings)
    if (!ending.empty() && file.ends_with(ending))
      return path.substr(0, path.size() - ending.size());
  return path;
}

std::string partner_of(const std::string& path, std::string_view ending) {
  namespace fs = std::filesystem;
  const std::string unpacked = without_packing(path);
  const std::string own = fs::path(unpacked).extension();
  std::string other(ending);
  if (own != lower(own))
    for (char& c : other) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  std::string plain = fs::path(unpacked).replace_extension(other);
  std::error_code code;
  if (std::string alike = plain + path.substr(unpacked.size()); fs::exists(alike, code))
    return alike;
  for (const std::string_view packing : kPackedEndings)
    if (std::string packed = plain + std::string(packing); fs::exists(packed, code)) return packed;
  return plain;
}

std::string_view next_line(std::string_view text, std::size_t& at) {
  const auto end = text.find('\n', at);
  auto line = text.substr(at, end == std::string_view::npos ? end : end - at);
  at = end == std::string_view::npos ? text.size() : end + 1;
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

}  // namespace slf::volume_io
