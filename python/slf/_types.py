"""Values that slf takes and returns: named tuples."""

from __future__ import annotations

from typing import Any, NamedTuple, Sequence

import numpy as np

from ._errors import UsageError

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


class Level(NamedTuple):
    """How much of a level exists."""

    level: int
    tiles: int
    stored: int
    """Tiles with a payload."""
    empty: int
    """Tiles that were built and show nothing."""
    slabs: int
    """Rays of the level."""
    payload_bytes: int


class Content(NamedTuple):
    levels: tuple[Level, ...]
    complete: bool
    """No tile of the field, or of its part, is missing."""
    file_bytes: int
    payload_bytes: int


class Tile(NamedTuple):
    level: int
    entry: int
    """Index of the entry section."""
    exit: int
    """Index of the exit section."""
    content: str
    """"stored", "empty" or "missing"."""
    payload_bytes: int
    offset_bytes: int
    """Of the payload in the file; 0 without a payload."""


class Picture(NamedTuple):
    """A picture with depths."""

    rgba: np.ndarray
    """[height, width, 4], premultiplied."""
    depth: np.ndarray
    """float32 [height, width]: distance from the eye in world units, infinite where nothing is."""


class PickedPoint(NamedTuple):
    """A point of the surface that a picture shows."""

    point: Point
    """In world units."""
    depth: float
    """Its distance from the eye, in world units."""
    uncertainty: float
    """The standard deviation of the depth, in world units."""


class Finding(NamedTuple):
    kind: str
    """S1, M1, R1, K1, T1, T2, T3 or C1, as `slf verify` prints them."""
    message: str


class VerifyReport(NamedTuple):
    findings: tuple[Finding, ...]
    """The first 1000."""
    found: int
    damaged: int
    """Of `found`: damage, not only missing tiles."""
    unfixed: int
    tiles: int
    payload_bytes: int
    dropped: int
    complete: bool

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return self.found == 0


class MeanAndMax(NamedTuple):
    mean: float
    max: float


class LevelMeasure(NamedTuple):
    """What views of one level need; means and maxima over the views."""

    level: int | None
    """None: the sum over all levels."""
    tiles: int
    tiles_touched: MeanAndMax
    pairs_crossed: MeanAndMax
    compressed_bytes: MeanAndMax
    map_pages: MeanAndMax
    """4 KiB pages of the file."""
    decoded_peak_bytes: MeanAndMax
    fraction: MeanAndMax
    """tiles_touched / tiles."""
    pair_fraction: MeanAndMax


class Measurement(NamedTuple):
    levels: tuple[LevelMeasure, ...]
    total: LevelMeasure
    rss_anon_peak: int
    """Bytes."""
    rss_file_peak: int
    """Bytes: mapped pages of files."""


class Evaluation(NamedTuple):
    psnr: float
    """In dB: the mean of the views'."""
    ssim: float
    views: tuple[tuple[float, float], ...]
    """PSNR and SSIM of each view."""
    differs: str
    """Where the field's provenance is not that of the scene, as a JSON pointer; else empty."""


class BuildReport(NamedTuple):
    tiles: int
    """Built by this call."""
    resumed: int
    """Built by earlier calls."""


class RepackReport(NamedTuple):
    tiles: int
    copied: int
    recoded: int
    missing: int
    payload_bytes: int
    file_bytes: int


class ExportReport(NamedTuple):
    field_bytes: int
    finest_level: int


class MergeReport(NamedTuple):
    tiles: int
    payload_bytes: int
    file_bytes: int


class ChannelDifference(NamedTuple):
    channel: str
    compared: int
    only_in_a: int
    only_in_b: int
    recoded: int
    """Tiles with other bytes that decode to the same samples."""
    differing: int
    psnr: float
    worst_psnr: float
    worst: tuple[int, int, int] | None
    """Level, entry and exit of the tile that differs most."""


class Difference(NamedTuple):
    equal: bool
    """The same manifest, and the same tiles with the same bytes."""
    comparable: bool
    """Tiles of the same key sample the same rays."""
    manifest: tuple[str, ...]
    """Places in the manifest that differ, as JSON pointers."""
    channels: tuple[ChannelDifference, ...]


class Frame(NamedTuple):
    """How a player drew a frame."""

    seconds: float
    full_share: float
    """Share of the pixels that show the requested level, 0 to 1."""
    tiles: int
    misses: int
    loads: int
    load_bytes: int
