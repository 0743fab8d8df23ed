#!/usr/bin/env python3
"""What cuts cost in the page, in Chromium without a graphics card.

    benchmarks/cut_in_page.py SLF FIELD.slf [--size 512]

The field has a reveal; the plane goes through the middle of its sphere. Prints frames a second and
their share of the window's pixels, while the camera turns, whole and cut, and while the plane
moves; milliseconds from a new plane to its coarse light and to its fine light; and the PSNR of the
page's picture to `slf render`: under the guessed light that it has while a plane moves, then under
the light of a view at rest.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "page"))

from browser import Browser

# Changes something in each frame for three seconds: frames a second, their mean share of pixels.
MOVES = """(async (change) => {
  const shown = [], begin = performance.now();
  let last = slf.scaled;
  for (let k = 0; performance.now() - begin < 3000; ++k) {
    change(k);
    await new Promise(requestAnimationFrame);
    if (slf.scaled !== last) shown.push((last = slf.scaled).scale ** 2);
  }
  return [shown.length / 3, shown.reduce((a, b) => a + b, 0) / shown.length];
})(%s)"""
TURN = "() => { slf.camera.turn(1, 0); slf.moved(); }"
PLANE = "(k) => { slf.root.host.clip = plane(0.1 * Math.sin(k / 10)); }"
FIRST = """globalThis.plane = (way) => `%s`.replace('WAY', %s + way * %s); 0"""
# From a new plane to its light.
LIGHT = """(async () => {
  const begin = performance.now(), times = [];
  slf.root.host.clip = plane(0.2);
  for (const fine of [false, true]) {
    while (slf.cut.light?.clip !== slf.root.host.clip.join(';') || slf.cut.light.fine !== fine)
      await new Promise((done) => setTimeout(done, 10));
    times.push(performance.now() - begin);
  }
  return times;
})()"""


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("slf")
    parser.add_argument("field")
    parser.add_argument("--size", type=int, default=512)
    options = parser.parse_args()

    def slf(*arguments):
        return subprocess.run([options.slf, "-q", *map(str, arguments)], check=True, text=True,
                              stdout=subprocess.PIPE).stdout

    info = json.loads(slf("info", options.field, "--json"))
    x, y, z = info["sphere"]["center"]
    server = subprocess.Popen([options.slf, "-q", "view", options.field], stdout=subprocess.PIPE,
                              text=True)
    view = f"{server.stdout.readline().strip()}#level={len(info['levels']) - 1}&view=30,40,3"
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        page = browser.open(view, options.size, options.size)
        page.settle()
        page.run(FIRST % (f"{x},{y},WAY,0,0,1", z, info["sphere"]["radius"]))
        rows = {"turning, whole": page.run(MOVES % TURN, 60)}
        page.run("slf.root.host.clip = plane(0), 0")
        page.settle()
        rows["turning, cut"] = page.run(MOVES % TURN, 60)
        rows["moving the plane"] = page.run(MOVES % PLANE, 60)
        for name, (rate, share) in rows.items():
            print(f"{name:18} {rate:5.1f} frames a second, {share:4.0%} of the pixels", flush=True)
        page.run("slf.camera.fromText('30,40,3'), slf.moved(), 0")
        page.settle()
        coarse, fine = page.run(LIGHT, 300)
        print(f"light of a new plane: coarse after {coarse:.0f} ms, fine after {fine:.0f} ms")
        page.settle()

        def psnr():
            page.canvas(os.path.join(folder, "page.png"))
            return json.loads(slf("compare", os.path.join(folder, "page.png"), truth,
                                  "--json"))["psnr"]

        truth = os.path.join(folder, "truth.png")
        clip = f"{x},{y},{z + 0.2 * info['sphere']['radius']},0,0,1"
        slf("render", options.field, "-o", truth, "--orbit", "30,40,3", "--size", options.size,
            "--clip", clip)
        lit = psnr()
        page.run("slf.cut.lightUp = async () => {}, slf.cut.light = undefined, slf.changed(), 0")
        page.settle()
        print(f"to slf render: {psnr():.1f} dB under the guessed light, {lit:.1f} dB at rest")
    server.terminate()
    server.wait()


if __name__ == "__main__":
    main()
