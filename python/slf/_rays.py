"""Rays from functions and classes of Python, in this process or in several."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Callable, Iterator, Mapping

import numpy as np

from . import _slf
from ._errors import UsageError
from ._types import Sphere, finite, point

Trace = Callable[[np.ndarray, np.ndarray], Any]


class Scene:
    """Rays from anywhere: subclass it, and pass an instance to slf.build() or slf.raycast().

    >>> class Fog(Scene):
    ...     sphere = Sphere((0, 0, 0), 1)
    ...     def trace(self, origins, targets):
    ...         thickness = np.linalg.norm(targets - origins, axis=1)
    ...         return np.repeat(1 - np.exp(-thickness)[:, None], 4, axis=1)
    >>> import slf
    >>> slf.raycast(Fog(), size=(32, 32))[16, 16].round(2)
    array([0.86, 0.86, 0.86, 0.86], dtype=float32)
    """

    sphere: Sphere
    """Around everything visible, in world units."""

    batch: int = 65536
    """The most rays of one call of trace()."""

    processes: int = 0
    """Above 0: trace() is called in so many processes, which are forked when the build begins, one
    batch each at a time. 0: in this process, one batch at a time."""

    provenance: Mapping[str, Any] = {}
    """What the rays depend on, for the field's manifest, as JSON. A build is resumed only if it is
    equal; so name here what distinguishes this scene from others of its class."""

    def trace(self, origins: np.ndarray, targets: np.ndarray) -> Any:
        """The rays from origins to targets, both float64 [n, 3], world points on the sphere.

        Returns rgba [n, 4], 0 to 1 and premultiplied by alpha; or (rgba, depth), where depth [n]
        is the mean position of what is visible, 0 at the origin, 1 at the target. Without depths,
        it is taken as 0.5. The rays of a call mostly have one origin. Must be deterministic. It is
        called on threads of slf, one at a time.
        """
        raise NotImplementedError


class Function(Scene):
    """A function of rays as a scene."""

    def __init__(self, fn: Trace, sphere: Any, batch: int, processes: int,
                 provenance: Mapping[str, Any]) -> None:
        center, radius = sphere
        self.trace = fn  # type: ignore[assignment]
        self.sphere = Sphere(center, radius)
        self.batch = batch
        self.processes = processes
        self.provenance = {"name": _name(fn), **provenance}


def _name(thing: Any) -> str:
    return f"{getattr(thing, '__module__', '')}.{getattr(thing, '__qualname__', repr(thing))}"


@contextlib.contextmanager
def ray_scene(scene: Scene) -> Iterator[_slf.Scene]:
    """A scene of Python as one of the extension module."""
    center, radius = scene.sphere
    finite("sphere", (*center, radius))
    if not radius > 0:
        raise UsageError(f"sphere {scene.sphere}: expected (center, radius) with a radius above 0")
    if scene.batch < 1:
        raise UsageError(f"batch {scene.batch}: expected at least 1")
    record = {"kind": "rays", "name": _name(type(scene)), **scene.provenance}
    with _called_in(scene.processes, scene.trace) as trace:
        yield _slf.ray_scene(trace, Sphere(point(center), float(radius)),
                             json.dumps(record, sort_keys=True), scene.batch, scene.processes > 0)


# ---- several processes ---------------------------------------------------------------------------

_trace: Trace  # in a process of the pool


def _begin(trace: Trace) -> None:
    global _trace
    _trace = trace
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the build ends on it, and then the pool


def _traced(origins: np.ndarray, targets: np.ndarray) -> Any:
    return _trace(origins, targets)


@contextlib.contextmanager
def _called_in(processes: int, trace: Trace) -> Iterator[Trace]:
    """A function that calls `trace` in a pool of processes; `trace` itself for 0."""
    if processes == 0:
        yield trace
        return
    # Forked, so that a function of a notebook need not be importable.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("fork"), _begin,
                             (trace,)) as pool:
        pool.submit(int).result()  # begins all, while no thread of the build runs
        yield lambda origins, targets: pool.submit(_traced, origins, targets).result()
