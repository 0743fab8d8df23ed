#!/usr/bin/env python3
"""How near `slf build --dry-run` comes to the build.

  benchmarks/forecast.py SLF SOURCE... [--options "--quality draft"] [--json]

A source is what slf build takes, with its options, in one argument: "head.nii.gz --transfer
ct-bone". Prints the forecast divided by the truth, of size and of time, and what the forecast took,
of the build's processor time. Run it on a quiet machine.
"""

import argparse
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import time


def run(*command):
    """What a command printed, its seconds, and its processor's."""
    before, begin = os.times(), time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{shlex.join(command)}: {done.stderr}")
    after = os.times()
    busy = sum(after[2:4]) - sum(before[2:4])
    return done.stdout, time.monotonic() - begin, busy


def measure(slf, source, options):
    with tempfile.TemporaryDirectory() as folder:
        field = pathlib.Path(folder) / "field.slf"
        build = [slf, "-q", "build", *shlex.split(source), *options]
        text, _, cost = run(*build, "--dry-run", "--json")
        forecast = json.loads(text)
        _, seconds, busy = run(*build, "-o", str(field))
        size = field.stat().st_size
    return {
        "source": source,
        "file_bytes": size,
        "size": forecast["file_bytes"] / size,
        "error": forecast["file_error_bytes"] / size,
        "seconds": seconds,
        "time": forecast["seconds"] / seconds,
        "cost": cost / busy,
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("slf")
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--options", default="--quality draft", help="of all builds")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = [
        measure(arguments.slf, source, shlex.split(arguments.options))
        for source in arguments.sources
    ]
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    print("   MiB   size ± error      s   time   cost  source")
    for row in rows:
        print(f"{row['file_bytes'] / 2**20:6.2f}  {row['size']:5.2f} ± {row['error']:4.2f} "
              f"{row['seconds']:7.1f}  {row['time']:5.2f}  {row['cost']:5.2f}  {row['source']}")


if __name__ == "__main__":
    main()
