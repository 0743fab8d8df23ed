#!/usr/bin/env python3
"""What `slf render` takes of a field on a web server, and how long.

    benchmarks/render_over_http.py FIELD.slf SLF... [--views N] [--repeat N]

Each program draws each view, 512 pixels square, of a field that it has not read before: from a host
that answers at once, and from hosts behind links of 100 Mbit/s and 20 or 100 ms, and of 10 Mbit/s
and 40 ms. This program simulates host and link (tests/page/host.py). If several programs are given,
they take turns. Printed per program and link: the means over the views of requests and bytes, and
of the median of the repeated times.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "page"))

from host import Host

VIEWS = [(30, 20, 3), (200, -35, 3), (110, 85, 3), (300, 5, 3), (75, 0, 3)]
LINKS = {"at once": (None, 0.0), "100 Mbit/s, 20 ms": (12.5e6, 0.02),
         "100 Mbit/s, 100 ms": (12.5e6, 0.1), "10 Mbit/s, 40 ms": (1.25e6, 0.04)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("field")
    parser.add_argument("slf", nargs="+", help="a program, or NAME=VALUE PROGRAM in quotes")
    parser.add_argument("--views", type=int, default=len(VIEWS))
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    folder, name = os.path.split(os.path.abspath(arguments.field))

    with tempfile.TemporaryDirectory() as output:
        picture = os.path.join(output, "view.png")
        print(f"{'link':17} {'program':30} {'requests':>8} {'bytes':>9} {'ms':>6}", flush=True)
        for link, (rate, delay) in LINKS.items():
            taken = {program: [] for program in arguments.slf}  # (requests, bytes, ms) of a view
            for view in VIEWS[:arguments.views]:
                runs = {program: [] for program in arguments.slf}
                for _ in range(arguments.repeat):
                    for program in arguments.slf:
                        *variables, path = program.split()
                        environment = {**os.environ, **dict(v.split("=") for v in variables)}
                        with Host(folder, "one", rate, delay) as host:
                            begin = time.monotonic()
                            subprocess.run(
                                [path, "-q", "render", f"{host.url}/{name}", "-o", picture, "-f",
                                 "--orbit", ",".join(map(str, view)), "--size", "512x512"],
                                check=True, env=environment)
                            runs[program].append((1000 * (time.monotonic() - begin),
                                                  len(host.answers(name)), host.bytes(name)))
                for program, found in runs.items():
                    taken[program].append((found[0][1], found[0][2],
                                           statistics.median(ms for ms, *_ in found)))
            for program, found in taken.items():
                requests, count, ms = (statistics.mean(column) for column in zip(*found))
                print(f"{link:17} {program:30} {requests:8.0f} {count:9.0f} {ms:6.0f}", flush=True)


if __name__ == "__main__":
    main()
