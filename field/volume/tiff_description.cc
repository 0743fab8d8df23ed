#include "field/volume/tiff_description.h"

#include <algorithm>
#include <cmath>

#include "field/volume/io.h"
#include "field/volume/xml.h"

namespace slf::volume_io {

namespace {

constexpr std::uint64_t kMaxCount = 1 << 24;  // slices, channels, times, or pages

double micrometres(std::string_view unit) {
  const std::string text = lower(trim(unit));
  if (text == "nm") return 1e-3;
  if (text == "mm") return 1e3;
  if (text == "cm") return 1e4;
  if (text == "m") return 1e6;
  if (text == "inch" || text == "in") return 25400;
  if (text == "\xc3\x85" || text == "angstrom") return 1e-4;
  return 1;  // µm in its many spellings, pixels
}

/// Collects the description of the first image in OME's metadata.
class OmeReader {
 public:
  explicit OmeReader(std::uint32_t components) : components_(components) { d_.origin = "OME"; }

  [[nodiscard]] XmlHandler handler() {
    return {
        .start = [this](std::string_view name, const XmlAttributes& a) { return start(name, a); }};
  }
  /// The file that has the metadata instead; empty: none.
  [[nodiscard]] const std::string& metadata_file() const { return metadata_file_; }

  [[nodiscard]] Result<TiffDescription> finish(const std::string& source) {
    std::string sorted = d_.order;
    std::sort(sorted.begin(), sorted.end());
    if (sorted != "CTZ") problem_ = "DimensionOrder";
    if (!problem_.empty() || d_.z == 0)
      return fail(ErrorCode::bad_file, source, ": OME metadata: ",
                  problem_.empty() ? "Pixels is missing" : problem_ + " is absurd or missing");
    return std::move(d_);
  }

 private:
  bool start(std::string_view name, const XmlAttributes& a) {
    if (name == "BinaryOnly") {
      if (const auto file = a.find("MetadataFile"); file != a.end()) metadata_file_ = file->second;
    } else if (name == "Pixels") {
      if (d_.z > 0) return false;  // of another image
      pixels(a);
    } else if (name == "TiffData" && d_.z > 0) {
      tiff_data(a);
    } else if (name == "UUID" && run_) {
      if (const auto file = a.find("FileName"); file != a.end()) run_->file = file->second;
    }
    return true;
  }

  /// A number from `min` on.
  std::uint64_t count(const XmlAttributes& a, const char* key, std::uint64_t min,
                      std::optional<std::uint64_t> otherwise) {
    const auto found = a.find(key);
    if (found == a.end() && otherwise) return *otherwise;
    const auto value = found == a.end() ? std::nullopt : parse_integer(found->second);
    if (value && *value >= static_cast<std::int64_t>(min) &&
        *value <= static_cast<std::int64_t>(kMaxCount))
      return static_cast<std::uint64_t>(*value);
    problem_ = key;
    return min;
  }

  void pixels(const XmlAttributes& a) {
    d_.z = count(a, "SizeZ", 1, {});
    d_.channels = count(a, "SizeC", 1, {});
    d_.times = count(a, "SizeT", 1, {});
    // OME counts the samples of a colour pixel as channels.
    if (components_ > 1 && d_.channels % components_ == 0)
      d_.channels /= components_;
    else
      components_ = 1;
    if (const auto order = a.find("DimensionOrder"); order != a.end() && order->second.size() == 5)
      d_.order = order->second.substr(2);
    for (int i = 0; i < 3; ++i) {
      const std::string key = std::string("PhysicalSize") + "XYZ"[i];
      const auto size = a.find(key);
      const auto unit = a.find(key + "Unit");
      const auto value = size == a.end() ? std::nullopt : parse_number(size->second);
      if (value && *value > 0 && std::isfinite(*value))
        d_.spacing[i] = *value * micrometres(unit == a.end() ? "" : unit->second);
    }
  }

  /// Without a page, the element means all pictures; with one, a single picture.
  void tiff_data(const XmlAttributes& a) {
    const bool all = !a.contains("IFD");
    const std::uint64_t first =
        page_of(d_, count(a, "FirstZ", 0, 0), count(a, "FirstC", 0, 0) / components_,
                count(a, "FirstT", 0, 0));
    run_ = &d_.runs[first];
    run_->page = count(a, "IFD", 0, 0);
    run_->count = count(a, "PlaneCount", 1, all ? kMaxCount : 1);
  }

  TiffDescription d_;
  TiffDescription::Run* run_ = nullptr;  // of the last TiffData
  std::uint64_t components_;
  std::string metadata_file_, problem_;
};

}  // namespace

bool TiffDescription::names_files() const {
  return std::ranges::any_of(runs, [](const auto& run) { return !run.second.file.empty(); });
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
  return fail(ErrorCode::bad_file, path, ": its OME metadata do not say where picture ", picture,
              " is");
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
                                  std::uint32_t components) {
  OmeReader reader(components);
  if (const auto end = parse_xml(text, path + ": OME metadata", reader.handler()); !end)
    return tl::unexpected(end.error());
  if (reader.metadata_file().empty()) return reader.finish(path);
  const std::string file = beside(path, reader.metadata_file());
  if (const auto end = read_xml(file, reader.handler()); !end) return tl::unexpected(end.error());
  return reader.finish(file);
}

bool looks_like_imagej(std::string_view text) { return text.starts_with("ImageJ="); }

TiffDescription parse_imagej(std::string_view text, std::array<float, 2> resolution) {
  TiffDescription d{.order = "CZT", .origin = "ImageJ"};
  std::map<std::string, std::string, std::less<>> entries;
  for (std::size_t at = 0; at < text.size();) {
    const auto line = next_line(text, at);
    const auto equals = line.find('=');
    if (equals != std::string_view::npos)
      entries[lower(trim(line.substr(0, equals)))] = trim(line.substr(equals + 1));
  }
  const auto count = [&](const char* key) -> std::uint64_t {
    const auto found = entries.find(key);
    const auto value = found == entries.end() ? std::nullopt : parse_integer(found->second);
    return value && *value > 0 ? static_cast<std::uint64_t>(*value) : 1;
  };
  d.channels = count("channels");
  d.times = count("frames");
  d.z = entries.contains("slices") || d.channels > 1 || d.times > 1 ? count("slices")
                                                                    : count("images");
  const bool has_unit = entries.contains("unit");
  const double unit = micrometres(has_unit ? entries["unit"] : "");
  for (int i = 0; i < 2; ++i) {
    const float pixels = resolution[static_cast<std::size_t>(i)];
    d.spacing[i] = has_unit && pixels > 0 ? unit / pixels : 0;
  }
  if (const auto z = parse_number(entries.contains("spacing") ? entries["spacing"] : "");
      z && *z != 0 && std::isfinite(*z))
    d.spacing.z = std::abs(*z) * unit;
  return d;
}

}  // namespace slf::volume_io
