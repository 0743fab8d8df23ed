"""Sphere light fields: build them from arrays, draw them, show them.

    import slf
    field = slf.build(volume, "out.slf", spacing=(1, 1, 2), transfer="ct-bone")
    picture = field.render(slf.orbit(30, 20, 3), size=(512, 512))

World coordinates are LPS, as in DICOM and ITK. Arrays of voxels are indexed [z, y, x].
"""

import pathlib as _pathlib

try:
    from . import _slf
except ImportError as error:
    _list = _pathlib.Path(__file__).with_name("packages.txt")  # of a wheel
    if "cannot open shared object" not in str(error) or not _list.exists():
        raise
    raise ImportError(f"{error}: install the libraries of slf, in Debian 12 by\n"
                      f"sudo apt-get install {_list.read_text()}") from None

from ._build import build, build_rays, raycast, studio
from ._errors import (BadFileError, BusyError, Error, FailedError, IoError, NotFoundError,
                      OutOfMemoryError, UnsupportedError, UsageError)
from ._field import Field, Player, diff, export, merge, open, repack, verify
from ._notebook import Studio
from ._rays import Scene
from ._source import BuildSettings, Settings, SourceSettings
from ._slf import version as __version__
from ._types import Camera, Look, Orbit, Picture, Rays, Sphere, Tone, orbit

__all__ = ["BadFileError", "BuildSettings", "BusyError", "Camera", "Error", "FailedError",
           "Field", "IoError", "Look", "NotFoundError", "Orbit", "OutOfMemoryError", "Picture",
           "Player", "Rays", "Scene", "Settings", "SourceSettings", "Sphere", "Studio", "Tone",
           "UnsupportedError", "UsageError", "build", "build_rays", "diff", "export", "merge",
           "open", "orbit", "raycast", "repack", "studio", "verify"]
