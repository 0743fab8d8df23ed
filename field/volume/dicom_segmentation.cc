// Binary and fractional DICOM segmentations, whose frames belong to one segment each, as labels.
#include <algorithm>
#include <cstring>
#include <sstream>

#include "base/try.h"
#include "field/volume/dicom.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

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
  std::ostringstream text;
  text << "a segmentation of " << segments.size()
       << (segments.size() == 1 ? " segment" : " segments");
  constexpr int kNamed = 10;
  int named = 0;
  for (const auto& [id, style] : segments) {
    if (++named > kNamed) {
      text << ", …";
      break;
    }
    text << (named == 1 ? ": " : ", ") << id;
    if (!style.name.empty()) text << " " << in_quotes(style.name);
  }
  return text.str();
}

}  // namespace

Result<Volume> read_segmentation(const std::string& source, const DicomStack& stack,
                                 const VolumeOptions& options) {
  SLF_TRY(expect_one_number(source, options));
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
  Volume volume;
  volume.source = source;
  volume.files = {slices.front().path};
  volume.notes = stack.notes;
  const auto grid = SLF_TRY(grid_of_planes(slices, source));
  const DicomSlice& first = slices.front();
  volume.dims = SLF_TRY(
      check_dims(source, std::array<std::uint64_t, 3>{first.width, first.height, grid.count}));
  volume.axes = {first.row * first.spacing.x, first.column * first.spacing.y, grid.step};
  volume.origin = grid.origin;
  SLF_TRY(check_axes(volume));

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
    volume.notes.push_back(
        "segments overlap at " + std::to_string(labels->shared()) +
        " voxels, which belong to the one with the largest fraction, then to the highest number");
  return volume;
}

}  // namespace slf::volume_io
