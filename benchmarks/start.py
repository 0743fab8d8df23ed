#!/usr/bin/env python3
"""What starting slf costs:
  benchmarks/start.py PROGRAM... FIELD
Runs the programs in turn, 50 times each, with --version and to draw a small picture of the field.
Prints medians of processor time and of the largest resident memory."""

import os
import statistics
import sys
import tempfile

RUNS = 50


def run(command):
    """Processor time in milliseconds, and resident memory in MB."""
    quiet = (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)
    child = os.posix_spawn(command[0], command, os.environ, file_actions=[quiet])
    _, status, used = os.wait4(child, 0)
    if status != 0:
        sys.exit(f"{' '.join(command)} failed")
    return 1000 * (used.ru_utime + used.ru_stime), used.ru_maxrss / 1000


def main():
    *programs, field = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        draw = ["render", field, "-f", "-o", os.path.join(folder, "view.png"), "--size", "64x64"]
        for arguments in (["--version"], draw):
            costs = {program: [] for program in programs}
            for _ in range(RUNS):
                for program in programs:
                    costs[program].append(run([program, *arguments]))
            for program in programs:
                time, memory = map(statistics.median, zip(*costs[program]))
                print(f"{program} {arguments[0]}: {time:.1f} ms, {memory:.1f} MB")


main()
