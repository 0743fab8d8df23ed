"""Building fields, and pictures without one."""

from __future__ import annotations

import contextlib
import os
from typing import Any, Callable, Literal, Mapping, Sequence, Unpack, overload

import numpy as np

from . import _slf
from ._field import (AnyCamera, Array, Field, Path, Size, State, check_dtype, finished_picture)
from ._errors import UsageError
from ._mesh import on_disk
from ._notebook import Studio, server_base
from ._progress import Progress, reporter
from ._rays import Function, Scene
from ._source import BuildSettings, Settings, described, recipe_of
from ._types import Picture, finite, orbit


def build(source: Any, out: Path, *, states: Sequence[Mapping[str, Any]] = (),
          shard: tuple[int, int] = (1, 1),
          only_levels: tuple[int | None, int | None] = (None, None), coarser: Path = "",
          memory: int = 0, threads: int = 0, commit_every: float = 5, force: bool = False,
          progress: Progress = None, **settings: Unpack[BuildSettings]) -> Field:
    """Builds a field, or resumes its build, and opens it.

    source: one of
        an array [z, y, x] of integers or floats, of NumPy or anything that becomes one; one in C
            order is not copied, and must not change during the build. zarr and dask arrays are
            read in slabs along z; those above 256 MiB into a temporary file beside `out`.
        a mesh of trimesh, with its colours or its texture, or of pyvista, with the first uint8 RGB
            or RGBA array of its point_data; z is up.
        an image of nibabel (RAS, converted to LPS) or SimpleITK, or an array of xarray with
            evenly spaced coordinates, with its own position.
        a path of a volume, a mesh or a recipe (.json), "pictures:FOLDER", "pictures:JSON" or
            "scene:NAME", as `slf build` reads them.
        an slf.Scene.
    out: the field to write. It grows in OUT.unfinished, and gets its name when it is complete. The
        same call resumes what was interrupted. A complete field of the same source and settings is
        only opened.
    states: variants of the object, for one field: for each {"name": ..., other settings}, which are
        taken before those of this call; "source": another source; "light_from": the name of an
        earlier state that differs by `clip` or structures and whose light this one has.
    shard: (k, n), the k-th of n parts, from 1, for slf.merge().
    only_levels, coarser: as --only-levels and --coarser of `slf build`.
    memory: most bytes of tiles and records under way; 0: 256 MiB, or what the largest tile needs.
    threads: 0: all.  commit_every: seconds between commits, which a kill can lose.
    force: replace another field at `out`, once this one is complete.
    progress: True: a bar of tqdm; or a function (done, total, skipped), which ends the call if it
        returns False. Counts paths of light, then rays.

    settings: slf.BuildSettings, whose documentation says what each does.

    Decisions of readers that a person may want to check are warnings.
    Raises slf.UsageError (a ValueError) for wrong settings or another field at `out`, slf.IoError,
    slf.UnsupportedError, slf.FailedError if `progress` returned False, MemoryError, and whatever
    `progress` or a scene raises. KeyboardInterrupt ends it, too; finished tiles are kept.
    """
    if isinstance(source, Scene):
        threads = threads or source.processes  # a thread waits for each process
    folder = os.path.dirname(os.fspath(out)) or None
    finite("commit_every", commit_every)
    with contextlib.ExitStack() as stack, reporter(progress, "build") as report:
        recipe, scenes = described(stack, source, settings, states=states, known=BuildSettings,
                                   report=report, folder=folder, threads=threads)
        built = _slf.build(recipe, scenes, out, report, memory=memory, threads=threads,
                           commit_every=commit_every, force=force, shard=shard,
                           only_levels=only_levels, coarser=coarser)
    field = Field(out, threads=threads)
    field.build_report = built
    return field


def build_rays(fn: Callable[..., Any], sphere: tuple[Sequence[float], float], out: Path, *,
               batch: int = 65536, processes: int = 0, provenance: Mapping[str, Any] = {},
               **settings: Any) -> Field:
    """Builds a field from a function of rays: fn(origins, targets) -> rgba or (rgba, depth).

    fn: vectorised, as Scene.trace().  sphere: (center, radius) around everything visible.
    batch: the most rays of one call.
    processes: above 0: call it in so many processes (Scene.processes).
    provenance: what distinguishes this function from others of its name (Scene.provenance).
    settings: those of build() that are not of volumes.
    """
    return build(Function(fn, sphere, batch, processes, provenance), out, **settings)


@overload
def raycast(source: Any, camera: AnyCamera = ..., size: Size = ..., *,
            depth: Literal[False] = ..., dtype: Any = ...,
            background: Sequence[float] | None = ..., states: Sequence[Mapping[str, Any]] = ...,
            state: State = ..., threads: int = ..., progress: Progress = ...,
            **settings: Unpack[Settings]) -> Array: ...


@overload
def raycast(source: Any, camera: AnyCamera = ..., size: Size = ..., *,
            depth: Literal[True], dtype: Any = ...,
            background: Sequence[float] | None = ..., states: Sequence[Mapping[str, Any]] = ...,
            state: State = ..., threads: int = ..., progress: Progress = ...,
            **settings: Unpack[Settings]) -> Picture: ...


def raycast(source: Any, camera: AnyCamera = orbit(), size: Size = (512, 512), *,
            depth: bool = False, dtype: Any = np.float32, background: Sequence[float] | None = None,
            states: Sequence[Mapping[str, Any]] = (), state: State = 0, threads: int = 0,
            progress: Progress = None, **settings: Unpack[Settings]) -> Any:
    """A picture of the source itself, without a field: one ray per pixel.

    source and settings are those of build(), results those of Field.render().
    states, state: those of build(), and the one to draw, in a view of the field of all.
    progress: counts rows.
    """
    check_dtype(dtype)
    with contextlib.ExitStack() as stack, reporter(progress, "raycast") as report:
        recipe, scenes = described(stack, source, settings, states=states, threads=threads)
        known: dict[State, Any] = {k: scene for k, (_, scene) in enumerate(scenes)} | dict(scenes)
        if state not in known:
            raise UsageError(f"no state {state!r}; there are {', '.join(dict(scenes)) or 'none'}")
        sphere = _slf.sphere_of(recipe, scenes)
        colors, distance = known[state].raycast(sphere, camera, size, threads, report)
    picture = finished_picture(colors, dtype, background)
    return Picture(picture, distance) if depth else picture


def studio(source: Any, out: Path, *, save: Path = "", threads: int = 0,
           **settings: Unpack[BuildSettings]) -> Studio:
    """A page on which colours, light and cuts are chosen by looking, and the field is built.

    source: an array, an image, a mesh or a path, as of build().
    out: the field that the page builds. The recipe is saved beside it as NAME.recipe.json, or in
        `save`. That of an array or a mesh object names no file that stays: slf.build() takes its
        members as settings.
    settings: what the page begins with; those of build(), with a transfer function as a name, a
        file or JSON.

    Raises what build() raises, and slf.UnsupportedError: slf was built without the page.
    """
    if isinstance(source, Scene):
        raise UsageError("studio: not for scenes of Python")
    folder = os.path.dirname(os.fspath(out)) or None
    with contextlib.ExitStack() as stack:
        mesh = on_disk(source, settings.get("name"), stack)
        recipe = recipe_of({**settings, "source": mesh}, False, folder, [], {})
        made = Studio(recipe, out, save, threads, server_base() is not None)
        made.files = stack.pop_all()  # until it is closed
    return made
