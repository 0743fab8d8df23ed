"""Recipes in files, beside the same settings as keyword arguments."""

import filecmp
import json

import numpy as np
import pytest

import slf
from conftest import SMALL

pytestmark = pytest.mark.filterwarnings("ignore:.*v.npy")  # it states no spacing


@pytest.fixture()
def write(voxels, tmp_path):
    """Writes a recipe of the voxels and returns its path."""
    np.save(tmp_path / "v.npy", voxels)

    def to_file(name="r.json", **options):
        path = tmp_path / name
        path.write_text(json.dumps({"input": "v.npy", "lighting": "direct", **SMALL, **options}))
        return path

    return to_file


def test_a_recipe_builds_what_its_options_do(write, tmp_path, command):
    recipe = write(transfer="flame")
    field = slf.build(recipe, tmp_path / "a.slf")
    slf.build(tmp_path / "v.npy", tmp_path / "b.slf", transfer="flame", lighting="direct", **SMALL)
    command("build", recipe, "-o", tmp_path / "c.slf")
    (tmp_path / "again.json").write_text(command("info", field.path, "--recipe"))
    slf.build(tmp_path / "again.json", tmp_path / "d.slf")
    for name in "bcd":
        assert filecmp.cmp(field.path, tmp_path / f"{name}.slf", shallow=False), name


def test_rays_are_cast_within_the_sphere_of_a_recipe(write, tmp_path):
    recipe = write(center=[4, 4, 4], radius=2)
    field = slf.build(recipe, tmp_path / "a.slf")
    assert field.shape.sphere == ((4, 4, 4), 2)
    cast = slf.raycast(recipe, size=(32, 32))
    within = np.abs(field.render(size=(32, 32)) - cast).mean()
    assert within < 0.3 * np.abs(slf.raycast(write(), size=(32, 32)) - cast).mean()


def test_settings_replace_what_a_recipe_states(write, tmp_path):
    field = slf.build(write(transfer="flame"), tmp_path / "a.slf", finest_level=0)
    assert field.finest_level == 0 and field.shape.entry_side == SMALL["entry"]
    coarse = slf.build(write(), tmp_path / "b.slf", quality="draft", radius=9, codec="jpeg:50",
                       depth=False)
    assert (coarse.shape.entry_side, coarse.shape.exit_side, coarse.finest_level) == (8, 32, 1)


def test_states_of_a_recipe(write, tmp_path):
    recipe = write(states=[{"name": "whole"}, {"name": "flames", "transfer": "flame"}])
    field = slf.build(recipe, tmp_path / "a.slf")
    assert field.states == ("whole", "flames")
    own = slf.build(write("s.json"), tmp_path / "b.slf",
                    states=[{"name": "whole"}, {"name": "flames", "transfer": "flame"}])
    assert slf.diff(field, own).channels[0].differing == 0
    with pytest.raises(slf.UsageError, match="the recipe has states"):
        field.evaluate(recipe, 1, (8, 8))


@pytest.mark.parametrize("options, settings, message", [
    (dict(states=[{"name": "a"}]), {}, "the recipe makes states itself, without states="),
    (dict(each_time=True), {}, "each_time makes states itself, without states="),
    ({}, dict(each_time=True), "each_time makes states itself, without states="),
    ({}, dict(each_label=True), "each_label makes states itself, without states=")])
def test_states_beside_states_are_refused(write, tmp_path, options, settings, message):
    with pytest.raises(slf.UsageError, match=message):
        slf.build(write(**options), tmp_path / "a.slf", states=[{"name": "b"}], **settings)
    if options:
        with pytest.raises(slf.UsageError, match=message):
            slf.raycast(write(**options), size=(8, 8), states=[{"name": "b"}])


@pytest.mark.parametrize("settings", [
    dict(quality="draft", finest_level=1), dict(entry=8, quality="fine"),
    dict(projection="mip", lighting="direct")])
def test_settings_that_stand_for_each_other_are_refused(tmp_path, settings):
    with pytest.raises(slf.UsageError, match="not beside"):
        slf.build("scene:balls", tmp_path / "a.slf", **settings)


def test_only_builds_store_linear_radiance(write):
    lit = dict(lighting="shadowed", light_samples=4)
    plain = slf.raycast(write(**lit), size=(16, 16))
    assert (slf.raycast(write(**lit, color_type="half"), size=(16, 16)) == plain).all()


def test_mapped_labels_lie_where_the_array_lies(voxels, tmp_path):
    labels = np.zeros(voxels.shape, np.uint8)
    labels[2:9, 3:11, 4:12] = 7
    mapped = np.memmap(tmp_path / "labels.raw", np.uint8, "w+", shape=labels.shape)
    mapped[:] = labels
    shown = [slf.raycast(voxels, size=(24, 24), spacing=(1, 1, 2), origin=(50, 20, 10), labels=one,
                         lighting="direct") for one in (labels, mapped)]
    assert shown[0].any() and (shown[0] == shown[1]).all()
