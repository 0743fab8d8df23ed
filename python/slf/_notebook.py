"""How fields show themselves in notebooks: HTML that notebooks display."""

from __future__ import annotations

import base64
import html
import importlib.util
import json
import os
import pathlib
import struct
import tempfile
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from ._errors import Error

if TYPE_CHECKING:
    from ._field import Field

_MAX_EMBEDDED = 20 << 20  # bytes of a field that a notebook gets whole


def png(picture: np.ndarray) -> bytes:
    """A PNG file of uint8 [height, width, 3]."""
    height, width, _ = picture.shape

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # each row begins with its filter: none
    rows[:, 1:] = picture.reshape(height, 3 * width)
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)) + chunk(b"IEND", b""))


def _frame(url: str) -> str:
    url = html.escape(url, quote=True)
    return (f"<iframe src='{url}' loading='lazy' width='100%' height='540' style='border:0' "
            f"allowfullscreen></iframe><p><a href='{url}' target='_blank'>{url}</a></p>")


def server_base() -> str | None:
    """Where this kernel's notebook server is on its host, such as "/user/me/", if its readers may
    be at other machines; None if they are at this one."""
    base = os.environ.get("JUPYTERHUB_SERVICE_PREFIX")
    if base:
        return base
    try:
        from jupyter_core.paths import jupyter_runtime_dir
        pid = os.environ["JPY_PARENT_PID"]
        for kind in ("jpserver", "nbserver"):  # what servers say about themselves
            file = pathlib.Path(jupyter_runtime_dir(), f"{kind}-{pid}.json")
            if file.exists():
                server = json.loads(file.read_text())
                here = server["hostname"] in ("localhost", "127.0.0.1", "::1")
                return None if here and server["base_url"] == "/" else str(server["base_url"])
    except (ImportError, KeyError, OSError, ValueError):
        pass
    return None


def _reachable(url: str) -> str | None:
    """The address of a page of this machine for the notebook's reader, if there is one."""
    base = server_base()
    if base is None or "://" not in url:
        return url
    if not importlib.util.find_spec("jupyter_server_proxy"):
        return None
    return f"{base}proxy/{url.rpartition(':')[2]}"  # PORT/TOKEN/NAME/


def _page(field: Field) -> str:
    """The page, which loads when it is unfolded; nothing if it cannot be served."""
    try:
        url = _reachable(field.show().url)
    except Error:
        return ""
    if not url:
        return ""
    return f"<details><summary>Turn it with the mouse</summary>{_frame(url)}</details>"


def bundle(field: Field) -> dict[str, Any]:
    """The field as text, as a picture, and as a picture with its facts and its page."""
    picture = png(field.thumbnail()[..., :3])
    shape = field.shape
    source = field.provenance.get("source", field.provenance.get("name", ""))
    rows = {"field": field.path, "source": source,
            "levels": f"0 to {shape.finest_level}",
            "lattices": f"{shape.entry_side << shape.finest_level} entry, "
                        f"{shape.exit_side << shape.finest_level} exit",
            "codec": field.codec,
            "size": f"{field.file_bytes / 1e6:.1f} MB"}
    table = "".join(f"<tr><th style='text-align:left'>{name}</th>"
                    f"<td style='text-align:left'>{html.escape(str(value))}</td></tr>"
                    for name, value in rows.items() if value)
    data = base64.b64encode(picture).decode()
    return {"text/plain": repr(field),
            "image/png": data,
            "text/html": "<div style='display:flex;gap:1em;align-items:center'>"
                         f"<img width='256' height='256' src='data:image/png;base64,{data}'>"
                         f"<table>{table}</table></div>{_page(field)}"}


class View:
    """The page that shows a field, at a URL."""

    def __init__(self, url: str, field: Field, shown: dict[str, Any]) -> None:
        self.url = url
        self._field, self._shown = field, shown

    def __repr__(self) -> str:
        return f"<slf view at {self.url}>"

    def _repr_html_(self) -> str:
        url = _reachable(self.url)
        if url:
            return _frame(url)
        if self._field.file_bytes > _MAX_EMBEDDED:
            return ("<p>The browser cannot reach the page of this field, which is on the machine "
                    "of the notebook, and the field is too large to embed. Install "
                    "jupyter-server-proxy there, or <code>field.show(\"page.html\")</code> writes "
                    "a file beside the notebook, or <code>slf.repack</code> makes a smaller field."
                    "</p>")
        with tempfile.TemporaryDirectory() as folder:
            page = pathlib.Path(folder, "page.html")
            self._field.show(page, **self._shown)
            text = html.escape(page.read_text("utf-8"))
        return f"<iframe srcdoc='{text}' width='100%' height='540' style='border:0'></iframe>"
