// A folder as a volume: a DICOM series, or pictures in the order of their names.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <map>
#include <set>

#include "base/try.h"
#include "source/volume/formats.h"
#include "source/volume/stack.h"

namespace slf::volume_io {

namespace {

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

/// Orders names as people do: numbers in them by value.
bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [](const std::string& text, std::size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const std::size_t first = at;
      while (at < text.size() && is_digit(text[at])) ++at;
      return std::string_view(text).substr(first, at - first);
    };
    const auto x = number(a, i), y = number(b, j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

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

/// Checks the names of the pictures in a folder, sorted: one series, numbered without gaps. Takes
/// strays of other names out, with a note. Adds notes on numbers in steps, and on names that cannot
/// be checked.
/// unsupported: two series. bad_file: a number is missing, or there twice.
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

/// A kind of pictures that folders may hold.
struct PictureFormat {
  const char* plural;
  bool (*looks_like)(std::string_view head);
  SliceReader* append;
};

constexpr std::array<PictureFormat, 3> kFormats = {{{"PNGs", looks_like_png, append_png},
                                                    {"JPEGs", looks_like_jpeg, append_jpeg},
                                                    {"TIFFs", looks_like_tiff, append_tiff}}};

Result<Volume> stack(const std::string& path, std::vector<std::string> files,
                     const PictureFormat& format, const VolumeOptions& options) {
  Volume volume{.source = path};
  SLF_TRY(check_numbering(path, files, volume.notes));
  const bool may_have_times = format.append == append_tiff;
  SLF_TRY(choose(path, may_have_times ? std::nullopt : options.time, 1, "time point"));
  // Strays, or what a scanner broke off, are first or last: the one in the middle says what slices
  // are like. In between, a slice that is left out would shift others.
  std::optional<SliceKind> kind;
  std::vector<std::byte> middle;
  SLF_TRY(format.append(files[files.size() / 2], options, kind, middle));
  std::uint64_t slices = 0;
  std::vector<std::string> used;
  std::optional<Error> broken;
  std::size_t left_out = 0;
  bool ended = false;
  for (const auto& file : files) {
    const std::size_t before = volume.voxels.size();
    auto appended = format.append(file, options, kind, volume.voxels);
    if (appended && !ended) {
      slices += *appended;
      used.push_back(file);
      continue;
    }
    volume.voxels.resize(before);
    ended = !used.empty();
    if (!broken || !appended) broken = std::move(appended.error());
    const bool stray =
        broken->code == ErrorCode::bad_file || broken->code == ErrorCode::unsupported;
    if (appended || !stray || !are_strays(++left_out, files.size())) return tl::unexpected(*broken);
  }
  if (broken)
    volume.notes.push_back(
        concat("left out ", left_out, " of ", files.size(), " pictures: ", broken->message));
  volume.type = kind->type;
  volume.slope = kind->slope, volume.intercept = kind->intercept;
  volume.files = std::move(used);
  volume.dims = SLF_TRY(check_dims(path, {kind->width, kind->height, slices}));
  if (!options.spacing)
    volume.notes.emplace_back("pictures state no spacing: voxels are taken as 1x1x1");
  return volume;
}

/// Reads the set of files that OME metadata describe. `files`: TIFFs of the folder. nullopt: their
/// metadata describe none.
Result<std::optional<Volume>> read_set(const std::vector<std::string>& files,
                                       const VolumeOptions& options) {
  const auto name_of = [](const std::string& file) {
    return std::filesystem::path(file).filename().string();
  };
  for (const std::string& file : {files.front(), files.back()}) {
    const auto described = SLF_TRY(files_of_tiff_set(file));
    if (described.empty() || described == std::set<std::string>{name_of(file)}) continue;
    auto volume = SLF_TRY(read_tiff(file, {}, options));
    const auto strays = std::ranges::count_if(
        files, [&](const std::string& other) { return !described.contains(name_of(other)); });
    if (strays > 0)
      volume.notes.push_back(concat("left out ", strays, " of ", files.size(),
                                    " TIFFs, which the OME metadata of ", name_of(file),
                                    " do not name"));
    return std::optional<Volume>(std::move(volume));
  }
  return std::nullopt;
}

}  // namespace

std::string describe(const SliceKind& kind) {
  return concat(kind.width, "x", kind.height, " ", name(kind.type),
                kind.components > 1 ? concat(", ", kind.components, " components") : "",
                kind.alpha ? " with opacity" : "");
}

Result<void> same_kind(const std::string& source, const SliceKind& here,
                       std::optional<SliceKind>& kind) {
  if (!kind) kind = here;
  if (*kind == here) return {};
  return unsupported(source, describe(here), ", unlike the other slices (", describe(*kind), ")");
}

Result<ComponentSelector> ComponentSelector::make(const std::string& source, const SliceKind& kind,
                                                  const VolumeOptions& options) {
  ComponentSelector selector;
  selector.source_ = source;
  selector.components_ = kind.components;
  selector.width_ = bytes_per_voxel(kind.type);
  if (!options.component && kind.components >= 2 && kind.components <= 4) {
    selector.equal_ = kind.components - (kind.alpha ? 1 : 0);
    return selector;
  }
  selector.component_ = SLF_TRY(choose(source, options.component, kind.components, "component"));
  return selector;
}

Result<void> ComponentSelector::differ() const {
  const auto error = choose(source_, {}, components_, "component");
  return tl::unexpected(error.error());
}

Result<void> ComponentSelector::append(std::span<const std::byte> samples,
                                       std::vector<std::byte>& voxels) const {
  if (components_ == 1) {
    voxels.insert(voxels.end(), samples.begin(), samples.end());
    return {};
  }
  const std::size_t stride = width_ * components_;
  for (std::size_t at = 0; at + stride <= samples.size(); at += stride) {
    const auto* voxel = &samples[at];
    for (std::size_t c = 1; c < equal_; ++c)
      if (std::memcmp(voxel, voxel + c * width_, width_) != 0) return differ();
    const auto* from = voxel + component_ * width_;
    voxels.insert(voxels.end(), from, from + width_);
  }
  return {};
}

Result<Volume> read_folder(const std::string& path, const VolumeOptions& options) {
  std::array<std::vector<std::string>, kFormats.size()> files;
  bool any_dicom = false, any_picture = false;
  std::error_code code;
  auto it = std::filesystem::directory_iterator(path, code);
  for (; !code && it != std::filesystem::directory_iterator(); it.increment(code)) {
    std::error_code ignored;
    if (!it->is_regular_file(ignored)) continue;
    const auto file = it->path().string();
    const auto head = read_head(file, 1024);
    if (!head) continue;
    const bool packed = packing_of_file(file) != Packing::none;
    for (std::size_t i = 0; !packed && i < kFormats.size(); ++i)
      if (kFormats[i].looks_like(*head)) files[i].push_back(file), any_picture = true;
    any_dicom = any_dicom || looks_like_dicom(*head);
  }
  if (code) return fail(ErrorCode::io, path, ": ", code.message());
  if (!any_dicom && !any_picture) return refuse_folder(path);
  if (any_dicom) return read_dicom_folder(path, options);
  SLF_TRY(refuse_series(path, options));
  std::string found;
  std::size_t all = 0, format = 0;
  for (std::size_t i = 0; i < kFormats.size(); ++i) {
    if (files[i].empty()) continue;
    found += concat(all > 0 ? " and " : "", files[i].size(), " ", kFormats[i].plural);
    all += files[i].size();
    if (files[i].size() > files[format].size()) format = i;
  }
  const std::size_t strays = all - files[format].size();
  if (strays > 0 && !are_strays(strays, all))
    return unsupported(path, found,
                       ", expected one kind: move the others to a folder of their own");
  std::ranges::sort(files[format], natural_less);
  if (kFormats[format].append == append_tiff) {
    auto set = SLF_TRY(read_set(files[format], options));
    if (set) return std::move(*set);
  }
  auto volume = stack(path, files[format], kFormats[format], options);
  if (volume && strays > 0)
    volume->notes.push_back("of " + found + ", only the " + kFormats[format].plural + " are read");
  return volume;
}

}  // namespace slf::volume_io
