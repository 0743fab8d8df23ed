#!/usr/bin/env python3
"""A 4-D volume to test time with: a reaction that spreads through a bed of grains.

  benchmarks/reaction.py reaction.nii.gz [--side 64] [--steps 24] [--every 30]

The Gray-Scott model of two substances (Pearson, "Complex patterns in a simple system", Science 261,
1993) in a cube of SIDE^3 voxels, between balls that nothing flows through. It starts at the top.
Writes a NIfTI file with STEPS time points, EVERY iterations apart: the second substance from 0 to
200, balls as 255. `reaction.nii.json` beside it is a transfer function. Needs numpy.
"""

import argparse
import gzip
import json
import pathlib
import struct

import numpy

FEED, KILL, DIFFUSION_U, DIFFUSION_V = 0.03, 0.057, 0.16, 0.08
TRANSFER = {"RGBPoints": [0, 0.2, 0.3, 0.9, 120, 1, 0.6, 0.2, 200, 1, 0.8, 0.5, 230, 0.8, 0.8, 0.8],
            "Points": [90, 0, 0.5, 0, 120, 0.8, 0.5, 0, 220, 0.8, 0.5, 0, 230, 1, 0.5, 0]}


def grains(side, random):
    """Where the balls are: as many as find a place in 4000 tries."""
    z, y, x = numpy.ogrid[:side, :side, :side]
    balls, filled = [], numpy.zeros((side,) * 3, bool)
    for center in random.uniform(side / 8, side * 7 / 8, (4000, 3)):
        radius = random.uniform(side / 14, side / 9)
        if all(numpy.linalg.norm(center - c) > radius + r for c, r in balls):
            balls.append((center, radius))
            filled |= ((z - center[0]) ** 2 + (y - center[1]) ** 2 + (x - center[2]) ** 2
                       < radius ** 2)
    return filled


def laplacian(field, free):
    """Nothing flows between free voxels and others."""
    return sum(numpy.where(numpy.roll(free, shift, axis), numpy.roll(field, shift, axis), field)
               for axis in range(3) for shift in (-1, 1)) - 6 * field


def volumes(side, steps, every):
    """The stored values at each step, z slowest."""
    random = numpy.random.default_rng(1)
    free = ~grains(side, random)
    u, v = numpy.ones((2, side, side, side), numpy.float32) * [[[[1]]], [[[0]]]]
    seed = (slice(side * 5 // 6, side * 5 // 6 + 6), *(slice(side // 2 - 3, side // 2 + 3),) * 2)
    u[seed], v[seed] = 0.5, 0.25 + 0.05 * random.random(v[seed].shape)
    for _ in range(steps):
        for _ in range(every):
            reaction = u * v * v * free
            u, v = (u + DIFFUSION_U * laplacian(u, free) - reaction + FEED * (1 - u),
                    v + DIFFUSION_V * laplacian(v, free) + reaction - (FEED + KILL) * v)
        yield numpy.where(free, numpy.clip(v * 500, 0, 200), 255).astype(numpy.uint8)


def nifti_header(side, steps):
    """One of 352 bytes: uint8, 4-D, voxels of 1 mm, about the origin."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 4, side, side, side, steps, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 2, 8)  # uint8, bits
    struct.pack_into("<8f", header, 76, 1, 1, 1, 1, 1, 0, 0, 0)
    struct.pack_into("<f", header, 108, 352)  # where the voxels begin
    struct.pack_into("<2h", header, 252, 0, 1)  # only the rows of the matrix below
    for axis in range(3):
        row = [0.0, 0.0, 0.0, -side / 2]
        row[axis] = 1.0
        struct.pack_into("<4f", header, 280 + 16 * axis, *row)
    header[344:348] = b"n+1\0"
    return bytes(header)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out")
    parser.add_argument("--side", type=int, default=64)
    parser.add_argument("--steps", type=int, default=24)
    parser.add_argument("--every", type=int, default=30, help="iterations between time points")
    options = parser.parse_args()
    pathlib.Path(options.out).with_suffix(".json").write_text(json.dumps(TRANSFER))
    with gzip.open(options.out, "wb", 1) as file:
        file.write(nifti_header(options.side, options.steps))
        for volume in volumes(options.side, options.steps, options.every):
            file.write(volume.tobytes())


if __name__ == "__main__":
    main()
