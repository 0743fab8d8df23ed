#!/usr/bin/env python3
"""A 4-D volume to test time with: a reaction of two substances that grows from a seed.

  benchmarks/reaction.py reaction.nii.gz [--side 64] [--steps 24] [--every 100]

The Gray-Scott model (Pearson, "Complex patterns in a simple system", Science 261, 1993) on a
cube of SIDE^3 voxels. Writes the second substance, 0 to 255, every EVERY iterations, as a NIfTI
file with STEPS time points. Needs numpy.
"""

import argparse
import gzip
import struct

import numpy

FEED, KILL, DIFFUSION_U, DIFFUSION_V, STEP = 0.04, 0.06, 0.16, 0.08, 1.0


def laplacian(field):
    return sum(numpy.roll(field, shift, axis)
               for axis in range(3) for shift in (-1, 1)) - 6 * field


def volumes(side, steps, every):
    """The second substance at each step, z slowest."""
    random = numpy.random.default_rng(1)
    u, v = numpy.ones((2, side, side, side), numpy.float32) * [[[[1]]], [[[0]]]]
    seed = (slice(side // 2 - 3, side // 2 + 3),) * 3
    u[seed], v[seed] = 0.5, 0.25 + 0.05 * random.random(v[seed].shape)
    for _ in range(steps):
        for _ in range(every):
            reaction = u * v * v
            u, v = (u + STEP * (DIFFUSION_U * laplacian(u) - reaction + FEED * (1 - u)),
                    v + STEP * (DIFFUSION_V * laplacian(v) + reaction - (FEED + KILL) * v))
        yield numpy.clip(v * 512, 0, 255).astype(numpy.uint8)


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
    parser.add_argument("--every", type=int, default=100, help="iterations between time points")
    options = parser.parse_args()
    with gzip.open(options.out, "wb", 1) as file:
        file.write(nifti_header(options.side, options.steps))
        for volume in volumes(options.side, options.steps, options.every):
            file.write(volume.tobytes())


if __name__ == "__main__":
    main()
