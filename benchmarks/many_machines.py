#!/usr/bin/env python3
"""Measures the cost of building a field in parts, and the speed of joining the parts.

  benchmarks/many_machines.py --slf build/release/cli/slf \\
    --large build/bench/benchmarks/large_field --folder /var/tmp/slf \
        [INPUT --transfer ... --levels 2 ...]

INPUT and what follows go to `slf build` (default: scene:balls --levels 2). Prints:

  - the processor time of a whole build; of the coarse levels alone and of each of 8 shards of the
    finest level, one after the other; of 8 shards that build the coarser tiles that they need
    themselves;
  - the time of `slf merge` of a field of 4 GB and more in 8 parts, and its memory, beside that of
    `cp` and a sync of the parts' bytes, alternating;
  - the processor seconds and the memory of `ls`, `info` and `diff` of fields of 65,535, 262,140 and
    1,048,575 tiles. Memory is the most that is resident at a time, mapped pages of files included.
"""

import argparse
import contextlib
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import time
import typing

SHARDS = 8
LEVELS_OF_TILES = {"65,535": (3, 15), "262,140": (3, 60), "1,048,575": (4, 15)}


class Cost(typing.NamedTuple):
    seconds: float
    processor: float  # seconds, of all threads
    memory: float     # MiB at most, anonymous and of mapped files together


def run(*commands, **options):
    """Runs commands one after the other, and returns what they cost together."""
    begin = time.monotonic()
    processor = memory = 0.0
    for command in commands:
        process = subprocess.Popen([str(word) for word in command], **options)
        while True:
            with contextlib.suppress(OSError):
                status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
                resident = re.search(r"VmRSS:\s+(\d+)", status)
                memory = max(memory, int(resident[1]) / 1024 if resident else 0)
            done, status, usage = os.wait4(process.pid, os.WNOHANG)
            if done:
                break
            time.sleep(0.01)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            sys.exit(f"{command}: ended with {process.returncode}")
        processor += usage.ru_utime + usage.ru_stime
    return Cost(time.monotonic() - begin, processor, memory)


def build_in_parts(slf, folder, build, with_alone):
    """Builds a field whole, in shards after the coarse levels, and in shards alone. Prints
    processor seconds, because other work on the machine changes these little."""
    levels = 2
    if "--levels" in build:
        levels = int(build[build.index("--levels") + 1])
    else:
        build = [*build, "--levels", str(levels)]

    def cost(name, *options):
        path = folder / name
        path.unlink(missing_ok=True)
        return run([slf, "-q", "build", *build, "-o", path, *options]).processor

    def shards(name, *options):
        return [cost(f"{name}-{k}.slf", *options, "--shard", f"{k}/{SHARDS}")
                for k in range(1, SHARDS + 1)]

    wholes = [cost("whole.slf")]
    coarse = cost("coarse.slf", "--only-levels", f"0-{levels - 1}")
    after = shards("after", "--coarser", folder / "coarse.slf")
    wholes.append(cost("whole.slf"))
    whole = statistics.mean(wholes)
    print(f"processor seconds of a whole build: {wholes[0]:.1f} before, {wholes[1]:.1f} after")
    print(f"coarse levels first: {coarse:.1f} s, then {SHARDS} shards: {sum(after):.1f} s; together "
          f"{(coarse + sum(after)) / whole:.3f} of the whole build; the longest shard is "
          f"{max(after) / statistics.mean(after):.2f} of the mean")
    merged = folder / "merged.slf"
    parts = [folder / "coarse.slf", *folder.glob("after-*.slf")]
    run([slf, "-q", "merge", *parts, "-o", merged, "-f"], stdout=subprocess.DEVNULL)
    run([slf, "-q", "diff", folder / "whole.slf", merged], stdout=subprocess.DEVNULL)
    if not with_alone:
        return
    alone = shards("alone")
    print(f"{SHARDS} shards alone: {sum(alone):.1f} s, {sum(alone) / whole:.3f} of the whole build; "
          f"the longest is {max(alone) / statistics.mean(alone):.2f} of the mean")


def merge_beside_cp(slf, large, folder, repeats):
    run([large, folder / "big-{K}.slf", "--parts", SHARDS], stdout=subprocess.DEVNULL)
    parts = sorted(folder.glob("big-*.slf"))
    size = sum(part.stat().st_size for part in parts)
    costs = {"cp": [], "merge": []}

    def warm():
        """Writes and removes a file of that size: the host of a virtual machine takes long to give
        it memory that it has not used yet."""
        with open(folder / "scratch", "wb") as scratch:
            for _ in range(size >> 20):
                scratch.write(bytes(1 << 20))
        (folder / "scratch").unlink()

    copies, merged = folder / "copy", folder / "copy.slf"
    for _ in range(repeats):
        shutil.rmtree(copies, ignore_errors=True)
        copies.mkdir()
        warm()
        costs["cp"].append(run(["cp", *parts, copies], ["sync", "-f", copies]))
        shutil.rmtree(copies)
        warm()
        costs["merge"].append(run([slf, "-q", "merge", *parts, "-o", merged, "-f"],
                                  stdout=subprocess.DEVNULL))
        merged.unlink()
    medians = {}
    for name, values in costs.items():
        seconds = [cost.seconds for cost in values]
        processor = [cost.processor for cost in values]
        medians[name] = statistics.median(seconds)
        print(f"{name} of {size / 1e9:.2f} GB in {SHARDS} parts, and its sync: "
              f"{medians[name]:.2f} s ({min(seconds):.2f} to {max(seconds):.2f}), processor "
              f"{statistics.median(processor):.2f} s ({min(processor):.2f} to {max(processor):.2f})")
    print(f"merge has {medians['cp'] / medians['merge']:.2f} of the speed of cp; memory with mapped "
          f"files {max(cost.memory for cost in costs['merge']):.0f} MiB")
    for part in parts:
        part.unlink()


def tools_at_scale(slf, large, folder):
    for name, (levels, subfields) in LEVELS_OF_TILES.items():
        field = folder / "many.slf"
        run([large, field, "--levels", levels, "--subfields", subfields, "--payload", 512],
            stdout=subprocess.DEVNULL)
        shutil.copy(field, folder / "other.slf")
        texts = []
        for title, command in {
            "info": ["info", field], "ls": ["ls", field], "ls --json": ["ls", field, "--json"],
            "diff": ["diff", field, folder / "other.slf"],
        }.items():
            cost = run([slf, "-q", *command], stdout=subprocess.DEVNULL)
            texts.append(f"{title} {cost.processor:.2f} s, {cost.memory:.0f} MiB")
        print(f"{name} tiles: " + "; ".join(texts))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--slf", required=True, type=pathlib.Path)
    parser.add_argument("--large", type=pathlib.Path)
    parser.add_argument("--folder", required=True, type=pathlib.Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", choices=["build", "merge", "tools"])
    parser.add_argument("--without-alone", action="store_true",
                        help="leave out shards that build their coarser tiles themselves")
    arguments, build = parser.parse_known_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    slf = arguments.slf.resolve()
    if arguments.only in (None, "build"):
        build_in_parts(slf, arguments.folder, build or ["scene:balls", "--levels", "2"],
                       not arguments.without_alone)
    if arguments.large and arguments.only in (None, "merge"):
        merge_beside_cp(slf, arguments.large.resolve(), arguments.folder, arguments.repeats)
    if arguments.large and arguments.only in (None, "tools"):
        tools_at_scale(slf, arguments.large.resolve(), arguments.folder)


if __name__ == "__main__":
    main()
