#include "field/geometry/level_geometry.h"

#include <gtest/gtest.h>

#include "field/geometry/lattice.h"

namespace slf {
namespace {

TEST(LevelGeometry, TablesAgreeWithTheSectionFunctions) {
  FieldShape shape;
  shape.entry_side = 4;
  shape.exit_side = 3;
  for (unsigned depth = 0; depth <= 2; ++depth) {
    shape.entry_extra_levels = depth;
    for (unsigned level = 0; level <= 2; ++level) {
      const LevelGeometry geometry(shape, level);
      const auto n = geometry.entry_resolution();
      for (unsigned octant = 0; octant < 8; ++octant)
        for (std::int32_t y = 0; y <= n; ++y)
          for (std::int32_t x = 0; x + y <= n; ++x) {
            const LatticeVertex v = to_vertex(octant, {x, y}, n);
            const EntryRow found = geometry.entry_row(octant, {x, y});
            const Section owner = owner_of(v, level + depth);
            ASSERT_EQ(found.section, owner.index);
            const auto rows = geometry.rows(found.section);
            ASSERT_LT(found.row, rows.size());
            EXPECT_EQ(vertex_at(owner, rows[found.row], shape.entry_section_side()), v);
          }
      const auto m = geometry.exit_resolution();
      for (unsigned octant = 0; octant < 8; ++octant)
        for (std::int32_t y = 0; y < m; ++y)
          for (std::int32_t x = 0; x + y < m; ++x)
            for (const bool inverted : {false, true}) {
              if (inverted && x + y + 1 >= m) continue;
              const Cell cell{octant, {x, y}, inverted, {}};
              const auto found = geometry.exit_cell(cell);
              const auto side = static_cast<std::int32_t>(shape.exit_side);
              const bool down = x % side + y % side + (inverted ? 1 : 0) >= side;
              const Section section = section_at(octant, {x / side, y / side, down}, level);
              ASSERT_EQ(found.section, section.index);
              const auto corners = cell.corners();
              for (int c = 0; c < 3; ++c) {
                const LocalPoint local = to_local(corners[c], section, shape.exit_side);
                EXPECT_EQ(found.columns[c], triangle_index(shape.exit_side, local.p, local.q));
              }
            }
    }
  }
}

}  // namespace
}  // namespace slf
