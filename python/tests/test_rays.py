"""Fields from functions and scenes of Python."""

import gc
import os
import threading
import weakref
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest

import slf
from conftest import SMALL

BALL = ((1, 2, 3), 2.0)


def ball(origins, targets):
    """An opaque ball of radius 1 around (1, 2, 3), coloured by its normal; depth to its front."""
    center = np.array(BALL[0])
    direction = targets - origins
    length = np.linalg.norm(direction, axis=1)
    direction /= length[:, None]
    along = ((center - origins) * direction).sum(1)
    apart = ((center - origins) ** 2).sum(1) - along ** 2
    hit = apart < 1
    distance = along - np.sqrt(np.where(hit, 1 - apart, 0))
    normal = origins + distance[:, None] * direction - center
    rgba = np.zeros((len(origins), 4), np.float32)
    rgba[hit, :3] = (normal[hit] + 1) / 2
    rgba[hit, 3] = 1
    return rgba, distance / length


def test_field_shows_what_the_function_says(tmp_path):
    sizes = []

    def counted(origins, targets):
        assert origins.shape == targets.shape and origins.dtype == np.float64
        assert (origins != targets).any(axis=1).all()
        on_sphere = np.linalg.norm(origins - BALL[0], axis=1)
        assert np.allclose(on_sphere, BALL[1])
        sizes.append(len(origins))
        return ball(origins, targets)

    settings = dict(entry=4, exit=16, finest_level=1, codec="predictive:lossless")
    with slf.build_rays(counted, BALL, tmp_path / "a.slf", batch=500, **settings) as field:
        assert field.sphere == BALL and max(sizes) == 500
        picture = field.render(slf.orbit(0, 0, 3), (65, 65), depth=True)
        assert picture.rgba[0, 0, 3] == 0
        # In front is the point with the normal -y.
        assert np.allclose(picture.rgba[32, 32], [0.5, 0, 0.5, 1], atol=0.05)
        assert picture.depth[32, 32] == pytest.approx(3 * 2 - 1, abs=0.1)
        assert field.provenance["kind"] == "rays" and "counted" in field.provenance["name"]
    truth = slf.raycast(_Ball(), slf.orbit(0, 0, 3), (65, 65))
    assert abs(truth - picture.rgba).mean() < 0.02


class _Ball(slf.Scene):
    sphere = slf.Sphere(*BALL)
    trace = staticmethod(ball)


@pytest.mark.parametrize("settings", [{}, dict(entry=4, entry_extra_levels=1),
                                      dict(color_type="half")])
def test_rays_of_a_field_are_those_that_the_function_was_asked_for(tmp_path, settings):
    settings = {**SMALL, "codec": "predictive:lossless", **settings}
    with slf.build_rays(ball, BALL, tmp_path / "a.slf", **settings) as field:
        seen = 0
        for tile in field.tiles(level=1):
            rays = field.rays(tile.level, tile.entry, tile.exit)
            assert rays.rgba.shape == rays.directions.shape[:2] + (4,)
            ends = rays.origins + rays.directions
            for points in rays.origins, ends:
                assert np.allclose(np.linalg.norm(points - BALL[0], axis=-1), BALL[1])
            asked = np.linalg.norm(rays.directions, axis=-1) > 0
            rgba, depth = ball(rays.origins[asked], ends[asked])
            within = 1 / 255 if field.format.startswith("rgba8") else 1e-3
            assert np.allclose(rays.rgba[asked], rgba, rtol=0, atol=within)
            shown = rgba[:, 3] > 0
            assert np.allclose(rays.depth[asked][shown], depth[shown], rtol=0, atol=1 / 255)
            seen += shown.sum()
        assert seen > 1000
        some = field.rays(0, 0, 7)  # coarse: a mean around the ray, through the ball's middle
        assert np.allclose(some.rgba[..., 3].max(), 1) and some.rgba.dtype == np.float32
        with pytest.raises(slf.UsageError, match="1/99999/0"):
            field.rays(1, 99999, 0)
    with slf.build_rays(ball, BALL, tmp_path / "b.slf", depth=False,
                        **{**settings, "codec": "zstd"}) as field:
        assert field.rays(0, 0, 7).depth is None
    with pytest.raises(slf.UsageError, match="closed"):
        field.rays(0, 0, 7)


def test_batches_do_not_change_the_field(tmp_path):
    for batch in (1, 7, 100000):
        slf.build_rays(ball, BALL, tmp_path / f"{batch}.slf", batch=batch, entry=2, exit=4,
                       finest_level=0).close()
    first = (tmp_path / "1.slf").read_bytes()
    assert (tmp_path / "7.slf").read_bytes() == (tmp_path / "100000.slf").read_bytes() == first


def test_subclass_of_scene(tmp_path):
    slf.build(_Ball(), tmp_path / "a.slf", **SMALL).close()
    with slf.open(tmp_path / "a.slf") as field:
        assert "_Ball" in field.provenance["name"]
        assert field.evaluate(_Ball(), 1, (32, 32)).psnr > 15
    with pytest.raises(NotImplementedError):
        slf.build(type("Empty", (slf.Scene,), dict(sphere=slf.Sphere((0, 0, 0), 1)))(),
                  tmp_path / "b.slf", **SMALL)


@pytest.mark.parametrize("wrong, error, text", [
    (lambda o, t: 1 / 0, ZeroDivisionError, "division"),
    (lambda o, t: np.zeros((len(o), 3)), ValueError, r"rgba has the shape \(\d+, 3\), expected"),
    (lambda o, t: np.zeros((len(o) + 1, 4)), ValueError, "rgba has the shape"),
    (lambda o, t: (np.zeros((len(o), 4)), np.zeros(3)), ValueError, "depth has the shape"),
    (lambda o, t: (1, 2, 3), ValueError, "a tuple of 3"),
    (lambda o, t: np.full((len(o), 4), np.nan), ValueError, "not finite on the ray from"),
    (lambda o, t: (np.ones((len(o), 4)), np.full(len(o), 1.5)), ValueError, "0 to 1, on the ray"),
    (lambda o, t: "text", ValueError, "text"),
    (lambda o, t: None, (TypeError, ValueError), ""),
])
def test_what_is_wrong_comes_back_as_it_is(wrong, error, text, tmp_path):
    out = tmp_path / "a.slf"
    with pytest.raises(error, match=text) as caught:
        slf.build_rays(wrong, BALL, out, **SMALL)
    assert any("rays, the first of which is the ray from" in note
               for note in caught.value.__notes__)
    assert not out.exists()


def test_failed_build_resumes(tmp_path):
    calls = []

    def flaky(origins, targets):
        calls.append(len(origins))
        if flaky.fails and len(calls) > 300:
            raise ConnectionError("the renderer went away")
        return ball(origins, targets)

    flaky.fails = True
    settings = dict(SMALL, commit_every=0, threads=1)
    with pytest.raises(ConnectionError, match="went away"):
        slf.build_rays(flaky, BALL, tmp_path / "a.slf", **settings)
    assert not (tmp_path / "a.slf").exists()
    with slf.open(tmp_path / "a.slf.unfinished") as unfinished:
        assert not unfinished.content().complete
    flaky.fails = False
    with slf.build_rays(flaky, BALL, tmp_path / "a.slf", **settings) as field:
        assert field.build_report.resumed > 0
    slf.build_rays(flaky, BALL, tmp_path / "b.slf", **SMALL).close()
    assert slf.diff(tmp_path / "a.slf", tmp_path / "b.slf").equal


def test_another_provenance_is_another_field(tmp_path):
    out = tmp_path / "a.slf"
    slf.build_rays(ball, BALL, out, provenance={"version": 1}, **SMALL).close()
    with pytest.raises(slf.UsageError):
        slf.build_rays(ball, BALL, out, provenance={"version": 2}, **SMALL)


def test_function_is_called_by_one_thread_at_a_time_and_released(tmp_path):
    lock = threading.Lock()

    def exclusive(origins, targets):
        assert lock.acquire(blocking=False)
        result = ball(origins, targets)
        lock.release()
        return result

    slf.build_rays(exclusive, BALL, tmp_path / "a.slf", threads=4, **SMALL).close()
    gone = weakref.ref(exclusive)
    del exclusive
    gc.collect()
    assert gone() is None


def test_large_batches_span_the_origins_of_a_tile(tmp_path):
    sizes = []

    def counted(origins, targets):
        sizes.append(len(np.unique(origins, axis=0)))
        return ball(origins, targets)

    slf.build_rays(counted, BALL, tmp_path / "a.slf", **SMALL).close()
    assert len(sizes) <= 1088 and max(sizes) > 5


def test_function_runs_in_several_processes(tmp_path):
    processes = tmp_path / "processes"
    processes.mkdir()

    def traced(origins, targets):
        (processes / str(os.getpid())).touch()
        return ball(origins, targets)

    slf.build_rays(traced, BALL, tmp_path / "a.slf", processes=2, **SMALL).close()
    called_in = {int(path.name) for path in processes.iterdir()}
    assert len(called_in) == 2 and os.getpid() not in called_in
    slf.build_rays(ball, BALL, tmp_path / "b.slf", **SMALL).close()
    assert slf.diff(tmp_path / "a.slf", tmp_path / "b.slf").channels[0].differing == 0


def test_what_a_process_raises_comes_back(tmp_path):
    def fails(origins, targets):
        raise ZeroDivisionError("in a process")

    with pytest.raises(ZeroDivisionError, match="in a process") as caught:
        slf.build_rays(fails, BALL, tmp_path / "a.slf", processes=2, **SMALL)
    assert "the first of which is the ray from" in caught.value.__notes__[0]
    with pytest.raises(BrokenProcessPool):
        slf.build_rays(lambda o, t: os._exit(1), BALL, tmp_path / "b.slf", processes=2, **SMALL)
    assert not (tmp_path / "b.slf").exists()


def test_sphere_must_have_a_size(tmp_path):
    with pytest.raises(ValueError, match="radius"):
        slf.build_rays(ball, ((0, 0, 0), 0), tmp_path / "a.slf")
