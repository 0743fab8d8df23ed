"""Fields in notebooks: a real Notebook server, and a headless Chromium that runs its cells.

    notebook_test.py SLF WORK_FOLDER

PYTHONPATH has the package slf. Exits with 77, which CTest takes for skipped, where there is no
browser, Notebook, or page.
"""

import base64
import importlib.util
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

sys.dont_write_bytecode = True

from browser import Browser, BrowserError
from host import Host
import nginx

SLF, WORK = sys.argv[1:3]
# A name that is not of this machine, as browsers see it.
FOREIGN = "notebooks.example.org"
PROXY = """
daemon off; master_process off; pid {work}/pid; error_log {work}/log;
events {{ worker_connections 512; }}
http {{
  access_log {work}/access.log;
  client_body_temp_path {work}/b; proxy_temp_path {work}/p; fastcgi_temp_path {work}/f;
  uwsgi_temp_path {work}/u; scgi_temp_path {work}/s;
  server {{
    listen 127.0.0.1:{port};
    proxy_http_version 1.1; proxy_set_header Host $http_host;
    proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";
    location ~ ^{base}proxy/([0-9]+)(/.*)$ {{ proxy_pass http://127.0.0.1:$1$2$is_args$args; }}
    location {base} {{ proxy_pass {notebook}; }}
  }}
}}
"""
FRAME = "document.querySelector('iframe')"
CELLS = {
    "shown": ["import slf\nfield = slf.open('field.slf')\nfield.show()", "field"],
    "small": ["import slf\nfield = slf.open('small.slf')\nfield.show()"],
    "structures": ["""
import numpy as np, slf
ids = np.zeros((12, 12, 12), np.uint8)
ids[2:10, 2:5, 2:10], ids[2:10, 7:10, 2:10] = 1, 2
atlas = slf.build(ids, "atlas.slf", labels=True, each_label=True, lighting="direct", entry=2,
                  exit=8, finest_level=0, force=True)
atlas.show(structures={"label 2": slf.Look(0.5, (1, 0, 0))})"""],
    "widget": ["""
import os, numpy as np, slf
def listening():
    with open("/proc/self/net/tcp") as one:
        open_ones = {line.split()[9] for line in one if line.split()[3] == "0A"}
    links = [os.path.join("/proc/self/fd", name) for name in os.listdir("/proc/self/fd")]
    return sum(os.readlink(link)[8:-1] in open_ones for link in links if os.path.islink(link))
ports = listening()
field = slf.open('field.slf')
widget = field.widget(slf.orbit(60, 10, 2.5), height=400)
widget""", """
ids = np.zeros((12, 12, 12), np.uint8)
ids[2:10, 2:5, 2:10], ids[2:10, 7:10, 2:10] = 1, 2
how = dict(labels=True, lighting="direct", entry=2, exit=8, finest_level=0, force=True)
parts = slf.build(ids, "parts.slf", each_label=True, **how).widget(structures=["label 2"])
parts""", """
states = [{"name": "whole"}, {"name": "half", "clip": [(6, 6, 6, 0, 0, 1)]}]
states = slf.build(ids, "states.slf", states=states, **how).widget(state="half")
states""", "widget"]}


def path(name):
    return os.path.join(WORK, name)


def slf(*arguments):
    return subprocess.run([SLF, "-q", *map(str, arguments)], check=True, capture_output=True,
                          text=True).stdout


class Notebook:
    """A Notebook server of a folder, which listens on an address; its pages are below `base`."""

    def __init__(self, folder, address, base="/", variables=(), options=()):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.config = tempfile.mkdtemp(prefix="slf-jupyter-")
        environment = os.environ | {"HOME": self.config, "JUPYTER_CONFIG_DIR": self.config,
                                    "JUPYTER_DATA_DIR": self.config,
                                    "JUPYTER_RUNTIME_DIR": self.config} | dict(variables)
        self.log = open(os.path.join(self.config, "log"), "w")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "notebook", "--allow-root", "--no-browser",
             f"--ip={address}", f"--port={port}", "--NotebookApp.port_retries=0",
             "--NotebookApp.token=", "--NotebookApp.password=", f"--notebook-dir={folder}",
             f"--NotebookApp.base_url={base}", *options],
            env=environment, stdout=self.log, stderr=self.log, start_new_session=True)
        host = f"[{address}]" if ":" in address else address
        self.url = f"http://{host}:{port}{base.rstrip('/')}"

    def __enter__(self):
        deadline = time.monotonic() + 60
        while True:
            try:
                return urllib.request.urlopen(self.url + "/api", timeout=5) and self
            except OSError:
                if time.monotonic() > deadline or self.process.poll() is not None:
                    raise
                time.sleep(0.1)

    def __exit__(self, *_):
        os.killpg(self.process.pid, signal.SIGKILL)  # with its kernels
        self.process.wait()
        self.log.close()
        shutil.rmtree(self.config, ignore_errors=True)


class PathProxy:
    """nginx as the front of a hub: the notebook server below a path and, as jupyter-server-proxy
    does it, the ports of its machine below that one's proxy/, with the headers that came."""

    def __init__(self, notebook, base):
        self.work = tempfile.mkdtemp(prefix="slf-proxy-")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        with open(os.path.join(self.work, "conf"), "w") as file:
            file.write(PROXY.format(work=self.work, port=port, base=base,
                                    notebook=notebook.url.removesuffix(base.rstrip("/"))))
        self.url = f"http://{FOREIGN}:{port}{base.rstrip('/')}"
        self.process = subprocess.Popen(
            [nginx.program(), "-p", self.work, "-c", os.path.join(self.work, "conf"), "-e",
             os.path.join(self.work, "log")])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)
        shutil.rmtree(self.work, ignore_errors=True)


class NotebookTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        os.makedirs(WORK, exist_ok=True)
        for name, levels in [("field", 2), ("small", 0)]:  # small: notebooks get it whole
            slf("build", "scene:balls", "--entry", 4, "--exit", 16, "--levels", levels, "-o",
                path(name + ".slf"), "-f")
        kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
        for name, sources in CELLS.items():
            cells = [{"cell_type": "code", "metadata": {}, "execution_count": None, "outputs": [],
                      "source": source} for source in sources]
            with open(path(name + ".ipynb"), "w") as file:
                json.dump({"nbformat": 4, "nbformat_minor": 4, "metadata": {"kernelspec": kernel},
                           "cells": cells}, file)

    def setUp(self):
        self.browser = Browser(f"--host-resolver-rules=MAP {FOREIGN} 127.0.0.1")
        self.addCleanup(self.browser.__exit__)

    def frames(self, count, timeout=120):
        """The pages in frames of other sites, once there are `count` of them."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            found = [target for target, url in self.browser.targets("iframe").items()
                     if url.startswith("http://127.0.0.1:")]
            if len(found) >= count:
                return [self.browser.attach(target) for target in found]
            time.sleep(0.1)
        raise BrowserError(f"{len(found)} frames show a field")

    def expect_field(self, page, name):
        """The canvas shows what slf render draws of the same view."""
        page.settle()
        self.assertRegex(page.run("location.pathname"), r"^/[0-9a-f]{32}/field/$")
        width, height = page.run("(({width, height}) => [width, height])"
                                 "(slf.root.getElementById('picture'))")
        self.assertGreater(min(width, height), 300)
        page.run("new Promise((done) => { addEventListener('hashchange', done, {once: true});"
                 " location.hash = 'view=30,20,3&mode=bitri&level=1'; }).then(() => 0)")
        page.settle()
        page.canvas(path(name + ".png"))
        slf("render", path("field.slf"), "-o", path(name + "-slf.png"), "-f", "--mode", "bitri",
            "--level", 1, "--orbit", "30,20,3", "--size", f"{width}x{height}", "--fov",
            2 * 19.471220634490695, "--background", "0,0,0")
        found = json.loads(slf("compare", path(name + ".png"), path(name + "-slf.png"), "--json"))
        self.assertGreater(found["psnr"] or 99, 45)

    def expect_visible(self, page, name, there=True):
        """A picture of the whole window has the field's colours in its frame, or not."""
        from PIL import Image
        page.run("document.querySelector('iframe').scrollIntoView({block: 'center'})")
        box = page.run("(({x, y, width, height}) => [x, y, x + width, y + height])"
                       "(document.querySelector('iframe').getBoundingClientRect())")
        time.sleep(1)
        page.screenshot(path(name + "-window.png"))
        frame = Image.open(path(name + "-window.png")).convert("RGB").crop(tuple(map(int, box)))
        colours = len(set(frame.getdata()))
        (self.assertGreater if there else self.assertLess)(colours, 1000)

    def run_cells(self, notebook, count=2, name="shown"):
        page = self.browser.open(f"{notebook.url}/notebooks/{name}.ipynb", 1000, 1800)
        page.wait("globalThis.Jupyter?.notebook?.kernel?.is_connected()")
        page.run("Jupyter.notebook.execute_all_cells()")
        shown = "document.querySelectorAll('.output_area iframe').length"
        failed = "document.querySelector('.output_error')?.textContent"
        page.wait(f"{shown} === {count or shown} && {shown} > 0 || {failed}", 60)
        self.assertIsNone(page.run(failed))
        return page

    def test_cells_show_the_field(self):
        # Where Notebook listens if nothing else is said, and where it may. Browsers take 127.0.0.1
        # and localhost for two sites.
        for address in ["localhost", "::1"]:
            if address == "::1" and not os.path.exists("/proc/net/if_inet6"):
                continue
            with Notebook(WORK, address) as notebook:
                page = self.run_cells(notebook)
                [shown] = self.frames(1)
                self.expect_field(shown, "shown")
                self.expect_visible(page, "shown")
                # The field's own display has the page folded.
                page.run("document.querySelector('.output_area details').open = true;"
                         "document.querySelector('.output_area details').scrollIntoView()")
                for frame in self.frames(2):
                    self.expect_field(frame, "display")
                page.close()

    def test_a_cell_shows_structures(self):
        with Notebook(WORK, "localhost") as notebook:
            page = self.run_cells(notebook, 1, "structures")
            page.wait(f"{FRAME}.contentWindow.slf?.state === 'settled'", 60)
            self.assertEqual(
                page.run(f"{FRAME}.contentDocument.querySelector('slf-field').structures"),
                ["label 2:0.5:#ff0000"])
            page.close()

    def test_a_widget_by_messages_of_the_kernel(self):
        python = lambda code: page.run(
            "new Promise((done) => Jupyter.notebook.kernel.execute('', {shell: {reply: "
            "({content}) => done(content.user_expressions.it.data?.['text/plain'] ?? "
            "JSON.stringify(content))}}, {user_expressions: {it: " + json.dumps(code) + "}}))")
        set_to = lambda name, value: python("setattr({}, {!r}, {})".format(*name.split("."), value))

        def wait(code, value):
            deadline = time.monotonic() + 20
            while (found := python(code)) != value:
                self.assertLess(time.monotonic(), deadline, f"{code}: {found}, not {value}")
                time.sleep(0.2)

        element = "document.querySelectorAll('slf-field')[%d]"
        settled = lambda k: page.wait(f"{element % k}?.viewer?.state === 'settled'", 60)
        with Notebook(WORK, "localhost") as notebook:
            page = self.browser.open(f"{notebook.url}/notebooks/widget.ipynb", 1000, 1800)
            page.wait("globalThis.Jupyter?.notebook?.kernel?.is_connected()")
            page.run("Jupyter.notebook.execute_all_cells()")
            page.wait("document.querySelectorAll('slf-field').length === 4", 60)
            shown = element % 0
            for k in range(3):
                page.run(f"{element % k}.scrollIntoView({{block: 'center'}})")
                settled(k)
            # As slf render draws it: so tiles came.
            page.run(f"{shown}.scrollIntoView({{block: 'center'}})")
            settled(0)
            self.assertEqual(page.run(f"{shown}.view"), "60,10,2.5")
            page.run(f"({shown}.viewer.settings.level = 1, {shown}.viewer.changed(), 0)")
            settled(0)
            with open(path("widget.png"), "wb") as file:
                file.write(base64.b64decode(page.run(
                    f"{shown}.picture().then((blob) => blob.arrayBuffer()).then((bytes) => "
                    "btoa(String.fromCharCode(...new Uint8Array(bytes))))")))
            width, height = page.run(f"[{shown}.byId('picture').width, "
                                     f"{shown}.byId('picture').height]")
            slf("render", path("field.slf"), "-o", path("widget-slf.png"), "-f", "--level", 1,
                "--orbit", "60,10,2.5", "--size", f"{width}x{height}", "--background", "0,0,0")
            found = json.loads(slf("compare", path("widget.png"), path("widget-slf.png"), "--json"))
            self.assertGreater(found["psnr"] or 99, 38)
            self.assertEqual(page.run(f"{shown}.byId('name').textContent"), "balls")
            # Python changes the page.
            set_to("widget.camera", "slf.orbit(10, 0, 3)")
            for k in [0, 3]:  # it is shown twice
                page.wait(f"{element % k}.view === '10,0,3'", 20)
            set_to("widget.clip", "[((0, 0, 0), (0, 0, 1))]")
            page.wait(f"{shown}.clip.join() === '0,0,0,0,0,1'", 20)
            set_to("widget.picked", "field.pick(256, 256, widget.camera)")
            page.wait(f"{shown}.byId('lines').children.length === 1", 20)
            set_to("parts.structures", "{'label 1': slf.Look(0.5, (1, 0, 0))}")
            page.wait(f"{element % 1}.structures.join() === 'label 1:0.5:#ff0000'", 20)
            self.assertEqual(page.run(f"{element % 2}.state"), "half")
            set_to("states.state", "'whole'")
            page.wait(f"{element % 2}.state === 'whole'", 20)
            # The page changes Python.
            page.run(f"({shown}.view = '350,-5,2,0.1,0,0', {shown}.clip = '', 0)")
            wait("(round(widget.camera.look_at[0] / field.sphere.radius, 3), widget.clip)",
                 "(0.1, [])")
            page.wait(f"{element % 3}.view === '350,-5,2,0.1,0,0'", 20)
            page.run(f"({shown}.view = '30,20,3', {element % 1}.structures = ['label 2'],"
                     f" {element % 2}.state = 'half', 0)")
            wait("(widget.camera, parts.structures, states.state)",
                 "(Orbit(azimuth=30.0, elevation=20.0, distance=3.0), ['label 2'], 'half')")
            settled(0)
            x, y = page.run(f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])"
                            f"({shown}.getBoundingClientRect())")
            for kind in ["mousePressed", "mouseReleased"]:
                page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                          buttons=int(kind == "mousePressed"), clickCount=1)
            wait(f"field.pick({width} / 2, {height} / 2, widget.camera, ({width}, {height})).depth"
                 " - widget.picked.depth < 0.1", "True")
            # All by the notebook's own connection.
            self.assertEqual(python("listening() - ports"), "0")
            self.assertEqual(page.run("""performance.getEntriesByType('resource').filter(
                ({name}) => new URL(name).host !== location.host && !/^(blob|data):/.test(name))
                .length"""), 0)
            page.screenshot(path("widget-window.png"))
            # Jupyter drops no messages, which it does above 1 MB a second.
            set_to("widget._file", "open('/dev/zero', 'rb')")
            self.assertEqual(page.run(f"{shown}.source.read(5, 5 + (16 << 20)).then((bytes) => "
                                      "bytes.length)"), 16 << 20)
            # What is left: the picture.
            page.run("Jupyter.notebook.save_notebook().then(() => 0)")
            page.run("Jupyter.notebook.kernel.restart(), 0")
            page.wait("document.querySelectorAll('slf-field').length === 0", 60)
            pictures = """[...document.querySelectorAll('img[alt$=".slf"]')].map(
                ({naturalWidth, height}) => [naturalWidth, height])"""
            left = page.run(pictures)
            self.assertEqual(left, [[480, 400], [480, 540], [480, 540], [480, 400]])
            page.close()
        with open(path("widget.ipynb")) as file:
            self.assertNotIn("slf-field", file.read())  # nor what the kernel had sent
        subprocess.run([sys.executable, "-m", "nbconvert", "--to", "html", "--log-level", "ERROR",
                        path("widget.ipynb")], check=True)
        self.browser.events.clear()
        page = self.browser.open("file://" + os.path.abspath(path("widget.html")), 1000, 1800)
        page.wait("document.readyState === 'complete'")
        self.assertEqual(page.run(pictures), left)
        self.assertEqual([said for said in page.complaints() if "slf" in said], [])
        page.close()

    def test_what_is_left_when_the_kernel_has_ended(self):
        """On reload and in HTML by nbconvert: a picture, or the field if it is small."""
        with Notebook(WORK, "localhost") as notebook:
            for name, count in [("shown", 2), ("small", 1)]:
                page = self.run_cells(notebook, count, name)
                page.wait(f"getComputedStyle({FRAME}).opacity === '1'", 60)
                page.run("Jupyter.notebook.save_notebook()")
                page.run("globalThis.before = true, Jupyter.notebook.kernel.restart(), 0")
                page.wait("!Jupyter.notebook.kernel.is_connected()", 20)
                page.wait("Jupyter.notebook.kernel.is_connected()", 60)
                page.call("Page.reload")
                page.wait("!globalThis.before")
                self.expect_left(page, name)
                page.close()
        subprocess.run([sys.executable, "-m", "nbconvert", "--to", "html", "--log-level", "ERROR",
                        path("shown.ipynb"), path("small.ipynb")], check=True)
        with Host(WORK) as host:
            for name in ["shown", "small"]:
                page = self.browser.open(f"{host.url}/{name}.html", 1000, 1800)
                self.expect_left(page, name + "-html")
                page.close()

    def expect_left(self, page, name):
        page.wait(FRAME + " && document.readyState === 'complete'", 60)
        if name.startswith("small"):
            page.run(FRAME + ".scrollIntoView()")
            page.wait(f"{FRAME}.contentWindow?.slf?.state === 'settled'", 60)
        time.sleep(1)
        self.assertEqual(page.run(f"getComputedStyle({FRAME}).opacity"),
                         "1" if name.startswith("small") else "0")
        self.expect_visible(page, name)
        self.assertIn("run the cell again" if name.startswith("shown") else "has the whole field",
                      page.run(f"{FRAME}.parentElement.nextElementSibling.textContent"))

    def test_the_wheel_over_a_frame_scrolls_the_notebook(self):
        with Notebook(WORK, "localhost") as notebook:
            page = self.run_cells(notebook, 1, "small")
            page.run("document.querySelector('.output_area').style.paddingBottom = '3000px';"
                     "document.querySelector('#site').scrollTop = 0")
            page.wait(f"{FRAME}.contentWindow.slf?.state === 'settled'", 60)
            x, y = page.run(f"(({{x, y}}) => [x + 200, y + 300])({FRAME}.getBoundingClientRect())")

            def wheel():
                page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0,
                          deltaY=100)
                time.sleep(0.5)
                return page.run(f"[document.querySelector('#site').scrollTop > 0, "
                                f"{FRAME}.contentWindow.slf.camera.distance > 3]")

            self.assertEqual(wheel(), [True, False])
            page.run("document.querySelector('#site').scrollTop = 0")
            for kind in ["mousePressed", "mouseReleased"]:  # then it is used
                page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                          buttons=int(kind == "mousePressed"), clickCount=1)
            self.assertEqual(wheel(), [False, True])
            page.close()

    def shown_away(self, variables, *options):
        """The frame's field, in a notebook that the browser reaches by a proxy only."""
        base = "/user/me/"
        with Notebook(WORK, "localhost", base, variables,
                      ["--NotebookApp.allow_remote_access=True", *options]) as notebook, \
                PathProxy(notebook, base) as proxy:
            page = self.run_cells(proxy, count=None)
            page.run(f"{FRAME}.scrollIntoView()")
            page.wait(f"{FRAME}.contentWindow.slf?.state === 'settled'", 60)
            found = page.run(f"[{FRAME}.contentWindow.location.href, "
                             "document.querySelectorAll('.output_area iframe').length]")
            self.expect_visible(page, "away")
            # A widget needs no more than the notebook's own connection.
            if not variables:
                page.run("""((cell) => {
                  cell.set_text('field.widget()');
                  cell.execute();
                  cell.element[0].scrollIntoView();
                })(Jupyter.notebook.insert_cell_at_bottom('code'))""")
                page.wait("document.querySelector('slf-field')?.viewer?.state === 'settled'", 60)
            self.assertEqual([line for line in page.complaints() if "slf" in line], [])
            page.close()
            return found

    @unittest.skipUnless(nginx.program(), "no nginx")
    def test_a_notebook_on_another_machine(self):
        modules = path("modules")
        os.makedirs(modules, exist_ok=True)
        places = os.pathsep.join([modules, *sys.path])
        hub = {"JUPYTERHUB_SERVICE_PREFIX": "/user/me/"}
        # Of the server below a path, or of a hub: embedded.
        for variables in [{}, hub]:
            self.assertEqual(self.shown_away(variables), ["about:srcdoc", 1])
        with open(os.path.join(modules, "jupyter_server_proxy.py"), "w"):
            pass
        where, count = self.shown_away({"PYTHONPATH": places})
        self.assertRegex(where, r"/user/me/proxy/[0-9]+/[0-9a-f]{32}/field/#")
        self.assertEqual(count, 2)  # the field's own display has the page, too

    def test_only_origins_that_are_named_frame_it_too(self):
        folder = path("foreign")
        os.makedirs(folder, exist_ok=True)

        def outcome(*options):
            view = subprocess.Popen([SLF, "-q", "view", path("field.slf"), *options],
                                    stdout=subprocess.PIPE, text=True)
            try:
                with open(os.path.join(folder, "index.html"), "w") as file:
                    file.write(f"<iframe src='{view.stdout.readline().strip()}' width=500 "
                               "height=500></iframe>")
                page = self.browser.open(origin, 600, 600)
                page.wait("document.readyState === 'complete'")
                if options:
                    self.expect_field(self.frames(1)[0], "foreign")
                self.expect_visible(page, "foreign", bool(options))
                page.run("1")
                said = " ".join(page.complaints())
                page.close()
                return said
            finally:
                view.terminate()
                view.wait()
                view.stdout.close()

        with Host(folder) as host:
            origin = host.url.replace("127.0.0.1", FOREIGN)
            self.assertIn("frame-ancestors", outcome())
            self.browser.events.clear()
            self.assertNotIn("frame-ancestors", outcome("--allow-frames", origin))


if __name__ == "__main__":
    for module in ["notebook", "PIL", "slf"]:
        if not importlib.util.find_spec(module):
            print(f"skipped: no Python module {module}")
            sys.exit(77)
    if not shutil.which("chromium"):
        print("skipped: no chromium")
        sys.exit(77)
    if subprocess.run([SLF, "export", "-o", "/dev/null/x.html", "/nonexistent.slf"],
                      capture_output=True).returncode == 5:
        print("skipped: slf was built without the page")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
