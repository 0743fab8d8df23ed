#!/usr/bin/env python3
"""Measures fields from pictures, and prints a table in Markdown.

  benchmarks/pictures_quality.py --slf build/release/cli/slf [--folder out/pictures]
      [--counts 50,100,200,400] [--shape "--entry 8 --exit 48 --levels 1"] [SET[:TEST] ...]

First a round trip: pictures of a volume, with depth, become a field, which is compared with further
pictures of the volume, beside the field that is ray-cast directly in the same shape. Then each SET,
as `slf build pictures:SET` takes it: with TEST, a file of other cameras; without, every eighth
picture is left out. What exists in the folder is not made again.
"""

import argparse
import json
import os
import pathlib
import resource
import shlex
import subprocess
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slf", required=True)
    parser.add_argument("--folder", default="out/pictures")
    parser.add_argument("--volume", default="/usr/share/mricron/templates/ch2bet.nii.gz")
    parser.add_argument("--transfer", default=ROOT / "scripts/data/brain.json")
    parser.add_argument("--counts", default="50,100,200,400")
    parser.add_argument("--size", default="512")
    parser.add_argument("--shape", default="--entry 8 --exit 48 --levels 1")
    parser.add_argument("sets", nargs="*")
    a = parser.parse_args()
    folder = pathlib.Path(a.folder)
    folder.mkdir(parents=True, exist_ok=True)

    def run(*arguments):
        return subprocess.run([a.slf, *map(str, arguments)], check=True, stdout=subprocess.PIPE)

    def measure(title, name, source, test=None):
        """Builds a field, unless it is there, and prints its row."""
        field, spent = folder / f"{name}.slf", ""
        if not field.exists():
            start = time.monotonic()
            run("build", *source, *shlex.split(a.shape), "-o", field, "-q")
            spent = f"{time.monotonic() - start:.0f} s"
        pictures = ["--pictures", test] if test else []
        quality = json.loads(run("evaluate", field, *pictures, "--json").stdout)
        print(f"| {title} | {quality['psnr']:.2f} dB | {quality['psnr_inside']:.2f} dB | "
              f"{quality['ssim']:.4f} | {quality['file_bytes'] / 2**20:.1f} MiB | {spent} |",
              flush=True)

    def draw(name, count):
        """Pictures of the volume from this many directions."""
        pictures = folder / name
        if not (pictures / "transforms.json").exists():
            cameras = folder / f"{name}.json"
            run("cameras", a.volume, "--transfer", a.transfer, "--count", count, "--size", a.size,
                "-o", cameras, "-f", "--distance", 2.5)
            run("raycast", a.volume, "--transfer", a.transfer, "--cameras", cameras, "-o", pictures,
                "-f", "-q")
        return pictures / "transforms.json"

    print(f"{os.cpu_count()} processors; {a.shape}\n")
    print("| field | PSNR | inside the sphere | SSIM | size | build |")
    print("|---|---|---|---|---|---|")
    # 23 directions are none of those of the other numbers.
    test = draw("test", 23)
    measure("ray-cast directly", "direct", [a.volume, "--transfer", a.transfer], test)
    for count in a.counts.split(","):
        measure(f"{count} pictures of it", f"from_{count}",
                [f"pictures:{draw(f'pictures_{count}', count)}"], test)
    for item in a.sets:
        source, _, test = item.partition(":")
        name = pathlib.Path(source).stem
        holdout = [] if test else ["--holdout", 8]
        measure(name, name, [f"pictures:{source}", *holdout], test)
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    print(f"\nmost memory of a process: {most / 2**20:.2f} GiB")


if __name__ == "__main__":
    main()
