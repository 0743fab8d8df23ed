#!/usr/bin/env python3
"""Bytes of two versions of the codec at the same picture.

  benchmarks/equal_quality.py BEFORE AFTER NAME=VOLUME... [--folder equal-quality] [--views 8]
      [--size 256] [--distance 3] [--mode depth] [-- BUILD-OPTION...]

BEFORE and AFTER are slf programs. BEFORE builds a lossless field of each volume; both repack it to
predictive:75, :90 and :95; AFTER draws all of them, and ray-casts the volume. Prints, for each
quality, payload bytes, PSNR and SSIM over black, PSNR over white (8-bit pictures, means over the
views), and `equal`: the bytes of AFTER over those of BEFORE where AFTER has the PSNR of BEFORE, by
interpolation of its logarithm. Needs numpy and Pillow.
"""

import argparse
import json
import pathlib
import subprocess
import sys

import numpy as np
from PIL import Image

QUALITIES = [75, 90, 95]
CURVE = [60, *QUALITIES, 98]


def run(program, *arguments):
    done = subprocess.run([program, "-q", *map(str, arguments)], check=True, capture_output=True,
                          text=True)
    return done.stdout


def kept(path, make):
    """Makes a file that another run has not left."""
    if not path.exists():
        make()
    return path


def over(path, background):
    picture = Image.open(path).convert("RGBA")
    ground = Image.new("RGBA", picture.size, (background,) * 3 + (255,))
    shown = path.with_name(f"{path.stem}-{background}.png")
    Image.alpha_composite(ground, picture).convert("RGB").save(shown)
    return shown


def quality(after, drawn, truths):
    found = {0: [], 255: []}
    for picture, truth in zip(drawn, truths):
        for background, values in found.items():
            said = json.loads(run(after, "compare", over(picture, background),
                                  over(truth, background), "--json"))
            values.append((said["psnr"], said["ssim"]))
    black, white = (np.mean(values, axis=0) for values in found.values())
    return {"psnr": round(black[0], 3), "ssim": round(black[1], 5), "white": round(white[0], 3)}


def row(program, options, name, field, qualityof, truths, orbits):
    folder = pathlib.Path(options.folder)
    label = "before" if program == options.before else "after"
    coded = folder / f"{name}-{label}-{qualityof}.slf"
    kept(coded, lambda: run(program, "repack", field, "-o", coded, "--codec",
                            f"predictive:{qualityof}"))
    pictures = []
    for k, orbit in enumerate(orbits):
        pictures.append(folder / f"{coded.stem}-{k}.png")
        run(options.after, "render", coded, "-o", pictures[-1], "-f", "--orbit", orbit, "--size",
            options.size, "--mode", options.mode, "--transparent")
    said = json.loads(run(options.after, "info", coded, "--json"))
    return {"payload": said["payload_bytes"], **quality(options.after, pictures, truths)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("volumes", nargs="+")
    parser.add_argument("--folder", default="equal-quality")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--distance", type=float, default=3)
    parser.add_argument("--mode", default="depth")
    words = sys.argv[1:]
    split = words.index("--") if "--" in words else len(words)
    options, build = parser.parse_args(words[:split]), words[split + 1:]
    folder = pathlib.Path(options.folder)
    folder.mkdir(parents=True, exist_ok=True)
    orbits = [f"{360 * k / options.views + 20},{50 * np.sin(2.4 * k):.3f},{options.distance}"
              for k in range(options.views)]
    for volume in options.volumes:
        name, _, source = volume.partition("=")
        field = folder / f"{name}.slf"
        kept(field, lambda: run(options.before, "build", source, "-o", field, "--codec", "zstd",
                                *build))
        recipe = list(build)
        for word in ("--entry", "--exit", "--levels"):
            if word in recipe:
                del recipe[recipe.index(word):recipe.index(word) + 2]
        truths = [folder / f"{name}-truth-{options.distance}-{k}.png"
                  for k in range(options.views)]
        for truth, orbit in zip(truths, orbits):
            kept(truth, lambda: run(options.after, "raycast", source, "-o", truth, "--orbit", orbit,
                                    "--size", options.size, "--transparent", *recipe))
        after = {q: row(options.after, options, name, field, q, truths, orbits) for q in CURVE}
        curve = sorted((one["psnr"], np.log(one["payload"])) for one in after.values())
        for q in QUALITIES:
            before = row(options.before, options, name, field, q, truths, orbits)
            equal = np.exp(np.interp(before["psnr"], *zip(*curve))) / before["payload"]
            print(json.dumps({"name": name, "quality": q, "before": before, "after": after[q],
                              "equal": round(float(equal), 3)}), flush=True)


if __name__ == "__main__":
    main()
