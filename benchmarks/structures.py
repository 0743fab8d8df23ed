#!/usr/bin/env python3
"""Structures of a label volume in one field, drawn together, beside fields of single sets.

  benchmarks/structures.py --slf build/release/cli/slf [--labels VOLUME] [-o out/structures]

Builds a field of six structures, groups of labels, with --each-label; and for each of four sets of
visible structures one field that shows that set alone, with --only-labels. Prints, for each set,
the PSNR of both against ray-casting the volume with the same labels, the bytes that the structures
have in the file, those of the single field, and the time of a view. Then draws structures.jpg, a
sheet of the sets. Fields in the folder are not built again. Needs ImageMagick's montage.
"""

import argparse
import gzip
import json
import pathlib
import struct
import subprocess
import time

FONT = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf"
ROOT = pathlib.Path(__file__).resolve().parents[1]
# Labels of the Allen Human Reference Atlas 3D, named by where they lie.
STRUCTURES = {
    "white matter": ([51], (0.93, 0.9, 0.82)),
    "cerebellum": ([120, 121], (0.9, 0.6, 0.35)),
    "frontal": ([66, 67, 68, 138], (0.45, 0.65, 0.9)),
    "temporal": ([84, 85, 86], (0.55, 0.8, 0.45)),
    "occipital": ([81, 93, 94, 96, 97], (0.85, 0.4, 0.45)),
    "parietal": ([78, 79, 80, 82], (0.7, 0.5, 0.85)),
}
SETS = {
    "all": list(STRUCTURES),
    "without white matter": [name for name in STRUCTURES if name != "white matter"],
    "white matter and cerebellum": ["white matter", "cerebellum"],
    "frontal, temporal, cerebellum": ["frontal", "temporal", "cerebellum"],
}


def ids_in(volume):
    """The ids of a NIfTI file of bytes."""
    data = gzip.open(volume).read()
    return sorted(set(data[int(struct.unpack_from("<f", data, 108)[0]):]))


class Bench:
    def __init__(self, arguments):
        self.slf, self.volume = arguments.slf, arguments.labels
        self.folder = pathlib.Path(arguments.output)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.settings = arguments.build.split()
        self.views = ["--views", arguments.views, "--size", arguments.size]
        self.ids = ids_in(self.volume)

    def run(self, *arguments):
        done = subprocess.run([self.slf, "-q", *map(str, arguments)], check=True,
                              stdout=subprocess.PIPE, text=True)
        return json.loads(done.stdout) if done.stdout.startswith("{") else done.stdout

    def source(self, names=()):
        """The options that read the structures, or only some."""
        table = self.folder / "names.json"
        named = {i: {"id": i, "name": name, "color": color}
                 for name, (ids, color) in STRUCTURES.items() for i in ids}
        labels = [named.get(i, {"id": i, "opacity": 0}) for i in self.ids]
        table.write_text(json.dumps({"labels": labels}))
        shown = ",".join(str(i) for name in names for i in STRUCTURES[name][0])
        return ["--labels", "--label-table", table] + (["--only-labels", shown] if names else [])

    def build(self, title, *options):
        path = self.folder / f"{title.replace(' ', '_')}.slf"
        if not path.exists():
            self.run("build", self.volume, "-o", path, *options, *self.settings)
        return path

    def evaluate(self, names, field, *structures):
        return self.run("evaluate", field, *structures, "--volume", self.volume,
                        *self.source(names), *self.views, "--json")["psnr"]

    def payloads(self, field, state):
        return self.run("info", field, "--state", state, "--json")["payload_bytes"] / (1 << 20)

    def seconds(self, field, *structures):
        """The least time of three views of 512², with all that the command does."""
        times = []
        for _ in range(3):
            began = time.monotonic()
            self.run("render", field, *structures, "-f", "-o", self.folder / "view.png")
            times.append(time.monotonic() - began)
        return min(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slf", required=True)
    parser.add_argument("-o", "--output", default="out/structures")
    parser.add_argument("--labels", default=ROOT.parent /
                        "shared/data/allen_brain_labels/AllenAtlas.nii.gz")
    parser.add_argument("--build", default="--lighting direct --levels 1", help="of slf build")
    parser.add_argument("--views", default="8")
    parser.add_argument("--size", default="256")
    bench = Bench(parser.parse_args())

    field = bench.build("structures", *bench.source(), "--each-label")
    mib = {name: bench.payloads(field, name) for name in STRUCTURES}
    for name, size in mib.items():
        print(f"{name:30} {size:7.2f} MiB")
    print(f"{'set':30} {'composed':>9} {'single':>9} {'MiB':>7} {'single':>7} {'s':>6} "
          f"{'single':>6}")
    sheet = []

    def draw(title, *structures):
        picture = bench.folder / f"{title.replace(' ', '_')}.png"
        bench.run("render", field, *structures, "-f", "-o", picture, "--orbit", "60,25,2.6")
        sheet.extend(["-label", title, str(picture)])

    for title, names in SETS.items():
        single = bench.build(title, *bench.source(names))
        structures = [text for name in names for text in ("--structure", name)]
        print(f"{title:30} {bench.evaluate(names, field, *structures):6.2f} dB "
              f"{bench.evaluate(names, single):6.2f} dB {sum(mib[name] for name in names):7.2f} "
              f"{bench.payloads(single, '0'):7.2f} {bench.seconds(field, *structures):6.2f} "
              f"{bench.seconds(single):6.2f}", flush=True)
        draw(title, *structures)
    draw("white matter, others at 0.3", "--structure", "*:0.3", "--structure", "white matter")
    draw("tinted", "--structure", "*:#ffe0c0", "--structure", "temporal:0.4:#ff4040")
    subprocess.run(["montage", "-font", FONT, *sheet, "-tile", "3x", "-geometry", "320x320+4+4",
                    "-background", "black", "-fill", "white", "-quality", "90",
                    bench.folder / "structures.jpg"], check=True)


if __name__ == "__main__":
    main()
