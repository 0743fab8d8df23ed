"""States and structures of fields: what calls share, and what they leave alone."""

import os
import pickle
import sys
import threading

import numpy as np
import pytest

import slf
from conftest import SMALL

TWO = [{"name": "balls"}, {"name": "globe", "source": "scene:globe"}]
TINY = (24, 24)


@pytest.fixture(scope="module")
def two_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("states") / "two.slf"
    slf.build("scene:balls", path, **SMALL, states=TWO).close()
    return path


def test_a_list_of_structures_that_is_changed_later(two_path):
    with slf.open(two_path) as field:
        chosen = ["balls"]
        before = field.render(size=TINY, structures=chosen)
        chosen[0] = "globe"
        assert (field.render(size=TINY, structures=chosen) != before).any()
        composed = field.compose(chosen)
        chosen[0] = "balls"
        assert (composed.render(size=TINY) == field.render(size=TINY, state="globe")).all()


def test_tints_of_arrays(two_path):
    with slf.open(two_path) as field:
        tint = np.array([1, 0.5, 0.5])
        look = {"balls": slf.Look(1, tint)}
        first = field.render(size=TINY, structures=look)
        assert (field.render(size=TINY, structures=look) == first).all()
        tint[:] = 1
        assert (field.render(size=TINY, structures=look) != first).any()


def test_structures_of_two_threads(two_path):
    with slf.open(two_path) as field:
        pictures = {name: field.render(size=TINY, structures=[name]) for name in ("balls", "globe")}
        wrong = []

        def draw(name):
            for _ in range(30):
                if (field.render(size=TINY, structures=[name]) != pictures[name]).any():
                    wrong.append(name)

        interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-6)
        try:
            threads = [threading.Thread(target=draw, args=[name]) for name in pictures]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            sys.setswitchinterval(interval)
        assert not wrong


def test_closing_a_state_leaves_the_field_open(two_path):
    with slf.open(two_path) as field:
        globe = field.render(size=TINY, state="globe")
        with field.in_state("globe") as state:
            assert field.in_state("globe") is state
        assert state.closed
        assert (field.render(size=TINY, state="globe") == globe).all()
        again = field.in_state("globe")
        assert not again.closed and (again.render(size=TINY) == globe).all()
        assert (again.in_state("balls").render(size=TINY) == field.render(size=TINY)).all()


def test_states_share_the_memory_for_tiles(two_path):
    def address(field):
        return field.tile(0, 0, 0).__array_interface__["data"][0]

    with slf.open(two_path) as field:
        kept = field.tile(0, 0, 0)  # whose memory no other tile gets meanwhile
        assert address(field) == kept.__array_interface__["data"][0]
        for other in (field.in_state("globe"), field.compose(["globe"])):
            before = field.tile(0, 0, 0)
            other.render(size=TINY)
            assert address(field) != before.__array_interface__["data"][0]


def test_the_page_of_a_state_publishes_it_alone(two_path, tmp_path):
    with slf.open(two_path) as field:
        try:
            slf.export(field.in_state("globe"), tmp_path / "globe")
        except slf.UnsupportedError:
            pytest.skip("slf was built without the page")
        with slf.open(tmp_path / "globe" / "field.slf") as alone:
            assert alone.states == ()
            assert slf.diff(alone, field.in_state("globe")).channels[0].psnr > 40
        slf.export(field.in_state("globe"), tmp_path / "both", states=["balls", "globe"])
        slf.export(field, tmp_path / "all", state="globe")
        for name in ("both", "all"):
            with slf.open(tmp_path / name / "field.slf") as several:
                assert several.states == ("balls", "globe")


def test_relative_paths_outlive_their_folder(two_path, tmp_path, monkeypatch):
    monkeypatch.chdir(two_path.parent)
    field = slf.open(two_path.name)
    composed = field.compose(["globe"])
    monkeypatch.chdir(tmp_path)
    with field:
        picture = field.render(size=TINY)
        assert (pickle.loads(pickle.dumps(field)).render(size=TINY) == picture).all()
        assert (pickle.loads(pickle.dumps(composed)).render(size=TINY) != picture).any()
        assert slf.verify(field, fix=True).ok
        assert slf.repack(field, tmp_path / "again.slf").copied > 0
        assert os.path.isabs(field.path)
