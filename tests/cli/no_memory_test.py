#!/usr/bin/env python3
"""Commands for which an allocation fails, of any library, or it and all later ones.

  tests/cli/no_memory_test.py build/release/cli/slf .../libfailing_malloc.so [--every 1]

Each ends by itself: with what it does otherwise, or with exit code 4 and a message. Files that it
says to have written are those that it writes otherwise.
"""

import argparse
import os
import pathlib
import random
import subprocess
import sys
import tempfile

SHAPE = ["--entry", "2", "--exit", "4", "--levels", "1"]
# Name, arguments, and what they write. {} is the folder.
COMMANDS = [
    (["--help"], []), (["--version"], []), (["render", "--foo"], []), (["repack"], []),
    (["build", "scene:balls", "-o", "{}/b.slf", *SHAPE], ["b.slf"]),
    (["build", "{}/v.npy", "-o", "{}/v.slf", *SHAPE], ["v.slf"]),
    (["info", "{}/a.slf"], []), (["info", "{}/a.slf", "--json"], []), (["info", "{}/v.npy"], []),
    (["render", "{}/a.slf", "-o", "{}/view.png", "--size", "32", "-f"], ["view.png"]),
    (["pick", "{}/a.slf", "16,16", "--size", "32"], []),
    (["repack", "{}/a.slf", "-o", "{}/r.slf"], ["r.slf"]),
    (["repack", "{}/a.slf", "-o", "{}/z.slf", "--codec", "zstd:1"], ["z.slf"]),
    (["merge", "{}/1.slf", "{}/2.slf", "-o", "{}/m.slf"], ["m.slf"]),
    (["verify", "{}/a.slf", "--fix"], ["a.slf"]), (["verify", "{}/zstd.slf", "--fix"], ["zstd.slf"]),
    (["verify", "{}/jpeg.slf", "--fix"], ["jpeg.slf"]),
    (["diff", "{}/a.slf", "{}/zstd.slf"], []), (["ls", "{}/a.slf"], []),
    (["tile", "{}/a.slf", "0/7", "-o", "{}/t.png", "-f"], ["t.png"]),
    (["raycast", "scene:balls", "-o", "{}/ray.png", "--size", "16", "-f"], ["ray.png"]),
    (["compare", "{}/two.png", "{}/two.png"], []),
    (["evaluate", "{}/a.slf", "--volume", "scene:balls", "--views", "1", "--size", "16"], []),
    (["play", "{}/a.slf", "--seconds", "0.1", "--fps", "10", "--size", "16"], None),
    (["measure", "{}/a.slf", "--views", "2", "--size", "16"], None),  # prints times
    (["transfer", "--list"], []), (["cameras", "scene:balls", "-o", "{}/c.json", "-f"], ["c.json"]),
    (["export", "{}/a.slf", "-o", "{}/page.html", "-f"], ["page.html"]),
]


class Runs:
    def __init__(self, slf, library, folder):
        self.slf, self.library, self.folder = slf, library, folder

    def run(self, arguments, written, failing=1 << 50, all_later=False):
        """(whether an allocation failed, exit code, stdout, stderr, files)."""
        mark = self.folder / "failed"
        for name in written or []:
            if name not in ("a.slf", "zstd.slf", "jpeg.slf"):
                for path in self.folder.glob(name + "*"):
                    path.unlink()
        mark.unlink(missing_ok=True)
        environment = dict(os.environ, LD_PRELOAD=self.library, SLF_TEST_FAILING=str(failing),
                           SLF_TEST_FAILED=str(mark))
        if all_later:
            environment["SLF_TEST_ALL_LATER"] = "1"
        done = subprocess.run([self.slf, "-q", *(a.format(self.folder) for a in arguments)],
                              env=environment, capture_output=True, timeout=120, check=False)
        files = [(self.folder / name).read_bytes() if (self.folder / name).exists() else None
                 for name in written or []]
        out = b"" if written is None else done.stdout
        return mark.exists(), done.returncode, out, done.stderr, files


def failures(runs, arguments, written, most, every):
    """What is wrong, as lines."""
    _, code, out, err, files = runs.run(arguments, written)
    count = 1
    while runs.run(arguments, written, count)[0]:
        count *= 2
    tried = range(0, count, every) if every else sorted(
        {*range(8), *(random.randrange(count) for _ in range(most))})
    for failing in tried:
        for all_later in (False, True):
            failed, *ended = runs.run(arguments, written, failing, all_later)
            same = ended[0] == code and ended[1] == out and ended[3] == files
            refused = ended[0] == 4 and b"slf: " in ended[2]
            # A library may do without, such as one that only wanted to keep something for later.
            if not (same if not failed else same or refused):
                yield (f"slf {' '.join(arguments)}: allocation {failing}"
                       f"{' and all later' if all_later else ''}: exit code {ended[0]} (otherwise "
                       f"{code}): {ended[2][-300:]!r}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("slf")
    parser.add_argument("library")
    parser.add_argument("--most", type=int, default=20, help="numbers of allocations to try")
    parser.add_argument("--every", type=int, default=0, help="try every N-th allocation")
    parser.add_argument("--only", default="", help="commands that begin with this")
    a = parser.parse_args()
    random.seed(1)
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder)
        header = "{'descr': '|u1', 'fortran_order': False, 'shape': (12, 12, 12), }"
        header += " " * (117 - len(header)) + "\n"
        (place / "v.npy").write_bytes(
            b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() +
            bytes(255 - 3 * (abs(x - 6) + abs(y - 6) + abs(z - 6))
                  for x in range(12) for y in range(12) for z in range(12)))
        for name, *options in (["a"], ["zstd", "--codec", "zstd"], ["jpeg", "--codec", "jpeg:80"],
                               ["1", "--shard", "1/2"], ["2", "--shard", "2/2"]):
            subprocess.run([a.slf, "-q", "build", "scene:balls", "-o", place / (name + ".slf"),
                            *SHAPE, *options], check=True)
        subprocess.run([a.slf, "-q", "render", place / "a.slf", "-o", place / "two.png", "--size",
                        "32"], check=True)
        runs = Runs(a.slf, a.library, place)
        for arguments, written in COMMANDS:
            if arguments[0].startswith(a.only):
                wrong += failures(runs, arguments, written, a.most, a.every)
    print("\n".join(wrong))
    print(len(wrong), "runs ended as they must not")
    return len(wrong) > 0


if __name__ == "__main__":
    sys.exit(main())
