#!/usr/bin/env python3
"""Cuts through fields: what they lay open, beside ray-casting the volume with the same plane.

  benchmarks/cut.py NAME=VOLUME[:OPTION=VALUE...]... [--folder cut-benchmark] [--planes 5]
      [--views 8] [--size 160] [--reveal 192] [--loss 0] [--truth-samples N]
      [--built] [--sheet FILE.png] [--slf build/release/cli/slf] [-- BUILD-OPTION=VALUE...]

as `brain=ch2bet.nii.gz:transfer=brain.json atlas=labels.nii.gz:labels=true`. Options are settings
of slf.build(), as JSON or text. Each field has a reveal. The first five planes go through the
centre of its sphere, three along the axes and two oblique ones; more have other directions, and up
to a quarter of the radius from it. A picture is exposed where the first hit with the
plane is deeper than without it. For each cap it prints the PSNR of exposed pixels, pooled over the
views of a plane, then of all pixels, each the mean over the planes; for the uncut field that of all
pixels, and that of the copy ray-cast alone, without the field; and the time of a cut view over that
of an uncut one, once tiles and light are there. The light of the truth has noise of its own, less
with more paths, `--truth-samples`. With `--built`, also for a field that was built
with the plane. Needs slf for Python and numpy; a sheet of pictures needs Pillow.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import numpy as np

import slf

CAPS = ("shaded", "coarse", "hollow")


def planes_of(center, radius, count):
    """Points and normals."""
    normals = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (1, -1, 0.5)][:count]
    planes = [(tuple(center), normal) for normal in normals]
    for k in range(len(planes), count):  # along a spiral on the sphere
        z = 1 - (2 * k + 1) / count
        angle, flat = 2.4 * k, np.sqrt(1 - z * z)
        normal = np.array((flat * np.cos(angle), flat * np.sin(angle), z))
        point = np.asarray(center) + 0.25 * radius * np.sin(1.7 * k) * normal
        planes.append((tuple(point), tuple(normal)))
    return planes


def settings_of(texts):
    settings = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            settings[name] = json.loads(value)
        except json.JSONDecodeError:
            settings[name] = value
    return settings


def rgb(picture):
    return np.clip(picture[..., :3], 0, 1)


class Errors:
    """Squared errors of exposed pixels and of all, pooled."""

    def __init__(self):
        self.sums, self.counts = [0.0, 0.0], [0, 0]

    def add(self, drawn, truth, exposed):
        squares = (rgb(drawn) - rgb(truth)) ** 2
        for k, chosen in enumerate((squares[exposed], squares)):
            self.sums[k] += float(chosen.sum())
            self.counts[k] += chosen.size

    def psnr(self):
        return [-10 * np.log10(max(s / c, 1e-12)) if c else np.nan
                for s, c in zip(self.sums, self.counts)]


def seconds(draw):
    draw()
    times = []
    for _ in range(3):
        begin = time.process_time()
        draw()
        times.append(time.process_time() - begin)
    return sorted(times)[1]


def run_case(name, volume, settings, build, options):
    folder = pathlib.Path(options.folder)
    lit = {} if settings.get("lighting") == "direct" else {"light_file": folder / f"{name}.light"}
    field = slf.build(volume, folder / f"{name}.slf", reveal=options.reveal,
                      reveal_loss=options.loss, **settings, **build, **lit)
    field = slf.open(field.path, memory=1 << 30)  # large reveals need more than the default
    center, radius = field.sphere
    size = (options.size, options.size)
    cameras = [field.camera(slf.orbit(360 * k / options.views + 20, 50 * np.sin(2.4 * k), 3), size)
               for k in range(options.views)]
    finer = {"light_samples": options.truth_samples} if options.truth_samples else {}
    if finer and lit:
        lit = {"light_file": folder / f"{name}-truth.light"}
    whole = [slf.raycast(volume, camera, size, depth=True, **settings, **lit, **finer)
             for camera in cameras]
    values, affine = field.reveal()
    said = subprocess.run([options.slf, "info", field.path, "--json"],
                          capture_output=True, check=True).stdout
    reveal_bytes = json.loads(said)["reveal"]["bytes"]
    shown = {key: value for key, value in settings.items() if key not in ("crop", "spacing")}
    uncut, alone = Errors(), Errors()
    for camera, truth in zip(cameras, whole):
        everywhere = np.ones(truth.depth.shape, bool)
        uncut.add(field.render(camera, size), truth.rgba, everywhere)
        copy = slf.raycast(values, camera, size, affine=affine, **shown)
        alone.add(copy, truth.rgba, everywhere)
    ways = CAPS + ("built",) * options.built
    found = {way: [] for way in ways}
    times, pictures = [], []
    for number, plane in enumerate(planes_of(center, radius, options.planes)):
        cut = {"clip": [[*plane[0], *plane[1]]]}
        own = lit and {"light_file": folder / f"{name}-{number}.light"}
        errors = {way: Errors() for way in ways}
        built = options.built and slf.build(volume, folder / f"{name}-{number}.slf", **settings,
                                            **build, **own, **cut)
        for camera, before in zip(cameras, whole):
            truth = slf.raycast(volume, camera, size, depth=True, **settings, **own, **cut,
                                **finer)
            hit = np.isfinite(truth.depth)
            exposed = hit & (truth.depth > before.depth + 0.01 * radius)
            row = [truth.rgba]
            for way in ways:
                drawn = built.render(camera, size) if way == "built" else \
                    field.render(camera, size, clip=[plane], cap=way)
                errors[way].add(drawn, truth.rgba, exposed)
                row.append(drawn)
            if camera is cameras[number % len(cameras)]:
                pictures += [*row, field.render(camera, size, clip=[plane], cap="slice")]
        for way in ways:
            found[way].append(errors[way].psnr())
        big = (512, 512)
        camera = field.camera(slf.orbit(40, 20, 3), big)
        times.append(seconds(lambda: field.render(camera, big, clip=[plane])) /
                     seconds(lambda: field.render(camera, big)))
    kept = json.loads(json.dumps({way: np.nanmean(found[way], axis=0).round(2).tolist()
                                  for way in ways}))
    print(json.dumps({"name": name, "uncut": round(uncut.psnr()[1], 2),
                      "copy alone": round(alone.psnr()[1], 2), "exposed, all": kept,
                      "payload_bytes": field.content().payload_bytes,
                      "reveal_bytes": reveal_bytes,
                      "light_bytes": lit and os.path.getsize(lit["light_file"]),
                      "time": [round(float(t), 2) for t in times],
                      "reveal_voxels": list(field.reveal()[0].shape[::-1])}), flush=True)
    return pictures, 2 + len(ways)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+")
    parser.add_argument("--folder", default="cut-benchmark")
    parser.add_argument("--planes", type=int, default=5)
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--reveal", type=int, default=192)
    parser.add_argument("--loss", type=int, default=0)
    parser.add_argument("--truth-samples", type=int, help="paths of a node of the truth's light")
    parser.add_argument("--slf", default="slf", help="the command")
    parser.add_argument("--built", action="store_true")
    parser.add_argument("--sheet")
    words = sys.argv[1:]
    split = words.index("--") if "--" in words else len(words)
    options = parser.parse_args(words[:split])
    build = {"entry": 8, "exit": 16, "finest_level": 1} | settings_of(words[split + 1:])
    pathlib.Path(options.folder).mkdir(parents=True, exist_ok=True)
    pictures, columns = [], 1
    for case in options.cases:
        name, _, rest = case.partition("=")
        volume, *more = re.split(r":(?=\w+=)", rest)
        made, columns = run_case(name, volume, settings_of(more), build, options)
        pictures += made
    if options.sheet:
        from PIL import Image
        shown = [(255 * rgb(picture)).astype(np.uint8) for picture in pictures]
        rows = [np.hstack(shown[k:k + columns]) for k in range(0, len(shown), columns)]
        Image.fromarray(np.vstack(rows)).save(options.sheet)


if __name__ == "__main__":
    main()
