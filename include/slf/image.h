// Image: a picture as rendered, with its files and the measures that compare two of them.
#pragma once

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
  std::vector<glm::vec4> rgba;  ///< width × height, 0..1 (HDR fields: above 1 too)
  std::vector<float> depth;     ///< world units from the eye, infinity where nothing; may be empty

  [[nodiscard]] std::size_t pixels() const { return rgba.size(); }
};

/// The picture over an opaque background, 8 bits a channel, RGB interleaved.
[[nodiscard]] std::vector<std::uint8_t> to_rgb8(const Image& image,
                                                const glm::vec3& background = glm::vec3(0));

/// How a picture is written: .png (RGB over `background`, or RGBA straight alpha when
/// `transparent`), .jpg (RGB), .exr (float premultiplied RGBA, and Z where there is depth).
struct ImageFileOptions {
  glm::vec3 background{0};
  bool transparent = false;
  int jpeg_quality = 92;
};

/// Writes to a temporary beside `path` and renames, so no half-written picture is ever seen.
/// usage: unknown extension, no pixels. io: cannot write; nothing is left behind.
[[nodiscard]] Result<void> write_image(const std::string& path, const Image& image,
                                       const ImageFileOptions& options = {});

/// Reads .png, .jpg or .exr. Input is untrusted. PNG and JPEG give 0..1.
[[nodiscard]] Result<Image> read_image(const std::string& path);

struct ImageDifference {
  double psnr = 0;  ///< dB over RGB at 8 bits on black; infinity when equal
  double ssim = 0;  ///< mean structural similarity of luma, Wang et al. 2004, 11×11 Gaussian σ 1.5
};

/// REQUIRES: equal sizes.
[[nodiscard]] ImageDifference compare(const Image& a, const Image& b);

/// The means of factor × factor pixels; the distances are left out.
/// REQUIRES: width and height are multiples of `factor`.
[[nodiscard]] Image shrink(const Image& image, std::uint32_t factor);

/// |a - b| × gain over black, opaque: what a person looks at to see where two pictures differ.
/// REQUIRES: equal sizes.
[[nodiscard]] Image difference(const Image& a, const Image& b, float gain);

/// Pictures one after the other as an animated WebP, which browsers show.
/// Thread-safety: none; one thread.
class AnimationWriter {
 public:
  /// Endless; each picture stays for `frame_seconds`. `quality` 0 to 100, WebP's own scale.
  AnimationWriter(const std::string& path, double frame_seconds, float quality = 75);
  AnimationWriter(AnimationWriter&&) noexcept;
  AnimationWriter& operator=(AnimationWriter&&) noexcept;
  ~AnimationWriter();

  /// usage: not as large as the first, or more than 16383 pixels along a side.
  [[nodiscard]] Result<void> add(const Image& image, const glm::vec3& background = glm::vec3(0));

  /// Writes the file, beside `path` first and renamed. io: cannot write; nothing is left behind.
  [[nodiscard]] Result<void> close();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace slf
