#!/usr/bin/env python3
"""Measures what the page fetches from a static host, and how long that takes, in Chromium.

    benchmarks/view_over_http.py SLF TOUCHED FIELD.slf [--views N] [--json FILE]

SLF and TOUCHED are build/release/cli/slf and build/release/tests/touched. The field is exported
unchanged. Each view is opened cold in a headless Chromium, from hosts that serve several ranges in
a request and from hosts that serve one, without delay and as over a link of 10 Mbit/s and 40 ms.
This program simulates the host and the link (tests/view/host.py).

Columns: requests, dependent round trips, bytes of the field and milliseconds until the first
picture and until the view is complete; bytes also relative to the payload of the view's tiles. The
processor emulates the graphics card (SwiftShader), and the times include that.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "view"))

from browser import Browser
from host import Host

VIEWS = [(30, 20, 3), (200, -35, 3), (110, 85, 3), (300, 5, 3), (75, 0, 3)]
SIZE = 512
LINKS = {"at once": (None, 0.0), "10 Mbit/s, 40 ms": (1.25e6, 0.04)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slf")
    parser.add_argument("touched")
    parser.add_argument("field")
    parser.add_argument("--views", type=int, default=len(VIEWS))
    parser.add_argument("--json", help="also write the figures to this file")
    arguments = parser.parse_args()

    def slf(*words):
        return subprocess.run([arguments.slf, "-q", *words], check=True, capture_output=True,
                              text=True).stdout

    rows = []
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        slf("export", arguments.field, "-o", folder, "-f")
        field = os.path.join(folder, "field.slf")
        level = json.loads(slf("info", field, "--json"))["levels"][-1]["level"]
        print(f"{platform.node()}: {os.cpu_count()} cores; {os.path.getsize(field)} bytes of field")
        print(f"{'ranges':6} {'link':17} {'view':15} | first: req trips    bytes    ms "
              f"| complete: req trips    bytes  ratio    ms", flush=True)
        for view in VIEWS[:arguments.views]:
            touched = int(subprocess.run([arguments.touched, field, *map(str, view), str(SIZE)],
                                         check=True, capture_output=True, text=True).stdout)
            for ranges in ["many", "one"]:
                for link, (rate, delay) in LINKS.items():
                    with Host(folder, ranges, rate, delay) as host:
                        text = ",".join(map(str, view))
                        begin = time.monotonic()
                        page = browser.open(
                            f"{host.url}/index.html#view={text}&mode=depth&level={level}",
                            SIZE, SIZE)
                        page.settle()
                        found = page.run("slf.statistics()")
                        page.close()
                        first = found["first"]
                        row = {"ranges": ranges, "link": link, "view": view, "payload": touched,
                               "first": first, "requests": len(host.answers("field.slf")),
                               "round_trips": found["roundTrips"],
                               "bytes": host.bytes("field.slf"),
                               "milliseconds": 1000 * (time.monotonic() - begin)}
                    rows.append(row)
                    print(f"{ranges:6} {link:17} {text:15} | {first['requests']:10} "
                          f"{first['roundTrips']:5} {first['bytes']:8} {first['milliseconds']:5.0f} "
                          f"| {row['requests']:13} {row['round_trips']:5} {row['bytes']:8} "
                          f"{row['bytes'] / touched:6.2f} {row['milliseconds']:5.0f}", flush=True)
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file, indent=1)


if __name__ == "__main__":
    main()
