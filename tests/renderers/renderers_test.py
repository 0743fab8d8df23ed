#!/usr/bin/env python3
"""The scripts of examples/renderers, with the programs that they are for, on tiny pictures:

    renderers_test.py transforms|vtk|blender SLF

Exits with 77 if the program is not installed.
"""
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "examples" / "renderers"
SLF = None
SIZE = (48, 40)

sys.dont_write_bytecode = True
sys.path.insert(0, str(SCRIPTS))
import transforms  # noqa: E402

# A cube from -1 to 1 with outward faces, each of two triangles.
CORNERS = [(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def write_cube(path):
    lines = ["ply", "format ascii 1.0", f"element vertex {len(CORNERS)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(FACES)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, corner)) for corner in CORNERS]
    lines += [" ".join(map(str, (4, *face))) for face in FACES]
    path.write_text("\n".join(lines) + "\n")


def read_png(path):
    """Rows of pixels, each a tuple of 4 bytes, of a PNG with 8-bit RGBA."""
    data, at, pixels = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", body[:10])
            assert (depth, color) == (8, 6), (depth, color)
        elif kind == b"IDAT":
            pixels += body
        at += 12 + length
    pixels, rows, above = zlib.decompress(pixels), [], bytes(4 * width)
    for y in range(height):
        line = bytearray(pixels[y * (4 * width + 1):(y + 1) * (4 * width + 1)])
        kind, line = line[0], line[1:]
        for k in range(len(line)):
            left, up = line[k - 4] if k >= 4 else 0, above[k]
            corner = above[k - 4] if k >= 4 else 0
            near = min((abs(up - corner), 0, left), (abs(left - corner), 1, up),
                       (abs(left + up - 2 * corner), 2, corner))[2]
            line[k] = (line[k] + (0, left, up, (left + up) // 2, near)[kind]) & 255
        above = bytes(line)
        rows.append([tuple(line[4 * x:4 * x + 4]) for x in range(width)])
    return rows


def box_of(rows):
    """The columns and rows of what is opaque: left, right, top, bottom, half open."""
    xs = [x for row in rows for x, pixel in enumerate(row) if pixel[3] > 127]
    ys = [y for y, row in enumerate(rows) if any(pixel[3] > 127 for pixel in row)]
    return min(xs), max(xs) + 1, min(ys), max(ys) + 1


def write_camera(path, **lens):
    """One camera at (0, 0, 5) that looks along -z, with x right and y up."""
    width, height = SIZE
    frame = {"file_path": "images/one", "transform_matrix":
             [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]}
    common = {"w": width, "h": height, "fl_x": 40, "fl_y": 40, "cx": width / 2, "cy": height / 2}
    path.write_text(json.dumps({**common, **lens, "frames": [frame]}))


class Base(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def path(self, name):
        return self.folder / name


class Transforms(Base):
    def refusal(self, text):
        self.path("t.json").write_text(text)
        with self.assertRaises(SystemExit) as raised:
            transforms.read(str(self.path("t.json")))
        return str(raised.exception)

    def test_what_is_missing_is_named(self):
        self.assertIn("t.json", self.refusal("{"))
        self.assertIn('"frames"', self.refusal("[]"))
        self.assertIn('"frames"', self.refusal('{"frames": []}'))
        frame = {"file_path": "a", "transform_matrix": []}
        self.assertIn("frame a: no fl_x", self.refusal(json.dumps({"frames": [frame]})))
        lens = dict.fromkeys(("fl_x", "fl_y", "cx", "cy", "w", "h"), 1)
        exr = json.dumps({**lens, "frames": [{**frame, "file_path": "a.exr"}]})
        self.assertIn("expected a .png", self.refusal(exr))
        with self.assertRaises(SystemExit):
            transforms.read(str(self.path("none.json")))

    def test_depths_are_stated_where_slf_finds_them(self):
        path = self.path("t.json")
        frames = [{"file_path": "images/0000", "kept": 1}, {"file_path": "images/v1.5.PNG"}]
        path.write_text(json.dumps({"w": 3, "frames": frames}))
        path.chmod(0o640)
        transforms.state_depths(str(path))
        data = json.loads(path.read_text())
        self.assertEqual(data["w"], 3)
        self.assertEqual(data["frames"][0], {"file_path": "images/0000", "kept": 1,
                                             "depth_file_path": "images/0000.exr"})
        self.assertEqual(data["frames"][1]["depth_file_path"], "images/v1.5.exr")
        self.assertEqual(path.stat().st_mode & 0o777, 0o640)
        self.assertEqual(os.listdir(self.folder), ["t.json"])


class Renderer(Base):
    """What the scripts of all programs promise."""
    __test__ = False

    def render(self, *arguments, good=True):
        done = subprocess.run([*self.command(), *map(str, arguments)], text=True, timeout=300,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.assertEqual(done.returncode == 0, good, done.stdout)
        return done.stdout

    def test_bad_arguments_are_named(self):
        write_camera(self.path("t.json"))
        write_cube(self.path("cube.ply"))
        self.assertIn("usage:", self.render(good=False))
        self.assertIn("none.json", self.render(self.path("none.json"), self.path("cube.ply"),
                                               good=False))
        self.assertIn("expected .", self.render(self.path("t.json"), "cube.xyz", good=False))

    def boxes(self, **lens):
        write_camera(self.path("t.json"), **lens)
        write_cube(self.path("cube.ply"))
        self.render(self.path("t.json"), self.path("cube.ply"))
        rows = read_png(self.path("images/one.png"))
        self.assertEqual((len(rows[0]), len(rows)), SIZE)
        self.assertEqual(rows[0][0][3], 0)
        return box_of(rows)

    def test_lens(self):
        # The front face is 4 away: the cube is 2 * 40 / 4 = 20 pixels wide.
        self.assert_near(self.boxes(), (14, 34, 10, 30))
        self.assert_near(self.boxes(cx=30, cy=15), (20, 40, 5, 25))
        self.assert_near(self.boxes(fl_x=80), (4, 44, 10, 30))

    def assert_near(self, box, expected):
        for a, b in zip(box, expected):
            self.assertLessEqual(abs(a - b), 1, (box, expected))

    def test_slf_reads_what_was_rendered(self):
        def slf(*arguments):
            return subprocess.run([SLF, *map(str, arguments)], check=True, text=True,
                                  stdout=subprocess.PIPE, timeout=300).stdout
        write_cube(self.path("cube.ply"))
        slf("cameras", "--sphere", "0,0,0,1.8", "--count", 30, "--size", "64x56", "-o",
            self.path("transforms.json"))
        self.render(self.path("transforms.json"), self.path("cube.ply"))
        info = json.loads(slf("info", f"pictures:{self.folder}", "--json"))
        self.assertEqual((info["pictures"], info["depth_files"]), (30, 30 if self.DEPTH else 0))
        field = self.path("cube.slf")
        slf("build", f"pictures:{self.folder}", "-o", field, "-q", "--voxels", 48, "--entry", 2,
            "--exit", 4, "--levels", 1)
        built = json.loads(slf("info", field, "--json"))["provenance"]
        self.assertEqual(built["depth"], self.DEPTH or "estimated")


class Vtk(Renderer):
    __test__ = True
    DEPTH = None

    def command(self):
        display = [] if os.environ.get("DISPLAY") else ["xvfb-run", "-a"]
        return [*display, self.python(), SCRIPTS / "vtk_render.py"]

    @staticmethod
    def python():
        """An interpreter that has VTK: the system's may not be the one that runs this."""
        for python in (sys.executable, "/usr/bin/python3"):
            if os.path.exists(python) and subprocess.run(
                    [python, "-c", "import vtk"], stderr=subprocess.DEVNULL).returncode == 0:
                return python
        return None

    @staticmethod
    def missing():
        if not Vtk.python():
            return "no Python that has VTK"
        if not os.environ.get("DISPLAY") and not shutil.which("xvfb-run"):
            return "no display, and no xvfb-run"
        return None


class Blender(Renderer):
    __test__ = True
    DEPTH = "z"

    def command(self):
        return ["blender", "-b", "--python-exit-code", "1", "--python",
                SCRIPTS / "blender_render.py", "--"]

    def render(self, *arguments, good=True):
        paths = [4] if len(arguments) == 2 else []
        return super().render(*arguments, *paths, good=good)

    @staticmethod
    def missing():
        return None if shutil.which("blender") else "blender is not installed"


def main():
    global SLF
    name, SLF = sys.argv[1:]
    case = {"transforms": Transforms, "vtk": Vtk, "blender": Blender}[name]
    reason = case.missing() if issubclass(case, Renderer) else None
    if reason:
        print("skipped:", reason)
        sys.exit(77)
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    suite = unittest.defaultTestLoader.loadTestsFromTestCase(case)
    sys.exit(not unittest.TextTestRunner(verbosity=2).run(suite).wasSuccessful())


if __name__ == "__main__":
    main()
