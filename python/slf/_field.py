"""Reading fields."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import re
import warnings
import weakref
from operator import attrgetter
from typing import Any, Callable, Literal, Mapping, Sequence, Union, Unpack, overload

import numpy as np

from . import _slf
from ._errors import UsageError
from ._notebook import View, bundle, server_base
from ._progress import Progress, reporter
from ._source import SourceSettings, described, recipe_of
from ._types import (BuildReport, Camera, Content, Difference, Evaluation, ExportReport, Frame,
                     Look, Measurement, MergeReport, Orbit, PickedPoint, Picture, Rays,
                     RepackReport, Shape, Sphere, Tile, Tone, VerifyReport, finite, orbit)

Path = str | os.PathLike[str]
Array = np.ndarray[Any, Any]
AnyCamera = Orbit | Camera
Size = tuple[int, int]
LevelName = int | str
State = int | str
"""The number of a state, from 0, or its name."""
Structures = Mapping[Union["Field", Path], float | Look] | Sequence[Path]
"""Names of a field's states, patterns such as "left *", or fields or paths of others on its sphere,
with an opacity, 0 to 1, or a Look of each; or a list of texts such as "left *:0.3:#ffd0b0", as
`slf render --structure` takes them. Later ones replace earlier ones of the same state."""
Planes = Sequence[tuple[Sequence[float], Sequence[float]] | Sequence[float]]
"""(point, normal) of each, or the six numbers."""
AnyViews = Path | dict[str, Any] | None

_DEFAULT_MEMORY = 256 << 20
_THUMBNAIL_MEMORY = 16 << 20


def finished_picture(rgba: Array, dtype: Any,
                     background: Sequence[float] | None) -> Array:
    """Composites over a background and converts to the type that was asked for."""
    if background is not None:
        finite("background", background)
        rgba[..., :3] += (1 - rgba[..., 3:]) * np.asarray(background, np.float32)
        rgba[..., 3] = 1
    if np.dtype(dtype) == np.uint8:
        return (np.clip(rgba, 0, 1) * 255 + 0.5).astype(np.uint8)
    return rgba


def check_dtype(dtype: Any) -> np.dtype[Any]:
    if np.dtype(dtype) not in (np.float32, np.uint8):
        raise UsageError(f"dtype {dtype}: expected float32 or uint8")
    return np.dtype(dtype)


def _fact(name: str, doc: str, of: Callable[[Any], Any] = lambda value: value) -> Any:
    """A property of Field that the extension module has."""
    return property(lambda self: of(attrgetter(name)(self._field)), doc=doc)


def _looks(structures: Structures) -> list[Any]:
    """Structures as the extension module takes them, which later changes leave as they are."""
    if isinstance(structures, (str, os.PathLike)):
        return [structures]
    if not isinstance(structures, Mapping):
        return list(structures)
    return [(key._field if isinstance(key, Field) else key, float(opacity), tuple(map(float, tint)))
            for key, look in structures.items()
            for opacity, tint in [look if isinstance(look, Look) else Look(look)]]


def _absolute(path: Path) -> Path:
    """A path that another working folder leaves as it is; an address as it is."""
    text = os.fsdecode(path)
    return path if re.match("https?://", text, re.I) else os.path.abspath(text)


class Field:
    """An open sphere light field: a snapshot of its file, read-only.

    Opened by slf.open() and slf.build(). A context manager. Any thread may use it; one view is
    drawn at a time. Pictures and tiles outlive it. Pickled by path.

    A field of structures (slf.build(each_label=True)) is drawn, measured and evaluated with all of
    them, unless structures= or state= choose others; of other fields with states, the first one is.
    """

    def __init__(self, path: Path, *, memory: int = _DEFAULT_MEMORY, threads: int = 0,
                 state: State | None = None, cache: Path = "", cache_size: int = 1 << 30,
                 progress: Progress = None) -> None:
        self._open: _slf.Field | None = None
        path, cache = _absolute(path), cache and os.path.abspath(os.fsdecode(cache))
        self._opened_with = (path, memory, threads, state, cache, cache_size)
        self._structures: Structures | None = None
        self._composed: tuple[list[Any] | None, _slf.Field] | None = None
        self._others: dict[State, Field] = {}
        self._servers: dict[str, _slf.Server] = {}
        with reporter(progress, "fetch") as report:
            self._open = _slf.Field(*self._opened_with, report)
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
        while self._servers:
            self._servers.popitem()[1].close()

    @property
    def closed(self) -> bool:
        return self._open is None

    def __enter__(self) -> Field:
        self._field
        return self

    def __exit__(self, *raised: Any) -> None:
        self.close()

    def __reduce__(self) -> Any:
        """Pickled by path: where it is unpickled, the file is opened again."""
        return _reopened, (self._opened_with, self._structures)

    def __repr__(self) -> str:
        if self._open is None:
            return "<slf.Field, closed>"
        states = f", {len(self.states)} states" if self.states else ""
        return f"<slf.Field {self.path!r}, levels 0 to {self.finest_level}{states}>"

    # -- content ----------------------------------------------------------------------------------

    path: str = _fact("path", "The file or address that was opened.")
    shape: Shape = _fact("shape", "How it samples its sphere.")
    sphere: Sphere = _fact("shape.sphere", "Around the object, in world units.")
    finest_level: int = _fact("shape.finest_level", "Levels 0 to this can be drawn.")
    format: str = _fact("format", '''Of samples: "rgba8", "rgba16f", "rgba8_depth8" or
        "rgba16f_depth8".''')
    codec: str = _fact("codec", "As in slf.build().")
    has_depth: bool = _fact("has_depth", "Whether depths are stored beside colours.")
    linear: bool = _fact("linear", "Whether colours are linear radiance, to be tone-mapped.")
    file_bytes: int = _fact("file_bytes", "The size of the file.")
    states: tuple[str, ...] = _fact("states", """The names of the states, variants of the object
        that the file holds; () if there is just one.""")
    state: int = _fact("state", "The state that this shows; 0 unless another was asked for.")
    manifest: Any = _fact("manifest", "The manifest, parsed (FORMAT.md).", json.loads)
    provenance: Any = _fact("provenance", "The source and settings of the build.", json.loads)

    def in_state(self, state: State) -> Field:
        """The same file in another state, by its name or number: a field of its own. What of it was
        drawn last is in memory, in place of what the others drew. Later calls return the same one.
        slf.UsageError: there is none."""
        other = self._others.get(state)
        if other is None or other.closed:
            other = self._others[state] = self._variant(self._field.in_state(state), None)
            other._opened_with = (*self._opened_with[:3], state, *self._opened_with[4:])
        return other

    def _variant(self, opened: _slf.Field, structures: Structures | None) -> Field:
        """A field that shows something else of the same file."""
        other = object.__new__(Field)
        other.__dict__.update(self.__dict__, _open=opened, _structures=structures, _composed=None,
                              _others={}, _servers={})
        return other

    def _drawn(self, state: State | None, structures: Structures | None) -> _slf.Field:
        """What calls with these arguments draw."""
        if structures is None:
            if state is not None:
                return self.in_state(state)._field
            if self._structures is not None or self._opened_with[3] is not None or not self.states:
                return self._field
        looks = None if structures is None else _looks(structures)
        composed = self._composed  # another thread may replace it
        if composed is None or composed[0] != looks:
            composed = self._composed = looks, self._field.compose(looks)
        return composed[1]

    def content(self) -> Content:
        """Counts the tiles and bytes of each level, of this state.

        Raises slf.BadFileError: a table is damaged."""
        return self._field.content()

    # -- pictures ---------------------------------------------------------------------------------

    def camera(self, camera: AnyCamera, size: Size = (512, 512)) -> Camera:
        """The camera that an orbit stands for, for a picture of this size."""
        return self._field.camera(camera, size)  # type: ignore[no-any-return]

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
               level: LevelName = ..., *, depth: Literal[False] = ..., dtype: Any = ...,
               background: Sequence[float] | None = ..., tone: Tone | None = ...,
               state: State | None = ...,
               structures: Structures | None = ..., clip: Planes = ...,
               cap: str = ...) -> Array: ...

    @overload
    def render(self, camera: AnyCamera = ..., size: Size = ..., mode: str | None = ...,
               level: LevelName = ..., *, depth: Literal[True], dtype: Any = ...,
               background: Sequence[float] | None = ..., tone: Tone | None = ...,
               state: State | None = ..., structures: Structures | None = ...,
               clip: Planes = ..., cap: str = ...) -> Picture: ...

    def render(self, camera: AnyCamera = orbit(), size: Size = (512, 512),
               mode: str | None = None, level: LevelName = "finest", *, depth: bool = False,
               dtype: Any = np.float32, background: Sequence[float] | None = None,
               tone: Tone | None = None, state: State | None = None,
               structures: Structures | None = None, clip: Planes = (), cap: str = "") -> Any:
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
        state: that of in_state(); default: the one that this shows, or all structures.
        structures: what to draw together instead, as for compose(). The last ones stay open.
        clip: planes as (point, normal), up to six, each of which removes what lies on the side that
            its normal points to. Needs mode "depth".
        cap: what they lay open: "shaded", under its own light; "coarse", the same by a tenth of the
            work; "slice", the scan's values in grey, "slice:LO,HI" with a window; "hollow",
            nothing.
            All but "hollow" need a reveal; default: "shaded", or else "hollow". The last cut stays
            in memory, and takes as much again as `memory` of slf.open() says.

        Raises slf.UsageError for an invalid camera, level, mode or state, slf.BadFileError for a
        damaged tile.
        """
        display = check_dtype(dtype) == np.uint8 or background is not None
        colors, distance = self._drawn(state, structures).render(
            camera, size, mode=mode, level=self._level(level), depth=depth, tone=tone,
            display=display, clip=clip, cap=cap)
        picture = finished_picture(colors, dtype, background)
        return Picture(picture, distance) if depth else picture

    def compose(self, structures: Structures) -> Field:
        """The field that shows structures together, in place of what this one shows: along each
        stored ray, the nearest over those behind it.

        structures: names of this field's states, or fields or paths of others on its sphere, and
            an opacity, 0 to 1, or a Look of each; or texts as of `slf render --structure`. Those of
            opacity 0 are not read. At one depth, states are in front, in their order.

        It is drawn, played, measured and evaluated as others are; its page begins with these
        structures, if all are of this field.
        Raises slf.UsageError for structures without depth, or on another sphere or lattice, or with
        another kind of colours, and for a name that neither a state nor a file has.
        """
        kept: Structures = (dict(structures) if isinstance(structures, Mapping)
                            else _looks(structures))
        return self._variant(self._field.compose(_looks(kept)), kept)

    def pick(self, x: float, y: float, camera: AnyCamera = orbit(),
             size: Size = (512, 512), *, state: State | None = None,
             structures: Structures | None = None, clip: Planes = (),
             cap: str = "") -> PickedPoint | None:
        """The point of the surface that a picture shows at a place; None if it is less than half
        opaque there.

        x, y: in pixels from the upper left corner; centres of pixels are at halves.
        camera, size, state, structures, clip, cap: of the picture, as in render().

        Raises slf.UsageError for a place outside the picture, and for a field without depths.
        """
        return self._drawn(state, structures).pick(x, y, camera, size, clip, cap)

    def reveal(self) -> tuple[Array, Array] | None:
        """The small copy of the volume that the field keeps for cuts: its values [z, y, x], and the
        4×4 affine from the indices (x, y, z) of a voxel to the world. None: it keeps none, or that
        of another state's volume."""
        found = self._field.reveal()
        if found is None:
            return None
        stored, slope, intercept, labels, columns = found
        affine = np.eye(4)
        affine[:3] = np.transpose(columns)
        if labels:
            return stored.astype(np.int64), affine
        return (stored * slope + intercept).astype(np.float32), affine

    def add_reveal(self, source: Any, size: int = 192, window: tuple[float, float] | None = None,
                   **settings: Any) -> None:
        """Adds the small copy of the volume that cuts show the inside of, 8 bits a voxel.

        source, settings: the volume that the field was built from, as for slf.build().
        size: voxels along the longest side.
        window: keep these values, all of them; default: voxels that touch nothing visible are left
            out. It publishes the scan: see doc/cut.md.

        Other open fields do not see it. slf.UsageError: it is another volume.
        """
        given: dict[str, Any] = {"reveal": size, **settings}
        if window is not None:
            given["reveal_window"] = f"{float(window[0])!r},{float(window[1])!r}"
        _slf.add_reveal(self._opened_with[0],
                        recipe_of({"source": source, **given}, False, None, [], {}))
        self.close()
        self._open = _slf.Field(*self._opened_with)

    def thumbnail(self, size: int = 256, background: Sequence[float] | None = (0, 0, 0), *,
                  camera: AnyCamera = orbit(), state: State | None = None,
                  structures: Structures | None = None) -> Array:
        """A small picture: uint8 [size, size, 4]. Reads coarse tiles, and keeps none.

        camera, state, structures: as in render().
        """
        colors, _ = self._drawn(state, structures).render(
            camera, (size, size), display=True, memory=_THUMBNAIL_MEMORY)
        return finished_picture(colors, np.uint8, background)

    def player(self, mode: str | None = None, level: LevelName = "finest", loading: str = "ahead",
               horizon: int = 8, *, state: State | None = None,
               structures: Structures | None = None, clip: Planes = (), cap: str = "") -> Player:
        """A player for the frames of a moving camera. It keeps the file open itself.

        loading: "ahead" loads tiles of predicted frames, "demand" those that frames lacked, both
            in the background; with "wait", frames wait for their tiles.
        horizon: frames to load ahead.
        mode, level, state, structures, clip, cap: as in render().
        """
        number = self._level(level)
        return Player(self._drawn(state, structures), mode,
                      self.finest_level if number is None else number, loading, horizon, clip, cap)

    # -- tiles ------------------------------------------------------------------------------------

    def tiles(self, level: int | None = None, missing: bool = False) -> list[Tile]:
        """Lists tiles in key order. Reads tables, no payload.

        level: of one level; default: of all.  missing: also list tiles that are missing.
        """
        return self._field.tiles(level or 0, level, missing)

    def tile(self, level: int, entry: int, exit: int, channel: str = "color") -> Array:
        """The samples of a tile: [entry vertices, exit vertices, 4] of premultiplied RGBA, uint8 or
        float16; or [entry vertices, exit vertices] of depth, uint8, 0 at entry, 255 at exit.

        A read-only view of the decoded tile, which stays in memory as long as the array. Exit
        vertices are in the order of FORMAT.md.
        Raises slf.UsageError: no such tile or channel; slf.FailedError: it was never built;
        slf.BadFileError: it is damaged.
        """
        return self._field.tile(level, entry, exit, channel)

    def rays(self, level: int, entry: int, exit: int) -> Rays:
        """The rays of a tile, as a scene is asked for them, and their samples, as of tile().

        On the finest level that was built, a sample is what the ray sees; on coarser ones, a mean
        of rays around it, with the same origin and ends near to its own.
        Raises what tile() raises.
        """
        origins, targets = self._field.rays(level, entry, exit)
        origins, targets = np.broadcast_arrays(origins[:, None], targets)
        color = self.tile(level, entry, exit)
        scale = np.float32(255 if color.dtype == np.uint8 else 1)
        depth = self.tile(level, entry, exit, "depth") / np.float32(255) if self.has_depth else None
        return Rays(origins, targets - origins, np.divide(color, scale, dtype=np.float32), depth)

    # -- measures ---------------------------------------------------------------------------------

    def measure(self, cameras: int | Sequence[AnyCamera] = 8, size: Size = (512, 512),
                mode: str | None = None, levels: Sequence[int] = (), *, distance: float = 3,
                state: State | None = None, structures: Structures | None = None,
                clip: Planes = (), cap: str = "", progress: Progress = None) -> Measurement:
        """Measures the memory that views need.

        cameras: a number of random ones at `distance` radii, or a list.
        levels: default: all.
        mode, state, structures, clip, cap: as in render().
        progress: counts views.
        """
        with reporter(progress, "measure") as report:
            return self._drawn(state, structures).measure(
                cameras, size, distance, mode, levels, clip, cap, report)

    def evaluate(self, scene: Any, cameras: int | Sequence[AnyCamera] = 8, size: Size = (256, 256),
                 mode: str | None = None, level: LevelName = "finest", *, distance: float = 3,
                 supersample: int = 1, state: State | None = None,
                 structures: Structures | None = None, cap: str = "", progress: Progress = None,
                 **settings: Unpack[SourceSettings]) -> Evaluation:
        """Compares views with ray-cast ones of the field's scene: PSNR and SSIM, RGB over black.

        scene: what the field was built from.
        mode, level, state, structures, cap: as in render().
        settings: say how to read it, as in slf.build(). The planes of `clip` cut the field's views,
            too, but for those that it was built with. Light, rays and, unless it is given, the
            transfer function are those of the field; rays have a step of at most 0.5 voxels.
        """
        drawn = self._drawn(state, structures)
        with contextlib.ExitStack() as stack, reporter(progress, "evaluate") as report:
            clip = [np.ravel(plane).tolist() for plane in settings.pop("clip", None) or ()]
            if clip:
                settings["clip"] = clip
            _, [(_, truth)] = described(stack, scene, settings, known=SourceSettings,
                                        truth_of=drawn.provenance)
            evaluation = _slf.evaluate(drawn, truth, cameras, size, distance, mode,
                                       self._level(level), supersample, clip, cap,
                                       report)
        if evaluation.differs:
            warnings.warn(f"{self.path} was built from another source ({evaluation.differs} "
                          "differs): the figures compare two different objects", stacklevel=2)
        return evaluation

    # -- notebooks --------------------------------------------------------------------------------

    def _first(self, state: State | None, structures: Structures | None) -> tuple[str, list[Any]]:
        """What a page shows first, as the extension module takes it."""
        structures = self._structures if structures is None else structures
        if state is None and structures is None:
            state = self._opened_with[3]
        return "" if state is None else str(state), _looks(structures or ())

    def show(self, page: Path | None = None, *, views: AnyViews = None, state: State | None = None,
             structures: Structures | None = None, force: bool = False) -> View:
        """The page of `slf view`, turned by the mouse, in a notebook; its `url` for a browser.

        The notebook gets a field of at most 2 MiB whole, and so keeps it. Of a larger one, it keeps
        a picture: a server on this machine sends the page the parts of the file that views need,
        until the field is closed. Where the notebook's server is on another machine than the
        browser, jupyter-server-proxy leads there; without it, the notebook gets a field of at most
        20 MiB whole.
        page: a file .html beside the notebook, to write page and field to and to show.
        views: saved views and notes that the page shows: a file, or what such a file has
            (schemas/views.json).
        state, structures: what the page shows first, as in render(); of this field only.
        force: replace that file, or write into a folder that has files in it.

        Raises slf.UnsupportedError: slf was built without the page. slf.UsageError: `page` exists,
        or there is no such state or structure. slf.BadFileError: `views` are none.
        """
        shown = dict(views=views, state=state, structures=structures)
        if page is not None:
            export(self, page, views=views, state=state, structures=structures, force=force)
            return View(os.fspath(page), self, shown)
        first = self._first(state, structures)
        key = repr((views, first))
        if key not in self._servers or isinstance(views, (str, os.PathLike)):
            # A proxy passes on the name of its own host.
            server = _slf.Server(self.path, views, server_base() is not None, *first)
            if key in self._servers:
                self._servers[key].close()
            self._servers[key] = server
            _with_threads.add(self)
        return View(self._servers[key].url, self, shown)

    def widget(self, camera: AnyCamera = orbit(), *, state: State | None = None,
               structures: Structures | None = None, clip: Planes = (), cap: str = "",
               height: int = 540) -> Any:
        """The page as a widget, whose traits camera, state, structures, clip, cap and picked change
        with what its reader does, and change what it shows.

        It needs no address: scripts and tiles are messages of the kernel, which also pass hubs and
        tunnels. So it loads while no cell runs. In Notebook 6 nothing else is needed; elsewhere,
        anywidget. A saved notebook keeps a picture of the first view.
        camera, state, structures, clip, cap: what it shows first, as in render(); of this field
            only.
        height: in pixels.

        Raises slf.UnsupportedError: slf was built without the page. slf.UsageError: the field is
        not a file of this machine, or there is no such structure.
        """
        from ._widget import Widget
        if "://" in self.path:
            raise UsageError(f"{self.path}: widgets show files of this machine, such as slf.repack "
                             "makes")
        text, looks = self._first(state, structures)
        return Widget(self, camera=camera, state=text, structures=looks, clip=clip, cap=cap,
                      height=height)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        return None if self._open is None else bundle(self)


class Player(_slf.Player):
    """Draws the frames of a moving camera on time. Made by Field.player(). A context manager."""

    report: Frame | None = None
    """How the last frame was drawn."""

    def __init__(self, *played: Any) -> None:
        super().__init__(*played)
        _with_threads.add(self)

    def draw(self, camera: AnyCamera, size: Size = (512, 512), dtype: Any = np.float32,
             background: Sequence[float] | None = None, tone: Tone | None = None) -> Array:
        """The next frame, as Field.render(). Draws coarser levels where tiles are not loaded."""
        display = check_dtype(dtype) == np.uint8 or background is not None
        colors, self.report = super().drawn(camera, size, tone, display)
        return finished_picture(colors, dtype, background)


_with_threads: "weakref.WeakSet[Field | Player]" = weakref.WeakSet()


@atexit.register
def _end_threads() -> None:
    """Ends the threads of slf, which must not outlive the interpreter."""
    _slf.stop_calls()
    for owner in list(_with_threads):
        owner.close()


def open(path: Path, *, memory: int = _DEFAULT_MEMORY, threads: int = 0,
         state: State | None = None, cache: Path = "", cache_size: int = 1 << 30,
         progress: Progress = None) -> Field:
    """Opens a field, complete or not: a file or an address, http:// or https://.

    memory: most bytes of decoded tiles.
    threads: for drawing; 0: all.
    state: which of the field's states to show; default: the first, or all that are structures.
    cache: a folder that keeps what is read of a remote field for later programs, and cache_size
        bytes of it, the most recently used.
    progress: counts the bytes of a remote field that must be fetched whole.

    Raises FileNotFoundError, slf.IoError, slf.BadFileError, slf.UnsupportedError (a newer format).
    """
    return Field(path, memory=memory, threads=threads, state=state, cache=cache,
                 cache_size=cache_size, progress=progress)


def _reopened(opened_with: tuple[Any, ...], structures: Structures | None) -> Field:
    path, memory, threads, state, cache, cache_size = opened_with
    field = open(path, memory=memory, threads=threads, state=state, cache=cache,
                 cache_size=cache_size)
    return field if structures is None else field.compose(structures)


def verify(field: Field | Path, *, quick: bool = False, fix: bool = False,
           memory: int = _DEFAULT_MEMORY, threads: int = 0,
           progress: Progress = None) -> VerifyReport:
    """Checks every page, record and tile. Damage is a finding in the report, not an exception.

    quick: structure and counts only.  fix: drop damaged tiles, so that a build makes them again.
    """
    path, handle = (field.path, field._field) if isinstance(field, Field) else (field, None)
    with reporter(progress, "verify") as report:
        return _slf.verify(path, None if fix else handle, report, quick=quick, fix=fix,
                           memory=memory, threads=threads)


def _opened(field: Field | Path) -> contextlib.AbstractContextManager[Field]:
    """A field that is given as a path is open only as long as the call."""
    if isinstance(field, Field):
        return contextlib.nullcontext(field)
    return Field(field)


def repack(field: Field | Path | Sequence[Field | Path], out: Path, *,
           states: Sequence[State] = (), codec: str = "", depth: bool = True,
           finest_level: int | None = None, subfields: Sequence[int] = (),
           color_type: str | None = None, light: bool = True, reveal: bool = True, memory: int = 0,
           threads: int = 0, force: bool = False, progress: Progress = None) -> RepackReport:
    """Rewrites a field into another form. Empty arguments keep what the field has.

    field: several make one whose states they are, named after their files, and the states in them.
    states: those to keep; default: all, or the one of Field.in_state().
    codec, depth: as in slf.build().  finest_level: the finest to keep.
    color_type: "u8" or "half".  progress: counts tiles.
    light, reveal: keep the scene's light, and the copy of the volume that cuts show.
    memory: most bytes of tiles and records under way; 0: 256 MiB, or what the largest tile needs.
    """
    half = None if color_type is None else is_half(color_type)
    given = field if isinstance(field, (list, tuple)) else [field]
    with contextlib.ExitStack() as stack, reporter(progress, "repack") as report:
        opened = [stack.enter_context(_opened(one)) for one in given]
        sources = [(one._field, [str(state) for state in states or (one._opened_with[3],)
                                 if state is not None]) for one in opened]
        done = _slf.repack(
            sources, out, report, codec=codec, depth=depth, finest_level=finest_level,
            subfields=sorted(subfields), half=half, light=light, reveal=reveal, memory=memory,
            threads=threads, force=force)
    return done  # type: ignore[no-any-return]


def merge(parts: Sequence[Path], out: Path, *, part: bool = False, memory: int = 0,
          threads: int = 0, force: bool = False, progress: Progress = None) -> MergeReport:
    """Joins parts of a field: shards, levels or subfields.  part: the result may be a part.

    memory: as in repack().
    """
    with reporter(progress, "merge") as report:
        return _slf.merge(parts, out, report, part=part, memory=memory, threads=threads,
                          force=force)


def diff(a: Field | Path, b: Field | Path, *, threads: int = 0,
         progress: Progress = None) -> Difference:
    """Compares two fields tile by tile, in all states unless a state was chosen of one."""
    with _opened(a) as left, _opened(b) as right, reporter(progress, "diff") as report:
        all_states = left._opened_with[3] is None and right._opened_with[3] is None
        return _slf.diff(left._field, right._field, threads, all_states, report)


def export(field: Field | Path, out: Path, *, views: AnyViews = None, state: State | None = None,
           structures: Structures | None = None, states: Sequence[State] = (), codec: str = "",
           depth: bool = True, reveal: bool = True, finest_level: int | None = None,
           max_size: int = 0, title: str = "", url: str = "", threads: int = 0, force: bool = False,
           progress: Progress = None) -> ExportReport:
    """Writes the page that shows a field together with it.

    out: a path that ends in .html or .htm becomes one file, which opens from disk (fields up to
        1 GiB); any other a folder for a host of static files.
    views, state, structures: as in Field.show().
    states, codec, depth, reveal, finest_level: what to keep, as in repack(): of a field that
        Field.in_state() made, that state alone.
    max_size: bytes; chooses quality and levels so that the page fits. 0: no limit.
    title: what the page says it shows; in place of that of `views` ("about").
    url: where the page will be, for the pictures of links to it in other programs.
    force: replace that file, or write into a folder that has files in it.
    progress: counts tiles that are encoded, then bytes.

    Raises slf.UsageError: `out` exists, there is no such state or structure, or nothing fits.
    slf.BadFileError: `views` are none.
    """
    with _opened(field) as source, reporter(progress, "export") as report:
        first, own = source._first(state, structures), source._opened_with[3]
        if own is not None and source._structures is state is structures is None and not states:
            first, states = ("", []), [own]
        return _slf.export_field(
            source.path, out, views, *first, report, states=[str(one) for one in states],
            codec=codec, depth=depth, reveal=reveal, finest_level=finest_level, max_size=max_size,
            title=title, url=url, threads=threads, force=force)


def is_half(color_type: str) -> bool:
    if color_type not in ("u8", "half"):
        raise UsageError(f"color_type {color_type!r}: expected 'u8' or 'half'")
    return color_type == "half"
