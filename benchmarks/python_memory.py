#!/usr/bin/env python3
"""What building and showing take in memory from Python.

    PYTHONPATH=build/release/python benchmarks/python_memory.py [--field FIELD] [--gigabytes 4]

Prints, each in a process of its own: the resident memory after FIELD has shown itself as in a
notebook, also under its page's requests; and the peak of a build from an array of so many
gigabytes that is read slab by slab, under the kernel's memory limit of 1 GB (which needs root or
delegated control groups). The build's light is direct: other light takes up to light_memory more.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

from out_of_core import MemoryLimit

SHOW = """
import sys, urllib.request
import slf
field = slf.open(sys.argv[1])
field._repr_mimebundle_()
view = field.show()
with urllib.request.urlopen(view.url) as page:
    page.read()
for offset in range(0, field.file_bytes, max(1, field.file_bytes // 1000)):
    request = urllib.request.Request(view.url + "field.slf",
                                     headers={"Range": f"bytes={offset}-{offset + 65535}"})
    urllib.request.urlopen(request).read()
for line in open("/proc/self/status"):
    if line.startswith(("VmHWM", "VmRSS", "RssAnon", "RssFile")):
        print(line.strip())
"""

BUILD = """
import sys, time
import numpy as np
import slf

class Chunked:  # as an array of zarr
    shape, dtype, chunks = (int(sys.argv[1]), 1024, 1024), np.dtype("i2"), (16, 1024, 1024)
    def __getitem__(self, part):
        z, y, x = (axis.astype("i2") // 64 for axis in np.ogrid[part, 0:1024, 0:1024])
        return (z + y + x) % 2 * np.int16(2000)

begin = time.perf_counter()
slf.build(Chunked(), sys.argv[2], entry=2, exit=8, finest_level=0, lighting="direct",
          transfer=[[0, 0, 0, 0, 0], [1000, 0, 0, 0, 0], [2000, 1, 1, 1, 0.5]])
print(f"{np.prod(Chunked.shape) * 2 / 1e9:.2f} GB of voxels in {time.perf_counter() - begin:.0f} s")
"""


def run(script, *arguments, **options):
    subprocess.run([sys.executable, "-c", script, *map(str, arguments)], check=True, **options)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--field", type=pathlib.Path)
    parser.add_argument("--gigabytes", type=float, default=4, help="0: no build")
    parser.add_argument("--folder", help="for the build; it needs so much space")
    a = parser.parse_args()
    if a.field:
        print(f"{a.field}: {a.field.stat().st_size / 1e9:.2f} GB")
        run(SHOW, a.field)
    if a.gigabytes == 0:
        return
    with tempfile.TemporaryDirectory(dir=a.folder) as folder, MemoryLimit(10**9) as limit:
        run(BUILD, round(a.gigabytes * 1e9 / 2**21), os.path.join(folder, "a.slf"),
            preexec_fn=limit.enter)
        if limit.path:
            print(f"peak under a limit of 1 GB: {limit.peak() / 1e9:.2f} GB with pages of files")
        else:
            print("no memory limit could be set")


if __name__ == "__main__":
    main()
