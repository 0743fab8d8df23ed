"""What fields are built from: arrays and images of other packages as volumes, and scenes."""

from __future__ import annotations

import contextlib
import functools
import json
import math
import mmap
import os
import tempfile
import warnings
from typing import Any, Mapping, NamedTuple, Sequence

import numpy as np

from . import _settings, _slf
from ._errors import UsageError
from ._mesh import on_disk
from ._progress import ProgressFunction
from ._rays import Scene, ray_scene
from ._types import Tone, finite, point

_Path = str | os.PathLike[str]


class SourceSettings(_settings.DataOptions, total=False):
    """How to read a source, as keyword arguments of slf.build(), slf.raycast() and
    Field.evaluate(). None stands for the default. Where a file may be named, an array or an image
    may stand, too: for `labels` (then the parts of the volume, by their ids) and `mask` (0 hides
    voxels, as does the mask of a numpy.ma array; masked ids are 0).

    transfer may also be rows of (value, red, green, blue, opacity), or a function from values [n]
    to [n, 4] of these, each 0 to 1; opacity is per voxel. label_table may be
    {id: (name, (red, green, blue), opacity)}.
    """

    affine: Any
    """4×4, from the indices (x, y, z) of a voxel to world coordinates (LPS); arrays only."""
    origin: Sequence[float] | None
    """World position of the first voxel; arrays only."""
    name: str | None
    """What the manifest names as the source; default: the image's file, or "array"."""


class Settings(SourceSettings, _settings.ViewOptions, total=False):
    """What is seen of a source, beside how to read it: of slf.build() and slf.raycast()."""

    tone: Tone | None
    """exposure and tonemap."""


class BuildSettings(Settings, _settings.FieldOptions, total=False):
    """And the field: of slf.build()."""


_OF_FILES = ("component", "time", "array", "series", "resample", "crop", "dims")


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
        raise UsageError(f"affine has the shape {matrix.shape}, expected a finite 4×4 matrix")
    return _place(matrix[:3, 3], matrix[:3, :3].T)


# ---- arrays and images ---------------------------------------------------------------------------


class _Voxels(NamedTuple):
    array: Any
    """[z, y, x], perhaps not in memory."""
    place: _Place | None
    """None: not stated."""
    slope: float = 1.0
    intercept: float = 0.0
    source: str = "array"
    unit: str = ""
    patient_axes: bool = False
    """Whether it is stated that the world is LPS."""


def _from_nibabel(image: Any) -> _Voxels:
    data = image.dataobj
    slope, intercept = 1.0, 0.0
    if hasattr(data, "get_unscaled"):  # as stored in the file, with its scale
        slope, intercept = float(data.slope), float(data.inter)
        data = data.get_unscaled()
    data = np.asanyarray(data)
    if data.ndim > 3 and set(data.shape[3:]) == {1}:
        data = data.reshape(data.shape[:3], order="A")
    to_mm = None
    with contextlib.suppress(AttributeError):
        to_mm = {"meter": 1e3, "mm": 1.0, "micron": 1e-3}.get(image.header.get_xyzt_units()[0])
    scale = np.array([-1, -1, 1]) * (to_mm or 1.0)  # from RAS
    place = _affine_place(image.affine)
    name = getattr(image, "get_filename", lambda: None)()

    def states(code: str) -> bool:
        with contextlib.suppress(AttributeError, KeyError, ValueError, IndexError, TypeError):
            return int(image.header[code]) > 0
        return False

    placed = any(map(states, ("sform_code", "qform_code", "goodRASFlag")))
    return _Voxels(data.T, _place(place.origin * scale, place.axes * scale), slope, intercept,
                   os.fspath(name) if name else _file_of(data, "image"), "mm" if to_mm else "",
                   placed)


def _from_itk(image: Any) -> _Voxels:
    if type(image).__module__.startswith("SimpleITK"):
        import SimpleITK  # type: ignore[import]
        data = SimpleITK.GetArrayViewFromImage(image)
    else:
        data = np.asarray(image)
    spacing = np.asarray(tuple(image.GetSpacing()), float)
    direction = np.asarray(image.GetDirection(), float).reshape(3, 3)  # columns are the axes
    # What a reader of ITK keeps of NRRD, NIfTI and DICOM says whether the world is a patient's.
    kept: tuple[str, ...] = getattr(image, "GetMetaDataKeys", tuple)()
    return _Voxels(data, _place(tuple(image.GetOrigin()), (direction * spacing).T), source="image",
                   patient_axes=any(key in ("NRRD_space", "qform_code_name", "sform_code_name") or
                                    key.startswith("0020|") for key in kept))


def _from_xarray(array: Any) -> _Voxels:
    dims = [str(d) for d in array.dims]
    named = {name.lower(): name for name in dims}
    if {"x", "y", "z"} <= set(named):
        dims = [named["z"], named["y"], named["x"]]
        array = array.transpose(*dims)
    if len(dims) != 3:
        raise UsageError(f"dims {tuple(array.dims)}: expected three, or z, y and x among singles")
    origin, spacing = [0.0] * 3, [1.0] * 3
    for axis, dim in enumerate(reversed(dims)):
        if dim not in array.coords:
            continue
        at = np.asarray(array.coords[dim], float)
        steps = np.diff(at)
        if len(at) < 2 or not np.allclose(steps, steps[0], rtol=1e-3, atol=0) or steps[0] == 0:
            raise UsageError(f"the coordinates of {dim} are not evenly spaced")
        origin[axis], spacing[axis] = at[0], (at[-1] - at[0]) / (len(at) - 1)
    return _Voxels(array.data, _place(origin, np.diag(spacing)),
                   source=_file_of(array.data, str(array.name or "array")))


def _voxels(source: Any) -> _Voxels:
    if hasattr(source, "affine") and hasattr(source, "dataobj"):
        return _from_nibabel(source)
    if hasattr(source, "GetSpacing") and hasattr(source, "GetDirection"):
        return _from_itk(source)
    if hasattr(source, "dims") and hasattr(source, "coords"):
        return _from_xarray(source)
    return _Voxels(source, None, source=_file_of(source, "array"))


def _file_of(array: Any, otherwise: str) -> str:
    """The file of a numpy.memmap, or of what an array views: the field must not replace it."""
    while array is not None:
        if isinstance(name := getattr(array, "filename", None), (str, os.PathLike)):
            return os.fspath(name)
        array = getattr(array, "base", getattr(array, "obj", None))
    return otherwise


def _type_for(dtype: np.dtype) -> np.dtype:
    """The type of voxels that holds values of a NumPy type."""
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    if dtype.kind == "f":
        return np.dtype(np.float32 if dtype.itemsize <= 4 else np.float64)
    if dtype.kind in "iu" and dtype.itemsize <= 8:
        return dtype.newbyteorder("=")
    raise TypeError(f"voxels of type {dtype}: expected integers or floating-point numbers")


def _unmasked(array: Any, mask: Any) -> tuple[Any, Any]:
    """A masked array without its mask, and a mask that also hides what that hid. Hidden voxels get
    the least value, so that the default transfer function does not see those beneath."""
    hidden = np.ma.getmaskarray(array)
    if isinstance(mask, (str, os.PathLike)) or hasattr(mask, "affine") or hasattr(mask, "dims"):
        raise UsageError("mask: the array is masked itself; fill it, or pass an array as the mask")
    shown = ~hidden if mask is None else ~hidden & (np.ma.filled(mask, 0) != 0)
    return array.filled(array.min() if array.count() > 0 else 0), shown


_MOST_IN_MEMORY = 256 << 20
"""Bytes of voxels; of arrays that are read in slabs."""


def _space(shape: tuple[int, ...], dtype: np.dtype, folder: str | None,
           mapped: list[mmap.mmap]) -> np.ndarray:
    """Space for voxels. Large ones are in a file without a name, which the kernel can write back
    and drop from memory; its map is appended to `mapped`."""
    size = math.prod(shape) * dtype.itemsize
    if size <= _MOST_IN_MEMORY:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(dir=folder) as file:
        os.posix_fallocate(file.fileno(), 0, size)  # a full disk is an error here, not a signal
        mapped.append(mmap.mmap(file.fileno(), size))
    return np.frombuffer(mapped[-1], dtype).reshape(shape)


def _in_order(array: Any, folder: str | None, mapped: list[mmap.mmap]) -> np.ndarray:
    """The voxels in C order, in a type of volumes. A contiguous array is not copied; an array that
    is read on demand, as those of zarr and dask are, is read in slabs along z."""
    chunks = getattr(array, "chunks", None)
    if chunks is None or isinstance(array, np.ndarray):
        array = np.ma.filled(array, 0) if np.ma.isMaskedArray(array) else np.asarray(array)
        chunks = None
    if len(array.shape) != 3:
        raise UsageError(f"an array of shape {array.shape}: expected three axes, z, y and x")
    dtype = _type_for(np.dtype(array.dtype))
    if chunks is None:
        return np.require(array, dtype, ["C", "A"])
    out = _space(array.shape, dtype, folder, mapped)
    depth = chunks[0] if isinstance(chunks[0], int) else max(chunks[0])
    for z in range(0, array.shape[0], depth):
        part = slice(z, min(z + depth, array.shape[0]))
        values = np.asanyarray(array[part])
        if np.ma.is_masked(values):
            raise UsageError("masked voxels in an array that is read in slabs: fill them, and "
                             "pass the mask as mask=")
        out[part] = values
    return out


def _volume(source: Any, *, labels: bool, folder: str | None, mapped: list[mmap.mmap],
            spacing: Sequence[float] | None = None, affine: Any = None,
            origin: Sequence[float] | None = None, name: str | None = None,
            like: _Place | None = None) -> tuple[_slf.Volume, _Place]:
    """A volume from an array or an image, and its place. Maps of files that hold voxels are
    appended to `mapped`."""
    voxels = _voxels(source)
    place = voxels.place or like or _place(np.zeros(3), np.eye(3))
    if affine is not None:
        place = _affine_place(affine)
    if spacing is not None:
        lengths = np.asarray(spacing, float)
        if lengths.shape != (3,) or not (np.isfinite(lengths) & (lengths > 0)).all():
            raise UsageError(f"spacing {spacing}: expected three positive numbers, dx, dy, dz")
        directions = place.axes / np.linalg.norm(place.axes, axis=1, keepdims=True)
        place = _place(place.origin, directions * lengths[:, None])
    if origin is not None:
        place = _place(origin, place.axes)
    if not abs(np.linalg.det(place.axes)) > 0:
        raise UsageError("the axes of the image are singular")
    finite("scale", (voxels.slope, voxels.intercept))
    array = _in_order(voxels.array, folder, mapped)
    volume = _slf.Volume(array, tuple(place.origin), [tuple(axis) for axis in place.axes],
                         voxels.slope, voxels.intercept, labels, voxels.unit,
                         voxels.patient_axes or affine is not None, name or voxels.source,
                         [voxels.source] if os.path.exists(voxels.source) else [])
    return volume, place


# ---- transfer functions --------------------------------------------------------------------------


def _transfer(transfer: Any) -> Any:
    """A transfer function as a function that makes JSON for a volume."""
    def for_volume(low: float, high: float, spacing: float) -> str:
        if callable(transfer):
            values = np.linspace(low, high, 256)
            points = np.column_stack([values, np.asarray(transfer(values), float)])
        else:
            points = np.asarray(transfer, float)
        if points.ndim != 2 or points.shape[1] != 5 or not np.isfinite(points).all():
            raise UsageError(f"transfer has the shape {points.shape}, expected finite rows of "
                             "value, red, green, blue and opacity (a function: of the last four)")
        opacity = np.column_stack([points[:, [0, 4]], np.full(len(points), 0.5),
                                   np.zeros(len(points))])
        return json.dumps({"Name": "array", "ColorSpace": "RGB",
                           "RGBPoints": points[:, :4].ravel().tolist(),
                           "Points": opacity.ravel().tolist(),
                           "ScalarOpacityUnitDistance": spacing})
    return for_volume


# ---- scenes --------------------------------------------------------------------------------------


def _is_path(source: Any) -> bool:
    return isinstance(source, (str, bytes, os.PathLike))


_Kept = dict[Any, tuple[_slf.Volume, _Place]]
"""Volumes in memory by what they were made of, for states of the same array."""


def _arrays(source: Any, settings: Any, folder: str | None, mapped: list[mmap.mmap],
            kept: _Kept) -> None:
    """Replaces what is no file by volumes in memory."""
    def volume(array: Any, **how: Any) -> tuple[_slf.Volume, _Place]:
        key = (id(array), repr(how))
        if key not in kept:
            kept[key] = _volume(array, folder=folder, mapped=mapped, **how)
        return kept[key]

    labels, mask = settings.pop("labels", False), settings.get("mask")
    is_labels = isinstance(labels, (bool, np.bool_)) and bool(labels)
    if is_labels:
        settings["labels"] = True
    elif not isinstance(labels, (bool, np.bool_)):
        settings["labels_volume"] = labels
    placed = {key: settings.pop(key, None) for key in ("affine", "origin", "name")}
    place = None
    if _is_path(source):
        settings["input"] = source
        if placed["affine"] is not None or placed["origin"] is not None:
            raise UsageError("affine and origin are for arrays; files state their position")
    else:
        of_files = [key for key in _OF_FILES if settings.get(key)]
        if of_files:
            raise UsageError(f"{', '.join(of_files)}: for files only")
        make: Any = volume
        if np.ma.is_masked(source) and not is_labels:
            source, settings["mask"] = _unmasked(source, mask)
            make = functools.partial(_volume, folder=folder, mapped=mapped)  # of new arrays
        settings["input"], place = make(source, labels=is_labels,
                                         spacing=settings.pop("spacing", None), **placed)
    for key, name in ("labels_volume", "labels"), ("mask", "mask"):
        part = settings.get(key)
        if part is not None and not _is_path(part):
            settings[key], _ = volume(part, labels=True, like=place, name=name)


class Described(NamedTuple):
    """A recipe, and the scenes that it describes, by the names of their states."""

    recipe: _slf.Recipe
    scenes: list[tuple[str, Any]]


def described(stack: contextlib.ExitStack, source: Any, settings: Mapping[str, Any], *,
              states: Sequence[Mapping[str, Any]] = (), known: type = Settings,
              report: ProgressFunction | None = None, folder: str | None = None, threads: int = 0,
              truth_of: str | None = None) -> Described:
    """The scenes of states, until `stack` is closed; without states, those of the recipe alone.
    known: the settings that there are.  report: for reading pictures.  folder: for temporary
    files.  truth_of: the provenance of a field to compare with. Called by what users call, whose
    place warnings state."""
    scenes: list[tuple[str, Any]] = []
    shared = _slf.StateScenes() if states else None
    kept: _Kept = {}
    whole: _slf.Recipe | None = None
    for state in states or ({},):
        given: Any = {"source": source, **settings, **state}
        given["source"] = on_disk(given["source"], settings.get("name"), stack)
        name, lit_by = state.get("name", ""), given.pop("light_from", None) or ""
        if "name" in state:
            given["name"] = settings.get("name")
        unknown = sorted(set(given) - {"source"} - set(known.__annotations__))
        if unknown:
            raise TypeError(f"unexpected settings: {', '.join(unknown)}")
        mapped: list[mmap.mmap] = []
        recipe = recipe_of(given, bool(lit_by), folder, mapped, kept)
        recipe.use_threads(threads)
        if truth_of is not None:
            recipe.compare_with(truth_of)
        notes: list[str] = []
        if isinstance(given["source"], Scene):
            made = [(name, stack.enter_context(ray_scene(given["source"])))]
        else:
            made = recipe.scenes(shared, name, lit_by, known is BuildSettings, notes, report)
        for note in notes:
            warnings.warn(note, stacklevel=3)
        for file in mapped:  # rays jump from page to page: reading ahead would be in vain
            file.madvise(mmap.MADV_RANDOM)
        scenes += [(name, made[0][1])] if states else made
        whole = whole or recipe
    assert whole is not None
    return Described(whole, scenes)


def recipe_of(given: Mapping[str, Any], lit: bool, folder: str | None, mapped: list[mmap.mmap],
              kept: _Kept) -> _slf.Recipe:
    """The recipe of settings, of which one is the source."""
    settings: Any = {key: value for key, value in given.items() if value is not None}
    source = settings.pop("source")
    recipe = _slf.Recipe()
    if isinstance(source, Scene):
        wrong = sorted(set(settings) - set(_settings.FieldOptions.__annotations__))
        wrong += ["each_label"] * bool(settings.get("each_label")) + ["light_from"] * lit
        if wrong:
            raise UsageError(f"{', '.join(wrong)}: not for scenes of Python")
    else:
        _arrays(source, settings, folder, mapped, kept)
        if isinstance(table := settings.get("label_table"), Mapping):
            settings["label_table"] = {"labels": [_style(*style) for style in table.items()]}
        if not _is_path(transfer := settings.get("transfer", "")):
            settings["transfer"] = _transfer(transfer)
        if tone := settings.pop("tone", None):
            settings |= {"exposure": tone.exposure, "tonemap": tone.curve}
    for key, value in settings.items():
        recipe.set(key, value)
    if _is_path(source):
        recipe.read(source)
    return recipe


def _style(id: Any, style: Any) -> dict[str, Any]:
    """A name, or (name, color, opacity), of which the last two may be missing."""
    given = (style,) if isinstance(style, str) else tuple(style)
    name, color, opacity = given + (None, 1.0)[len(given) - 1:]
    finite(f"the style of {name!r}:", [opacity, *(() if color is None else color)])
    made = {"id": int(id), "name": name, "opacity": float(opacity)}
    return made if color is None else {**made, "color": point(color)}
