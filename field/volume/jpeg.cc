// JPEG slices, through the decoder of pictures.
#include "field/image/formats.h"
#include "field/volume/stack.h"

namespace slf::volume_io {

bool looks_like_jpeg(std::string_view head) { return head.starts_with("\xff\xd8\xff"); }

Result<void> append_jpeg(const std::string& path, const VolumeOptions& options,
                         std::optional<SliceKind>& kind, std::vector<std::byte>& voxels) {
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  auto file = ByteReader::open(path, 0, false);
  if (!file) return tl::unexpected(file.error());
  std::vector<std::byte> bytes(*size);
  const auto got = file->read(bytes);
  if (!got) return tl::unexpected(got.error());
  const auto picture = image_formats::decode_jpeg_samples(path, std::span(bytes).first(*got));
  if (!picture) return tl::unexpected(picture.error());
  const SliceKind here{
      .width = picture->width, .height = picture->height, .components = picture->channels};
  if (auto ok = same_kind(path, here, kind); !ok) return ok;
  const auto selector = ComponentSelector::make(path, here, options);
  if (!selector) return tl::unexpected(selector.error());
  return selector->append(std::as_bytes(std::span(picture->samples)), voxels);
}

}  // namespace slf::volume_io
