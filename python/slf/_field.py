"""Reading fields."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import warnings
import weakref
from types import TracebackType
from typing import (Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple, Type, Union, Unpack,
                    overload)

import numpy as np

from . import _slf
from ._errors import UsageError
from ._notebook import View, bundle
from ._progress import Progress, reporter
from ._source import SourceSettings, scene_of
from ._types import (BuildReport, Camera, Content, Difference, Evaluation, Frame, Measurement,
                     MergeReport, Orbit, PickedPoint, Picture, RepackReport, Shape, Sphere, Tile,
                     Tone, VerifyReport, finite, orbit)

Path = Union[str, "os.PathLike[str]"]
AnyCamera = Union[Orbit, Camera]
Size = Tuple[int, int]
LevelName = Union[int, str]
AnyViews = Union[None, Path, Dict[str, Any]]

_DEFAULT_MEMORY = 256 << 20
_THUMBNAIL_MEMORY = 16 << 20


def path_text(path: Path) -> str:
    return os.fspath(path)


def camera_tuple(sphere: Sphere, camera: AnyCamera, size: Size) -> Tuple[Any, ...]:
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
                     background: Optional[Sequence[float]]) -> np.ndarray:
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
                 progress: Progress = None) -> None:
        self._open: Optional[_slf.Field] = None
        self._opened_with = (path, memory, threads)
        self._server: Optional[_slf.Server] = None
        with reporter(progress, "fetch") as report:
            self._open = _slf.Field(path_text(path), memory, threads, report)
        self._shape: Shape = self._open.shape
        self.build_report: Optional[BuildReport] = None
        """What slf.build() did, if it opened this field."""

    # -- lifetime ---------------------------------------------------------------------------------

    @property
    def _field(self) -> _slf.Field:
        if self._open is None:
            raise UsageError("the field is closed")
        return self._open

    def close(self) -> None:
        """Closes the file. A second call does nothing."""
        self._open = None
        if self._server is not None:
            self._server.close()
            self._server = None

    @property
    def closed(self) -> bool:
        return self._open is None

    def __enter__(self) -> Field:
        self._field
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], value: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()

    def __reduce__(self) -> Any:
        """Pickled by path: where it is unpickled, the file is opened again."""
        return _reopened, self._opened_with

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

    def content(self) -> Content:
        """Counts the tiles and bytes of each level. slf.BadFileError: a table is damaged."""
        return self._field.content()

    # -- pictures ---------------------------------------------------------------------------------

    def camera(self, camera: AnyCamera, size: Size = (512, 512)) -> Camera:
        """The camera that an orbit stands for, for a picture of this size."""
        return Camera(*camera_tuple(self.sphere, camera, size)[:4])

    def _level(self, level: LevelName) -> Optional[int]:
        if level == "matching":
            return None
        if level == "finest":
            return self.finest_level
        if isinstance(level, str):
            raise UsageError(f"level {level!r}: expected a number, 'finest' or 'matching'")
        return int(level)

    @overload
    def render(self, camera: AnyCamera = ..., size: Size = ..., mode: Optional[str] = ...,
               level: LevelName = ..., *, dtype: Any = ...,
               background: Optional[Sequence[float]] = ...,
               tone: Optional[Tone] = ...) -> np.ndarray: ...

    @overload
    def render(self, camera: AnyCamera = ..., size: Size = ..., mode: Optional[str] = ...,
               level: LevelName = ..., *, depth: bool, dtype: Any = ...,
               background: Optional[Sequence[float]] = ...,
               tone: Optional[Tone] = ...) -> Any: ...

    def render(self, camera: AnyCamera = orbit(), size: Size = (512, 512),
               mode: Optional[str] = None, level: LevelName = "finest", *, depth: bool = False,
               dtype: Any = np.float32, background: Optional[Sequence[float]] = None,
               tone: Optional[Tone] = None) -> Any:
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

        Raises slf.UsageError for an invalid camera, level or mode, slf.BadFileError for a damaged
        tile.
        """
        display = check_dtype(dtype) == np.uint8 or background is not None
        colors, distance = self._field.render(camera_tuple(self.sphere, camera, size), mode,
                                              self._level(level), depth, tone, display)
        picture = finished_picture(colors, dtype, background)
        return Picture(picture, distance) if depth else picture

    def pick(self, x: float, y: float, camera: AnyCamera = orbit(),
             size: Size = (512, 512)) -> Optional[PickedPoint]:
        """The point of the surface that a picture shows at a place; None if it is less than half
        opaque there.

        x, y: in pixels from the upper left corner; centres of pixels are at halves.
        camera, size: of the picture, as in render().

        Raises slf.UsageError for a place outside the picture, and for a field without depths.
        """
        return self._field.pick(camera_tuple(self.sphere, camera, size), x, y)

    def thumbnail(self, size: int = 256,
                  background: Optional[Sequence[float]] = (0, 0, 0)) -> np.ndarray:
        """A small picture: uint8 [size, size, 4], over black. Reads coarse tiles only, and keeps none.
        """
        colors, _ = self._field.render(camera_tuple(self.sphere, orbit(), (size, size)), None,
                                       self._level("matching"), False, None, True,
                                       _THUMBNAIL_MEMORY)
        return finished_picture(colors, np.uint8, background)

    def player(self, mode: Optional[str] = None, level: LevelName = "finest",
               loading: str = "ahead", horizon: int = 8) -> Player:
        """A player for the frames of a moving camera. It keeps the file open itself.

        loading: "ahead" loads tiles of predicted frames, "demand" those that frames lacked, both
            in the background; with "wait", frames wait for their tiles.
        horizon: frames to load ahead.
        """
        number = self._level(level)
        return Player(self, self._field.player(
            mode, self.finest_level if number is None else number, loading, horizon))

    # -- tiles ------------------------------------------------------------------------------------

    def tiles(self, level: Optional[int] = None, missing: bool = False) -> List[Tile]:
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

    def _cameras(self, cameras: Union[int, Sequence[AnyCamera]], size: Size,
                 distance: float) -> List[Tuple[Any, ...]]:
        finite("distance", distance)
        if isinstance(cameras, int):
            return _slf.random_cameras(self.sphere, distance, cameras, 1, *size)
        return [camera_tuple(self.sphere, camera, size) for camera in cameras]

    def measure(self, cameras: Union[int, Sequence[AnyCamera]] = 8, size: Size = (512, 512),
                mode: Optional[str] = None, levels: Sequence[int] = (), *, distance: float = 3,
                progress: Progress = None) -> Measurement:
        """Measures the memory that views need.

        cameras: a number of random ones at `distance` radii, or a list.
        levels: default: all.
        progress: counts views.
        """
        with reporter(progress, "measure") as report:
            return self._field.measure(self._cameras(cameras, size, distance), mode, list(levels),
                                       report)

    def evaluate(self, scene: Any, cameras: Union[int, Sequence[AnyCamera]] = 8,
                 size: Size = (256, 256), mode: Optional[str] = None,
                 level: LevelName = "finest", *, distance: float = 3, supersample: int = 1,
                 progress: Progress = None, **settings: Unpack[SourceSettings]) -> Evaluation:
        """Compares views with ray-cast ones of the field's scene: PSNR and SSIM, RGB over black.

        scene: what the field was built from.
        settings: say how to read it, as in slf.build(). Light, rays and, unless it is given, the
            transfer function are those of the field; rays have a step of at most 0.5 voxels.
        """
        with scene_of(scene, truth_of=self._field.provenance, **settings) as handle:
            with reporter(progress, "evaluate") as report:
                evaluation = _slf.evaluate(
                    self._field, handle, self._cameras(cameras, size, distance), mode,
                    self._level(level), supersample, report)
        if evaluation.differs:
            warnings.warn(f"{self.path} was built from another source ({evaluation.differs} "
                          "differs): the figures compare two different objects", stacklevel=2)
        return evaluation

    # -- notebooks --------------------------------------------------------------------------------

    def show(self, page: Optional[Path] = None, *, views: AnyViews = None,
             force: bool = False) -> View:
        """The page of `slf view`, turned by the mouse, in a notebook; its `url` for a browser.

        A server on this machine sends the page the parts of the file that views need. It runs
        until the field is closed.
        page: where a browser on another machine cannot reach that server: a file .html beside the
            notebook, to write page and field to and to show.
        views: saved views and notes that the page shows: a file, or what such a file has
            (schemas/views.json).
        force: replace that file, or write into a folder that has files in it.

        Raises slf.UnsupportedError: slf was built without the page. slf.UsageError: `page` exists.
        slf.BadFileError: `views` are none.
        """
        if page is not None:
            export(self, page, views=views, force=force)
            return View(path_text(page))
        if self._server is None or views is not None:
            server = _slf.Server([self.path], *_views(views))
            if self._server is not None:
                self._server.close()
            self._server = server
            _with_threads.add(self)
        return View(self._server.url)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        return None if self._open is None else bundle(self)


class Player:
    """Draws the frames of a moving camera on time. Made by Field.player(). A context manager."""

    def __init__(self, field: Field, player: _slf.Player) -> None:
        self._sphere = field.sphere
        self._player = player
        self.report: Optional[Frame] = None
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
             background: Optional[Sequence[float]] = None,
             tone: Optional[Tone] = None) -> np.ndarray:
        """The next frame, as Field.render(). Draws coarser levels where tiles are not loaded."""
        display = check_dtype(dtype) == np.uint8 or background is not None
        colors, self.report = self._player.draw(camera_tuple(self._sphere, camera, size),
                                                tone, display)
        return finished_picture(colors, dtype, background)

    def settle(self) -> None:
        """Waits until all tiles are loaded that are being loaded."""
        self._player.settle()


_with_threads: "weakref.WeakSet[Union[Field, Player]]" = weakref.WeakSet()


@atexit.register
def _end_threads() -> None:
    """Ends the threads of slf, which must not outlive the interpreter."""
    _slf.stop_calls()
    for owner in list(_with_threads):
        owner.close()


def open(path: Path, *, memory: int = _DEFAULT_MEMORY, threads: int = 0,
         progress: Progress = None) -> Field:
    """Opens a field, complete or not: a file or an address, http:// or https://.

    memory: most bytes of decoded tiles.
    threads: for drawing; 0: all.
    progress: counts the bytes of a remote field that must be fetched whole.

    Raises FileNotFoundError, slf.IoError, slf.BadFileError, slf.UnsupportedError (a newer format).
    """
    return Field(path, memory=memory, threads=threads, progress=progress)


def _reopened(path: Path, memory: int, threads: int) -> Field:
    return Field(path, memory=memory, threads=threads)


def verify(field: Union[Field, Path], *, quick: bool = False, fix: bool = False, threads: int = 0,
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
def _opened(field: Union[Field, Path]) -> Iterator[Field]:
    """A field that is given as a path is open only as long as the call."""
    if isinstance(field, Field):
        yield field
        return
    with Field(field) as mine:
        yield mine


def repack(field: Union[Field, Path], out: Path, *, codec: str = "", depth: bool = True,
           finest_level: Optional[int] = None, subfields: Sequence[int] = (),
           color_type: Optional[str] = None, light: bool = True, memory: int = _DEFAULT_MEMORY,
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


def diff(a: Union[Field, Path], b: Union[Field, Path], *, threads: int = 0,
         progress: Progress = None) -> Difference:
    """Compares two fields tile by tile."""
    with _opened(a) as left, _opened(b) as right, reporter(progress, "diff") as report:
        return _slf.diff(left._field, right._field, threads, report)


def _views(views: AnyViews) -> Tuple[str, Optional[str]]:
    """A name for messages, and JSON, or None for the file of that name."""
    if views is None:
        return "", None
    return ("views", json.dumps(views)) if isinstance(views, dict) else (path_text(views), None)


def export(field: Union[Field, Path], out: Path, *, views: AnyViews = None, force: bool = False,
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
