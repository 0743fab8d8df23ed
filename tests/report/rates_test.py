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


if __name__ == "__main__":
    unittest.main()
