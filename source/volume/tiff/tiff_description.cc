#include "source/volume/tiff/tiff_description.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/try.h"
#include "base/xml.h"
#include "image/tiff_file.h"
#include "source/volume/io.h"
#include "source/volume/units.h"

namespace slf::volume_io {

namespace {

constexpr std::uint64_t kMaxCount = 1 << 24;  // slices, channels, times, or pages

/// Collects the descriptions of the images in OME's metadata.
class OmeReader {
 public:
  explicit OmeReader(std::uint32_t components) : all_components_(components) {}

  /// Reads the metadata of the file at `path`, or those of the file that they name instead, an XML
  /// document or another TIFF. Returns the path of that file.
  Result<std::string> read(std::string_view text, const std::string& path) {
    SLF_TRY(parse(text, path + ": OME metadata"));
    if (metadata_file_.empty()) return path;
    const std::string source = beside(path, metadata_file_);
    const auto head = SLF_TRY(read_head(source, 4));
    if (!looks_like_tiff(head)) {
      const auto bytes = SLF_TRY(read_file(source, std::uint64_t{1} << 30));
      SLF_TRY(parse(chars_of(bytes), source));
      return source;
    }
    const auto file = SLF_TRY(image_formats::TiffFile::open(source));
    SLF_TRY(file->skip_thumbnails());
    SLF_TRY(parse(file->text(TIFFTAG_IMAGEDESCRIPTION), source + ": OME metadata"));
    for (auto& image : images_)  // a place without a file is in the file of the metadata
      for (auto& [first, run] : image.d.runs)
        if (run.file.empty()) run.file = metadata_file_;
    return source;
  }

  /// The names of all files that it names.
  [[nodiscard]] std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& image : images_)
      for (const auto& [first, run] : image.d.runs)
        if (!run.file.empty()) names.insert(run.file);
    return names;
  }

  [[nodiscard]] Result<TiffDescription> finish(const std::string& source,
                                               const std::optional<std::string>& wanted) {
    for (const auto& image : images_) {
      std::string sorted = image.d.order;
      std::ranges::sort(sorted);
      if (sorted != "CTZ") problem_ = "DimensionOrder";
    }
    if (!problem_.empty() || images_.empty())
      return bad_file(source, "OME metadata: ",
                      problem_.empty() ? "Pixels is missing" : problem_ + " is absurd or missing");
    if (images_.size() == 1 && !wanted) return std::move(images_.front().d);
    std::uint64_t page = 0;
    std::string names;
    for (std::size_t i = 0; i < images_.size(); ++i) {
      auto& [name, id, d] = images_[i];
      if (wanted && (*wanted == name || *wanted == id || *wanted == std::to_string(i))) {
        // Images without places of their own follow each other.
        d.of_several = images_.size() > 1;
        if (d.runs.empty()) d.runs[0] = {.file = "", .page = page, .count = kMaxCount};
        return std::move(d);
      }
      page += d.z * d.channels * d.times;
      if (i < 8) names += (i ? ", " : "") + in_quotes(name.empty() ? id : name);
    }
    if (images_.size() > 8) names += " and more";
    if (wanted)
      return misuse(source, "no image ", in_quotes(*wanted), " in its OME metadata; there are ",
                    names);
    return fail_without("array", ErrorCode::unsupported, source, ": ", images_.size(),
                        " images (series) in one OME-TIFF, expected one: choose array ", names);
  }

 private:
  struct OmeImage {
    std::string name, id;
    TiffDescription d{};
  };

  Result<void> parse(std::string_view text, const std::string& source) {
    constexpr std::size_t kMaxImages = 4096;
    const auto xml = SLF_TRY(parse_xml(text, source));
    std::string image_name, image_id;
    TiffDescription::Run* run = nullptr;  // of the last TiffData
    for (const pugi::xml_node& element : elements_of(*xml)) {
      const auto name = name_of(element);
      if (name == "BinaryOnly") {
        metadata_file_ = attribute(element, "MetadataFile");
      } else if (name == "Image") {
        image_name = attribute(element, "Name");
        image_id = attribute(element, "ID");
      } else if (name == "Pixels") {
        if (images_.size() == kMaxImages) break;
        images_.push_back({.name = image_name, .id = image_id});
        run = nullptr;
        pixels(element, images_.back().d);
      } else if (name == "TiffData" && !images_.empty()) {
        run = &tiff_data(element, images_.back().d);
      } else if (name == "UUID" && run) {
        if (const auto file = element.attribute("FileName")) run->file = file.value();
      }
    }
    return {};
  }

  /// A number from `min` on.
  std::uint64_t count(const pugi::xml_node& element, const char* key, std::uint64_t min,
                      std::optional<std::uint64_t> otherwise) {
    const auto stated = element.attribute(key);
    if (!stated && otherwise) return *otherwise;
    const auto value = parse_integer(stated.value());
    if (value && *value >= static_cast<std::int64_t>(min) &&
        *value <= static_cast<std::int64_t>(kMaxCount))
      return static_cast<std::uint64_t>(*value);
    problem_ = key;
    return min;
  }

  void pixels(const pugi::xml_node& a, TiffDescription& d) {
    d.origin = "OME";
    d.z = count(a, "SizeZ", 1, {});
    d.channels = count(a, "SizeC", 1, {});
    d.times = count(a, "SizeT", 1, {});
    // OME counts the samples of a colour pixel as channels.
    components_ = d.channels % all_components_ == 0 ? all_components_ : 1;
    d.channels /= components_;
    if (const std::string order = attribute(a, "DimensionOrder"); order.size() == 5)
      d.order = order.substr(2);
    // Without a unit, sizes are in micrometres; with one that is no length, as the pixel, in none.
    glm::dvec3 units(1);
    for (int i = 0; i < 3; ++i) {
      const std::string key = std::string("PhysicalSize") + "XYZ"[i];
      const auto value = parse_number(attribute(a, key.c_str()));
      if (!value || !(*value > 0) || !std::isfinite(*value)) continue;
      d.spacing[i] = *value;
      const auto unit = a.attribute((key + "Unit").c_str());
      const auto length = unit ? micrometres(unit.value()) : 1;
      d.has_unit = d.has_unit && length;
      units[i] = length.value_or(1);
    }
    if (d.has_unit) d.spacing *= units;
  }

  /// Without a page, the element means all pictures; with one, a single picture.
  TiffDescription::Run& tiff_data(const pugi::xml_node& a, TiffDescription& d) {
    const bool all = !a.attribute("IFD");
    const std::uint64_t first =
        page_of(d, count(a, "FirstZ", 0, 0), count(a, "FirstC", 0, 0) / components_,
                count(a, "FirstT", 0, 0));
    TiffDescription::Run& run = d.runs[first];
    run.page = count(a, "IFD", 0, 0);
    run.count = count(a, "PlaneCount", 1, all ? kMaxCount : 1);
    return run;
  }

  std::vector<OmeImage> images_;
  std::uint64_t all_components_, components_ = 1;
  std::string metadata_file_, problem_;
};

}  // namespace

bool TiffDescription::names_files() const {
  return std::ranges::any_of(runs, [](const auto& run) { return !run.second.file.empty(); });
}

bool TiffDescription::places_pages(std::uint64_t pages) const {
  std::set<TiffPlace> places;
  for (std::uint64_t picture = 0; picture < pages && !runs.empty(); ++picture) {
    const auto place = place_of(picture, "");
    if (!place || place->page >= pages) return false;
    places.insert(*place);
  }
  return places.size() == pages && places.begin()->path == places.rbegin()->path;
}

Result<TiffPlace> TiffDescription::place_of(std::uint64_t picture, const std::string& path) const {
  auto after = runs.upper_bound(picture);
  if (after != runs.begin()) {
    const auto& [first, run] = *--after;
    if (picture - first < run.count) {
      TiffPlace place{path, run.page + (picture - first)};
      if (!run.file.empty()) place.path = beside(path, run.file);
      return place;
    }
  }
  return bad_file(path, "its OME metadata do not say where picture ", picture, " is");
}

std::uint64_t page_of(const TiffDescription& d, std::uint64_t z, std::uint64_t c, std::uint64_t t) {
  std::uint64_t index = 0, stride = 1;
  for (const char axis : d.order) {
    index += stride * (axis == 'Z' ? z : axis == 'C' ? c : t);
    stride *= axis == 'Z' ? d.z : axis == 'C' ? d.channels : d.times;
  }
  return index;
}

bool looks_like_ome(std::string_view text) {
  return text.find("<OME") < 4096 || text.find(":OME") < 4096;
}

Result<TiffDescription> parse_ome(std::string_view text, const std::string& path,
                                  std::uint32_t components,
                                  const std::optional<std::string>& image) {
  OmeReader reader(components);
  const auto source = SLF_TRY(reader.read(text, path));
  return reader.finish(source, image);
}

Result<std::set<std::string>> files_of_ome(std::string_view text, const std::string& path) {
  OmeReader reader(1);
  SLF_TRY(reader.read(text, path));
  return reader.files();
}

bool looks_like_imagej(std::string_view text) { return text.starts_with("ImageJ="); }

TiffDescription parse_imagej(std::string_view text, const TiffResolution& resolution) {
  TiffDescription d{.order = "CZT", .origin = "ImageJ"};
  std::map<std::string, std::string, std::less<>> entries;
  while (!text.empty()) {
    const auto line = next_line(text);
    const auto equals = line.find('=');
    if (equals != std::string_view::npos)
      entries[lower_case(trim(line.substr(0, equals)))] = trim(line.substr(equals + 1));
  }
  const auto number = [&](const char* key, double otherwise) {
    const auto value = parse_number(entries[key]);
    return value && std::isfinite(*value) ? *value : otherwise;
  };
  const auto count = [&](const char* key) -> std::uint64_t {
    const auto value = parse_integer(entries[key]);
    return value && *value > 0 ? static_cast<std::uint64_t>(*value) : 1;
  };
  const bool listed = entries.contains("slices");
  d.channels = count("channels");
  d.times = count("frames");
  d.z = count(listed || d.channels > 1 || d.times > 1 ? "slices" : "images");
  // As ImageJ does: a resolution counts without a unit; the unit may be that of the tag; and 72
  // pixels per inch, which programs write into any file, mean nothing.
  constexpr int kInch = 2, kCentimetre = 3;
  constexpr float kDefaultPerInch = 72;
  std::string unit = entries["unit"];
  std::array<float, 2> pixels = resolution.pixels;
  if (unit.empty() && resolution.unit == kCentimetre) unit = "cm";
  if (unit.empty() && resolution.unit == kInch) {
    if (pixels[0] == kDefaultPerInch)
      pixels = {};
    else
      unit = "inch";
  }
  const auto length = micrometres(unit);
  d.has_unit = length.has_value();
  for (int i = 0; i < 2; ++i)
    if (const float per_unit = pixels[static_cast<std::size_t>(i)]; per_unit > 0)
      d.spacing[i] = length.value_or(1) / per_unit;
  d.spacing.z =
      std::abs(number("spacing", 0)) * micrometres(entries["zunit"]).value_or(length.value_or(1));
  // A line, as that of 16 bits with a sign; other functions are of grey levels and films.
  if (number("cf", 0) == 0 && number("c1", 0) != 0)
    d.slope = number("c1", 1), d.intercept = number("c0", 0);
  // The order in which other programs stored the pictures, as "zct" or "xyzct".
  std::string order = entries["order"];
  if (order.size() >= 3) {
    for (char& axis : order = order.substr(order.size() - 3))
      axis = static_cast<char>(std::toupper(static_cast<unsigned char>(axis)));
    if (std::is_permutation(order.begin(), order.end(), d.order.begin())) d.order = order;
  }
  // One pixel per nothing is what writers put where they know no resolution.
  if (!d.has_unit && d.spacing == glm::dvec3(1, 1, 0)) d.spacing = glm::dvec3(0);
  return d;
}

bool looks_like_shape(std::string_view text) {
  return text.starts_with('{') && text.find("\"shape\"") < 4096;
}

TiffDescription parse_shape(std::string_view text, std::uint32_t components) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object() || !json.contains("shape") || !json["shape"].is_array()) return {};
  std::vector<std::uint64_t> shape;
  for (const auto& extent : json["shape"]) {
    if (!extent.is_number_unsigned() || extent > kMaxCount || extent == 0) return {};
    shape.push_back(extent);
  }
  std::string axes = json.contains("axes") && json["axes"].is_string() ? json["axes"] : "";
  if (axes.size() != shape.size()) axes.assign(shape.size(), '?');
  // The last axes are those within a page.
  std::size_t inner = 2;
  if (components > 1 && !shape.empty() &&
      (shape.back() == components || (shape.size() > 2 && shape[shape.size() - 3] == components)))
    inner = 3;
  if (shape.size() < inner + 2 || shape.size() > 16) return {};
  TiffDescription d{.z = 1, .order = "", .origin = "tifffile"};
  // A page holds an axis less for each that is left: the last of these runs fastest.
  for (std::size_t i = shape.size() - inner; i-- > 0;) {
    const char letter = axes[i] == 'C' || axes[i] == 'T' || axes[i] == 'Z' ? axes[i] : '?';
    char axis = letter;
    if (letter == '?') axis = d.order.find('Z') == std::string::npos ? 'Z' : 'T';
    std::uint64_t& size = axis == 'Z' ? d.z : axis == 'C' ? d.channels : d.times;
    if (d.order.find(axis) != std::string::npos) {
      // Further axes can only be numbered along with times that are next to them.
      if (axis != 'T' || d.order.back() != 'T' || shape[i] > kMaxCount / size) return {};
    } else {
      d.order += axis;
    }
    size *= shape[i];
  }
  for (const char axis : {'Z', 'C', 'T'})
    if (d.order.find(axis) == std::string::npos) d.order += axis;
  return d;
}

}  // namespace slf::volume_io
