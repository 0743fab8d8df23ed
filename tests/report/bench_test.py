"""What the parts of the report share: programs that fail, and parts that do."""

import contextlib
import io
import sys
import tempfile
import types
import unittest
from pathlib import Path
from unittest import mock

from report import __main__ as driver
from report.bench import Bench, Failed
from report.outcome import NOT_RUN


class WithBench(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        self.bench = Bench(self.root, self.root / "out", self.root / "data", True, False)


class Programs(WithBench):
    def test_output_is_returned_and_the_command_noted(self):
        self.assertEqual(self.bench.run("printf", "%s", "a b"), "a b")
        self.assertEqual(self.bench.commands, ["printf %s 'a b'"])
        self.assertEqual(self.bench.json("echo", '{"a": 1}'), {"a": 1})

    def test_a_failing_or_missing_program_is_named_with_what_it_said(self):
        with self.assertRaisesRegex(Failed, "(?s)exit code 3.*why"):
            self.bench.run("sh", "-c", "echo why >&2; exit 3")
        with self.assertRaisesRegex(Failed, "no-such-program is not there"):
            self.bench.run("no-such-program")

    def test_volumes_that_are_not_there_are_named(self):
        with self.assertRaisesRegex(Failed, "unicorn"):
            self.bench.volume("unicorn")

    def test_close_removes_what_it_made(self):
        self.bench.close()
        self.assertFalse(self.bench.work.exists() or self.bench.fields.exists())


class Parts(WithBench):
    def run_part(self, run):
        module = types.ModuleType("report.fake")
        module.TITLE, module.run = "Fake", run
        with mock.patch.dict(sys.modules, {"report.fake": module}), contextlib.redirect_stderr(
            io.StringIO()
        ):
            return driver.run_part(self.bench, "fake", True)

    def test_a_part_that_fails_keeps_what_it_had_and_says_so(self):
        def run(bench, part):
            part.claim("slf", "first", "1", True)
            raise Failed("the disk is full")

        part = self.run_part(run)
        self.assertTrue(part.failed)
        self.assertEqual([c.verdict for c in part.claims], ["confirmed", NOT_RUN])
        self.assertIn("the disk is full", part.left_out[0])
        self.assertEqual(part.claims[0].command, "scripts/report --only fake --quick")

    def test_a_part_that_succeeds(self):
        part = self.run_part(lambda bench, part: bench.run("true"))
        self.assertFalse(part.failed)
        self.assertEqual(part.commands, ["true"])

    def test_every_part_can_be_imported_and_has_a_title(self):
        import importlib

        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest("python3-matplotlib is not installed")
        for name in driver.PARTS:
            module = importlib.import_module(f"report.{name}")
            self.assertTrue(module.TITLE)
            self.assertTrue(callable(module.run))


if __name__ == "__main__":
    unittest.main()
