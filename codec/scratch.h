// Scratch: working memory that a thread keeps from tile to tile.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

namespace slf::codec {

/// A buffer that grows and is never cleared: take() returns memory with undefined content.
template <class T>
class Scratch {
 public:
  /// Valid until the next take() of the same Scratch.
  [[nodiscard]] std::span<T> take(std::size_t count) {
    if (count > capacity_) {
      values_.reset(new T[count]);  // uninitialised, unlike make_unique's
      capacity_ = count;
    }
    return {values_.get(), count};
  }

 private:
  std::unique_ptr<T[]> values_;
  std::size_t capacity_ = 0;
};

}  // namespace slf::codec
