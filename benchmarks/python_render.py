#!/usr/bin/env python3
"""Drawing from Python beside C++, and what it leaves in memory.

    PYTHONPATH=build/release/python benchmarks/python_render.py FIELD --cpp PROGRAM

Draws the same view alternately in C++ (PROGRAM is draw_on_request of the benchmarks' build) and in
Python, and prints medians and quartiles of the processor time on all threads, and the median of the
ratios of neighbours. Then it opens, draws and closes the field 10,000 times and prints the growth
of resident memory.
"""

import argparse
import os
import statistics
import subprocess
import time

import slf


def resident_bytes():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE")


def compare(a):
    with slf.open(a.field) as field, subprocess.Popen(
        [a.cpp, a.field, str(a.size)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as cpp:

        def ours():
            begin = time.process_time()
            field.render(slf.orbit(30, 20, 3), (a.size, a.size))
            return time.process_time() - begin

        def theirs():
            cpp.stdin.write("\n")
            cpp.stdin.flush()
            return float(cpp.stdout.readline())

        theirs(), ours()
        pairs = [(theirs(), ours()) for _ in range(a.rounds)]
        cpp.stdin.close()
    for name, times in zip(("C++", "Python"), zip(*pairs)):
        low, middle, high = (1e3 * t for t in statistics.quantiles(times, n=4))
        print(f"{name:8} {middle:8.2f} ms, quartiles {low:.2f} to {high:.2f}")
    ratio = statistics.median(p / c for c, p in pairs)
    print(f"Python takes {100 * (ratio - 1):+.1f} %")


def grow(a):
    def use():
        with slf.open(a.field, threads=1) as field:
            field.render(size=(16, 16), level=0)

    for _ in range(100):
        use()
    before = resident_bytes()
    for _ in range(a.opens):
        use()
    print(f"{a.opens} opens: resident memory grew by {(resident_bytes() - before) / 1e6:.2f} MB")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("field")
    parser.add_argument("--cpp", required=True, help="the program draw_on_request")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=151)
    parser.add_argument("--opens", type=int, default=10000)
    a = parser.parse_args()
    compare(a)
    grow(a)


if __name__ == "__main__":
    main()
