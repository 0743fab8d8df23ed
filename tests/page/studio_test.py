"""The studio of `slf view VOLUME`, in Chromium: what it shows, saves and builds is what the
commands make of the recipe that it saves.

    studio_test.py SLF FOLDER
"""

import base64
import http.client
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
import unittest
import urllib.parse

from browser import Browser, BrowserError

SLF, WORK = sys.argv[1:3]
DIMS = (28, 26, 24)


def path(name):
    return os.path.join(WORK, name)


def slf(*arguments, code=0):
    done = subprocess.run([SLF, "-q", *arguments], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.stderr)
    return done.stdout


class Studio:
    """slf view of something that a field can be made of."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen([SLF, "-q", "view", *arguments], stdout=subprocess.PIPE,
                                        text=True, cwd=WORK)
        self.url = self.process.stdout.readline().strip()
        if self.url:
            self.url += "studio/"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        self.status = self.process.wait(120)
        self.process.stdout.close()

    def ask(self, what, body=None, method=None, headers={}):
        """The status and the bytes of an answer."""
        address = urllib.parse.urlsplit(self.url)
        connection = http.client.HTTPConnection(address.netloc, timeout=60)
        text = body if isinstance(body, (bytes, type(None))) else json.dumps(body)
        connection.request(method or ("GET" if body is None else "POST"), address.path + what, text,
                           headers)
        answer = connection.getresponse()
        got = answer.status, answer.read()
        connection.close()
        return got

    def state(self):
        return json.loads(self.ask("state")[1])

    def show(self, **options):
        status, said = self.ask("recipe", {"revision": self.state()["revision"], "shown": options,
                                           "recipe": options, "views": {}})
        return status, json.loads(said)


class StudioTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        os.makedirs(WORK)
        middle = [(d - 1) / 2 for d in DIMS]
        with open(path("ball.raw"), "wb") as file:
            file.write(bytes(
                min(255, max(0, int(128 + 40 * (9 - math.dist((x, y, z), middle)))))
                for z in range(DIMS[2]) for y in range(DIMS[1]) for x in range(DIMS[0])))
        with open(path("ball.nhdr"), "w") as file:
            file.write("NRRD0004\ntype: uint8\ndimension: 3\nencoding: raw\nspacings: 1 1 1\n"
                       f"sizes: {DIMS[0]} {DIMS[1]} {DIMS[2]}\ndata file: ball.raw\n")
        cls.browser = Browser()

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()

    def setUp(self):
        for name in os.listdir(WORK):
            if name not in ("ball.raw", "ball.nhdr"):
                os.remove(path(name))

    def open(self, studio, width=900, height=500):
        page = self.browser.open(studio.url, width, height)
        self.fine(page)
        return page

    def fine(self, page):
        """Waits until the picture is as good as it gets."""
        page.wait("globalThis.studio?.shown.stage === 5 && !studio.sending &&"
                  " studio.shown.serial === studio.serial &&"
                  " performance.now() - studio.pictures.at(-1).at > 400")

    def canvas(self, page, name):
        url = page.run("document.getElementById('picture').toDataURL('image/png')")
        with open(path(name), "wb") as file:
            file.write(base64.b64decode(url.split(",", 1)[1]))

    def set(self, page, label, value, event="change"):
        page.run(f"""(() => {{
          const input = document.querySelector({json.dumps(label)});
          input.value = {json.dumps(value)};
          input.dispatchEvent(new Event('{event}'));
        }})()""")

    def test_from_looking_to_a_field(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            page = self.open(studio)
            stages = page.run("studio.pictures.map((p) => p.stage)")
            self.assertEqual(stages, sorted(stages))
            self.assertEqual(stages[0], 1)  # a small one comes first
            page.wait("document.querySelector('#presets img')?.complete")
            self.assertGreater(page.run("document.querySelector('#presets img').naturalWidth"), 0)
            self.set(page, "#notename", "Here", "input")
            page.run("document.getElementById('addnote').click()")
            middle = page.run("""(() => {
              const {x, y, width, height} = document.getElementById('picture')
                .getBoundingClientRect();
              return [x + width / 2, y + height / 2];
            })()""")
            self.mouse(page, [middle, middle])
            page.wait("document.querySelectorAll('#notelist li').length === 1")
            side = page.run("[studio.camera.azimuth, studio.camera.elevation]")
            page.run("document.querySelectorAll('#presets button')[3].click()")
            self.fine(page)
            before = page.run("studio.state.revision")

            # Drag the last point but one of the curve to the left and down.
            box = page.run("""(() => {
              const {left, top, width, height} = document.getElementById('curve')
                .getBoundingClientRect();
              return [left, top, width, height];
            })()""")
            point = page.run("""(() => {
              const [value, opacity] = ['Value', 'Opacity'].map((name) => Number(
                [...document.querySelectorAll(`[aria-label^="${name} of point"]`)].at(-2).value));
              const ends = [...document.querySelectorAll('#ends span')].map((e) =>
                parseFloat(e.textContent));
              return [(value - ends[0]) / (ends[1] - ends[0]), 1 - opacity];
            })()""")
            x, y = box[0] + point[0] * box[2], box[1] + 4 + point[1] * (box[3] - 8)
            self.mouse(page, [(x, y), (x - 6, y + 10), (x - 12, y + 20), (x - 20, y + 30)])
            self.fine(page)
            self.assertGreater(page.run("studio.state.revision"), before)
            serials = page.run("studio.pictures.map((p) => p.serial)")
            self.assertEqual(serials, sorted(serials))  # none is older than the one before

            page.run("document.querySelector('[data-axis=\"1\"]').click()")
            # A place of the slider means the same plane, whatever is shown.
            numbers = "document.querySelector(\"[aria-label='Point and normal of plane 1']\").value"
            found = []
            for to in ["-0.2", "0.1", "-0.2"]:
                self.set(page, "[aria-label='Place of plane 1']", to)
                self.fine(page)
                found.append(page.run(numbers))
            self.assertEqual(found[0], found[2])
            self.assertNotEqual(found[0], found[1])
            place = "Number(document.querySelector(\"[aria-label='Place of plane 1']\").value)"
            knob = page.run("""(() => {
              const {x, y, width} = document.querySelector('#handles circle')
                .getBoundingClientRect();
              return [x + width / 2, y + width / 2];
            })()""")
            self.mouse(page, [knob, (knob[0] + 8, knob[1] - 8), (knob[0] + 40, knob[1] - 40)])
            dragged = page.run(place)
            self.assertNotAlmostEqual(dragged, -0.2, delta=0.02)
            page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowDown")
            # Backwards along its normal, which points to the eye: here to -y.
            self.assertAlmostEqual(page.run(place), dragged + 0.02, delta=0.006)
            self.fine(page)
            page.run("document.getElementById('undo').click()")
            page.run("document.getElementById('redo').click()")
            page.run("document.getElementById('picture').focus()")
            page.call("Input.dispatchKeyEvent", type="keyDown", key="+")
            for _ in range(3):
                page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
            self.set(page, "#viewname", "From the left", "input")
            page.run("document.getElementById('addview').click()")
            self.set(page, "[data-about=title]", "A ball")
            self.set(page, "#finest_level", "0")
            page.wait("studio.state.revision > 5")
            self.fine(page)
            page.call("Input.dispatchKeyEvent", type="keyDown", key="r")
            self.fine(page)
            size = self.kept(page)
            slf("raycast", path("ball.recipe.json"), "-o", path("cast.png"), "--size", size)
            self.assertIn("inf", slf("compare", path("shown.png"), path("cast.png")))

            self.set(page, "#statename", "whole head", "input")
            page.run("document.getElementById('addstate').click()")
            self.fine(page)
            page.run("document.querySelector('#planes button:last-child').click()")
            self.fine(page)
            page.wait("document.getElementById('forecast').textContent.includes('MiB')", 60)
            forecast = page.run("parseFloat(document.getElementById('forecast').textContent"
                                ".match(/[0-9.e+-]+/)[0])") * 2**20
            page.run("document.getElementById('build').click()")
            page.wait("!document.getElementById('result').hidden", 240)
            size = os.path.getsize(path("ball.slf"))
            self.assertAlmostEqual(forecast, size, delta=0.2 * size + 2**15)
            publish = page.run("document.getElementById('publish').textContent")
            self.assertEqual(publish, "slf export ball.slf -o ball-page --views ball.views.json")
            subprocess.run([SLF, "-q", *publish.split()[1:]], cwd=WORK, check=True)
            shutil.rmtree(path("ball-page"))
            inside = "document.querySelector('iframe').contentWindow.slf"
            page.wait(f"{inside}?.state === 'settled'", 240)
            self.set(page, "#compare", "0", "input")
            box = f"{inside}.root.getElementById('panel').getBoundingClientRect().width"
            self.assertEqual(page.run(box), 0)
            self.assertEqual(page.run("document.querySelector('iframe').contentDocument"
                                      ".querySelector('slf-field').view"),
                             page.run("studio.camera.toText()"))
            page.run("document.getElementById('field').removeAttribute('target')")
            page.run("document.getElementById('field').click()")
            page.wait("globalThis.slf?.state === 'settled'", 240)
            page.close()

        with open(path("ball.recipe.json")) as file:
            recipe = json.load(file)
        self.assertEqual(recipe["input"], "ball.nhdr")
        self.assertEqual([state["name"] for state in recipe["states"]], ["whole", "whole head"])
        with open(path("ball.views.json")) as file:
            said = json.load(file)
        self.assertEqual(said["views"][0]["title"], "From the left")
        self.assertEqual(said["about"], {"title": "A ball"})
        self.assertEqual(said["notes"][0]["label"], "Here")
        x, y, z = (p - t for p, t in zip(said["notes"][0]["point"], said["views"][0]["target"]))
        self.assertAlmostEqual(math.degrees(math.atan2(x, -y)), side[0], delta=2)
        self.assertAlmostEqual(math.degrees(math.atan2(z, math.hypot(x, y))), side[1], delta=2)
        self.assertFalse(os.path.exists(path("ball.recipe.json.draft")))
        slf("build", path("ball.recipe.json"), "-o", path("again.slf"))
        slf("diff", path("ball.slf"), path("again.slf"))

    def mouse(self, page, places):
        for kind, (x, y), buttons in zip(
                ["mousePressed"] + ["mouseMoved"] * (len(places) - 2) + ["mouseReleased"], places,
                [1] * (len(places) - 1) + [0]):
            page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                      buttons=buttons, clickCount=1)
            time.sleep(0.05)

    def test_what_is_made_survives(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            self.assertEqual(studio.show(exposure=1.5)[0], 200)
            self.assertEqual(studio.ask("recipe", {"revision": 1, "shown": {}})[0], 409)
        self.assertEqual(studio.status, -signal.SIGINT)
        self.assertEqual(sorted(os.listdir(WORK)),
                         ["ball.nhdr", "ball.raw", "ball.recipe.json.draft"])
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            self.assertEqual(studio.state()["shown"], {"exposure": 1.5})
            self.assertEqual(studio.ask("save", {})[0], 200)
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:  # another one owns no recipe
            status, said = studio.ask("save", {})
            self.assertEqual(status, 422)
            self.assertIn("exists", json.loads(said)["error"])

    def test_a_recipe_that_is_opened_is_edited(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            state = studio.state()
            self.assertEqual(studio.ask("recipe", {
                "revision": state["revision"], "shown": {"exposure": 1}, "recipe": {"exposure": 1},
                "views": {"notes": [{"label": "a", "point": [1, 2, 3]}]}})[0], 200)
            self.assertEqual(studio.ask("save", {})[0], 200)
        with Studio("ball.recipe.json", "-o", "ball.slf") as studio:
            state = studio.state()
            self.assertEqual(state["shown"]["exposure"], 1)
            self.assertEqual(state["views"]["notes"][0]["label"], "a")
            wrong = {"revision": state["revision"], "shown": {}, "views": {"notes": [{}]}}
            self.assertEqual(studio.ask("recipe", wrong)[0], 422)
            self.assertEqual(studio.show(exposure=2)[0], 200)
            self.assertEqual(studio.ask("save", {})[0], 200)
        with open(path("ball.recipe.json")) as file:
            self.assertEqual(json.load(file)["exposure"], 2)

    def test_files_of_others_stay(self):
        for name in ["ball.recipe.json", "ball.views.json"]:
            with open(path(name), "w") as file:
                file.write("{}")
            for _ in range(2):  # the second one goes on from the draft of the first
                with Studio("ball.nhdr", "-o", "ball.slf") as studio:
                    state = studio.state()
                    self.assertEqual(studio.ask("recipe", {
                        "revision": state["revision"], "shown": {}, "recipe": {},
                        "views": {"views": [{"title": "a", "orbit": [1, 2, 3]}]}})[0], 200)
                    status, said = studio.ask("save", {})
                    self.assertEqual(status, 422)
                    self.assertIn(name, json.loads(said)["error"])
            with open(path(name)) as file:
                self.assertEqual(file.read(), "{}")
            os.remove(path(name))
        with open(path("ball.recipe.json.draft"), "w") as file:
            file.write("my notes")
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            self.assertEqual(studio.url, "")
            studio.process.wait(30)
        with open(path("ball.recipe.json.draft")) as file:
            self.assertEqual(file.read(), "my notes")
        # A draft that somebody else wrote has no other files read or removed.
        for name in ["secret.hdr", "ball.environment-x.hdr"]:
            with open(path(name), "w") as file:
                file.write("mine")
        foreign = [os.path.abspath(path("secret.hdr")), "secret.hdr", "ball.environment-x.hdr",
                   "../secret.hdr"]
        with open(path("ball.recipe.json.draft"), "w") as file:
            json.dump({"recipe": {}, "shown": {}, "owns": foreign, "loose": foreign}, file)
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            for name in foreign:
                status, said = studio.show(environment=name)
                self.assertEqual(status, 422)
                self.assertIn("command line", said["error"])
        for name in ["secret.hdr", "ball.environment-x.hdr"]:
            with open(path(name)) as file:
                self.assertEqual(file.read(), "mine")

    def test_requests_are_untrusted(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            for options, part in [({"exposure": "much"}, "exposure"), ({"nothing": 1}, "nothing"),
                                  ({"labels_volume": "/etc/passwd"}, "command line"),
                                  ({"transfer": "/etc/passwd"}, "command line"),
                                  ({"up_axis": "z"}, "up_axis")]:
                status, said = studio.show(**options)
                self.assertEqual(status, 422, options)
                self.assertIn(part, said["error"])
            for body in [b"", b"[", b"[]", b"{" * 5000, b'{"orbit": [1, 2, 3], "size": [9, 9]}',
                         b'{"orbit": [0, 0, 0, 0, 0, 0], "size": [1e9, 1]}']:
                self.assertIn(studio.ask("look", body, "POST")[0], [400, 422, 500], body)
            self.assertEqual(studio.ask("recipe", b"x" * (2 << 20), "POST")[0], 413)
            self.assertEqual(studio.ask("nothing")[0], 404)
            self.assertEqual(studio.ask("state", b"", "PUT")[0], 405)
            inside, studio.url = studio.url, studio.url.replace(studio.url.split("/")[3], "0" * 32)
            self.assertEqual(studio.ask("state")[0], 403)
            self.assertEqual(studio.ask("save", {})[0], 403)
            studio.url = inside
            self.assertEqual(studio.ask("state")[0], 200)
            # Nothing is visible: a message, and the page goes on.
            status, said = studio.show(transfer={"RGBPoints": [500, 1, 1, 1],
                                                 "Points": [500, 0, 0.5, 0]})
            self.assertEqual(status, 200)
            status, said = studio.ask("look", {"page": 1, "serial": 1, "size": [32, 32],
                                               "orbit": [30, 20, 3, 0, 0, 0]})
            self.assertEqual(status, 422)
            self.assertIn("visible", json.loads(said)["error"])

    def test_files_of_states_are_those_that_the_recipe_named(self):
        os.makedirs(path("made"))
        self.addCleanup(shutil.rmtree, path("made"))
        colors = [{"Name": "c", "ColorSpace": "RGB", "RGBPoints": [0, 1, 0, 0, 255, 1, 0, 0],
                   "Points": [100, 0, 0.5, 0, 130, 1, 0.5, 0]}]
        for name in ["made/red.json", "other.json"]:
            with open(path(name), "w") as file:
                json.dump(colors, file)
        states = [{"name": "a"}, {"name": "b", "transfer": "red.json"}]
        with open(path("made/two.json"), "w") as file:
            json.dump({"input": "../ball.nhdr", "quality": "draft", "states": states}, file)
        with Studio("made/two.json", "-o", "two.slf") as studio:
            state = studio.state()
            self.assertEqual(studio.ask("save", {})[0], 200)
            with open(path("two.recipe.json")) as file:
                saved = json.load(file)
            self.assertEqual([saved["input"], saved["states"][1]["transfer"]],
                             ["ball.nhdr", "made/red.json"])
            recipe = state["recipe"]
            recipe["states"][1]["transfer"] = "other.json"
            studio.ask("recipe", {"revision": state["revision"], "shown": state["shown"],
                                  "recipe": recipe})
            for what in ["save", "build", "forecast"]:
                status, said = studio.ask(what, {})
                self.assertEqual(status, 422)
                self.assertIn("command line", json.loads(said)["error"])
        slf("build", path("two.recipe.json"), "-o", path("two.slf"), "--dry-run")

    def test_labels_have_colours_and_opacities(self):
        self.make_atlas()
        with open(path("names.txt"), "w") as file:
            file.write("1 core 255 0 0 255\n2 shell 0 0 255 255\n")
        with open(path("made.json"), "w") as file:
            json.dump({"input": "atlas.nhdr", "labels": True, "label_table": "names.txt",
                       "entry": 4, "exit": 16, "finest_level": 0}, file)
        with Studio("made.json", "-o", "atlas.slf") as studio:
            page = self.open(studio, 900, 700)
            rows = page.run("[...document.querySelectorAll('.label')].map((row) =>"
                            " [row.innerText.trim(), row.querySelector('[type=color]').value])")
            self.assertEqual([(name.split()[0], color) for name, color in rows],
                             [("core", "#ff0000"), ("shell", "#0000ff")])
            self.set(page, "[aria-label='Colour of core']", "#00ff00", "input")
            self.set(page, "[aria-label='Opacity of shell']", "0.25", "input")
            self.fine(page)
            self.canvas(page, "shown.png")
            size = page.run("['width', 'height'].map((side) =>"
                            " document.getElementById('picture')[side]).join('x')")
            page.run("document.querySelector('[aria-label=\"Only core\"]').click()")
            self.assertEqual(page.run("studio.pictures.length && [...document.querySelectorAll("
                                      "'.label [type=checkbox]')].map((box) => box.checked)"),
                             [True, False])
            page.run("document.querySelector('[aria-label=\"Only core\"]').click()")
            self.fine(page)
            page.run("document.getElementById('save').click()")
            page.wait("document.getElementById('said').textContent.startsWith('Saved')")
            page.run("document.getElementById('each_label').click()")
            self.fine(page)
            self.assertTrue(studio.state()["recipe"]["each_label"])
            page.wait("document.getElementById('forecast').textContent.includes('MiB')", 60)
            page.close()
        with open(path("atlas.recipe.json")) as file:
            labels = json.load(file)["label_table"]["labels"]
        self.assertEqual([(one["id"], one["color"], one["opacity"]) for one in labels],
                         [(1, [0, 1, 0], 1), (2, [0, 0, 1], 0.25)])
        slf("raycast", path("atlas.recipe.json"), "-o", path("cast.png"), "--size", size)
        self.assertIn("inf", slf("compare", path("shown.png"), path("cast.png")))

    def drop(self, page, name, expression):
        """Drops a file of this name, whose bytes an expression makes."""
        page.run(f"""(() => {{
          const dataTransfer = new DataTransfer();
          dataTransfer.items.add(new File([{expression}], {json.dumps(name)}));
          dispatchEvent(new DragEvent('drop', {{dataTransfer, cancelable: true}}));
        }})()""")

    def status(self, page, part):
        page.wait("document.getElementById('status').textContent.includes("
                  f"{json.dumps(part)}) === true")

    def test_surroundings_are_dropped(self):
        # Radiance HDR of 512 x 256, in more than one piece: bright from the left, dim elsewhere.
        sky = """(() => {
          const head = new TextEncoder().encode('#?RADIANCE\\nFORMAT=32-bit_rle_rgbe\\n\\n' +
                                                '-Y 256 +X 512\\n');
          const pixels = new Uint8Array(512 * 256 * 4).map((_, k) => k % 4 === 3
            ? ((k >> 2) % 512 < 128 ? 132 : 127) : 128);
          return new Blob([head, pixels]);
        })()"""
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            page = self.open(studio)
            self.canvas(page, "before.png")
            self.drop(page, "wrong.hdr", "'no picture'")
            self.status(page, "wrong.hdr: expected a picture in OpenEXR or Radiance HDR")
            self.drop(page, "sky.hdr", sky)
            page.wait("document.getElementById('surroundings').naturalWidth === 160")
            self.assertEqual(page.run("document.getElementById('status').textContent"), "")
            self.set(page, "#environment_gain", "0.5")
            self.fine(page)
            self.canvas(page, "shown.png")
            self.assertNotIn("inf", slf("compare", path("before.png"), path("shown.png")))
            size = page.run("['width', 'height'].map((side) =>"
                            " document.getElementById('picture')[side]).join('x')")
            self.drop(page, "other.hdr", sky)
            page.wait("document.getElementById('surroundings').src.includes('environment-2')")
            page.run("document.getElementById('undo').click()")
            page.wait("!document.getElementById('surroundings').src.includes('environment-2')")
            self.fine(page)
            page.run("document.getElementById('save').click()")
            page.wait("document.getElementById('said').textContent.startsWith('Saved')")
            page.run("document.getElementById('sky').click()")
            page.wait("document.getElementById('surroundings').hidden && !studio.sending")
            page.close()
            status, said = studio.show(environment="/etc/passwd")
            self.assertEqual(status, 422)
            for head, body in [({"Slf-First": 5, "Slf-Size": 9}, b"abcd"),
                               ({"Slf-First": 0, "Slf-Size": 2}, b"abcd"),
                               ({"Slf-First": 0, "Slf-Size": 1 << 40}, b"abcd")]:
                self.assertEqual(studio.ask("environment", body, "POST", head)[0], 422)
        self.assertEqual(  # the second one, which nothing names, is gone
            sorted(name for name in os.listdir(WORK) if "environment" in name),
            ["ball.environment.hdr"])
        with open(path("ball.recipe.json")) as file:
            self.assertEqual(json.load(file)["environment"], "ball.environment.hdr")
        slf("raycast", path("ball.recipe.json"), "-o", path("cast.png"), "--size", size)
        self.assertIn("inf", slf("compare", path("shown.png"), path("cast.png")))

    def network(self, page, **conditions):
        page.call("Network.enable")
        page.call("Network.emulateNetworkConditions", **{
            "offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1,
            **conditions})

    def test_a_lost_connection(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            page = self.open(studio)
            self.network(page, offline=True)
            self.status(page, "does not answer")
            self.set(page, "#exposure", "1.5")
            time.sleep(1.5)
            self.assertEqual(studio.state()["shown"], {})
            self.network(page)
            page.wait("document.getElementById('status').textContent === ''")
            page.wait("!studio.sending")
            self.fine(page)
            self.assertEqual(studio.state()["shown"], {"exposure": 1.5})

            # The lid is closed for a while: no process runs.
            stopped = [studio.process.pid, *self.browser.processes()]
            for then in (signal.SIGSTOP, signal.SIGCONT):
                for process in stopped:
                    os.kill(process, then)
                time.sleep(2)
            self.set(page, "#exposure", "-1")
            page.wait("!studio.sending")
            self.fine(page)
            self.assertEqual(studio.state()["shown"], {"exposure": -1})

            port = urllib.parse.urlsplit(studio.url).port
            studio.process.kill()
            studio.process.wait()
            self.status(page, "does not answer")
            with Studio("ball.nhdr", "-o", "ball.slf", "--port", str(port)) as next_one:
                self.status(page, "started again")
                self.assertEqual(next_one.state()["shown"], {"exposure": -1})
            page.call("Page.navigate", url="about:blank")
            page.close()

    def test_a_slow_link(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            page = self.open(studio, 1320, 1000)
            drag = [(300 + 8 * k, 300 + 3 * k) for k in range(60)]
            self.mouse(page, drag)
            self.fine(page)
            near = self.motion(page)
            self.network(page, latency=40, downloadThroughput=10e6 / 8, uploadThroughput=10e6 / 8)
            self.mouse(page, drag)
            self.fine(page)
            far = self.motion(page)
            self.network(page, latency=40, downloadThroughput=4e5 / 8, uploadThroughput=10e6 / 8)
            self.mouse(page, drag)
            page.wait("studio.pictures.at(-1).moving === false")
            slow = self.motion(page)
            page.close()
        print(f"pictures in motion, (milliseconds, width): {near}, 10 Mbit/s {far}, 0.4 {slow}")
        self.assertLess(far[0], 250)
        self.assertLess(slow[1], near[1])

    def motion(self, page):
        """The median time between moving pictures since the last call, and the last one's width."""
        seen = page.run("studio.pictures.filter((one) => one.moving).map((one) =>"
                        " [one.at, one.width])")
        page.run("studio.pictures.length = 0")
        steps = sorted(b[0] - a[0] for a, b in zip(seen, seen[1:]))
        return round(steps[len(steps) // 2]), seen[-1][1]

    def test_two_pages_and_a_reload(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            one, other = self.open(studio), self.open(studio)
            value = "Number(document.getElementById('exposure').value)"
            self.set(one, "#exposure", "1.5", "input")
            other.wait(f"{value} === 1.5")
            for page in (one, other):
                self.fine(page)
            self.canvas(one, "one.png")
            self.canvas(other, "other.png")
            self.assertIn("inf", slf("compare", path("one.png"), path("other.png")))

            self.network(other, offline=True)
            self.status(other, "does not answer")
            self.set(other, "#exposure", "2")
            self.set(one, "#exposure", "1")
            one.wait("!studio.sending")
            self.network(other)
            self.status(other, "Another page changed the recipe")
            self.assertEqual(other.run(value), 1)
            other.run("document.getElementById('undo').click()")
            one.wait(f"{value} === 2")
            other.close()

            # A state is chosen, the camera turned, and a change on its way.
            self.set(one, "#statename", "bright", "input")
            one.run("document.getElementById('addstate').click()")
            one.run("document.getElementById('picture').focus()")
            one.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
            self.fine(one)
            camera = one.run("studio.camera.toText()")
            self.set(one, "#exposure", "0.5")
            one.run("globalThis.before = true, location.reload()")
            one.wait("!globalThis.before")
            one.wait(f"globalThis.studio?.shown.stage === 5 && {value} === 0.5")
            self.assertEqual(one.run("studio.camera.toText()"), camera)
            self.assertEqual(one.run("document.querySelector('#statelist [aria-pressed=true]')"
                                     ".textContent"), "bright")
            one.close()

    def test_access(self):
        """axe-core, on a desktop and on a phone, with all that the panel has."""
        axe = path("axe/node_modules/axe-core/axe.min.js")
        self.addCleanup(shutil.rmtree, path("axe"), ignore_errors=True)
        if not shutil.which("npm") or subprocess.run(
                ["npm", "install", "--silent", "--prefix", path("axe"), "axe-core@4"],
                timeout=120).returncode:
            self.skipTest("no axe-core: npm cannot install it here")
        with open(axe) as file:
            script = file.read()
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            for width, height, dark in [(1280, 800, True), (1280, 800, False), (390, 844, True),
                                        (390, 844, False)]:
                page = self.browser.open(studio.url, width, height, dark=dark)
                self.fine(page)
                page.run("document.querySelectorAll('details').forEach((one) => one.open = true)")
                page.run("document.querySelector('[data-axis=\"0\"]').click()")
                page.run(script + ";0")
                found = page.run("""axe.run(document, {runOnly: [
                  'wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa']}).then((all) =>
                  all.violations.map(({id, nodes}) => [id, nodes.map((node) => node.target)]))""")
                self.assertEqual(found, [], (width, dark))
                self.assertFalse(page.run("document.documentElement.scrollWidth > innerWidth"))
                page.close()

    def test_what_a_page_lost_is_sent_again(self):
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            first = {"page": 7, "revision": 1, "shown": {"exposure": 1}}
            self.assertEqual(studio.ask("recipe", first)[0], 200)
            self.assertEqual(studio.ask("recipe", first)[0], 200)  # its answer was lost
            self.assertEqual(studio.ask("recipe", {**first, "page": 8})[0], 409)

    def labelled(self, page, label):
        """The numbers in the inputs whose label begins so."""
        return page.run(f"[...document.querySelectorAll('[aria-label^=\"{label}\"]')]"
                        ".map((input) => Number(input.value))")

    def built(self, studio):
        """What the state says of a build once that has ended."""
        while True:
            told = studio.state()["build"]
            if "field" in told or "error" in told:
                return told
            time.sleep(0.05)

    def test_a_build_is_stopped_and_goes_on(self):
        os.makedirs(path("made"))
        self.addCleanup(shutil.rmtree, path("made"))
        with Studio("ball.nhdr", "-o", "ball.slf", "--save", "made/mine.json") as studio:
            options = {"lighting": "direct", "entry": 4, "exit": 24, "finest_level": 1}
            self.assertEqual(studio.ask("recipe", {
                "revision": studio.state()["revision"], "shown": options, "recipe": options,
                "views": {"views": [{"title": "a", "orbit": [1, 2, 3]}]}})[0], 200)
            self.assertEqual(studio.ask("build", {})[0], 200)
            while not studio.state()["build"]["done"]:
                pass
            self.assertEqual(studio.ask("build", {})[0], 409)
            self.assertEqual(studio.ask("stop", {})[0], 200)
            self.assertIn("interrupted", self.built(studio)["error"])
            self.assertFalse(os.path.exists(path("ball.slf")))
            self.assertTrue(os.path.exists(path("ball.slf.unfinished")))

            # One page goes on with the build and is closed; another waits for its picture.
            page, other = (self.browser.open(studio.url, 900, 500) for _ in range(2))
            for one in (page, other):
                self.fine(one)
            self.assertIn("interrupted", page.run("document.getElementById('said').textContent"))
            page.run("document.getElementById('build').click()")
            page.wait("document.getElementById('progress').value > 0")
            page.close()
            # Small pictures come meanwhile: six that wait would use up a browser's connections.
            text = json.dumps([{"Name": "one", "RGBPoints": [100, 1, 0, 0, 200, 1, 1, 0],
                                "Points": [100, 0, 0.5, 0, 200, 0.3, 0.5, 0]}])
            said = studio.ask("presets", {"name": "one.json", "text": text})[1]
            self.assertEqual(studio.ask(f"preset/{json.loads(said)['first']}")[0], 200)
            self.assertNotIn("field", studio.state()["build"])
            other.run("document.getElementById('picture').focus()")
            other.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
            other.wait("studio.shown.serial === studio.serial")  # of direct light, at once
            self.assertNotIn("field", studio.state()["build"])
            self.fine(other)  # after the build, of which nothing told it
            other.close()
            self.assertIn("field", self.built(studio))
            page = self.open(studio)
            page.wait("!document.getElementById('result').hidden")
            page.run("""
              navigator.clipboard.writeText = async (text) => { globalThis.copied = text; };
              document.getElementById('copypublish').click()""")
            self.assertEqual(page.run("copied"), studio.state()["build"]["publish"])
            page.run("document.getElementById('copy').click()")
            page.wait("document.getElementById('said').textContent.startsWith('Copied: slf build')")
            command = page.run("document.getElementById('said').textContent")
            page.close()
        self.assertEqual(sorted(os.listdir(path("made"))), ["mine.json", "mine.views.json"])
        self.assertEqual(sorted(os.listdir(WORK)), ["ball.nhdr", "ball.raw", "ball.slf", "made"])
        os.rename(path("ball.slf"), path("first.slf"))
        subprocess.run([SLF, "-q", *command.split()[2:]], cwd=WORK, check=True)
        slf("diff", path("first.slf"), path("ball.slf"))

    def test_habits_of_hands(self):
        with open(path("ball.recipe.json"), "w") as file:
            json.dump({"input": "other.nhdr"}, file)
        with Studio("ball.nhdr", "-o", "ball.slf") as studio:
            page = self.open(studio, 900, 800)
            self.assertIn("slf view ball.recipe.json goes on with it",
                          page.run("document.getElementById('said').textContent"))
            page.run("document.getElementById('save').click()")
            page.wait("document.getElementById('said').textContent.includes('did not begin with')")

            def key(name):
                for kind in ("keyDown", "keyUp"):
                    page.call("Input.dispatchKeyEvent", type=kind, key=name)

            def marked():
                return page.run("[...document.querySelectorAll('#presets button')].findIndex("
                                "(one) => one.getAttribute('aria-pressed') === 'true')")

            self.assertEqual(marked(), 0)
            page.run("document.querySelectorAll('#presets button')[3].click()")
            self.fine(page)
            self.assertEqual(marked(), 3)
            points = self.labelled(page, "Value of point")
            x, y = page.run("""(() => {
              const {left, top, width, height} = document.getElementById('curve')
                .getBoundingClientRect();
              const [value, opacity] = ['Value', 'Opacity'].map((name) => Number(
                [...document.querySelectorAll(`[aria-label^="${name} of point"]`)].at(-2).value));
              const [low, high] = [...document.querySelectorAll('#ends span')].map((e) =>
                parseFloat(e.textContent));
              return [left + (value - low) / (high - low) * width,
                      top + 4 + (1 - opacity) * (height - 8)];
            })()""")
            self.mouse(page, [(x, y), (x - 6, y + 10), (x - 20, y + 30)])
            self.fine(page)
            self.assertNotEqual(self.labelled(page, "Value of point"), points)
            self.assertEqual(marked(), -1)
            self.mouse(page, [(x - 20, y + 30), (x - 20, y + 30)])  # chosen, but not moved
            page.run("document.getElementById('undo').click()")  # all of the movement
            self.fine(page)
            self.assertEqual(self.labelled(page, "Value of point"), points)
            self.assertEqual(marked(), 3)

            for text, said in (("", ""), ("1e9", "must be less")):
                self.set(page, "#low", text)
                self.assertIn(said, page.run("document.getElementById('status').textContent"))
                self.assertEqual(self.labelled(page, "Value of point"), points)

            page.run("document.getElementById('saved').open = true")
            self.set(page, "#viewname", "From here", "input")
            page.run("document.getElementById('viewname').focus()")
            key("Enter")
            page.wait("document.querySelectorAll('#viewlist li').length === 1")
            page.run("document.getElementById('addnote').click()")
            self.status(page, "Click the place")
            key("Escape")
            self.assertEqual(page.run("document.getElementById('status').textContent"), "")
            self.mouse(page, [(300, 400), (300, 400)])
            page.close()
            self.assertEqual(studio.state()["views"].get("notes", []), [])

    def test_files_of_colours_are_dropped(self):
        files = {
            "one.json": json.dumps([{"Name": "one", "ColorSpace": "RGB",
                                     "RGBPoints": [100, 1, 0, 0, 200, 1, 1, 0],
                                     "Points": [100, 0, 0.5, 0, 200, 0.3, 0.5, 0]}]),
            "two.vp": "1\n1\n0\n0.2\n1\n0\n4 90 0 220 1\n4 0 1 255 1\n"
                      "8 90 0 1 0 220 0 0 1\n",
            "three.clut": "[FLT]\nmin=0\nmax=0\n[INT]\nnumnodes=2\n[BYT]\nnodeintensity0=0\n"
                          "nodeintensity1=255\n[RGBA255]\nnodergba0=0|0|0|0\n"
                          "nodergba1=255|0|255|200\n"}
        with open(path("made.json"), "w") as file:
            json.dump({"input": "ball.nhdr", "lighting": "direct"}, file)
        with Studio("made.json", "-o", "ball.slf") as studio:
            page = self.open(studio)
            self.drop(page, "wrong.txt", "'no colours'")
            self.status(page, "wrong.txt: expected a transfer function of ParaView")
            count = page.run("document.querySelectorAll('#presets button').length")
            self.canvas(page, "before.png")
            for k, (name, text) in enumerate(files.items(), 1):
                points = self.labelled(page, "Value of point")
                self.drop(page, name, json.dumps(text))
                page.wait("document.querySelectorAll('#presets button').length === "
                          f"{count + k} && !studio.sending")
                self.fine(page)
                self.canvas(page, "shown.png")
                self.assertNotIn("inf", slf("compare", path("before.png"), path("shown.png")))
                self.assertNotEqual(self.labelled(page, "Value of point"), points)
                os.replace(path("shown.png"), path("before.png"))
            names = [preset["name"] for preset in studio.state()["presets"]]
            self.assertEqual(names[count:], ["one", "two", "three"])
            page.run(f"document.querySelectorAll('#presets button')[{count}].click()")
            self.assertEqual(self.labelled(page, "Value of point"), [100, 200])
            self.assertEqual(self.labelled(page, "Opacity of point"), [0, 0.3])
            page.wait("[...document.querySelectorAll('#presets img')].every((image) =>"
                      " image.scrollIntoView() ?? image.naturalWidth > 0)")
            page.close()

    def test_settings_as_numbers(self):
        with open(path("made.json"), "w") as file:
            json.dump({"input": "ball.nhdr", "lighting": "direct", "range": [60, 180],
                       "transfer": "ct-bone"}, file)
        with Studio("made.json", "-o", "ball.slf") as studio:
            page = self.open(studio, 900, 800)
            page.run("document.querySelectorAll('details').forEach((one) => one.open = true)")

            def shown():
                page.wait("!studio.sending")
                return studio.state()["shown"]

            # The curve.
            values = self.labelled(page, "Value of point")
            self.assertEqual([values[0], values[-1]], [60, 180])
            self.set(page, "[aria-label='Value of point 1']", "-500")
            self.assertEqual(page.run("document.querySelector('#ends span').textContent"), "-500")
            self.set(page, "[aria-label='Value of point 1']", "50")
            self.set(page, "[aria-label='Opacity of point 2']", "0.125")
            self.set(page, "[aria-label='Colour of point 2']", "#00ff00")
            function = shown()["transfer"]
            self.assertEqual((function["Points"][0], function["Points"][5]), (50, 0.125))
            self.assertEqual(function["RGBPoints"][5:8], [0, 1, 0])
            self.assertNotIn("range", shown())
            page.run("document.getElementById('add').click()")
            self.assertEqual(len(self.labelled(page, "Value of point")), len(values) + 1)
            page.run("document.querySelector('[aria-label=\"Remove point 1\"]').click()")
            self.assertEqual(len(self.labelled(page, "Value of point")), len(values))
            self.set(page, "#low", "100")
            self.set(page, "#high", "200")
            ends = self.labelled(page, "Value of point")
            self.assertEqual([ends[0], ends[-1], shown()["transfer"]["Points"][0]],
                             [100, 200, 100])
            self.fine(page)
            page.call("Input.dispatchMouseEvent", type="mouseMoved", x=290, y=420)
            page.wait("document.getElementById('under').textContent")
            value, _, *place = page.run("document.getElementById('under').textContent").split()
            voxel = [round(float(x.strip(","))) for x in place]
            with open(path("ball.raw"), "rb") as file:
                file.seek(voxel[0] + DIMS[0] * (voxel[1] + DIMS[1] * voxel[2]))
                self.assertEqual(float(value), file.read(1)[0])

            # The light.
            page.run("document.getElementById('ball').focus()")
            page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight")
            turned = page.run("document.getElementById('ball').ariaValueText")
            self.assertEqual(turned, "10 right, 0 up")
            self.assertAlmostEqual(math.hypot(*shown()["light"]), 1, delta=0.001)
            page.run("document.getElementById('undo').click()")
            self.assertNotIn("light", shown())
            self.assertEqual(page.run("document.getElementById('ball').ariaValueText"),
                             "0 right, 0 up")
            page.run("document.getElementById('redo').click()")
            self.assertEqual(page.run("document.getElementById('ball').ariaValueText"), turned)

            # Planes, and a crop, whose undoing brings back the histogram.
            page.run("document.querySelector('[data-axis=\"0\"]').click()")
            numbers = "[aria-label='Point and normal of plane 1']"
            self.set(page, numbers, "13.5, 12.5, 11.5, 1, 0, 0")
            page.run("document.querySelector('#planes button').click()")
            self.set(page, numbers, "1, 2, 3")
            self.assertEqual(page.run(f'document.querySelector("{numbers}").value'),
                             "13.5, 12.5, 11.5, -1, 0, 0")
            self.assertEqual(shown()["clip"], [[13.5, 12.5, 11.5, -1, 0, 0]])

            def counted():
                self.fine(page)
                return sum(studio.state()["histogram"]["counts"])

            self.set(page, "#crop", "0:28,0:26,4:24")
            self.assertEqual(counted(), 28 * 26 * 20)
            page.run("document.getElementById('undo').click()")
            self.assertEqual(counted(), math.prod(DIMS))
            page.run("document.getElementById('redo').click()")

            # What excludes another, what states have in common, and what needs a title.
            self.set(page, "#projection", "mip")
            self.assertNotIn("lighting", shown())
            self.set(page, "#lighting", "shadowed")
            self.assertNotIn("projection", shown())
            page.run("document.getElementById('undo').click()")
            self.assertEqual(shown()["projection"], "mip")
            self.set(page, "#statename", "other", "input")
            page.run("document.getElementById('addstate').click()")
            self.set(page, "#quality", "draft")
            self.set(page, "#radius", "12.5")
            self.assertEqual(shown()["radius"], 12.5)
            recipe = studio.state()["recipe"]
            self.assertEqual((recipe["quality"], recipe["radius"]), ("draft", 12.5))
            page.run("document.querySelector('[aria-label=\"Remove other\"]').click()")
            page.run("document.querySelector('[aria-label=\"Remove whole\"]').click()")
            self.assertTrue(page.run("document.querySelector('[data-about=author]').disabled"))
            self.set(page, "[data-about=title]", "A ball")
            self.set(page, "[data-about=author]", "A. Author")
            self.set(page, "[data-about=source]", "nowhere")  # is not sent
            shown()
            self.set(page, "[data-about=source]", "https://example.org/ball")
            shown()
            self.assertEqual(studio.state()["views"]["about"], {
                "title": "A ball", "author": "A. Author", "source": "https://example.org/ball"})

            # The whole is what `slf raycast` draws.
            self.fine(page)
            page.run("document.getElementById('picture').focus()")
            page.call("Input.dispatchKeyEvent", type="keyDown", key="r")
            self.fine(page)
            size = self.kept(page)
            page.close()
        slf("raycast", path("ball.recipe.json"), "-o", path("cast.png"), "--size", size)
        self.assertIn("inf", slf("compare", path("shown.png"), path("cast.png")))

    def test_slices_and_pictures(self):
        for folder in ["slices", "balls"]:
            self.addCleanup(shutil.rmtree, path(folder), ignore_errors=True)
        os.makedirs(path("slices"))
        with open(path("ball.raw"), "rb") as file:
            for z in range(DIMS[2]):  # TIFF: tags with a number each, then the pixels
                tags = {256: DIMS[0], 257: DIMS[1], 258: 8, 259: 1, 262: 1, 273: 122,
                        277: 1, 278: DIMS[1], 279: DIMS[0] * DIMS[1]}
                with open(path(f"slices/{z:02}.tif"), "wb") as to:
                    to.write(b"II*\0" + struct.pack("<IH", 8, len(tags)))
                    for tag, number in tags.items():
                        to.write(struct.pack("<HHII", tag, 4, 1, number))
                    to.write(bytes(4) + file.read(DIMS[0] * DIMS[1]))
        slf("cameras", "--sphere", "0,0,0,1", "--count", "12", "--size", "32", "-o", path("c.json"))
        slf("raycast", "scene:balls", "--cameras", path("c.json"), "-o", path("balls"))
        for arguments, name in [(["slices/", "--spacing", "1x1x1"], "slices"),
                                (["pictures:balls"], "balls")]:
            with Studio(*arguments) as studio:  # whose output has the source's name
                page = self.open(studio, 600, 300)
                self.assertEqual(page.run("document.getElementById('status').textContent"), "")
                self.assertEqual(page.run("document.getElementById('presets').hidden"),
                                 name == "balls")
                if name == "slices":
                    self.assertEqual(sum(studio.state()["histogram"]["counts"]), math.prod(DIMS))
                size = self.kept(page)
                page.close()
            slf("raycast", path(f"{name}.recipe.json"), "-o", path(f"{name}.png"), "--size", size)
            self.assertIn("inf", slf("compare", path("shown.png"), path(f"{name}.png")))

    def kept(self, page):
        """Keeps the picture that is shown, and saves its recipe. The picture's size."""
        self.canvas(page, "shown.png")
        page.run("document.getElementById('save').click()")
        page.wait("document.getElementById('said').textContent.startsWith('Saved')")
        return page.run("['width', 'height'].map((side) =>"
                        " document.getElementById('picture')[side]).join('x')")

    def make_atlas(self):
        middle = [(d - 1) / 2 for d in DIMS]
        with open(path("atlas.raw"), "wb") as file:
            file.write(bytes(
                1 if distance < 5 else 2 if distance < 9 else 0
                for distance in (math.dist((x, y, z), middle)
                for z in range(DIMS[2]) for y in range(DIMS[1]) for x in range(DIMS[0]))))
        with open(path("ball.nhdr")) as file, open(path("atlas.nhdr"), "w") as atlas:
            atlas.write(file.read().replace("ball.raw", "atlas.raw"))

    def test_an_analytic_scene_within_a_sphere(self):
        with open(path("within.json"), "w") as file:
            json.dump({"input": "scene:balls", "center": [0.2, 0, 0], "radius": 0.5}, file)
        with Studio("within.json", "-o", "balls.slf") as studio:
            page = self.open(studio)
            self.assertEqual(page.run("document.getElementById('status').textContent"), "")
            self.canvas(page, "shown.png")
            size = page.run("['width', 'height'].map((side) =>"
                            " document.getElementById('picture')[side]).join('x')")
            page.close()
        slf("raycast", path("within.json"), "-o", path("cast.png"), "--size", size)
        self.assertIn("inf", slf("compare", path("shown.png"), path("cast.png")))


if __name__ == "__main__":
    try:
        Browser().__exit__()
    except BrowserError as error:
        print(error)
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
