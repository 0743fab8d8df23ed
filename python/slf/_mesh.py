"""Meshes of trimesh and pyvista, and what has their attributes, as PLY files."""

from __future__ import annotations

import contextlib
import itertools
import pathlib
import tempfile
from typing import Any

import numpy as np

from ._errors import UsageError


def on_disk(source: Any, name: str | None, stack: contextlib.ExitStack) -> Any:
    """A source as it is, or the file of a mesh, until `stack` is closed."""
    if hasattr(source, "vertices") and hasattr(source, "faces"):
        parts = _of_trimesh(source)
    elif hasattr(source, "points") and hasattr(source, "point_data"):
        parts = _of_pyvista(source)
    else:
        return source
    folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="slf-mesh-")))
    file = folder / pathlib.Path(name or "mesh").with_suffix(".ply").name
    file.write_bytes(_ply(folder, *parts))
    return file


def _of_trimesh(mesh: Any) -> tuple[Any, ...]:
    """Points, faces as pyvista has them, colours of points and of faces, places and a texture."""
    visual: Any = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    places = picture = None
    if kind == "texture" and getattr(visual, "uv", None) is not None:
        material = visual.material  # simple, or of glTF
        picture = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        places = visual.uv
    triangles = np.asarray(mesh.faces)
    return (mesh.vertices, np.insert(triangles, 0, triangles.shape[1], axis=1),
            visual.vertex_colors if kind == "vertex" else None,
            visual.face_colors if kind == "face" else None, places, picture)


def _of_pyvista(mesh: Any) -> tuple[Any, ...]:
    faces = getattr(mesh, "faces", None)
    if faces is None or len(faces) == 0:
        raise UsageError("a mesh without faces: expected a surface; extract_surface() makes one")
    colors = [array for array in map(np.asarray, mesh.point_data.values())
              if array.dtype == np.uint8 and array.shape[1:] in ((3,), (4,))]
    return mesh.points, faces, colors[0] if colors else None, None, None, None


def _ply(folder: pathlib.Path, points: Any, faces: Any, colors: Any, tints: Any, places: Any,
         picture: Any) -> bytes:
    faces = np.asarray(faces, "<i4")
    vertex, comments = dict(zip("xyz", np.asarray(points, float).T)), []
    names: tuple[str, ...] = ("red", "green", "blue", "alpha")
    if colors is not None:  # as fractions: 1 of 255 would else be 1
        vertex |= dict(zip(names, np.asarray(colors, np.uint8).T / 255))
    names = () if tints is None else names[:np.shape(tints)[1]]
    if names:
        fractions = (np.asarray(tints, np.uint8) / 255).astype("<f4")
        faces = np.hstack([faces, fractions.view("<i4")])
    if picture is not None:
        vertex |= dict(zip("st", np.asarray(places, float).T))
        picture.save(folder / "texture.png")
        comments = ["comment TextureFile texture.png"]
    count = len(faces) if faces.ndim == 2 else _count(faces)
    head = ["ply", "format binary_little_endian 1.0", *comments, f"element vertex {len(points)}",
            *(f"property double {name}" for name in vertex), f"element face {count}",
            "property list int int vertex_indices", *(f"property float {name}" for name in names),
            "end_header\n"]
    return b"".join(["\n".join(head).encode(),
                     np.column_stack(list(vertex.values())).astype("<f8").tobytes(),
                     faces.tobytes()])


def _count(faces: np.ndarray) -> int:
    """How many faces there are in a list of corners that follow their number."""
    numbers, count = iter(faces.tolist()), 0
    while corners := next(numbers, 0):
        tuple(itertools.islice(numbers, corners))
        count += 1
    return count
