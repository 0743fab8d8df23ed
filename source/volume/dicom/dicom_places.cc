// Which DICOM slices lie at one place, and in which order: places along the normal, and at each
// place the times.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>
#include <string_view>

#include "base/try.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/dicom/dicom_elements.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

using Place = std::vector<DicomSlice>;

/// The order of slices at one place: by what the file says of time, else by number.
bool is_earlier(const DicomSlice& a, const DicomSlice& b) {
  if (a.indices != b.indices) return a.indices < b.indices;
  const auto* const other = std::ranges::mismatch(a.moments, b.moments).in1;
  if (other - a.moments.begin() < std::ptrdiff_t{kInstanceMoment}) return a.moments < b.moments;
  return std::tie(a.traits, a.moments) < std::tie(b.traits, b.moments);
}

/// Whether `b` is a file that was copied under another name.
bool is_copy(const DicomSlice& a, const DicomSlice& b) {
  if (a.instance.empty() || a.instance != b.instance || a.frame != b.frame || a.path == b.path)
    return false;
  const auto first = read_dicom_bytes(a.path), second = read_dicom_bytes(b.path);
  return first && second && first->bytes == second->bytes;
}

void leave_out_copies(std::vector<Place>& places, std::vector<std::string>& notes) {
  std::set<std::string> named;
  for (auto& place : places)
    for (std::size_t i = 0; i < place.size(); ++i)
      for (std::size_t k = place.size(); k-- > i + 1;) {
        if (!is_copy(place[i], place[k])) continue;
        if (named.insert(place[k].path).second)
          notes.push_back("left out " + place[k].path + ", a duplicate of " + place[i].path);
        place.erase(place.begin() + static_cast<std::ptrdiff_t>(k));
      }
}

std::string where(const DicomSlice& slice) {
  return concat(slice.position.x, ",", slice.position.y, ",", slice.position.z);
}

/// Whether all places have as many slices, and what tells those at one place apart is known.
Result<void> check_counts(const std::vector<Place>& places) {
  std::map<std::size_t, std::size_t> places_with;
  for (const auto& place : places) ++places_with[place.size()];
  const auto usual = std::ranges::max_element(places_with, [](auto& a, auto& b) {
                       return a.second < b.second;
                     })->first;
  for (const auto& place : places) {
    const auto& first = place.front();
    if (place.size() < usual)
      return bad_file(first.label(), "the place ", where(first), " has ", place.size(), " of ",
                      usual, " time points, which ", places_with[usual],
                      " others have: a slice is missing there");
    const auto same = std::ranges::adjacent_find(
        place, [](auto& a, auto& b) { return !is_earlier(a, b) && !is_earlier(b, a); });
    const auto extra = place.size() > usual ? place.end() - 2 : same;
    if (extra != place.end())
      return fail(ErrorCode::unsupported, (extra + 1)->label(), " and ", extra->label(),
                  " lie at the same place, ", where(first),
                  ", as duplicates do: keep one of them (the other places have ", usual, ")");
  }
  if (places.size() == 1 && usual > 1)
    return unsupported(
        places[0][0].label(), "all ", usual,
        " slices lie at the same place, as those of a film do; a volume needs slices "
        "at several places");
  return {};
}

/// What tells the times apart, as "EchoTime 4.9"; none if only the order of files does.
std::vector<std::string> names_of_times(const std::vector<Place>& places) {
  const auto& first = places.front();
  for (std::size_t m = 0; m < kInstanceMoment; ++m) {
    std::set<double> values;
    bool constant = true;
    for (std::size_t t = 0; t < first.size(); ++t) {
      values.insert(first[t].moments[m]);
      for (const auto& place : places)
        constant = constant && place[t].moments[m] == first[t].moments[m];
    }
    if (!constant || values.size() < 2) continue;
    std::vector<std::string> names;
    for (const auto& slice : first) {
      std::array<char, 512> digits{};  // all of them: a date has 14 and a fraction
      const auto [end, _] =
          std::to_chars(digits.begin(), digits.end(), slice.moments[m], std::chars_format::fixed);
      names.push_back(std::isfinite(slice.moments[m])
                          ? concat(kDicomMoments[m], " ", std::string_view(digits.begin(), end))
                          : "");
    }
    return names;
  }
  return {};
}

/// Places slices whose files state no position, with what they or the caller state instead.
Result<void> place_by_number(std::vector<DicomSlice>& slices,
                             const std::optional<glm::dvec3>& spacing,
                             std::vector<std::string>& notes) {
  std::ranges::stable_sort(slices, [](const DicomSlice& a, const DicomSlice& b) {
    return std::pair(a.moments[kInstanceMoment], a.frame) <
           std::pair(b.moments[kInstanceMoment], b.frame);
  });
  const glm::dvec3 normal = glm::cross(slices[0].row, slices[0].column);
  std::set<double> locations;
  for (const auto& slice : slices)
    if (slice.location) locations.insert(*slice.location);
  const bool located = !spacing && locations.size() == slices.size();
  const double gap = spacing ? spacing->z : slices[0].stated_gap;
  if (!located && !(gap > 0))
    return fail_without(
        "spacing", slices[0].frames > 1 ? ErrorCode::unsupported : ErrorCode::bad_file,
        slices[0].path, ": ", slices[0].frames > 1 ? slices[0].frames : slices.size(),
        slices[0].frames > 1 ? " frames" : " slices", " without ", slices[0].unplaced,
        ", so their places are unknown: state a spacing to stack them by number");
  for (std::size_t k = 0; k < slices.size(); ++k)
    slices[k].position += normal * (located ? *slices[k].location : gap * static_cast<double>(k));
  notes.push_back("no " + slices[0].unplaced + ": slices are placed by " +
                  (located ? "SliceLocation" : "InstanceNumber"));
  return {};
}

/// Slices at one place differ by less than this along the normal.
double tolerance(const DicomSlice& slice) {
  return 0.01 * std::min(slice.spacing.x, slice.spacing.y);
}

}  // namespace

double height_of(const DicomSlice& slice) {
  return glm::dot(glm::cross(slice.row, slice.column), slice.position);
}

const char* difference(const DicomSlice& a, const DicomSlice& b) {
  if (a.segmentation || b.segmentation)
    return a.segmentation && b.segmentation && a.path == b.path ? nullptr : "file";
  return a.width != b.width || a.height != b.height ? "size"
         : a.component_type() != b.component_type() || a.components() != b.components()
             ? "pixel type"
         : a.placed != b.placed ? "lack of a position"
         : a.stack != b.stack   ? "stack"
         : glm::length(a.row - b.row) > 1e-3 || glm::length(a.column - b.column) > 1e-3
             ? "orientation"
         : glm::length(a.spacing - b.spacing) > 1e-3 * glm::length(a.spacing) ? "pixel spacing"
                                                                              : nullptr;
}

Result<DicomPlaces> sort_by_place(const DicomStack& stack,
                                  const std::optional<glm::dvec3>& spacing) {
  DicomPlaces sorted;
  sorted.notes = stack.notes;
  std::vector<DicomSlice> good, bad;
  for (const auto& slice : stack.slices) (slice.problem ? bad : good).push_back(slice);
  if (good.empty()) return tl::unexpected(*bad.front().problem);
  for (auto& slice : good) {
    if (const char* what = difference(good.front(), slice))
      return unsupported(slice.label(), "its ", what, " is not that of ", good.front().label(),
                         ": a volume needs slices that are alike");
  }
  for (auto& slice : good) {
    if (slice.spacing.x > 0) continue;
    if (!spacing)
      return fail_without("spacing", ErrorCode::bad_file, slice.path, ": no PixelSpacing",
                          slice.placed ? "" : " and no ", slice.placed ? "" : slice.unplaced,
                          ", which a volume needs to be placed in space: state a spacing");
    slice.spacing = {spacing->x, spacing->y};
  }
  if (!good.front().placed) SLF_TRY(place_by_number(good, spacing, sorted.notes));

  std::ranges::stable_sort(
      good, [](const DicomSlice& a, const DicomSlice& b) { return height_of(a) < height_of(b); });
  auto& places = sorted.places;
  for (const auto& slice : good) {
    const bool is_new =
        places.empty() || height_of(slice) - height_of(places.back().front()) > tolerance(slice);
    if (is_new) places.emplace_back();
    places.back().push_back(slice);
  }
  leave_out_copies(places, sorted.notes);
  for (auto& place : places) std::ranges::stable_sort(place, is_earlier);
  SLF_TRY(check_counts(places));

  for (const auto& slice : bad) {
    // A hole in the volume is an error. A picture without a place (a dose report) is no hole.
    const double at = height_of(slice);
    const bool outside = slice.placed ? at < height_of(places.front().front()) ||
                                            at > height_of(places.back().front())
                                      : slice.problem->code == ErrorCode::unsupported;
    if (!outside) return tl::unexpected(*slice.problem);
    sorted.notes.push_back("left out " + slice.problem->message);
  }
  sorted.times = names_of_times(places);
  return sorted;
}

}  // namespace slf::volume_io
