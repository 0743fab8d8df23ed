#!/usr/bin/env python3
"""The commands that write a field live in a control group of --memory and 24 MiB, and are killed.

  tests/cli/budget_test.py build/release/cli/slf [--levels 2 --entry 10]

So the field has 2 GB, and the test takes half an hour. Exits with 77 where no control group can be
made: that needs root.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent.parent / "benchmarks"))
from out_of_core import MIB, MemoryLimit

MEMORY = 24 * MIB
LIMIT = MEMORY + 24 * MIB


def run(command, kill_after=None):
    """Runs a command in a control group, and kills it after so many seconds. Whether it ended."""
    began = time.monotonic()
    with MemoryLimit(LIMIT) as limit:
        process = subprocess.Popen(list(map(str, command)), preexec_fn=limit.enter,
                                   stdout=subprocess.DEVNULL)
        try:
            code = process.wait(kill_after)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            code = "killed"
        print(f"{code} after {time.monotonic() - began:.0f} s:", *command[2:], flush=True)
        if code not in (0, "killed"):
            sys.exit(f"exit code {code}, killed for want of memory {limit.killed()} times")
        return code == 0


def damage(path):
    """Changes bytes of payloads in the middle of a file."""
    with path.open("r+b") as file:
        size = path.stat().st_size
        for at in range(size // 3, size // 2, size // 40):
            file.seek(at)
            file.write(b"damage" * 8)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("slf")
    parser.add_argument("--levels", default="1")
    parser.add_argument("--entry", default="16")
    parser.add_argument("--folder", help="for the fields")
    a = parser.parse_args()
    with MemoryLimit(LIMIT) as limit:
        if not limit.path:
            print("skipped: no control group can be made here")
            return 77
    with tempfile.TemporaryDirectory(dir=a.folder) as folder:
        place = pathlib.Path(folder)
        raw, coded, joined = place / "raw.slf", place / "coded.slf", place / "joined.slf"

        def slf(command, *arguments, kill_after=None):
            return run([a.slf, "-q", command, *arguments, "--memory", MEMORY, "-j", "2"], kill_after)

        def build(output, *options, **kill):
            return slf("build", "scene:globe", "-o", output, "--entry", a.entry, "--exit", "32",
                       "--levels", a.levels, *options, **kill)

        build(raw, "--codec", "raw", kill_after=1)
        build(raw, "--codec", "raw")
        slf("repack", raw, "-o", coded, "--codec", "predictive:90", kill_after=3)
        slf("repack", raw, "-o", coded, "--codec", "predictive:90")
        build(place / "built.slf", kill_after=3)
        build(place / "built.slf")
        join = ["repack", raw, coded, "--merge-states", "-o", joined, "--codec", "zstd:1"]
        slf(*join, kill_after=3)
        slf(*join)
        print(f"{raw.stat().st_size / 1e9:.2f} GB as raw samples", flush=True)
        slf("merge", raw, "-o", place / "merged.slf", kill_after=1)
        slf("merge", raw, "-o", place / "merged.slf")
        damage(raw)
        slf("verify", raw, "--fix", kill_after=0.3)
        slf("verify", raw, "--fix")
        build(raw, "--codec", "raw")
        slf("verify", raw)
    return 0


if __name__ == "__main__":
    sys.exit(main())
