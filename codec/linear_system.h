// Solves the systems of linear equations of least-squares fits.
#pragma once

#include <cstddef>

namespace slf::codec {

/// Solves the symmetric, positive definite system a·x = b of `size` unknowns in place: `a` has b as
/// its last column, which becomes x. Rounds the same on every machine.
template <class Matrix>
void solve_system(Matrix& a, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    const double pivot = a[i][i];
    for (std::size_t j = i; j <= size; ++j) a[i][j] /= pivot;
    for (std::size_t k = 0; k < size; ++k) {
      if (k == i) continue;
      const double factor = a[k][i];
      for (std::size_t j = i; j <= size; ++j) a[k][j] -= factor * a[i][j];
    }
  }
}

}  // namespace slf::codec
