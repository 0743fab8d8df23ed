"""Numbers and verdicts of the report."""

import math
import unittest

from report.outcome import (
    CONFIRMED,
    PARTLY,
    REFUTED,
    Part,
    geometric_mean,
    human_bytes,
    human_count,
    mean,
)


class Numbers(unittest.TestCase):
    def test_means(self):
        self.assertEqual(mean([1, 2, 6]), 3)
        self.assertTrue(math.isnan(mean([])))
        self.assertAlmostEqual(geometric_mean([1, 4, 16]), 4)

    def test_bytes_have_three_digits_and_a_unit(self):
        self.assertEqual(human_bytes(0), "0 B")
        self.assertEqual(human_bytes(1023), "1023 B")
        self.assertEqual(human_bytes(1536), "1.5 KiB")
        self.assertEqual(human_bytes(2.5 * 2**30), "2.5 GiB")
        self.assertEqual(human_bytes(2**52), "4.1e+03 TiB")

    def test_counts(self):
        self.assertEqual(human_count(999), "999")
        self.assertEqual(human_count(1500), "1.5 k")
        self.assertEqual(human_count(269e6), "269 M")
        self.assertEqual(human_count(4.3e9), "4.3 G")


class Claims(unittest.TestCase):
    def test_a_truth_value_becomes_a_verdict(self):
        part = Part("title")
        part.claim("paper", "a", "1", True)
        part.claim("paper", "b", "2", False)
        part.claim("slf", "c", "3", PARTLY, "scripts/report --only x")
        self.assertEqual([c.verdict for c in part.claims], [CONFIRMED, REFUTED, PARTLY])
        self.assertEqual(part.claims[2].command, "scripts/report --only x")

    def test_parts_do_not_share_their_lists(self):
        Part("a").add("<p>")
        self.assertEqual(Part("b").html, [])


if __name__ == "__main__":
    unittest.main()
