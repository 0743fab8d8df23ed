// NumPy arrays that own what slf made, without copies.
#pragma once

#include <pybind11/numpy.h>

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "slf/image.h"

namespace slf::python {

/// An array of type `type` that takes over a vector's memory.
template <class T>
pybind11::array array_of(std::vector<T>&& values, const pybind11::dtype& type,
                         std::vector<pybind11::ssize_t> shape) {
  auto owned = std::make_unique<std::vector<T>>(std::move(values));
  const void* data = owned->data();
  const pybind11::capsule owner(owned.release(),
                                [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return {type, std::move(shape), data, owner};
}

/// A read-only array of `bytes`, which `owner` keeps.
inline pybind11::array array_over(std::span<const std::byte> bytes,
                                  std::shared_ptr<const void> owner, const pybind11::dtype& type,
                                  std::vector<pybind11::ssize_t> shape) {
  using Owner = std::shared_ptr<const void>;
  const pybind11::capsule capsule(new Owner(std::move(owner)),
                                  [](void* p) { delete static_cast<Owner*>(p); });
  pybind11::array view(type, std::move(shape), bytes.data(), capsule);
  view.attr("setflags")(pybind11::arg("write") = false);
  return view;
}

/// float32 [height, width, 4], premultiplied.
inline pybind11::array colors_of(Image& image) {
  const pybind11::ssize_t height = image.height, width = image.width;
  return array_of(std::move(image.rgba), pybind11::dtype::of<float>(), {height, width, 4});
}

/// float32 [height, width], or None for a picture without depths.
inline pybind11::object depths_of(Image& image) {
  if (image.depth.empty()) return pybind11::none();
  const pybind11::ssize_t height = image.height, width = image.width;
  return array_of(std::move(image.depth), pybind11::dtype::of<float>(), {height, width});
}

}  // namespace slf::python
