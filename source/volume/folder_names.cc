// The names of a folder's pictures: are they one series without gaps?
#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "base/try.h"
#include "source/volume/stack.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kMaxDigits = 18;  // such a number fits 64 bits

/// A file name, with its numbers taken out.
struct PictureName {
  std::string name;     // without the folder
  std::string pattern;  // '#' for each number
  std::vector<std::uint64_t> numbers;
  bool too_long = false;  // one of the numbers
};

PictureName parse_name(const std::string& path) {
  PictureName result;
  result.name = std::filesystem::path(path).filename().string();
  const auto dot = std::min(result.name.rfind('.'), result.name.size());
  const std::string text = result.name.substr(0, dot) + lower_case(result.name.substr(dot));
  constexpr std::string_view kDigits = "0123456789";
  for (std::size_t at = 0; at < text.size();) {
    const auto end = std::min(text.find_first_not_of(kDigits, at), text.size());
    if (end == at) {
      result.pattern += text[at++];
      continue;
    }
    result.pattern += '#';
    const auto first = std::min(text.find_first_not_of('0', at), end);
    result.too_long = result.too_long || end - first > kMaxDigits;
    const auto value = parse_integer(std::string_view(text).substr(at, end - at));
    result.numbers.push_back(static_cast<std::uint64_t>(value.value_or(0)));
    at = end;
  }
  return result;
}

/// The numbers in one place of all names, in ascending order.
std::vector<std::uint64_t> column(const std::vector<PictureName>& names, std::size_t place) {
  std::vector<std::uint64_t> numbers(names.size());
  std::ranges::transform(names, numbers.begin(), [&](auto& name) { return name.numbers[place]; });
  std::ranges::sort(numbers);
  return numbers;
}

/// Distances between ascending numbers.
struct Steps {
  std::uint64_t least = 0;
  std::size_t least_count = 0, count = 0;
  [[nodiscard]] bool even() const { return least_count == count; }
};

Steps steps_of(const std::vector<std::uint64_t>& numbers) {
  Steps steps{.count = numbers.size() - 1};
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    const std::uint64_t step = numbers[i] - numbers[i - 1];
    if (steps.least == 0 || step < steps.least) steps.least = step, steps.least_count = 0;
    steps.least_count += step == steps.least;
  }
  return steps;
}

/// "5, 9 to 12": what is missing between ascending numbers.
std::string missing(const std::vector<std::uint64_t>& numbers, std::uint64_t step) {
  constexpr int kMaxGaps = 8;
  std::string text;
  int gaps = 0;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    if (numbers[i] - numbers[i - 1] <= step) continue;
    if (++gaps > kMaxGaps) return text + " and more";
    const std::uint64_t first = numbers[i - 1] + step;
    const std::uint64_t last = numbers[i - 1] + (numbers[i] - 1 - numbers[i - 1]) / step * step;
    text.append(text.empty() ? "" : ", ").append(std::to_string(first));
    if (last > first) text.append(" to ").append(std::to_string(last));
  }
  return text;
}

/// Refuses names of several patterns, unless no two names share one. Strays are erased.
Result<void> check_patterns(const std::string& folder, std::vector<PictureName>& names,
                            std::vector<std::string>& notes) {
  std::map<std::string, std::vector<std::string>> by_pattern;
  for (const auto& name : names) by_pattern[name.pattern].push_back(name.name);
  if (by_pattern.size() == 1) return {};
  if (by_pattern.size() == names.size()) {
    notes.emplace_back("the names of its pictures share no numbers: stacked in their order");
    return {};
  }
  std::vector<std::vector<std::string>> series;
  series.reserve(by_pattern.size());
  for (auto& [pattern, members] : by_pattern) series.push_back(std::move(members));
  std::ranges::stable_sort(series,
                           [](const auto& a, const auto& b) { return a.size() > b.size(); });
  const std::size_t strays = names.size() - series[0].size();
  if (are_strays(strays, names.size())) {
    const std::string kept = parse_name(series[0].front()).pattern;
    std::erase_if(names, [&](const PictureName& name) { return name.pattern != kept; });
    notes.push_back(concat("left out ", strays, " of ", names.size() + strays, " pictures, ",
                           in_quotes(series[1].front()), strays > 1 ? " and others" : "",
                           ", named unlike the series ", in_quotes(series[0].front())));
    return {};
  }
  return unsupported(folder, "pictures of ", series.size(), " series: ", series[0].size(), " as ",
                     in_quotes(series[0].front()), ", ", series[1].size(), " as ",
                     in_quotes(series[1].front()),
                     ": move those of one series to a folder of their own");
}

}  // namespace

Result<void> check_numbering(const std::string& folder, std::vector<std::string>& files,
                             std::vector<std::string>& notes) {
  std::vector<PictureName> names(files.size());
  std::ranges::transform(files, names.begin(), parse_name);
  SLF_TRY(check_patterns(folder, names, notes));
  std::set<std::string> kept;
  for (const auto& name : names) kept.insert(name.name);
  std::erase_if(files,
                [&](const std::string& file) { return !kept.contains(parse_name(file).name); });
  const auto& pattern = names.front().pattern;
  if (names.back().pattern != pattern || names.size() < 2) return {};
  if (std::ranges::any_of(names, [](const auto& name) { return name.too_long; })) return {};

  // A place whose numbers all differ numbers the slices.
  std::vector<std::size_t> varying, slices;
  for (std::size_t place = 0; place < names.front().numbers.size(); ++place) {
    const auto numbers = column(names, place);
    if (numbers.front() != numbers.back()) varying.push_back(place);
    if (std::ranges::adjacent_find(numbers) == numbers.end()) slices.push_back(place);
  }
  if (slices.empty()) {
    for (std::size_t i = 1; i < names.size(); ++i)
      if (names[i].numbers == names[i - 1].numbers)
        return bad_file(folder, in_quotes(names[i - 1].name), " and ", in_quotes(names[i].name),
                        " have the same number: remove one");
    if (pattern.find("#.#") != std::string::npos) return {};  // positions as 12.5, perhaps
    const std::size_t place = varying.back();
    const auto again = std::find_if(names.begin() + 1, names.end(), [&](const PictureName& name) {
      return name.numbers[place] == names.front().numbers[place];
    });
    return unsupported(
        folder, "pictures of several series: ", in_quotes(names.front().name), " and ",
        in_quotes((again == names.end() ? names.back() : *again).name),
        " differ in more than one number: move those of one series to a folder of their own");
  }
  std::vector<std::uint64_t> best;
  for (const std::size_t place : slices) {
    const auto numbers = column(names, place);
    const Steps steps = steps_of(numbers);
    if (steps.even()) {
      if (steps.least > 1 && slices.size() == 1)
        notes.push_back("its pictures are numbered in steps of " + std::to_string(steps.least));
      return {};
    }
    if (best.empty() || numbers.back() - numbers.front() < best.back() - best.front())
      best = numbers;
  }
  const Steps steps = steps_of(best);
  if (2 * steps.least_count < steps.count) {
    notes.emplace_back("the numbers of its pictures are uneven: stacked in their order");
    return {};
  }
  return bad_file(
      folder, "of its pictures, numbered ", best.front(), " to ", best.back(), ", ",
      missing(best, steps.least),
      " is missing: add it, or number the pictures without a gap to stack them as they are");
}

}  // namespace slf::volume_io
