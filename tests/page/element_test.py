"""<slf-field> in pages of others, and what a page says and in which languages.

Arguments and exit codes are those of page_testing.py.
"""

import base64
import json
import os
import re
import shutil
import subprocess
import time

from host import Host
from page_testing import FULL, PageTest, ROOT, SIZE, SLF, Server, main, path, slf


class ElementTest(PageTest):
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

    def leaves_what_ten_leave(self, page):
        """Calls the page's mount(k), and compares the workers, listeners, nodes and memory that 10
        and many calls leave. SLF_MOUNTS=1000 makes so many; otherwise there are as many as 8
        seconds allow, in full checks 20."""
        mounts = int(os.environ.get("SLF_MOUNTS", 0))
        page.call("Performance.enable")

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
        ten, count, until = left(), 10, time.monotonic() + (20 if FULL else 8)
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

    def test_many_mounts_leave_what_ten_leave(self):
        """Some elements are removed while they load."""
        with Host(self.site()) as host:
            page = self.embedded(host, "")
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
            self.leaves_what_ten_leave(page)
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
                                       " max-distance='4' max-elevation='40' disable-pan>"
                                       "</slf-field>")
            self.settled(page)
            camera = "one().viewer.camera"
            page.run(f"{camera}.zoom(1.2), {camera}.zoom(1.2), 0")
            self.assertEqual(page.run("one().view"), "30,20,4")
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

    def test_without_controls_only_the_picture_shows(self):
        field = self.cut_field("cut", "--lighting", "direct")
        words = {"views": [{"title": "A view", "orbit": [30, 20, 3]}],
                 "notes": [{"label": "A note", "point": [14, 6, 10]}]}
        with Host(self.site()) as host:
            shutil.copy(field, os.path.join(host.folder, "cut.slf"))
            with open(os.path.join(host.folder, "views.json"), "w") as file:
                json.dump(words, file)
            page = self.embedded(host, "<slf-field src='cut.slf' views='views.json' "
                                 "clip='16,16,17,0,0,1' controls='none'></slf-field>")
            self.settled(page)
            shown = """[...now('picture').parentNode.children].filter((it) =>
                (it.id === 'picture' || it.childNodes.length > 0) &&
                it.getBoundingClientRect().height > 1).map(({id}) => id).join()"""
            page.wait("now('planes').childNodes.length > 0 && now('notes').childNodes.length > 0")
            self.assertEqual(page.run(shown), "picture")
            page.run("one().controls = null, 0")
            self.assertLessEqual({"picture", "planes", "notes", "compass", "panel", "views"},
                                 set(page.run(shown).split(",")))
            # The cut is an attribute that may change.
            up, lower, pictures = "16,16,17,0,0,1", "16,16,10,0,0,1", []
            for planes in [[up], [lower], [lower, "16,16,16,1,0,0"], []]:
                page.run(f"one().setAttribute('clip', '{';'.join(planes)}'), 0" if planes else
                         "one().removeAttribute('clip'), 0")
                self.assertEqual(page.run("one().clip"), planes)
                page.wait(f"one().viewer.cut.planes.length === {len(planes)}")
                self.settled(page)
                pictures.append(page.run("now('picture').toDataURL()"))
            self.assertEqual(len(set(pictures)), 4)
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
        import {useEffect, useRef, useState} from 'react';
        import {renderToString} from 'react-dom/server.browser';
        import {hydrateRoot} from 'react-dom/client';
        function App() {
          const [given, give] = useState({view: '60,10,3', 'min-distance': 2});
          globalThis.give = give;
          const field = useRef(null);
          useEffect(() => field.current?.addEventListener('ready',
            () => { globalThis.heard = true; }));
          return given && <slf-field ref={field} src="field.slf" {...given}
                                     oncamera={() => { globalThis.moved = true; }}/>;
        }
        if (globalThis.document) hydrateRoot(document.querySelector('main'), <App/>);
        else {
          console.log(renderToString(<App/>));
          process.exit();  // since 19.3 a channel of React's keeps Node alive
        }"""
    VUE = """import 'slf-field';
        import {createSSRApp, h, ref} from 'vue';
        import {renderToString} from 'vue/server-renderer';
        const given = ref({view: '60,10,3', 'min-distance': 2});
        globalThis.give = (value) => { given.value = value; };
        const app = createSSRApp({render: () => given.value && h('slf-field', {
          src: 'field.slf', ...given.value, onReady() { globalThis.heard = true; },
          onCamera() { globalThis.moved = true; }})});
        if (globalThis.document) app.mount('main');
        else renderToString(app).then(console.log);"""
    REACT_TYPES = """import type {} from 'slf-field/react';
        import {SlfField} from 'slf-field';
        export const shown = <slf-field src="a.slf" autoRotate minDistance={2} tour="6"
          onprogress={({detail}) => detail.totalProgress.toFixed()}/>;
        document.querySelector('slf-field')!.addEventListener('camera', ({detail}) =>
          detail.view.trim());
        // @ts-expect-error
        export const wrong = <slf-field minDistance="near"/>;
        export const one: SlfField | null = null;"""
    VUE_TYPES = """<script setup lang="ts">
          import type {} from 'slf-field/vue';
        </script>
        <template>
          <slf-field src="a.slf" class="it" auto-rotate :min-distance="2" tour="6"
                     @progress="({detail}) => detail.totalProgress.toFixed()"/>
          <!-- @vue-expect-error -->
          <slf-field min-distance="near"/>
          <!-- @vue-expect-error -->
          <slf-field @camera="({detail}) => detail.nothing"/>
        </template>"""

    def test_the_element_in_react_and_vue(self):
        """Rendered on a server, hydrated in a browser, and changed there."""
        if not FULL:
            self.skipTest("npm takes minutes; scripts/check runs it")
        for program in ["npm", "node", "esbuild"]:
            if not shutil.which(program):
                self.skipTest(f"no {program}")
        site = self.site()
        for name, source, packages in [
                ("react18", self.REACT, ["react@18", "react-dom@18"]),
                ("react19", self.REACT, ["react@19", "react-dom@19", "@types/react@19",
                                         "typescript@5"]),
                ("vue3", self.VUE, ["vue@3", "vue-tsc@3", "typescript@5"])]:
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
                self.assertTrue(page.run("globalThis.heard"))
                page.run("give({view: '20,0,2.5', 'auto-rotate': ''}), 0")
                page.wait("one().view === '20,0,2.5' && one().autoRotate", 10)
                # React 18 knows no events of elements; 19 listens from the second rendering on.
                if name != "react18":
                    page.wait("globalThis.moved", 10)
                self.assertEqual(page.run("[one().minDistance, wrong]"), [1.02, []])
                page.run("""globalThis.until = async (holds) => {
                    while (!holds()) await new Promise(requestAnimationFrame);
                  };
                  globalThis.mount = async (i) => {
                    heard = false;
                    give({view: '60,10,3'});
                    await until(() => i % 3 ? heard : document.querySelector('slf-field'));
                    give(null);
                    await until(() => !document.querySelector('slf-field'));
                  };
                  (async () => { give(null); await until(() => !one()); })()""")
                self.leaves_what_ten_leave(page)
                page.close()
        for name, source, command in [
                ("react19/types.tsx", self.REACT_TYPES, ["tsc", "--jsx", "react-jsx", "types.tsx"]),
                ("vue3/types.vue", self.VUE_TYPES, ["vue-tsc"])]:
            folder = path(os.path.dirname(name))
            with open(path(name), "w") as file:
                file.write(source)
            settings = ["--noEmit", "--strict", "--module", "nodenext", "--target", "es2022"]
            if command == ["vue-tsc"]:  # takes no names of files
                with open(os.path.join(folder, "tsconfig.json"), "w") as file:
                    json.dump({"include": ["types.vue"]}, file)
            checked = subprocess.run(
                [os.path.join(folder, "node_modules/.bin", command[0]), *settings, *command[1:]],
                cwd=folder, capture_output=True, text=True)
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
                     '<meta name="twitter:card" content="summary_large_image">',
                     '<meta name="description" content="What &quot;it&quot; shows">']:
            self.assertIn(head, html)
        for url, image in [("https://example.org", "https://example.org/poster.jpg"),
                           ("https://example.org/a/b.html", "https://example.org/a/poster.jpg")]:
            slf("export", self.fields[0], "-o", folder, "-f", "--levels", "0", "--url", url)
            with open(os.path.join(folder, "index.html")) as file:
                self.assertIn(f'<meta property="og:image" content="{image}">', file.read())
        # One file has its picture in itself, where programs that show links do not look for it.
        one = path("about.html")
        slf("export", self.fields[0], "-o", one, "-f", "--levels", "0", "--views",
            path("about.json"), "--url", "https://example.org/brain.html")
        with open(one) as file:
            html = file.read()
        self.assertIn('<meta property="og:url" content="https://example.org/brain.html">', html)
        self.assertNotRegex(html, "og:image|twitter:")
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
                                  r".* lobe|stem, white|Default labels|labels.raw|field.slf|"
                                  r".* [KM]iB")
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

    AXE = """axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa']})
      .then(({violations}) => violations.map(({id, nodes}) =>
        [id, ...nodes.map(({target, failureSummary}) =>
          [target.flat().join(' '), failureSummary])]))"""

    SMALL = """[...slf.root.querySelectorAll('button, select, input, label')]
      .filter((e) => e.offsetParent && !e.closest('label label, .check input'))
      .filter((e) => !e.closest('label') || e.matches('label'))
      .map((e) => [e.id || e.textContent.trim(), e.getBoundingClientRect()])
      .filter(([, {width, height}]) => Math.min(width, height) < 43.5)
      .map(([name, {width, height}]) => `${name} ${width} ${height}`)"""

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
        panels = [("h", "settings"), ("l", "parts")]  # on a phone, the last one opened shows
        with self.explained(views, self.structured()) as server:
            for (width, height), dark in [((1280, 800), True), ((1280, 800), False),
                                          ((390, 844), True), ((390, 844), False)]:
                page = self.browser.open(server.url, width, height, dark=dark)
                page.settle()
                for key, panel in panels if dark else panels[::-1]:
                    if page.run(f"slf.root.getElementById('{panel}').hidden"):
                        self.press(page, key)
                page.run(script + "; 0")
                for button in ["cut", "about"]:
                    page.run(f"slf.root.getElementById('{button}').click(), 0")
                    page.wait("slf.root.getElementById('planes').childNodes.length > 0")
                    with self.subTest(width=width, dark=dark, button=button):
                        self.assertEqual(page.run(self.AXE, 120), [])
                        self.assertEqual(page.run(self.SMALL), [])
                page.close()


if __name__ == "__main__":
    main()
