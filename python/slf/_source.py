"""What fields are built from: arrays and images of other packages as volumes, and scenes."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import mmap
import os
import tempfile
from typing import (Any, Callable, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional,
                    Sequence, Tuple, Union)

import numpy as np

from . import _slf
from ._rays import Scene, ray_scene
from ._types import Point, Tone, finite, point

log = logging.getLogger("slf")

_OF_FILES = ("component", "time", "array", "series", "resample")
"""Settings that say which part of a file to read."""

_SCENE = "scene:"


# ---- positions -----------------------------------------------------------------------------------


class _Place(NamedTuple):
    """World position (LPS) of voxel (i, j, k): origin + i·axes[0] + j·axes[1] + k·axes[2]."""

    origin: np.ndarray
    axes: np.ndarray


def _place(origin: Any, axes: Any) -> _Place:
    finite("position", origin)
    finite("axes", axes)
    # + 0.0: no -0, so that equal places have equal bytes.
    return _Place(np.asarray(origin, float).reshape(3) + 0.0,
                  np.asarray(axes, float).reshape(3, 3) + 0.0)


def _affine_place(affine: Any) -> _Place:
    matrix = np.asarray(affine, float)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError(f"affine has the shape {matrix.shape}, expected a finite 4×4 matrix")
    return _place(matrix[:3, 3], matrix[:3, :3].T)


# ---- arrays and images ---------------------------------------------------------------------------


class _Voxels(NamedTuple):
    array: Any
    """[z, y, x], perhaps not in memory."""
    place: _Place
    slope: float = 1.0
    intercept: float = 0.0
    source: str = "array"


def _from_nibabel(image: Any) -> _Voxels:
    data = image.dataobj
    slope, intercept = 1.0, 0.0
    if hasattr(data, "get_unscaled"):  # as stored in the file, with its scale
        slope, intercept = float(data.slope), float(data.inter)
        data = data.get_unscaled()
    data = np.asanyarray(data)
    if data.ndim > 3 and set(data.shape[3:]) == {1}:
        data = data.reshape(data.shape[:3], order="A")
    to_mm = 1.0
    with contextlib.suppress(AttributeError):
        to_mm = {"meter": 1e3, "micron": 1e-3}.get(image.header.get_xyzt_units()[0], 1.0)
    place = _affine_place(image.affine)
    to_lps = np.array([-1, -1, 1])
    name = getattr(image, "get_filename", lambda: None)()
    return _Voxels(data.T, _place(place.origin * to_lps * to_mm, place.axes * to_lps * to_mm),
                   slope, intercept, os.fspath(name) if name else "image")


def _from_itk(image: Any) -> _Voxels:
    if type(image).__module__.startswith("SimpleITK"):
        import SimpleITK  # type: ignore[import]
        data = SimpleITK.GetArrayViewFromImage(image)
    else:
        data = np.asarray(image)
    spacing = np.asarray(tuple(image.GetSpacing()), float)
    direction = np.asarray(image.GetDirection(), float).reshape(3, 3)  # columns are the axes
    return _Voxels(data, _place(tuple(image.GetOrigin()), (direction * spacing).T),
                   source="image")


def _from_xarray(array: Any) -> _Voxels:
    dims = [str(d) for d in array.dims]
    named = {name.lower(): name for name in dims}
    if {"x", "y", "z"} <= set(named):
        dims = [named["z"], named["y"], named["x"]]
        array = array.transpose(*dims)
    if len(dims) != 3:
        raise ValueError(f"dims {tuple(array.dims)}: expected three, or z, y and x among singles")
    origin, spacing = [0.0] * 3, [1.0] * 3
    for axis, dim in enumerate(reversed(dims)):
        if dim not in array.coords:
            continue
        at = np.asarray(array.coords[dim], float)
        steps = np.diff(at)
        if len(at) < 2 or not np.allclose(steps, steps[0], rtol=1e-3, atol=0) or steps[0] == 0:
            raise ValueError(f"the coordinates of {dim} are not evenly spaced")
        origin[axis], spacing[axis] = at[0], (at[-1] - at[0]) / (len(at) - 1)
    return _Voxels(array.data, _place(origin, np.diag(spacing)),
                   source=str(array.name) if array.name else "array")


def _voxels(source: Any) -> _Voxels:
    if hasattr(source, "affine") and hasattr(source, "dataobj"):
        return _from_nibabel(source)
    if hasattr(source, "GetSpacing") and hasattr(source, "GetDirection"):
        return _from_itk(source)
    if hasattr(source, "dims") and hasattr(source, "coords"):
        return _from_xarray(source)
    name = getattr(source, "filename", None)  # of a numpy.memmap
    if not (isinstance(name, (str, os.PathLike))):
        name = "array"
    return _Voxels(source, _place(np.zeros(3), np.eye(3)), source=os.fspath(name))


def _type_for(dtype: np.dtype) -> np.dtype:
    """The type of voxels that holds values of a NumPy type."""
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    if dtype.kind in "iu" and dtype.itemsize <= 8:
        return dtype.newbyteorder("=")
    raise TypeError(f"voxels of type {dtype}: expected integers or floating-point numbers")


def _unmasked(array: Any, mask: Any) -> Tuple[Any, Any]:
    """A masked array without its mask, and a mask that also hides what that hid. Hidden voxels get
    the least value, so that the default transfer function does not see those beneath."""
    hidden = np.ma.getmaskarray(array)
    if isinstance(mask, (str, os.PathLike)) or hasattr(mask, "affine") or hasattr(mask, "dims"):
        raise ValueError("mask: the array is masked itself; fill it, or pass an array as the mask")
    shown = ~hidden if mask is None else ~hidden & (np.ma.filled(mask, 0) != 0)
    return array.filled(array.min() if array.count() > 0 else 0), shown


_MOST_IN_MEMORY = 256 << 20
"""Bytes of voxels; of arrays that are read in slabs."""


def _space(shape: Tuple[int, ...], dtype: np.dtype, folder: Optional[str],
           mapped: List[mmap.mmap]) -> np.ndarray:
    """Space for voxels. Large ones are in a file without a name, which the kernel can write back
    and drop from memory; its map is appended to `mapped`."""
    size = math.prod(shape) * dtype.itemsize
    if size <= _MOST_IN_MEMORY:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(dir=folder) as file:
        os.posix_fallocate(file.fileno(), 0, size)  # a full disk is an error here, not a signal
        mapped.append(mmap.mmap(file.fileno(), size))
    return np.frombuffer(mapped[-1], dtype).reshape(shape)


def _in_order(array: Any, folder: Optional[str], mapped: List[mmap.mmap]) -> np.ndarray:
    """The voxels in C order, in a type of volumes. A contiguous array is not copied; an array that
    is read on demand, as those of zarr and dask are, is read in slabs along z."""
    chunks = getattr(array, "chunks", None)
    if chunks is None or isinstance(array, np.ndarray):
        array = np.ma.filled(array, 0) if np.ma.isMaskedArray(array) else np.asarray(array)
        chunks = None
    if len(array.shape) != 3:
        raise ValueError(f"an array of shape {array.shape}: expected three axes, z, y and x")
    dtype = _type_for(np.dtype(array.dtype))
    if chunks is None:
        return np.require(array, dtype, ["C", "A"])
    out = _space(array.shape, dtype, folder, mapped)
    depth = chunks[0] if isinstance(chunks[0], int) else max(chunks[0])
    for z in range(0, array.shape[0], depth):
        part = slice(z, min(z + depth, array.shape[0]))
        values = np.asanyarray(array[part])
        if np.ma.is_masked(values):
            raise ValueError("masked voxels in an array that is read in slabs: fill them, and "
                             "pass the mask as mask=")
        out[part] = values
    return out


def volume_of(source: Any, *, labels: bool = False, spacing: Optional[Sequence[float]] = None,
              affine: Any = None, origin: Optional[Sequence[float]] = None,
              name: Optional[str] = None, like: Optional[_Place] = None,
              folder: Optional[str] = None, reader: Optional[Mapping[str, Any]] = None,
              mapped: List[mmap.mmap]) -> Tuple[_slf.Volume, Optional[_Place]]:
    """A volume from an array, an image or a file; and its place, if it is no file. Maps of files
    that hold voxels are appended to `mapped`."""
    if isinstance(source, (str, os.PathLike)):
        if affine is not None or origin is not None:
            raise ValueError("affine and origin are for arrays; files state their position")
        options: Dict[str, Any] = {**dict.fromkeys(_OF_FILES), "resample": False, **(reader or {})}
        volume = _slf.read_volume(os.fspath(source), labels,
                                  None if spacing is None else tuple(map(float, spacing)),
                                  **options)
        for note in volume.notes:
            log.info("%s: %s", volume.source, note)
        return volume, None
    if reader:
        raise ValueError(f"{', '.join(reader)}: for files only")
    voxels = _voxels(source)
    place = voxels.place
    if like is not None and voxels.source == "array":
        place = like
    if affine is not None:
        place = _affine_place(affine)
    if spacing is not None:
        lengths = np.asarray(spacing, float)
        if lengths.shape != (3,) or not (np.isfinite(lengths) & (lengths > 0)).all():
            raise ValueError(f"spacing {spacing}: expected three positive numbers, dx, dy, dz")
        directions = place.axes / np.linalg.norm(place.axes, axis=1, keepdims=True)
        place = _place(place.origin, directions * lengths[:, None])
    if origin is not None:
        place = _place(origin, place.axes)
    if not abs(np.linalg.det(place.axes)) > 0:
        raise ValueError("the axes of the image are singular")
    finite("scale", (voxels.slope, voxels.intercept))
    array = _in_order(voxels.array, folder, mapped)
    path = name or voxels.source
    volume = _slf.Volume(array, tuple(place.origin), [tuple(axis) for axis in place.axes],
                         voxels.slope, voxels.intercept, labels, path,
                         [voxels.source] if os.path.exists(voxels.source) else [])
    return volume, place


# ---- transfer functions --------------------------------------------------------------------------


def _transfer(transfer: Any, volume: _slf.Volume) -> Tuple[str, str]:
    """A transfer function as a reference, or as JSON."""
    if transfer is None:
        return "", ""
    if isinstance(transfer, (str, os.PathLike)):
        return os.fspath(transfer), ""
    if callable(transfer):
        low, high = volume.value_range
        values = np.linspace(low, high, 256)
        points = np.column_stack([values, np.asarray(transfer(values), float)])
    else:
        points = np.asarray(transfer, float)
    if points.ndim != 2 or points.shape[1] != 5 or not np.isfinite(points).all():
        raise ValueError(f"transfer has the shape {points.shape}, expected finite rows of value, "
                         "red, green, blue and opacity (a function: of the last four)")
    opacity = np.column_stack([points[:, [0, 4]], np.full(len(points), 0.5),
                               np.zeros(len(points))])
    return "", json.dumps({"Name": "array", "ColorSpace": "RGB",
                           "RGBPoints": points[:, :4].ravel().tolist(),
                           "Points": opacity.ravel().tolist(),
                           "ScalarOpacityUnitDistance": min(volume.spacing)})


# ---- scenes --------------------------------------------------------------------------------------

_LIGHTS = ("direct", "shadowed", "global")
_PROJECTIONS = {None: "none", "mip": "mip", "minip": "minip", "mean": "mean"}
Labels = Union[None, bool, Any]


@contextlib.contextmanager
def scene_of(source: Any, *, linear: bool = False, folder: Optional[str] = None, threads: int = 0,
             **settings: Any) -> Iterator[_slf.Scene]:
    """The scene of a source. folder: for temporary files.  settings: those of volumes."""
    is_analytic = isinstance(source, str) and source.startswith(_SCENE)
    if not is_analytic and not isinstance(source, Scene):
        yield _volume_scene(source, linear=linear, folder=folder, threads=threads, **settings)
        return
    if settings:
        raise TypeError(f"unexpected settings, as this is no volume: {', '.join(sorted(settings))}")
    if is_analytic:
        yield _slf.analytic_scene(source[len(_SCENE):])
        return
    with ray_scene(source) as scene:
        yield scene


def _volume_scene(source: Any, *, linear: bool, folder: Optional[str], threads: int,
                  spacing: Optional[Sequence[float]] = None, affine: Any = None,
                  origin: Optional[Sequence[float]] = None, name: Optional[str] = None,
                  transfer: Any = None, range: Optional[Sequence[float]] = None,
                  labels: Labels = None, label_table: Any = None, mask: Any = None,
                  light: Optional[str] = None, light_rig: str = "", environment: str = "",
                  environment_gain: float = 1, light_samples: int = 16, light_bounces: int = 32,
                  light_spacing: float = 2, light_memory: int = 1 << 30, light_seed: int = 1,
                  light_file: str = "", tone: Optional[Tone] = None, shade: bool = True,
                  light_direction: Sequence[float] = (-0.45, -0.65, 0.6),
                  ambient: Optional[float] = None, projection: Optional[str] = None,
                  step: float = 2, clip: Iterable[Sequence[float]] = (),
                  **reader: Any) -> _slf.Scene:
    unknown = sorted(set(reader) - set(_OF_FILES))
    if unknown:
        raise TypeError(f"unexpected settings: {', '.join(unknown)}")
    if light is None:
        light = "global" if shade and ambient is None and projection is None else "direct"
    if light not in _LIGHTS:
        raise ValueError(f"light {light!r}: expected one of {', '.join(_LIGHTS)}")
    if projection not in _PROJECTIONS:
        raise ValueError(f"projection {projection!r}: expected mip, minip, mean or None")
    is_labels = isinstance(labels, (bool, np.bool_)) and bool(labels)
    if np.ma.is_masked(source) and not is_labels:
        source, mask = _unmasked(source, mask)
    mapped: List[mmap.mmap] = []
    volume, place = volume_of(source, labels=is_labels, spacing=spacing, affine=affine,
                              origin=origin, name=name, folder=folder, reader=reader,
                              mapped=mapped)
    if not is_labels and volume.looks_like_labels():
        log.warning("%s: its values look like ids; labels=True shows them unblended",
                    volume.source)
    parts: List[Optional[_slf.Volume]] = []
    for part, what in ((None if isinstance(labels, bool) else labels, "labels"), (mask, "mask")):
        parts.append(None if part is None else
                     volume_of(part, labels=True, like=place, folder=folder, mapped=mapped,
                               name=None if isinstance(part, (str, os.PathLike)) else what)[0])
    shown = tone or Tone()
    planes = np.asarray([[float(x) for x in plane] for plane in clip]).reshape(-1, 6)
    for what, value in (("step", step), ("ambient", ambient or 0), ("range", range or ()),
                        ("light_direction", light_direction), ("light_samples", light_samples),
                        ("light_bounces", light_bounces), ("light_spacing", light_spacing),
                        ("light_memory", light_memory), ("light_seed", light_seed),
                        ("clip", planes), ("environment_gain", environment_gain), ("exposure", shown.exposure)):
        finite(what, value)
    settings = {
        "step": float(step), "ambient": 0.3 if ambient is None else float(ambient),
        "shade": shade and projection is None, "projection": _PROJECTIONS[projection],
        "light": [float(x) for x in light_direction], "clip": planes.tolist(),
        "lighting": {
            "mode": light, "samples": light_samples, "bounces": light_bounces,
            "spacing": float(light_spacing), "memory": light_memory, "seed": light_seed,
            "environment_gain": float(environment_gain), "linear": linear,
            "tone": {"exposure": float(shown.exposure), "curve": shown.curve}}}
    reference, points = _transfer(transfer, volume)
    table, styles = "", None
    if isinstance(label_table, Mapping):
        styles = {int(id): _style(style) for id, style in label_table.items()}
    elif label_table is not None:
        table = os.fspath(label_table)
    scene = _slf.raycaster(volume, json.dumps(settings), reference, points,
                           None if range is None else (float(range[0]), float(range[1])),
                           light_rig, os.fspath(environment), parts[0], table, styles, parts[1],
                           os.fspath(light_file), threads)
    for file in mapped:  # rays jump from page to page: reading ahead would be in vain
        file.madvise(mmap.MADV_RANDOM)
    return scene


def _style(style: Any) -> Tuple[str, Optional[Point], float]:
    """A name, or (name, color, opacity), of which the last two may be missing."""
    given = (style,) if isinstance(style, str) else tuple(style)
    name, color, opacity = given + (None, 1.0)[len(given) - 1:]
    finite(f"the style of {name!r}:", [opacity, *(() if color is None else color)])
    return name, None if color is None else point(color), float(opacity)
