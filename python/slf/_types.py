"""Values that slf takes and returns: named tuples."""

from __future__ import annotations

from typing import Any, NamedTuple, Sequence

import numpy as np

from . import _reports
from ._errors import UsageError
from ._reports import (BuildReport, ChannelDifference, Content, Difference, Evaluation,
                       ExportReport, Finding, Frame, Level, LevelMeasure, MeanAndMax, Measurement,
                       MergeReport, PickedPoint, RepackReport, Tile, TileAddress, ViewQuality)

Point = tuple[float, float, float]


def point(values: Sequence[float]) -> Point:
    x, y, z = values
    return float(x), float(y), float(z)


def finite(name: str, values: Any) -> None:
    """Raises UsageError for NaN and infinities, which comparisons do not stop."""
    if not np.isfinite(np.asarray(values, float)).all():
        raise UsageError(f"{name} {values}: expected finite numbers")


class Sphere(NamedTuple):
    """The sphere around the object, in world units. World coordinates are LPS, mostly in mm."""

    center: Point
    radius: float


class Orbit(NamedTuple):
    """A camera that looks at the centre of a field's sphere. See orbit()."""

    azimuth: float
    elevation: float
    distance: float


def orbit(azimuth: float = 30, elevation: float = 20, distance: float = 3) -> Orbit:
    """A camera that looks at the centre of the sphere, which fits the picture from 3 radii.

    azimuth: degrees; 0 is the front (-y, anterior), 90 the patient's left (+x).
    elevation: degrees; 90 is above (+z).
    distance: from the centre, in radii of the sphere, above 0.

    >>> orbit(30, 20, 3)
    Orbit(azimuth=30, elevation=20, distance=3)
    """
    return Orbit(azimuth, elevation, distance)


class Camera(NamedTuple):
    """A pinhole camera with square pixels, in world coordinates."""

    eye: Point
    look_at: Point
    up: Point = (0.0, 0.0, 1.0)
    fov: float = 40.0
    """Vertical field of view in degrees, above 0 and below 180."""


class Look(NamedTuple):
    """How a structure is drawn together with others."""

    opacity: float = 1.0
    """0, hidden, to 1."""
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """RGB, each 0 to 1: its own colours are multiplied by this."""


class Tone(NamedTuple):
    """How pictures show linear radiance, of fields built with color_type="half" and light."""

    exposure: float = 0.0
    """In stops: radiance is multiplied by 2^exposure."""
    curve: str = "neutral"
    """"neutral", "srgb" or "none"."""


class Shape(NamedTuple):
    """How a field samples its sphere. Level l has entry_side·2^l and exit_side·2^l cells."""

    sphere: Sphere
    entry_side: int
    exit_side: int
    finest_level: int
    """Levels 0 to this are stored."""
    entry_extra_levels: int
    subfields: tuple[int, ...]
    """The level-0 subfields of the field; empty: all 64."""


class Picture(NamedTuple):
    """A picture with depths."""

    rgba: np.ndarray
    """[height, width, 4], premultiplied."""
    depth: np.ndarray
    """float32 [height, width]: distance from the eye in world units, infinite where nothing is."""


class Rays(NamedTuple):
    """Rays and what they see: arrays [entry vertices, exit vertices, ...]."""

    origins: np.ndarray
    """float64 [..., 3]: where they enter the sphere, in world units."""
    directions: np.ndarray
    """float64 [..., 3]: from there to where they leave it; 0 where these are one point."""
    rgba: np.ndarray
    """float32 [..., 4], 0 to 1 and premultiplied; linear radiance may exceed 1."""
    depth: np.ndarray | None
    """float32 [...]: what is visible is at origins + depth · directions, on average. Any value
    where alpha is 0. None: the field has no depths."""


class VerifyReport(_reports.VerifyReport):
    __slots__ = ()

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return self.found == 0
