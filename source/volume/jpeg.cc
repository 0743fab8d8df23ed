// JPEG slices, through the decoder of pictures.
#include "base/try.h"
#include "image/formats.h"
#include "source/volume/stack.h"

namespace slf::volume_io {

bool looks_like_jpeg(std::string_view head) { return head.starts_with("\xff\xd8\xff"); }

Result<std::uint64_t> append_jpeg(const std::string& path, const VolumeOptions& options,
                                  std::optional<SliceKind>& kind, std::vector<std::byte>& voxels) {
  const auto size = SLF_TRY(file_size(path));
  auto file = SLF_TRY(ByteReader::open(path, 0, false));
  std::vector<std::byte> bytes(size);
  const auto got = SLF_TRY(file.read(bytes));
  const auto picture =
      SLF_TRY(image_formats::decode_jpeg_samples(path, std::span(bytes).first(got)));
  const SliceKind here{
      .width = picture.width, .height = picture.height, .components = picture.channels};
  SLF_TRY(same_kind(path, here, kind));
  const auto selector = SLF_TRY(ComponentSelector::make(path, here, options));
  SLF_TRY(selector.append(std::as_bytes(std::span(picture.samples)), voxels));
  return 1;
}

}  // namespace slf::volume_io
