"""The page under hands: the mouse, fingers, keys, saved views, notes and cuts.

Arguments and exit codes are those of page_testing.py.
"""

import json
import math
import subprocess

from page_testing import PageTest, SIZE, SLF, Server, main, path, slf


class UseTest(PageTest):
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
            page.run("""globalThis.taps = [];
              addEventListener('pointerup', (event) => taps.push(event), true)""")
            near = 0.6 * surface["distance"]
            for kind, apart, place, distance in [
                    ("mouse", 100, (220, 250), 3), ("mouse", 2, (500, 250), 1.8),
                    ("mouse", 2, (220, 250), near), ("touch", 2, (220, 250), near)]:
                for _ in range(10):  # until the second click is in time
                    page.run("slf.camera.reset()")
                    page.run("new Promise((done) => setTimeout(done, 400))")
                    for x in [place[0], place[0] + apart]:
                        at = (x, place[1])
                        self.drag(page, at, at, steps=0, touch=kind == "touch")
                    page.wait("!slf.flight")
                    if page.run("taps.at(-1).timeStamp - taps.at(-2).timeStamp < 250"):
                        break
                self.assertEqual(page.run("taps.at(-1).pointerType"), kind)
                self.assertAlmostEqual(page.run("slf.camera.distance"), distance, delta=0.02)
            # The camera turns about that point from then on.
            for key in ["", "ArrowRight", "ArrowUp"]:
                if key:
                    self.press(page, key)
                at = page.run(f"slf.camera.project({json.dumps(surface['point'])}, 512, 512)")
                self.assertAlmostEqual(at["x"], 256, delta=8)
                self.assertAlmostEqual(at["y"], 256, delta=8)
            self.assertEqual(page.run("[slf.camera.azimuth, slf.camera.elevation]"), [36, 26])
            page.close()

    # ---- explaining -----------------------------------------------------------------------------

    def test_saved_views_by_keyboard(self):
        views = [{"title": f"View {i}", "text": "See https://example.org.",
                  "orbit": [36 * i, 5 * i - 20, 2 + 0.1 * i]} for i in range(10)]
        with self.explained({"views": views}) as server:
            page = self.browser.open(server.url, SIZE, SIZE, calm=True)
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

    def rim(self, page):
        """A place on the rim of the first plane."""
        return page.run("""(({x, y}) => [x, y])(slf.project(
            slf.root.host.handles.rim(slf.cut.planes[0])[10]))""")

    def plane(self, page):
        return page.run("slf.root.host.clip.join().split(',').map(Number)")

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
            begin = self.rim(page)
            self.drag(page, begin, (begin[0] + 40, begin[1] + 10))
            tilted = self.plane(page)
            self.assertGreater(abs(tilted[3]) + abs(tilted[5]), 0.1)
            self.assertAlmostEqual(math.hypot(*tilted[3:]), 1, 4)
            self.assertEqual(page.run("slf.camera.toText()"), camera)  # which stays
            # The arrow has the focus.
            self.press(page, "Home")
            axis = self.plane(page)[3:]
            self.assertEqual(sorted(map(abs, axis)), [0, 0, 1])
            # With Shift, arrows turn it as a ball whose front moves that way.
            for key, back, way in [("ArrowRight", "ArrowLeft", "right"),
                                   ("ArrowDown", "ArrowUp", "down")]:
                self.press(page, key, self.SHIFT)
                there = page.run(f"slf.camera.axes(1, 1).{way}")
                turned = self.plane(page)[3:]
                self.assertGreater(sum((a - b) * w for a, b, w in zip(turned, axis, there)), 0.01)
                self.press(page, back, self.SHIFT)
                for a, b in zip(self.plane(page)[3:], axis):
                    self.assertAlmostEqual(a, b, delta=0.01)
            # Dropped near to an axis, it snaps to that, unless Shift is held.
            self.press(page, "Home")
            for options, snaps in [({"modifiers": self.SHIFT}, False), ({}, True),
                                   ({"touch": True}, True)]:
                begin = self.rim(page)
                self.drag(page, begin, (begin[0] + 4, begin[1] + 2), **options)
                self.assertEqual(sorted(map(abs, self.plane(page)[3:])) == [0, 0, 1], snaps)
            begin = self.rim(page)
            self.drag(page, begin, (begin[0] + 30, begin[1] + 20), touch=True)
            self.assertLess(max(map(abs, self.plane(page)[3:])), 0.995)
            self.assertEqual(page.run("slf.camera.toText()"), camera)
            self.press(page, "Home")
            before = self.plane(page)
            page.run("slf.root.getElementById('flip').click(), 0")
            self.assertEqual(self.plane(page), before[:3] + [-v if v else 0 for v in before[3:]])
            before = self.plane(page)
            self.press(page, "Enter")
            self.assertEqual(self.plane(page)[3:], [-v if v else 0 for v in before[3:]])
            self.press(page, "ArrowUp")
            after = self.plane(page)
            self.assertAlmostEqual(
                sum((a - b) * n for a, b, n in zip(after, before, after[3:])),
                0.02 * sphere["radius"], 2)
            more = "slf.root.getElementById('more')"
            for count in [2, 3]:
                page.run(more + ".click(), 0")
                page.wait(f"slf.cut.planes.length === {count}")
                self.assertEqual(page.run(more + ".disabled"), count == 3)
            for count in [2, 1]:
                page.run("slf.root.getElementById('remove').click(), 0")
                page.wait(f"slf.cut.planes.length === {count} && !{more}.disabled")
            # The wheel zooms over what lies on the picture, too.
            page.run("slf.root.host.say('A text'), 0")
            middle = """(({x, y, width, height}) => [x + width / 2, y + height / 2])(
                slf.root.querySelector('%s').getBoundingClientRect())"""
            for name in ["#planes .wide", "#planes circle", "#compass span", "#status"]:
                x, y = self.rim(page) if name == "#planes .wide" else page.run(middle % name)
                self.assertTrue(page.run(f"slf.root.elementFromPoint({x}, {y}).matches('{name}')"))
                page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0,
                          deltaY=100)
                page.wait("slf.camera.distance > 3", 10)
                page.run("slf.camera.fromText('30,20,3'), slf.moved(), 0")
            page.run("slf.root.host.say(''), 0")
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
                page = self.browser.open(server.url, *size, scale=0.5)
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
                page = self.browser.open(server.url, *size, scale=0.5)
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
                page = self.browser.open(server.url, width, 600, scale=0.5)
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
            page.run("navigator.clipboard.writeText = async (text) => { "
                     "globalThis.copied = text }, slf.root.getElementById('copy').click(), 0")
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
            page = self.browser.open(server.url + "#view=0,0,3&level=1", SIZE, SIZE,
                                     calm=True)
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


if __name__ == "__main__":
    main()
