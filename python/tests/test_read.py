"""Reading fields: content, pictures, tiles, and what goes wrong."""

import contextlib
import filecmp
import gc
import multiprocessing
import os
import pathlib
import pickle
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import slf
from conftest import SMALL


def test_states_shape_and_content(balls):
    assert (balls.finest_level, balls.shape.entry_side, balls.shape.exit_side) == (1, 2, 8)
    assert balls.sphere.radius > 0
    assert balls.manifest["provenance"] == balls.provenance
    content = balls.content()
    assert content.complete
    assert [level.tiles for level in content.levels] == [64, 1024]
    assert content.file_bytes == balls.file_bytes == os.path.getsize(balls.path)
    assert balls.format == "rgba8_depth8" and balls.codec == "predictive:90" and balls.has_depth
    assert "levels 0 to 1" in repr(balls)


def test_picture_equals_that_of_the_command(balls, command, tmp_path):
    for mode in ("nearest", "bitri", "depth"):
        command("render", balls.path, "-o", tmp_path / "view.png", "--size", "96x64", "--orbit",
                "30,20,3", "--mode", mode, "-f")
        picture = balls.render(slf.orbit(30, 20, 3), (96, 64), mode, dtype=np.uint8,
                               background=(0, 0, 0))
        image = pytest.importorskip("PIL.Image").open(tmp_path / "view.png")
        assert np.array_equal(np.asarray(image.convert("RGB")), picture[..., :3])


def test_picture_with_depth(balls):
    picture = balls.render(slf.orbit(0, 0, 3), (64, 48), depth=True)
    assert picture.rgba.shape == (48, 64, 4) and picture.rgba.dtype == np.float32
    assert picture.depth.shape == (48, 64) and picture.depth.dtype == np.float32
    seen = picture.rgba[..., 3] > 0.5
    assert seen.any() and np.isinf(picture.depth[picture.rgba[..., 3] == 0]).all()
    radius = balls.sphere.radius
    assert (abs(picture.depth[seen] - 3 * radius) < radius).all()
    # Premultiplied, but for the codec's error of a few 8-bit steps.
    assert (picture.rgba[..., :3] <= picture.rgba[..., 3:] + 8 / 255).all()


def test_camera_of_an_orbit_draws_the_same(balls):
    camera = balls.camera(slf.orbit(10, -5, 2.5), (50, 40))
    assert np.array_equal(balls.render(camera, (50, 40)),
                          balls.render(slf.orbit(10, -5, 2.5), (50, 40)))


def test_levels_by_name(balls):
    size = (40, 40)
    finest = balls.render(size=size)
    assert np.array_equal(finest, balls.render(size=size, level=1))
    assert not np.array_equal(finest, balls.render(size=size, level=0))
    assert balls.render(size=(8, 8), level="matching").shape == (8, 8, 4)
    with pytest.raises(ValueError, match="'coarse'"):
        balls.render(level="coarse")
    with pytest.raises(slf.UsageError, match="level"):
        balls.render(level=7)


def test_wrong_arguments_are_value_errors(balls):
    for wrong in (dict(mode="cubic"), dict(size=(0, 5)), dict(dtype=np.int16),
                  dict(camera=slf.Camera((0, 0, 0), (0, 0, 0))), dict(tone=slf.Tone())):
        with pytest.raises(ValueError):
            balls.render(**wrong)


def test_thumbnail_is_a_picture_over_black(balls):
    thumbnail = balls.thumbnail(64)
    assert thumbnail.shape == (64, 64, 4) and thumbnail.dtype == np.uint8
    assert (thumbnail[..., 3] == 255).all() and thumbnail[..., :3].max() > 60


def test_lists_and_decodes_tiles(balls):
    tiles = balls.tiles(level=1)
    assert len(tiles) == 1024 and {tile.content for tile in tiles} <= {"stored", "empty"}
    stored = [tile for tile in tiles if tile.content == "stored"]
    assert sum(tile.payload_bytes for tile in stored) == balls.content().levels[1].payload_bytes
    tile = max(stored, key=lambda t: t.payload_bytes)
    color = balls.tile(tile.level, tile.entry, tile.exit)
    depth = balls.tile(tile.level, tile.entry, tile.exit, "depth")
    assert color.dtype == depth.dtype == np.uint8
    assert color.shape[1:] == (9 * 10 // 2, 4) and depth.shape == color.shape[:2]
    assert color[..., 3].max() > 0
    with pytest.raises(slf.UsageError):
        balls.tile(1, 99999, 0)
    with pytest.raises(slf.UsageError, match="heat"):
        balls.tile(1, 0, 0, "heat")


def test_arrays_outlive_their_field(balls_path):
    field = slf.open(balls_path)
    entry = next(t for t in field.tiles() if t.content == "stored")
    tile, picture = field.tile(*entry[:3]), field.render(size=(32, 32))
    copies = tile.copy(), picture.copy()
    field.close()
    del field
    gc.collect()
    assert np.array_equal(tile, copies[0]) and np.array_equal(picture, copies[1])


def test_closed_field_says_so(balls_path):
    with slf.open(balls_path) as field:
        pass
    assert field.closed and "closed" in repr(field)
    with pytest.raises(ValueError, match="closed"):
        field.render()
    with pytest.raises(ValueError, match="closed"):
        with field:
            pass
    field.close()


def test_errors_have_code_path_and_python_classes(tmp_path):
    missing = tmp_path / "missing.slf"
    with pytest.raises(FileNotFoundError) as caught:
        slf.open(missing)
    error = caught.value
    assert isinstance(error, slf.Error) and isinstance(error, OSError)
    assert error.code == 2 and error.path == str(missing) and str(missing) in str(error)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    bad = tmp_path / "bad.slf"
    bad.write_bytes(b"not a field" * 1000)
    with pytest.raises(slf.BadFileError) as caught:
        slf.open(bad)
    assert caught.value.code == 3


def test_field_of_a_web_server(balls_path, tmp_path):
    local = slf.open(balls_path)
    try:
        address = local.show().url + "field.slf"
    except slf.UnsupportedError:
        pytest.skip("slf was built without the page, so there is no server here")
    with slf.open(address) as remote:
        assert np.array_equal(remote.render(size=(48, 48)), local.render(size=(48, 48)))
    with slf.open(address, cache=tmp_path / "kept") as remote:
        shown = pickle.loads(pickle.dumps(remote)).render(size=(48, 48))
    assert np.array_equal(shown, local.render(size=(48, 48)))
    assert sum(file.stat().st_size for file in (tmp_path / "kept").rglob("*")) > 10_000
    local.close()
    local.close()
    with pytest.raises(slf.IoError):
        slf._slf.Field(address, 1 << 24, 1, None)


def test_verify_repack_diff_and_merge(balls_path, tmp_path):
    assert slf.verify(balls_path).ok
    with slf.open(balls_path) as field:
        assert slf.verify(field, quick=True).complete
        report = slf.repack(field, tmp_path / "coarse.slf", finest_level=0)
        assert report.recoded == 0 and report.tiles == 64
        with pytest.raises(slf.UsageError):
            slf.repack(field, tmp_path / "coarse.slf", finest_level=0)
        assert slf.diff(field, balls_path).equal
        other = slf.diff(field, tmp_path / "coarse.slf")
    assert not other.equal and other.channels[0].only_in_a == 1024


def test_finds_damage(balls_path, tmp_path):
    data = bytearray(balls_path.read_bytes())
    with slf.open(balls_path) as field:
        tile = max(field.tiles(), key=lambda t: t.payload_bytes)
    data[tile.offset_bytes + 20] ^= 0xFF
    damaged = tmp_path / "damaged.slf"
    damaged.write_bytes(data)
    report = slf.verify(damaged)
    assert not report.ok and report.damaged == 1
    assert "T1" in {finding.kind for finding in report.findings}
    with slf.open(damaged) as field, pytest.raises(slf.BadFileError) as caught:
        field.tile(*tile[:3])
    assert caught.value.path == str(damaged)


def test_measures_and_evaluates(balls):
    measurement = balls.measure([slf.orbit(0, 0, 3), slf.orbit(90, 10, 3)], (64, 64))
    assert [level.level for level in measurement.levels] == [0, 1]
    assert 0 < measurement.levels[1].fraction.mean < 1
    assert measurement.levels[1].tiles_touched.max >= measurement.levels[1].tiles_touched.mean
    evaluation = balls.evaluate("scene:balls", 2, (64, 64))
    assert len(evaluation.views) == 2 and 10 < evaluation.psnr < 60 and 0 < evaluation.ssim <= 1


def test_planes_cut_what_is_played_measured_and_evaluated(tmp_path, voxels):
    planes, camera, size = [((8, 6, 6), (0, 0, 1))], slf.orbit(20, 30, 3), (48, 48)
    how = dict(SMALL, lighting="direct", light_samples=4)
    with slf.build(voxels, tmp_path / "cut.slf", reveal=16, **how) as field:
        cut = dict(clip=planes, cap="slice")
        shown = field.render(camera, size, **cut)
        assert not np.array_equal(shown, field.render(camera, size))
        assert np.array_equal(shown, field.render(camera, size, clip=[(8, 6, 6, 0, 0, 1)],
                                                  cap="slice"))
        with field.player(loading="wait", **cut) as player:
            assert np.array_equal(player.draw(camera, size), shown)
        whole, part = (field.measure([camera], size, **given).total.tiles_touched.mean
                       for given in ({}, dict(clip=planes, cap="hollow")))
        assert part < whole
        ours = field.evaluate(voxels, [camera], size, clip=planes, cap="shaded")
        assert ours.psnr > field.evaluate(voxels, [camera], size, clip=planes, cap="hollow").psnr
        assert not ours.differs
        for call in (field.measure, field.player):
            with pytest.raises(slf.UsageError, match="mode depth"):
                call(mode="bitri", clip=planes)
    with slf.build(voxels, tmp_path / "half.slf", clip=[(8, 6, 6, 0, 0, 1)], **how) as half:
        assert half.evaluate(voxels, [camera], size, clip=planes).psnr > 20  # it has the plane


def test_a_reveal_is_added_and_read(tmp_path, voxels):
    how = dict(SMALL, lighting="direct", light_samples=4)
    affine = np.diag((2.0, 1.0, 1.0, 1.0))
    with slf.build(voxels, tmp_path / "f.slf", affine=affine, **how) as field:
        assert field.reveal() is None
        cut = dict(camera=slf.orbit(20, 30, 3), size=(48, 48), clip=[((16, 6, 6), (0, 0, 1))])
        hollow = field.render(**cut)
        with pytest.raises(slf.UsageError, match="another volume"):
            field.add_reveal(voxels[::-1].copy(), 16, affine=affine)
        field.add_reveal(voxels, 32, (float(voxels.min()), float(voxels.max())), affine=affine)
        values, placed = field.reveal()
        assert not np.array_equal(field.render(**cut), hollow)
        # The value in the middle of each voxel of the copy is about that of the volume there.
        z, y, x = np.indices(values.shape)
        world = np.stack((x, y, z, np.ones_like(x)), -1) @ placed.T
        at = np.rint(world @ np.linalg.inv(affine).T)[..., :3].astype(int)
        inside = np.all((at >= 0) & (at < voxels.shape[::-1]), axis=-1)
        assert inside.mean() > 0.8
        there = voxels[tuple(at[inside].T[::-1])]
        assert np.corrcoef(there, values[inside])[0, 1] > 0.95
    slf.repack(tmp_path / "f.slf", tmp_path / "g.slf", reveal=False)
    with slf.open(tmp_path / "g.slf") as field:
        assert field.reveal() is None


def test_fields_and_cameras_are_pickled(balls):
    for camera in (slf.orbit(10, 20, 3), slf.Camera((0, -3, 0), (0, 0, 0))):
        assert pickle.loads(pickle.dumps(camera)) == camera
    with pickle.loads(pickle.dumps(balls)) as again:
        assert again.path == balls.path
        assert np.array_equal(again.render(size=(16, 16)), balls.render(size=(16, 16)))
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(slf.Field.thumbnail, balls, 16).result().shape == (16, 16, 4)


def test_player_draws_what_the_field_draws(balls):
    player = balls.player(loading="wait")
    for azimuth in (0, 5, 10):
        frame = player.draw(slf.orbit(azimuth, 20, 3), (64, 64))
        assert np.array_equal(frame, balls.render(slf.orbit(azimuth, 20, 3), (64, 64)))
        assert player.report.full_share == 1
    with pytest.raises(ValueError, match="linear radiance"):
        player.draw(slf.orbit(0, 20, 3), (64, 64), tone=slf.Tone())
    player = balls.player()
    balls.close()
    player.draw(slf.orbit(0, 0, 3), (64, 64))
    player.settle()
    assert player.draw(slf.orbit(0, 0, 3), (64, 64)).shape == (64, 64, 4)
    player.close()
    player.close()
    with pytest.raises(ValueError, match="closed"):
        player.draw(slf.orbit(0, 0, 3), (64, 64))


def test_threads_may_share_a_field(balls):
    expected = balls.render(size=(64, 64))
    wrong = []

    def draw():
        for _ in range(5):
            if not np.array_equal(balls.render(size=(64, 64)), expected):
                wrong.append(1)

    threads = [threading.Thread(target=draw) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_forked_process_draws_with_the_open_field_and_closes_it(balls):
    expected = balls.render(size=(64, 64))
    player = balls.player()
    player.draw(slf.orbit(), (64, 64))
    player.settle()  # no thread works at the fork
    with contextlib.suppress(slf.UnsupportedError):
        balls.show()
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        same = np.array_equal(balls.render(size=(64, 64)), expected)
        with pytest.raises(slf.UsageError, match="forked"):
            player.draw(slf.orbit(), (64, 64))
        player.close()
        del player
        balls.close()
        os._exit(0 if same else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert np.array_equal(balls.render(size=(64, 64)), expected)
    player.draw(slf.orbit(), (64, 64))


def test_a_forked_process_draws_and_builds_whatever_threads_do(balls, balls_path, tmp_path):
    def draw():
        return np.array_equal(balls.render(size=(64, 64)), expected)

    def build(name):
        slf.build("scene:balls", tmp_path / name, **SMALL).close()
        return filecmp.cmp(tmp_path / name, balls_path, shallow=False)

    def work(stop):
        while not stop.is_set():
            assert draw()

    def fork(name):
        child = os.fork()
        if child == 0:
            signal.alarm(60)
            os._exit(0 if all(draw() for _ in range(4)) and build(name) and draw() else 1)
        return os.waitpid(child, 0)[1]

    expected = balls.render(size=(64, 64))
    tile = balls.tile(0, 0, 0)
    assert build("before.slf")
    for threads in (0, 3):
        stop = threading.Event()
        others = [threading.Thread(target=work, args=(stop,)) for _ in range(threads)]
        for thread in others:
            thread.start()
        ended = [fork(f"{threads}-{k}.slf") for k in range(4)]
        stop.set()
        for thread in others:
            thread.join()
        assert ended == [0] * 4
    assert draw()
    del tile


def test_a_process_that_is_forked_while_a_view_takes_long_draws_anew(balls):
    expected = balls.render(size=(64, 64))
    tile = balls.tile(0, 0, 0)
    thread = threading.Thread(target=lambda: balls.render(size=(3000, 3000)))
    thread.start()
    time.sleep(0.3)
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        same = np.array_equal(balls.render(size=(64, 64)), expected)
        del tile
        balls.close()
        os._exit(0 if same else 1)
    assert os.waitpid(child, 0)[1] == 0
    thread.join()


def resident_bytes():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE")


@pytest.mark.skipif("libasan" in os.environ.get("LD_PRELOAD", ""),
                    reason="the address sanitizer keeps freed memory")
def test_failed_reads_keep_nothing():
    damaged = pathlib.Path(__file__).parents[2] / "tests/data/golden/flipped_tile.slf"
    failed = 0
    for _ in range(53):
        with slf.open(damaged) as field:
            for tile in field.tiles():
                try:
                    field.tile(tile.level, tile.entry, tile.exit)
                except slf.Error:
                    failed += 1
    assert failed >= 53
    gc.collect()
    assert "flipped_tile.slf" not in pathlib.Path("/proc/self/maps").read_text()


def test_opens_and_closes_without_growth(balls_path):
    def use():
        with slf.open(balls_path, threads=1) as field:
            field.render(size=(16, 16), level=0)

    for _ in range(50):
        use()
    before = resident_bytes()
    for _ in range(500):
        use()
    assert resident_bytes() - before < 4 << 20


def test_structures_are_drawn_together(balls, balls_path, tmp_path):
    half = slf.Look(0.5, (1, 0, 1))
    plain = balls.render(mode="bitri", size=(48, 48))
    alone = balls.render(mode="bitri", size=(48, 48), structures={balls: half})
    assert np.allclose(alone, plain * (0.5, 0, 0.5, 0.5), atol=1 / 255)
    with slf.open(balls_path) as other:
        composed = balls.compose({other: 1, "hidden.slf": 0})
    assert np.array_equal(composed.render(mode="bitri", size=(48, 48)), plain)
    assert composed.measure(2, (32, 32)).total.tiles_touched.mean > 0
    again = pickle.loads(pickle.dumps(balls.compose({balls_path: half})))
    assert np.array_equal(again.render(mode="bitri", size=(48, 48)), alone)
    assert not balls.render(size=(8, 8), structures={}).any()
    with pytest.raises(slf.Error, match="has no structures that its page|without the page"):
        balls.compose({balls: 1}).show()
    with pytest.raises(slf.UsageError, match="opacity or tint 2: expected 0 to 1"):
        balls.compose({balls: 2})
    with slf.build("scene:balls", tmp_path / "flat.slf", entry=2, exit=8, finest_level=1,
                   depth=False, codec="zstd") as flat:
        with pytest.raises(slf.UsageError, match="flat.slf: has no depth"):
            balls.compose({flat: 1})
