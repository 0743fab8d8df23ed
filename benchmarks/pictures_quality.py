#!/usr/bin/python3
"""Measures fields from pictures and meshes, and prints tables in Markdown.

  benchmarks/pictures_quality.py --slf build/release/cli/slf [--parts brain,vtk,cycles,sets,mesh]
      [--quick] [--folder out/pictures] [--data ../shared/data] [SET[:TEST] ...]

  brain   pictures of a volume, with depth, become a field, which is compared with further pictures
          of the volume, beside the field that is ray-cast directly in the same shape
  vtk     VTK's pictures of the same scan, without depth, beside VTK's own new views
  cycles  Cycles' pictures of a mesh with a texture, with Z, beside Cycles' own new views
  sets    the chair and the mouse of --data, or each SET as `slf build pictures:SET` takes it: with
          TEST, a file of other cameras; without, every eighth picture is left out
  mesh    rays a second of a mesh and of a volume, a mesh of 10 million triangles, and whether the
          number of threads changes a field

Fields and pictures are kept in the folder and used again. Parts whose programs or data are missing
are named and left out. Needs Debian's own Python for VTK and NumPy.
"""

import argparse
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import time
import typing

ROOT = pathlib.Path(__file__).resolve().parents[1]
RENDERERS = ROOT / "examples/renderers"
PARTS = ["brain", "vtk", "cycles", "sets", "mesh"]
BRAIN = pathlib.Path("/usr/share/mricron/templates/ch2bet.nii.gz")
MIB = 2**20


class Missing(Exception):
    """What a part needs is not installed, or not there; the message names it."""


class Failed(Exception):
    """A command failed."""


class Cost(typing.NamedTuple):
    output: str
    seconds: float
    processor: float  # user seconds, of all threads and child processes
    memory: float  # MiB at most, of the process and its child processes together


class Row(typing.NamedTuple):
    """A field beside pictures that it was not built from. Without a cost, it was there before."""

    title: str
    field: pathlib.Path
    psnr: float
    ssim: float
    psnr_inside: float  # the sphere
    ssim_inside: float
    size: int  # bytes
    build: typing.Optional[Cost]
    views: list  # of each picture: its name; psnr, ssim, psnr_inside, ssim_inside


def _tree(process):
    """A process and its descendants."""
    found, at = [process], 0
    while at < len(found):
        try:
            children = pathlib.Path(f"/proc/{found[at]}/task/{found[at]}/children").read_text()
            found += map(int, children.split())
        except OSError:
            pass
        at += 1
    return found


def _resident(process):
    """MiB of memory; pages that several processes share count once."""
    total = 0
    for number in _tree(process):
        try:
            lines = pathlib.Path(f"/proc/{number}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total / 1024


class Tools:
    """Programs, and the folder for what they write. `note` is told each command."""

    def __init__(self, slf, folder, data, quick=False, note=None):
        self.program, self.quick, self.note = str(slf), quick, note
        self.folder, self.data = pathlib.Path(folder), pathlib.Path(data)
        self.folder.mkdir(parents=True, exist_ok=True)

    def run(self, *words, measured=False):
        words = [str(word) for word in words]
        if self.note:
            self.note(words)
        begin, memory = time.monotonic(), 0.0
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
        errors = self.folder / "errors.txt"
        with open(self.folder / "output.txt", "w+") as out, open(errors, "w+") as err:
            process = subprocess.Popen(words, stdout=out, stderr=err, env=environment,
                                       stdin=subprocess.DEVNULL)  # fmt: skip
            try:
                while True:
                    done, status, usage = os.wait4(process.pid, os.WNOHANG)
                    if done:
                        break
                    memory = max(memory, _resident(process.pid) if measured else 0)
                    time.sleep(0.2 if measured else 0.02)
            except BaseException:
                process.terminate()
                raise
            process.returncode = os.waitstatus_to_exitcode(status)
            out.seek(0), err.seek(0)
            output, complaint = out.read(), err.read()
        if process.returncode != 0:
            raise Failed(f"{shlex.join(words)}: exit code {process.returncode}: "
                         f"{(output + complaint)[-600:]}")  # fmt: skip
        memory = max(memory, usage.ru_maxrss / 1024)
        return Cost(output, time.monotonic() - begin, usage.ru_utime, memory)

    def slf(self, *words, **options):
        return self.run(self.program, *words, **options)

    def row(self, title, name, source, shape, test):
        """Builds a field, unless it is there, and compares it with pictures."""
        field, build = self.folder / f"{name}.slf", None
        cost = self.folder / f"{name}.cost.json"
        if not cost.exists() or not field.exists():
            build = self.slf("build", *source, *shape.split(), "-o", field, "-f", "-q",
                             measured=True)  # fmt: skip
            cost.write_text(json.dumps(build))
        build = Cost(*json.loads(cost.read_text()))
        said = json.loads(self.slf("evaluate", field, "--pictures", test, "--json").output)
        return Row(title, field, said["psnr"], said["ssim"], said["psnr_inside"],
                   said["ssim_inside"], said["file_bytes"], build, said["per_view"])  # fmt: skip

    def cameras(self, name, *options):
        """A file of cameras in a folder of its own. Returns its path, and whether it is new."""
        path = self.folder / name / "transforms.json"
        if path.exists():
            return path, False
        path.parent.mkdir(exist_ok=True)
        self.slf("cameras", *options, "-o", path)
        return path, True

    def once(self, folder, work):
        """Does work for a folder, unless it was done before."""
        done = folder / "done"
        if not done.exists():
            work()
            done.touch()


# ---- brain ---------------------------------------------------------------------------------


def brain(tools):
    """The field that is ray-cast directly first, then those from pictures of it."""
    if not BRAIN.exists():
        raise Missing("mricron-data is not installed")
    size, counts, shape = (
        (160, (50, 100), "--entry 4 --exit 20 --levels 1")
        if tools.quick
        else (512, (50, 100, 200, 400), "--entry 4 --exit 48 --levels 1")
    )
    volume = [BRAIN, "--transfer", ROOT / "scripts/data/brain.json", "--light-file",
              tools.folder / "brain.light"]  # fmt: skip

    def draw(count):
        """Pictures of the volume from this many directions."""
        file, _ = tools.cameras(f"brain_{count}_cameras", *volume[:3], "--count", count, "--size",
                                size, "--distance", 2.5)  # fmt: skip
        folder = tools.folder / f"brain_{count}"
        if not (folder / "transforms.json").exists():
            tools.slf("raycast", *volume, "--cameras", file, "-o", folder, "-f", "-q")
        return folder / "transforms.json"

    # 23 directions are none of those of the other numbers.
    test = draw(23)
    yield tools.row("ray-cast directly", "brain_direct", volume, shape, test)
    for count in counts:
        # All pictures fit, so none is decoded twice.
        source = [f"pictures:{draw(count)}", "--picture-memory", "3GiB"]
        yield tools.row(f"{count} pictures", f"brain_from_{count}", source, shape, test)


# ---- other renderers -----------------------------------------------------------------------


def vtk(tools):
    if not BRAIN.exists():
        raise Missing("mricron-data is not installed")
    python = "/usr/bin/python3"
    if not pathlib.Path(python).exists() or subprocess.run(
        [python, "-c", "import vtk"], stderr=subprocess.DEVNULL
    ).returncode:
        raise Missing("python3-vtk9 is not installed")
    if not os.environ.get("DISPLAY") and not shutil.which("xvfb-run"):
        raise Missing("there is no display, and xvfb is not installed")
    display = [] if os.environ.get("DISPLAY") else ["xvfb-run", "-a"]
    # VTK places the first voxel at 0, so the world is another than slf's.
    info = json.loads(tools.slf("info", BRAIN, "--json").output)
    middle = [(n - 1) * s / 2 for n, s in zip(info["dims"], info["spacing"])]
    sphere = ",".join(map(str, [*middle, max(middle)]))
    count, size, shape = (
        (60, 192, "--entry 4 --exit 24 --levels 1 --voxels 96")
        if tools.quick
        else (200, 384, "--entry 8 --exit 48 --levels 1")
    )
    file, _ = tools.cameras("vtk", "--sphere", sphere, "--count", count, "--test", 10, "--size",
                            size)  # fmt: skip
    test = file.with_name("transforms_test.json")

    def draw():
        for cameras in (file, test):
            tools.run(*display, python, RENDERERS / "vtk_render.py", cameras, BRAIN)

    tools.once(file.parent, draw)
    yield tools.row(f"{count} pictures by VTK, of the brain", "from_vtk", [f"pictures:{file}"],
                    shape, test)  # fmt: skip


def cycles(tools):
    if not shutil.which("blender"):
        raise Missing("blender is not installed")
    mesh = knot_with_texture(tools)
    count, size, shape = (
        (40, 128, "--entry 4 --exit 24 --levels 1 --voxels 96")
        if tools.quick
        else (100, 256, "--entry 12 --exit 32 --levels 1")
    )
    file, _ = tools.cameras("cycles", mesh, "--count", count, "--test", 10, "--size", size)
    test = file.with_name("transforms_test.json")

    def draw():
        # Noise of the new views would count as an error of the field.
        for cameras, paths in ((file, 16), (test, 32)) if tools.quick else ((file, 32), (test, 128)):
            tools.run("blender", "-b", "--python-exit-code", 1, "--python",
                      RENDERERS / "blender_render.py", "--", cameras, mesh, paths)  # fmt: skip

    tools.once(file.parent, draw)
    yield tools.row(f"{count} pictures by Cycles, of a mesh", "from_cycles", [f"pictures:{file}"],
                    shape, test)  # fmt: skip


# ---- sets that were handed over ------------------------------------------------------------

SHAPES = {"chair": "--entry 8 --exit 128 --levels 1", "mouse": "--entry 4 --exit 32 --levels 1"}


def sets(tools, chosen=()):
    """The chair and the mouse, or (source, test) of others."""
    chair, mouse = tools.data / "chair_pictures", tools.data / "mouse_photos"
    if not chosen and not chair.exists() and not mouse.exists():
        raise Missing(f"neither {chair} nor {mouse} is there")
    for source, test in chosen:
        name = pathlib.Path(source).stem
        yield _set(tools, name, name, source, SHAPES["chair"], test)
    if not chosen and chair.exists():
        yield _set(tools, "chair, 100 pictures with alpha", "chair",
                   chair / "transforms_train.json", SHAPES["chair"],
                   chair / "transforms_test.json")  # fmt: skip
    if not chosen and mouse.exists():
        for kept in ("keep",) if tools.quick else ("drop", "keep"):
            yield _set(tools, f"mouse, 49 photographs, background: {kept}", f"mouse_{kept}", mouse,
                       SHAPES["mouse"], None, "--background-model", kept)  # fmt: skip


def _set(tools, title, name, source, shape, test, *options):
    # Depths are estimated once for all builds of a set, beside the fields.
    depths = tools.folder / f"{pathlib.Path(source).stem}.depths"
    if tools.quick:
        shape = "--entry 4 --exit 24 --levels 1 --voxels 80"
    holdout = [] if test else ["--holdout", 8]
    return tools.row(title, name, [f"pictures:{source}", *holdout, *options, "--depth-cache", depths],
                     shape, test or source)  # fmt: skip


# ---- meshes --------------------------------------------------------------------------------


def _knot(around, along):
    """A knotted tube with bumps: points (along, around, 3), texture coordinates, triangles."""
    import numpy as np

    u = np.linspace(0, 2 * np.pi, along, endpoint=False)[:, None]
    v = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]

    def core(t):
        ring = 2 + np.cos(3 * t)
        return np.stack([ring * np.cos(2 * t), ring * np.sin(2 * t), np.sin(3 * t)], -1)

    tangent = core(u + 1e-3) - core(u - 1e-3)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = np.cross(tangent, [0, 0, 1.0])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(side, tangent)
    radius = 0.5 * (1 + 0.06 * np.sin(24 * u) * np.sin(5 * v))
    points = core(u) + radius[..., None] * (np.cos(v)[..., None] * side + np.sin(v)[..., None] * up)
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    corner = lambda a, b: (i + a) % along * around + (j + b) % around  # noqa: E731
    triangles = np.stack([np.stack([corner(0, 0), corner(1, 0), corner(1, 1)], -1),
                          np.stack([corner(0, 0), corner(1, 1), corner(0, 1)], -1)], 2)  # fmt: skip
    return points.reshape(-1, 3).astype("<f4"), triangles.reshape(-1, 3).astype("<i4")


def _has_numpy():
    try:
        import numpy  # noqa: F401
    except ImportError:
        raise Missing("this Python has no NumPy") from None


def knot_with_texture(tools):
    """An OBJ whose texture has blobs of all sizes."""
    _has_numpy()
    import numpy as np

    path = tools.folder / "knot.obj"
    if path.exists():
        return path
    around, along = 48, 600
    points, triangles = _knot(around, along)
    # A second time, because the last cells end where the first begin.
    s, t = np.meshgrid(np.arange(along + 1) / along, np.arange(around + 1) / around, indexing="ij")
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    place = lambda a, b: (i + a) * (around + 1) + j + b  # noqa: E731
    texture = np.stack([np.stack([place(0, 0), place(1, 0), place(1, 1)], -1),
                        np.stack([place(0, 0), place(1, 1), place(0, 1)], -1)], 2)  # fmt: skip
    lines = ["mtllib knot.mtl", "usemtl knot"]
    lines += ["v %.6g %.6g %.6g" % tuple(p) for p in points]
    lines += ["vt %.6g %.6g" % p for p in zip(s.ravel(), t.ravel())]
    lines += ["f %d/%d %d/%d %d/%d" % tuple(np.stack([f, x], 1).ravel() + 1)
              for f, x in zip(triangles, texture.reshape(-1, 3))]  # fmt: skip
    random = np.random.default_rng(1)
    width, height = 1024, 128
    x, y = np.arange(width) / width, np.arange(height)[:, None] / height
    color = np.full((height, width, 3), 0.5)
    for _ in range(60):
        # The finest waves are several pixels long in the pictures.
        a, b = random.integers(1, 48), random.integers(0, 6)
        wave = np.sin(2 * np.pi * (a * x + b * y + random.random()))
        color += wave[..., None] * random.normal(size=3) / (8 + a)
    from PIL import Image

    Image.fromarray((np.clip(color, 0.1, 0.9) * 255).astype("u1")).save(tools.folder / "knot.png")
    (tools.folder / "knot.mtl").write_text("newmtl knot\nKd 1 1 1\nKs 0 0 0\nillum 1\n"
                                           "map_Kd knot.png\n")  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def _write_ply(path, points, triangles):
    import numpy as np

    faces = np.empty(len(triangles), np.dtype([("corners", "u1"), ("points", "<i4", 3)]))
    faces["corners"], faces["points"] = 3, triangles
    with open(path, "wb") as file:
        file.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"element face {len(triangles)}\nproperty list uchar int vertex_indices\n"
            "end_header\n".encode()
        )
        points.tofile(file)
        faces.tofile(file)


def mesh(tools):
    """Yields one dictionary."""
    _has_numpy()
    # The bumps stay as they are; only triangles become smaller.
    size = {name: (200, 1000) if tools.quick or name == "small" else (1000, 5000)
            for name in ("small", "large")}  # fmt: skip
    path = {name: tools.folder / f"knot_{a}x{b}.ply" for name, (a, b) in size.items()}
    for name, file in path.items():
        if not file.exists():
            _write_ply(file, *_knot(*size[name]))
    shape = "--entry 4 --exit 16 --levels 1 --lighting direct".split()
    fields = [tools.folder / f"mesh_{threads}_threads.slf" for threads in (1, 2, 5)]
    for threads, field in zip((1, 2, 5), fields):
        tools.slf("build", path["small"], *shape, "-j", threads, "-o", field, "-f", "-q")
    equal = True
    for other in fields[1:]:
        try:
            tools.slf("diff", fields[0], other)
        except Failed:
            equal = False
    build = tools.slf("build", path["large"], *shape, "-o", tools.folder / "mesh.slf", "-f", "-q",
                      measured=True)  # fmt: skip

    def rate(*source):
        """Rays a second of processor time. Loading is in the smaller picture, too."""
        small, large = 512, 2048
        first, second = (
            tools.slf("raycast", *source, "--lighting", "direct", "-j", 1, "--size", size, "-f",
                      "-o", tools.folder / "rate.png").processor
            for size in (small, large)
        )  # fmt: skip
        return (large**2 - small**2) / (second - first)

    truth = json.loads(tools.slf("evaluate", fields[0], "--volume", path["small"], "--views", 4,
                                 "--json").output)  # fmt: skip
    yield {
        "triangles": 2 * size["large"][0] * size["large"][1],
        "memory": build.memory,
        "equal": equal,
        "psnr": truth["psnr"],
        "mesh rays": rate(path["large"]),
        "volume rays": rate(BRAIN, "--transfer", ROOT / "scripts/data/brain.json")
        if BRAIN.exists()
        else None,
    }


# ---- printing ------------------------------------------------------------------------------

HEAD = ["field", "PSNR", "SSIM", "inside the sphere", "size", "memory of the build"]


def cells(row):
    return [row.title, f"{row.psnr:.2f} dB", f"{row.ssim:.4f}",
            f"{row.psnr_inside:.2f} dB, {row.ssim_inside:.4f}",
            f"{row.size / MIB:.1f} MiB", f"{row.build.memory:,.0f} MiB"]  # fmt: skip


def mesh_cells(found):
    rays = lambda r: f"{r / 1e6:.2f} M" if r else "not measured"  # noqa: E731
    return [
        ["triangles", f"{found['triangles']:,}"],
        ["memory of the build, with the process that reads", f"{found['memory']:,.0f} MiB"],
        ["fields of a smaller one by 1, 2 and 5 threads", "equal" if found["equal"] else "NOT equal"],
        ["its field (8/32 cells) beside direct trace", f"{found['psnr']:.2f} dB"],
        ["rays a second of processor time, mesh", rays(found["mesh rays"])],
        ["the same, brain volume", rays(found["volume rays"])],
    ]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slf", required=True)
    parser.add_argument("--folder", default="out/pictures")
    parser.add_argument("--data", default=ROOT / "../shared/data")
    parser.add_argument("--parts", default=",".join(PARTS))
    parser.add_argument("--quick", action="store_true", help="smaller: minutes, not hours")
    parser.add_argument("sets", nargs="*", metavar="SET[:TEST]")
    a = parser.parse_args()
    tools = Tools(a.slf, a.folder, a.data, a.quick)
    chosen = [(source, test or None) for source, _, test in (s.partition(":") for s in a.sets)]
    work = {"brain": brain, "vtk": vtk, "cycles": cycles, "mesh": mesh,
            "sets": lambda tools: sets(tools, chosen)}  # fmt: skip
    line = lambda words: print("| " + " | ".join(words) + " |", flush=True)  # noqa: E731
    headed = False
    for part in a.parts.split(","):
        if part not in work:
            parser.error(f"no part {part}; there are: {', '.join(PARTS)}")
        try:
            for found in work[part](tools):
                if part == "mesh":
                    line(["", "mesh"]), line(["---"] * 2)
                    for row in mesh_cells(found):
                        line(row)
                    continue
                if not headed:
                    line(HEAD), line(["---"] * len(HEAD))
                    headed = True
                line(cells(found))
        except Missing as missing:
            print(f"{part} left out: {missing}", file=sys.stderr)


if __name__ == "__main__":
    main()
