"""The page in a headless Chromium: its pictures beside those of slf render.

    page_test.py SLF DECODED WORK_FOLDER [FIELD.slf …]

Exits with 77, which CTest takes for skipped, where there is no browser or no page.
"""

import base64
import hashlib
import json
import math
import os
import re
import signal
import struct
import subprocess
import sys
import time
import unittest
from email.utils import formatdate
from urllib.parse import quote

sys.dont_write_bytecode = True

from browser import Browser, BrowserError, shutil
from host import Handler, Host
from nginx import Nginx

SLF, DECODED, WORK = sys.argv[1:4]
WORK = os.path.abspath(WORK)
ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
VIEWS = [(30, 20, 3), (200, -35, 3), (110, 85, 2.2), (300, 5, 1.4), (75, 0, 6)]
MIN_PSNR = {"bitri": 45.0, "depth": 42.0}  # dB
# Software graphics take a second for a picture of 512². Half of that shows the same mistakes;
# fields that are given are drawn in full.
SIZE = 512 if sys.argv[4:] else 256
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

    def test_pictures_are_those_of_slf_render(self):
        for field in self.fields:
            info = json.loads(slf("info", field, "--json"))
            with Server(field) as server:
                page = self.browser.open(server.url, SIZE, SIZE)
                page.settle()
                for mode in ["depth", "bitri"]:
                    for view in VIEWS:
                        found = self.psnr(page, field, view, mode, info["levels"][-1]["level"])
                        print(f"{os.path.basename(field):20} {mode:6} {view}: {found:.1f} dB",
                              flush=True)
                        with self.subTest(field=field, mode=mode, view=view):
                            self.assertGreaterEqual(found, MIN_PSNR[mode])
                self.assertEqual(page.run("slf.statistics().damaged"), 0)
                page.close()
            self.assertEqual(server.status, -signal.SIGINT)  # as a shell expects of Ctrl-C

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

    def cut(self, page, clip, cap, view="30,20,3"):
        """Shows a cut of the finest level, under its own light, by the page's address."""
        page.run(f"""new Promise((done) => {{
          addEventListener('hashchange', done, {{once: true}});
          location.hash = 'view={view}&level=1&clip={clip}&cap={cap}';
        }}).then(() => new Promise((done) => setTimeout(done, 300)))""")
        page.settle()
        page.wait("""slf.cut.hollow || !slf.cut.of.lit ||
                     (slf.cut.light?.fine && slf.cut.light.clip === slf.root.host.clip.join(';') &&
                      slf.cut.light.view === slf.camera.toText())""")
        page.run("new Promise((done) => setTimeout(done, 300))")
        page.settle()

    def test_cuts_are_those_of_slf_render(self):
        up, two = "16,16,17,0,0,1", "16,16,17,0,0.2,1;13,16,16,1,-1,0"
        for options in [["--lighting", "direct"], ["--lighting", "global"], ["--no-reveal"],
                        ["--lighting", "direct", "--labels"],
                        ["--lighting", "global", "--color-type", "half"]]:
            reveal = "--no-reveal" not in options
            field = self.cut_field("cut", *[o for o in options if reveal])
            if not reveal:
                slf("repack", field, "-o", path("hollow.slf"), "-f", "--no-reveal")
                field = path("hollow.slf")
            with Server(field) as server:
                page = self.browser.open(server.url, SIZE, SIZE)
                page.settle()
                for clip, cap in [(up, "hollow"), (up, "shaded"), (two, "shaded"), (two, "slice"),
                                  (up, "slice:50,250")][:None if reveal else 1]:
                    self.cut(page, clip, cap)
                    page.canvas(path("cut-page.png"))
                    slf("render", field, "-o", path("cut-slf.png"), "-f", "--level", 1, "--orbit",
                        "30,20,3", "--size", f"{SIZE}x{SIZE}", "--background", "0,0,0", "--cap",
                        cap, *[part for plane in clip.split(";") for part in ["--clip", plane]])
                    found = json.loads(slf("compare", path("cut-page.png"), path("cut-slf.png"),
                                           "--json"))["psnr"] or 99
                    print(f"{options} {clip} {cap}: {found:.1f} dB", flush=True)
                    with self.subTest(options=options, clip=clip, cap=cap):
                        self.assertGreaterEqual(found, 42)
                page.close()

    def test_any_distance_that_slf_render_takes_is_shown(self):
        field = self.fields[0]
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            for distance in [0.5, 1.005, 60]:
                found = self.psnr(page, field, (30, 20, distance), "depth", 2)
                with self.subTest(distance=distance):
                    self.assertGreaterEqual(found, MIN_PSNR["depth"])
                    self.assertEqual(page.run("slf.camera.distance"), distance)
            for factor, distance in [(0.9, 54), (1.1, 54), (0.1, 5.4), (0.1, 1.02), (100, 20)]:
                page.run(f"slf.camera.zoom({factor})")  # never further than it is, or 20 radii
                self.assertAlmostEqual(page.run("slf.camera.distance"), distance)
            page.close()

    def test_chooses_the_level_that_slf_render_chooses(self):
        field = self.fields[0]
        sphere = json.loads(slf("info", field, "--json"))["sphere"]

        def drawn(orbit, target, mode, width, height):
            azimuth, elevation, distance = (*map(math.radians, orbit[:2]), orbit[2])
            out = (math.sin(azimuth) * math.cos(elevation),
                   -math.cos(azimuth) * math.cos(elevation), math.sin(elevation))
            at = [c + sphere["radius"] * t for c, t in zip(sphere["center"], target)]
            eye = [c + sphere["radius"] * distance * v for c, v in zip(at, out)]
            half = math.tan(math.radians(FOV / 2)) * max(1, height / width)
            return json.loads(slf(
                "render", field, "-o", path("level.png"), "-f", "--level", "auto", "--mode", mode,
                "--eye", ",".join(map(str, eye)), "--look-at", ",".join(map(str, at)), "--fov",
                math.degrees(2 * math.atan(half)), "--size", f"{width}x{height}", "--stats",
                "--json"))["level"]

        chosen = set()
        with Server(field) as server:
            for width, height in [(120, 120), (200, 130), (130, 200)]:
                page = self.browser.open(server.url, width, height)
                page.wait("['loading', 'settled'].includes(globalThis.slf?.state)")
                self.assertEqual(page.run("[slf.canvas.width, slf.canvas.height]"), [width, height])
                for orbit in [(30, 20, d) for d in (1.5, 3, 5, 6, 8, 10, 14, 20)]:
                    # From the last target, the eye is further from the sphere's centre.
                    for target in [(0, 0, 0), (0, -1, 0.5)]:
                        for mode in ["depth", "bitri"]:
                            view = ",".join(map(str, orbit + target))
                            found = page.run(f"""(() => {{
                              slf.settings.mode = '{mode}';
                              slf.camera.fromText('{view}');
                              return slf.view().level;
                            }})()""")
                            with self.subTest(view=view, mode=mode, size=(width, height)):
                                self.assertEqual(found, drawn(orbit, target, mode, width, height))
                            chosen.add(found)
                page.close()
        self.assertEqual(chosen, {0, 1, 2})

    def test_exposure_and_tone_mapping_are_those_of_slf_render(self):
        field = path("lit.slf")
        if field not in self.fields:
            self.skipTest("other fields are given")
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            for curve, exposure in [("srgb", 1.5), ("neutral", -1)]:
                found = self.psnr(page, field, VIEWS[0], "depth", 1,
                                  f"&curve={curve}&exposure={exposure}",
                                  ("--tonemap", curve, "--exposure", exposure))
                with self.subTest(curve=curve, exposure=exposure):
                    self.assertGreaterEqual(found, MIN_PSNR["depth"])
            page.close()

    def test_the_shaders_tone_curve_is_that_of_slf(self):
        """Over a ramp of half floats, within a grey level."""
        values = [0, 2 ** -24, 2 ** -14, *(10 ** (k / 20) for k in range(-100, 97)), 65504,
                  *(k / 256 for k in range(512))]
        hues = [(1, 1, 1), (1, 0.5, 0.125), (0, 1, 0), (0.9, 0.96, 1), (-1, 0.01, 1)]
        texels = [[v * h for h in hue] + [alpha] for alpha in (1, 0.5, 1 / 255, 0) for hue in hues
                  for v in values]
        width, height = len(values), len(texels) // len(values)
        halves = struct.pack(f"<{4 * len(texels)}e", *(v for texel in texels for v in texel))
        colors = struct.pack(f"<{4 * len(texels)}f",
                             *struct.unpack(f"<{4 * len(texels)}e", halves))
        # The rest of the shader, and a main() that maps the ramp.
        draw = f"""(curve, exposure) => {{
          const canvas = new OffscreenCanvas({width}, {height}), gl = canvas.getContext('webgl2');
          const program = gl.createProgram(), shader = drawShader(false);
          const ramp = shader.slice(0, shader.indexOf('void main()')) +
            `void main() {{
               result = mapped(texelFetch(uColor, ivec3(gl_FragCoord.xy, 0), 0), uCurve, uGain);
             }}`;
          for (const [type, text] of [[gl.VERTEX_SHADER, kVertex], [gl.FRAGMENT_SHADER, ramp]]) {{
            const shader = gl.createShader(type);
            gl.shaderSource(shader, text);
            gl.compileShader(shader);
            gl.attachShader(program, shader);
          }}
          gl.linkProgram(program);
          if (!gl.getProgramParameter(program, gl.LINK_STATUS))
            throw new Error(gl.getAttachedShaders(program).map((s) => gl.getShaderInfoLog(s)));
          gl.useProgram(program);
          gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
          gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA16F, {width}, {height}, 1);
          for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
            gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, gl.NEAREST);
          gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, 0, {width}, {height}, 1, gl.RGBA,
                           gl.HALF_FLOAT, new Uint16Array(halves.buffer));
          const target = gl.createTexture(), bytes = new Uint8Array({4 * len(texels)});
          gl.bindTexture(gl.TEXTURE_2D, target);
          gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, {width}, {height});
          gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
          gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
          gl.uniform1i(gl.getUniformLocation(program, 'uCurve'), kCurves.indexOf(curve));
          gl.uniform1f(gl.getUniformLocation(program, 'uGain'), 2 ** exposure);
          gl.viewport(0, 0, {width}, {height});
          gl.drawArrays(gl.TRIANGLES, 0, 3);
          gl.readPixels(0, 0, {width}, {height}, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
          if (gl.getError()) throw new Error('WebGL');
          return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join(''));
        }}"""
        with Host(os.path.join(ROOT, "page/web")) as host:
            page = self.browser.open(host.url + "/style.css", 64, 64)
            page.wait("document.readyState === 'complete'")
            page.run(f"""import('./shader.js').then(({{drawShader, kVertex, kCurves}}) => {{
              const halves = Uint8Array.from(atob('{base64.b64encode(halves).decode()}'),
                                             (c) => c.charCodeAt(0));
              globalThis.draw = {draw};
            }})""")
            for number, curve in enumerate(["neutral", "srgb", "none"]):  # as ToneCurve
                for exposure in [0, 1.5, -1, 6, -6]:
                    found = base64.b64decode(page.run(f"draw('{curve}', {exposure})"))
                    mapped = subprocess.run([DECODED, "--tones", str(number), str(exposure)],
                                            input=colors, check=True, capture_output=True).stdout
                    exact = [255 * min(max(v, 0), 1) for v in
                             struct.unpack(f"<{4 * len(texels)}f", mapped)]
                    worst = max(range(len(exact)), key=lambda i: abs(found[i] - exact[i]))
                    with self.subTest(curve=curve, exposure=exposure, color=texels[worst // 4]):
                        self.assertLess(abs(found[worst] - exact[worst]), 0.75)
            page.close()

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

    def test_states(self):
        """The states of a field, by link, by keys and as a film. What they share comes once."""
        field = self.stated()
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            for state in ["top off", "half", "whole"]:
                found = self.psnr(page, field, VIEWS[0], "depth", 1, f"&state={quote(state)}",
                                  ("--state", state))
                with self.subTest(state=state):
                    self.assertGreaterEqual(found, MIN_PSNR["depth"])
            self.assertEqual(page.run("slf.statistics().damaged"), 0)
            loaded = page.run("slf.statistics().bytes")
            for key, state in 2 * [(".", 1), (".", 2), (",", 1), (",", 0)]:
                self.press(page, key)
                page.settle()
                self.assertEqual(page.run("slf.field.state"), state)
            # A coarse picture may ask for a tile that the finished one does not show.
            seen = page.run("slf.statistics().bytes")
            self.assertLess(seen, 1.01 * loaded)
            for key in [".", ".", ","]:
                self.press(page, key)
                page.settle()
            self.assertIn("state=top%20off", page.run("location.hash"))
            self.assertEqual(page.run("slf.statistics().bytes"), seen)
            self.press(page, "p")
            for state in [2, 0, 1]:
                page.wait(f"slf.field.state === {state}", 20)
            self.press(page, "p")
            page.close()

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

    @staticmethod
    def labelled(name, structures):
        """A small field of structures of these names."""
        with open(path(name + ".raw"), "wb") as file:
            file.write(bytes(1 + k % len(structures) for k in range(8 ** 3)))
        with open(path(name + ".json"), "w") as file:
            json.dump({"labels": [{"id": k + 1, "name": one, "color": [1, 1, 1]}
                                  for k, one in enumerate(structures)]}, file)
        field = path(name + ".slf")
        slf("build", path(name + ".raw"), "--dims", "8x8x8", "--labels", "--label-table",
            path(name + ".json"), "--each-label", "--lighting", "direct", "--levels", 0, "--entry",
            2, "--exit", 4, "-o", field, "-f")
        return field

    def same_as(self, page, field, *structures, view=VIEWS[0], fragment=""):
        """Whether the page shows what slf render --structure draws."""
        options = [text for name in structures for text in ("--structure", name)]
        found = self.psnr(page, field, view, "depth", 1, fragment, options)
        with self.subTest(structures=structures, view=view):
            self.assertGreaterEqual(found, MIN_PSNR["depth"])

    def test_structures(self):
        """The list: what is hidden, alone, faded and tinted looks as slf render draws it."""
        field = self.structured()
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            part = "slf.root.querySelector('[aria-label=\"{}\"]')"

            def click(label):
                page.run(part.format(label) + ".click()")
                page.settle()

            def enter(label, value):
                page.run(f"""(() => {{
                  const input = {part.format(label)};
                  input.value = {json.dumps(value)};
                  input.dispatchEvent(new Event('input'));
                }})()""")
                page.wait("!slf.stale")
                page.settle()

            self.assertEqual(page.run(
                "[...slf.root.querySelectorAll('#list label')].map((e) => e.textContent)"),
                ["core", "left lobe", "right lobe", "stem, white"])
            self.assertTrue(page.run("slf.root.getElementById('states').hidden"))
            for view in VIEWS[:2]:
                self.same_as(page, field, view=view)
            self.psnr(page, field, VIEWS[1], "depth", 0)  # all tiles of which are there
            page.wait("!slf.statistics().busy")
            loaded = page.run("slf.statistics().bytes")
            for label in ["Show left lobe", "Show stem, white", "Only core", "Only core"]:
                click(label)
            page.run("slf.root.getElementById('all-on').click()")
            page.settle()
            page.wait("!slf.statistics().busy")  # nothing of all structures is on its way
            self.assertEqual(page.run("slf.statistics().bytes"), loaded)
            # Rays meet other surfaces now, but none of what is hidden, which is read only where
            # others are predicted from it.
            page.run("""(() => {
              const {composer} = slf.loader, {reader} = composer;
              globalThis.states = new Set();
              composer.reader = {
                read(pages) {
                  pages.forEach((page) => states.add(Math.floor(page / slf.field.shape.pages)));
                  return reader.read(pages);
                },
                place: (...tile) => reader.place(...tile),
              };
            })()""")
            click("Show right lobe")
            self.same_as(page, field, "*", "right lobe:0", view=VIEWS[1])
            self.assertEqual(page.run("[...states].sort()"), [0, 1, 3])
            self.assertIn("structures=*,right%20lobe:0&", page.run("location.hash"))
            click("Only core")
            self.same_as(page, field, "core", view=VIEWS[1])
            click("Only core")  # what was shown before
            self.same_as(page, field, "*", "right lobe:0", view=VIEWS[1])
            page.run("slf.root.getElementById('all-on').click()")
            enter("Opacity of left lobe", "0.4")
            enter("Tint of stem, white", "#ffd080")
            self.same_as(page, field, "*", "left lobe:0.4", "stem, white:#ffd080")
            self.assertEqual(page.run("document.querySelector('slf-field').structures"),
                             ["*", "left lobe:0.4", "stem, white:#ffd080"])
            page.run("slf.root.getElementById('all-off').click()")
            page.settle()
            self.assertEqual(page.run("slf.loader.tiles"), 0)
            self.assertEqual(page.run("slf.statistics().damaged"), 0)
            page.close()

    def test_structures_by_address_and_keyboard(self):
        field = self.structured()
        with Server(field) as server:
            loaded = {}
            for structures, options in [
                    ("*", ["*"]), ("stem%2C white", ["stem, white"]),
                    ("*lobe:0.3:%23ffd0b0,core", ["*lobe:0.3:#ffd0b0", "core"])]:
                page = self.browser.open(server.url + f"#structures={structures}", SIZE, SIZE)
                page.settle()
                page.wait("!slf.statistics().busy")
                loaded[structures] = page.run("slf.statistics().bytes")
                self.same_as(page, field, *options)
                page.close()
            # What is hidden is not loaded.
            self.assertLess(loaded["stem%2C white"], 0.6 * loaded["*"])
            page = self.browser.open(server.url + "#structures=core,no such", SIZE, SIZE)
            page.settle()
            self.assertIn("no structure named no such",
                          page.run("slf.root.getElementById('status').textContent"))
            if page.run("slf.root.getElementById('parts').hidden"):
                self.press(page, "l")
            reached = []
            for _ in range(60):
                self.press(page, "Tab")
                reached.append(page.run("slf.root.activeElement?.getAttribute('aria-label')"))
                if reached[-1] == "Show left lobe":
                    break
            self.assertEqual(reached[-5:], ["Show core", "Opacity of core", "Tint of core",
                                            "Only core", "Show left lobe"])
            self.press(page, " ")
            page.wait("slf.field.layers.length === 2")
            self.press(page, "Tab")
            self.press(page, "ArrowLeft")
            page.wait("slf.field.layers[1].opacity === 0.99")
            self.assertEqual(page.run("slf.camera.toText()"), "30,20,3")
            page.settle()
            self.assertIn("structures=core,left%20lobe:0.99", page.run("location.hash"))
            page.close()

    def test_begins_with_the_state_that_slf_view_is_told(self):
        """A state, by name or number; of structures, the one of that name alone."""
        views = {"views": [{"title": "Faded", "orbit": [60, 10, 3], "structures": ["*:0.5"]}]}
        with open(path("first.json"), "w") as file:
            json.dump(views, file)
        parts = self.labelled("begin", ["a", 'b, "c" <d>&%2C', "e:0.5", "f*"])
        with open(path("states2.json"), "w") as file:
            json.dump({"states": [{"name": "a"}, {"name": 'b, "c" <d>&%2C', "transfer": "flame"}]},
                      file)
        field = path("states2.slf")
        slf("build", path("cube.raw"), "--dims", "24x24x24", "--lighting", "direct", "--levels", 0,
            "--entry", 2, "--exit", 8, "--states", path("states2.json"), "-o", field, "-f")
        shown = "[slf.field.state, slf.field.layers.map(({state, opacity}) => [state, opacity])]"
        everything = [[0, 1], [1, 1], [2, 1], [3, 1]]
        for arguments, fragment, expected in [
                ([field], "", [0, []]),
                (["--state", "1", field], "", [1, []]),
                (["--state", 'b, "c" <d>&%2C', field], "", [1, []]),
                (["--state", "1", field], "#state=a", [0, []]),
                ([parts], "", [0, everything]),
                (["--state", "1", parts], "", [0, [[1, 1]]]),
                (["--state", 'b, "c" <d>&%2C', parts], "", [0, [[1, 1]]]),
                (["--state", "e:0.5", parts], "", [0, [[2, 1]]]),
                (["--state", "3", parts], "#structures=a,e*:0.2", [0, [[0, 1], [2, 0.2]]]),
                (["--views", path("first.json"), parts], "",
                 [0, [[state, 0.5] for state, _ in everything]]),
                (["--state", "0", "--views", path("first.json"), parts], "", [0, [[0, 1]]])]:
            with self.subTest(arguments=arguments, fragment=fragment), Server(*arguments) as server:
                page = self.browser.open(server.url + fragment, 64, 64)
                page.wait("['loading', 'settled', 'failed'].includes(globalThis.slf?.state)")
                self.assertEqual(page.run(shown), expected)
                page.close()

    def test_picks_the_nearest_structure_that_is_shown(self):
        """As slf pick; what is hidden is not there."""
        field = self.structured()
        radius = json.loads(slf("info", field, "--json"))["sphere"]["radius"]
        depths = {}
        with Server(field) as server:
            for structures in ["*", "*,right lobe:0", "left lobe", "core,right lobe:0.3", "*:0"]:
                view = "#view=90,0,3&level=1&structures=" + quote(structures, safe=",*:")
                page = self.browser.open(server.url + view, SIZE, SIZE)
                page.settle()
                found = page.run(f"slf.pick({SIZE / 2}, {SIZE / 2})")
                page.close()
                options = [text for name in structures.split(",") for text in ("--structure", name)]
                same = json.loads(slf("pick", field, "--orbit", "90,0,3", "--size",
                                      f"{SIZE}x{SIZE}", f"{SIZE // 2},{SIZE // 2}", "--json",
                                      *options))
                with self.subTest(structures=structures):
                    self.assertEqual(found is None, same["point"] is None)
                    for a, b in zip((found or same)["point"] or [], same["point"] or []):
                        self.assertLess(abs(a - b), 0.02 * radius)
                depths[structures] = found and found["depth"]
        # The lobe reaches to 9 voxels from the middle, the core to 5. A faint lobe counts less than
        # the core behind it.
        self.assertAlmostEqual(depths["*,right lobe:0"] - depths["*"], 4, delta=1)
        self.assertGreater(depths["core,right lobe:0.3"], depths["*"] + 2)
        self.assertGreater(depths["left lobe"], depths["*,right lobe:0"] + 4)
        self.assertIsNone(depths["*:0"])

    def test_texts_show_the_structures_that_slf_render_shows(self):
        names = ["core", "left lobe", "stem, white", "Körper", "a:b", "[x]", "1*2", "a.b", "0.5",
                 "e:0.5", "e:0.5:7", "132", "c*"]
        field = self.labelled("named", names)
        patterns = [
            *names, "*", "?ore", "???? ????", "left *", "*e*", "[ck]*", "[!c]*", "[a-c]*", "K*r",
            "", "cor", "Core", "core*core", "[", "[c", "a.?", "a?b", "a+", "(", "$",
            "1\\*2", "1\\**", "\\c\\o\\re", "1\\d2", "core\\"]
        looks = [
            "", "0", "1", "0.25", ".5", "5.", "1.", "0.", ".", "1e-1", "1E-1", "1e-1.", "e-1", "1e",
            "0x1", "+1", "-1", "-0", "1.01", "2", "1e2", "inf", "nan", " 1", "1 ", "0,5", "0.3:0.7",
            "#ff8000", "#FF8000", "#ff80", "#ff800", "#ff80000", "#gg0000", "#12345-", "#-12345",
            "#", "0.5:#ff8000", "#ff8000:0.5", "#ff8000:0", "0:#ff8000", "0.5:#ff80", "#ff80:0.5",
            ":", ":0.5", "1:", "#000000"]
        lists = [[text] for text in patterns + [f"core:{look}" for look in looks]] + [
            ["*:0.5:#010203"], ["a:b:0.5"], ["a:*:#ffffff"], ["a:0.5"], ["0.5:0.5"], [":0.5"],
            [":"], ["*:0.5", "core"], ["core", "*:0.5"], ["*", "l*:0", "a:b:#ff0000", "*x*:0.1"],
            ["core", "none"], ["e:0.5:0.25"], ["e:0.5:7:#ff0000"], ["e"], ["e:*:0.5"]]
        folder = path("named")
        slf("export", field, "-o", folder, "-f")
        shutil.copytree(os.path.join(ROOT, "page/web"), os.path.join(folder, "source"),
                        dirs_exist_ok=True)
        with Host(folder) as host:
            page = self.browser.open(host.url + "/index.html", 64, 64)
            page.settle()
            # With an unknown name, so that there are looks even if none is known.
            found = page.run(f"""import('./source/structures.js').then(({{looksOf, layersOf}}) =>
              {json.dumps(lists)}.map((texts) => {{
                const {{looks, unknown}} = looksOf(slf.field, ['core:0', ...texts, 'no']);
                return unknown.length > 1 ? 'refused' : layersOf(looks).map(
                  ({{state, opacity, tint}}) => `${{state}} ${{opacity}} ${{tint}}`);
              }}))""")
            page.close()
        for texts, shown in zip(lists, found, strict=True):
            done = subprocess.run([DECODED, "--looks", field, *texts], capture_output=True,
                                  text=True)
            slfs = done.stdout.splitlines() if done.returncode == 0 else "refused"
            with self.subTest(texts=texts):
                self.assertIn(done.returncode, [0, 4])
                self.assertEqual(shown, slfs)

    def test_hostile_patterns_in_the_address_take_no_time(self):
        field = self.labelled("hostile", ["a" * 60, "b"])
        with Server(field) as server:
            for pattern in ["*a" * 12 + "*b", "*?" * 20 + "*b", "*[!b]" * 12 + "*b", "[" * 5000]:
                page = self.browser.open(f"{server.url}#structures={quote(pattern)}", 64, 64)
                begin = time.monotonic()
                page.settle(30)
                self.assertLess(time.monotonic() - begin, 10)
                page.close()

    def test_structures_in_saved_views_and_as_an_attribute(self):
        field = self.structured()
        views = {"views": [{"title": "All", "orbit": [30, 20, 3]},
                           {"title": "Core", "orbit": [30, 20, 3], "structures": ["core:0.5"]}]}
        with self.explained(views, field) as server:
            page = self.browser.open(server.url + "#saved=2", SIZE, SIZE)
            page.wait("slf.field?.layers?.length === 1 && slf.field.layers[0].opacity === 0.5")
            page.run("""document.querySelector('slf-field').setAttribute('structures',
                          'stem%2C white'); 0""")
            page.wait("slf.field.layers.length === 1 && slf.field.layers[0].state === 3")
            self.assertEqual(page.run("slf.root.getElementById('shown').textContent"), "1 of 4")
            page.close()

    def test_decodes_the_same_samples(self):
        for field in self.fields:
            stride = 31
            native = subprocess.run([DECODED, field, str(stride)], check=True, capture_output=True)
            with self.subTest(field=field), Server(field) as server:
                page = self.browser.open(server.url, 64, 64)
                page.settle()
                text = page.run(f"""(async () => {{
                  const pages = [];
                  for (let p = 0; p < slf.field.shape.pages; p += {stride}) pages.push(p);
                  const parts = [];
                  for (const tile of await Promise.all(slf.loader.reader.read(pages)))
                    for (const part of [tile.color, tile.depth]) if (part) parts.push(part);
                  const all = await new Blob(parts).arrayBuffer();
                  const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', all));
                  return Array.from(digest, (b) => b.toString(16).padStart(2, '0')).join('');
                }})()""", 120)
                self.assertEqual(text, hashlib.sha256(native.stdout).hexdigest())
                page.close()

    def test_tiles_and_their_copies_in_workers_share_one_budget(self):
        """Decodes tiles that are predicted from 3 of 12 others of 100 bytes, where 10 fit."""
        with Host(os.path.join(ROOT, "page/web")) as host:
            page = self.browser.open(host.url + "/style.css", 64, 64)
            page.wait("document.readyState === 'complete'")
            found = page.run("""(async () => {
              const {Decoders} = await import('./decoders.js');
              const workers = [], found = {lacking: 0, most: 0, held: 0, sent: 0};
              const makeWorker = () => {  // as worker.js, without decoding
                const copies = new Set(), port = {copies, postMessage: (message) => {
                  message.forget.forEach((page) => copies.delete(page));
                  for (const {page, samples} of message.references) {
                    if (samples) copies.add(page), ++found.sent;
                    found.lacking += !copies.has(page);
                  }
                  setTimeout(() => port.onmessage({data: {id: message.id}}));
                }};
                workers.push(port);
                return port;
              };
              const decoders = new Decoders(makeWorker), {cache} = decoders;
              cache.budget = 1000;
              const decode = (i) => {
                const references = [i >> 3, i, i * i].map((k) => {
                  const page = k % 12;
                  if (!cache.get(page)) cache.set(page, true, 100);
                  return {page, samples: new Uint8Array(100)};
                });
                const done = decoders.decode({level: 1}, undefined, references);
                found.most = Math.max(found.most, cache.bytes);
                return done;
              };
              for (let i = 0; i < 500; i += 10)
                await Promise.all(Array.from({length: 10}, (_, k) => decode(i + k)));
              await Promise.all(workers.map(() => decoders.decode({level: 1}, undefined, [])));
              found.held = workers.reduce((sum, {copies}) => sum + 100 * copies.size, 0);
              return found;
            })()""")
            self.assertEqual(found["lacking"], 0)
            self.assertLessEqual(found["most"], 1000)
            self.assertLess(0, found["held"])
            self.assertLessEqual(found["held"], 1000)
            self.assertLess(found["sent"], 1000)  # of 1500
            page.close()

    def test_a_field_without_an_index_shows_the_same(self):
        bare = path("bare.slf")
        with open(self.fields[0], "rb") as file:
            content = file.read()
        with open(bare, "wb") as file:
            file.write(content[:-index_size(self.fields[0])])
        with Server(bare) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            self.assertGreaterEqual(self.psnr(page, bare, VIEWS[0], "depth", 2), MIN_PSNR["depth"])
            self.assertEqual(page.run("slf.statistics().damaged"), 0)
            page.close()

    def test_one_file_shows_the_same_offline(self):
        field, html = self.fields[0], path("one.html")
        slf("export", field, "-o", html, "-f")
        page = self.browser.open("file://" + os.path.abspath(html), SIZE, SIZE)
        page.settle()
        self.assertGreaterEqual(self.psnr(page, field, VIEWS[0], "bitri", 1), MIN_PSNR["bitri"])
        page.close()

    def test_a_site_works_below_a_path_and_in_a_frame(self):
        folder = path("host/below/site")
        slf("export", self.fields[0], "-o", folder, "-f")
        with open(path("host/frame.html"), "w") as file:
            file.write('<iframe src="below/site/index.html" width="400" height="300"></iframe>')
        with Host(path("host")) as host:
            page = self.browser.open(host.url + "/frame.html", 512, 512)
            page.wait("frames[0]?.slf?.state === 'settled'")
            page.close()

    def counted_site(self):
        """A folder with the page and a field, and the bytes of its index."""
        folder, ordered = path("counted"), path("ordered.slf")
        # How a build lays tiles out depends on its speed; a repacked field has them in order.
        slf("repack", self.fields[0], "-o", ordered, "-f")
        slf("export", ordered, "-o", folder, "-f")
        return folder, index_size(os.path.join(folder, "field.slf"))

    @staticmethod
    def payload(folder, view):
        """The bytes of the tiles of a view."""
        return json.loads(slf("render", os.path.join(folder, "field.slf"), "-o",
                              path("payload.png"), "-f", "--orbit", view, "--size", SIZE, "--level",
                              "finest", "--stats", "--json"))["compressed_bytes"]

    def test_a_cold_view_takes_few_requests(self):
        folder, index = self.counted_site()
        # In the last view, depths move rays to other tiles more than once.
        for ranges, view in [("many", VIEWS[0]), ("one", VIEWS[0]), ("many", (117, 71, 3.9))] + \
                [("HTTP/2", view) for view in VIEWS[:2] if Nginx.available()]:
            view = ",".join(map(str, view))
            payload = self.payload(folder, view)
            with self.subTest(ranges=ranges, view=view), \
                    Nginx(folder) if ranges == "HTTP/2" else Host(folder, ranges) as host:
                page = self.open(f"{host.url}/index.html#view={view}&level=2",
                                 certificate=ranges != "HTTP/2")
                page.settle()
                page.wait("!slf.statistics().busy")
                found = page.run("slf.statistics()")
                print(f"{ranges}: {payload} bytes of payload, {found}", flush=True)
                self.assertLessEqual(len(host.answers("field.slf")), 40)
                self.assertEqual(len(host.answers("field.slf")), found["requests"])
                self.assertEqual(host.bytes("field.slf"), found["bytes"])  # none was refused
                self.assertLessEqual(found["first"]["requests"], 4)
                self.assertLessEqual(found["first"]["roundTrips"], 3)
                self.assertLessEqual(found["complete"]["roundTrips"], 4)
                if ranges == "many":
                    # Tiles are small here: the headers of parts take 140 bytes each.
                    self.assertLessEqual(host.bytes("field.slf"), 1.5 * payload + index + 65536)
                else:  # gaps may have twice the bytes of what is asked for, and 128 KiB
                    self.assertLessEqual(host.bytes("field.slf"), 3 * payload + index + 3 * 65536)
                page.close()

    def early_site(self):
        """A folder whose level 0 is too large to be loaded whole."""
        field, folder = path("early.slf"), path("early")
        slf("build", "scene:fog", "--entry", 4, "--exit", 16, "--levels", 0, "--codec", "raw",
            "-o", field, "-f")
        slf("export", field, "-o", folder, "-f")
        return folder

    def test_the_first_tiles_come_before_the_module(self):
        """The exporter lists them; no other request for tiles comes before the first picture."""
        class Late(Handler):  # the module comes after the tiles are asked for
            ranges_asked = []

            def do_GET(self):
                if self.path.endswith("field.slf"):
                    Late.ranges_asked.append(self.headers["Range"])
                deadline = time.monotonic() + 20
                while self.path.endswith("module.bin") and len(Late.ranges_asked) < 3 \
                        and time.monotonic() < deadline:
                    time.sleep(0.01)
                super().do_GET()

        with Host(self.early_site(), handler=Late) as host:
            page = self.open(host.url + "/index.html")
            page.settle()
            found = page.run("slf.statistics().first")
            page.close()
            self.assertIn(",", Late.ranges_asked[2])
            self.assertLessEqual(found["requests"], 4)
            self.assertLess(found["milliseconds"], 20000)

    def test_a_list_of_first_tiles_that_is_wrong_does_no_harm(self):
        folder = self.early_site()
        field = os.path.join(folder, "field.slf")
        slf("export", self.fields[0], "-o", path("other"), "-f")
        shutil.copy(path("other/field.slf"), field)  # smaller; index.html is of the old one
        with Host(folder) as host:
            page = self.open(host.url + "/index.html")
            page.settle()
            self.assertGreaterEqual(self.psnr(page, field, VIEWS[0], "depth", 2), MIN_PSNR["depth"])
            page.close()

    def test_a_second_visit_fetches_no_tile_again(self):
        """Unless the field has changed, or the host forbids that it is stored."""
        folder, _ = self.counted_site()
        field, kinds = os.path.join(folder, "field.slf"), ["many", "one", "no-store"]
        for kind in kinds + ["HTTP/2"] * Nginx.available():
            headers = {"Cache-Control": "no-store"} if kind == "no-store" else {}
            with self.subTest(kind=kind), Nginx(folder) if kind == "HTTP/2" else \
                    Host(folder, "one" if kind == "one" else "many", headers=headers) as host:
                visits, pictures = [], []
                for visit in range(3):
                    if visit == 2:
                        os.utime(field)  # another ETag
                    before = host.bytes("field.slf")
                    page = self.open(f"{host.url}/index.html#view=30,20,3&level=2",
                                     certificate=kind != "HTTP/2")
                    page.settle()
                    page.wait("!slf.statistics().busy")
                    pictures.append(page.run(PICTURE))
                    visits.append(host.bytes("field.slf") - before)
                    page.close()
                print(f"{kind}: {visits} bytes in three visits", flush=True)
                self.assertEqual(len(set(pictures)), 1)
                self.assertGreater(visits[2], 200000)
                if kind == "no-store":
                    self.assertGreater(visits[1], 200000)
                else:
                    self.assertLessEqual(visits[1], 8192 + 65536)  # the start and the end

    def test_what_is_damaged_in_the_browsers_store_is_fetched_again(self):
        """At the visit after the one that finds it."""
        folder, _ = self.counted_site()

        def visit(host):
            page = self.open(f"{host.url}/index.html#view=30,20,3&level=2")
            page.wait("['settled', 'failed'].includes(globalThis.slf?.state)")
            picture = page.run(PICTURE)
            return page, picture

        with Host(folder, "one") as host:
            page, right = visit(host)
            page.run("""(async () => {
              const cache = await caches.open((await caches.keys())[0]);
              for (const key of await cache.keys()) {
                const {byteLength} = await (await cache.match(key)).arrayBuffer();
                await cache.put(key, new Response(new Uint8Array(byteLength).fill(1)));
              }
            })()""")
            page.close()
            page, wrong = visit(host)
            page.close()
            self.assertNotEqual(wrong, right)
            page, again = visit(host)
            page.close()
            self.assertEqual(again, right)

    def test_a_damaged_tile_where_nothing_is_stored_is_just_a_tile(self):
        """In a sandbox, where reading `caches` throws."""
        folder, _ = self.counted_site()
        sandbox = {"Content-Security-Policy": "sandbox allow-scripts",
                   "Access-Control-Allow-Origin": "*",
                   "Access-Control-Expose-Headers": "ETag, Content-Range"}
        field = os.path.join(folder, "field.slf")
        lines = [line.split("\t") for line in slf("ls", field, "--level", 2).splitlines()]
        with open(field, "r+b") as file:
            for line in lines:
                if line[1] == "stored":
                    file.seek(int(line[3]))
                    file.write(bytes(int(line[2])))
        with Host(folder, headers=sandbox, preflight=True) as host:
            self.assertEqual(self.outcome(host.url + "/index.html#level=2", "settled"), "")

    def open(self, url, certificate=True, script=""):
        """Opens an address. `script` runs before the page's own."""
        page = self.browser.open("about:blank", SIZE, SIZE)
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

    def test_a_folder_works_from_disk(self):
        folder = os.path.abspath(self.site())
        page = self.open("file://" + os.path.join(folder, "index.html"))
        page.wait("globalThis.slf?.state === 'asking'")
        self.assertIn("Choose field.slf", page.run("slf.root.getElementById('choose').innerText"))
        chooser = page.call("Runtime.evaluate", expression="slf.root.getElementById('file')")
        page.call("DOM.setFileInputFiles", objectId=chooser["result"]["objectId"],
                  files=[os.path.join(folder, "field.slf")])
        page.settle()
        self.assertTrue(page.run("slf.root.getElementById('choose').hidden"))
        page.close()

    def test_a_folder_works_without_the_slash_at_its_end(self):
        with Host(os.path.dirname(self.site())) as host:
            self.assertEqual(self.outcome(host.url + "/site"), "")

    def test_a_path_that_begins_with_two_slashes_names_no_host(self):
        class Literal(Handler):  # as hosts that do not merge slashes
            def translate_path(self, name):
                return self.host.folder if name.endswith("/site") else super().translate_path(
                    "/" + name.rsplit("/", 1)[1])

            def parse_request(self):  # Python's own takes one slash away
                fine = super().parse_request()
                if fine:
                    self.path = self.raw_requestline.decode().split()[1]
                return fine

        with Host(self.site()) as other, Host(self.site(), handler=Literal) as host:
            address = f"{host.url}//{other.url.removeprefix('http://')}/site"
            self.assertEqual(self.outcome(address), "")
            self.assertEqual(other.log, [])

    def test_notices_that_a_file_is_swapped_whose_version_nobody_tells(self):
        """Two fields of equal length, on a host without ETags."""
        fields = []
        for name, value in [("swap-a", 200), ("swap-b", 150)]:
            with open(path(name + ".raw"), "wb") as file:
                file.write(bytes(value if all(6 <= at < 18 for at in (x, y, z)) else 10
                                 for z in range(24) for y in range(24) for x in range(24)))
            fields.append(path(name + ".slf"))
            slf("build", path(name + ".raw"), "--dims", "24x24x24", "--range", "0,255",
                "--lighting", "direct", "--levels", 1, "--entry", 4, "--exit", 8, "--codec", "raw",
                "-o", fields[-1], "-f")
        self.assertEqual(*map(os.path.getsize, fields))
        folder = path("swapped")
        slf("export", fields[0], "-o", folder, "-f")

        class Swapping(Handler):
            answers, after = 0, 1000

            def send_header(self, name, value):
                if name != "ETag":
                    super().send_header(name, value)

            def translate_path(self, name):
                if not name.endswith("field.slf"):
                    return super().translate_path(name)
                Swapping.answers += 1
                return fields[Swapping.answers > Swapping.after]

        for ranges in ["many", "one"]:
            outcomes = []
            for Swapping.after in [1000, 4, 5, 6, 8]:
                Swapping.answers = 0
                with Host(folder, ranges=ranges, handler=Swapping) as host:
                    page = self.open(host.url + "/index.html")
                    page.wait("['failed', 'settled'].includes(slf.state)")
                    page.wait("slf.state === 'failed' || !slf.statistics().busy")
                    page.run("new Promise((done) => setTimeout(done, 500))")
                    outcomes.append(page.run("slf.state === 'failed' ? slf.message : ''"))
                    page.close()
                if Swapping.answers <= Swapping.after:
                    self.assertEqual(outcomes[-1], "")
                else:
                    self.assertIn("has changed on its host", outcomes[-1])
            self.assertGreater(len([said for said in outcomes if said]), 1)

    def test_ctrl_c_leaves_the_browser_that_it_opened(self):
        log, stop = path("opened.txt"), path("opened.stop")
        for name in [log, stop]:
            if os.path.exists(name):
                os.remove(name)
        os.makedirs(path("bin"), exist_ok=True)
        with open(path("bin/xdg-open"), "w") as file:
            file.write(f"#!/bin/sh\ntrap 'echo interrupted >>{log}' INT\necho $1 >>{log}\n"
                       f"while [ ! -e {stop} ]; do sleep 0.1; done\necho ended >>{log}\n")
        os.chmod(path("bin/xdg-open"), 0o755)

        def said(what):
            deadline = time.monotonic() + 20
            while time.monotonic() < deadline:
                if os.path.exists(log) and what in open(log).read():
                    return open(log).read()
                time.sleep(0.05)
            self.fail(f"xdg-open did not say {what}")

        view = subprocess.Popen([SLF, "-q", "view", "--open", self.fields[0]], text=True,
                                env=os.environ | {"PATH": f"{path('bin')}:{os.environ['PATH']}"},
                                stdout=subprocess.PIPE, start_new_session=True)
        said(view.stdout.readline().strip())
        os.killpg(view.pid, signal.SIGINT)  # as a terminal does
        view.wait(20)
        view.stdout.close()
        time.sleep(0.5)
        open(stop, "w").close()
        self.assertNotIn("interrupted", said("ended"))

    def test_a_wait_for_the_gpu_that_fails_ends(self):
        with Server(self.fields[0]) as server:
            self.assertEqual(self.outcome(server.url, "settled", script="""
              WebGL2RenderingContext.prototype.clientWaitSync = (gl) => 0x911D;  // WAIT_FAILED
              """), "")

    def test_a_sandbox_needs_the_hosts_consent(self):
        sandbox = {"Content-Security-Policy": "sandbox allow-scripts"}  # as of <iframe sandbox>
        with Host(self.site(), headers=sandbox) as host:
            said = self.outcome(host.url + "/index.html")
            self.assertIn("Access-Control-Allow-Origin: *", said)
            self.assertIn("sandbox", said)
        with Host(self.site(), headers=sandbox | {"Access-Control-Allow-Origin": "*"}) as host:
            self.assertEqual(self.outcome(host.url + "/index.html", "settled"), "")

    def test_policies_of_hosts(self):
        """One file under policies that forbid other scripts, workers and WebAssembly."""
        os.makedirs(path("policy"), exist_ok=True)
        slf("export", self.fields[0], "-o", path("policy/one.html"), "-f", "--levels", "0")

        def host(policy):
            return Host(path("policy"), headers={"Content-Security-Policy": policy})

        inline = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
        with host(inline + " 'wasm-unsafe-eval'") as strict:
            self.assertEqual(self.outcome(strict.url + "/one.html", "settled"), "")
        with host(inline) as stricter:
            self.assertIn("'wasm-unsafe-eval'", self.outcome(stricter.url + "/one.html"))
        with host("script-src 'none'") as strictest:
            page = self.open(strictest.url + "/one.html")
            page.wait("document.getAnimations().length > 0 && document.readyState === 'complete'")
            status = "getComputedStyle(document.getElementById('late')).visibility"
            self.assertEqual(page.run(status), "hidden")
            page.run("document.getAnimations().forEach((animation) => animation.finish())")
            self.assertEqual(page.run(status), "visible")
            page.close()

    def test_says_what_is_missing(self):
        with Host(self.site()) as host:
            for name in ["WebAssembly", "DecompressionStream"]:
                said = self.outcome(host.url + "/index.html", script=f"delete globalThis.{name}")
                self.assertIn("too old or locked down: it lacks " + name, said)
            self.assertEqual(self.outcome(host.url + "/index.html", script="""
              WebAssembly.compileStreaming = async () => { throw new Error('no policy'); };"""),
                             "no policy")
            for name in ["module.bin", "module.bin.js"]:
                os.remove(os.path.join(host.folder, name))
            self.assertIn("cannot be loaded: module.bin", self.outcome(host.url + "/index.html"))

    def test_says_that_a_field_is_a_projection(self):
        field = path("mip.slf")
        slf("build", path("cube.raw"), "--dims", "24x24x24", "--projection", "mip", "--levels", 0,
            "--entry", 4, "--exit", 16, "-o", field, "-f")
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            page.run("slf.root.getElementById('about').click()")
            self.assertIn("maximum intensity projection",
                          page.run("slf.root.getElementById('facts-list').textContent"))
            page.close()

    def test_shows_fields_of_other_hosts(self):
        folder = self.site()
        shared = {"Access-Control-Allow-Origin": "*"}
        with Host(folder) as home, Host(folder, headers=shared) as other:
            def at(field):
                return f"{home.url}/index.html?field={field}"

            self.assertEqual(self.outcome(at(other.url + "/field.slf")), "")
            self.assertGreater(other.bytes("field.slf"), 0)
            self.assertEqual(home.bytes("field.slf"), 0)
            self.assertIn("(CORS)", self.outcome(at("http://127.0.0.1:1/field.slf")))
            self.assertIn("not an address", self.outcome(at("http://")))
        with Server(self.fields[0]) as server:
            self.assertIn("only its own", self.outcome(server.url + "?field=" + other.url))

    def test_a_mirror_takes_over(self):
        folder = self.site()

        class Failing(Handler):
            asked, left = 0, 0

            def do_GET(self):
                Failing.asked += self.path.endswith(".slf")
                if Failing.asked <= Failing.left or not self.path.endswith(".slf"):
                    return super().do_GET()
                self.send_response(429)
                self.send_header("Retry-After", "3600")
                self.send_header("Content-Length", "0")
                return self.end_headers()

        shared = {"Access-Control-Allow-Origin": "*"}
        for Failing.left in [0, 4]:  # it fails at once; once the field is open
            Failing.asked = 0
            with Host(folder, "one", handler=Failing) as home, \
                    Host(folder, "one", headers=shared) as mirror:
                both = f"{home.url}/field.slf%20{mirror.url}/field.slf"
                self.assertEqual(self.outcome(f"{home.url}/index.html?field={both}#level=2"), "")
                self.assertGreater(mirror.bytes("field.slf"), 0)
                self.assertLessEqual(Failing.asked, Failing.left + 34)  # those that were under way

    def test_a_host_without_ranges_sends_a_small_field_once(self):
        with Host(self.site(), ranges="none") as host:
            page = self.open(host.url + "/index.html")
            page.settle()
            self.assertEqual(page.run("slf.statistics().bytes"),
                             os.path.getsize(os.path.join(host.folder, "field.slf")))
            self.assertEqual(page.run("slf.root.getElementById('status').textContent"), "")
            page.close()

    def test_says_what_is_wrong(self):
        folder = path("wrong")
        slf("export", self.fields[0], "-o", folder, "-f")
        large = path("large")
        slf("export", self.fields[0], "-o", large, "-f")
        with open(os.path.join(large, "field.slf"), "r+b") as file:
            file.truncate((64 << 20) + 1)
        with Host(folder) as host, Host(large, ranges="none") as plain:
            def message(host):
                page = self.browser.open(host.url + "/index.html", SIZE, SIZE)
                page.wait("globalThis.slf?.state === 'failed'", 60)
                text = page.run("slf.root.getElementById('status').textContent")
                page.close()
                return text

            self.assertIn("ranges", message(plain))
            with open(os.path.join(folder, "field.slf"), "r+b") as file:
                file.truncate(100000)
            self.assertIn("truncated", message(host))
            with open(os.path.join(folder, "field.slf"), "wb") as file:
                file.write(b"x" * 20000)
            self.assertIn("not a field", message(host))
            os.remove(os.path.join(folder, "field.slf"))
            self.assertIn("404", message(host))

    def test_an_orbit_has_no_blank_frame(self):
        with Server(self.fields[0]) as server:
            page = self.browser.open(server.url, 96, 96)
            page.settle()
            blank = page.run("""(async () => {
              const canvas = slf.root.getElementById('picture');
              const gl = canvas.getContext('webgl2');
              const pixels = new Uint8Array(canvas.width * canvas.height * 4);
              let blank = 0;
              for (let i = 0; i < 360; ++i) {
                slf.camera.turn(1, 0);
                slf.moved();
                await new Promise((done) => requestAnimationFrame(done));
                gl.bindFramebuffer(gl.FRAMEBUFFER, null);
                gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
                let lit = 0;
                for (let k = 0; k < pixels.length; k += 4) lit += pixels[k] > 0;
                if (lit < 40) ++blank;
              }
              return blank;
            })()""", 300)
            self.assertEqual(blank, 0)
            state = page.run("slf.statistics()")
            self.assertLessEqual(state["tiles"], state["slots"])
            page.close()

    def test_survives_a_lost_context(self):
        with Server(self.fields[0]) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            page.canvas(path("before.png"))
            page.run("""globalThis.lose = slf.root.getElementById('picture').getContext('webgl2')
                          .getExtension('WEBGL_lose_context');
              globalThis.shown = () => slf.root.querySelector('#picture.shown');
              globalThis.blank = 0;
              const look = () => {  // at what the canvas shows, wherever it shows
                requestAnimationFrame(look);
                const canvas = shown(), gl = canvas?.getContext('webgl2');
                if (!canvas || gl.isContextLost()) return;
                const {width, height} = canvas, pixels = new Uint8Array(width * height * 4);
                gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
                gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
                blank += !pixels.some((v, i) => i % 4 < 3 && v > 100);
              };
              requestAnimationFrame(look), 0""")
            for change in ["0", "slf.camera.turn(40, 0), slf.moved()"]:  # the second one: at work
                page.run(change + ", lose.loseContext()")
                page.run("new Promise((done) => setTimeout(done, 300))")
                self.assertEqual(page.run("[slf.state, shown()]"), ["lost", None])
                page.run("lose.restoreContext(), 0")
                page.settle()
                self.assertEqual(page.run("[blank, shown() !== null, "
                                          "slf.root.getElementById('status').textContent]"),
                                 [0, True, ""])
            page.run("slf.camera.turn(-40, 0), slf.moved()")
            page.settle()
            page.canvas(path("after.png"))
            found = json.loads(slf("compare", path("before.png"), path("after.png"), "--json"))
            self.assertTrue(found["equal"], found)
            page.close()

    def test_no_frame_shows_two_states(self):
        """While states play over a slow link."""
        folder = path("slow")
        slf("export", self.stated(), "-o", folder, "-f")
        with Host(folder, rate=4e4, delay=0.1) as host:
            page = self.open(host.url + "/index.html#view=30,40,3")
            page.settle()
            page.run("""globalThis.frames = [];
              globalThis.frame = () => {
                const canvas = slf.root.getElementById('picture'), gl = canvas.getContext('webgl2');
                const pixels = new Uint8Array(canvas.width * canvas.height * 4);
                gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
                gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
                return pixels;
              };
              const shoot = () => {
                requestAnimationFrame(shoot);
                const now = frame(), last = frames.at(-1);
                if (!last || now.some((v, i) => v !== last[i])) frames.push(now);
              };
              requestAnimationFrame(shoot), 0""")
            self.press(page, "p")
            # A reader turns it meanwhile.
            page.run("""(async () => {
              for (let i = 0; i < 60; ++i) {
                await new Promise((done) => setTimeout(done, 50));
                if (i % 4 === 0) slf.moved();
              }
            })()""")
            page.wait("slf.field.state === 0", 60)
            self.press(page, "p")
            page.run("globalThis.film = frames, 0")
            shares = []
            for state in ["whole", "top off", "half"]:
                page.run(f"slf.root.host.state = '{state}', 0")
                page.settle()
                for level in [0, 1]:
                    page.run(f"slf.settings.level = '{level}', slf.changed(), 0")
                    page.settle()
                    page.run(f"(globalThis.exact ??= {{}})['{state}{level}'] = frame(), 0")
            found = page.run("""film.map((frame) => {
              // How much of a frame is none of the colours that a state has there.
              const others = ['whole', 'top off', 'half'].map((state) => {
                let wrong = 0, all = 0;
                for (let i = 0; i < frame.length; i += 4) {
                  const levels = [exact[state + 0][i], exact[state + 1][i]], v = frame[i];
                  all += v > 40 || Math.max(...levels) > 40;
                  wrong += v > Math.max(...levels) + 40 || v < Math.min(...levels) - 40;
                }
                return wrong / all;
              });
              return Math.min(...others);
            })""")
            print([round(v, 2) for v in found], flush=True)
            self.assertGreater(len(found), 2)
            self.assertLess(max(found), 0.03)
            page.close()

    def test_a_film_of_loading_gets_only_better(self):
        """Each frame at 10 Mbit/s beside the finished picture."""
        folder, _ = self.counted_site()
        with Host(folder, rate=1.25e6, delay=0.04) as host:
            page = self.open(f"{host.url}/index.html#level=2&background=00ff00", script="""
              globalThis.film = [];
              const shoot = () => {
                requestAnimationFrame(shoot);
                const canvas = slf.root.getElementById('picture');
                if (!globalThis.slf?.statistics().first || film.length > 200) return;
                const gl = canvas.getContext('webgl2'), {width, height} = canvas;
                const frame = new Uint8Array(width * height * 4), last = film.at(-1);
                gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
                gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, frame);
                if (!last || frame.some((v, i) => v !== last[i])) film.push(frame);
              };
              requestAnimationFrame(shoot);""")
            page.settle()
            page.wait("film.length > 1")
            page.run("new Promise((done) => setTimeout(done, 1500))")
            page.run("globalThis.finished = film, 0")
            for level in [1, 0]:
                page.run(f"slf.settings.level = '{level}', slf.moved(), film = [], 0")
                page.settle()
                page.run(f"globalThis.level{level} = film.at(-1), 0")
            found = page.run("""(() => {
              const coarse = level0, last = finished.at(-1), size = Math.sqrt(last.length / 4);
              // How much of the background a pixel shows.
              const green = (frame, i) => frame[i + 1] - Math.max(frame[i], frame[i + 2]);
              const solid = Array.from({length: size * size}, (_, i) =>
                [last, level1, coarse].every((frame) => green(frame, 4 * i) < 40));
              const inside = [];  // offsets of pixels whose neighbours are solid too
              for (let y = 2; y < size - 2; ++y)
                for (let x = 2; x < size - 2; ++x) {
                  let all = true;
                  for (let v = -2; v <= 2; ++v)
                    for (let u = -2; u <= 2; ++u) all &&= solid[(y + v) * size + x + u];
                  if (all) inside.push(4 * (y * size + x));
                }
              const step = (frame, i, by) => Math.max(
                ...[0, 1, 2].map((c) => Math.abs(frame[i + c] - frame[i + 4 * by + c])));
              return [inside.length, finished.map((frame) => {
                let error = 0;
                for (let i = 0; i < frame.length; i += 4)
                  for (let c = 0; c < 3; ++c) error += (frame[i + c] - last[i + c]) ** 2;
                const mean = error / (0.75 * frame.length * 255 ** 2);
                return {
                  psnr: -10 * Math.log10(Math.max(mean, 1e-9)),
                  emptier: inside.filter(
                    (i) => green(frame, i) > Math.max(green(coarse, i), green(last, i)) + 16).length,
                  steepest: Math.max(
                    ...inside.map((i) => Math.max(step(frame, i, 1), step(frame, i, size)))),
                };
              })];
            })()""", 120)
            page.close()
        print(*found, sep="\n", flush=True)
        inside, frames = found
        self.assertGreater(inside, 1000)
        self.assertGreater(len(frames), 3)
        for before, after in zip(frames, frames[1:]):
            self.assertGreaterEqual(after["psnr"], before["psnr"] - 0.01)
        for frame in frames:
            self.assertEqual(frame["emptier"], 0)
            self.assertLessEqual(frame["steepest"], frames[-1]["steepest"] + 4)

    def test_a_picture_that_fades_in_stays_whole(self):
        """While tiles of a finer level are awaited: what is solid before and after stays solid."""
        folder, _ = self.counted_site()

        with Host(folder, handler=Silent) as host:
            page = self.open(host.url + "/index.html#view=30,20,3&level=2&background=00ff00")
            page.settle()
            page.wait("!slf.statistics().busy")
            page.run("""
              globalThis.green = () => {
                const canvas = slf.root.getElementById('picture'), gl = canvas.getContext('webgl2');
                const {width, height} = canvas, frame = new Uint8Array(width * height * 4);
                gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
                gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, frame);
                return Float32Array.from({length: width * height}, (_, i) =>
                  frame[4 * i + 1] - Math.max(frame[4 * i], frame[4 * i + 2]));
              };
              globalThis.before = green();
              globalThis.most = new Float32Array(before.length);
              globalThis.shoot = () => {
                if (most) requestAnimationFrame(shoot);
                green().forEach((value, i) => { most[i] = Math.max(most[i], value); });
              };
              0""")
            Silent.down = True
            page.run("slf.camera.fromText('75,0,3'), slf.moved(), shoot(), 0")
            page.run("new Promise((done) => setTimeout(done, 5000))")
            page.run("globalThis.found = most, most = undefined, 0")
            self.assertEqual(page.run("slf.state"), "loading")
            Silent.down = False
            page.settle()
            page.run("slf.settings.level = '0', slf.moved(), 0")
            page.settle()
            solid, emptier = page.run("""(() => {
              const coarse = green(), width = Math.sqrt(coarse.length), around = [-2, -1, 0, 1, 2];
              const solid = (i) => around.every((v) => around.every((u) =>
                before[i + v * width + u] < 40 && coarse[i + v * width + u] < 40));
              const all = [...coarse.keys()].filter(solid);
              return [all.length, all.filter((i) => found[i] > 60).length];
            })()""")
            page.close()
        print(f"{emptier} of {solid} pixels showed the background", flush=True)
        self.assertGreater(solid, 1000)
        self.assertEqual(emptier, 0)

    def test_a_first_view_takes_few_pictures_of_pixels(self):
        """And no pixel is drawn while nothing comes."""
        folder, _ = self.counted_site()
        script = """
          globalThis.pixels = 0;
          const {prototype} = WebGL2RenderingContext, {drawArrays} = prototype;
          prototype.drawArrays = function (...all) {
            const box = this.isEnabled(this.SCISSOR_TEST) ? this.SCISSOR_BOX : this.VIEWPORT;
            const [, , width, height] = this.getParameter(box);
            pixels += width * height / this.canvas.width / this.canvas.height;
            return drawArrays.apply(this, all);
          };"""

        with Host(folder, handler=Silent) as host:
            page = self.open(host.url + "/index.html#view=30,20,3&level=2", script=script)
            page.settle()
            first = page.run("pixels")
            page.wait("!slf.statistics().busy")
            Silent.down = True
            page.run("slf.camera.fromText('75,0,3'), slf.moved(), 0")
            page.run("new Promise((done) => setTimeout(done, 3000))")
            page.run("pixels = 0")
            page.run("new Promise((done) => setTimeout(done, 3000))")
            waiting = page.run("pixels")
            Silent.down = False
            page.close()
        print(f"{first:.1f} pictures until the first view, {waiting:.1f} while nothing comes",
              flush=True)
        self.assertLessEqual(first, 12)
        self.assertLessEqual(waiting, 1)

    def test_an_outage_is_waited_out(self):
        folder, _ = self.counted_site()

        class Failing(Handler):
            down = False

            def do_GET(self):
                if Failing.down and self.path.endswith(".slf"):
                    self.close_connection = True
                    return self.connection.shutdown(2)
                return super().do_GET()

        with Host(folder, rate=2e5, handler=Failing) as host:
            page = self.open(host.url + "/index.html#level=2")
            page.wait("globalThis.slf?.statistics().first")
            Failing.down = True
            page.wait("slf.root.getElementById('status').textContent.includes('Waiting')")
            time.sleep(8)  # five attempts took three seconds
            self.assertEqual(page.run("slf.state"), "loading")
            Failing.down = False
            page.settle()
            self.assertEqual(page.run("slf.root.getElementById('status').textContent"), "")
            page.close()

    def test_a_busy_host_is_asked_again_when_it_says(self):
        folder, _ = self.counted_site()

        class Busy(Handler):
            asked, until = [], 0  # times

            def do_GET(self):
                if not self.path.endswith(".slf"):
                    return super().do_GET()
                Busy.asked.append(time.time())
                if len(Busy.asked) == 4:
                    Busy.until = time.time() + 3
                if time.time() > Busy.until:
                    return super().do_GET()
                self.send_response(429)
                self.send_header("Retry-After", formatdate(Busy.until + 1, usegmt=True)
                                 if by_date else "3")
                self.send_header("Content-Length", "0")
                return self.end_headers()

        for by_date in [False, True]:
            Busy.asked, Busy.until = [], 0
            with Host(folder, "one", handler=Busy) as host:
                page = self.open(host.url + "/index.html#level=2")
                page.settle()
                page.close()
            # Those that were under way were refused, too.
            early = [at for at in Busy.asked if Busy.until - 2.5 < at < Busy.until]
            self.assertEqual(early, [])
            self.assertLessEqual(len(Busy.asked), 50)

    def test_the_panel_starts_folded_where_it_would_cover_much(self):
        with Server(self.fields[0]) as server:
            for size, folded in [((800, 600), True), ((1600, 1000), False)]:
                page = self.browser.open(server.url, *size)
                page.wait("['loading', 'settled'].includes(globalThis.slf?.state)")
                self.assertEqual(page.run("slf.root.getElementById('settings').hidden"), folded)
                page.close()

    def test_mouse_and_keys_move_the_camera(self):
        with Server(self.fields[0]) as server:
            page = self.browser.open(server.url, 512, 512)
            page.settle()
            before = page.run("[slf.camera.azimuth, slf.camera.elevation, slf.camera.distance]")
            for kind, x in [("mousePressed", 300), ("mouseMoved", 350), ("mouseReleased", 350)]:
                page.call("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left",
                          buttons=0 if kind == "mouseReleased" else 1, clickCount=1)
            page.call("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0,
                      deltaY=200)
            after = page.run("[slf.camera.azimuth, slf.camera.elevation, slf.camera.distance]")
            self.assertNotEqual(after[0], before[0])
            self.assertGreater(after[2], before[2])
            for key in ["r"]:
                page.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=key)
            self.assertEqual(page.run("slf.camera.distance"), 3)
            # A double click goes nearer to what it meets; two quick clicks apart, as of the ruler,
            # do not. Beside the object it goes straight on.
            surface = page.run("slf.probe([[220, 250]])[0]")
            for apart, place, distance in [(100, (220, 250), 3), (2, (500, 250), 1.8),
                                           (2, (220, 250), 0.6 * surface["distance"])]:
                page.run("slf.camera.reset()")
                page.run("new Promise((done) => setTimeout(done, 400))")
                for x in [place[0], place[0] + apart]:
                    for kind in ["mousePressed", "mouseReleased"]:
                        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=place[1],
                                  button="left", buttons=int(kind == "mousePressed"), clickCount=1)
                page.wait("!slf.flight")
                self.assertAlmostEqual(page.run("slf.camera.distance"), distance, delta=0.02)
            at = page.run(f"slf.camera.project({json.dumps(surface['point'])}, 512, 512)")
            self.assertAlmostEqual(at["x"], 256, delta=8)
            self.assertAlmostEqual(at["y"], 256, delta=8)
            page.close()


    # ---- explaining -----------------------------------------------------------------------------

    def explained(self, views, field=None):
        """slf view of a field with views, and the page."""
        with open(path("views.json"), "w") as file:
            json.dump(views, file)
        return Server("--views", path("views.json"), field or self.fields[0])

    @staticmethod
    def press(page, key):
        for kind in ["keyDown", "keyUp"]:
            page.call("Input.dispatchKeyEvent", type=kind, key=key)

    def test_saved_views_by_keyboard(self):
        views = [{"title": f"View {i}", "text": "See https://example.org.",
                  "orbit": [36 * i, 5 * i - 20, 2 + 0.1 * i]} for i in range(10)]
        with self.explained({"views": views}) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            self.assertEqual(page.run("slf.camera.toText()"), "0,-20,2")
            self.assertEqual(page.run("slf.root.querySelector('#text a').href"),
                             "https://example.org/")
            for i, key in [*((i, "PageDown") for i in range(1, 10)), (0, "PageDown"),
                           (9, "PageUp")]:
                self.press(page, key)
                page.wait(f"slf.camera.toText() === '{36 * i},{5 * i - 20},{2 + 0.1 * i:g}'", 20)
                self.assertEqual(page.run("slf.root.getElementById('title').textContent"),
                                 f"View {i}")
            page.run("location.hash = '#saved=4'")
            page.wait("slf.camera.toText() === '108,-5,2.3'", 20)
            page.close()

    def test_notes_hide_behind_matter(self):
        sphere = json.loads(slf("info", self.fields[0], "--json"))["sphere"]
        found = json.loads(slf("pick", self.fields[0], "--orbit", "30,20,3", "--size", "256x256",
                               "128,128", "--json"))["point"]
        other = [2 * c - v for c, v in zip(sphere["center"], found)]
        notes = [{"label": "here", "text": "More", "point": found},
                 {"label": "there", "point": other}]
        with self.explained({"notes": notes}) as server:
            page = self.browser.open(server.url + "#view=30,20,3", SIZE, SIZE)
            page.settle()
            behind = ("[...slf.root.querySelectorAll('.note')].map("
                      "(note) => note.classList.contains('behind')).join()")
            page.wait(behind + " === 'false,true'", 10)
            page.run("slf.flyTo('210,-20,3')")
            page.wait(behind + " === 'true,false'", 20)
            page.close()

    def knob(self, page):
        """Where the arrow of the plane ends, in the picture."""
        return page.run("""(({x, y, width, height}) => [x + width / 2, y + height / 2])(
            slf.root.querySelector('#planes circle').getBoundingClientRect())""")

    def plane(self, page):
        return page.run("slf.root.host.clip.join().split(',').map(Number)")

    def drag(self, page, begin, end, steps=8, touch=False):
        def mouse(kind, share, buttons=1):
            x, y = (a + share * (b - a) for a, b in zip(begin, end))
            if touch:
                touches = {"mousePressed": "touchStart", "mouseMoved": "touchMove"}
                page.call("Input.dispatchTouchEvent", type=touches.get(kind, "touchEnd"),
                          touchPoints=[{"x": x, "y": y}] if buttons else [])
                return
            page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                      buttons=buttons, clickCount=1)
        mouse("mousePressed", 0)
        for step in range(1, steps + 1):
            mouse("mouseMoved", step / steps)
            page.run("new Promise((done) => requestAnimationFrame(done))")
        mouse("mouseReleased", 1, 0)

    def test_a_plane_is_moved_and_tilted_by_hand_and_by_keys(self):
        with Server(self.cut_field("cut", "--lighting", "direct")) as server:
            page = self.browser.open(server.url + "#view=30,20,3", SIZE, SIZE)
            page.settle()
            camera = page.run("slf.camera.toText()")
            self.press(page, "c")
            page.wait("slf.cut.active && slf.state === 'settled'")
            self.assertEqual(self.plane(page)[3:], [0, -1, 0])  # towards the camera
            sphere = page.run("slf.field.manifest.sphere")
            x, y = self.knob(page)
            before = self.plane(page)
            self.drag(page, (x, y), (x - 12, y + 6))  # outwards
            moved = self.plane(page)
            self.assertLess(moved[1], before[1] - 0.02 * sphere["radius"])
            self.assertEqual(moved[3:], before[3:])
            x, y = self.knob(page)
            self.drag(page, (x, y), (x + 12, y - 6), touch=True)  # back, by a finger
            self.assertGreater(self.plane(page)[1], moved[1] + 0.02 * sphere["radius"])
            self.assertEqual(self.plane(page)[3:], before[3:])
            begin = page.run("""(({x, y}) => [x, y])(slf.project(
              slf.root.host.handles.rim(slf.cut.planes[0])[10]))""")
            self.drag(page, begin, (begin[0] + 40, begin[1] + 10))
            tilted = self.plane(page)
            self.assertGreater(abs(tilted[3]) + abs(tilted[5]), 0.1)
            self.assertAlmostEqual(math.hypot(*tilted[3:]), 1, 4)
            self.assertEqual(page.run("slf.camera.toText()"), camera)  # which stays
            # The arrow has the focus.
            self.press(page, "Home")
            self.assertEqual(sorted(map(abs, self.plane(page)[3:])), [0, 0, 1])
            before = self.plane(page)
            self.press(page, "Enter")
            self.assertEqual(self.plane(page)[3:], [-v if v else 0 for v in before[3:]])
            self.press(page, "ArrowUp")
            after = self.plane(page)
            self.assertAlmostEqual(
                sum((a - b) * n for a, b, n in zip(after, before, after[3:])),
                0.02 * sphere["radius"], 2)
            page.run("slf.root.getElementById('more').click(), 0")
            page.wait("slf.cut.planes.length === 2")
            page.run("slf.root.getElementById('remove').click(), 0")
            page.wait("slf.cut.planes.length === 1")
            page.run("slf.root.host.cap = 'slice', 0")
            page.wait("slf.cut.cap === 'slice' && !slf.root.getElementById('greys').hidden")
            page.run("""slf.root.getElementById('grey').value = 150;
                        slf.root.getElementById('grey').oninput(), 0""")
            page.wait("slf.cut.cap.startsWith('slice:')")
            # The address has it all, and shows it again.
            page.settle()
            page.wait("location.hash.includes('cap=slice:')")
            link = page.run("location.href")
            again = self.browser.open(link, SIZE, SIZE)
            again.settle()
            self.assertEqual(again.run("slf.root.host.fragment()"),
                             page.run("slf.root.host.fragment()"))
            again.close()
            self.press(page, "Delete")
            page.wait("!slf.cut.active")
            self.assertNotIn("clip", page.run("slf.root.host.fragment()"))
            page.close()

    def test_a_film_of_a_drag_shows_nothing_black(self):
        with Server(self.cut_field("cut", "--lighting", "global")) as server:
            page = self.browser.open(server.url + "#view=30,60,3&clip=16,16,20,0,0,1&level=1",
                                     SIZE, SIZE)
            page.settle()
            page.run("""globalThis.film = [];
              const shoot = () => {
                requestAnimationFrame(shoot);
                const {canvas, renderer: {gl}} = slf, {width, height} = canvas;
                const frame = new Uint8Array(width * height * 4), last = film.at(-1);
                gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
                gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, frame);
                if (!last || frame.some((v, i) => v !== last[i])) film.push(frame);
              };
              shoot(), 0""")
            x, y = self.knob(page)
            self.drag(page, (x, y), (x, y + 30), steps=20)
            page.settle()
            page.run("new Promise((done) => setTimeout(done, 2500))")
            page.settle()
            lit = page.run("""film.map((frame) => {
              let count = 0;
              for (let i = 0; i < frame.length; i += 4)
                count += frame[i] + frame[i + 1] + frame[i + 2] > 24;
              return count;
            })""", 120)
            print(lit, flush=True)
            self.assertGreater(len(lit), 8)
            self.assertGreater(min(lit), 0.9 * min(lit[0], lit[-1]))
            page.close()

    def test_saved_views_and_notes_of_cuts(self):
        field = self.cut_field("cut", "--lighting", "direct")
        clip = [[16, 16, 17, 0, 0, 1]]
        views = {"views": [{"title": "Cut", "orbit": [30, 20, 3], "clip": clip, "cap": "slice"},
                           {"title": "Whole", "orbit": [30, 20, 3]}],
                 "notes": [{"label": "gone", "point": [14, 16, 28]},
                           {"label": "kept", "point": [14, 6, 10]}]}
        with self.explained(views, field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            self.assertEqual(page.run("slf.root.host.clip"), ["16,16,17,0,0,1"])
            self.assertEqual(page.run("slf.cut.cap"), "slice")
            # The ruler finds the face.
            x, y = page.run("""(({x, y}) => [x, y])(slf.project(slf.root.host.explain.inward(
              [14, 8, 17])))""")
            self.assertAlmostEqual(page.run(f"slf.pick({x}, {y}).point[2]"), 17, 1)
            gone = "slf.root.querySelector('.note').classList.contains('behind')"
            page.wait(gone)
            copied = page.run("slf.root.host.explain.currentView()")
            self.assertEqual([copied["clip"], copied["cap"]], [clip, "slice"])
            self.press(page, "PageDown")
            page.wait(f"!slf.cut.active && slf.state === 'settled' && !{gone}")
            page.close()
        slf("export", field, "-o", path("cut.html"), "-f", "--views", path("views.json"))
        page = self.browser.open("file://" + path("cut.html"), SIZE, SIZE)
        page.settle()
        self.assertFalse(page.run("slf.cut.hollow"))
        self.assertEqual(page.run("slf.root.host.clip"), ["16,16,17,0,0,1"])
        page.close()
        for wrong in [[[1, 2, 3]], "up", [[0, 0, 0, 0, 0, "z"]]]:
            views["views"][0]["clip"] = wrong
            with open(path("views.json"), "w") as file:
                json.dump(views, file)
            said = subprocess.run([SLF, "view", "--views", path("views.json"), field],
                                  capture_output=True, text=True)
            self.assertEqual(said.returncode, 3)
            self.assertIn("views[0].clip", said.stderr)

    def phone(self, server, fragment=""):
        page = self.browser.open("about:blank", 390, 844)
        page.call("Emulation.setTouchEmulationEnabled", enabled=True)
        page.call("Page.navigate", url=server.url + fragment)
        page.settle()
        return page

    def test_labels_of_notes_do_not_overlap_on_a_phone(self):
        sphere = json.loads(slf("info", self.fields[0], "--json"))["sphere"]
        notes = [{"label": f"Number {i} of several", "point": [
            c + 0.1 * sphere["radius"] * (i % d - 1) for c, d in zip(sphere["center"], [2, 3, 4])]}
            for i in range(8)]
        with self.explained({"notes": notes}) as server:
            page = self.phone(server, "#view=30,20,1.5")
            page.run("slf.probe = () => [], slf.moved(), 0")  # nothing is in front of them
            page.wait("slf.root.querySelectorAll('.note:not(.behind)').length === 8")
            page.screenshot(path("notes.png"))
            found = page.run("""[...slf.root.querySelectorAll('.note:not(.crowded)')].map((note) =>
                (({left, top, right, bottom}) => [left, top, right, bottom])(
                  note.getBoundingClientRect()))""")
            self.assertGreater(len(found), 2)
            for i, a in enumerate(found):
                self.assertTrue(a[0] >= 0 and a[1] >= 0 and a[2] <= 390 and a[3] <= 844, a)
                for b in found[:i]:
                    self.assertTrue(a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1])
            page.close()

    LONG = {"views": [{"title": "A view", "orbit": [30, 10, 2.5]},
                      {"title": "A view with a long title", "text": "And a long text. " * 30,
                       "orbit": [60, 10, 2.5]}]}

    def test_the_way_to_the_next_view_does_not_move_with_the_text(self):
        with self.explained(self.LONG) as server:
            for size in [(390, 844), (512, 512), (800, 600), (1200, 800)]:
                page = self.browser.open(server.url, *size)
                page.settle()
                at = "['previous', 'next'].map((id) => (({x, y}) => [x, y])(" \
                     "slf.root.getElementById(id).getBoundingClientRect()))"
                places = page.run(at)
                page.run("slf.root.getElementById('next').click()")
                self.assertIn("long", page.run("slf.root.getElementById('title').textContent"))
                with self.subTest(size=size):
                    self.assertEqual(page.run(at), places)
                page.close()

    def test_saved_views_cover_nothing_of_the_panel_or_the_list(self):
        with self.explained(self.LONG, self.structured()) as server:
            for size in [(530, 400), (640, 360), (800, 600), (844, 390), (1050, 500), (1200, 700)]:
                page = self.browser.open(server.url, *size)
                page.settle()
                page.run("slf.root.getElementById('next').click()")
                for name, by in [("panel", "fold"), ("structures", "unroll")]:
                    page.run(f"""((button) => button.ariaExpanded === 'true' || button.click())(
                      slf.root.getElementById('{by}'))""")
                    box = """((id) => (({left, top, right, bottom}) => [left, top, right, bottom])(
                      slf.root.getElementById(id).getBoundingClientRect()))"""
                    a, b = page.run(f"{box}('views')"), page.run(f"{box}('{name}')")
                    with self.subTest(size=size, name=name):
                        self.assertTrue(a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or
                                        b[3] <= a[1], (a, b))
                        self.assertTrue(a[0] >= 0 and a[2] <= size[0] and a[2] - a[0] > 170, a)
                page.close()

    def test_the_background_follows_the_colour_scheme_until_it_is_chosen(self):
        with Server(self.fields[0]) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()

            def scheme(value):
                page.call("Emulation.setEmulatedMedia",
                          features=[{"name": "prefers-color-scheme", "value": value}])
                page.settle()
                return page.run("[slf.settings.background,"
                                " slf.root.getElementById('background').value]")

            for value, color in [("light", "#f4f5f7"), ("dark", "#000000")]:
                self.assertEqual(scheme(value), [color, color])
            page.run("""((input) => {
              input.value = '#123456';
              input.dispatchEvent(new Event('input'));
            })(slf.root.getElementById('background'))""")
            self.assertEqual(scheme("light"), ["#123456", "#123456"])
            page.close()

    def test_a_link_to_a_view_that_is_not_there_says_so(self):
        with self.explained(self.LONG) as server:
            for number in ["99", "0", "-1", "1.5", "x"]:
                page = self.browser.open(server.url + "#saved=" + number, SIZE, SIZE)
                page.wait("slf.root.getElementById('status').textContent.includes("
                          f"'no saved view {number}')", 30)
                self.assertEqual(page.run("slf.camera.toText()"), "30,10,2.5")
                page.close()
            page = self.browser.open(server.url + "#saved=2", SIZE, SIZE)
            page.wait("slf.camera.toText() === '60,10,2.5'", 20)
            page.close()

    def test_screen_readers_hear_what_is_seen(self):
        with Server(self.stated()) as server:
            page = self.browser.open(server.url + "#view=30,20,3", SIZE, SIZE)
            page.settle()
            names = []
            for key in ["ArrowRight", "."]:
                names.append(page.run("slf.root.getElementById('picture').ariaLabel"))
                self.press(page, key)
                page.settle()
            names.append(page.run("slf.root.querySelector('[aria-live]#seen').textContent"))
            self.assertEqual(names, [
                f"cube.raw, seen from azimuth {a}°, elevation 20°, 3 radii away; state {state}"
                for a, state in [(30, "whole"), (36, "whole"), (36, "top off")]])
            page.close()

    def test_the_scale_bar_and_the_compass_are_beside_the_views(self):
        with self.explained({"views": [{"title": "A view", "orbit": [30, 10, 2.5]}]}) as server:
            for width in (390, 650, 900, 1100):
                page = self.browser.open(server.url, width, 600)
                page.settle()
                page.run("slf.root.getElementById('compass').hidden = false, 0")
                views, *others = page.run("""['views', 'scale', 'compass'].map((id) =>
                    (({left, top, right, bottom}) => [left, top, right, bottom])(
                      slf.root.getElementById(id).getBoundingClientRect()))""")
                with self.subTest(width=width):
                    for a in others:
                        self.assertLess(a[0], a[2])
                        self.assertTrue(views[2] <= a[0] or a[3] <= views[1], (views, a))
                page.close()

    def test_the_compass_has_letters_of_patients_only_where_the_source_states_them(self):
        with Server(self.fields[0]) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            for space, letters in [("undefined", "xyz"), ("'LPS'", "AILPRS")]:
                found = page.run(f"""(() => {{
                    slf.field.manifest.provenance.space = {space};
                    slf.root.getElementById('marks').checked = true;
                    slf.root.host.drawMarks();
                    return slf.root.getElementById('compass').textContent;
                }})()""")
                self.assertEqual("".join(sorted(found)), letters)
            page.close()

    def test_swipes_and_copying_a_view(self):
        views = [{"title": f"View {i}", "orbit": [30 * i, 10, 2.5]} for i in range(3)]
        with self.explained({"views": views}) as server:
            page = self.phone(server)
            box = page.run("(({left, top, width, height}) => [left + width / 2, top + height / 2])"
                           "(slf.root.getElementById('views').getBoundingClientRect())")

            def swipe(by):
                for kind, x in [("touchStart", box[0] - by / 2), ("touchMove", box[0]),
                                ("touchMove", box[0] + by / 2), ("touchEnd", None)]:
                    page.call("Input.dispatchTouchEvent", type=kind,
                              touchPoints=[] if x is None else [{"x": x, "y": box[1]}])

            for by, orbit in [(-120, "30,10,2.5"), (-120, "60,10,2.5"), (120, "30,10,2.5")]:
                swipe(by)
                page.wait(f"slf.camera.toText() === '{orbit}'", 20)
            swipe(20)  # too short
            page.run("slf.camera.fromText('12.5,-40,2.25,0.1,0,0.2'), slf.moved(), 0")
            page.run("navigator.clipboard.writeText = async (text) => { globalThis.copied = text }, "
                     "slf.root.getElementById('copy').click(), 0")
            page.wait("globalThis.copied")
            copied = json.loads(page.run("copied"))
            page.close()
        with self.explained({"views": [copied]}) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            camera = page.run("slf.camera.toText()").split(",")
            for found, expected in zip(camera, [12.5, -40, 2.25, 0.1, 0, 0.2], strict=True):
                self.assertAlmostEqual(float(found), expected, places=3)
            page.close()

    def test_wrong_views_are_refused(self):
        for content, place in [
                ('{"views": [{"title": "a", "orbit": [0, 0, 0]}]}', "views[0].orbit: expected"),
                ('{"views": [],\n "notes": [}', "line 2: this is no JSON"),
                ('{"notes": [{"label": "a", "point": [1, 2]}]}', "notes[0].point: expected three"),
                ('{"notes": [{"label": "a", "at": 1}]}', 'no member "at" is known'),
                ('[]', 'expected an object with the lists "views" and "notes", and "about"')]:
            with open(path("wrong.json"), "w") as file:
                file.write(content)
            for command in [["export", self.fields[0], "-o", path("wrong.html"), "-f"],
                            ["view", self.fields[0]]]:
                done = subprocess.run([SLF, "-q", *command, "--views", path("wrong.json")],
                                      capture_output=True, text=True, timeout=30)
                self.assertNotEqual(done.returncode, 0)
                self.assertIn(place, done.stderr)
                self.assertIn("wrong.json", done.stderr)

    def test_the_ruler_measures_a_phantom(self):
        """A cube of 12 voxels, from one face to the opposite one."""
        field = path("phantom.slf")
        with open(path("opaque.json"), "w") as file:
            json.dump([{"Name": "Opaque", "ColorSpace": "RGB", "ScalarOpacityUnitDistance": 0.1,
                        "Points": [0, 0, 0.5, 0, 104, 0, 0.5, 0, 106, 1, 0.5, 0, 255, 1, 0.5, 0],
                        "RGBPoints": [0, 1, 0.9, 0.8, 255, 1, 0.9, 0.8]}], file)
        with open(path("phantom.nhdr"), "w") as file:
            file.write("""NRRD0004
type: uint8
dimension: 3
space: left-posterior-superior
sizes: 24 24 24
space directions: (2,0,0) (0,2,0) (0,0,2)
space units: "mm" "mm" "mm"
encoding: raw
data file: cube.raw
""")
        slf("build", path("phantom.nhdr"), "--levels", 1, "--transfer", path("opaque.json"),
            "--entry", 8, "--exit", 32, "-o", field, "-f")
        picked = json.loads(slf("pick", field, "--size", "64x64", "32,32", "--json"))
        self.assertEqual(picked["unit"], "mm")
        with Server(field) as server:
            page = self.browser.open(server.url + "#view=0,0,3&level=1", SIZE, SIZE)
            page.settle()
            self.press(page, "m")
            for view in ["180,0,3", "90,0,3"]:
                self.press(page, "Enter")
                page.run(f"slf.flyTo('{view}')")
                page.settle()
            said = page.run("slf.root.getElementById('status').textContent")
            self.assertTrue(said.endswith(" mm"), said)
            length, error = map(float, said[:-3].removeprefix("Distance: ").split(" ± "))
            self.assertLessEqual(abs(length - 24), 2)
            self.assertLess(0, error)
            self.assertLess(error, 4)
            # The scale bar spans its length on the face that is seen, from anywhere.
            for view in ["0,0,3", "0,0,1.2", "0,0,1.6,0,0,0.2", "0,0,7"]:
                page.run(f"slf.flyTo('{view}')")
                page.settle()
                length, text, a, b = page.run("""new Promise((done) => setTimeout(done, 300)).then(
                  () => {
                    const bar = slf.root.getElementById('scale');
                    const half = bar.querySelector('i').getBoundingClientRect().width / 2;
                    const at = (x) => slf.pick(slf.canvas.clientWidth / 2 + x,
                                               slf.canvas.clientHeight / 2)?.point;
                    return [parseFloat(bar.textContent), bar.innerText, at(-half), at(half)];
                  })""")
                with self.subTest(view=view):
                    self.assertRegex(text, r"^[\d.]+ mm$")
                    if a and b:
                        self.assertAlmostEqual(math.dist(a, b), length, delta=0.1 * length)
                    else:
                        self.assertGreater(view, "0,0,3")  # the bar is longer than the face
            page.run("slf.flyTo('0,0,3,1,0,1')")  # past the cube
            page.wait("slf.root.getElementById('scale').hidden", 10)
            page.close()
        with Server(path("lit.slf")) as server:  # of a volume without a unit
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            self.assertRegex(page.run("slf.root.getElementById('scale').ariaLabel"),
                             r"^Scale: the bar is [\d.]+ units of the volume long$")
            page.close()

    # ---- embedding ------------------------------------------------------------------------------

    def test_two_elements_of_two_hosts_on_one_page(self):
        """The package for npm, installed, on a page whose policy forbids inline scripts."""
        if not shutil.which("npm"):
            self.skipTest("no npm")
        folder = path("embedding")
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run([os.path.join(ROOT, "scripts/npm-package"), SLF, folder], check=True)
        package, = [name for name in os.listdir(folder) if name.endswith(".tgz")]
        subprocess.run(["npm", "install", "--silent", "--offline", "--prefix", folder,
                        os.path.join(folder, package)], check=True)
        site = self.site()
        shutil.copy(os.path.join(site, "field.slf"), folder)
        with Host(site, headers={"Access-Control-Allow-Origin": "*"}) as other:
            with open(os.path.join(folder, "index.html"), "w") as file:
                file.write(f"""<!doctype html><title>Two</title>
<link rel="stylesheet" href="page.css">
<slf-field id="a" src="field.slf" view="60,10,3"></slf-field><p>Text</p>
<slf-field id="b" src="{other.url}/field.slf"></slf-field>
<div class="far"></div><slf-field id="c" src="field.slf"></slf-field>
<script type="module" src="page.js"></script>""")
            with open(os.path.join(folder, "page.css"), "w") as file:
                file.write("slf-field { width: 240px; height: 80px } .far { height: 3000px }")
            with open(os.path.join(folder, "page.js"), "w") as file:
                file.write("""globalThis.heard = [];
for (const name of ['ready', 'camera', 'pick', 'error'])
  document.addEventListener(name, ({type, target}) => heard.push(type + target.id));
const {SlfField} = await import('./node_modules/slf-field/slf-field.js');
globalThis.right = document.getElementById('a') instanceof SlfField;""")
            policy = ("default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src blob:; "
                      f"style-src 'self'; connect-src 'self' {other.url}")
            with Host(folder, headers={"Content-Security-Policy": policy}) as host:
                page = self.open(host.url + "/index.html")
                page.wait("['a', 'b'].every((id) => document.getElementById(id).viewer?.state === "
                          "'settled')")
                self.assertTrue(page.run("right"))
                heard = page.run("heard")
                self.assertLessEqual({"readya", "readyb"}, set(heard))
                self.assertNotIn("readyc", heard)  # out of sight
                self.assertEqual(page.run("document.activeElement.tagName"), "BODY")
                self.assertEqual(page.run("document.getElementById('a').viewer.camera.toText()"),
                                 "60,10,3")
                self.assertEqual(page.run("location.hash"), "")
                page.call("Input.dispatchMouseEvent", type="mouseWheel", x=120, y=40, deltaX=0,
                          deltaY=100)
                page.wait("scrollY > 0")  # the page scrolls
                self.assertEqual(page.run("document.getElementById('a').viewer.camera.distance"), 3)
                page.run("document.getElementById('a').flyTo('10,0,2.5')", 20)
                self.assertIn("cameraa", page.run("heard"))
                self.assertTrue(page.run("document.getElementById('a').picture().then("
                                         "(file) => file.type === 'image/png' && file.size > 500)"))
                found = page.run("document.getElementById('a').pick(120, 40)")
                self.assertEqual(len(found["point"]), 3)
                self.assertIsNone(page.run("document.getElementById('a').pick(1, 1)"))
                self.assertNotIn("errora", page.run("heard"))
                page.close()

    def embedded(self, host, body, width=600, height=600,
                 script='<script src="page.js" defer></script>'):
        """A page of one's own beside the field of site(), once its script has run."""
        with open(os.path.join(host.folder, "own.html"), "w") as file:
            file.write(f"""<!doctype html><title>Own</title>{script}
<style>body {{ margin: 0 }} slf-field {{ width: 240px; height: 160px }}</style>{body}""")
        page = self.browser.open("about:blank", width, height)
        page.call("Page.addScriptToEvaluateOnNewDocument", source="""globalThis.wrong = [];
          addEventListener('unhandledrejection', ({reason}) => wrong.push(String(reason)));
          addEventListener('error', ({message}) => message && wrong.push(message));
          globalThis.workers = 0;
          globalThis.Worker = class extends Worker {
            constructor(...given) { super(...given); ++workers; }
            terminate() { super.terminate(); --workers; }
          };
          globalThis.one = () => document.querySelector('slf-field');
          globalThis.now = (id) => one().shadowRoot.getElementById(id);""")
        page.call("Page.navigate", url=host.url + "/own.html")
        page.wait("globalThis.customElements?.get('slf-field')")
        return page

    def settled(self, page):
        page.wait("one().viewer.state === 'settled'")

    def test_many_mounts_leave_what_ten_leave(self):
        """Workers, listeners, nodes and memory; some elements are removed while they load.
        SLF_MOUNTS=1000 mounts so many; otherwise as many as 20 seconds allow."""
        mounts = int(os.environ.get("SLF_MOUNTS", 0))
        with Host(self.site()) as host:
            page = self.embedded(host, "")
            page.call("Performance.enable")
            page.run("""globalThis.mount = async (i) => {
              const element = document.createElement('slf-field');
              element.src = 'field.slf';
              element.addEventListener('error', ({detail}) => wrong.push(detail.message));
              document.body.append(element);
              const ready = new Promise((done) => element.addEventListener('ready', done));
              await (i % 3 ? ready : new Promise((done) => setTimeout(done, i % 100)));
              if (i % 5 === 0) document.body.prepend(element);
              element.remove();
            }; 0""")

            def mount(begin):
                page.run(f"(async () => {{ for (let i = {begin}; i < {begin + 10}; ++i) "
                         "await mount(i); })()", 120)

            def left():
                time.sleep(0.5)
                page.call("HeapProfiler.collectGarbage")
                counts = {one["name"]: one["value"]
                          for one in page.call("Performance.getMetrics")["metrics"]}
                return page.run("workers"), *(counts[name] for name in [
                    "JSEventListeners", "Nodes", "JSHeapUsedSize"])

            mount(0)
            ten, count, until = left(), 10, time.monotonic() + 20
            while count < mounts or (not mounts and time.monotonic() < until):
                mount(count)
                count += 10
            many = left()
            print(f"10 mounts leave {ten}, {count} leave {many}: workers, listeners, nodes, bytes",
                  flush=True)
            self.assertEqual((ten[0], many[0]), (0, 0))
            self.assertLessEqual(many[1], ten[1] + 2)
            self.assertLessEqual(many[2], ten[2] + 20)
            self.assertLess(many[3], ten[3] + (1 << 20))
            self.assertEqual(page.run("wrong"), [])
            page.close()

    def test_an_element_that_is_moved_stays_as_it_is(self):
        with Host(self.site()) as host:
            page = self.embedded(host, "<main></main><slf-field src='field.slf'></slf-field>")
            self.settled(page)
            page.run("one().view = '100,5,2.5', 0")
            self.settled(page)
            requests = len(host.log)
            page.run("globalThis.canvas = now('picture'), "
                     "document.querySelector('main').append(one())")
            self.assertEqual(page.run("[one().view, canvas === now('picture'), workers > 0]"),
                             ["100,5,2.5", True, True])
            self.assertEqual(len(host.log), requests)
            for how in ["display = 'none'", "width = 0", "height = 0"]:
                page.run(f"one().style.{how}, one().viewer.moved(), 0")
                time.sleep(0.3)
                page.run("one().style = '', 0")
            self.settled(page)
            # Removed, it frees all; it may come back, with its view.
            page.run("(globalThis.kept = one()).remove()")
            page.wait("workers === 0")
            page.run("kept.view = '50,5,2'; kept.structures = ['*']; kept.state = 0;"
                     "kept.flyTo('55,5,2'); kept.pick(9, 9)")
            page.run("document.body.append(kept)")
            self.settled(page)
            self.assertEqual(page.run("[one().view, workers > 0, wrong]"), ["55,5,2", True, []])
            page.close()

    def test_an_element_follows_its_attributes_and_properties(self):
        with Host(self.site()) as host:
            for name, field in [("parts", self.structured()), ("half", self.stated())]:
                shutil.copy(field, os.path.join(host.folder, name + ".slf"))
            page = self.embedded(host, "<slf-field src='field.slf' view='60,10,3'></slf-field>")
            self.settled(page)
            self.assertEqual(page.run("one().view"), "60,10,3")
            for change in ["one().setAttribute('view', '10,0,2.5')", "one().view = '20,0,2.5'"]:
                page.run(change + ", 0")
                self.assertEqual(page.run("one().view"), change.split("'")[-2])
                self.settled(page)
            page.run("one().src = 'parts.slf', 0")
            self.settled(page)
            self.assertEqual(page.run("one().view"), "10,0,2.5")
            self.assertEqual(page.run("one().viewer.field.layers.length"), 4)
            page.run("one().setAttribute('structures', 'core'), 0")
            page.wait("one().viewer.field.layers.length === 1")
            page.run("one().structures = ['* lobe'], 0")
            page.wait("one().viewer.field.layers.length === 2")
            page.run("one().setAttribute('src', 'half.slf'), 0")
            self.settled(page)
            for change, state in [("setAttribute('state', 'half')", 2), ("state = 'top off'", 1),
                                  ("state = 2", 2), ("removeAttribute('state')", 0)]:
                page.run(f"one().{change}, 0")
                self.assertEqual(page.run("one().viewer.field.state"), state)
                self.settled(page)
            # Properties that were set before the element was known, and while it loads.
            page.run("one().src = 'field.slf', one().view = '30,0,4', 0")
            self.settled(page)
            self.assertEqual(page.run("[one().view, workers <= 4, wrong]"), ["30,0,4", True, []])
            page.close()

    def test_wheel_and_keys_that_do_nothing_are_the_pages(self):
        with Host(self.site()) as host:
            page = self.embedded(host, "<slf-field src='field.slf'></slf-field>"
                                       "<div style='height: 3000px'></div>")
            self.settled(page)
            page.run("now('picture').focus(), one().view = '30,20,19', 0")
            for by, scrolls in [(300, False), (100, True)]:
                page.call("Input.dispatchMouseEvent", type="mouseWheel", x=120, y=80, deltaX=0,
                          deltaY=by)
                time.sleep(0.3)
                self.assertEqual(page.run("scrollY > 0"), scrolls)
            page.run("scrollTo(0, 0)")
            self.assertEqual(page.run("one().viewer.camera.distance"), 20)
            prevented = """((key) => !now('picture').dispatchEvent(new KeyboardEvent('keydown',
              {key, bubbles: true, composed: true, cancelable: true})))"""
            for key, taken in [("PageDown", False), ("PageUp", False), ("x", False),
                               ("ArrowUp", True), ("+", True), ("r", True)]:
                self.assertEqual(page.run(f"{prevented}('{key}')"), taken, key)
            page.close()

    def test_limits_bound_what_hands_do(self):
        with Host(self.site()) as host:
            page = self.embedded(host, "<slf-field src='field.slf' view='30,20,3' min-distance='2'"
                                       " max-elevation='40' disable-pan></slf-field>")
            self.settled(page)
            camera = "one().viewer.camera"
            page.run(f"now('picture').focus(), {camera}.turn(0, 80), {camera}.zoom(0.1), "
                     f"{camera}.pan(1, 1), 0")
            self.assertEqual(page.run("one().view"), "30,40,2")
            page.run("one().lookFrom([0, 0, 1])")
            page.wait("one().view === '0,40,2'", 10)
            # Views that are given may be beyond; attributes and properties may change.
            page.run("one().view = '30,60,1.5', 0")
            self.assertEqual(page.run("one().view"), "30,60,1.5")
            page.run("one().disableZoom = true, one().maxElevation = 70, one().disablePan = false, "
                     f"{camera}.zoom(0.5), {camera}.turn(0, 50), {camera}.pan(0.1, 0), 0")
            self.assertRegex(page.run("one().view"), r"^30,70,1.5,[\d.,-]+$")
            self.assertEqual(page.run("[one().hasAttribute('disable-pan'), "
                                      "one().getAttribute('max-elevation')]"), [False, "70"])
            page.close()

    def test_an_element_turns_by_itself_until_it_is_used(self):
        with Host(self.site()) as host:
            page = self.embedded(host, "<slf-field src='field.slf' auto-rotate"
                                       " auto-rotate-delay='300'></slf-field>")
            page.run("""globalThis.told = []; one().addEventListener('progress',
                ({detail}) => told.push(detail.totalProgress))""")
            page.wait("one().viewer?.complete", 60)
            self.assertTrue(page.run("!now('hint').hidden && now('hint').textContent.length > 20"))
            page.wait("one().view !== '30,20,3'", 20)
            page.run("one().autoRotateDelay = 1e6, now('picture').dispatchEvent("
                     "new WheelEvent('wheel', {bubbles: true, composed: true})), 0")
            before = page.run("one().view")
            self.settled(page)
            self.assertEqual(page.run("one().view"), before)
            self.assertTrue(page.run("now('hint').hidden"))
            told = page.run("told")
            self.assertEqual((told[-1], told), (1, sorted(told)))
            page.run("localStorage.removeItem('slfPrompted')")
            page.call("Emulation.setEmulatedMedia", features=[
                {"name": "prefers-reduced-motion", "value": "reduce"}])
            page.run("one().autoRotateDelay = 100, 0")
            time.sleep(0.5)
            self.assertEqual(page.run("one().view"), before)
            page.close()

    def test_a_tour_plays_saved_views_and_their_states(self):
        states = json.loads(slf("info", self.stated(), "--json"))["states"]
        names = [one["name"] if isinstance(one, dict) else one for one in states]
        views = {"views": [{"title": f"View {i}", "orbit": [60 * i, 10, 3],
                            "state": names[i % len(names)]} for i in range(3)]}
        with self.explained(views, self.stated()) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            page.run("document.querySelector('slf-field').tour = 0.1, 0")
            for i in [1, 2, 0]:
                page.wait(f"slf.camera.toText() === '{60 * i},10,3' && "
                          f"slf.field.state === {i % len(names)}", 60)
            self.press(page, "ArrowLeft")
            self.assertEqual(page.run("[slf.root.getElementById('tour').ariaPressed, "
                                      "slf.root.host.explain.tours]"), ["false", False])
            self.assertIn("state", page.run("slf.root.host.explain.currentView()"))
            page.close()
            views["views"][0]["state"] = "none of them"
            with open(path("views.json"), "w") as file:
                json.dump(views, file)
            done = subprocess.run([SLF, "view", "--views", path("views.json"), self.stated()],
                                  capture_output=True, text=True)
            self.assertIn("none of them", done.stderr)

    def test_letters_of_the_compass_and_what_lies_on_the_picture(self):
        found = json.loads(slf("pick", self.fields[0], "--orbit", "30,20,3", "--size", "256x256",
                               "128,128", "--json"))["point"]
        notes = [{"label": "A note", "text": "x", "point": found}]
        with self.explained({"notes": notes}) as server:
            page = self.browser.open(server.url, 640, 640)
            page.settle()
            mouse = lambda kind, x, y, **more: page.call(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)
            mouse("mouseMoved", 300, 320)
            page.wait("!slf.root.getElementById('under').hidden", 10)
            said = page.run("slf.root.getElementById('under').textContent").split(", ")
            self.assertEqual(len([float(one) for one in said]), 3)
            # The wheel over a note, a drag that begins there, and a click, which opens it.
            x, y = page.run("""(({x, y, width, height}) => [x + width / 2, y + 20])(
                slf.root.querySelector('.note').getBoundingClientRect())""")
            mouse("mouseWheel", x, y, deltaX=0, deltaY=200)
            page.wait("slf.camera.distance > 3", 10)
            x, y = page.run("""(({x, y, width, height}) => [x + width / 2, y + 20])(
                slf.root.querySelector('.note').getBoundingClientRect())""")
            self.drag(page, (x, y), (x + 80, y))
            page.wait("slf.camera.azimuth !== 30", 10)
            self.assertTrue(page.run("slf.root.querySelector('.note p').hidden"))
            page.run("slf.root.getElementById('marks').click()")
            for number, (letter, view) in enumerate(
                    [("x", "90,0"), ("y", "180,0"), ("z", "0,90")]):
                x, y = page.run(f"""(({{x, y, width, height}}) => [x + width / 2, y + height / 2])(
                    [...slf.root.querySelectorAll('#compass span')].find(({{textContent}}) =>
                      textContent === '{letter}').getBoundingClientRect())""")
                for kind in ["mousePressed", "mouseReleased"]:
                    mouse(kind, x, y, button="left", clickCount=1)
                page.wait(f"slf.camera.toText().startsWith('{view},')", 20)
                page.run("slf.root.host.view = '30,20,3', 0")
                self.press(page, str(number + 1))
                page.wait(f"slf.camera.toText() === '{view},3'", 20)
                page.run("slf.root.host.view = '30,20,3', 0")
            page.close()

    def test_names_the_structure_under_the_pointer(self):
        field = self.structured()
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            names = page.run("slf.field.structures")
            seen = set()
            # What is named is what is seen: shown alone, it has the same surface there.
            for x, y in [(SIZE // 4, SIZE // 2), (SIZE * 7 // 10, SIZE // 2)]:
                page.run("slf.root.host.structures = ['*'], 0")
                page.wait("slf.field.layers.length > 1 && slf.state === 'settled'")
                page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
                page.wait("slf.root.getElementById('under').textContent.includes('·')", 20)
                name = page.run("slf.root.getElementById('under').textContent").split(" · ")[0]
                self.assertIn(name, names)
                depth = page.run(f"slf.probe([[{x}, {y}]])[0].distance")
                page.run(f"slf.root.host.structures = [{json.dumps(name)}], 0")
                page.wait("slf.field.layers.length === 1 && slf.state === 'settled'")
                self.assertAlmostEqual(page.run(f"slf.probe([[{x}, {y}]])[0].distance"), depth,
                                       delta=0.02)
                seen.add(name)
                page.call("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
                page.wait("slf.root.getElementById('under').hidden", 10)
            self.assertGreater(len(seen), 1)
            page.close()

    def test_an_element_says_what_is_wrong(self):
        with Host(self.site()) as host, Host(self.site()) as foreign:  # without CORS
            page = self.embedded(host, "<slf-field></slf-field>")
            page.wait("one().viewer?.state === 'failed'", 20)
            self.assertIn("needs an attribute src", page.run("one().viewer.message"))
            page.run(f"one().src = '{foreign.url}/field.slf', 0")
            page.wait("one().viewer?.state === 'failed'", 15)
            self.assertIn("(CORS)", page.run("one().viewer.message"))
            # The whole message can be read in an element of the smallest size.
            page.run("one().style.height = '120px', 0")
            box, outer, whole = page.run("""[now('status'), one()].map((it) =>
                (({left, top, right, bottom}) => [left, top, right, bottom])(
                  it.getBoundingClientRect())).concat([now('status').scrollHeight <=
                  now('status').clientHeight ||
                  getComputedStyle(now('status')).overflowY === 'auto'])""")
            self.assertTrue(whole)
            self.assertTrue(box[0] >= outer[0] and box[1] >= outer[1] and box[2] <= outer[2] and
                            box[3] <= outer[3], (box, outer))
            page.close()

    def test_node_imports_the_package(self):
        if not shutil.which("node"):
            self.skipTest("no node")
        folder = path("node")
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run([os.path.join(ROOT, "scripts/npm-package"), SLF, folder], check=True)
        package, = os.listdir(folder)
        subprocess.run(["tar", "-C", folder, "-xzf", os.path.join(folder, package)], check=True)
        done = subprocess.run(["node", "--input-type=module", "-e",
                               "import {SlfField} from './package/slf-field.js';"
                               "console.log(SlfField);"], cwd=folder, capture_output=True,
                              text=True)
        self.assertEqual((done.stdout, done.stderr), ("undefined\n", ""))

    REACT = """import 'slf-field';
        import {useState} from 'react';
        import {renderToString} from 'react-dom/server.browser';
        import {hydrateRoot} from 'react-dom/client';
        function App() {
          const [given, give] = useState({view: '60,10,3', 'min-distance': 2});
          globalThis.give = give;
          return <slf-field src="field.slf" {...given}
                            onready={() => { globalThis.heard = true; }}/>;
        }
        if (globalThis.document) hydrateRoot(document.querySelector('main'), <App/>);
        else console.log(renderToString(<App/>));"""
    VUE = """import 'slf-field';
        import {createSSRApp, h, ref} from 'vue';
        import {renderToString} from 'vue/server-renderer';
        const given = ref({view: '60,10,3', 'min-distance': 2});
        globalThis.give = (value) => { given.value = value; };
        const app = createSSRApp({render: () => h('slf-field', {
          src: 'field.slf', ...given.value, onReady() { globalThis.heard = true; }})});
        if (globalThis.document) app.mount('main');
        else renderToString(app).then(console.log);"""
    TYPES = """import type {} from 'slf-field/react';
        import {SlfField} from 'slf-field';
        export const shown = <slf-field src="a.slf" autoRotate minDistance={2} tour="6"
          onprogress={({detail}) => detail.totalProgress.toFixed()}/>;
        document.querySelector('slf-field')!.addEventListener('camera', ({detail}) =>
          detail.view.trim());
        // @ts-expect-error
        export const wrong = <slf-field minDistance="near"/>;
        export const one: SlfField | null = null;"""

    def test_the_element_in_react_and_vue(self):
        """Rendered on a server, hydrated in a browser, and changed there."""
        if not os.environ.get("SLF_EVERY_BYTE"):
            self.skipTest("npm takes minutes; scripts/check runs it")
        for program in ["npm", "node", "esbuild"]:
            if not shutil.which(program):
                self.skipTest(f"no {program}")
        site = self.site()
        for name, source, packages in [
                ("react18", self.REACT, ["react@18", "react-dom@18"]),
                ("react19", self.REACT, ["react@19", "react-dom@19", "@types/react@19",
                                         "typescript@5"]),
                ("vue3", self.VUE, ["vue@3"])]:
            folder = path(name)
            os.makedirs(folder, exist_ok=True)
            if not os.path.exists(os.path.join(folder, "node_modules")) and subprocess.run(
                    ["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", folder,
                     *packages], timeout=180).returncode:
                self.skipTest(f"npm cannot install {name} here: its registry does not answer")
            package = os.path.join(folder, "node_modules", "slf-field")
            shutil.rmtree(package, ignore_errors=True)
            os.makedirs(package)
            subprocess.run([os.path.join(ROOT, "scripts/npm-package"), SLF, folder], check=True)
            found, = [one for one in os.listdir(folder) if one.endswith(".tgz")]
            subprocess.run(["tar", "-C", package, "--strip-components=1", "-xzf",
                            os.path.join(folder, found)], check=True)
            with open(os.path.join(folder, "app.jsx"), "w") as file:
                file.write(source)
            for platform, output in [("node", path(f"{name}/app.cjs")),
                                     ("browser", os.path.join(site, name + ".js"))]:
                subprocess.run(["esbuild", "app.jsx", "--bundle", "--jsx=automatic",
                                "--log-level=error", f"--platform={platform}",
                                '--define:process.env.NODE_ENV="development"',
                                f"--outfile={output}"], cwd=folder, check=True)
            server = subprocess.run(["node", "app.cjs"], cwd=folder, capture_output=True, text=True)
            with self.subTest(name), Host(site) as host:
                self.assertEqual(server.stderr, "")
                self.assertRegex(server.stdout,
                                 '^<slf-field src="field.slf" view="60,10,3" min-distance="2">')
                page = self.embedded(host, f"<main>{server.stdout.strip()}</main>"
                                           f"<script src={name}.js></script>", script="")
                self.settled(page)
                self.assertEqual(page.run("[one().view, one().minDistance]"), ["60,10,3", 2])
                if name != "react18":  # it knows no events of elements
                    self.assertTrue(page.run("globalThis.heard"))
                page.run("give({view: '20,0,2.5', 'auto-rotate': ''}), 0")
                page.wait("one().view === '20,0,2.5' && one().autoRotate", 10)
                self.assertEqual(page.run("[one().minDistance, wrong]"), [1.02, []])
                page.close()
        with open(path("react19/types.tsx"), "w") as file:
            file.write(self.TYPES)
        checked = subprocess.run(
            ["node_modules/.bin/tsc", "--noEmit", "--strict", "--jsx", "react-jsx", "--module",
             "nodenext", "--target", "es2022", "types.tsx"], cwd=path("react19"),
            capture_output=True, text=True)
        self.assertEqual(checked.stdout, "")

    def test_a_page_says_what_it_is_about(self):
        about = {"title": "<A> brain", "author": "A. Author", "licence": "CC BY 4.0",
                 "description": 'What "it" shows', "source": "https://example.org/?a&b"}
        with open(path("about.json"), "w") as file:
            json.dump({"about": about}, file)
        folder = path("about")
        slf("export", self.fields[0], "-o", folder, "-f", "--levels", "0", "--views",
            path("about.json"), "--url", "https://example.org/brain/")
        with open(os.path.join(folder, "index.html")) as file:
            html = file.read()
        for head in ["<title>&lt;A> brain</title>",
                     '<meta property="og:title" content="&lt;A> brain">',
                     '<meta property="og:url" content="https://example.org/brain/">',
                     '<meta property="og:image" content="https://example.org/brain/poster.jpg">',
                     '<meta name="description" content="What &quot;it&quot; shows">']:
            self.assertIn(head, html)
        for url, image in [("https://example.org", "https://example.org/poster.jpg"),
                           ("https://example.org/a/b.html", "https://example.org/a/poster.jpg")]:
            slf("export", self.fields[0], "-o", folder, "-f", "--levels", "0", "--url", url)
            with open(os.path.join(folder, "index.html")) as file:
                self.assertIn(f'<meta property="og:image" content="{image}">', file.read())
        slf("export", self.fields[0], "-o", folder, "-f", "--levels", "0", "--views",
            path("about.json"))
        with Host(folder) as host:
            page = self.open(host.url + "/index.html")
            page.wait("globalThis.slf?.state === 'settled'")
            self.assertEqual(page.run("slf.root.getElementById('name').textContent"), "<A> brain")
            shown = page.run("document.querySelector('[slot=about]').innerText")
            self.assertEqual(shown, 'What "it" shows · A. Author · CC BY 4.0 · Source')
            self.assertEqual(page.run("document.querySelector('[slot=about] a').href"),
                             about["source"])
            self.assertGreater(page.run(
                "document.querySelector('[slot=about]').getBoundingClientRect().height"), 10)
            page.close()
        with open(path("about.json"), "w") as file:
            json.dump({"about": about | {"source": "javascript:alert(1)"}}, file)
        for options, code in [(["--views", path("about.json")], 3), (["--url", "//host"], 1)]:
            done = subprocess.run([SLF, "export", self.fields[0], "-o", folder, "-f", *options],
                                  capture_output=True)
            self.assertEqual(done.returncode, code, done.stderr)

    def test_an_exported_page_has_a_poster_and_needs_no_inline_script(self):
        folder = self.site()
        with open(os.path.join(folder, "index.html")) as file:
            html = file.read()
        self.assertIn('<meta property="og:image" content="poster.jpg">', html)
        self.assertIn("<title>Sphere light field", html)  # and not the name of a file
        self.assertLess(os.path.getsize(os.path.join(folder, "page.js")), 149000)
        for name in ["poster.jpg", "poster-light.jpg"]:
            self.assertLessEqual(os.path.getsize(os.path.join(folder, name)), 40 << 10)
        policy = ("default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src blob:; "
                  "style-src 'self'; connect-src 'self'; img-src 'self' data:")
        with Host(folder, headers={"Content-Security-Policy": policy}) as host:
            self.assertEqual(self.outcome(host.url + "/index.html", "settled"), "")

    # ---- languages ------------------------------------------------------------------------------

    WEB = os.path.join(ROOT, "page", "web")

    def scripts(self):
        """The sources of the page without its texts, shaders and comments, by name."""
        found = {}
        for name in sorted(os.listdir(self.WEB)):
            if name.endswith(".js") and name not in ("text.js", "shader.js", "march.js"):
                with open(os.path.join(self.WEB, name)) as file:
                    found[name] = re.sub(r"(^|\s)//.*|/\*.*?\*/", "", file.read())
        return found

    def texts(self):
        if not shutil.which("node"):
            self.skipTest("no node")
        shutil.copy(os.path.join(self.WEB, "text.js"), path("text.mjs"))
        return json.loads(subprocess.run(
            ["node", "--input-type=module", "-e", f"import {{kTexts}} from '{path('text.mjs')}';"
             "console.log(JSON.stringify(kTexts))"], check=True, capture_output=True).stdout)

    def test_every_text_is_in_each_language_and_in_use(self):
        texts, code = self.texts(), "".join(self.scripts().values())
        for name, row in texts.items():
            self.assertEqual([bool(one.strip()) for one in row], [True] * 3, name)
            values = [sorted(re.findall(r"\{\d\}", one)) for one in row]
            self.assertTrue(values[0] == values[1] == values[2], row)
        used = re.findall(r"(?:\bt|Told|refuse)\('(\w+)'", code)
        for name in set(used + re.findall(r"[^$]\{(\w+)\}", self.markup())):
            self.assertIn(name, texts)
        for name in texts:
            self.assertRegex(code, rf"'{name}'|\{{{name}\}}|\b{name}:", name)

    def markup(self):
        return re.search(r"`(<div lang[^`]*)`", self.scripts()["look.js"])[1]

    def test_no_text_stands_outside_the_table(self):
        markup = re.sub(r"<[^>]*>|\{\w+\}|srgb|depth|bitri", " ", self.markup())
        self.assertNotRegex(markup, r"\w{2}")
        for value in re.findall(r'(?:aria-label|title|placeholder|alt)="([^"]*)"', self.markup()):
            self.assertRegex(value, r"^(\{\w+\}( \(\w\))?|[A-Z]|)$")
        for name, code in self.scripts().items():
            if name == "module.js":  # messages of the module, as those of its C++, are English
                continue
            code = re.sub(r"(k\w*Style = |=> )`[^`]*`", "", code)  # styles and markup
            for quoted, template in re.findall(r"'([^'\n]*)'|`([^`<]*)`", code):
                text = quoted or re.sub(r"\$\{[^}]*\}", "", template)
                self.assertNotRegex(text, r"\b[a-z]{2,} [a-z]{2,} [a-z]{2,}\b|[A-Z][a-z]+ [a-z]+\b",
                                    name)

    SAID = """(() => {
      const all = [slf.root.getElementById('about').click()];
      for (const it of slf.root.querySelectorAll('*')) {
        for (const name of ['aria-label', 'title', 'placeholder'])
          all.push(it.getAttribute(name));
        for (const node of it.childNodes) if (node.nodeType === 3) all.push(node.data.trim());
      }
      return all.filter(Boolean);
    })()"""

    def test_a_page_speaks_the_language_of_the_browser(self):
        def said(language, fragment):
            page = self.browser.open("about:blank", 800, 600)
            page.call("Emulation.setUserAgentOverride", userAgent="test", acceptLanguage=language)
            page.call("Page.navigate", url=server.url + fragment)
            page.settle()
            found = page.run(self.SAID), page.run("document.documentElement.lang")
            page.screenshot(path(f"language-{language}.png"))
            page.close()
            return found

        texts = self.texts()
        views = {"views": [{"title": "Foo", "orbit": [30, 20, 3]}]}
        with self.explained(views, self.structured()) as server:
            english = said("it,en", "")
            self.assertEqual(english[1], "en")
            for number, language in [(1, "de"), (2, "fr")]:
                found, lang = said(f"it,{language}-CH,en", "")
                self.assertEqual(lang, language)
                for name in ["settings", "measure", "allOn", "about", "keys", "close", "lattice"]:
                    self.assertIn(re.sub(r"\n *", " ", texts[name][number]), found)
                # What is the same in both is the same in the table, or comes from the field.
                same = {row[0] for row in texts.values() if row[0] == row[number]}
                data = re.compile(r"[^a-z]*$|[xyz]$|srgb|depth|bitri|Foo|volume|rgb|\d+:|core|"
                                  r".* lobe|stem, white|Default labels|labels.raw|field.slf|.* [KM]iB")
                left = [one for one in set(found) & set(english[0]) - same if not data.match(one)]
                self.assertEqual(left, [])

    # ---- print ----------------------------------------------------------------------------------

    def test_print_shows_the_picture_and_what_is_said_of_it(self):
        words = {"about": {"title": "Balls", "description": "Three of them", "licence": "CC0"},
                 "views": [{"title": "First", "text": "A caption", "orbit": [30, 20, 3]}],
                 "notes": [{"label": "Note", "point": [0, 0, 0]}]}
        with self.explained(words) as server:
            page = self.browser.open(server.url, 800, 600)
            page.settle()
            page.call("Emulation.setEmulatedMedia", media="print", features=[])
            page.call("Emulation.setDeviceMetricsOverride", width=600, height=850,
                      deviceScaleFactor=1, mobile=False)
            page.settle()
            page.screenshot(path("print.png"))
            shown = page.run("""[...slf.root.querySelector('[lang]').children].filter((it) =>
                it.getBoundingClientRect().height > 1).map(({id}) => id).join()""")
            self.assertEqual(shown, "picture,panel,views")
            self.assertEqual(page.run("slf.root.getElementById('views').innerText.trim()"),
                             "First\n\nA caption")
            self.assertEqual(page.run("slf.canvas.clientWidth"), 600)
            self.assertEqual(page.run("slf.canvas.clientWidth / slf.canvas.clientHeight"), 4 / 3)
            self.assertIn("CC0", page.run("document.querySelector('[slot=about]').innerText"))
            self.assertEqual(page.run("""[...slf.root.querySelectorAll('button, input, select')]
                .filter((it) => it.offsetParent).length"""), 0)
            pdf = base64.b64decode(page.call("Page.printToPDF", printBackground=False)["data"])
            self.assertEqual(len(re.findall(rb"/Type\s*/Page\b", pdf)), 1)
            with open(path("print.pdf"), "wb") as file:
                file.write(pdf)
            page.close()

    # ---- access ---------------------------------------------------------------------------------

    def test_access(self):
        """axe-core, and the size of all targets, on a desktop and on a phone."""
        axe = path("axe/node_modules/axe-core/axe.min.js")
        if not os.path.exists(axe) and (not shutil.which("npm") or subprocess.run(
                ["npm", "install", "--silent", "--prefix", path("axe"), "axe-core@4"],
                timeout=120).returncode):
            self.skipTest("no axe-core: npm cannot install it here")
        with open(axe) as file:
            script = file.read()
        views = {"views": [{"title": "Left", "text": "A text", "orbit": [90, 0, 3]}],
                 "notes": [{"label": "Note", "text": "More", "point": [0, 0, 0]}]}
        panels = [("h", "settings"), ("l", "parts")]  # on a phone, the last one that is opened shows
        with self.explained(views, self.structured()) as server:
            for (width, height), dark in [((1280, 800), True), ((1280, 800), False),
                                          ((390, 844), True), ((390, 844), False)]:
                page = self.browser.open(server.url, width, height, dark=dark)
                page.settle()
                for key, panel in panels if dark else panels[::-1]:
                    if page.run(f"slf.root.getElementById('{panel}').hidden"):
                        self.press(page, key)
                page.run(script + "; 0")
                found = page.run("""axe.run(document, {runOnly: [
                    'wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa']}).then(
                    ({violations}) => violations.map(({id, nodes}) =>
                      [id, ...nodes.map(({target, failureSummary}) =>
                        [target.flat().join(' '), failureSummary])]))""", 120)
                with self.subTest(width=width, dark=dark):
                    self.assertEqual(found, [])
                    small = page.run("""[...slf.root.querySelectorAll(
                        'button, select, input, label')]
                      .filter((e) => e.offsetParent && !e.closest('label label, .check input'))
                      .filter((e) => !e.closest('label') || e.matches('label'))
                      .map((e) => [e.id || e.textContent.trim(), e.getBoundingClientRect()])
                      .filter(([, {width, height}]) => Math.min(width, height) < 43.5)
                      .map(([name, {width, height}]) => `${name} ${width} ${height}`)""")
                    self.assertEqual(small, [])
                page.close()


FOV = 2 * 19.471220634490695  # degrees: asin(1/3), twice

if __name__ == "__main__":
    if not shutil.which("chromium"):
        print("skipped: no chromium")
        sys.exit(77)
    probe = subprocess.run([SLF, "export", "-o", "/dev/null/x.html", "/nonexistent.slf"],
                           capture_output=True)
    if probe.returncode == 5:
        print("skipped: slf was built without the page")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
