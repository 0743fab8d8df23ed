"""Reading fields."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import warnings
import weakref
from types import TracebackType
from typing import Any, Iterator, Mapping, Sequence, Union, Unpack, overload

import numpy as np

from . import _slf
from ._errors import UnsupportedError, UsageError
from ._notebook import View, bundle, server_base
from ._progress import Progress, reporter
from ._source import SourceSettings, scenes_of
from ._types import (BuildReport, Camera, Content, Difference, Evaluation, Frame, Look, Measurement,
                     MergeReport, Orbit, PickedPoint, Picture, RepackReport, Shape, Sphere, Tile,
                     Tone, VerifyReport, finite, orbit)

Path = str | os.PathLike[str]
AnyCamera = Orbit | Camera
Size = tuple[int, int]
LevelName = int | str
State = int | str
"""The number of a state, from 0, or its name."""
Structures = Mapping[Union["Field", Path], float | Look]
AnyViews = Path | dict[str, Any] | None

_DEFAULT_MEMORY = 256 << 20
_THUMBNAIL_MEMORY = 16 << 20


def path_text(path: Path) -> str:
    return os.fspath(path)


def camera_tuple(sphere: Sphere, camera: AnyCamera, size: Size) -> tuple[Any, ...]:
    """A camera as the extension module takes it."""
    width, height = (int(side) for side in size)
    if width < 1 or height < 1 or width * height > 1 << 28:
        raise UsageError(f"size {size}: expected (width, height), at least 1 and at most 2^28 "
                         "pixels")
    for values in camera:
        finite("camera", values)
    if isinstance(camera, Orbit):
        return _slf.orbit_camera(sphere, tuple(camera), width, height)
    return (*camera, width, height)


def finished_picture(rgba: np.ndarray, dtype: Any,
                     background: Sequence[float] | None) -> np.ndarray:
    """Composites over a background and converts to the type that was asked for."""
    if background is not None:
        finite("background", background)
        rgba[..., :3] += (1 - rgba[..., 3:]) * np.asarray(background, np.float32)
        rgba[..., 3] = 1
    if np.dtype(dtype) == np.uint8:
        return (np.clip(rgba, 0, 1) * 255 + 0.5).astype(np.uint8)
    return rgba


def check_dtype(dtype: Any) -> np.dtype:
    if np.dtype(dtype) not in (np.float32, np.uint8):
        raise UsageError(f"dtype {dtype}: expected float32 or uint8")
    return np.dtype(dtype)


class Field:
    """An open sphere light field: a snapshot of its file, read-only.

    Opened by slf.open() and slf.build(). A context manager. Any thread may use it; one view is
    drawn at a time. Pictures and tiles outlive it.
    """

    def __init__(self, path: Path, *, memory: int = _DEFAULT_MEMORY, threads: int = 0,
                 state: State = 0, progress: Progress = None) -> None:
        self._open: _slf.Field | None = None
        self._opened_with = (path, memory, threads, state)
        self._structures: Structures | None = None
        self._composed: tuple[Any, Field] | None = None
        self._others: dict[State, Field] = {}
        self._server: _slf.Server | None = None
        with reporter(progress, "fetch") as report:
            self._open = _slf.Field(path_text(path), memory, threads, report)
        if state != 0:
            self._open = self._open.in_state(state)
        self._shape: Shape = self._open.shape
        self.build_report: BuildReport | None = None
        """What slf.build() did, if it opened this field."""

    # -- lifetime ---------------------------------------------------------------------------------

    @property
    def _field(self) -> _slf.Field:
        if self._open is None:
            raise UsageError("the field is closed")
        return self._open

    def close(self) -> None:
        """Closes the file. A second call does nothing."""
        self._open = self._composed = None
        self._others.clear()
        if self._server is not None:
            self._server.close()
            self._server = None

    @property
    def closed(self) -> bool:
        return self._open is None

    def __enter__(self) -> Field:
        self._field
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def __reduce__(self) -> Any:
        """Pickled by path: where it is unpickled, the file is opened again."""
        return _reopened, (*self._opened_with, self._structures)

    def __repr__(self) -> str:
        if self._open is None:
            return "<slf.Field, closed>"
        return f"<slf.Field {self.path!r}, levels 0 to {self.finest_level}>"

    # -- content ----------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        return self._field.path

    @property
    def shape(self) -> Shape:
        return self._shape

    @property
    def sphere(self) -> Sphere:
        return self._shape.sphere

    @property
    def finest_level(self) -> int:
        """Levels 0 to this can be drawn."""
        return self._shape.finest_level

    @property
    def format(self) -> str:
        """Of samples: "rgba8", "rgba16f", "rgba8_depth8" or "rgba16f_depth8"."""
        return self._field.format

    @property
    def codec(self) -> str:
        return self._field.codec

    @property
    def has_depth(self) -> bool:
        return self._field.has_depth

    @property
    def linear(self) -> bool:
        """Whether colours are linear radiance, which pictures are tone-mapped from."""
        return self._field.linear

    @property
    def manifest(self) -> Any:
        """The manifest, parsed (FORMAT.md)."""
        return json.loads(self._field.manifest)

    @property
    def provenance(self) -> Any:
        """The source and the settings of the build."""
        return json.loads(self._field.provenance)

    @property
    def file_bytes(self) -> int:
        return self._field.file_bytes

    @property
    def states(self) -> tuple[str, ...]:
        """The names of the states, variants of the object that the file holds; () if there is just
        one."""
        return self._field.states

    @property
    def state(self) -> int:
        """The state that this shows; 0 unless another was asked for."""
        return self._field.state

    def in_state(self, state: State) -> Field:
        """The same file in another state, by its name or number: a field of its own, with its own
        memory for tiles. Later calls return the same one. slf.UsageError: there is none."""
        if state not in self._others:
            other = self._others[state] = self._variant(self._field.in_state(state), None)
            other._opened_with = (*self._opened_with[:3], state)
        return self._others[state]

    def _variant(self, opened: _slf.Field, structures: Structures | None) -> Field:
        """A field that shows something else of the same file."""
        other = object.__new__(Field)
        other.__dict__.update(self.__dict__, _open=opened, _structures=structures, _composed=None,
                              _others={}, _server=None)
        return other

    def content(self) -> Content:
        """Counts the tiles and bytes of each level, of this state.

        Raises slf.BadFileError: a table is damaged."""
        return self._field.content()

    # -- pictures ---------------------------------------------------------------------------------

    def camera(self, camera: AnyCamera, size: Size = (512, 512)) -> Camera:
        """The camera that an orbit stands for, for a picture of this size."""
        return Camera(*camera_tuple(self.sphere, camera, size)[:4])

    def _level(self, level: LevelName) -> int | None:
        if level == "matching":
            return None
        if level == "finest":
            return self.finest_level
        if isinstance(level, str):
            raise UsageError(f"level {level!r}: expected a number, 'finest' or 'matching'")
        return int(level)

    @overload
    def render(self, camera: AnyCamera = ..., size: Size = ..., mode: str | None = ...,
               level: LevelName = ..., *, dtype: Any = ...,
               background: Sequence[float] | None = ..., tone: Tone | None = ...,
               state: State | None = ...,
               structures: Structures | None = ...) -> np.ndarray: ...

    @overload
    def render(self, camera: AnyCamera = ..., size: Size = ..., mode: str | None = ...,
               level: LevelName = ..., *, depth: bool, dtype: Any = ...,
               background: Sequence[float] | None = ..., tone: Tone | None = ...,
               state: State | None = ..., structures: Structures | None = ...) -> Any: ...

    def render(self, camera: AnyCamera = orbit(), size: Size = (512, 512),
               mode: str | None = None, level: LevelName = "finest", *, depth: bool = False,
               dtype: Any = np.float32, background: Sequence[float] | None = None,
               tone: Tone | None = None, state: State | None = None,
               structures: Structures | None = None) -> Any:
        """Draws a view: an array [height, width, 4] of RGBA, premultiplied by alpha.

        camera: slf.orbit() or slf.Camera.
        size: (width, height) in pixels.
        mode: "nearest", "uv", "st", "bitri" or "depth"; default: "depth" if the field has depths,
            else "bitri".
        level: 0 to field.finest_level, "finest", or "matching": the coarsest that is dense enough.
        depth: also return depths, as a Picture(rgba, depth).
        dtype: float32, 0 to 1 (fields with linear radiance exceed 1), or uint8, 0 to 255.
        background: an RGB colour, each 0 to 1, to composite over; alpha is then 1.
        tone: how to show linear radiance; default: as it is for float32 without a background,
            else Tone().
        state: that of in_state(); default: the one that this shows.
        structures: what to draw together instead, as for compose(). The last ones stay open.

        Raises slf.UsageError for an invalid camera, level, mode or state, slf.BadFileError for a
        damaged tile.
        """
        if structures is not None:
            if self._composed is None or self._composed[0] != structures:
                self._composed = dict(structures), self.compose(structures)
            return self._composed[1].render(camera, size, mode, level, depth=depth, dtype=dtype,
                                            background=background, tone=tone)
        display = check_dtype(dtype) == np.uint8 or background is not None
        shown = self if state is None else self.in_state(state)
        colors, distance = shown._field.render(camera_tuple(self.sphere, camera, size), mode,
                                              self._level(level), depth, tone, display, None)
        picture = finished_picture(colors, dtype, background)
        return Picture(picture, distance) if depth else picture

    def compose(self, structures: Structures) -> Field:
        """The field that shows structures together, in place of what this one shows: along each
        stored ray, the nearest over those behind it.

        structures: names of this field's states, or fields or paths of others on its sphere, and an
            opacity, 0 to 1, or a Look of each. Those of opacity 0 are not read. At one depth, the
            first ones are in front.

        It is drawn, played, measured and evaluated as others are, but not shown in a page.
        Raises slf.UsageError for structures without depth, or on another sphere or lattice, or with
        another kind of colours.
        """
        looks = [(key, look if isinstance(look, Look) else Look(look))
                 for key, look in structures.items()]
        layers = [((key if isinstance(key, Field) else
                    self.in_state(key) if isinstance(key, str) and key in self.states else
                    Field(key))._field, *look)
                  for key, look in looks if look.opacity != 0]
        return self._variant(self._field.compose(layers), dict(structures))

    def pick(self, x: float, y: float, camera: AnyCamera = orbit(),
             size: Size = (512, 512)) -> PickedPoint | None:
        """The point of the surface that a picture shows at a place; None if it is less than half
        opaque there.

        x, y: in pixels from the upper left corner; centres of pixels are at halves.
        camera, size: of the picture, as in render().

        Raises slf.UsageError for a place outside the picture, and for a field without depths.
        """
        return self._field.pick(camera_tuple(self.sphere, camera, size), x, y)

    def thumbnail(self, size: int = 256,
                  background: Sequence[float] | None = (0, 0, 0)) -> np.ndarray:
        """A small picture: uint8 [size, size, 4], over black. Reads coarse tiles, and keeps none.
        """
        colors, _ = self._field.render(camera_tuple(self.sphere, orbit(), (size, size)), None,
                                       self._level("matching"), False, None, True,
                                       _THUMBNAIL_MEMORY)
        return finished_picture(colors, np.uint8, background)

    def player(self, mode: str | None = None, level: LevelName = "finest", loading: str = "ahead",
               horizon: int = 8) -> Player:
        """A player for the frames of a moving camera. It keeps the file open itself.

        loading: "ahead" loads tiles of predicted frames, "demand" those that frames lacked, both
            in the background; with "wait", frames wait for their tiles.
        horizon: frames to load ahead.
        """
        number = self._level(level)
        return Player(self, self._field.player(
            mode, self.finest_level if number is None else number, loading, horizon))

    # -- tiles ------------------------------------------------------------------------------------

    def tiles(self, level: int | None = None, missing: bool = False) -> list[Tile]:
        """Lists tiles in key order. Reads tables, no payload.

        level: of one level; default: of all.  missing: also list tiles that are missing.
        """
        return self._field.tiles(level or 0, level, missing)

    def tile(self, level: int, entry: int, exit: int, channel: str = "color") -> np.ndarray:
        """The samples of a tile: [entry vertices, exit vertices, 4] of premultiplied RGBA, uint8 or
        float16; or [entry vertices, exit vertices] of depth, uint8, 0 at entry, 255 at exit.

        A read-only view of the decoded tile, which stays in memory as long as the array. Exit
        vertices are in the order of FORMAT.md.
        Raises slf.UsageError: no such tile or channel; slf.FailedError: it was never built;
        slf.BadFileError: it is damaged.
        """
        return self._field.tile(level, entry, exit, channel)

    # -- measures ---------------------------------------------------------------------------------

    def _cameras(self, cameras: int | Sequence[AnyCamera], size: Size,
                 distance: float) -> list[tuple[Any, ...]]:
        finite("distance", distance)
        if isinstance(cameras, int):
            return _slf.random_cameras(self.sphere, distance, cameras, 1, *size)
        return [camera_tuple(self.sphere, camera, size) for camera in cameras]

    def measure(self, cameras: int | Sequence[AnyCamera] = 8, size: Size = (512, 512),
                mode: str | None = None, levels: Sequence[int] = (), *, distance: float = 3,
                progress: Progress = None) -> Measurement:
        """Measures the memory that views need.

        cameras: a number of random ones at `distance` radii, or a list.
        levels: default: all.
        progress: counts views.
        """
        with reporter(progress, "measure") as report:
            return self._field.measure(self._cameras(cameras, size, distance), mode, list(levels),
                                       report)

    def evaluate(self, scene: Any, cameras: int | Sequence[AnyCamera] = 8, size: Size = (256, 256),
                 mode: str | None = None, level: LevelName = "finest", *, distance: float = 3,
                 supersample: int = 1, progress: Progress = None,
                 **settings: Unpack[SourceSettings]) -> Evaluation:
        """Compares views with ray-cast ones of the field's scene: PSNR and SSIM, RGB over black.

        scene: what the field was built from.
        settings: say how to read it, as in slf.build(). Light, rays and, unless it is given, the
            transfer function are those of the field; rays have a step of at most 0.5 voxels.
        """
        with contextlib.ExitStack() as stack, reporter(progress, "evaluate") as report:
            [(_, truth)] = scenes_of(stack, scene, truth_of=self._field.provenance, **settings)
            evaluation = _slf.evaluate(self._field, truth, self._cameras(cameras, size, distance),
                                       mode, self._level(level), supersample, report)
        if evaluation.differs:
            warnings.warn(f"{self.path} was built from another source ({evaluation.differs} "
                          "differs): the figures compare two different objects", stacklevel=2)
        return evaluation

    # -- notebooks --------------------------------------------------------------------------------

    def show(self, page: Path | None = None, *, views: AnyViews = None,
             force: bool = False) -> View:
        """The page of `slf view`, turned by the mouse, in a notebook; its `url` for a browser.

        A server on this machine sends the page the parts of the file that views need. It runs
        until the field is closed. Where the notebook's server is on another machine than the
        browser, jupyter-server-proxy leads there; without it, the notebook gets a field of at most
        20 MiB whole.
        page: a file .html beside the notebook, to write page and field to and to show.
        views: saved views and notes that the page shows: a file, or what such a file has
            (schemas/views.json).
        force: replace that file, or write into a folder that has files in it.

        Raises slf.UnsupportedError: slf was built without the page. slf.UsageError: `page` exists.
        slf.BadFileError: `views` are none.
        """
        if self._structures is not None:
            raise UnsupportedError(f"{self.path}: a page shows a file, not what is composed of it")
        if page is not None:
            export(self, page, views=views, force=force)
            return View(path_text(page), self)
        if self._server is None or views is not None:
            # A proxy passes on the name of its own host.
            server = _slf.Server([self.path], *_views(views), server_base() is not None)
            if self._server is not None:
                self._server.close()
            self._server = server
            _with_threads.add(self)
        return View(self._server.url, self, views)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        return None if self._open is None else bundle(self)


class Player:
    """Draws the frames of a moving camera on time. Made by Field.player(). A context manager."""

    def __init__(self, field: Field, player: _slf.Player) -> None:
        self._sphere = field.sphere
        self._player = player
        self.report: Frame | None = None
        """How the last frame was drawn."""
        _with_threads.add(self)

    def close(self) -> None:
        """Ends the thread that loads tiles, and closes the file. A second call does nothing."""
        self._player.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *raised: Any) -> None:
        self.close()

    def draw(self, camera: AnyCamera, size: Size = (512, 512), dtype: Any = np.float32,
             background: Sequence[float] | None = None, tone: Tone | None = None) -> np.ndarray:
        """The next frame, as Field.render(). Draws coarser levels where tiles are not loaded."""
        display = check_dtype(dtype) == np.uint8 or background is not None
        colors, self.report = self._player.draw(camera_tuple(self._sphere, camera, size),
                                                tone, display)
        return finished_picture(colors, dtype, background)

    def settle(self) -> None:
        """Waits until all tiles are loaded that are being loaded."""
        self._player.settle()


_with_threads: "weakref.WeakSet[Field | Player]" = weakref.WeakSet()


@atexit.register
def _end_threads() -> None:
    """Ends the threads of slf, which must not outlive the interpreter."""
    _slf.stop_calls()
    for owner in list(_with_threads):
        owner.close()


def open(path: Path, *, memory: int = _DEFAULT_MEMORY, threads: int = 0, state: State = 0,
         progress: Progress = None) -> Field:
    """Opens a field, complete or not: a file or an address, http:// or https://.

    memory: most bytes of decoded tiles.
    threads: for drawing; 0: all.
    state: which of the field's states to show; Field.in_state() shows another.
    progress: counts the bytes of a remote field that must be fetched whole.

    Raises FileNotFoundError, slf.IoError, slf.BadFileError, slf.UnsupportedError (a newer format).
    """
    return Field(path, memory=memory, threads=threads, state=state, progress=progress)


def _reopened(path: Path, memory: int, threads: int, state: State,
              structures: Structures | None) -> Field:
    field = Field(path, memory=memory, threads=threads, state=state)
    return field if structures is None else field.compose(structures)


def verify(field: Field | Path, *, quick: bool = False, fix: bool = False, threads: int = 0,
           progress: Progress = None) -> VerifyReport:
    """Checks every page, record and tile. Damage is a finding in the report, not an exception.

    quick: structure and counts only.  fix: drop damaged tiles, so that a build makes them again.
    """
    handle = field._field if isinstance(field, Field) else None
    path = field.path if isinstance(field, Field) else path_text(field)
    if fix:
        handle = None
    with reporter(progress, "verify") as report:
        return _slf.verify(path, handle, quick, fix, threads, report)


@contextlib.contextmanager
def _opened(field: Field | Path) -> Iterator[Field]:
    """A field that is given as a path is open only as long as the call."""
    if isinstance(field, Field):
        yield field
        return
    with Field(field) as mine:
        yield mine


def repack(field: Field | Path, out: Path, *, codec: str = "", depth: bool = True,
           finest_level: int | None = None, subfields: Sequence[int] = (),
           color_type: str | None = None, light: bool = True, memory: int = _DEFAULT_MEMORY,
           threads: int = 0, force: bool = False, progress: Progress = None) -> RepackReport:
    """Rewrites a field into another form. Empty arguments keep what the field has.

    codec, depth: as in slf.build().  finest_level: the finest to keep.
    color_type: "u8" or "half".  light: keep the scene's light.  progress: counts tiles.
    """
    half = None if color_type is None else is_half(color_type)
    with _opened(field) as source, reporter(progress, "repack") as report:
        return _slf.repack(source._field, path_text(out), codec, depth, finest_level,
                           sorted(subfields), half, light, memory, threads, force, report)


def merge(parts: Sequence[Path], out: Path, *, part: bool = False, memory: int = _DEFAULT_MEMORY,
          threads: int = 0, force: bool = False, progress: Progress = None) -> MergeReport:
    """Joins parts of a field: shards, levels or subfields.  part: the result may be a part."""
    with reporter(progress, "merge") as report:
        return _slf.merge([path_text(p) for p in parts], path_text(out), part, memory, threads,
                          force, report)


def diff(a: Field | Path, b: Field | Path, *, threads: int = 0,
         progress: Progress = None) -> Difference:
    """Compares two fields tile by tile."""
    with _opened(a) as left, _opened(b) as right, reporter(progress, "diff") as report:
        return _slf.diff(left._field, right._field, threads, report)


def _views(views: AnyViews) -> tuple[str, str | None]:
    """A name for messages, and JSON, or None for the file of that name."""
    if views is None:
        return "", None
    return ("views", json.dumps(views)) if isinstance(views, dict) else (path_text(views), None)


def export(field: Field | Path, out: Path, *, views: AnyViews = None, force: bool = False,
           progress: Progress = None) -> None:
    """Writes the page that shows a field together with it.

    out: a path that ends in .html or .htm becomes one file, which opens from disk (fields up to
        1 GiB); any other a folder for a host of static files.
    views: as in Field.show().
    force: replace that file, or write into a folder that has files in it.

    Raises slf.UsageError: `out` exists. slf.BadFileError: `views` are none.
    """
    path = path_text(out)
    source = field.path if isinstance(field, Field) else path_text(field)
    with reporter(progress, "export") as report:
        _slf.export_field(source, path, *_views(views), force, report)


def is_half(color_type: str) -> bool:
    if color_type not in ("u8", "half"):
        raise UsageError(f"color_type {color_type!r}: expected 'u8' or 'half'")
    return color_type == "half"
