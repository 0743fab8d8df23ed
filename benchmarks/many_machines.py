#!/usr/bin/env python3
"""What building in parts costs, and how fast parts are joined.

  benchmarks/many_machines.py --slf build/release/cli/slf --large build/bench/benchmarks/large_field \\
    --folder /var/tmp/slf [INPUT --transfer ... --levels 2 ...]

INPUT and what follows go to `slf build` (default: scene:balls --levels 2). Prints:

  - the time of a whole build; of the coarse levels alone and of each of 8 shards of the finest
    level, one after the other; of 8 shards that build the coarser tiles that they need themselves;
  - the time of `slf merge` of a field of 4 GB and more in 8 parts, and its memory, beside that of
    `cp` and a sync of the parts' bytes, alternating;
  - the times and the memory of `ls`, `info` and `diff` of fields of 65,535, 262,140 and 1,048,575
    tiles.
"""

import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

SHARDS = 8
LEVELS_OF_TILES = {"65,535": (3, 15), "262,140": (3, 60), "1,048,575": (4, 15)}


def run(command, **options):
    """Seconds and peak anonymous-and-file memory, in MiB, of a command."""
    begin = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], **options)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - begin
    if status not in (0,):
        sys.exit(f"{command}: ended with {os.waitstatus_to_exitcode(status)}")
    return seconds, usage.ru_maxrss / 1024


def build_in_parts(slf, folder, build):
    """Whole, in shards after the coarse levels, and in shards alone."""
    levels = 2
    if "--levels" in build:
        levels = int(build[build.index("--levels") + 1])
    else:
        build = [*build, "--levels", str(levels)]

    def timed(name, *options):
        path = folder / name
        path.unlink(missing_ok=True)
        return run([slf, "-q", "build", *build, "-o", path, *options])[0]

    whole = timed("whole.slf")
    coarse = timed("coarse.slf", "--only-levels", f"0-{levels - 1}")
    after = [timed(f"after-{k}.slf", "--coarser", folder / "coarse.slf", "--shard", f"{k}/{SHARDS}")
             for k in range(1, SHARDS + 1)]
    alone = [timed(f"alone-{k}.slf", "--shard", f"{k}/{SHARDS}") for k in range(1, SHARDS + 1)]
    merged = folder / "merged.slf"
    for parts in ([folder / "coarse.slf", *folder.glob("after-*.slf")], folder.glob("alone-*.slf")):
        run([slf, "-q", "merge", *parts, "-o", merged, "-f"], stdout=subprocess.DEVNULL)
        run([slf, "-q", "diff", folder / "whole.slf", merged], stdout=subprocess.DEVNULL)
    print(f"whole build: {whole:.1f} s")
    print(f"coarse levels first: {coarse:.1f} s, then {SHARDS} shards: {sum(after):.1f} s; together "
          f"{(coarse + sum(after)) / whole:.3f} of the whole build; the longest shard is "
          f"{max(after) / statistics.mean(after):.2f} of the mean")
    print(f"{SHARDS} shards alone: {sum(alone):.1f} s, {sum(alone) / whole:.3f} of the whole build; "
          f"the longest is {max(alone) / statistics.mean(alone):.2f} of the mean")


def merge_beside_cp(slf, large, folder, repeats):
    run([large, folder / "big-{K}.slf", "--parts", SHARDS], stdout=subprocess.DEVNULL)
    parts = sorted(folder.glob("big-*.slf"))
    size = sum(part.stat().st_size for part in parts)
    times = {"merge": [], "cp": []}
    memory = 0
    for _ in range(repeats):
        shutil.rmtree(folder / "copy", ignore_errors=True)
        (folder / "copy").mkdir()
        begin = time.monotonic()
        subprocess.run(["cp", *parts, folder / "copy"], check=True)
        subprocess.run(["sync", "-f", folder / "copy"], check=True)
        times["cp"].append(time.monotonic() - begin)
        shutil.rmtree(folder / "copy")
        seconds, mebibytes = run([slf, "-q", "merge", *parts, "-o", folder / "copy.slf", "-f"],
                                 stdout=subprocess.DEVNULL)
        times["merge"].append(seconds)
        memory = max(memory, mebibytes)
        (folder / "copy.slf").unlink()
    median = {name: statistics.median(values) for name, values in times.items()}
    print(f"merge of {size / 1e9:.2f} GB in {SHARDS} parts: {median['merge']:.2f} s "
          f"({min(times['merge']):.2f} to {max(times['merge']):.2f}); cp and sync: "
          f"{median['cp']:.2f} s ({min(times['cp']):.2f} to {max(times['cp']):.2f}); "
          f"{median['cp'] / median['merge']:.2f} of its speed; at most {memory:.0f} MiB resident, "
          "mapped pages of the parts included")
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
            seconds, mebibytes = run([slf, "-q", *command], stdout=subprocess.DEVNULL)
            texts.append(f"{title} {seconds:.2f} s, {mebibytes:.0f} MiB")
        print(f"{name} tiles: " + "; ".join(texts))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--slf", required=True, type=pathlib.Path)
    parser.add_argument("--large", type=pathlib.Path)
    parser.add_argument("--folder", required=True, type=pathlib.Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", choices=["build", "merge", "tools"])
    arguments, build = parser.parse_known_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    slf = arguments.slf.resolve()
    if arguments.only in (None, "build"):
        build_in_parts(slf, arguments.folder, build or ["scene:balls", "--levels", "2"])
    if arguments.large and arguments.only in (None, "merge"):
        merge_beside_cp(slf, arguments.large.resolve(), arguments.folder, arguments.repeats)
    if arguments.large and arguments.only in (None, "tools"):
        tools_at_scale(slf, arguments.large.resolve(), arguments.folder)


if __name__ == "__main__":
    main()
