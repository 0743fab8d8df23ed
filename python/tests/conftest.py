"""Fields and voxels for the tests, and the command line to compare with."""

import os
import pathlib
import signal
import struct
import subprocess

import numpy as np
import pytest

import slf

SMALL = dict(entry=2, exit=8, finest_level=1)
SMALL_ARGUMENTS = ["--entry", "2", "--exit", "8", "--levels", "1"]


# Where the tests run in the background of a shell, SIGINT is ignored, and Python leaves that so.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def command():
    """Runs `slf ARGUMENTS...`, which must succeed."""
    program = os.environ["SLF_COMMAND"]
    # Python needs a sanitizer's library preloaded, but the program has its own.
    environment = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}

    def run(*arguments):
        return subprocess.run([program, "-q", *map(str, arguments)], check=True,
                              capture_output=True, text=True, env=environment).stdout

    return run


@pytest.fixture(scope="session")
def balls_path(tmp_path_factory) -> pathlib.Path:
    path = tmp_path_factory.mktemp("fields") / "balls.slf"
    slf.build("scene:balls", path, **SMALL).close()
    return path


@pytest.fixture()
def balls(balls_path):
    with slf.open(balls_path) as field:
        yield field


@pytest.fixture(scope="session")
def voxels() -> np.ndarray:
    """A soft ball with a bump, int16 [z, y, x], with values that no axis order confuses."""
    z, y, x = np.mgrid[0:12, 0:14, 0:16]
    ball = 1000 - 25 * ((x - 8) ** 2 + (y - 6) ** 2 + (z - 6) ** 2)
    return (np.clip(ball, -200, 1000) + 3 * x + 2 * y + z).astype(np.int16)


def write_nifti(path, array, affine, slope=1.0, intercept=0.0):
    """A NIfTI-1 file of an int16 array indexed [x, y, z]."""
    header = bytearray(348)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *array.shape, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, 1, *np.linalg.norm(affine[:3, :3], axis=0), 0, 0, 0, 0)
    struct.pack_into("<fff", header, 108, 352, slope, intercept)
    header[123] = 2  # mm
    struct.pack_into("<hh", header, 252, 0, 1)
    for row in range(3):
        struct.pack_into("<4f", header, 280 + 16 * row, *affine[row])
    header[344:348] = b"n+1\0"
    path.write_bytes(bytes(header) + bytes(4) + array.astype("<i2").tobytes(order="F"))
