"""The volumes the report draws, and resampled copies of them."""

import gzip
import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Volume:
    """The source of a field: a file or scene:NAME, and how to render it."""

    name: str
    title: str
    path: str
    transfer: str = ""
    options: tuple = ()

    def arguments(self):
        transfer = ["--transfer", self.transfer] if self.transfer else []
        return [self.path, *transfer, *self.options]

    def under_direct_light(self):
        """Its arguments; analytic scenes bring their own light."""
        light = [] if self.path.startswith("scene:") else ["--lighting", "direct"]
        return [*self.arguments(), *light]


def _packaged(package, ending):
    """The file of an installed Debian package whose path ends so, or None."""
    try:
        listing = subprocess.run(
            ["dpkg", "-L", package], capture_output=True, text=True, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    found = [line for line in listing.splitlines() if line.endswith(ending)]
    return Path(found[0]) if found else None


def _template_folder():
    """The folder of mricron-data's volumes, or None."""
    brain = _packaged("mricron-data", "/ch2bet.nii.gz")
    return brain and brain.parent


def write_skull(target):
    """Writes the CT of a head from invesalius-examples as NRRD, if that package is installed.
    Returns whether it is."""
    archive = _packaged("invesalius-examples", "/Cranium.inv3")
    if not archive:
        return False
    with tarfile.open(archive) as files:
        member = next(name for name in files.getnames() if name.endswith("/matrix.dat"))
        voxels = files.extractfile(member).read()
    header = (
        "NRRD0004\ntype: int16\nendian: little\ndimension: 3\nsizes: 256 256 108\n"
        "spacings: 0.957 0.957 1.5\nencoding: raw\n\n"
    )
    target.write_bytes(header.encode() + voxels)
    return True


def find_volumes(root, data):
    """All available volumes, by name, in the order in which the report shows them. `data` is a
    folder with the layout of the development volumes; without it, packaged ones are used."""
    brain, presets = root / "scripts/data", data / "transfer"
    templates = _template_folder()
    wanted = []
    if templates:
        wanted += [
            ("brain", "Brain, MRI", templates / "ch2bet.nii.gz", brain / "brain.json", ()),
            ("glass", "Brain, translucent", templates / "ch2bet.nii.gz",
             brain / "brain_translucent.json", ()),
        ]  # fmt: skip
    wanted += [
        ("head", "Head, CT: skin and bone", data / "cranium_ct/cranium_ct_256x256x108_int16.nrrd",
         presets / "ct_skin_bone.json", ()),
        ("bonsai", "Bonsai, CT", data / "bonsai_ct/bonsai.nii.gz", presets / "bonsai.json", ()),
        ("engine", "Engine block, CT", data / "engine_ct/engine.nii.gz", presets / "engine.json", ()),
        ("heptane", "Heptane jet, simulation", data / "heptane_sim/heptane.nii.gz", None, ()),
        ("atlas", "Brain atlas, 141 labels", data / "allen_brain_labels/AllenAtlas.nii.gz", None,
         ("--labels",)),
        ("teapot", "Teapot with a lobster, CT",
         data / "boston_teapot_ct/boston_teapot_256x256x178_uint8.nrrd", None, ()),
        ("tooth", "Tooth, CT", data / "tooth_ct/tooth.nhdr", None, ()),
    ]  # fmt: skip
    if templates:
        wanted += [
            ("scalp", "Head, MRI", templates / "ch2.nii.gz", None, ()),
            ("regions", "Brain regions, labels", templates / "aal.nii.gz", None, ("--labels",)),
            ("monkey", "Macaque brain, MRI", templates / "inia19-t1-brain.nii.gz", None, ()),
            ("areas", "Brodmann areas, labels", templates / "brodmann.nii.gz", None, ("--labels",)),
        ]
    return {
        name: Volume(name, title, str(path), str(transfer or ""), options)
        for name, title, path, transfer, options in wanted
        if Path(path).exists() and (not transfer or Path(transfer).exists())
    }


def resample_nifti(source, info, side, target):
    """Writes an 8-bit NIfTI volume as NRRD with side³ voxels that fill the same box of the world.
    `info` is what `slf info --json` prints for it."""
    data = gzip.open(source).read()
    offset = int(np.frombuffer(data, "<f4", 1, 108)[0])
    dims = np.frombuffer(data, "<i2", 3, 42).astype(int)
    if np.frombuffer(data, "<i2", 1, 70)[0] != 2:
        raise ValueError(f"{source}: expected 8-bit voxels")
    voxels = np.frombuffer(data, "u1", int(dims.prod()), offset).reshape(dims[::-1])
    voxels = voxels.astype(np.float32)
    for axis in range(3):
        voxels = _stretch(voxels, axis, side)
    axes = np.array(info["axes"], float)  # rows: a voxel's step along x, y, z in the world
    scale = dims / side
    steps = axes * scale[:, None]
    origin = np.array(info["origin"], float) + ((scale - 1) / 2) @ axes
    vector = lambda v: "(" + ",".join(f"{x:.9g}" for x in v) + ")"  # noqa: E731
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\n"
        f"sizes: {side} {side} {side}\nspace directions: {' '.join(map(vector, steps))}\n"
        f"space origin: {vector(origin)}\nencoding: raw\n\n"
    )
    with open(target, "wb") as file:
        file.write(header.encode())
        file.write(np.clip(np.rint(voxels), 0, 255).astype(np.uint8).tobytes())


def _stretch(voxels, axis, side):
    """Linear interpolation along an axis; a mean over the covered voxels when it shrinks."""
    count = voxels.shape[axis]
    if side < count:
        edges = np.linspace(0, count, side + 1)
        sums = np.insert(np.cumsum(voxels, axis=axis, dtype=np.float64), 0, 0, axis=axis)
        below = np.minimum(edges.astype(int), count - 1)
        part = (edges - below).reshape([-1 if a == axis else 1 for a in range(3)])
        at = np.take(sums, below, axis) * (1 - part) + np.take(sums, below + 1, axis) * part
        return (np.diff(at, axis=axis) * side / count).astype(np.float32)
    at = np.clip((np.arange(side) + 0.5) * count / side - 0.5, 0, count - 1)
    low = np.minimum(at.astype(int), count - 2)
    part = (at - low).reshape([-1 if a == axis else 1 for a in range(3)]).astype(np.float32)
    return np.take(voxels, low, axis) * (1 - part) + np.take(voxels, low + 1, axis) * part
