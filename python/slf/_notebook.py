"""How fields show themselves in notebooks: HTML that notebooks display."""

from __future__ import annotations

import base64
import contextlib
import html
import importlib.util
import json
import os
import pathlib
import tempfile
import uuid
from typing import TYPE_CHECKING, Any

from . import _slf
from ._errors import Error

if TYPE_CHECKING:
    from ._field import Field

_SMALL = 2 << 20          # bytes of a field that show() puts into the notebook whole,
_MAX_EMBEDDED = 20 << 20  # and of one that its reader could not see otherwise


def _png(field: Field, size: int, **shown: Any) -> str:
    """A picture of a field, in base64."""
    return base64.b64encode(_slf.png(field.thumbnail(size, **shown) / 255)).decode()


def _figure(field: Field, said: str, frame: str = "", **shown: Any) -> str:
    """A picture of a field. The frame is over it once the page inside says that it runs: after the
    kernel's end, in a file of nbconvert, or in a notebook that is not trusted, it may not."""
    picture = _png(field, 480, **shown)
    name, over = f"slf-{uuid.uuid4().hex}", "position:absolute;inset:0;width:100%;height:100%"
    inner = frame and (f"<iframe {frame} loading='lazy' allowfullscreen "
                       f"style='{over};border:0;opacity:0;pointer-events:none'></iframe>")
    return f"""<script>addEventListener('message', ({{data, source}}) => {{
  const frame = document.querySelector('#{name} iframe');
  if (data === 'slf-field' && frame?.contentWindow === source)
    Object.assign(frame.style, {{opacity: 1, pointerEvents: 'auto'}});
}});</script><div id='{name}' style='position:relative;background:#000;text-align:center'>
<img alt='{html.escape(field.path)}' height='540' src='data:image/png;base64,{picture}'>
{inner}</div><p>{said}</p>"""


def _linked(url: str) -> str:
    url = html.escape(url, quote=True)
    return f"<a href='{url}' target='_blank'>{url}</a>"


def _served(field: Field, url: str, **shown: Any) -> str:
    return _figure(field, _linked(url) + "<br>If this is only a picture, run the cell again to "
                   "turn it.", f"src='{html.escape(url, quote=True)}'", **shown)


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
    return f"<details><summary>Turn it with the mouse</summary>{_served(field, url)}</details>"


def bundle(field: Field) -> dict[str, Any]:
    """The field as text, as a picture, and as a picture with its facts and its page."""
    data = _png(field, 256)
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
        field = self._field
        first = {name: self._shown[name] for name in ("state", "structures")}
        url = _reachable(self.url)
        largest = min(_SMALL, _MAX_EMBEDDED) if url else _MAX_EMBEDDED
        if url and ("://" not in self.url or field.file_bytes > largest):
            return _served(field, url, **first)
        if field.file_bytes > largest:
            return _figure(field, "The browser cannot reach the page of this field, which is on "
                           "the machine of the notebook, and the field is too large to embed. "
                           "Install jupyter-server-proxy there, or "
                           "<code>field.show(\"page.html\")</code> writes a file beside the "
                           "notebook, or <code>slf.repack</code> makes a smaller field.", **first)
        with tempfile.TemporaryDirectory() as folder:
            page = pathlib.Path(folder, "page.html")
            field.show(page, **self._shown)
            text = html.escape(page.read_text("utf-8"))
        link = _linked(url) + "<br>" if url else ""
        return _figure(field, link + "The notebook has the whole field. If this is only a picture, "
                       "trust the notebook to turn it.", f"srcdoc='{text}'", **first)


class Studio(_slf.Studio):
    """A page on which colours, light and cuts are chosen, at a URL. Made by slf.studio(). A context
    manager."""

    files: contextlib.ExitStack | None = None  # that it shows, if they are its own

    def __repr__(self) -> str:
        return f"<slf studio at {self.url}>"

    def _repr_html_(self) -> str:
        url = _reachable(self.url)
        if not url:
            return "The browser cannot reach the studio, which is on the machine of the notebook."
        return (_linked(url) + f'<br><iframe src="{html.escape(url)}" width="100%" height="640" '
                'style="border:0"></iframe>')
