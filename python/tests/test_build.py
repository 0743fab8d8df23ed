"""Building from arrays and images: the same bytes as `slf build` from the same voxels."""

import contextlib
import filecmp
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import types
import urllib.request

import numpy as np
import pytest

import slf
from conftest import SMALL, SMALL_ARGUMENTS, write_nifti
from slf._source import described

META_TYPES = {"u1": "UCHAR", "i1": "CHAR", "u2": "USHORT", "i2": "SHORT", "u4": "UINT", "i4": "INT",
              "f4": "FLOAT", "f8": "DOUBLE"}


def write_mha(path, array, spacing=(1, 1, 1), origin=(0, 0, 0), direction=np.eye(3)):
    """A MetaImage of an array [z, y, x]; the columns of `direction` are the axes."""
    numbers = lambda values: " ".join(repr(float(v)) for v in values)
    header = (f"ObjectType = Image\nNDims = 3\nBinaryData = True\n"
              f"BinaryDataByteOrderMSB = False\nTransformMatrix = {numbers(direction.T.ravel())}\n"
              f"Offset = {numbers(origin)}\nElementSpacing = {numbers(spacing)}\n"
              f"DimSize = {array.shape[2]} {array.shape[1]} {array.shape[0]}\n"
              f"ElementType = MET_{META_TYPES[array.dtype.str[1:]]}\nElementDataFile = LOCAL\n")
    path.write_bytes(header.encode() + np.ascontiguousarray(array).tobytes())
    return path


def same_fields(tmp_path, command, file, source, arguments=(), parts=False, **settings):
    """Whether Python and the command build the same bytes; of `parts` in memory, which have no
    names for the recipe, the same but for that."""
    theirs, ours = tmp_path / "command.slf", tmp_path / "python.slf"
    for path in (theirs, ours):
        path.unlink(missing_ok=True)
    command("build", file, "-o", theirs, *SMALL_ARGUMENTS, *arguments)
    settings.setdefault("name", str(file))
    slf.build(source, ours, **SMALL, **settings).close()
    if not parts:
        return filecmp.cmp(theirs, ours, shallow=False)
    with slf.open(theirs) as a, slf.open(ours) as b:
        made = [{**field.provenance, "recipe": None} for field in (a, b)]
        return made[0] == made[1] and not any(c.recoded or c.differing
                                              for c in slf.diff(a, b).channels)


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"])
def test_types(kind, voxels, command, tmp_path):
    array = (np.clip(voxels, 0, None) / 10).astype(kind)
    file = write_mha(tmp_path / "a.mha", array)
    assert same_fields(tmp_path, command, file, array)


def test_clip(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    planes = [(3, 4, 5, 1, 0.5, 0), (4, 4, 4, 0, 0, -1)]
    texts = [("--clip", ",".join(map(str, plane))) for plane in planes]
    assert same_fields(tmp_path, command, file, voxels, sum(texts, ()), clip=planes)
    with pytest.raises(ValueError, match="clip"):
        slf.build(voxels, tmp_path / "b.slf", clip=[(1, 2, 3, 0, 0, float("nan"))])


def test_orders_and_strides(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    big = np.zeros([2 * n for n in voxels.shape], np.int16)
    big[::2, ::2, ::2] = voxels
    for array in (np.asfortranarray(voxels), big[::2, ::2, ::2], voxels.astype(">i2"),
                  voxels[:, ::-1].copy()[:, ::-1]):
        assert same_fields(tmp_path, command, file, array)


def test_spacing_affine_and_origin(voxels, command, tmp_path):
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    spacing, origin = (0.5, 0.75, 2.0), (10, -20, 30.5)
    file = write_mha(tmp_path / "a.mha", voxels, spacing, origin, turn)
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = turn * spacing, origin
    # An affine is one to LPS, so the file has to say that its world is that, too.
    stated = b"AnatomicalOrientation = RAI\nElementType"
    file.write_bytes(file.read_bytes().replace(b"ElementType", stated, 1))
    assert same_fields(tmp_path, command, file, voxels, affine=affine)
    file = write_mha(tmp_path / "b.mha", voxels, spacing, origin)
    assert same_fields(tmp_path, command, file, voxels, spacing=spacing, origin=origin)


def test_transfers_range_and_codecs(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    for arguments, settings in (
            (["--transfer", "ct-bone"], dict(transfer="ct-bone")),
            (["--transfer", "ct-bone", "--range", "0,900"],
             dict(transfer="ct-bone", range=(0, 900))),
            (["--codec", "zstd", "--no-depth"], dict(codec="zstd", depth=False)),
            (["--codec", "jpeg:80"], dict(codec="jpeg:80")),
            (["--projection", "mip", "--step", "1"], dict(projection="mip", step=1)),
            (["--no-shade", "--radius", "20", "--center", "7,6,6"],
             dict(shade=False, radius=20, center=(7, 6, 6)))):
        assert same_fields(tmp_path, command, file, voxels, arguments, **settings), arguments


def test_light(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    for light in ("shadowed", "global"):
        assert same_fields(tmp_path, command, file, voxels,
                           ["--lighting", light, "--light-samples", "4"],
                           lighting=light, light_samples=4)
        assert not (tmp_path / "python.slf.light").exists()
    assert same_fields(tmp_path, command, file, voxels,
                       ["--lighting", "global", "--light-samples", "2", "--color-type", "half",
                        "--codec", "zstd"],
                       lighting="global", light_samples=2, color_type="half", codec="zstd")


def test_labels(voxels, command, tmp_path):
    ids = (voxels > 500).astype(np.uint8) + (voxels > 800).astype(np.uint8)
    file = write_mha(tmp_path / "ids.mha", ids)
    assert same_fields(tmp_path, command, file, ids, ["--labels"], labels=True)
    grey = write_mha(tmp_path / "grey.mha", voxels)
    table = tmp_path / "table.json"
    table.write_text('{"labels": [{"id": 1, "name": "shell", "color": [1, 0, 0]},'
                     ' {"id": 2, "name": "core", "color": [0, 1, 0], "opacity": 0.5}]}')
    arguments = ["--labels-volume", file, "--label-table", table]
    assert same_fields(tmp_path, command, grey, voxels, arguments, True, labels=ids,
                       label_table=table)
    assert same_fields(tmp_path, command, grey, voxels, arguments, True, labels=ids,
                       label_table={1: ("shell", (1, 0, 0)), 2: ("core", (0, 1, 0), 0.5)})
    assert same_fields(tmp_path, command, grey, voxels, ["--mask", file], True, mask=ids)


def test_files(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    assert same_fields(tmp_path, command, file, file, name=None)
    assert same_fields(tmp_path, command, file, str(file), ["--spacing", "1x2x3"],
                       spacing=(1, 2, 3))


def test_shards_merge_to_the_whole(voxels, tmp_path):
    for k in (1, 2, 3):
        slf.build(voxels, tmp_path / f"{k}.slf", shard=(k, 3), **SMALL).close()
    slf.build(voxels, tmp_path / "whole.slf", **SMALL).close()
    report = slf.merge([tmp_path / f"{k}.slf" for k in (2, 3, 1)], tmp_path / "merged.slf")
    assert report.tiles == 1088
    difference = slf.diff(tmp_path / "merged.slf", tmp_path / "whole.slf")
    assert difference.comparable and all(c.differing == 0 for c in difference.channels)


# ---- images of other packages --------------------------------------------------------------------


def test_nibabel_images(voxels, command, tmp_path):
    array = np.asfortranarray(voxels.T)
    affine = np.array([[-1.5, 0, 0, 12], [0, 2, 0.25, -7], [0, -0.25, 2, 3], [0, 0, 0, 1.0]])
    file = tmp_path / "a.nii"
    write_nifti(file, array, affine, 0.5, -10)

    class Proxy:
        slope, inter = 0.5, -10.0

        def get_unscaled(self):
            return array

    class Header(dict):
        def get_xyzt_units(self):
            return "mm", "unknown"

    image = types.SimpleNamespace(affine=affine, dataobj=Proxy(), get_filename=lambda: str(file),
                                  header=Header(sform_code=1, qform_code=0))
    assert same_fields(tmp_path, command, file, image, name=None)
    nibabel = pytest.importorskip("nibabel")
    assert same_fields(tmp_path, command, file, nibabel.load(file), name=None)


@pytest.mark.parametrize("header, settings, patient", [
    ({"sform_code": 0, "qform_code": 2}, {}, True), ({"sform_code": 0, "qform_code": 0}, {}, False),
    ({"goodRASFlag": 1}, {}, True), ({}, {}, False), (None, {}, False),
    (None, {"affine": np.eye(4)}, True)])
def test_axes_are_patients_only_where_that_is_stated(voxels, tmp_path, header, settings, patient):
    image = voxels if header is None else types.SimpleNamespace(
        affine=np.eye(4), dataobj=voxels, header=header)
    with slf.build(image, tmp_path / "a.slf", lighting="direct", **settings, **SMALL) as field:
        assert field.provenance.get("space") == ("LPS" if patient else None)


def test_itk_images(voxels, command, tmp_path):
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    file = write_mha(tmp_path / "a.mha", voxels, (1, 2, 3), (4, 5, 6), turn)

    class Image:
        def GetSpacing(self):
            return 1.0, 2.0, 3.0

        def GetOrigin(self):
            return 4.0, 5.0, 6.0

        def GetDirection(self):
            return tuple(turn.ravel())

        def __array__(self, dtype=None):
            return voxels

    assert same_fields(tmp_path, command, file, Image())


def test_images_of_simpleitk(voxels, command, tmp_path):
    SimpleITK = pytest.importorskip("SimpleITK")
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    file = write_mha(tmp_path / "a.mha", voxels, (1, 2, 3), (4, 5, 6), turn)
    assert same_fields(tmp_path, command, file, SimpleITK.ReadImage(str(file)))


def test_xarrays(voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels, (0.5, 1, 2), (1, -2, 3))

    class Array:
        """[y, x, z], as xarray has it."""
        dims = ("y", "x", "z")
        name = "density"
        data = voxels.transpose(1, 2, 0)
        coords = {"x": 1 + 0.5 * np.arange(16), "y": -2 + 1.0 * np.arange(14),
                  "z": 3 + 2.0 * np.arange(12)}

        def transpose(self, *dims):
            moved = Array()
            moved.data = self.data.transpose([self.dims.index(d) for d in dims])
            moved.dims = dims
            return moved

    assert same_fields(tmp_path, command, file, Array())
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(Array.data, Array.coords, Array.dims, "density")
    assert same_fields(tmp_path, command, file, array)
    Array.coords = {**Array.coords, "x": np.arange(16.0) ** 2}
    with pytest.raises(ValueError, match="x are not evenly"):
        slf.build(Array(), tmp_path / "no.slf", **SMALL)


def test_chunked_arrays_are_read_in_slabs(voxels, command, tmp_path, monkeypatch):
    read = []

    class Zarr:
        shape, dtype, chunks = voxels.shape, voxels.dtype, (5, 7, 8)

        def __getitem__(self, part):
            read.append(part)
            return voxels[part]

        def __array__(self, dtype=None):
            raise AssertionError("the whole array was read at once")

    file = write_mha(tmp_path / "a.mha", voxels)
    assert same_fields(tmp_path, command, file, Zarr())
    assert read == [slice(0, 5), slice(5, 10), slice(10, 12)]
    monkeypatch.setattr(slf._source, "_MOST_IN_MEMORY", 100)  # into a temporary file
    assert same_fields(tmp_path, command, file, Zarr())
    assert sorted(os.listdir(tmp_path)) == ["a.mha", "command.slf", "python.slf"]


@pytest.mark.parametrize("package", ["zarr", "dask.array"])
def test_arrays_of_zarr_and_dask(package, voxels, command, tmp_path):
    module = pytest.importorskip(package)
    make = module.array if package == "zarr" else module.from_array
    file = write_mha(tmp_path / "a.mha", voxels)
    assert same_fields(tmp_path, command, file, make(voxels, chunks=(5, 7, 8)))


# ---- transfer functions --------------------------------------------------------------------------


def test_transfer_functions_as_arrays_and_functions(voxels, tmp_path):
    points = [[0, 0, 0, 0, 0], [500, 1, 0.5, 0, 0.2], [1000, 1, 1, 1, 0.9]]
    with slf.build(voxels, tmp_path / "array.slf", transfer=points, **SMALL) as field:
        transfer = field.provenance["transfer"][0]
        assert transfer["RGBPoints"] == [0, 0, 0, 0, 500, 1, 0.5, 0, 1000, 1, 1, 1]
        assert transfer["Points"][4:6] == [500, 0.2]
    red = lambda v: np.stack([v > 400, 0 * v, 0 * v, v > 400], axis=1)
    picture = slf.raycast(voxels, size=(32, 32), transfer=red, shade=False)
    assert picture[..., 0].max() > 0.9 and picture[..., 1:3].max() == 0
    with pytest.raises(ValueError, match="rows of value"):
        slf.build(voxels, tmp_path / "no.slf", transfer=np.zeros((3, 4)))


def test_raycast_equals_the_command_and_the_field(voxels, command, tmp_path):
    file, size = write_mha(tmp_path / "a.mha", voxels), (64, 48)
    command("raycast", file, "-o", tmp_path / "view.png", "--size", "64x48", "--orbit", "10,20,3")
    cast = slf.raycast(voxels, slf.orbit(10, 20, 3), size, dtype=np.uint8, background=(0, 0, 0))
    image = pytest.importorskip("PIL.Image").open(tmp_path / "view.png")
    assert np.array_equal(np.asarray(image.convert("RGB")), cast[..., :3])
    with slf.build(voxels, tmp_path / "a.slf", entry=4, exit=16, finest_level=1) as field:
        assert field.evaluate(voxels, 1, size).psnr > 20


# ---- manners -------------------------------------------------------------------------------------


def test_wrong_arguments(voxels, tmp_path):
    out = tmp_path / "no.slf"
    for error, source, settings in (
            (slf.UsageError, voxels[0], {}), (TypeError, voxels.astype(complex), {}),
            (slf.UsageError, voxels, dict(spacing=(1, 0, 1))), (slf.UsageError, voxels, dict(lighting="dim")),
            (slf.UsageError, voxels, dict(affine=np.zeros((4, 4)))),
            (slf.UsageError, voxels, dict(codec="gif")), (slf.UsageError, voxels, dict(color_type="u9")),
            (slf.UsageError, voxels, dict(center=(1e6, 0, 0))), (slf.UsageError, voxels, dict(series="1")),
            (slf.UsageError, voxels, dict(transfer="no-such-preset")),
            (slf.UsageError, "scene:none", {}), (FileNotFoundError, tmp_path / "missing.nii", {}),
            (slf.UsageError, voxels, dict(entry="x")), (TypeError, voxels, dict(colour="red")),
            (slf.UsageError, "scene:balls", dict(transfer="ct-bone"))):
        with pytest.raises(error):
            slf.build(source, out, **{**SMALL, **settings})
        assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("shape", [(0, 4, 4), (4, 0, 4), (4, 4, 0), (1, 4, 4), (0, 0, 0)])
def test_arrays_without_voxels_are_refused(shape, voxels):
    for dtype in ("u1", "f4"):
        empty = np.ones(shape, dtype)
        for source, settings in ((empty, {}), (empty, dict(labels=True)),
                                 (voxels, dict(labels=empty.astype("u1"))),
                                 (voxels, dict(mask=empty)), (empty, dict(transfer=lambda v: v))):
            with pytest.raises(slf.UsageError, match="along each axis"):
                slf.raycast(source, size=(8, 8), **settings)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize("bad", [NAN, INF, -INF])
def test_numbers_must_be_finite(bad, voxels, tmp_path):
    """None of them may be ignored, or with it all other settings."""
    scalars = ("step", "ambient", "light_samples", "light_bounces", "light_spacing",
               "light_memory", "light_seed", "environment_gain")
    everywhere = [{name: bad} for name in scalars] + [
        dict(light=(0, bad, 1)), dict(tone=slf.Tone(bad)), dict(range=(bad, 100)),
        dict(range=(0, bad)), dict(spacing=(1, bad, 1)), dict(origin=(0, bad, 0)),
        dict(affine=np.diag([1, bad, 1, 1])), dict(transfer=[(0, 0, 0, 0, 0), (1, 1, 1, 1, bad)]),
        dict(labels=np.ones(voxels.shape, "u1"), label_table={1: ("a", (1, bad, 0), 1)}),
        dict(labels=np.ones(voxels.shape, "u1"), label_table={1: ("a", (1, 1, 0), bad)})]
    for settings in everywhere:
        with pytest.raises(slf.UsageError):
            slf.raycast(voxels, size=(8, 8), **settings)
    for settings in (dict(radius=bad), dict(center=(0, bad, 0)), dict(commit_every=bad)):
        with pytest.raises(slf.UsageError):
            slf.build("scene:balls", tmp_path / "a.slf", **{**SMALL, **settings})
    with pytest.raises(slf.UsageError):
        slf.build_rays(lambda a, b: np.ones((len(a), 4)), ((0, 0, bad), 1), tmp_path / "a.slf")
    for camera in (slf.orbit(bad, 20, 3), slf.orbit(0, 20, bad),
                   slf.Camera((0, bad, 3), (0, 0, 0)), slf.Camera((0, 1, 3), (0, 0, 0), fov=bad)):
        with pytest.raises(slf.UsageError):
            slf.raycast("scene:balls", camera, (8, 8))
    with pytest.raises(slf.UsageError):
        slf.raycast("scene:balls", size=(8, 8), background=(0, bad, 0))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["no\udcff.nii", "né\udcfe.slf"])
def test_names_need_not_be_utf8(name, voxels, tmp_path):
    missing = tmp_path / name
    calls = [lambda: slf.open(missing), lambda: slf.raycast(missing), lambda: slf.verify(missing),
             lambda: slf.raycast(voxels, transfer=missing),
             lambda: slf.raycast(voxels, environment=missing),
             lambda: slf.raycast(voxels, light_rig=str(missing) + "/.json"),
             lambda: slf.raycast(voxels, labels=np.ones(voxels.shape, "u1"), label_table=missing),
             lambda: slf.merge([missing], tmp_path / "a.slf"),
             lambda: slf.repack(missing, tmp_path / "a.slf")]
    for call in calls:
        with pytest.raises(slf.Error) as error:
            call()
        assert name in str(error.value)
    missing.write_bytes(b"no field")
    with pytest.raises(slf.BadFileError) as error:
        slf.open(os.fsencode(missing))
    assert error.value.path == str(missing)
    missing.unlink()
    with slf.build(voxels, missing, name=str(missing), **SMALL) as field:
        assert field.path == str(missing)
        assert slf.verify(field).ok
    with slf.open(missing) as field:
        assert field.render(size=(8, 8)).shape == (8, 8, 4)


def test_masks_of_numpy_hide_voxels(voxels, tmp_path):
    settings = dict(camera=slf.orbit(20, 10, 3), size=(32, 32), lighting="direct")
    hidden = np.zeros(voxels.shape, bool)
    hidden[:, :, 8:] = True
    poisoned = np.where(hidden, 30000, voxels).astype(np.int16)
    least = np.where(hidden, voxels[~hidden].min(), voxels).astype(np.int16)
    cast = lambda source, **more: slf.raycast(source, **settings, **more)
    expected = cast(least, mask=~hidden)
    assert not np.array_equal(expected, cast(voxels))
    masked = np.ma.array(poisoned, mask=hidden)
    assert np.array_equal(cast(masked), expected)
    other = np.ones(voxels.shape, "u1")
    other[:6] = 0
    assert np.array_equal(cast(masked, mask=other), cast(least, mask=other * ~hidden))
    assert np.array_equal(cast(np.ma.array(voxels)), cast(voxels))  # nothing is masked
    ids = (voxels > 500).astype(np.uint8)
    assert np.array_equal(cast(np.ma.array(ids, mask=hidden), labels=True),
                          cast(ids * ~hidden, labels=True))
    assert np.array_equal(cast(voxels, labels=np.ma.array(ids, mask=hidden)),
                          cast(voxels, labels=ids * ~hidden))
    assert np.array_equal(cast(voxels, mask=np.ma.array(other, mask=hidden)),
                          cast(voxels, mask=other * ~hidden))


def test_same_call_opens_and_another_is_refused(voxels, tmp_path):
    out = tmp_path / "a.slf"
    assert slf.build(voxels, out, **SMALL).build_report == (1088, 0)
    assert slf.build(voxels, out, **SMALL).build_report == (0, 1088)
    with pytest.raises(slf.UsageError) as caught:
        slf.build(voxels + 1, out, **SMALL)
    assert caught.value.path == str(out)
    assert slf.build(voxels + 1, out, force=True, **SMALL).build_report.tiles == 1088


def test_progress_reports_stops_and_raises(voxels, tmp_path):
    seen = []
    slf.build(voxels, tmp_path / "a.slf", progress=lambda *p: seen.append(p), **SMALL)
    assert seen[-1][0] == seen[-1][1] > 0
    with pytest.raises(slf.FailedError):
        slf.build(voxels, tmp_path / "b.slf", progress=lambda *p: False, **SMALL)
    with pytest.raises(ZeroDivisionError):
        slf.build(voxels, tmp_path / "c.slf", progress=lambda *p: 1 / 0, **SMALL)
    assert not (tmp_path / "c.slf").exists()
    slf.build(voxels, tmp_path / "c.slf", progress=True, **SMALL)
    assert slf.diff(tmp_path / "a.slf", tmp_path / "c.slf").equal


def test_contiguous_array_is_not_copied(tmp_path):
    script = """
import re, sys
import numpy as np, slf
array = np.full((256, 512, 512), -1, np.float32)  # 256 MiB, all of it touched
array[100:140, 200:260, 200:260] = 1
def peak():  # of this process alone: ru_maxrss includes that of the one it was forked from
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1]) << 10
before = peak()
slf.build(array, sys.argv[1], range=(0, 1), entry=1, exit=2, finest_level=0)
print(peak() - before)
"""
    grown = subprocess.run([sys.executable, "-c", script, tmp_path / "a.slf"], check=True,
                           capture_output=True, text=True).stdout
    assert int(grown) < 64 << 20


def test_ctrl_c_keeps_what_is_finished(tmp_path):
    script = """
import sys, slf
try:
    slf.build("scene:balls", sys.argv[1], entry=2, exit=8, finest_level=5,
              progress=lambda done, total, skipped:
                  print("going", flush=True) if done > total / 8000 else None)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    out = tmp_path / "a.slf"
    process = subprocess.Popen([sys.executable, "-c", script, out], stdout=subprocess.PIPE,
                               text=True)
    assert process.stdout.readline() == "going\n"  # in level 2
    process.send_signal(signal.SIGINT)
    # Mostly a tenth of a second; the whole build would take hours.
    assert "interrupted" in process.communicate(timeout=60)[0]
    assert not out.exists()
    with slf.open(f"{out}.unfinished") as unfinished:
        assert [level.stored + level.empty for level in unfinished.content().levels[:2]] == [
            64, 1024]


def test_ctrl_c_comes_out_of_every_long_call(balls_path, voxels, tmp_path):
    def interrupt(done, total, skipped):
        os.kill(os.getpid(), signal.SIGINT)

    out = tmp_path / "out"
    with slf.open(balls_path) as field:
        for call in (lambda: slf.build(voxels, out, progress=interrupt, **SMALL),
                     lambda: slf.build("scene:balls", out, progress=interrupt, **SMALL),
                     lambda: slf.raycast(voxels, progress=interrupt),
                     lambda: slf.verify(balls_path, progress=interrupt),
                     lambda: slf.repack(field, out, codec="zstd", progress=interrupt),
                     lambda: slf.merge([balls_path], out, progress=interrupt),
                     lambda: slf.diff(field, balls_path, progress=interrupt),
                     lambda: field.measure(progress=interrupt),
                     lambda: field.evaluate("scene:balls", progress=interrupt)):
            with pytest.raises(KeyboardInterrupt):
                call()
            assert not out.exists()


def test_interpreter_exits_while_a_build_runs(tmp_path):
    script = """
import sys, threading, slf
begun = threading.Event()
def progress(done, total, skipped):
    if done: begun.set()
threading.Thread(target=slf.build, args=("scene:balls", sys.argv[1]), daemon=True,
                 kwargs=dict(finest_level=4, commit_every=0, progress=progress)).start()
begun.wait()
"""
    done = subprocess.run([sys.executable, "-c", script, tmp_path / "a.slf"], timeout=60,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with slf.open(tmp_path / "a.slf.unfinished") as unfinished:
        assert not unfinished.content().complete


def test_python_runs_while_slf_works(tmp_path):
    """The GIL is released: another thread makes progress during one call."""
    counts = []
    ended = threading.Event()

    def count():
        while not ended.is_set():
            counts.append(time.monotonic())

    def counted_inside():
        """The counts of one call, between its first and its last progress."""
        times = []
        slf.build("scene:balls", tmp_path / "a.slf", force=True,
                  progress=lambda *_: times.append(time.monotonic()), **SMALL)
        return sum(times[0] < t < times[-1] for t in counts[:])

    thread = threading.Thread(target=count)
    thread.start()
    try:
        # On a loaded machine the thread may not have its turn during a short call.
        give_up = time.monotonic() + 60
        while counted_inside() <= 100:
            counts.clear()
            assert time.monotonic() < give_up
    finally:
        ended.set()
        thread.join()


def test_notes_are_warnings(tmp_path):
    ids = np.zeros((8, 8, 32), np.uint8)
    ids[2:6, 2:6, 4:14], ids[2:6, 2:6, 14:28] = 3, 17
    with pytest.warns(UserWarning, match="look like labels") as caught:
        slf.raycast(ids, size=(8, 8))
        slf.build(ids, tmp_path / "a.slf", lighting="direct", **SMALL)
    assert [one.filename for one in caught] == 2 * [__file__]
    file = tmp_path / "a.nrrd"
    file.write_bytes(b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n"
                     b"12345678")
    with pytest.warns(UserWarning, match="a.nrrd: it states no spacing"):
        slf.raycast(file, size=(8, 8))


# ---- all kinds of scenes -------------------------------------------------------------------------


def test_meshes_and_pictures(command, tmp_path):
    mesh = tmp_path / "tetra.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    assert same_fields(tmp_path, command, mesh, mesh, name=None)
    assert same_fields(tmp_path, command, mesh, str(mesh), ["--up-axis", "z", "--lighting", "direct"],
                       name=None, up_axis="z", lighting="direct")
    with pytest.raises(slf.UsageError, match="transfer: only for volumes"):
        slf.build(mesh, tmp_path / "no.slf", transfer="ct-bone")
    cameras = tmp_path / "c.json"
    command("cameras", "--sphere", "0,0,0,1", "--count", "24", "--size", "48", "-o", cameras)
    command("raycast", "scene:balls", "--cameras", cameras, "-o", tmp_path / "balls")
    pictures = f"pictures:{tmp_path / 'balls'}"
    assert same_fields(tmp_path, command, pictures, pictures, ["--voxels", "48", "--holdout", "8"],
                       name=None, voxels=48, holdout=8)
    assert same_fields(tmp_path, command, pictures, pictures,
                       ["--voxels", "48", "--depth-kind", "none", "--radius", "0.9",
                        "--center", "0,0,0.1"],
                       name=None, voxels=48, depth_kind="none", radius=0.9, center=(0, 0, 0.1))


@pytest.mark.parametrize("built", [dict(), dict(color_type="half", codec="zstd"),
                                   dict(lighting="direct", transfer="ct-bone")])
def test_evaluates_as_the_command_does(built, voxels, command, tmp_path):
    file = write_mha(tmp_path / "a.mha", voxels)
    with slf.build(file, tmp_path / "a.slf", **{"light_samples": 4, **built}, **SMALL) as field:
        ours = field.evaluate(file, 2)
        other = write_mha(tmp_path / "b.mha", voxels + 1)
        with pytest.warns(UserWarning, match="another source"):
            assert field.evaluate(other, 2, (8, 8)).differs == "/content"
        with pytest.raises(TypeError, match="lighting"):
            field.evaluate(file, lighting="direct")
    theirs = json.loads(command("evaluate", tmp_path / "a.slf", "--volume", file, "--views", "2",
                                "--json"))
    assert (ours.psnr, ours.ssim) == (theirs["psnr"], theirs["ssim"])
    assert ours.views == tuple((v["psnr"], v["ssim"]) for v in theirs["per_view"])
    assert theirs["same_source"] and not ours.differs


def test_spheres_that_miss_everything_are_refused(tmp_path):
    with pytest.raises(slf.UsageError, match="misses all that is visible"):
        slf.build("scene:balls", tmp_path / "a.slf", center=(1000, 0, 0), radius=1)
    with pytest.raises(slf.UsageError, match="misses all that is visible"):
        slf.build_rays(lambda a, b: np.ones((len(a), 4)), ((0, 0, 0), 1), tmp_path / "a.slf",
                       center=(3, 0, 0), radius=1)


def test_threads_may_share_a_scene(voxels):
    """Its light is computed once, by one of them, which alone is told of it."""
    with contextlib.ExitStack() as stack:
        _, [(_, scene)] = described(stack, voxels, {"lighting": "global", "light_samples": 4})
        rows = 16
        view = scene.bounds, slf.orbit(10, 20, 3), (16, rows)
        pictures, totals, other = {}, {1: set(), 2: set()}, []

        def draw(name):
            def report(done, total, skipped):
                totals[name].add(total)
                if not other:
                    other.append(threading.Thread(target=draw, args=(2,)))
                    other[0].start()
                    other[0].join(0.2)
            pictures[name] = scene.raycast(*view, 2, report)[0]

        draw(1)
        other[0].join()
    assert totals[1] > {rows} and totals[2] == {rows}
    assert np.array_equal(pictures[1], pictures[2]) and pictures[1].any()


def test_states(tmp_path):
    voxels = np.zeros((12, 12, 12), np.uint8)
    voxels[2:10, 2:10, 2:10] = 200
    half = voxels.copy()
    half[6:] = 0
    field = slf.build(voxels, tmp_path / "a.slf", lighting="direct", **SMALL,
                      states=[{"name": "whole"}, {"name": "half", "source": half},
                              {"name": "again", "transfer": None}])
    assert field.states == ("whole", "half", "again") and field.state == 0
    whole, cut = field.render(size=(32, 32)), field.render(size=(32, 32), state="half")
    assert (whole != cut).any()
    assert (field.render(size=(32, 32), state=2) == whole).all()
    assert field.in_state("again").content().payload_bytes == 0
    assert field.in_state(1) is field.in_state(1)
    assert (slf.open(tmp_path / "a.slf", state=1).render(size=(32, 32)) == cut).all()
    own = slf.build(half, tmp_path / "b.slf", lighting="direct", **SMALL,
                    center=field.sphere.center, radius=field.sphere.radius)
    assert own.states == ()
    assert field.in_state(1).evaluate(half, 2).psnr == pytest.approx(own.evaluate(half, 2).psnr, abs=0.5)
    with pytest.raises(slf.UsageError, match="whole, half, again"):
        field.render(state="none")
    with pytest.raises(slf.UsageError, match="has no state 3"):
        field.in_state(3)


def test_states_of_one_light(tmp_path):
    z, y, x = np.mgrid[-6:6, -6:6, -6:6]
    ball = np.maximum(0, 255 - 9 * (x * x + y * y + z * z)).astype(np.uint8)
    states = [{"name": "whole"},
              {"name": "cut", "clip": [(6, 6, 6, 0, 0, 1)], "light_from": "whole"}]
    light = {"transfer": "ct-bone", "range": (20, 120), "light_samples": 4}
    cut = slf.build(ball, tmp_path / "a.slf", **SMALL, **light, states=states).in_state("cut")
    assert "light_of" in cut.provenance
    assert cut.content().payload_bytes < cut.in_state("whole").content().payload_bytes / 2
    assert cut.evaluate(ball, 2).psnr > 15
    for k in (1, 2):
        slf.build(ball, tmp_path / f"{k}.slf", **SMALL, **light, states=states, shard=(k, 2),
                  light_file=tmp_path / "{state}.light").close()
    assert [path.name for path in tmp_path.glob("*.light")] == ["whole.light"]
    slf.merge([tmp_path / "2.slf", tmp_path / "1.slf"], tmp_path / "merged.slf")
    for name in ("whole", "cut"):
        difference = slf.diff(slf.open(tmp_path / "merged.slf", state=name), cut.in_state(name))
        assert difference.comparable and all(c.differing == 0 for c in difference.channels)
    with pytest.raises(slf.UsageError, match="no part holds tiles"):
        slf.merge([tmp_path / "1.slf"], tmp_path / "x.slf")
    cut_open = [states[0], {"name": "cut", "clip": states[1]["clip"]}]
    with pytest.raises(slf.UsageError, match="one.light: has the light of state 'whole'"):
        slf.build(ball, tmp_path / "b.slf", **SMALL, **light, states=cut_open,
                  light_file=tmp_path / "one.light")
    states[1]["light_from"] = "hole"
    with pytest.raises(slf.UsageError, match="no earlier state is named 'hole'"):
        slf.build(ball, tmp_path / "b.slf", **SMALL, **light, states=states)
    states[1] = {"name": "hot", "transfer": "ct-skin", "light_from": "whole"}
    with pytest.raises(slf.UsageError, match="/transfer"):
        slf.build(ball, tmp_path / "b.slf", **SMALL, **light, states=states)


def test_states_of_one_array_read_it_once(tmp_path):
    class Slabs:
        """As an array of zarr."""
        shape, dtype, chunks, read = (12, 12, 12), np.dtype(np.uint8), (4, 12, 12), 0

        def __getitem__(self, part):
            self.read += 1
            return np.arange(12**3, dtype=np.uint16).astype(np.uint8).reshape(self.shape)[part]
    slabs = Slabs()
    states = [{"name": "whole"}, {"name": "cut", "clip": [(6, 6, 6, 0, 0, 1)]}]
    slf.build(slabs, tmp_path / "a.slf", **SMALL, lighting="direct", transfer="ct-bone",
              range=(0, 255), states=states)
    assert slabs.read == 3
    with pytest.raises(slf.UsageError, match="light_from: not for scenes of Python"):
        slf.build(slf.Scene(), tmp_path / "b.slf", states=[{"name": "a", "light_from": "b"}])


@pytest.fixture(scope="module")
def atlas_path(tmp_path_factory):
    """A field of two structures, "front" and "back", and its labels."""
    folder = tmp_path_factory.mktemp("atlas")
    labels = np.zeros((12, 12, 12), np.uint8)
    labels[2:10, 2:6, 2:10], labels[2:10, 8:10, 2:10], labels[4:6, 6:8, 4:6] = 1, 2, 3
    table = {1: ("front", (1, 0, 0)), 2: ("back", (0, 1, 0)), 3: "back"}
    settings = dict(labels=True, label_table=table, each_label=True, light_samples=2, **SMALL)
    counts = []
    slf.build(labels, folder / "atlas.slf", **settings, progress=lambda *p: counts.append(p)).close()
    assert len({total for _, total, _ in counts}) > 1  # light is counted, too
    write_mha(folder / "l.mha", labels)
    (folder / "t.json").write_text(json.dumps({"labels": [
        {"id": 1, "name": "front", "color": [1, 0, 0]},
        {"id": 2, "name": "back", "color": [0, 1, 0]}, {"id": 3, "name": "back"}]}))
    return folder / "atlas.slf"


def test_each_label_is_a_state(atlas_path, tmp_path, command):
    labels = np.zeros((12, 12, 12), np.uint8)
    command("build", atlas_path.parent / "l.mha", "--labels", "--label-table",
            atlas_path.parent / "t.json", "--each-label", "--light-samples", 2, *SMALL_ARGUMENTS,
            "-o", tmp_path / "b.slf")
    field = slf.open(atlas_path)
    assert field.states == ("front", "back")
    for state in field.states:
        theirs = slf.open(tmp_path / "b.slf", state=state)
        assert slf.diff(field.in_state(state), theirs).channels[0].differing == 0
    some = slf.build(atlas_path.parent / "l.mha", tmp_path / "some.slf", labels=True,
                     only_labels=[1, 3], each_label=True, lighting="direct", **SMALL)
    assert some.states == ("label 1", "label 3")
    for source, settings, message in [
            (labels, {"labels": True, "each_label": True, "states": [{"name": "all"}]},
             "each_label makes"),
            (labels + 1, {"each_label": True}, "amounts, not labels.*see the setting labels"),
            (labels, {"each_label": True, "labels": True}, "array: has no visible label"),
            (slf.Scene(), {"each_label": True}, "each_label: not for scenes of Python")]:
        with pytest.raises(slf.UsageError, match=message):
            slf.build(source, tmp_path / "c.slf", **settings)


def test_structures_of_one_field(atlas_path, tmp_path, command):
    """All are drawn unless others are named, in each call, as the command line does it."""
    with slf.open(atlas_path) as field:
        whole = field.render(size=(32, 32))
        assert np.array_equal(whole, field.render(size=(32, 32), structures=["*"]))
        front = field.render(size=(32, 32), state="front")
        assert np.array_equal(front, field.render(size=(32, 32), structures=["f*"]))
        assert np.array_equal(front, slf.open(atlas_path, state=0).render(size=(32, 32)))
        assert (front != whole).any() and (field.thumbnail() != field.in_state(0).thumbnail()).any()
        faded = {"*": 0.5, "back": slf.Look(1, (1, 0, 0))}
        command("render", atlas_path, "-o", tmp_path / "a.png", "--size", "32", "--structure",
                "*:0.5", "--structure", "back:#ff0000", "--background", "0,0,0")
        image = pytest.importorskip("PIL.Image").open(tmp_path / "a.png")
        ours = field.render(size=(32, 32), structures=faded, dtype="uint8", background=(0, 0, 0))
        assert np.array_equal(np.asarray(image.convert("RGB")), ours[..., :3])
        behind = slf.orbit(180, 0, 3)
        near, far = (field.pick(256, 256, behind, structures=[name]) for name in ("back", "front"))
        assert near.depth < far.depth and field.pick(256, 256, behind) == near
        assert field.pick(256, 256, behind, state="front") == far
        tiles = lambda **shown: field.measure(2, (32, 32), **shown).total.compressed_bytes.mean
        assert tiles() > tiles(structures={"front": 1, "back": 0}) == tiles(state="front") > 0
        truth = atlas_path.parent / "l.mha", 2, (32, 32)
        table = dict(labels=True, label_table=atlas_path.parent / "t.json")
        assert field.evaluate(*truth, **table).differs == ""
        assert field.evaluate(*truth, structures=["front"], **table).psnr > 15
        with field.player(structures=["front"], loading="wait") as player:
            assert np.array_equal(player.draw(slf.orbit(), (32, 32)), front)
        composed = pickle.loads(pickle.dumps(field.compose(faded)))
        assert np.array_equal(composed.render(size=(32, 32)),
                              field.render(size=(32, 32), structures=faded))
        with pytest.raises(slf.UsageError, match="no state 'middle'; its states are: front, back"):
            field.render(structures=["middle"])


def test_states_are_repacked(atlas_path, tmp_path):
    with slf.open(atlas_path) as field:
        slf.repack(field, tmp_path / "all.slf", codec="predictive:60")
        slf.repack(field, tmp_path / "back.slf", states=["back"])
        slf.repack(field.in_state("front"), tmp_path / "front.slf")
        slf.repack([tmp_path / "front.slf", tmp_path / "back.slf"], tmp_path / "both.slf")
        assert slf.open(tmp_path / "all.slf").states == ("front", "back")
        assert slf.open(tmp_path / "front.slf").states == ()
        both = slf.open(tmp_path / "both.slf")
        assert both.states == ("front", "back")
        for name in both.states:
            assert slf.diff(both.in_state(name), field.in_state(name)).channels[0].psnr > 40


def test_states_are_raycast(tmp_path):
    voxels = np.zeros((12, 12, 12), np.uint8)
    voxels[2:10, 2:10, 2:10] = 200
    states = [{"name": "whole"}, {"name": "half", "clip": [(6, 6, 6, 0, 0, 1)]}]
    draw = lambda **state: slf.raycast(voxels, size=(16, 16), lighting="direct", **state)
    with pytest.warns(UserWarning):
        half = draw(states=states, state="half")
        assert (draw() != half).any() and np.array_equal(draw(states=states, state=1), half)
        assert np.array_equal(draw(states=states), draw())
        with pytest.raises(slf.UsageError, match="no state 'none'; there are whole, half"):
            draw(states=states, state="none")


def test_pages_begin_with_structures(atlas_path, balls, tmp_path):
    field = slf.open(atlas_path)

    def attributes(view):
        with urllib.request.urlopen(view.url) as page:
            return page.read().decode().partition("<slf-field")[2].partition(">")[0]
    try:
        front = field.show(structures=["front"])
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    faded = field.show(structures={"*": 0.25, "back": slf.Look(1, (1, 0.5, 0))})
    assert 'structures="front"' in attributes(front)  # the first one is still served
    assert 'structures="*:0.25,back:#ff8000"' in attributes(faded)
    assert "structures" not in attributes(field.show())
    assert field.show(structures=["front"]).url == front.url
    assert 'structures="back"' in attributes(field.in_state(1).show())
    assert 'structures="front"' in attributes(field.compose({"front": 1}).show())
    for shown, message in [({"structures": ["middle"]}, "no state 'middle'"), ({"state": 5}, "5")]:
        with pytest.raises(slf.UsageError, match=message):
            field.show(**shown)
    with pytest.raises(slf.UsageError, match="has no structures"):
        balls.show(structures=["balls"])
    page = tmp_path / "page.html"
    report = slf.export(field, page, structures=["back:0.5"], finest_level=0)
    assert report.finest_level == 0 and 'structures="back:0.5"' in page.read_text("utf-8")
    small = slf.export(field, tmp_path / "one.html", states=["back"], max_size=2 << 20)
    assert small.finest_level == 1 and small.field_bytes < field.file_bytes
    with pytest.raises(slf.UsageError, match="not among the states to keep"):
        slf.export(field, tmp_path / "none.html", states=["back"], state="front")
    assert not list(tmp_path.glob("*.exporting"))


def test_memory_is_a_budget(balls_path, tmp_path):
    out = tmp_path / "a.slf"
    calls = [lambda memory: slf.build("scene:balls", out, memory=memory, force=True, **SMALL),
             lambda memory: slf.repack(balls_path, out, memory=memory, force=True),
             lambda memory: slf.merge([balls_path], out, memory=memory, force=True)]
    for call in calls:
        with pytest.raises(slf.UsageError, match="needs at least [0-9]+KiB of memory"):
            call(1000)
        call(64 << 20)
        call(0)
    assert slf.verify(balls_path, memory=1 << 20).found == 0
