#!/usr/bin/env python3
"""Measures fields larger than memory: pictures and frame times under the kernel's memory limit.

Builds a field of at least 8 GB from an analytic scene, unless it exists. Then it draws views inside
a memory control group, which must equal those drawn without a limit, and plays an orbit with each
way of loading. After that it plays the orbit with reads throttled to several rates, and compares
some of the frames with frames that wait for their tiles. It also measures how long the machine
itself keeps idle cores from a process, the first frame from the disk, and the bytes that a view
reads.

  benchmarks/out_of_core.py --slf build/release/cli/slf --folder /var/tmp/slf [--jpeg brain.slf]

The limits need root or delegated control groups. The program reports limits that it cannot set, and
goes on without them.
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import pathlib
import subprocess
import sys
import tempfile
import time

SHAPE = ["--entry", "10", "--entry-extra-levels", "1", "--exit", "16", "--levels", "3"]
CODECS = ["--codec", "raw"]
LEAST_BYTES = 8_000_000_000
MIB = 1 << 20
FRAME_MS = 1000 / 30
EVERY = 10  # one frame in so many is compared
MOST_PSNR = 60  # in dB, for frames that are equal
PAUSE = 0.005  # seconds


class ControlGroup:
    """A control group of version 1 or 2, made for one run and removed with it."""

    def __init__(self, name, settings):
        """`settings` are the ways to set its limit, one for each version: folder, file, text. If
        none works, `path` is None and there is no limit."""
        self.path = None
        for base, file, text in settings:
            path = pathlib.Path(base) / f"{name}-{os.getpid()}"
            try:
                path.mkdir()
                (path / file).write_text(text)
                self.path = path
                break
            except OSError:
                with contextlib.suppress(OSError):
                    path.rmdir()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.path:
            self.path.rmdir()

    def enter(self):
        """Moves the calling process into the group: for a child, before it runs."""
        if self.path:
            (self.path / "cgroup.procs").write_text(str(os.getpid()))


class MemoryLimit(ControlGroup):
    def __init__(self, limit):
        self.limit = limit
        settings = (
            ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", str(limit)),
            ("/sys/fs/cgroup", "memory.max", str(limit)),
        )
        super().__init__("slf", settings)
        if self.path and (self.path / "memory.swap.max").exists():
            (self.path / "memory.swap.max").write_text("0")

    def killed(self):
        """How often the kernel killed a process of the group for lack of memory."""
        for name in ("memory.oom_control", "memory.events"):
            file = self.path / name
            if file.exists():
                rows = dict(line.split() for line in file.read_text().splitlines())
                return int(rows.get("oom_kill", 0))
        return 0

    def peak(self):
        for name in ("memory.max_usage_in_bytes", "memory.peak"):
            if (self.path / name).exists():
                return int((self.path / name).read_text())
        return None


class ReadLimit(ControlGroup):
    """A control group that limits the rate at which its processes read from a file's disk."""

    def __init__(self, file, megabytes):
        device = os.stat(file).st_dev
        number = f"{os.major(device)}:{os.minor(device)}"
        disk = pathlib.Path("/sys/dev/block") / number
        if (disk / "partition").exists():
            number = (disk.resolve().parent / "dev").read_text().strip()
        rate = round(1e6 * megabytes)
        settings = (
            ("/sys/fs/cgroup/blkio", "blkio.throttle.read_bps_device", f"{number} {rate}"),
            ("/sys/fs/cgroup", "io.max", f"{number} rbps={rate}"),
        )
        super().__init__("slf-read", settings)


def run(command, *limits):
    def enter():
        for limit in limits:
            if limit:
                limit.enter()

    done = subprocess.run(
        [str(part) for part in command], stdout=subprocess.PIPE, text=True, preexec_fn=enter
    )
    if done.returncode != 0:
        sys.exit(f"failed with {done.returncode}: {' '.join(map(str, command))}")
    return done.stdout


def build(slf, field):
    if not field.exists():
        print(f"building {field}", file=sys.stderr)
        run([slf, "build", "scene:globe", "-o", field, *SHAPE, *CODECS])
    size = field.stat().st_size
    if size < LEAST_BYTES:
        sys.exit(f"{field}: {size} bytes; at least {LEAST_BYTES} were wanted")
    return size


def draw(slf, field, size, limit, budgets, folder):
    """Draws pictures from around the field."""
    for azimuth in range(0, 360, 60):
        run(
            [slf, "render", field, "-f", "-o", folder / f"{azimuth}.png",
             "--orbit", f"{azimuth},20,3", "--size", size, *budgets],
            limit,
        )


def same_pictures(slf, field, size, limit, budgets):
    """Whether views under the limit equal those without."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        draw(slf, field, size, None, [], pathlib.Path(one))
        draw(slf, field, size, limit, budgets, pathlib.Path(other))
        names = sorted(path.name for path in pathlib.Path(one).iterdir())
        return all(
            json.loads(run([slf, "compare", f"{one}/{name}", f"{other}/{name}", "--json"]))["equal"]
            for name in names
        ), len(names)


def play(slf, field, size, limits, budgets, loading, seconds, *options):
    text = run(
        [slf, "-q", "play", field, "--cold", "--loading", loading, "--seconds", seconds,
         "--size", size, "--json", *budgets, *options],
        *limits,
    )
    return json.loads(text)["runs"][0]


READ_AT_RANDOM = """
import os, random, sys, time
file = os.open(sys.argv[1], os.O_RDONLY)
os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
os.posix_fadvise(file, 0, 0, os.POSIX_FADV_RANDOM)
blocks = os.fstat(file).st_size >> 16
begin, done = time.perf_counter(), 0
while (passed := time.perf_counter() - begin) < 3:
    done += len(os.pread(file, 1 << 16, random.randrange(blocks) << 16))
print(done / passed / 1e6)
"""


def storage_rate(field, limit):
    """MB/s of random reads of 64 KiB from the cold file, one after the other."""
    return float(run([sys.executable, "-c", READ_AT_RANDOM, field], limit))


def mean_psnr(slf, frames, references):
    """The mean PSNR of every EVERYth frame to the same frame in another folder."""
    names = sorted(path.name for path in frames.iterdir())[::EVERY]
    return sum(
        min(json.loads(run([slf, "compare", frames / name, references / name, "--json"]))["psnr"]
            or MOST_PSNR, MOST_PSNR)
        for name in names
    ) / len(names)


def throttled(slf, field, size, memory_limit, budgets, seconds, rates):
    """Plays with reads throttled to each rate: rows of numbers."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        whole = pathlib.Path(folder) / "whole"
        play(slf, field, size, [], [], "wait", seconds, "--frames", whole)
        for rate in rates:
            with ReadLimit(field, rate) as limit:
                if not limit.path:
                    print("no control group can be made that throttles reads (it needs root)")
                    break
                frames = pathlib.Path(folder) / str(rate)
                measured = storage_rate(field, limit)
                played = play(slf, field, size, [memory_limit, limit], budgets, "ahead", seconds,
                              "--frames", frames)["summary"]
                rows.append({"rate": rate, "measured": measured, "summary": played,
                             "psnr": mean_psnr(slf, frames, whole)})
    return rows


def print_throttled(rows):
    if rows:
        print(f"{'throttled to':>13} {'storage':>10} {'read':>8} {'late':>5} {'PSNR':>8}  "
              "% of the pixels by level, the finest first")
    for row in rows:
        s = row["summary"]
        shares = " ".join(f"{100 * share:.0f}" for share in reversed(s.get("level_shares", [])))
        print(f"{row['rate']:8} MB/s {row['measured']:5.1f} MB/s {s['load_bytes'] / 1e6:5.0f} MB "
              f"{s['late']:5} {row['psnr']:5.1f} dB  {shares}")


def watch_clock(seconds, pauses):
    begin = last = time.perf_counter()
    seen = []
    while last - begin < seconds:
        now = time.perf_counter()
        if now - last >= PAUSE:
            seen.append(1000 * (now - last))
        last = now
    pauses.put(seen)


def machine_pauses(seconds):
    """Milliseconds for which the machine kept a process from its core, while one process per core
    only read the clock. A frame that meets such a pause is late by it, whatever draws the frame."""
    pauses = multiprocessing.Queue()
    watchers = [multiprocessing.Process(target=watch_clock, args=(seconds, pauses))
                for _ in os.sched_getaffinity(0)]
    for watcher in watchers:
        watcher.start()
    return sorted(sum((pauses.get() for _ in watchers), []))


def first_frame(slf, field, size, views=5):
    """Milliseconds of first frames from a cold file, each from another direction."""
    times = []
    for k in range(views):
        text = run(
            [slf, "-q", "play", field, "--cold", "--loading", "wait", "--seconds", "0.01",
             "--size", size, "--orbit", f"{72 * k},{15 * k - 30},3", "--json"]
        )
        times.append(json.loads(text)["runs"][0]["frames"][0]["ms"])
    return times


def disk_bytes(slf, field, size):
    """Bytes read from the disk for a view, over the payloads of the tiles that it touched."""
    runs = json.loads(
        run([slf, "measure", field, "--level", "finest", "--size", size, "--json"])
    )["runs"]
    level = runs[0]["levels"][-1]
    if not runs[0]["kernel_counted"]:
        return None
    return 4096 * level["cached_pages"]["mean"] / level["compressed_bytes"]["mean"]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--slf", required=True, help="the command")
    parser.add_argument("--folder", required=True, help="where the field is, or is built")
    parser.add_argument("--jpeg", help="a JPEG field for the first frame and the bytes read")
    parser.add_argument("--limit", type=int, default=256, help="MiB of memory (256)")
    parser.add_argument("--memory", default="160MiB", help="slf's own budget")
    parser.add_argument("--size", default="512x512")
    parser.add_argument("--seconds", default="24", help="length of an orbit")
    parser.add_argument("--rates", type=float, nargs="*", default=[10, 50, 200],
                        help="MB/s that reads are throttled to (10 50 200)")
    parser.add_argument("--json", help="also write the numbers here")
    a = parser.parse_args()

    folder = pathlib.Path(a.folder)
    folder.mkdir(parents=True, exist_ok=True)
    field = folder / "globe.slf"
    numbers = {"field_bytes": build(a.slf, field), "limit": a.limit * MIB, "loading": {}}
    budgets = ["--memory", a.memory]
    print(f"{field}: {numbers['field_bytes'] / 1e9:.2f} GB, under {a.limit} MiB")
    with MemoryLimit(a.limit * MIB) as limit:
        if not limit.path:
            print("no memory control group can be made here (it needs root): no limit is set")
            limit = None
        equal, count = same_pictures(a.slf, field, a.size, limit, budgets)
        numbers["pictures_equal"] = equal
        print(f"{count} pictures {'equal' if equal else 'DIFFER FROM'} those without a limit")
        print(f"{'loading':10} {'frames':>7} {'late':>6} {'mean ms':>8} {'worst':>8} "
              f"{'full level':>11} {'least':>8} {'anonymous':>10}")
        for loading in ("ahead", "demand", "wait"):
            played = play(a.slf, field, a.size, [limit], budgets, loading, a.seconds)
            s = numbers["loading"][loading] = played["summary"]
            print(f"{loading:10} {s['frames']:7} {s['late']:6} {s['mean_ms']:8.1f} "
                  f"{s['worst_ms']:8.1f} {100 * s['full_share']:9.2f} % "
                  f"{100 * s['least_full_share']:6.2f} % {s['rss_anon_peak_bytes'] / MIB:6.0f} MiB")
            late = [f"{k}: {f['ms']:.0f}" for k, f in enumerate(played["frames"])
                    if f["ms"] > FRAME_MS]
            if 0 < len(late) <= 12:
                print(f"{'':10} ms of the late: {', '.join(late)}")
        numbers["throttled"] = throttled(a.slf, field, a.size, limit, budgets, a.seconds, a.rates)
        print_throttled(numbers["throttled"])
        if limit:
            numbers["oom_kills"], numbers["limit_peak"] = limit.killed(), limit.peak()
            print(f"killed for want of memory: {numbers['oom_kills']}")
    pauses = numbers["machine_pauses_ms"] = machine_pauses(float(a.seconds))
    print(f"the machine alone, all cores busy as long: {len(pauses)} pauses of {1000 * PAUSE:.0f} ms "
          f"and more, the longest {max(pauses, default=0):.1f} ms")
    if a.jpeg:
        numbers["first_frame_ms"] = first_frame(a.slf, a.jpeg, a.size)
        numbers["disk_bytes_ratio"] = disk_bytes(a.slf, a.jpeg, a.size)
        worst, ratio = max(numbers["first_frame_ms"]), numbers["disk_bytes_ratio"]
        print(f"{a.jpeg}: first frame from the disk, at worst {worst:.0f} ms")
        print("bytes from the disk over compressed bytes touched: "
              + (f"{ratio:.2f}" if ratio else "not known here"))
    if a.json:
        pathlib.Path(a.json).write_text(json.dumps(numbers, indent=1) + "\n")
    return 0 if numbers["pictures_equal"] else 7


if __name__ == "__main__":
    sys.exit(main())
