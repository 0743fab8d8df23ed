#include "source/pictures/picture_cache.h"

#include <algorithm>
#include <cmath>

namespace slf {

Pixels::Pixels(const Image& image) : width_(image.width), height_(image.height) {
  const bool small = std::ranges::all_of(image.rgba, [](const glm::vec4& p) {
    const glm::vec4 scaled = p * 255.0f;
    return p.r >= 0 && p.g >= 0 && p.b >= 0 && std::max({p.r, p.g, p.b, p.a}) <= 1 &&
           // Premultiplied 8-bit colours are no whole numbers, and lose little.
           std::abs(scaled.a - std::round(scaled.a)) < 1e-3f;
  });
  if (!small) {
    large_ = image.rgba;
    return;
  }
  small_.reserve(image.rgba.size());
  for (const glm::vec4& p : image.rgba) small_.emplace_back(p * 255.0f + 0.5f);
}

std::size_t Pixels::bytes() const {
  return small_.size() * sizeof(glm::u8vec4) + large_.size() * sizeof(glm::vec4) +
         depth.size() * sizeof(float);
}

glm::vec4 Pixels::pixel(std::size_t at) const {
  return large_.empty() ? glm::vec4(small_[at]) / 255.0f : large_[at];
}

glm::vec4 Pixels::sample(const glm::dvec2& place) const {
  const double x = std::clamp(place.x - 0.5, 0.0, width_ - 1.0),
               y = std::clamp(place.y - 0.5, 0.0, height_ - 1.0);
  const auto ix = static_cast<std::size_t>(x), iy = static_cast<std::size_t>(y);
  const std::size_t right = ix + 1 < width_ ? 1 : 0, below = iy + 1 < height_ ? width_ : 0;
  const std::size_t at = iy * width_ + ix;
  const auto fx = static_cast<float>(x - static_cast<double>(ix)),
             fy = static_cast<float>(y - static_cast<double>(iy));
  const glm::vec4 top = glm::mix(pixel(at), pixel(at + right), fx);
  return glm::mix(top, glm::mix(pixel(at + below), pixel(at + below + right), fx), fy);
}

std::shared_ptr<const Pixels> PictureCache::get(std::size_t picture) {
  Slot& slot = slots_[picture];
  const auto find = [&]() -> std::shared_ptr<const Pixels> {
    const std::lock_guard lock(mutex_);
    if (slot.pixels) recent_.splice(recent_.begin(), recent_, slot.place);
    return slot.pixels;
  };
  if (auto found = find()) return found;
  const std::lock_guard loading(slot.loading);  // others wait instead of loading it, too
  if (auto found = find()) return found;
  auto pixels = load_(picture);
  const std::lock_guard lock(mutex_);
  slot.pixels = pixels;
  recent_.push_front(picture);
  slot.place = recent_.begin();
  used_ += pixels->bytes();
  while (used_ > budget_ && recent_.size() > 1) {
    Slot& oldest = slots_[recent_.back()];
    used_ -= oldest.pixels->bytes();
    oldest.pixels.reset();
    recent_.pop_back();
  }
  return pixels;
}

}  // namespace slf
