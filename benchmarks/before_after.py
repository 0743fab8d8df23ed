#!/usr/bin/env python3
"""What two versions of slf cost, measured in turn.

  benchmarks/before_after.py BEFORE AFTER VOLUME --transfer FILE [--parts start,build,...]

BEFORE and AFTER are build folders of preset bench. Each version builds its own field of the volume,
8/32 cells, three levels, direct light, in predictive:90, and repacks it to jpeg:90. Fields are kept
in --folder and used again. Run it on a quiet machine.

  start    slf --version, and a picture of 64²
  build    build, repack, verify: processor time, largest resident memory, bytes
  light    a picture of 1024², and a build with --levels 1, under global light
  decode   decode_speed: tiles of the finest level, on one thread
  first    view_times: opening a field that is on disk, and its first view of 512²
  memory   user time and resident memory of a view of 512² on one thread, by --memory
  draw     render_speed: ns per pixel from decoded tiles
  play     orbits of 512²: pixels at the finest level, late frames

Each figure is the median of --rounds; play runs once.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys

CELLS = ["--entry", "8", "--exit", "32", "--levels", "2"]
LIT = ["--entry", "8", "--exit", "32", "--levels", "1"]
CODECS = {"predictive": "predictive:90", "jpeg": "jpeg:90"}
MEMORY = ["64MiB", "32MiB", "16MiB", "8MiB"]
TURNS = [("64MiB", 24), ("128MiB", 24), ("256MiB", 8)]


class Version:
    """A build folder and the fields that its slf wrote."""

    def __init__(self, build, folder):
        self.slf = build / "cli/slf"
        self.programs = build / "benchmarks"
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def field(self, codec):
        return self.folder / f"{codec}.slf"

    def cost(self, *arguments):
        """Runs slf: (processor time in s, user time in s, resident memory in MB)."""
        command = [self.slf, *map(str, arguments)]
        quiet = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_WRONLY, 0) for fd in (1, 2)]
        child = os.posix_spawn(command[0], command, os.environ, file_actions=quiet)
        _, status, used = os.wait4(child, 0)
        if status != 0:
            sys.exit(f"failed: {' '.join(map(str, command))}")
        return used.ru_utime + used.ru_stime, used.ru_utime, used.ru_maxrss / 1000

    def run(self, program, *arguments):
        command = [program, *map(str, arguments)]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def make(self, source, codec):
        build = [*source, "--lighting", "direct", *CELLS, "--codec", CODECS["predictive"]]
        repack = [self.field("predictive"), "--codec", CODECS["jpeg"]]
        arguments = ["build", *build] if codec == "predictive" else ["repack", *repack]
        return self.cost(*arguments, "-f", "-o", self.field(codec))


def row(label, unit, before, after):
    """Prints the medians of what was measured, and their ratio."""
    a, b = statistics.median(before), statistics.median(after)
    ratio = f"{a / b:.2f}" if b else ""
    print(f"| {label} | {a:.4g} {unit} | {b:.4g} {unit} | {ratio} |", flush=True)


def in_turn(versions, rounds, measure):
    """`measure` of each version, in turn: one list for each version and each of its values."""
    results = [[], []]
    for _ in range(rounds):
        for version, result in zip(versions, results):
            result.append(measure(version))
    return [list(zip(*result)) for result in results]


def start(versions, args):
    draw = lambda v: ["render", v.field("predictive"), "-f", "-o", v.folder / "v.png", "--size", 64]
    for label, arguments in (("--version", lambda v: ["--version"]), ("render, 64²", draw)):
        a, b = in_turn(versions, 10 * args.rounds, lambda v: v.cost(*arguments(v)))
        row(f"start: {label}", "s", a[0], b[0])
        row(f"start: {label}", "MB", a[2], b[2])


def build(versions, args):
    source = [args.volume, "--transfer", args.transfer]
    copy = lambda v, codec: ["repack", v.field(codec), "-f", "-o", v.folder / "copy.slf"]
    tasks = (
        ("build", lambda v: v.make(source, "predictive")),
        ("repack to jpeg:90", lambda v: v.make(source, "jpeg")),
        ("repack jpeg:90 to predictive:90",
         lambda v: v.cost(*copy(v, "jpeg"), "--codec", CODECS["predictive"])),
        ("verify", lambda v: v.cost("verify", v.field("predictive"))),
        ("verify, jpeg:90", lambda v: v.cost("verify", v.field("jpeg"))),
    )
    for label, task in tasks:
        a, b = in_turn(versions, min(args.rounds, 2), task)
        row(label, "s", a[0], b[0])
        row(label, "MB", a[2], b[2])
    for codec in CODECS:
        row(f"field, {codec}", "MiB", *([v.field(codec).stat().st_size / 2**20] for v in versions))


def light(versions, args):
    for label, command in (("picture", ["raycast", "--size", 1024]), ("build", ["build", *LIT])):
        def measure(v):
            return v.cost(*command, args.volume, "--transfer", args.transfer, "--lighting", "global",
                          "-f", "-o", v.folder / ("lit.slf" if command[0] == "build" else "v.png"))
        a, b = in_turn(versions, min(args.rounds, 3), measure)
        row(f"{label}, global light", "s", a[0], b[0])
        row(f"{label}, global light", "MB", a[2], b[2])


def decode(versions, args):
    for codec in CODECS:
        def measure(v):
            words = v.run(v.programs / "decode_speed", v.field(codec), 16, 5).split()
            return float(words[2]) / float(words[0]), float(words[4])
        a, b = in_turn(versions, args.rounds, measure)
        row(f"decode, {codec}", "ms a tile", a[0], b[0])
        row(f"decode, {codec}", "MB/s", a[1], b[1])


def first(versions, args):
    for codec in CODECS:
        def measure(v):
            text = v.run(v.programs / "view_times", v.field(codec), "--size", 512, "--views", 9)
            times = json.loads(text)
            return times["open_cold_us"] / 1000, times["view_cold_ms"]
        a, b = in_turn(versions, args.rounds, measure)
        row(f"cold open, {codec}", "ms", a[0], b[0])
        row(f"first view, {codec}", "ms", a[1], b[1])


def memory(versions, args):
    for codec in CODECS:
        for size in MEMORY:
            view = ["--size", "512", "-j", "1", "--memory", size]
            a, b = in_turn(versions, args.rounds if size != "8MiB" else 1, lambda v: v.cost(
                "render", v.field(codec), "-f", "-o", v.folder / "v.png", *view))
            row(f"view in {size}, {codec}", "s", a[1], b[1])
            row(f"view in {size}, {codec}", "MB", a[2], b[2])


def draw(versions, args):
    for mode in ("bitri", "depth"):
        for step in (0, 7):
            def measure(v):
                text = v.run(v.programs / "render_speed", v.field("jpeg"), 1024, 9, mode, step)
                return [float(next(w for w in text.split(mode, 1)[1].split() if w[0].isdigit()))]
            a, b = in_turn(versions, args.rounds, measure)
            row(f"draw, {mode}, {step}° a view", "ns a pixel", a[0], b[0])


def play(versions, args):
    for size, seconds in TURNS:
        for codec in CODECS:
            def measure(v):
                orbit = ["--seconds", seconds, "--size", 512, "--memory", size, "--json"]
                summary = json.loads(v.run(v.slf, "play", v.field(codec), *orbit))["runs"][0]
                return 100 * summary["summary"]["full_share"], summary["summary"]["late"]
            a, b = in_turn(versions, 1, measure)
            row(f"play, {seconds} s a turn, {size}, {codec}", "%", a[0], b[0])
            row(f"play, {seconds} s a turn, {size}, {codec}", "late", a[1], b[1])


PARTS = {p.__name__: p for p in (build, light, start, decode, first, memory, draw, play)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=pathlib.Path)
    parser.add_argument("after", type=pathlib.Path)
    parser.add_argument("volume")
    parser.add_argument("--transfer", required=True)
    parser.add_argument("--folder", type=pathlib.Path,
                        default=pathlib.Path("/var/tmp/slf-versions"))
    parser.add_argument("--parts", default=",".join(PARTS), help="default: %(default)s")
    parser.add_argument("--rounds", type=int, default=5, help="default: %(default)s")
    args = parser.parse_args()
    versions = [Version(args.before, args.folder / "before"),
                Version(args.after, args.folder / "after")]
    parts = set(args.parts.split(","))
    if "build" not in parts and parts != {"light"}:
        source = [args.volume, "--transfer", args.transfer]
        for version in versions:
            for codec in CODECS:
                if not version.field(codec).exists():
                    version.make(source, codec)
    print("| | before | after | before / after |\n|---|---|---|---|")
    for name in args.parts.split(","):
        PARTS[name](versions, args)


main()
