// Sorts a list and removes repetitions.
#pragma once

#include <algorithm>
#include <vector>

namespace slf {

template <class T>
void sort_unique(std::vector<T>& values) {
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
}

}  // namespace slf
