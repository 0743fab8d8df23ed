#include "slf/image.h"

#include <webp/encode.h>
#include <webp/mux.h>

#include <cmath>

#include "base/file.h"
#include "base/try.h"

namespace slf {
namespace {

constexpr int kFastMethod = 2;  // one of WebP's fast methods (0 to 6), since this is only a preview

struct EncoderDeleter {
  void operator()(WebPAnimEncoder* encoder) const { WebPAnimEncoderDelete(encoder); }
};

}  // namespace

struct AnimationWriter::State {
  std::string path;
  double frame_seconds;
  WebPConfig config;
  std::unique_ptr<WebPAnimEncoder, EncoderDeleter> encoder;
  std::uint32_t width = 0, height = 0;
  std::uint64_t frames = 0;

  /// The start of frame `k`, in milliseconds.
  [[nodiscard]] int time(std::uint64_t k) const {
    return static_cast<int>(std::lround(1000 * frame_seconds * static_cast<double>(k)));
  }
};

AnimationWriter::AnimationWriter(const std::string& path, double frame_seconds, float quality)
    : state_(new State{path, frame_seconds, {}, nullptr}) {
  WebPConfigPreset(&state_->config, WEBP_PRESET_PICTURE, quality);
  state_->config.method = kFastMethod;
}
AnimationWriter::AnimationWriter(AnimationWriter&&) noexcept = default;
AnimationWriter& AnimationWriter::operator=(AnimationWriter&&) noexcept = default;
AnimationWriter::~AnimationWriter() = default;

Result<void> AnimationWriter::add(const Image& image, const glm::vec3& background) try {
  State& s = *state_;
  if (!s.encoder) {
    if (image.width > WEBP_MAX_DIMENSION || image.height > WEBP_MAX_DIMENSION)
      return misuse(s.path, image.width, "x", image.height, " pixels; an animation takes at most ",
                    WEBP_MAX_DIMENSION, " along a side");
    s.width = image.width;
    s.height = image.height;
    s.encoder.reset(
        WebPAnimEncoderNew(static_cast<int>(s.width), static_cast<int>(s.height), nullptr));
  }
  if (!s.encoder || image.width != s.width || image.height != s.height)
    return misuse(s.path, "a picture of ", image.width, "x", image.height,
                  " does not fit an animation of ", s.width, "x", s.height);
  const std::vector<std::uint8_t> rgb = to_rgb8(image, background);
  WebPPicture picture;
  WebPPictureInit(&picture);
  picture.use_argb = 1;
  picture.width = static_cast<int>(s.width);
  picture.height = static_cast<int>(s.height);
  const bool good = WebPPictureImportRGB(&picture, rgb.data(), 3 * picture.width) != 0 &&
                    WebPAnimEncoderAdd(s.encoder.get(), &picture, s.time(s.frames), &s.config) != 0;
  WebPPictureFree(&picture);
  if (!good)
    return fail(ErrorCode::failed, s.path, ": WebP: ", WebPAnimEncoderGetError(s.encoder.get()));
  ++s.frames;
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> AnimationWriter::close() try {
  State& s = *state_;
  WebPData data;
  WebPDataInit(&data);
  const bool good = s.encoder &&
                    WebPAnimEncoderAdd(s.encoder.get(), nullptr, s.time(s.frames), nullptr) != 0 &&
                    WebPAnimEncoderAssemble(s.encoder.get(), &data) != 0;
  Result<void> done =
      good ? write_file(s.path, {reinterpret_cast<const std::byte*>(data.bytes), data.size})
           : Result<void>(fail(ErrorCode::failed, s.path, ": no picture, or WebP failed"));
  WebPDataClear(&data);
  s.encoder.reset();
  return done;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
