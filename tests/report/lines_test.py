"""Lattices, lines and their measure."""

import unittest

import numpy as np
from report import lines


class Lattices(unittest.TestCase):
    def test_points_lie_on_the_sphere_and_are_as_many_as_the_lattice_has(self):
        for name, spread in lines.LATTICES.items():
            for cells in (1, 2, 5):
                points = lines.lattice_points(spread, cells)
                self.assertEqual(len(points), 4 * cells**2 + 2, name)
                np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-8)

    def test_an_octsphere_has_a_square_number_of_cells_with_mean_area_one(self):
        for name, spread in lines.LATTICES.items():
            corners, areas = lines.octsphere_cells(spread, 6)
            self.assertEqual(corners.shape, (36, 3, 3), name)
            self.assertAlmostEqual(areas.mean(), 1)
        self.assertLess(areas.std(), lines.octsphere_cells(lines.gnomonic, 6)[1].std())


class PlaneLines(unittest.TestCase):
    def test_every_pair_of_points_is_a_chord(self):
        a, b = lines.circle_lines(6)
        self.assertEqual(len(a), 15)
        r, beta = lines.line_space(a, b)
        self.assertTrue((np.abs(r) <= 1).all() and (beta >= 0).all() and (beta <= np.pi).all())

    def test_a_line_is_the_same_in_both_directions(self):
        a, b = lines.pair_lines(4, 1.5)
        np.testing.assert_allclose(lines.line_space(a, b), lines.line_space(b, a), atol=1e-12)

    def test_known_lines(self):
        r, beta = lines.line_space(np.array([[-1.0, 0.5]]), np.array([[1.0, 0.5]]))
        np.testing.assert_allclose([abs(r[0]), beta[0]], [0.5, np.pi / 2])


class SpaceLines(unittest.TestCase):
    def test_coordinates_do_not_depend_on_the_point_and_fill_the_unit_cube(self):
        random = np.random.default_rng(1)
        points, directions = lines.uniform_slabs(500, random)
        here = lines.line_coordinates(points, directions)
        there = lines.line_coordinates(points + 0.3 * directions, 2 * directions)
        np.testing.assert_allclose(here, there, atol=1e-6)
        self.assertTrue((here >= 0).all() and (here < 1).all())

    def test_uniform_lines_are_even_and_bunched_ones_are_not(self):
        random = np.random.default_rng(1)
        even, _ = lines.evenness(
            lines.line_coordinates(*lines.uniform_slabs(200_000, random)), 5, random
        )
        bunched, _ = lines.evenness(random.random((200_000, 4)) ** 2, 5, random)
        self.assertLess(even["variation"], 0.1)
        self.assertLess(even["discrepancy"], 0.02)
        self.assertEqual(even["empty"], 0)
        self.assertGreater(bunched["variation"], 0.5)
        self.assertGreater(bunched["discrepancy"], 0.1)


if __name__ == "__main__":
    unittest.main()
