"""Rates: reading a curve of bytes against PSNR."""

import unittest

from report import rates


class BytesAt(unittest.TestCase):
    CURVE = [{"bytes": 100, "psnr": 30.0}, {"bytes": 400, "psnr": 34.0}]

    def test_interpolates_the_logarithm(self):
        self.assertAlmostEqual(rates.bytes_at(self.CURVE, 32.0), 200)

    def test_is_exact_at_points(self):
        self.assertAlmostEqual(rates.bytes_at(self.CURVE, 34.0), 400)

    def test_does_not_guess_beyond_the_curve(self):
        self.assertIsNone(rates.bytes_at(self.CURVE, 34.1))
        self.assertIsNone(rates.bytes_at(self.CURVE, 29.9))


class Enclosing(unittest.TestCase):
    @staticmethod
    def point(quality):
        return {"quality": quality, "psnr": 30 + quality / 10, "bytes": quality}

    def qualities(self, psnr):
        return [point["quality"] for point in rates.enclosing(self.point, psnr)]

    def test_ends_near_the_psnr(self):
        self.assertEqual(self.qualities(39.4), [90, 94, 97])
        self.assertEqual(self.qualities(38.0), [75, 80, 90])
        self.assertEqual(self.qualities(35.0), [45, 50, 60, 75, 90])

    def test_a_psnr_beyond_all_qualities(self):
        self.assertEqual(self.qualities(45.0), [90, 97])
        self.assertEqual(self.qualities(20.0), [15, 30, 45, 60, 75, 90])


if __name__ == "__main__":
    unittest.main()
