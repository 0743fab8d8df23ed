#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>

#include "cli/command.h"

namespace slf::cli {
namespace {

std::string scaled(double value, double base, const std::array<const char*, 5>& units,
                   const char* separator) {
  std::size_t unit = 0;
  while (value >= base && unit + 1 < units.size()) value /= base, ++unit;
  return unit == 0 ? fmt::format("{:.0f}{}{}", value, separator, units[0])
                   : fmt::format("{:.{}f}{}{}", value,
                                 value < 10    ? 2
                                 : value < 100 ? 1
                                               : 0,
                                 separator, units[unit]);
}

/// The length of the UTF-8 sequence at the start of `text`; 0 if there is no valid one. Surrogates,
/// overlong forms and code points above U+10FFFF are invalid.
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t k = 1; k < length; ++k)
    if (byte(k) >> 6 != 2) return 0;
  const unsigned two = first << 8 | byte(1);
  const bool bad = (two >= 0xE080 && two < 0xE0A0) || (two >= 0xEDA0 && two < 0xEE80) ||
                   (two >= 0xF080 && two < 0xF090) || two >= 0xF490;
  return bad ? 0 : length;
}

/// Control characters: C0 except line feeds and tabs, DEL, and C1.
bool is_control(std::string_view character) {
  const auto first = static_cast<unsigned char>(character[0]);
  if (character.size() == 1)
    return (first < 0x20 && first != '\n' && first != '\t') || first == 0x7F;
  return first == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0;
}

}  // namespace

bool quiet = false;

void reserve_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(stream, F_GETFD) < 0 && errno == EBADF) (void)open("/dev/null", O_RDONLY);
}

std::string printable(std::string_view text, Lines lines) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const std::string_view character = text.substr(0, std::max<std::size_t>(length, 1));
    const bool begins_line =
        character == "\n" && lines == Lines::indented && !text.substr(1).starts_with("  ");
    if (length > 0 && !is_control(character) && !begins_line)
      out += character;
    else
      for (const char c : character) out += fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    text.remove_prefix(character.size());
  }
  return out;
}

void print_text(std::string_view text) {
  const std::string line = printable(text);
  std::fwrite(line.data(), 1, line.size(), stdout);
}

void message(const std::string& text, Lines lines) {
  const std::string line = printable(text, lines) + "\n";
  std::fflush(stdout);  // keeps the order if both streams go to one place
  std::fwrite(line.data(), 1, line.size(), stderr);
}

void note(const std::string& text) {
  if (!quiet) message(text);
}

void print_json(nlohmann::json json) {
  if (nlohmann::json traffic = traffic_json(); !traffic.is_null() && json.is_object())
    json["http"] = std::move(traffic);
  print_text(json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

nlohmann::json finite_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

std::string text_of(const nlohmann::json& json, const char* key, const std::string& otherwise) {
  if (!json.is_object() || !json.contains(key) || !json[key].is_string()) return otherwise;
  return json[key].get<std::string>();
}

std::string human_bytes(double bytes) {
  return scaled(bytes, 1024, {"B", "KiB", "MiB", "GiB", "TiB"}, " ");
}

std::string human_count(double count) { return scaled(count, 1000, {"", "k", "M", "G", "T"}, " "); }

void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
#endif
}

void print_table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> width;
  for (const auto& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c) {
      width.resize(std::max(width.size(), c + 1));
      width[c] = std::max(width[c], row[c].size());
    }
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t c = 0; c < row.size(); ++c)
      line += c == 0 ? fmt::format("{:<{}}", row[c], width[c])
                     : fmt::format("  {:>{}}", row[c], width[c]);
    print("{}\n", line);
  }
}

}  // namespace slf::cli
