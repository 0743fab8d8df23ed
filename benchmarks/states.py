#!/usr/bin/env python3
"""States of one object: a field of all beside a field of each.

  benchmarks/states.py VOLUME [--slf build/release/cli/slf] [--folder states-benchmark] [OPTIONS]

The states are a volume, and the same cut open by planes ever further down: `--states N` in all.
With `--one-light`, they have the light of the first. With `--times`, they are the time points of a
4-D volume. For each state it prints the bytes that it adds to the field of all, the bytes of a
field of its own, what share of tiles it has in common with earlier states, and the PSNR of views of
both fields to ray-casting, the latter under its own light. Then the sums: all states in one
field; a field for each; the same if equal tiles were stored once, but nothing were predicted from
other states. Options after `--` are those of `slf build`, as `-- --levels 1 --lighting direct`.

With `--film CRF...`, a film (AV1, by ffmpeg) of the same rays: their colours at the finest level,
one picture for each entry vertex, and each entry vertex in all states before the next one. Opacity
and depth cost the film nothing. Its views are drawn from fields with its colours. Needs numpy, and
`entry_pictures` beside `slf`, as in build/bench. Beside it `--quality Q...`: the field of all,
`predictive:Q`.

With `--new-rays`, what cuts lay open: the bytes of fields of their own, by the share of each tile's
visible rays that equal those of no earlier state. Needs numpy, and the module `slf`.

With `--memory`, it only builds, and prints the peak memory and the time of all states in one build,
and of the first alone; with `--labels`, too, those of each structure of a label volume, and of all
as one.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time
import types


class Benchmark:
    def __init__(self, options):
        self.options = options
        self.folder = self.work = pathlib.Path(options.folder)
        self.folder.mkdir(parents=True, exist_ok=True)

    def run(self, program, *arguments):
        if program == "entry_pictures":
            program = pathlib.Path(self.options.slf).parents[1] / "benchmarks" / program
        done = subprocess.run([program, *map(str, arguments)], text=True, capture_output=True,
                              check=False)
        if done.returncode != 0:
            sys.exit(f"{program} {' '.join(map(str, arguments))}: {done.stderr}")
        return done.stdout

    def slf(self, *arguments):
        return self.run(self.options.slf, "-q", *arguments)

    def json(self, *command):
        return json.loads(self.run(*command))

    def say(self, text):
        print(text, file=sys.stderr, flush=True)

    def states(self):
        """The members of each state."""
        volume, count = self.options.volume, self.options.states
        if self.options.times:
            return [{"name": f"time {t}", "time": t} for t in range(count)]
        info = json.loads(self.slf("info", volume, "--json"))
        low = info["origin"][2]
        high = low + sum(axis * (side - 1) for axis, side in
                         zip([a[2] for a in info["axes"]], info["dims"]))
        cuts = [max(low, high) - abs(high - low) * self.options.depth * k / (count - 1)
                for k in range(1, count)]
        shared = {"light-from": "whole"} if self.options.one_light else {}
        return [{"name": "whole"}] + [{"name": f"cut at {z:.4g}", "clip": [[0, 0, z, 0, 0, 1]],
                                       **shared} for z in cuts]

    def tiles(self, field, *state):
        return {tile["tile"]: tile for tile in json.loads(self.slf("ls", field, "--json", *state))}

    def psnr(self, field, state, *shown):
        source = ["--time", state["time"]] if "time" in state else []
        found = json.loads(self.slf("evaluate", field, "--volume", self.options.volume, *source,
                                   "--views", self.options.views, "--size", 256, "--json",
                                   *shown))["psnr"]
        return float("inf") if found is None else found

    def memory(self):
        file = self.folder / "states.json"
        if self.options.labels:
            builds = [("each structure", ["--labels", "--each-label"]),
                      ("all as one", ["--labels"])]
        else:
            file.write_text(json.dumps({"states": self.states()}))
            builds = [("all states", ["--states", file]), ("the first alone", [])]
        for name, options in builds:
            begin = time.monotonic()
            build = subprocess.Popen([self.options.slf, "-q", "build", self.options.volume, "-f",
                                      "-o", self.folder / "memory.slf", *options,
                                      *self.options.build])
            _, status, usage = os.wait4(build.pid, 0)
            if status != 0:
                sys.exit(f"{name}: the build failed")
            print(f"{name:16} {usage.ru_maxrss / 1024:6.0f} MiB {time.monotonic() - begin:7.1f} s",
                  flush=True)

    def new_rays(self, states, file, own):
        """The bytes of rays that no earlier state has, if they take those of their tiles."""
        import numpy
        import slf

        exact, total = self.folder / "exact.slf", 0
        self.slf("build", self.options.volume, "--states", file, "-o", exact, "-f",
                 *self.options.build, "--codec", "zstd")
        fields = [slf.open(exact, state=number) for number in range(len(states))]
        for number in range(1, len(states)):
            for name, tile in own[number].items():
                if tile["payload_bytes"] == 0:
                    continue
                level, entry, exit = tile["level"], tile["entry"], tile["exit"]
                color, depth = ([field.tile(level, entry, exit, channel) for field in
                                 fields[:number + 1]] for channel in ("color", "depth"))
                visible = color[-1][..., 3] > 0
                new = visible.copy()
                for rgba, deep in zip(color[:-1], depth[:-1]):
                    new &= (rgba != color[-1]).any(axis=-1) | (deep != depth[-1])
                total += tile["payload_bytes"] * new.sum() / max(visible.sum(), 1)
        return total

    def encoded(self, states, file):
        """What encodes the rays of all states again, its bytes, and the PSNR of views of each."""
        if not self.options.quality and not self.options.film:
            return
        import numpy
        from report import peers

        self.slf("build", self.options.volume, "--states", file, "-o", self.folder / "exact.slf",
                 *self.options.build, "--codec", "zstd")
        for quality in self.options.quality:
            path = self.folder / "encoded.slf"
            self.slf("repack", self.folder / "exact.slf", "-o", path, "-f", "--codec",
                     f"predictive:{quality}")
            size = sum(level["payload_bytes"]
                       for level in json.loads(self.slf("info", path, "--json"))["levels"])
            yield f"predictive:{quality}", size, [self.psnr(path, state, "--state", number)
                                                  for number, state in enumerate(states)]
        if not self.options.film:
            return
        exact, pictures = [], []
        for number in range(len(states)):
            exact.append(self.folder / f"exact-{number}.slf")
            self.slf("repack", self.folder / "exact.slf", "--states", number, "-o", exact[-1])
            pictures.append(peers.Pictures(self, exact[-1], f"state-{number}"))
        film = numpy.stack([state.data for state in pictures], axis=1)
        film[1::2] = film[1::2, ::-1]  # there and back
        _, _, edge, _, _ = film.shape
        truth = types.SimpleNamespace(path=self.folder / "film-truth.rgb", edge=edge,
                                      count=film.shape[0] * film.shape[1])
        film.tofile(truth.path)
        for crf in self.options.film:
            size, back = peers.film(self, truth, "AV1", crf)
            back = back.reshape(film.shape)
            back[1::2] = back[1::2, ::-1].copy()
            psnr = [self.psnr(peers.recolored(self, exact[number], back[:, number], "recolored"),
                              state) for number, state in enumerate(states)]
            yield f"film, AV1, crf {crf}", size, psnr

    def compare(self):
        states = self.states()
        build = self.options.build
        file = self.folder / "states.json"
        file.write_text(json.dumps({"states": states}))
        whole = self.folder / ("one-light.slf" if self.options.one_light else "all.slf")
        self.slf("build", self.options.volume, "--states", file, "-o", whole, *build)
        sphere = json.loads(self.slf("info", whole, "--json"))["sphere"]
        place = ["--center", ",".join(map(str, sphere["center"])), "--radius", sphere["radius"]]
        added, alone, shared, found, owns = [], [], [], [], []
        print("state           added    own field  share  same tiles   PSNR  own field")
        for number, state in enumerate(states):
            own_file = self.folder / f"own-{number}.slf"
            one = self.folder / "one.json"
            alone_state = {key: state[key] for key in state if key != "light-from"}
            one.write_text(json.dumps({"states": [alone_state]}))
            self.slf("build", self.options.volume, "--states", one, "-o", own_file, *place, *build)
            tiles, own = self.tiles(whole, "--state", number), self.tiles(own_file)
            owns.append(own)
            new = [name for name, tile in tiles.items() if tile["state"] == "stored"]
            stored = [name for name, tile in tiles.items() if tile["state"] != "empty"]
            added.append(sum(tiles[name]["payload_bytes"] for name in new))
            alone.append(sum(tile["payload_bytes"] for tile in own.values()))
            shared.append(sum(own[name]["payload_bytes"] for name in new))
            quality = [self.psnr(whole, state, "--state", number), self.psnr(own_file, state)]
            found.append(quality[0])
            print(f"{state['name']:14} {added[-1]:9} {alone[-1]:11}   {added[-1] / alone[-1]:.3f}  "
                  f"{1 - len(new) / len(stored):10.3f}  {quality[0]:6.2f}  {quality[1]:6.2f}",
                  flush=True)
        rows = [("all in one field", sum(added)), ("a field for each", sum(alone)),
                ("equal tiles stored once", sum(shared))]
        if self.options.new_rays:
            rows.append(("new rays alone", round(alone[0] + self.new_rays(states, file, owns))))
        for name, size in rows:
            print(f"{name:24} {size:10} bytes of payloads, {size / alone[0]:.2f} x the first alone")
        print(f"{'file of all':24} {whole.stat().st_size:10} bytes")
        for name, size, psnr in self.encoded(states, file):
            print(f"{name:24} {size:10} bytes, PSNR",
                  " ".join(f"{theirs - ours:+.2f}" for ours, theirs in zip(found, psnr)), "dB",
                  flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("volume")
    parser.add_argument("--slf", default="build/release/cli/slf")
    parser.add_argument("--folder", default="states-benchmark")
    parser.add_argument("--states", type=int, default=8)
    parser.add_argument("--one-light", action="store_true", help="the light of the first for all")
    parser.add_argument("--times", action="store_true", help="time points instead of cuts")
    parser.add_argument("--depth", type=float, default=0.7, help="how far down the last cut is")
    parser.add_argument("--views", type=int, default=4)
    parser.add_argument("--new-rays", action="store_true", help="what cuts lay open, in bytes")
    parser.add_argument("--memory", action="store_true", help="peak memory and time alone")
    parser.add_argument("--labels", action="store_true", help="with --memory: of a label volume")
    parser.add_argument("--film", type=int, nargs="+", default=[], metavar="CRF",
                        help="also as films of these qualities, 0 (best) to 63")
    parser.add_argument("--quality", type=int, nargs="+", default=[], metavar="Q",
                        help="also with these qualities of predictive, 1 to 100 (best)")
    arguments = sys.argv[1:]
    at = arguments.index("--") if "--" in arguments else len(arguments)
    options = parser.parse_args(arguments[:at])
    options.build = arguments[at + 1:]
    benchmark = Benchmark(options)
    benchmark.memory() if options.memory else benchmark.compare()


if __name__ == "__main__":
    main()
