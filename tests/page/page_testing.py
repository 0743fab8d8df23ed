"""What the tests of the page share: a headless Chromium, hosts and small fields.

    NAME_test.py SLF DECODED WORK_FOLDER [FIELD.slf …]

Exits with 77, which CTest takes for skipped, where there is no browser or no page.
"""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

from browser import Browser
from host import Handler

SLF, DECODED, WORK = sys.argv[1:4]
WORK = os.path.abspath(WORK)
ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
VIEWS = [(30, 20, 3), (200, -35, 3), (110, 85, 2.2), (300, 5, 1.4), (75, 0, 6)]
MIN_PSNR = {"bitri": 45.0, "depth": 42.0}  # dB
# Software graphics take a second for a picture of 512². Half of that shows the same mistakes;
# fields that are given are drawn in full.
SIZE = 512 if sys.argv[4:] else 256
# Full checks (SLF_EVERY_BYTE) leave nothing out.
FULL = sys.argv[4:] or os.environ.get("SLF_EVERY_BYTE")
PICTURE = "slf.root.getElementById('picture').toDataURL()"


def slf(*arguments):
    return subprocess.run([SLF, "-q", *map(str, arguments)], check=True, capture_output=True,
                          text=True).stdout


def path(name):
    return os.path.join(WORK, name)


def index_size(field):
    """The bytes after the pages of a field (doc/format/optional.md, "Index")."""
    with open(field, "rb") as file:
        file.seek(-24, os.SEEK_END)
        return os.path.getsize(field) - int.from_bytes(file.read(8), "little")


class Server:
    """slf view of some fields."""

    def __init__(self, *fields):
        self.process = subprocess.Popen([SLF, "-q", "view", *fields], stdout=subprocess.PIPE,
                                        text=True)
        self.url = self.process.stdout.readline().strip()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        self.status = self.process.wait(20)
        self.process.stdout.close()


class Silent(Handler):
    """A host that answers no request for the field while it is `down`."""
    down = False

    def do_GET(self):
        while Silent.down and self.path.endswith(".slf"):
            time.sleep(0.05)
        return super().do_GET()


class PageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        os.makedirs(WORK, exist_ok=True)
        cls.fields = sys.argv[4:] or cls.build_fields()
        cls.browser = Browser()

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()

    @classmethod
    def build_fields(cls):
        """An opaque and a translucent field, one of linear radiance, and one with missing tiles, of
        several codecs."""
        with open(path("cube.raw"), "wb") as file:
            file.write(bytes(200 if all(6 <= at < 18 for at in (x, y, z)) else 10
                             for z in range(24) for y in range(24) for x in range(24)))
        lattice = ["--entry", 4, "--exit", 16]
        recipes = {
            "opaque": ["scene:balls", "--levels", 2],  # predictive
            "translucent": ["scene:fog", "--codec", "zstd",
                            "--levels", 1],
            "lit": [path("cube.raw"), "--dims", "24x24x24", "--lighting", "shadowed", "--levels", 1,
                    "--color-type", "half", "--codec", "zstd"],
        }
        fields = []
        for name, recipe in recipes.items():
            fields.append(path(name + ".slf"))
            slf("build", *recipe, "-o", fields[-1], "-f", *lattice)
        fields.append(path("partial.slf"))
        slf("repack", fields[0], "-o", fields[-1], "-f", "--subfields", "0-40", "--levels", 1,
            "--codec", "jpeg:90")
        return fields

    def psnr(self, page, field, view, mode, level, fragment="", options=()):
        """Of the page's canvas beside slf render; `fragment` says to the page what `options` do."""
        name = f"{os.path.basename(field)}-{mode}-{'_'.join(map(str, view))}"
        fragment = f"view={','.join(map(str, view))}&mode={mode}&level={level}" + fragment
        page.run(f"""new Promise((done) => {{
          addEventListener('hashchange', done, {{once: true}});
          location.hash = '{fragment}';
        }}).then(() => 0)""")
        page.settle()
        shown, drawn = path(name + "-page.png"), path(name + "-slf.png")
        page.canvas(shown)
        slf("render", field, "-o", drawn, "-f", "--mode", mode, "--level", level, "--orbit",
            ",".join(map(str, view)), "--size", f"{SIZE}x{SIZE}", "--background", "0,0,0", *options)
        return json.loads(slf("compare", shown, drawn, "--json"))["psnr"] or 99.0

    def cut_field(self, name="cut", *options):
        """A field of a small volume with a reveal: balls in a box, one of them hollow."""
        field, raw = path(name + ".slf"), path("balls.raw")

        def value(x, y, z):
            away = [math.dist((x, y, z), center) for center in [(14, 16, 16), (23, 16, 12)]]
            inside = 60 + 5 * z if 4 < away[0] < 11 else 220 if away[1] < 5 else 0
            return min(255, inside)

        with open(raw, "wb") as file:
            file.write(bytes(value(x, y, z) for z in range(32) for y in range(32)
                             for x in range(32)))
        slf("build", raw, "--dims", "32x32x32", "-o", field, "-f", "--entry", 4, "--exit", 16,
            "--levels", 1, "--reveal", *options)
        return field

    @classmethod
    def stated(cls):
        """A field of three states."""
        with open(path("states.json"), "w") as file:
            json.dump({"states": [{"name": "whole"}] + [
                {"name": name, "clip": [[12, 12, 12, *normal]]}
                for name, normal in [("top off", (0, 0, 1)), ("half", (1, 0, 0))]]}, file)
        field = path("states.slf")
        slf("build", path("cube.raw"), "--dims", "24x24x24", "--lighting", "direct", "--levels", 1,
            "--entry", 4, "--exit", 16, "--states", path("states.json"), "-o", field, "-f")
        return field

    @classmethod
    def structured(cls):
        """A field of four structures: a core within two lobes, and a stem."""
        def label(x, y, z):
            square = sum((at - 11.5) ** 2 for at in (x, y, z))
            if max(abs(x - 11.5), abs(y - 11.5)) < 2 and z < 6:
                return 4
            return 0 if square > 81 else 1 if square < 25 else 2 if x < 12 else 3

        with open(path("labels.raw"), "wb") as file:
            file.write(bytes(label(x, y, z)
                             for z in range(24) for y in range(24) for x in range(24)))
        with open(path("labels.json"), "w") as file:
            json.dump({"labels": [{"id": 0, "opacity": 0}] + [
                {"id": k, "name": name, "color": color} for k, name, color in [
                    (1, "core", [0.9, 0.8, 0.6]), (2, "left lobe", [0.4, 0.6, 0.9]),
                    (3, "right lobe", [0.9, 0.5, 0.4]), (4, "stem, white", [1, 1, 1])]]}, file)
        field = path("structures.slf")
        slf("build", path("labels.raw"), "--dims", "24x24x24", "--labels", "--label-table",
            path("labels.json"), "--each-label", "--lighting", "direct", "--levels", 1, "--entry",
            4, "--exit", 16, "-o", field, "-f")
        return field

    def open(self, url, certificate=True, script="", browser=None):
        """Opens an address. `script` runs before the page's own."""
        page = (browser or self.browser).open("about:blank", SIZE, SIZE)
        page.call("Security.setIgnoreCertificateErrors", ignore=not certificate)
        if script:
            page.call("Page.addScriptToEvaluateOnNewDocument", source=script)
        page.call("Page.navigate", url=url)
        return page

    def outcome(self, url, state="loading", **options):
        """Opens an address and returns what the page says once its field is open (state: 'loading')
        or shown ('settled'), or once that has failed."""
        page = self.open(url, **options)
        states = ["failed", "settled"] + (["loading"] if state == "loading" else [])
        page.wait(f"{states}.includes(globalThis.slf?.state)")
        said = page.run("slf.state === 'failed' ? slf.message : ''")
        page.close()
        return said

    def site(self):
        """A folder with the page and a small field."""
        folder = path("small/site")
        os.makedirs(path("small"), exist_ok=True)
        slf("export", self.fields[0], "-o", folder, "-f", "--levels", "0")
        return folder

    def explained(self, views, field=None):
        """slf view of a field with views, and the page."""
        with open(path("views.json"), "w") as file:
            json.dump(views, file)
        return Server("--views", path("views.json"), field or self.fields[0])

    SHIFT = 8

    @staticmethod
    def press(page, key, modifiers=0):
        for kind in ["keyDown", "keyUp"]:
            page.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers)

    def drag(self, page, begin, end, steps=8, touch=False, modifiers=0):
        def mouse(kind, share, buttons=1):
            x, y = (a + share * (b - a) for a, b in zip(begin, end))
            if touch:
                touches = {"mousePressed": "touchStart", "mouseMoved": "touchMove"}
                page.call("Input.dispatchTouchEvent", type=touches.get(kind, "touchEnd"),
                          touchPoints=[{"x": x, "y": y}] if buttons else [])
                return
            page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                      buttons=buttons, clickCount=1, modifiers=modifiers)
        mouse("mousePressed", 0)
        for step in range(1, steps + 1):
            mouse("mouseMoved", step / steps)
            page.run("new Promise((done) => requestAnimationFrame(done))")
        mouse("mouseReleased", 1, 0)


def main():
    if not shutil.which("chromium"):
        print("skipped: no chromium")
        sys.exit(77)
    probe = subprocess.run([SLF, "export", "-o", "/dev/null/x.html", "/nonexistent.slf"],
                           capture_output=True)
    if probe.returncode == 5:
        print("skipped: slf was built without the page")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
