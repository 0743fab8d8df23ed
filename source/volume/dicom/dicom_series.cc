// The DICOM series of a folder, and the choice of one.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "base/try.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/formats.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

struct Scan {
  std::vector<DicomSlice> slices{};
  std::vector<std::string> notes{};  ///< files that cannot be read
  std::size_t files = 0;             ///< of any kind
  std::optional<Error> error{};      ///< of the first of these files
  std::optional<Error> stray{};      ///< of the first of them that may be of any series
  std::string other{};               ///< the first file of a kind that has no picture
};

void leave_out(const Error& error, Scan& scan) {
  // Name some; a folder of ten thousand foreign files is not worth as many notes.
  constexpr std::size_t kNamed = 8;
  if (!scan.error) scan.error = error;
  if (scan.notes.size() < kNamed)
    scan.notes.push_back("skipped " + error.message);
  else if (scan.notes.size() == kNamed)
    scan.notes.emplace_back("skipped more files that cannot be read");
}

bool is_named_dicom(const std::filesystem::path& path) {
  const auto ending = lower_case(path.extension().string());
  return ending == ".dcm" || ending == ".dicom" || ending == ".ima";
}

void scan_file(const std::string& path, Scan& scan) {
  ++scan.files;
  const auto stray = [&](const Error& error) {
    if (!scan.stray) scan.stray = error;
    leave_out(error, scan);
  };
  constexpr std::size_t kHead = 1024;
  const auto head = read_head(path, kHead);
  if (!head || !looks_like_dicom(*head)) {
    if (is_named_dicom(path))
      stray(head ? Error{ErrorCode::bad_file, path + ": not DICOM"} : head.error());
    return;
  }
  auto found = read_dicom_slices(path);
  if (!found) return stray(found.error());
  if (found->empty() && scan.other.empty()) scan.other = path;
  std::move(found->begin(), found->end(), std::back_inserter(scan.slices));
}

/// Leaves out series of which every slice is damaged, unless there are no others.
void leave_out_damaged_series(Scan& scan) {
  const auto is_damaged = [](const DicomSlice& slice) {
    return slice.problem && slice.problem->code == ErrorCode::bad_file;
  };
  std::set<std::string> readable;
  for (const auto& slice : scan.slices)
    if (!is_damaged(slice)) readable.insert(slice.series);
  if (readable.empty()) return;
  std::vector<DicomSlice> kept;
  for (auto& slice : scan.slices)
    if (readable.contains(slice.series))
      kept.push_back(std::move(slice));
    else
      leave_out(*slice.problem, scan);
  scan.slices = std::move(kept);
}

/// The slices of all files in a folder or, if `deep`, in those below it too.
Result<Scan> scan_folder(const std::string& folder, bool deep) {
  std::vector<std::string> files;
  std::error_code code;
  constexpr int kDeepest = 8;
  namespace fs = std::filesystem;
  auto it =
      fs::recursive_directory_iterator(folder, fs::directory_options::skip_permission_denied, code);
  for (; !code && it != fs::recursive_directory_iterator(); it.increment(code)) {
    std::error_code ignored;
    if (it->is_directory(ignored) && (!deep || it.depth() >= kDeepest))
      it.disable_recursion_pending();
    if (it->is_regular_file(ignored)) files.push_back(it->path().string());
  }
  if (code) return fail(ErrorCode::io, folder, ": ", code.message());
  std::ranges::sort(files);
  Scan scan;
  for (const auto& file : files) scan_file(file, scan);
  leave_out_damaged_series(scan);
  return scan;
}

/// As DICOMDIRs have it, pictures may lie in folders below.
Result<Scan> scan_folder(const std::string& folder) {
  auto scan = scan_folder(folder, false);
  if (scan && scan->slices.empty()) scan = scan_folder(folder, true);
  if (!scan) return scan;
  if (scan->slices.empty() && scan->error) return tl::unexpected(*scan->error);
  if (!scan->slices.empty()) return scan;
  const bool other = !scan->other.empty();
  if (other) SLF_TRY(refuse_known(scan->other, read_head(scan->other, 4096).value_or("")));
  return fail(other ? ErrorCode::unsupported : ErrorCode::bad_file, folder,
              ": no DICOM pictures among its ", scan->files,
              " files; give the folder that holds the slices themselves");
}

/// Divides the slices of a series, which is that of one volume and localizers, perhaps, or several
/// volumes. Slices with a problem go to the first stack, where it is reported.
std::vector<DicomStack> divide(const std::vector<DicomSlice>& series) {
  std::vector<DicomStack> stacks;
  for (const auto& slice : series) {
    if (slice.problem) continue;
    const auto same = std::ranges::find_if(
        stacks, [&](const DicomStack& stack) { return !difference(stack.slices.front(), slice); });
    if (same == stacks.end())
      stacks.push_back({.id = {}, .slices = {slice}});
    else
      same->slices.push_back(slice);
    constexpr std::size_t kMost = 64;
    if (stacks.size() > kMost) return {{.id = {}, .slices = series}};
  }
  // Single slices beside a volume are left out. Without a volume the series is one stack that
  // cannot be read.
  const auto volumes =
      std::stable_partition(stacks.begin(), stacks.end(), [](const DicomStack& stack) {
        return stack.slices.size() > 1 || stack.slices.front().segmentation;
      });
  if (volumes == stacks.begin()) return {{.id = {}, .slices = series}};
  for (auto it = volumes; it != stacks.end(); ++it)
    stacks.front().notes.push_back("left out " + it->slices.front().label() +
                                   ", unlike the other slices (a localizer, perhaps)");
  stacks.erase(volumes, stacks.end());
  for (const auto& slice : series)
    if (slice.problem) stacks.front().slices.push_back(slice);
  return stacks;
}

/// The stacks of all series, ordered by series number, with ids by which they can be chosen.
std::vector<DicomStack> stacks_of(const std::vector<DicomSlice>& slices) {
  std::map<std::string, std::vector<DicomSlice>> series;
  for (const auto& slice : slices) series[slice.series].push_back(slice);
  std::map<std::string, int> with_number;
  for (const auto& [uid, all] : series) ++with_number[all.front().number];
  std::vector<DicomStack> stacks;
  for (const auto& [uid, all] : series) {
    const std::string& number = all.front().number;
    const std::string name = number.empty() || with_number[number] > 1 ? uid : number;
    auto parts = divide(all);
    for (std::size_t i = 0; i < parts.size(); ++i) {
      parts[i].id = parts.size() == 1 ? name : name + ":" + std::to_string(i + 1);
      stacks.push_back(std::move(parts[i]));
    }
  }
  std::ranges::stable_sort(stacks, [](const DicomStack& a, const DicomStack& b) {
    return parse_number(a.slices.front().number).value_or(1e300) <
           parse_number(b.slices.front().number).value_or(1e300);
  });
  return stacks;
}

VolumeSeries describe(const DicomStack& stack) {
  const DicomSlice& first = stack.slices.front();
  VolumeSeries series{.id = stack.id,
                      .uid = first.series,
                      .number = first.number,
                      .description = first.description,
                      .modality = first.modality,
                      .slices = static_cast<std::uint32_t>(stack.slices.size()),
                      .dims = {first.width, first.height, 0},
                      .type = first.component_type(),
                      .components = first.components()};
  // Positions suffice: a spacing that is missing may be given later.
  const auto sorted = sort_by_place(stack, {});
  if (!sorted) {
    series.problem = sorted.error().message;
    return series;
  }
  series.dims[2] = static_cast<std::uint32_t>(sorted->places.size());
  series.times = static_cast<std::uint32_t>(sorted->time_count());
  return series;
}

std::string summary(const DicomStack& stack) {
  const VolumeSeries series = describe(stack);
  return concat(series.id, " (", series.modality, series.modality.empty() ? "" : " ",
                series.dims[0], "x", series.dims[1], ", ", series.slices,
                series.slices == 1 ? " slice" : " slices",
                series.description.empty() ? "" : ", " + in_quotes(series.description), ")");
}

/// Whether `wanted` names a stack: by id, by number, or by UID, with or without the part.
bool is_wanted(const DicomStack& stack, const std::string& wanted) {
  const DicomSlice& first = stack.slices.front();
  const auto colon = stack.id.rfind(':');
  const std::string part = colon == std::string::npos ? "" : stack.id.substr(colon);
  for (const auto& name : {first.number, first.series})
    if (!name.empty() && (wanted == name || wanted == name + part)) return true;
  return wanted == stack.id;
}

/// The first number that the InstanceNumbers of a stack leave out between its first and its last;
/// none if files state none, or one twice, as those of several times do.
std::optional<double> missing_number(const DicomStack& stack) {
  std::set<double> numbers;
  for (const auto& slice : stack.slices) numbers.insert(slice.moments[kInstanceMoment]);
  if (numbers.size() < stack.slices.size() || !std::isfinite(*numbers.begin())) return {};
  double next = *numbers.begin();
  for (const double number : numbers)
    if (number != next++) return next - 1;
  return {};
}

Result<Volume> read_chosen(const std::string& path, const Scan& scan,
                           const std::optional<std::string>& series, const VolumeOptions& options) {
  std::vector<DicomStack> all = stacks_of(scan.slices), chosen;
  for (const auto& stack : all)
    if (!series || is_wanted(stack, *series)) chosen.push_back(stack);
  if (chosen.size() != 1) {
    const std::string found = joined(chosen.empty() ? all : chosen, ", ", summary);
    if (chosen.empty())
      return misuse(path, "has no series ", in_quotes(*series), ", but these: ", found);
    return fail_without("series", ErrorCode::unsupported, path, ": ", chosen.size(),
                        " DICOM series, expected one: choose series ", found);
  }
  if (scan.stray)
    if (const auto missing = missing_number(chosen.front()))
      return bad_file(path, "the series has no slice number ", *missing,
                      ", which may be the file that cannot be read: ", scan.stray->message,
                      "; get it anew, or move it elsewhere if it is no slice");
  auto volume = read_dicom_stack(path, chosen.front(), options);
  if (!volume) {
    // A file that was skipped may be what the volume lacks.
    if (scan.notes.empty()) return volume;
    Error error = volume.error();
    for (const auto& note : scan.notes) error.message += "; " + note;
    return tl::unexpected(error);
  }
  volume->notes.insert(volume->notes.end(), scan.notes.begin(), scan.notes.end());
  return volume;
}

std::string folder_of(const std::string& path) {
  const auto folder = std::filesystem::path(path).parent_path();
  return folder.empty() ? "." : folder.string();
}

}  // namespace

Result<Volume> read_dicom_folder(const std::string& path, const VolumeOptions& options) {
  const auto scan = SLF_TRY(scan_folder(path));
  return read_chosen(path, scan, options.series, options);
}

Result<Volume> read_dicom_file(const std::string& path, std::string_view head,
                               const VolumeOptions& options) {
  const auto slices = SLF_TRY(read_dicom_slices(path));
  const bool is_directory =
      slices.empty() && lower_case(std::filesystem::path(path).filename().string()) == "dicomdir";
  if (options.series || is_directory) return read_dicom_folder(folder_of(path), options);
  if (slices.empty()) SLF_TRY(refuse_known(path, head));
  if (slices.empty())
    return unsupported(path,
                       "a DICOM file without a picture, such as a directory, report or plan; give "
                       "the folder that holds the slices, or one of them");
  const DicomSlice& first = slices.front();
  if (first.problem) return tl::unexpected(*first.problem);
  if (first.frames > 1 || first.segmentation)
    return read_chosen(path, {.slices = slices}, {}, options);
  auto scan = SLF_TRY(scan_folder(folder_of(path), false));
  // Of a series of several stacks, the one that the file is of.
  std::string id;
  for (const auto& stack : stacks_of(scan.slices))
    if (std::ranges::any_of(stack.slices, [&](const DicomSlice& slice) {
          return std::filesystem::path(slice.path).filename() ==
                 std::filesystem::path(path).filename();
        }))
      id = stack.id;
  const auto same_series = std::ranges::count_if(
      scan.slices, [&](const DicomSlice& slice) { return slice.series == first.series; });
  if (same_series <= 1)
    return unsupported(path,
                       "the single slice of its series in its folder; give a file that lies with "
                       "the others, or a multi-frame file");
  return read_chosen(path, scan, id.empty() ? first.series : id, options);
}

}  // namespace slf::volume_io

namespace slf {

Result<SeriesList> list_series(const std::string& path) try {
  const auto scan = SLF_TRY(volume_io::scan_folder(path));
  SeriesList list{.notes = scan.notes};
  for (const auto& stack : volume_io::stacks_of(scan.slices))
    list.series.push_back(volume_io::describe(stack));
  return list;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
