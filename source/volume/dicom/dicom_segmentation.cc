// DICOM segmentations: what they say of their segments; and the binary and fractional ones, whose
// frames belong to one segment each, as labels.
#include <algorithm>
#include <cstring>
#include <iterator>

#include "base/try.h"
#include "slf/tone.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/dicom/dicom_elements.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

enum SegmentTag : DicomTag {
  kSegmentationType = 0x00620001,
  kSegments = 0x00620002,
  kNumber = 0x00620004,
  kLabel = 0x00620005,
  kColor = 0x0062000d,
  kMaximumFraction = 0x0062000e,
};

/// CIELab as DICOM encodes it (white is D50) to sRGB, 0 to 1.
glm::dvec3 srgb_of_lab(const std::vector<std::uint32_t>& encoded) {
  const double l = encoded[0] * 100 / 65535.0;
  const double a = encoded[1] * 255 / 65535.0 - 128, b = encoded[2] * 255 / 65535.0 - 128;
  const auto cube = [](double t) {
    constexpr double kLinear = 6.0 / 29;
    return t > kLinear ? t * t * t : 3 * kLinear * kLinear * (t - 4.0 / 29);
  };
  const double y = (l + 16) / 116;
  const glm::dvec3 xyz(0.96422 * cube(y + a / 500), cube(y), 0.82521 * cube(y - b / 200));
  // To linear sRGB, adapted from D50 to D65 (Bradford).
  const glm::dmat3 to_rgb(3.1338561, -0.9787684, 0.0719453, -1.6168667, 1.9161415, -0.2289914,
                          -0.4906146, 0.0334540, 1.4052427);
  glm::dvec3 rgb = glm::clamp(to_rgb * xyz, 0.0, 1.0);
  for (int i = 0; i < 3; ++i) rgb[i] = srgb_from_linear(rgb[i]);
  return rgb;
}

/// The segments of each voxel, as frames are added.
class Labels {
 public:
  Labels(std::size_t voxels, std::uint32_t maximum)
      : ids_(voxels), fractions_(voxels), maximum_(maximum) {}

  void add(std::uint32_t segment, const std::vector<std::byte>& frame, std::size_t first) {
    for (std::size_t i = 0; i < frame.size(); ++i) {
      const auto fraction = std::to_integer<std::uint8_t>(frame[i]);
      if (fraction == 0 || 2u * fraction < maximum_) continue;
      auto& id = ids_[first + i];
      auto& best = fractions_[first + i];
      if (id != 0 && id != segment) ++shared_;
      if (fraction < best || (fraction == best && segment < id)) continue;
      id = static_cast<std::uint16_t>(segment);
      best = fraction;
    }
  }

  /// Voxels that several segments claim, each counted once per further segment.
  [[nodiscard]] std::size_t shared() const { return shared_; }

  void copy_to(Volume& volume) const {
    const auto highest = ids_.empty() ? 0 : *std::ranges::max_element(ids_);
    volume.type = highest > 255 ? ScalarType::u16 : ScalarType::u8;
    volume.voxels.resize(voxel_bytes(volume));
    if (volume.type == ScalarType::u16)
      std::memcpy(volume.voxels.data(), ids_.data(), volume.voxels.size());
    else
      std::transform(ids_.begin(), ids_.end(), volume.voxels.begin(),
                     [](std::uint16_t id) { return static_cast<std::byte>(id); });
  }

 private:
  std::vector<std::uint16_t> ids_;
  std::vector<std::uint8_t> fractions_;
  std::uint32_t maximum_;
  std::size_t shared_ = 0;
};

std::string list_of(const LabelTable& segments) {
  constexpr std::ptrdiff_t kNamed = 10;
  const auto last = std::ranges::next(segments.begin(), kNamed, segments.end());
  const auto named = joined(LabelTable(segments.begin(), last), ", ", [](const auto& segment) {
    const auto& [id, style] = segment;
    return concat(id, style.name.empty() ? "" : " " + in_quotes(style.name));
  });
  return concat("a segmentation of ", segments.size(),
                segments.size() == 1 ? " segment" : " segments", segments.empty() ? "" : ": ",
                named, std::ssize(segments) > kNamed ? ", …" : "");
}

}  // namespace

Result<void> read_segments(const DicomFile& file, const DicomLookup& values, DicomSlice& slice) {
  const std::string type = values.text(kSegmentationType);
  if (type.empty()) return {};
  using Kind = DicomSegmentation::Kind;
  auto segmentation = std::make_shared<DicomSegmentation>();
  segmentation->kind = type == "BINARY"       ? Kind::binary
                       : type == "FRACTIONAL" ? Kind::fractional
                                              : Kind::label_map;
  if (segmentation->kind == Kind::label_map && type != "LABELMAP")
    return unsupported(slice.path, "a segmentation of type ", in_quotes(type),
                       ", expected BINARY, FRACTIONAL or LABELMAP");
  if (segmentation->kind == Kind::fractional)
    segmentation->maximum = std::max(1u, values.integer(kMaximumFraction).value_or(255));
  for (const auto& item : file.data.items(kSegments)) {
    const DicomLookup segment(file.big_endian, {&item});
    const auto number = segment.integer(kNumber);
    if (!number) continue;
    LabelStyle& style = segmentation->segments[*number];
    style.name = segment.utf8(kLabel, values.text(kCharacterSet));
    const auto lab = segment.integers(kColor, 2);
    if (lab.size() == 3) style.color = srgb_of_lab(lab);
  }
  slice.segmentation = std::move(segmentation);
  return {};
}

Result<Volume> read_segmentation(const std::string& source, const DicomStack& stack,
                                 const VolumeOptions& options) {
  SLF_TRY(choose(source, options.component, 1, "component"));
  SLF_TRY(choose(source, options.time, 1, "time point"));
  const auto& slices = stack.slices;
  for (const auto& slice : slices) {
    if (slice.problem) return tl::unexpected(*slice.problem);
    if (!slice.placed || !(slice.spacing.x > 0))
      return bad_file(slice.label(), "a segmentation without ",
                      slice.placed ? "PixelSpacing" : slice.unplaced);
    if (slice.type != ScalarType::u8 || slice.components() != 1 || slice.segment == 0 ||
        slice.segment > 0xffff)
      return unsupported(slice.label(), "a segmentation of ", name(slice.type),
                         " pixels for segment ", slice.segment,
                         ", expected 1 or 8 bits for one of the segments 1 to 65535");
  }
  Volume volume{
      .source = source, .private_name = true, .files = {slices.front().path}, .notes = stack.notes};
  const auto grid = SLF_TRY(grid_of_planes(slices, source));
  const DicomSlice& first = slices.front();
  SLF_TRY(place_in(grid, first, volume));
  volume.unit = "mm";

  std::optional<Labels> labels;  // memory only once a file has yielded its pixels
  SLF_TRY(for_each_frame(slices,
                         [&](std::size_t i, const std::vector<std::byte>& frame) -> Result<void> {
                           if (!labels)
                             labels.emplace(volume.voxel_count(), first.segmentation->maximum);
                           labels->add(slices[i].segment, frame, grid.plane[i] * frame.size());
                           return {};
                         }));
  labels->copy_to(volume);
  volume.labels = true;
  volume.label_styles = first.segmentation->segments;
  volume.notes.push_back(list_of(volume.label_styles));
  if (labels->shared() > 0)
    volume.notes.push_back(concat(
        "segments overlap at ", labels->shared(),
        " voxels, which belong to the one with the largest fraction, then to the highest number"));
  return volume;
}

}  // namespace slf::volume_io
