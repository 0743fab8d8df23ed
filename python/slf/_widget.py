"""The widget of a field: its page in a notebook, whose traits the page and Python change.

The page asks for scripts and bytes by messages of the kernel, so no port is open. anywidget carries
them where it is installed. Elsewhere a comm of our own does, in Notebook 6 and older: plain
ipywidgets take views as AMD modules only, which each front end must have installed.
"""

from __future__ import annotations

import contextlib
import html
import math
import pathlib
import uuid
from typing import TYPE_CHECKING, Any

import numpy as np
import traitlets  # type: ignore[import]

from . import _slf
from ._errors import Error
from ._notebook import _png
from ._types import Camera, Orbit, PickedPoint, point

if TYPE_CHECKING:
    from ._field import Field

# Gives the element's model of anywidget a comm of the kernel, once there is one.
_CONNECT = """((box, target, notebook) => {
  const begin = () => {
    const state = {}, changed = {}, heard = {};
    const tell = (name, ...news) => (heard[name] ?? []).forEach((hear) => hear(...news));
    const comm = notebook.kernel.comm_manager.new_comm(target, {});
    const model = {
      on: (name, hear) => (heard[name] ??= []).push(hear),
      get: (name) => state[name],
      set: (name, value) => { state[name] = changed[name] = value; tell(`change:${name}`); },
      save_changes: () => {
        comm.send({state: {...changed}});
        for (const name in changed) delete changed[name];
      },
      send: (asked) => comm.send({asked})};
    comm.on_msg(async ({content: {data}, buffers}) => {
      Object.assign(state, data.state);
      for (const name in data.state ?? {}) tell(`change:${name}`);
      if (data.answer) tell('msg:custom', data.answer, buffers);
      if (!data.script) return;
      const script = URL.createObjectURL(new Blob([data.script], {type: 'text/javascript'}));
      (await import(script)).default.render({model, el: box.lastElementChild});
    });
    const end = () => box.lastElementChild.replaceChildren();
    comm.on_close(end);
    notebook.events.on('kernel_restarting.Kernel kernel_dead.Kernel', end);
  };
  if (notebook?.kernel?.is_connected()) begin();
  else notebook?.events.one('kernel_ready.Kernel', begin);
})(document.getElementById('%s'), '%s', globalThis.Jupyter?.notebook)"""


def _text(numbers: Any) -> str:
    return ",".join(f"{v:.9g}" for v in numbers)


def _view(camera: Any, field: Field) -> str:
    """A camera as the page has it: azimuth, elevation, distance, and what it looks at, in radii."""
    if not isinstance(camera, Camera):
        return _text(camera)
    center, radius = field.sphere
    eye, target = np.asarray(camera.eye), np.asarray(camera.look_at)
    x, y, z = (eye - target) / radius
    distance = math.hypot(x, y, z)
    return _text([math.degrees(math.atan2(x, -y)), math.degrees(math.atan2(z, math.hypot(x, y))),
               distance, *(target - center) / radius])


def _camera(view: str, field: Field) -> Any:
    azimuth, elevation, distance, *target = map(float, view.split(","))
    orbit = Orbit(azimuth, elevation, distance)
    if not target:
        return orbit
    camera = field.camera(orbit)
    at = field.sphere.radius * np.asarray(target)
    return camera._replace(eye=point([*(camera.eye + at)]), look_at=point([*(camera.look_at + at)]))


def _synced(trait: Any, to_json: Any = lambda value, widget: value,
            from_json: Any = lambda value, widget: value) -> Any:
    return trait.tag(sync=True, to_json=to_json, from_json=from_json)


class _Comms(traitlets.HasTraits):  # type: ignore[misc]
    """What anywidget.AnyWidget does, by a comm for each view, in Notebook 6 and older."""

    _esm: str
    _answer: Any
    _poster: Any
    height: Any

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self._id, self._comms, self._heard = f"slf-{uuid.uuid4().hex}", set[Any](), None
        self.observe(self._changed, list(self.traits(sync=True)))
        with contextlib.suppress(ImportError, AttributeError):  # not in a kernel
            from IPython import get_ipython  # type: ignore[import]
            get_ipython().kernel.comm_manager.register_target(self._id, self._begin)

    def _state(self, *names: str) -> dict[str, Any]:
        return {name: self.trait_metadata(name, "to_json")(getattr(self, name), self)
                for name in names}

    def _changed(self, change: Any) -> None:
        for comm in self._comms - {self._heard}:
            comm.send({"state": self._state(change.name)})

    def _begin(self, comm: Any, _: Any) -> None:
        self._comms.add(comm)
        comm.on_msg(lambda message: self._hear(comm, message["content"]["data"]))
        comm.on_close(lambda message: self._comms.discard(comm))
        comm.send({"state": self._state(*self.traits(sync=True)), "script": self._esm})

    def _hear(self, comm: Any, data: Any) -> None:
        self._heard = comm
        try:
            for name in self.traits(sync=True).keys() & data.get("state", {}):
                value = self.trait_metadata(name, "from_json")(data["state"][name], self)
                setattr(self, name, value)
            if "asked" in data:
                self._answer(self, data["asked"], [])
        finally:
            self._heard = None

    def send(self, answer: Any, buffers: Any = None) -> None:
        if self._heard is not None:
            self._heard.send({"answer": answer}, buffers=buffers)

    def close(self) -> None:
        """Ends the views; a picture is left. A second call does nothing."""
        while self._comms:
            self._comms.pop().close()

    def _repr_mimebundle_(self, **_: Any) -> Any:
        box = f"slf-{uuid.uuid4().hex}"  # it may be shown again
        return {"text/plain": repr(self), "text/html":
                f"<div id='{box}' style='position:relative;height:{self.height}px;"
                f"background:#000;text-align:center'>{self._poster()}"
                "<div style='position:absolute;inset:0'></div></div><p>If this is only a picture, "
                "run the cell again. JupyterLab and its like need anywidget to turn it.</p>"
                f"<script>{_CONNECT % (box, self._id)}</script>"}


_Base: Any = _Comms
with contextlib.suppress(ImportError):
    from anywidget import AnyWidget as _Base  # type: ignore[import, no-redef]


class Widget(_Base):  # type: ignore[misc]
    """The page of a field in a notebook. Made by Field.widget(). What its reader does changes these
    traits, and they change what it shows: observe() and traitlets.link() work as with any."""

    _esm = pathlib.Path(__file__).with_name("widget.js").read_text("utf-8")
    camera = _synced(traitlets.Any(Orbit(30, 20, 3)),
                     lambda camera, self: _view(camera, self._field),
                     lambda view, self: _camera(view, self._field))
    """An Orbit; a Camera where it does not look at the centre. The page keeps its field of view."""
    state = _synced(traitlets.Unicode())
    """The name of the state that is shown."""
    structures = _synced(traitlets.Any(()))
    """Texts as Field.compose() takes them; looks of structures may be set."""
    clip = _synced(traitlets.Any(()), lambda clip, _: [_text(np.ravel(plane)) for plane in clip],
                   lambda clip, _: [tuple(map(float, text.split(","))) for text in clip])
    """Planes, as of Field.render()."""
    cap = _synced(traitlets.Unicode())
    """As of Field.render()."""
    picked = _synced(traitlets.Any(), lambda at, _: at and at._asdict(),
                     lambda at, _: at and PickedPoint(point(at["point"]), at["depth"],
                                                      at["uncertainty"]))
    """The PickedPoint that was clicked on last; the page marks the one that is set here."""
    height = _synced(traitlets.Int(540))
    size = _synced(traitlets.Int())

    def __init__(self, field: Field, **shown: Any) -> None:
        self._field, self._file = field, open(field.path, "rb")
        _slf.page_file("page.js")
        super().__init__(size=field.file_bytes, **shown)
        if _Base is not _Comms:
            self.on_msg(self._answer)

    def __repr__(self) -> str:
        return f"<slf widget of {self._field.path!r}>"

    @traitlets.validate("structures")
    def _texts(self, proposal: Any) -> Any:
        from ._field import _looks
        return _slf.texts_of(_looks(proposal.value))

    def _answer(self, _: Any, asked: Any, __: Any) -> None:
        """Sends what the page asks for: parts of the field's file, or a file of the page."""
        answer, data = {"id": asked["id"]}, b""
        try:
            if "file" in asked:
                data = _slf.page_file(asked["file"])
            for begin, end in asked.get("ranges", ()):
                self._file.seek(begin)
                data += self._file.read(end - begin)
        except (OSError, ValueError, Error) as error:
            answer["error"] = str(error)
        self.send(answer, [data])

    def _poster(self) -> str:
        data = _png(self._field, 480, camera=self.camera, structures=self.structures or None,
                    state=None if self.structures else self.state or None)
        return (f"<img alt='{html.escape(self._field.path)}' style='height:{self.height}px' "
                f"src='data:image/png;base64,{data}'>")

    def _repr_mimebundle_(self, **given: Any) -> Any:
        """Notebooks that cannot show the widget, saved ones too, show its picture."""
        bundle = super()._repr_mimebundle_(**given)
        if _Base is not _Comms:
            bundle, *metadata = bundle if isinstance(bundle, tuple) else (bundle,)
            return ({**(bundle or {}), "text/html": self._poster()}, *metadata)
        return bundle
