#!/usr/bin/env python3
"""Structures of a label volume, each a field of its own, drawn together, beside single fields.

  benchmarks/structures.py --slf build/release/cli/slf [--labels AllenAtlas.nii.gz] [-o out/structures]

Builds a field of each of six structures, groups of labels, on one sphere; and for each of four sets
of visible structures one field that shows that set alone. Prints, for each set, the PSNR of both
against ray-casting the volume with the other labels hidden, the bytes of the files, and the time of
a view. Then draws structures.jpg, a sheet of the sets. Fields in the folder are not built again.
Needs ImageMagick's montage for the sheet.
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
# Of the Allen Human Reference Atlas 3D.
STRUCTURES = {
    "white matter": ([51], (0.93, 0.9, 0.82)),
    "cerebellum": ([120, 121], (0.9, 0.6, 0.35)),
    "parietal": ([64, 66, 67, 68], (0.45, 0.65, 0.9)),
    "temporal": ([80, 84, 85, 86], (0.55, 0.8, 0.45)),
    "frontal": ([81, 82, 93, 94, 96, 97], (0.85, 0.4, 0.45)),
    "occipital": ([78, 79, 138], (0.7, 0.5, 0.85)),
}
SETS = {
    "all": list(STRUCTURES),
    "without white matter": [name for name in STRUCTURES if name != "white matter"],
    "white matter and cerebellum": ["white matter", "cerebellum"],
    "parietal, temporal, frontal": ["parietal", "temporal", "frontal"],
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
        self.sphere = []

    def run(self, *arguments):
        done = subprocess.run([self.slf, "-q", *map(str, arguments)], check=True,
                              stdout=subprocess.PIPE, text=True)
        return json.loads(done.stdout) if done.stdout.startswith("{") else done.stdout

    def source(self, names):
        """The options that read the volume with these structures alone."""
        path = self.folder / f"{'+'.join(names).replace(' ', '_')}.json"
        shown = {i: STRUCTURES[name][1] for name in names for i in STRUCTURES[name][0]}
        function = {"Name": "structures", "ColorSpace": "Step", "RGBPoints": [], "Points": [],
                    "ScalarOpacityUnitDistance": 1}
        for i in self.ids:
            function["RGBPoints"] += [i, *shown.get(i, (0, 0, 0))]
            function["Points"] += [i, 1 if i in shown else 0, 0.5, 0]
        path.write_text(json.dumps([function]))
        return ["--labels", "--transfer", path]

    def build(self, names):
        path = self.folder / f"{'+'.join(names).replace(' ', '_')}.slf"
        if not path.exists():
            self.run("build", self.volume, "-o", path, *self.source(names), *self.settings,
                     *self.sphere)
        if not self.sphere:
            sphere = self.run("info", path, "--json")["sphere"]
            self.sphere = ["--radius", sphere["radius"],
                           "--center=" + ",".join(map(str, sphere["center"]))]
        return path

    def evaluate(self, names, field, *structures):
        found = self.run("evaluate", field, *structures, "--volume", self.volume,
                         *self.source(names), *self.views, "--json")
        return found["psnr"]

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
    parser.add_argument("--build", default="--lighting direct --levels 2", help="of slf build")
    parser.add_argument("--views", default="8")
    parser.add_argument("--size", default="256")
    bench = Bench(parser.parse_args())

    whole = bench.build(SETS["all"])
    parts = {name: bench.build([name]) for name in STRUCTURES}
    mib = lambda paths: sum(path.stat().st_size for path in paths) / (1 << 20)
    print(f"structures: {mib(parts.values()):.1f} MiB, "
          f"{mib(parts.values()) / mib([whole]):.2f} of one field of all")
    print(f"{'set':30} {'composed':>9} {'single':>9} {'MiB':>7} {'single':>7} {'s':>6} {'single':>6}")
    sheet = []
    for title, names in SETS.items():
        single = bench.build(names)
        structures = [text for name in names for text in ("--structure", parts[name])]
        print(f"{title:30} {bench.evaluate(names, whole, *structures):6.2f} dB "
              f"{bench.evaluate(names, single):6.2f} dB {mib(parts[name] for name in names):7.1f} "
              f"{mib([single]):7.1f} {bench.seconds(whole, *structures):6.2f} "
              f"{bench.seconds(single):6.2f}", flush=True)
        picture = bench.folder / f"{title.replace(' ', '_')}.png"
        bench.run("render", whole, *structures, "-f", "-o", picture, "--orbit", "60,25,2.6")
        sheet += ["-label", title, str(picture)]
    picture = bench.folder / "faded.png"
    structures = [text for name, path in parts.items() for text in
                  ("--structure", f"{path}:{1 if name == 'white matter' else 0.3}")]
    bench.run("render", whole, *structures, "-f", "-o", picture, "--orbit", "60,25,2.6")
    sheet += ["-label", "white matter, others at 0.3", str(picture)]
    subprocess.run(["montage", "-font", FONT, *sheet, "-tile", "3x", "-geometry", "+4+4", "-background", "black",
                    "-fill", "white", "-quality", "90", bench.folder / "structures.jpg"], check=True)


if __name__ == "__main__":
    main()
