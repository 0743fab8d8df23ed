#!/usr/bin/env python3
"""Measures how soon the studio of `slf view` shows what is asked of it, in Chromium.

    benchmarks/studio.py SLF VOLUME... [--repeat 3] [--json FILE]

SLF is build/release/cli/slf. The picture has 768x768 pixels. All numbers are medians of the runs:

    first       ms from the opening of the page, after the volume is read, to a picture
    light       ms from there to the first picture under global light
    motion      pictures a second while the camera turns for 3 s, and the median width of them
    point       ms from a point of the curve being dragged to a picture under that curve
    rest        ms from the last movement of a point, which makes new light, to a picture of the
                window's size (100 of them pass before it counts as rest)
    turn        the same of the camera, when light is complete
    equal       whether the last picture has the bytes of `slf raycast` of the saved recipe
    peak        MiB of the server's memory at most

The processor does all of it: it draws, and the browser decodes on it.
"""

import argparse
import http.client
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.parse

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "page"))

from browser import Browser, BrowserError

SIDE = 768
PANEL = 320
LAST = ("studio.shown.stage === 5 && studio.shown.serial === studio.serial && !studio.sending &&"
        " performance.now() - studio.pictures.at(-1).at > 500")
# Drags the point of the curve that is nearest to the middle, once a frame, `steps` times.
DRAG = """(async (steps) => {
  const canvas = document.getElementById('curve'), box = canvas.getBoundingClientRect();
  const rows = [...document.querySelectorAll('#points > div')].map((row) =>
    [...row.querySelectorAll('[type=number]')].map((input) => Number(input.value)));
  const [low, high] = [...document.querySelectorAll('#ends span')].map(
    (end) => Number(end.textContent));
  const [value, opacity] = rows[rows.length >> 1];
  const x = box.left + (value - low) / (high - low) * box.width;
  const y = box.top + (1 - opacity) * box.height, took = [];
  const point = (type, dx) => canvas.dispatchEvent(new PointerEvent(type, {
    clientX: x + dx, clientY: y, pointerId: 1, bubbles: true}));
  canvas.setPointerCapture = () => {};
  point('pointerdown', 0);
  let begin;
  for (let k = 1; k <= steps; ++k) {
    const before = studio.pictures.at(-1).revision;
    begin = performance.now();
    point('pointermove', (k & 1 ? 1 : -1) * (4 + k / 4));
    while (!(studio.pictures.at(-1).revision > before))
      await new Promise((go) => setTimeout(go, 1));
    took.push(studio.pictures.at(-1).at - begin);
  }
  const count = studio.pictures.length;
  point('pointerup', 0);
  begin = performance.now();
  while (!studio.pictures.slice(count).some((one) => one.stage >= 2))
    await new Promise((go) => setTimeout(go, 1));
  return [took, studio.pictures.slice(count).find((one) => one.stage >= 2).at - begin];
})"""
TURN = """(async (seconds) => {
  const picture = document.getElementById('picture'), from = studio.pictures.length;
  const key = () => picture.dispatchEvent(
    new KeyboardEvent('keydown', {key: 'ArrowLeft', bubbles: true}));
  const begin = performance.now();
  let last;
  while ((last = performance.now()) - begin < 1000 * seconds) {
    key();
    await new Promise((go) => setTimeout(go, 16));
  }
  const moving = studio.pictures.slice(from).filter((one) => one.moving && one.at <= last);
  const count = studio.pictures.length;
  const rest = () => studio.pictures.slice(count).find((one) => !one.moving);
  while (!rest()) await new Promise((go) => setTimeout(go, 1));
  return [moving.length / seconds, moving.map((one) => one.width), rest().at - last];
})"""


def ask(url, what, body):
    address = urllib.parse.urlsplit(url)
    connection = http.client.HTTPConnection(address.netloc)
    connection.request("POST", address.path + what, json.dumps(body))
    answer = connection.getresponse()
    got = answer.read()
    connection.close()
    return answer, got


def equal(slf, url, folder):
    """Whether the last picture of the server has the bytes of the command's."""
    saved = json.loads(ask(url, "save", {})[1])["save"]
    look = {"page": 1, "serial": 1, "size": [SIDE, SIDE], "orbit": [30, 20, 3, 0, 0, 0], "seen": 4}
    address = urllib.parse.urlsplit(url)
    connection = http.client.HTTPConnection(address.netloc)
    connection.request("GET", address.path + "state")
    look["revision"] = json.loads(connection.getresponse().read())["revision"]
    connection.close()
    picture = ask(url, "look", look)[1]
    cast = os.path.join(folder, "cast.png")
    subprocess.run([slf, "-q", "raycast", saved, "-o", cast, "--size", f"{SIDE}x{SIDE}", "--orbit",
                    "30,20,3"], check=True, cwd=folder)
    with open(cast, "rb") as file:
        return file.read() == picture


def measure(slf, volume, browser):
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen([slf, "-q", "view", os.path.abspath(volume), "-o", "out.slf"],
                                   stdout=subprocess.PIPE, text=True, cwd=folder)
        try:
            url = process.stdout.readline().strip() + "studio/"
            page = browser.open(url, SIDE + PANEL, SIDE)
            page.wait(f"globalThis.studio && {LAST}", 600)
            first = page.run("studio.pictures[0].at")
            light = page.run("studio.pictures.find((one) => one.stage >= 3).at")
            time.sleep(3)  # light is completed
            rate, widths, turn = page.run(f"{TURN}(3)")
            page.wait(LAST, 600)
            points, rest = page.run(f"{DRAG}(20)", 600)
            page.wait(LAST, 600)
            page.close()
            same = equal(slf, url, folder)
            with open(f"/proc/{process.pid}/status") as file:
                peak = next(int(line.split()[1]) for line in file if line.startswith("VmHWM"))
        finally:
            process.terminate()
            process.wait()
    return {"first": first, "light": light, "motion": rate, "width": statistics.median(widths),
            "point": statistics.median(points), "rest": rest, "turn": turn, "equal": same,
            "peak": peak / 1024}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("slf")
    parser.add_argument("volumes", nargs="+")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json")
    options = parser.parse_args()
    options.slf = os.path.abspath(options.slf)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{'':24}{'first':>7}{'light':>7}{'motion':>8}{'width':>7}{'point':>7}{'rest':>6}"
          f"{'turn':>6}{'equal':>7}{'peak':>7}")
    results = {}
    try:
        with Browser() as browser:
            for volume in options.volumes:
                runs = [measure(options.slf, volume, browser) for _ in range(options.repeat)]
                all_of = {name: statistics.median(run[name] for run in runs) for name in runs[0]}
                all_of["equal"] = all(run["equal"] for run in runs)
                name = os.path.basename(volume).split(".")[0][:22]
                results[name] = {"median": all_of, "runs": runs}
                print(f"{name:24}{all_of['first']:7.0f}{all_of['light']:7.0f}"
                      f"{all_of['motion']:8.1f}{all_of['width']:7.0f}{all_of['point']:7.0f}"
                      f"{all_of['rest']:6.0f}{all_of['turn']:6.0f}{str(all_of['equal']):>7}"
                      f"{all_of['peak']:7.0f}", flush=True)
    except BrowserError as error:
        sys.exit(f"studio.py: {error}")
    print(f"load at the end {os.getloadavg()[0]:.1f}")
    if options.json:
        with open(options.json, "w") as file:
            json.dump(results, file, indent=2)


if __name__ == "__main__":
    main()
