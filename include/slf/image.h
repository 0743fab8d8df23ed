// Image: a rendered picture; reading, writing and comparing pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <string>
#include <vector>

#include "slf/error.h"

namespace slf {

/// Premultiplied RGBA and the distance from the eye, rows from the top, pixels from the left.
struct Image {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<glm::vec4> rgba;  ///< width × height, 0..1; colours of HDR fields may exceed 1
  std::vector<float> depth;     ///< distance in world units, infinity where transparent; or empty

  [[nodiscard]] std::size_t pixels() const { return rgba.size(); }
};

/// The picture over an opaque background, with 8 bits per channel, RGB interleaved.
[[nodiscard]] std::vector<std::uint8_t> to_rgb8(const Image& image,
                                                const glm::vec3& background = glm::vec3(0));

/// How to write a picture. .png: RGB over `background` or, if `transparent`, RGBA with straight
/// alpha. .jpg: RGB over `background`. .exr: float premultiplied RGBA, and Z if there is depth.
struct ImageFileOptions {
  glm::vec3 background{0};
  bool transparent = false;
  int jpeg_quality = 92;
};

/// Writes a temporary file beside `path` and renames it, so `path` is never a partial picture.
/// usage: unknown extension, no pixels. io: cannot write; no temporary remains.
[[nodiscard]] Result<void> write_image(const std::string& path, const Image& image,
                                       const ImageFileOptions& options = {});

/// The bytes of such a file, in the format that `name` ends in. Errors as write_image().
[[nodiscard]] Result<std::vector<std::byte>> encode_image(const std::string& name,
                                                          const Image& image,
                                                          const ImageFileOptions& options = {});

/// Reads a PNG, JPEG, TIFF, OpenEXR or Radiance HDR picture, recognised by content, not by name. Of
/// TIFF, it reads the first page, 8 or 16 bits. Input is untrusted. Values of PNG, JPEG and TIFF
/// are 0..1. io: cannot be read. bad_file: damaged, or another kind of file. unsupported: more than
/// 2^26 pixels or 32,768 on a side, or an encoding that is not read.
[[nodiscard]] Result<Image> read_image(const std::string& path);

/// PSNR is of RGB at 8 bits over black, infinite if equal; SSIM of luma, Wang et al. 2004, with an
/// 11×11 Gaussian, σ 1.5.
struct ImageDifference {
  double psnr = 0, ssim = 0;

  static constexpr const char* kPython = "ViewQuality";
  void describe(auto& member) const {
    member("psnr", psnr, "dB; infinite, in JSON null, if there is no difference",
           R"("type": ["number", "null"])");
    member("ssim", ssim, "mean structural similarity");
  }
};

/// Compares the pixels that `counted` names, one flag each; empty: all. SSIM is the mean of the
/// windows whose middle pixel counts. Nothing counted: as equal pictures.
/// REQUIRES: equal sizes.
[[nodiscard]] ImageDifference compare(const Image& a, const Image& b,
                                      const std::vector<bool>& counted = {});

/// A smaller picture, whose pixels are the means of factor × factor pixels. Its depth is empty.
/// REQUIRES: width and height are multiples of `factor`.
[[nodiscard]] Image shrink(const Image& image, std::uint32_t factor);

/// The opaque picture |a - b| × gain of two pictures over black.
/// REQUIRES: equal sizes.
[[nodiscard]] Image difference(const Image& a, const Image& b, float gain);

/// Writes a sequence of pictures as an animated WebP, which browsers show.
/// Thread-safety: none; one thread.
class AnimationWriter {
 public:
  /// The animation repeats forever and shows each picture for `frame_seconds`. `quality` is 0 to
  /// 100, WebP's own scale.
  AnimationWriter(const std::string& path, double frame_seconds, float quality = 75);
  AnimationWriter(AnimationWriter&&) noexcept;
  AnimationWriter& operator=(AnimationWriter&&) noexcept;
  ~AnimationWriter();

  /// Appends a picture. usage: its size differs from that of the first one, or a side has more than
  /// 16383 pixels. failed: libwebp cannot encode it.
  [[nodiscard]] Result<void> add(const Image& image, const glm::vec3& background = glm::vec3(0));

  /// Writes a temporary file and renames it to `path`. io: cannot write; no temporary remains.
  /// failed: no picture was added, or libwebp cannot encode them.
  [[nodiscard]] Result<void> close();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace slf
