"""How fields show themselves, the view's server, exported pages, and the example notebooks."""

import base64
import io
import json
import pathlib
import subprocess
import sys
import types
import urllib.request

import numpy as np
import pytest

import slf
from conftest import write_nifti

NOTEBOOKS = pathlib.Path(__file__).parents[2] / "examples" / "notebooks"


def test_field_shows_a_picture_that_stays(balls):
    bundle = balls._repr_mimebundle_()
    assert bundle["text/plain"] == repr(balls)
    png = base64.b64decode(bundle["image/png"])
    assert png.startswith(b"\x89PNG") and bundle["image/png"] in bundle["text/html"]
    image = pytest.importorskip("PIL.Image").open(io.BytesIO(png))
    assert np.array_equal(np.asarray(image), balls.thumbnail()[..., :3])
    balls.close()
    assert balls._repr_mimebundle_() is None


def test_field_shows_its_page_beside_the_picture(balls, tmp_path):
    try:
        url = balls.show().url
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    shown = balls._repr_mimebundle_()["text/html"]
    assert f"<iframe src='{url}' loading='lazy'" in shown.partition("<details>")[2]
    view = balls.show(tmp_path / "page.html")  # where the server cannot be reached
    assert (tmp_path / "page.html").stat().st_size > balls.file_bytes
    assert str(tmp_path / "page.html") in view._repr_html_()


def test_a_notebook_on_another_machine(balls, monkeypatch):
    try:
        monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/me/")
        view = balls.show()
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    assert "<iframe srcdoc='&lt;!doctype html" in view._repr_html_()
    assert "<iframe" not in balls._repr_mimebundle_()["text/html"]
    monkeypatch.setattr("slf._notebook._MAX_EMBEDDED", balls.file_bytes - 1)
    assert "<iframe" not in view._repr_html_()
    assert "jupyter-server-proxy" in view._repr_html_()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name == "jupyter_server_proxy")
    port, token, name = view.url.split(":")[2].split("/")[:3]
    assert f"<iframe src='/user/me/proxy/{port}/{token}/{name}/'" in view._repr_html_()
    request = urllib.request.Request(view.url, headers={"Host": "hub.example.org"})
    with urllib.request.urlopen(request) as page:
        assert page.status == 200


def test_html_escapes_what_the_file_says(tmp_path):
    scene = slf.build("scene:balls", tmp_path / "<b>&.slf", entry=2, exit=4, finest_level=0)
    html = scene._repr_mimebundle_()["text/html"]
    assert "<b>" not in html and "&lt;b&gt;&amp;.slf" in html


def test_page_is_served_until_the_field_is_closed(balls):
    try:
        view = balls.show()
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    assert view.url in view._repr_html_() and view.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(view.url) as page:
        assert b"<slf-field" in page.read()
    request = urllib.request.Request(view.url + "field.slf", headers={"Range": "bytes=0-99"})
    with urllib.request.urlopen(request) as part:
        assert part.status == 206 and len(part.read()) == 100
    assert balls.show().url == view.url
    views = {"views": [{"title": "Left", "orbit": [90, 0, 3]}]}
    with urllib.request.urlopen(balls.show(views=views).url + "views.json") as file:
        assert json.load(file) == views
    with pytest.raises(slf.BadFileError, match=r"views: views\[0\]\.orbit: expected"):
        balls.show(views={"views": [{"title": "Left"}]})
    view = balls.show()
    balls.close()
    with pytest.raises(OSError):
        urllib.request.urlopen(view.url, timeout=2)


def test_interpreter_exits_while_the_page_is_served_and_tiles_load(balls_path):
    script = """
import ctypes, sys, threading, urllib.request, slf
field = slf.open(sys.argv[1])
player = field.player()
player.draw(slf.orbit(), (64, 64))
url = field.show().url
for never_freed in (field, player):
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(never_freed))
def fetch():
    while True:
        with urllib.request.urlopen(url) as page: page.read()
        begun.set()
begun = threading.Event()
threading.Thread(target=fetch, daemon=True).start()
begun.wait()
"""
    done = subprocess.run([sys.executable, "-c", script, balls_path], timeout=60,
                          capture_output=True, text=True)
    if "UnsupportedError" in done.stderr:
        pytest.skip("slf was built without the page")
    assert done.returncode == 0, done.stderr


def test_exports_a_page_and_a_folder(balls, tmp_path):
    try:
        slf.export(balls, tmp_path / "page.html")
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    assert (tmp_path / "page.html").stat().st_size > balls.file_bytes
    with pytest.raises(ZeroDivisionError):
        slf.export(balls, tmp_path / "other.html", progress=lambda *p: 1 / 0)
    assert not (tmp_path / "other.html").exists()
    slf.export(balls.path, tmp_path / "site")
    assert (tmp_path / "site" / "index.html").exists()
    with pytest.raises(slf.UsageError):
        slf.export(balls.path, tmp_path / "site")
    for name in ("mine.html", "mine.htm"):
        page = tmp_path / name
        page.write_text("mine")
        for write in (lambda **force: slf.export(balls, page, **force),
                      lambda **force: balls.show(page, **force)):
            with pytest.raises(slf.UsageError, match="exists; force=True overwrites it"):
                write()
            assert page.read_text() == "mine"
            write(force=True)
            assert page.stat().st_size > balls.file_bytes
            page.write_text("mine")


def test_a_build_keeps_the_files_of_its_settings(tmp_path):
    maps = tmp_path / "maps.json"
    maps.write_text(json.dumps([
        {"Name": name, "ColorSpace": "RGB", "RGBPoints": [0, 1, 0, 0, 1, 1, 1, 1],
         "Points": [0, 0, 0.5, 0, 1, 1, 0.5, 0]} for name in ("Other", "Mine")]))
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps({"lights": [{"direction": [0, 0, 1]}]}))
    voxels = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    voxels.tofile(tmp_path / "voxels.raw")
    mapped = np.memmap(tmp_path / "voxels.raw", np.uint8, "r", shape=(4, 4, 4))
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    views = [np.asarray(mapped), np.asarray(mapped)[:, ::-1], np.asarray(mapped).view(np.int8),
             np.frombuffer(memoryview(mapped), np.uint8).reshape(4, 4, 4)]
    for view in views:
        with pytest.raises(slf.UsageError, match="is the input"):
            slf.build(view, tmp_path / "voxels.raw", entry=2, exit=4, finest_level=0, force=True)
    for out in before:
        with pytest.raises(slf.UsageError, match="is the input"):
            slf.build(mapped, out, name="voxels", transfer=f"{maps}#Mine", light_rig=str(rig),
                      lighting="shadowed", light_samples=1, entry=2, exit=4, finest_level=0, force=True)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["first_field.ipynb", "rays_of_a_function.ipynb"])
def test_example_runs(name, voxels, tmp_path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    write_nifti(tmp_path / "head.nii", voxels.T, np.eye(4))
    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300,
                            resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)


class _AnyWidget(pytest.importorskip("traitlets").HasTraits):
    """What anywidget.AnyWidget has of Python; notebook_test.py has the other half."""

    def __init__(self, **given):
        super().__init__(**given)
        self.sent = []

    def on_msg(self, hear):
        self.hear = hear

    def send(self, content, buffers=None):
        self.sent.append((content, buffers))

    def _repr_mimebundle_(self, **_):
        return {"text/plain": "", "application/vnd.jupyter.widget-view+json": {}}, {}


@pytest.mark.parametrize("installed", [False, True])
def test_a_widget_answers_what_its_page_asks(balls, balls_path, monkeypatch, installed):
    monkeypatch.delitem(sys.modules, "slf._widget", raising=False)
    monkeypatch.setitem(sys.modules, "anywidget",
                        types.SimpleNamespace(AnyWidget=_AnyWidget) if installed else None)
    try:
        widget = balls.widget(slf.orbit(40, 10, 2), clip=[((0, 0, 1), (0, 0, 1))], height=300)
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    bundle = widget._repr_mimebundle_()
    data = bundle[0] if installed else bundle
    assert installed or widget._repr_mimebundle_() != bundle  # elements of a page have own ids
    assert "<img " in data["text/html"] and repr(balls_path)[11:-2] in data["text/html"]
    assert ("application/vnd.jupyter.widget-view+json" in data) == installed
    state = {name: widget.trait_metadata(name, "to_json")(getattr(widget, name), widget)
             for name in widget.traits(sync=True)}
    assert json.loads(json.dumps(state)) == {
        "camera": "40,10,2", "state": "", "structures": [], "clip": ["0,0,1,0,0,1"], "cap": "",
        "picked": None, "height": 300, "size": balls.file_bytes}
    camera = slf.Camera((0, -5, 1), (0.1, 0, 0.5))
    widget.camera = camera
    read = lambda name, value: widget.trait_metadata(name, "from_json")(value, widget)
    again = read("camera", widget.trait_metadata("camera", "to_json")(camera, widget))
    assert np.allclose(again.eye, camera.eye) and np.allclose(again.look_at, camera.look_at)
    assert read("clip", ["0,0,1,0,0,1"]) == [(0, 0, 1, 0, 0, 1)]
    assert read("picked", {"point": [1, 2, 3], "depth": 4, "uncertainty": 5}).point == (1, 2, 3)
    if not installed:
        comm = widget._heard = types.SimpleNamespace(sent=[])
        comm.send = lambda said, buffers: comm.sent.append((said["answer"], buffers))
    sent = widget.sent if installed else widget._heard.sent
    for asked in {"id": 1, "ranges": [[0, 4], [8, 16]]}, {"id": 2, "file": "page.js"}, \
            {"id": 3, "file": "/etc/passwd"}:
        widget._answer(widget, asked, [])
    content = balls_path.read_bytes()
    assert sent[0] == ({"id": 1}, [content[:4] + content[8:16]])
    assert sent[1][0] == {"id": 2} and b"slf-field" in sent[1][1][0]
    assert "no file /etc/passwd" in sent[2][0]["error"]
    if not installed:
        widget.close()
