"""The page's pictures beside those of slf render.

Arguments and exit codes are those of page_testing.py.
"""

import base64
import hashlib
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import time
from urllib.parse import quote

from host import Host
from page_testing import (DECODED, FULL, MIN_PSNR, PageTest, ROOT, SIZE, Server, VIEWS, index_size,
                          main, path, slf)

FOV = 2 * 19.471220634490695  # degrees: asin(1/3), twice


class PicturesTest(PageTest):
    def test_pictures_are_those_of_slf_render(self):
        for field in self.fields:
            info = json.loads(slf("info", field, "--json"))
            all_views = field == self.fields[0] or FULL
            with Server(field) as server:
                page = self.browser.open(server.url, SIZE, SIZE)
                page.settle()
                for k, mode in enumerate(["depth", "bitri"]):
                    for view in VIEWS if all_views else VIEWS[k::2]:
                        found = self.psnr(page, field, view, mode, info["levels"][-1]["level"])
                        print(f"{os.path.basename(field):20} {mode:6} {view}: {found:.1f} dB",
                              flush=True)
                        with self.subTest(field=field, mode=mode, view=view):
                            self.assertGreaterEqual(found, MIN_PSNR[mode])
                self.assertEqual(page.run("slf.statistics().damaged"), 0)
                page.close()
            self.assertEqual(server.status, -signal.SIGINT)  # as a shell expects of Ctrl-C

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
        every = slice(None)
        some = every if FULL else slice(1, 4, 2)
        for options, caps in [(["--lighting", "direct"], every), (["--lighting", "global"], some),
                              (["--no-reveal"], slice(1)),
                              (["--lighting", "direct", "--labels"], some),
                              (["--lighting", "global", "--color-type", "half"], some)]:
            reveal = "--no-reveal" not in options
            field = self.cut_field("cut", *[o for o in options if reveal])
            if not reveal:
                slf("repack", field, "-o", path("hollow.slf"), "-f", "--no-reveal")
                field = path("hollow.slf")
            with Server(field) as server:
                page = self.browser.open(server.url, SIZE, SIZE)
                page.settle()
                for clip, cap in [(up, "hollow"), (up, "shaded"), (two, "shaded"), (two, "slice"),
                                  (up, "slice:50,250")][caps]:
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

    def test_cuts_of_states_are_those_of_slf_render(self):
        """Each state has its own colours, of the faces, too."""
        with open(path("colours.json"), "w") as file:
            json.dump({"states": [{"name": name, "transfer": name}
                                  for name in ["mr-brain", "flame"]]}, file)
        field = self.cut_field("colours", "--lighting", "direct", "--states", path("colours.json"))
        clip, drawn = "16,16,17,0,0,1", []
        with Server(field) as server:
            page = self.browser.open(server.url, SIZE, SIZE)
            page.settle()
            for state in ["flame", "mr-brain"]:
                self.cut(page, f"{clip}&state={state}", "shaded")
                self.assertEqual(page.run("slf.root.host.state"), state)
                page.canvas(path("cut-page.png"))
                drawn.append(path(state + ".png"))
                slf("render", field, "-o", drawn[-1], "-f", "--state", state, "--level", 1,
                    "--orbit", "30,20,3", "--size", f"{SIZE}x{SIZE}", "--background", "0,0,0",
                    "--clip", clip)
                found = json.loads(slf("compare", path("cut-page.png"), drawn[-1], "--json"))
                with self.subTest(state=state):
                    self.assertGreaterEqual(found["psnr"] or 99, 42)
            page.close()
        found = json.loads(slf("compare", *drawn, "--json"))
        self.assertLess(found["psnr"], 25)

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
            page.wait("globalThis.slf?.root.getElementById('status').textContent"
                      ".includes('no structure named no such')")
            page.settle()
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


if __name__ == "__main__":
    main()
