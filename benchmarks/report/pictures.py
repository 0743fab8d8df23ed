"""Fields from pictures by any renderer, from photographs and from meshes."""

import json
import math
import struct
from pathlib import Path

import numpy as np
import pictures_quality as quality
from PIL import Image

from . import page
from .bench import Failed
from .outcome import PARTLY

TITLE = "Fields from pictures and meshes"
MOST_LOSS = 2  # dB, of pictures of the brain beside the brain itself
LEAST_RENDERER, LEAST_CHAIR, AIM_CHAIR = 30, 27, 28.8  # dB
MOST_CHAIR_SECONDS, MOST_CHAIR_GIB, MOST_MESH_GIB = 1800, 4, 2
WRONG = {
    "chair": "Fringes and blurred patterns are the worst: no picture is taken from below the seat, "
    "smooth surfaces have no pattern to match, and there the silhouettes, which are too large, "
    "stand for the surface.",
    "mouse": "Specks and blur are where the surface is smooth or shines, so that depths are missing "
    "or wrong, and the fitted sphere cuts the mouse's end: outside it, nothing is in the field.",
}


def run(bench, part):
    folder = bench.fields / "pictures"
    tools = quality.Tools(bench.program("slf") or "slf", folder, bench.data, bench.quick,
                          lambda words: _note(bench, words))  # fmt: skip
    rows = {}
    for name in ("brain", "vtk", "cycles", "sets"):
        rows[name] = list(_found(bench, part, tools, name))
    meshes = list(_found(bench, part, tools, "mesh"))
    _show(part, [row for of in rows.values() for row in of])
    if rows["brain"]:
        _claim_brain(part, rows["brain"])
    if not bench.quick:
        _claim_views(part, rows)
    for row in rows["sets"]:
        _compare(bench, part, row)
    for found in meshes:
        _claim_mesh(bench, part, found)


def _note(bench, words):
    slf = bench.program("slf")
    bench.commands.append(bench.shown(["slf" if w == str(slf) else w for w in words]))


def _found(bench, part, tools, name):
    """What a part of the benchmark yields. What it lacks is noted."""
    bench.say(f"measuring {name}")
    try:
        yield from getattr(quality, name)(tools)
    except quality.Missing as missing:
        part.left_out.append(f"{name}: {missing}")
    except quality.Failed as failed:
        raise Failed(str(failed)) from failed


def _show(part, rows):
    part.numbers["fields"] = [
        {"title": r.title, "psnr": r.psnr, "ssim": r.ssim,
         "psnr_inside": r.psnr_inside, "ssim_inside": r.ssim_inside,
         "bytes": r.size, "build_seconds": r.build.seconds, "build_mib": r.build.memory}
        for r in rows
    ]  # fmt: skip
    part.add(
        page.table(
            quality.HEAD,
            [quality.cells(row) for row in rows],
            "Views from the field beside pictures that it was not built from: of the brain by our "
            "ray-caster, else by the same renderer or camera. The first row is a field without a "
            "detour by way of pictures.",
        )
    )


def _claim_brain(part, rows):
    direct, last = rows[0], rows[-1]
    part.claim(
        "slf",
        f"A field from {last.title} of a volume is within {MOST_LOSS} dB of the field that is "
        "ray-cast directly",
        f"{last.psnr:.2f} and {direct.psnr:.2f} dB",
        last.psnr > direct.psnr - MOST_LOSS,
    )


def _claim_views(part, rows):
    for name, renderer in (("vtk", "VTK"), ("cycles", "Cycles")):
        for row in rows[name]:
            part.claim(
                "slf",
                f"A field from {row.title} has {LEAST_RENDERER} dB to new views by {renderer}",
                f"{row.psnr:.2f} dB",
                row.psnr >= LEAST_RENDERER,
            )
    for row in rows["sets"]:
        if not row.title.startswith("chair"):
            continue
        good = row.psnr >= LEAST_CHAIR
        good &= row.build.memory <= 1024 * MOST_CHAIR_GIB
        good &= row.build.seconds <= MOST_CHAIR_SECONDS
        part.claim(
            "slf",
            f"The chair's test views have {AIM_CHAIR} dB, at least {LEAST_CHAIR}, after "
            f"{MOST_CHAIR_SECONDS // 60} minutes and with {MOST_CHAIR_GIB} GiB at most",
            f"{row.psnr:.2f} dB, {row.build.seconds / 60:.0f} minutes, {row.build.memory:,.0f} MiB",
            True if good and row.psnr >= AIM_CHAIR else PARTLY if good else False,
        )


def _claim_mesh(bench, part, found):
    part.numbers["mesh"] = found
    part.add(page.heading("A mesh"), page.table(["", "mesh"], quality.mesh_cells(found)))
    part.claim("slf", "Any number of threads builds the same field of a mesh",
               "equal" if found["equal"] else "not equal", found["equal"])  # fmt: skip
    if not bench.quick:
        part.claim(
            "slf",
            f"A mesh of 10 million triangles needs at most {MOST_MESH_GIB} GiB",
            f"{found['triangles']:,} triangles, {found['memory']:,.0f} MiB",
            found["memory"] <= 1024 * MOST_MESH_GIB,
        )


# ---- pictures side by side -----------------------------------------------------------------


def _compare(bench, part, row):
    """The truth and the field, from the cameras of the middle and of the worst picture."""
    kind = row.title.split(",")[0]
    views = sorted(row.views, key=lambda view: view["psnr_inside"])
    cells = []
    for what, view in (("middle", views[len(views) // 2]), ("worst", views[0])):
        truth, camera = _truth(bench, kind, view["picture"])
        path = bench.work / f"{row.field.stem}-{what}"
        truth.save(path.with_suffix(".truth.png"))
        bench.run("slf", "render", row.field, "-o", path.with_suffix(".png"), "-f", "--size",
                  f"{truth.width}x{truth.height}", *camera)  # fmt: skip
        inside = f"{view['psnr_inside']:.1f} dB, SSIM {view['ssim_inside']:.2f} inside"
        cells.append([
            page.Cell(path.with_suffix(".truth.png"), f"{what} of {len(views)}", "picture"),
            page.Cell(path.with_suffix(".png"), inside, "field"),
        ])  # fmt: skip
    part.add(page.heading(row.title), page.grid([[*cells[0], *cells[1]]]))
    part.add(page.text(WRONG.get(kind, "")))


def _truth(bench, kind, name):
    """A picture over black, made smaller, and its camera as options of slf render."""
    folder = bench.data / {"chair": "chair_pictures", "mouse": "mouse_photos"}[kind]
    if kind == "chair":
        file = folder / (name if name.endswith(".png") else name + ".png")
        camera = _camera_of_transforms(folder / "transforms_test.json", name)
    else:
        file = folder / "images" / name
        camera = _camera_of_model(folder / "sparse/0", name)
    picture = Image.open(file).convert("RGBA")
    matrix, tangent = camera
    camera = [matrix[:, 3], matrix[:, 3] + matrix[:, 2], matrix[:, 1]]
    words = [",".join(f"{x:.9g}" for x in v) for v in camera]
    fov = math.degrees(2 * math.atan(tangent * picture.height / picture.width))
    black = Image.new("RGBA", picture.size, (0, 0, 0, 255))
    black.alpha_composite(picture)
    black.thumbnail((480, 480))
    return black.convert("RGB"), ["--eye", words[0], "--look-at", words[1], "--up", words[2],
                                  "--fov", fov]  # fmt: skip


def _camera_of_transforms(path, name):
    """Columns right, up, forward and eye; and the tangent of half the angle across."""
    file = json.loads(Path(path).read_text())
    frame = next(f for f in file["frames"] if f["file_path"] == name)
    matrix = np.array(frame["transform_matrix"], float)[:3]
    matrix[:, 2] *= -1
    return matrix, math.tan(file["camera_angle_x"] / 2)


def _camera_of_model(folder, name):
    """The same from COLMAP's binary files, with pinhole cameras."""
    data, at, lenses = (folder / "cameras.bin").read_bytes(), 8, {}
    while at < len(data):
        number, model, width, _ = struct.unpack_from("<iiQQ", data, at)
        if model != 1:
            raise Failed(f"{folder}: only pinhole cameras can be shown")
        lenses[number] = width / 2 / struct.unpack_from("<d", data, at + 24)[0]
        at += 24 + 4 * 8
    data, at = (folder / "images.bin").read_bytes(), 8
    while at < len(data):
        _, *pose, number = struct.unpack_from("<i7di", data, at)
        end = data.index(0, at + 64)
        if data[at + 64 : end].decode() == name:
            turn = _rotation(pose[:4]).T  # from camera to world, with y down
            matrix = np.column_stack([turn[:, 0], -turn[:, 1], turn[:, 2], -turn @ pose[4:]])
            return matrix, lenses[number]
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
    raise Failed(f"{folder}: no picture {name}")


def _rotation(q):
    w, x, y, z = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])  # fmt: skip
