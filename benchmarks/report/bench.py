"""What all parts of the report use: programs, volumes, and fields that are built once."""

import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from . import volumes


class Failed(Exception):
    """A command failed, or something is missing; the message names it and the reason."""


class Bench:
    """One run of the report. `quick` asks for smaller experiments that show the same."""

    def __init__(self, root, out, data, quick, keep_fields):
        self.root, self.out, self.quick = Path(root), Path(out), quick
        self.data = Path(data)
        self.programs = self.root / "build/release"
        self.fields = self.out / "fields"
        self.work = self.out / "work"
        self.keep_fields = keep_fields
        self.volumes = volumes.find_volumes(self.root, Path(data))
        self.commands = []  # of the part under way
        self.part = ""
        self._begin = time.monotonic()
        self._threads = os.cpu_count()
        for folder in (self.fields, self.work):
            folder.mkdir(parents=True, exist_ok=True)

    def close(self):
        shutil.rmtree(self.work, ignore_errors=True)
        if not self.keep_fields:
            shutil.rmtree(self.fields, ignore_errors=True)

    # ---- messages --------------------------------------------------------------------------

    def seconds(self):
        return time.monotonic() - self._begin

    def say(self, text):
        print(f"[{self.seconds():4.0f} s] {self.part}: {text}", file=sys.stderr, flush=True)

    # ---- commands --------------------------------------------------------------------------

    def program(self, name):
        """The path of a benchmark program, or None where it was not built."""
        path = self.programs / ("cli/slf" if name == "slf" else f"benchmarks/{name}")
        return path if path.exists() else None

    def run(self, name, *arguments, quiet=True, check=True, memory=None):
        """Runs slf, a benchmark program or a system program; returns its output.
        `memory` limits its address space, as ulimit -v."""
        program = self.program(name) or shutil.which(name)
        if not program:
            raise Failed(f"{name} is not there (not built, or not installed)")
        words = [str(program), *map(str, arguments)]
        self.commands.append(self.shown([name, *words[1:]]))
        begin = told = time.monotonic()
        with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
            process = subprocess.Popen(words, stdout=out, stderr=errors, stdin=subprocess.DEVNULL)
            while True:
                try:
                    process.wait(timeout=1)
                    break
                except subprocess.TimeoutExpired:
                    if time.monotonic() - told > 20:
                        told = time.monotonic()
                        self.say(f"... {name} {words[1]}: {told - begin:.0f} s")
                except BaseException:
                    process.terminate()
                    process.wait()
                    raise
            out.seek(0)
            errors.seek(0)
            text, complaint = out.read(), errors.read()
        if process.returncode != 0 and check:
            raise Failed(f"{self.commands[-1]}: exit code {process.returncode}: {complaint[-600:]}")
        return text

    def json(self, name, *arguments, **options):
        """The same for a program that prints JSON."""
        return json.loads(self.run(name, *arguments, **options))

    def shown(self, words):
        """A command as a reader would type it, from the root of the repository."""
        text = " ".join(shlex.quote(str(word)) for word in words)
        return text.replace(f"{self.root}/", "")

    # ---- volumes and fields ----------------------------------------------------------------

    def volume(self, *names):
        """The first of these volumes that is available."""
        for name in names:
            if name in self.volumes:
                return self.volumes[name]
        raise Failed(f"no volume of: {', '.join(names)} (scripts/install-packages --for report)")

    def scene(self, name):
        """An analytic scene, as a volume."""
        return volumes.Volume(name, f"scene:{name}", f"scene:{name}")

    def resampled(self, side):
        """The brain with side³ voxels in the same box."""
        brain = self.volume("brain")
        target = self.fields / f"brain-{side}.nrrd"
        if not target.exists():
            self.say(f"resampling the brain to {side}³")
            info = self.json("slf", "info", brain.path, "--json")
            volumes.resample_nifti(brain.path, info, side, target)
        return volumes.Volume(
            f"brain-{side}", f"Brain, resampled to {side}³", str(target), brain.transfer
        )

    def skull(self):
        """The CT of a head without the rest that it lies on, or None without its package."""
        target = self.fields / "skull.nrrd"
        if not target.exists() and not volumes.write_skull(target):
            return None
        options = ("--crop", "35:220,45:256,:")
        return volumes.Volume("skull", "Head, CT", str(target), "ct-bone", options)

    def field(self, volume, entry, exit, levels, codec="jpeg:90", depth=True):
        """The path of a field of a volume under direct light, that of the paper and of the programs
        that we compare with. Built at the first call."""
        kind = codec.replace(":", "") + ("" if depth else "-nodepth")
        path = self.fields / f"{volume.name}-{entry}-{exit}-{levels}-{kind}.slf"
        if not self.is_complete(path):
            finest = f"{entry << levels}/{exit << levels}"
            self.say(f"building {volume.name}, {finest} cells an edge, {kind}")
            self.run(
                "slf", "build", *volume.under_direct_light(), "-o", path,
                "--entry", entry, "--exit", exit, "--levels", levels, "--codec", codec, *([] if depth else ["--no-depth"]),
            )  # fmt: skip
        return path

    def recoded(self, field, codec, depth=True):
        """The path of a copy with another codec, and with or without depth."""
        kind = codec.replace(":", "") + ("" if depth else "-nodepth")
        path = self.fields / f"{field.stem}-in-{kind}.slf"
        if not self.is_complete(path):
            self.say(f"encoding {field.stem}: {kind}")
            without = [] if depth else ["--no-depth"]
            self.run("slf", "repack", field, "-o", path, "-f", "--codec", codec, *without)
        return path

    def is_complete(self, path):
        if not path.exists():
            return False
        text = self.run("slf", "info", path, "--json", check=False)
        self.commands.pop()
        return bool(text) and json.loads(text).get("complete", False)

    def evaluate(self, field, volume, mode, views=8, size=512, level=None):
        """PSNR, SSIM and file size of random views against ray-cast truth."""
        at = [] if level is None else ["--level", level]
        return self.json(
            "slf", "evaluate", field, "--volume", volume.path, *volume.options, "--mode", mode,
            "--views", views, "--size", size, *at, "--json",
        )  # fmt: skip

    # ---- pictures --------------------------------------------------------------------------

    def raycast(self, volume, name, *camera):
        path = self.work / f"{name}.png"
        self.run("slf", "raycast", *volume.under_direct_light(), "-o", path, "-f", *camera)
        return path

    def render(self, field, name, *camera):
        path = self.work / f"{name}.png"
        self.run("slf", "render", field, "-o", path, "-f", *camera)
        return path

    def compare(self, truth, picture, gain=4):
        """PSNR and SSIM of two pictures, and the path of their difference picture."""
        path = picture.with_name(f"{picture.stem}-error.png")
        numbers = self.json(
            "slf", "compare", truth, picture, "--diff", path, "-f", "--gain", gain, "--json"
        )
        return numbers, path
