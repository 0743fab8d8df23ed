#!/usr/bin/env python3
"""Measures what the page fetches from a static host, and how long that takes, in Chromium.

    benchmarks/view_over_http.py SLF FIELD.slf [--views N] [--json FILE]

SLF is build/release/cli/slf. The field is exported unchanged. Each view is opened cold, as the
first one of the exported page, in a headless Chromium, from hosts that serve several ranges in a
request and from hosts that serve one, without delay and as over a link of 10 Mbit/s and 40 ms. This
program simulates the host and the link (tests/page/host.py). "h2": nginx serves one range in a
request, over HTTP/2, without delay.

Columns: milliseconds from the beginning of the page until its poster shows; requests, dependent
round trips, bytes of the field and milliseconds until the first picture of tiles and until the view
is complete; bytes also relative to the payload of the view's tiles. Then the page loads the rest of
level 0: how many requests and bytes there are in all. The processor draws in place of a graphics
card (Mesa), and the times include that.

Then how fast the page's workers decode: tiles a second of a worker that decodes, and the share of
the time, from the first tile to the last, in which workers decode nothing.

At last, how long a picture of each view takes, as medians in milliseconds: in the page and with
`slf play`, both with all tiles decoded, and the whole command `slf render`, which opens the field,
decodes the tiles, draws and writes a picture. All have the same size, mode and level.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "page"))

from browser import Browser, BrowserError
from host import Host
from nginx import Nginx

VIEWS = [(30, 20, 3), (200, -35, 3), (110, 85, 3), (300, 5, 3), (75, 0, 3)]
SIZE = 512
FRAMES = 15
TIMED = """
self.work = {tiles: 0, busy: 0, first: 1e99, last: 0};
Object.defineProperty(self, 'onmessage', {set(answer) {
  self.addEventListener('message', (event) => {
    const begin = performance.timeOrigin + performance.now();
    answer(event);
    const end = performance.timeOrigin + performance.now();
    if (event.data.action !== 'decode') return;
    ++work.tiles;
    work.busy += end - begin;
    work.first = Math.min(work.first, begin);
    work.last = end;
  });
}})"""
# Runs before the page's own scripts.
POSTER = """document.addEventListener('load', ({target}) => {
  if (target.matches?.('[slot=poster] img'))
    requestAnimationFrame(() => { globalThis.poster ??= performance.now(); });
}, true)"""
DRAWN = """async (count) => {
  const times = [];
  while (slf.drawing) await new Promise((done) => setTimeout(done, 2));
  for (let i = 0; i < count; ++i) {
    const begin = performance.now();
    await slf.drawn(slf.renderer.draw({...slf.view(), stamp: undefined}, 1));
    slf.renderer.fade(1);
    times.push(performance.now() - begin);
  }
  return times;
}"""
LINKS = {"at once": (None, 0.0), "10 Mbit/s, 40 ms": (1.25e6, 0.04)}


class Workers:
    """The workers of a page that is about to be opened, each of which counts what it decodes."""

    def __init__(self, page):
        self.page, self.sessions = page, []
        page.browser.events.clear()  # of the workers of other pages
        page.call("Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True,
                  flatten=True)

    def wait(self, condition):
        """Waits for a condition in the page. Workers that start meanwhile begin to count."""
        browser, deadline = self.page.browser, time.monotonic() + 240
        while not self.page.run(condition):
            if time.monotonic() > deadline:
                raise BrowserError(f"not true: {condition}; {self.page.complaints()}")
            for event in browser.events:
                if event.get("method") != "Target.attachedToTarget":
                    continue
                session = event["params"]["sessionId"]
                if event["params"]["targetInfo"]["type"] == "worker" \
                        and session not in self.sessions:
                    self.sessions.append(session)
                    browser.call("Runtime.evaluate", session, expression=TIMED)
                    browser.call("Runtime.runIfWaitingForDebugger", session)
            time.sleep(0.02)

    def work(self):
        """(tiles a second, idle share)"""
        done = [self.page.browser.call("Runtime.evaluate", session, expression="self.work",
                                       returnByValue=True)["result"]["value"]
                for session in self.sessions]
        done = [work for work in done if work["tiles"] > 0]
        busy = sum(work["busy"] for work in done)
        whole = max(work["last"] for work in done) - min(work["first"] for work in done)
        return (1000 * sum(work["tiles"] for work in done) / busy,
                1 - busy / (len(self.sessions) * whole))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slf")
    parser.add_argument("field")
    parser.add_argument("--views", type=int, default=len(VIEWS))
    parser.add_argument("--json", help="also write the figures to this file")
    arguments = parser.parse_args()

    def slf(*words):
        return subprocess.run([arguments.slf, "-q", *words], check=True, capture_output=True,
                              text=True).stdout

    rows, frames = [], {}  # frames: milliseconds of the page's pictures, by view
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        def export(view):
            views = os.path.join(folder, "views")
            with open(views, "w") as file:
                json.dump({"views": [{"title": "First", "orbit": view}]}, file)
            slf("export", arguments.field, "-o", folder, "-f", "--views", views)

        export(VIEWS[0])
        field = os.path.join(folder, "field.slf")
        level = json.loads(slf("info", field, "--json"))["levels"][-1]["level"]
        print(f"{platform.node()}: {os.cpu_count()} cores; {os.path.getsize(field)} bytes of field")
        print(f"{'ranges':6} {'link':17} {'view':10} | poster | first: req trips   bytes   ms "
              f"| complete: req trips   bytes ratio    ms | all: req   bytes", flush=True)
        for view in VIEWS[:arguments.views]:
            text = ",".join(map(str, view))
            export(view)
            drawn = slf("render", field, "-o", os.path.join(folder, "view.png"), "-f", "--orbit",
                        text, "--size", str(SIZE), "--level", str(level), "--stats", "--json")
            payload = json.loads(drawn)["compressed_bytes"]
            for ranges in ["many", "one"] + ["h2"] * Nginx.available():
                for link, (rate, delay) in LINKS.items():
                    if ranges == "h2" and rate:
                        continue
                    with (Nginx(folder) if ranges == "h2" else
                          Host(folder, ranges, rate, delay)) as host:
                        page = browser.open("about:blank", SIZE, SIZE)
                        page.call("Security.setIgnoreCertificateErrors", ignore=True)
                        page.call("Page.addScriptToEvaluateOnNewDocument", source=POSTER)
                        page.call("Page.navigate", url=f"{host.url}/index.html#level={level}")
                        page.settle()
                        page.wait("!slf.statistics().busy")
                        found, poster = page.run("[slf.statistics(), globalThis.poster]")
                        if (ranges, rate) == ("many", None):
                            frames[text] = page.run(f"({DRAWN})({FRAMES})")
                        page.close()
                        first, complete = found["first"], found["complete"]
                        row = {"ranges": ranges, "link": link, "view": view, "payload": payload,
                               "poster": poster, "first": first, "complete": complete,
                               "requests": len(host.answers("field.slf")),
                               "bytes": host.bytes("field.slf")}
                    rows.append(row)
                    print(f"{ranges:6} {link:17} {text:10} | {poster:6.0f} "
                          f"| {first['requests']:10} {first['roundTrips']:5} "
                          f"{first['bytes']:7} {first['milliseconds']:4.0f} "
                          f"| {complete['requests']:13} {complete['roundTrips']:5} "
                          f"{complete['bytes']:7} {complete['bytes'] / payload:5.2f} "
                          f"{complete['milliseconds']:5.0f} | {row['requests']:8} "
                          f"{row['bytes']:7}", flush=True)
        print("view       link              | workers: tiles a second   idle")
        for view in VIEWS[:arguments.views]:
            text = ",".join(map(str, view))
            export(view)
            for link, (rate, delay) in LINKS.items():
                with Host(folder, "many", rate, delay) as host:
                    page = browser.open("about:blank", SIZE, SIZE)
                    workers = Workers(page)
                    page.call("Page.navigate", url=f"{host.url}/index.html#level={level}")
                    workers.wait("self.slf?.statistics().complete && !slf.statistics().busy")
                    speed, idle = workers.work()
                    page.close()
                rows.append({"view": view, "link": link, "tiles_per_second": speed, "idle": idle})
                print(f"{text:10} {link:17} | {speed:23.0f} {idle:6.0%}", flush=True)
        print("picture of   page, software GL   slf play | slf render: processor   wall")
        for text, times in frames.items():
            view = ["--orbit", text, "--size", f"{SIZE}x{SIZE}", "--mode", "depth", "--level",
                    str(level)]
            played = json.loads(slf("play", field, *view, "--turns", "0", "--seconds",
                                    str(FRAMES / 30), "--loading", "wait", "--json"))
            native = [frame["ms"] for frame in played["runs"][0]["frames"]]
            picture = os.path.join(folder, "picture.png")
            processor, wall = zip(*(timed(lambda: slf("render", field, *view, "-o", picture, "-f"))
                                    for _ in range(5)))
            row = {"picture": text, "page_ms": statistics.median(times),
                   "play_ms": statistics.median(native),
                   "render_processor_ms": statistics.median(processor),
                   "render_wall_ms": statistics.median(wall)}
            rows.append(row)
            print(f"{text:10} {row['page_ms']:19.0f} {row['play_ms']:10.1f} | "
                  f"{row['render_processor_ms']:21.0f} {row['render_wall_ms']:6.0f}", flush=True)
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(rows, file, indent=1)


def timed(command):
    """The milliseconds that a command takes: of the processor, and in all."""
    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before, begin = used(), time.monotonic()
    command()
    return 1000 * (used() - before), 1000 * (time.monotonic() - begin)


if __name__ == "__main__":
    main()
