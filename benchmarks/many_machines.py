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
import contextlib
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

SHARDS = 8
LEVELS_OF_TILES = {"65,535": (3, 15), "262,140": (3, 60), "1,048,575": (4, 15)}


def run(command, **options):
    """Seconds of a command and the most memory that it had, in MiB: anonymous, and mapped files."""
    begin = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], **options)
    most = {"RssAnon": 0, "RssFile": 0}
    while process.poll() is None:
        with contextlib.suppress(OSError):
            for line in pathlib.Path(f"/proc/{process.pid}/status").read_text().splitlines():
                name, value = line.split(":")
                if name in most:
                    most[name] = max(most[name], int(value.split()[0]) / 1024)
        time.sleep(0.01)
    if process.returncode != 0:
        sys.exit(f"{command}: ended with {process.returncode}")
    return time.monotonic() - begin, f"{most['RssAnon']:.0f} + {most['RssFile']:.0f} MiB"


def build_in_parts(slf, folder, build, with_alone):
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
    print(f"whole build: {whole:.1f} s")
    print(f"coarse levels first: {coarse:.1f} s, then {SHARDS} shards: {sum(after):.1f} s; together "
          f"{(coarse + sum(after)) / whole:.3f} of the whole build; the longest shard is "
          f"{max(after) / statistics.mean(after):.2f} of the mean")
    merged = folder / "merged.slf"
    parts = [folder / "coarse.slf", *folder.glob("after-*.slf")]
    run([slf, "-q", "merge", *parts, "-o", merged, "-f"], stdout=subprocess.DEVNULL)
    run([slf, "-q", "diff", folder / "whole.slf", merged], stdout=subprocess.DEVNULL)
    if not with_alone:
        return
    alone = [timed(f"alone-{k}.slf", "--shard", f"{k}/{SHARDS}") for k in range(1, SHARDS + 1)]
    print(f"{SHARDS} shards alone: {sum(alone):.1f} s, {sum(alone) / whole:.3f} of the whole build; "
          f"the longest is {max(alone) / statistics.mean(alone):.2f} of the mean")


def merge_beside_cp(slf, large, folder, repeats):
    run([large, folder / "big-{K}.slf", "--parts", SHARDS], stdout=subprocess.DEVNULL)
    parts = sorted(folder.glob("big-*.slf"))
    size = sum(part.stat().st_size for part in parts)
    times = {"merge": [], "cp": []}
    memories = []

    def warm():
        """Writes and removes a file of that size: the host of a virtual machine takes long to give
        it memory that it has not used yet."""
        with open(folder / "scratch", "wb") as scratch:
            for _ in range(size >> 20):
                scratch.write(bytes(1 << 20))
        (folder / "scratch").unlink()

    for _ in range(repeats):
        warm()
        shutil.rmtree(folder / "copy", ignore_errors=True)
        (folder / "copy").mkdir()
        begin = time.monotonic()
        subprocess.run(["cp", *parts, folder / "copy"], check=True)
        subprocess.run(["sync", "-f", folder / "copy"], check=True)
        times["cp"].append(time.monotonic() - begin)
        shutil.rmtree(folder / "copy")
        warm()
        seconds, memory = run([slf, "-q", "merge", *parts, "-o", folder / "copy.slf", "-f"],
                                 stdout=subprocess.DEVNULL)
        times["merge"].append(seconds)
        memories.append(memory)
        (folder / "copy.slf").unlink()
    median = {name: statistics.median(values) for name, values in times.items()}
    print(f"merge of {size / 1e9:.2f} GB in {SHARDS} parts: {median['merge']:.2f} s "
          f"({min(times['merge']):.2f} to {max(times['merge']):.2f}); cp and sync: "
          f"{median['cp']:.2f} s ({min(times['cp']):.2f} to {max(times['cp']):.2f}); "
          f"{median['cp'] / median['merge']:.2f} of its speed; anonymous and mapped memory: "
          + ", ".join(memories))
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
            seconds, memory = run([slf, "-q", *command], stdout=subprocess.DEVNULL)
            texts.append(f"{title} {seconds:.2f} s, {memory}")
        print(f"{name} tiles: " + "; ".join(texts))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
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
