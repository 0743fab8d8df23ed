// Decoded pictures within a budget of memory. Internal.
#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <vector>

#include "slf/pictures.h"

namespace slf {

/// A decoded picture: 8 bits or, where it may hold more, floats.
class Pixels {
 public:
  explicit Pixels(const Image& image);
  /// Bilinear, premultiplied. Places outside are those at the edge.
  [[nodiscard]] glm::vec4 sample(const glm::dvec2& place) const;
  [[nodiscard]] std::size_t bytes() const;

  /// What the object's surface hides: depths along z in pixels `depth_factor` times as large.
  std::vector<float> depth;
  std::uint32_t depth_width = 0, depth_height = 0, depth_factor = 1;

 private:
  [[nodiscard]] glm::vec4 pixel(std::size_t at) const;
  std::uint32_t width_, height_;
  std::vector<glm::u8vec4> small_;
  std::vector<glm::vec4> large_;
};

/// Thread-safety: any thread.
class PictureCache {
 public:
  using Load = std::function<std::shared_ptr<const Pixels>(std::size_t)>;
  PictureCache(std::size_t pictures, std::uint64_t budget, Load load)
      : budget_(budget), load_(std::move(load)), slots_(pictures) {}

  /// Loads the picture if it is not in memory; throws what the loader throws.
  [[nodiscard]] std::shared_ptr<const Pixels> get(std::size_t picture);

 private:
  struct Slot {
    std::mutex loading;
    std::shared_ptr<const Pixels> pixels;
    std::list<std::size_t>::iterator place;
  };
  std::uint64_t budget_;
  Load load_;
  std::mutex mutex_;  // guards all but Slot::loading
  std::vector<Slot> slots_;
  std::list<std::size_t> recent_;  // the most recently used first
  std::uint64_t used_ = 0;
};

}  // namespace slf
