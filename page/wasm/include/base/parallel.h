// base/parallel.h for a program of one thread.
#pragma once

#include <cstdint>

#include "base/guarded.h"

namespace slf {

[[nodiscard]] inline unsigned thread_count(unsigned) { return 1; }

template <class F>
[[nodiscard]] Result<void> parallel_for(std::uint64_t count, unsigned, const F& f) {
  for (std::uint64_t k = 0; k < count; ++k) f(k);
  return {};
}
[[nodiscard]] Result<void> make_in_order(std::uint64_t count, unsigned, std::size_t,
                                         const auto& new_maker, const auto& use) {
  auto make = new_maker();
  for (std::uint64_t k = 0; k < count; ++k) SLF_TRY(use(k, SLF_TRY(make(k))));
  return {};
}

}  // namespace slf
