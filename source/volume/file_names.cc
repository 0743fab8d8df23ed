// The names of the files that headers name, and of those beside them.
#include <array>
#include <cctype>
#include <filesystem>

#include "base/file_finder.h"
#include "base/try.h"
#include "source/volume/io.h"

namespace slf::volume_io {
namespace {

constexpr std::array<std::string_view, 5> kPackedEndings{"", ".gz", ".bz2", ".xz", ".zst"};

}  // namespace

std::string beside(const std::string& header, std::string_view name) {
  const std::filesystem::path path(name);
  if (path.is_absolute()) return path.string();
  return (std::filesystem::path(header).parent_path() / path).lexically_normal().string();
}

std::vector<std::string> TextHeader::find_files(std::vector<std::string> names,
                                                std::vector<std::string>& notes) const {
  FileFinder finder(std::filesystem::path(path).parent_path());
  for (std::string& name : names) name = finder.find(name).value_or(beside(path, name));
  if (finder.moved() > 0)
    notes.push_back("its data are not where it says, but in " + names.front());
  return names;
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
    return bad_file(header, "the data files ", in_quotes(pattern),
                    ", expected one %d for their numbers, as %03d");
  constexpr std::int64_t kMaxFiles = 1 << 20;
  if (!is_file_number(first) || !is_file_number(last) || !is_file_number(step) || step == 0 ||
      (step > 0) != (last >= first) || (last - first) / step >= kMaxFiles)
    return bad_file(header, "data files numbered ", first, " to ", last, " in steps of ", step,
                    ", expected at most ", kMaxFiles);
  std::vector<std::string> files;
  for (std::int64_t number = first; step > 0 ? number <= last : number >= last; number += step) {
    std::string digits = std::to_string(number);
    if (digits.size() < width) digits.insert(0, width - digits.size(), zeros ? '0' : ' ');
    files.push_back(std::string(pattern.substr(0, percent)) + digits +
                    std::string(pattern.substr(end + 1)));
  }
  return files;
}

std::string without_packing(const std::string& path) {
  const std::string file = lower_case(path);
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
  if (own != lower_case(own))
    for (char& c : other) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  std::string plain = fs::path(unpacked).replace_extension(other);
  std::error_code code;
  if (std::string alike = plain + path.substr(unpacked.size()); fs::exists(alike, code))
    return alike;
  for (const std::string_view packing : kPackedEndings)
    if (std::string packed = plain + std::string(packing); fs::exists(packed, code)) return packed;
  const fs::path file = plain;
  return FileFinder(file.parent_path()).find(file.filename()).value_or(plain);
}

}  // namespace slf::volume_io
