// AnimationWriter: pictures one after the other as an animated WebP, which browsers show.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "slf/error.h"
#include "slf/image.h"

namespace slf {

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
