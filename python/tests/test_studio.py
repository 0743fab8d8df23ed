"""slf.studio(): the page on which a recipe is made."""

import json
import urllib.request

import numpy as np
import pytest

import slf


def ask(address, body=None):
    data = None if body is None else json.dumps(body).encode()
    with urllib.request.urlopen(urllib.request.Request(address, data)) as answer:
        return answer.headers, answer.read()


def ball():
    z, y, x = np.mgrid[:20, :22, :24] - np.array([9.5, 10.5, 11.5]).reshape(3, 1, 1, 1)
    return np.clip(128 + 40 * (8 - np.sqrt(x * x + y * y + z * z)), 0, 255).astype(np.uint8)


def test_an_array_is_shown_saved_and_built(tmp_path):
    try:
        studio = slf.studio(ball(), tmp_path / "ball.slf", spacing=(1, 1, 2), exposure=0.5,
                            quality="draft")
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    with studio:
        page = studio.url + "studio/"
        look = {"page": 1, "serial": 1, "orbit": [30, 20, 3, 0, 0, 0], "size": [64, 64], "seen": 0}
        ask(page + "look", look)
        state = json.loads(ask(page + "state")[1])
        look |= {"seen": 4, "revision": state["revision"]}
        assert ask(page + "look", look)[0]["Content-Type"] == "image/png"
        assert state["shown"]["exposure"] == 0.5
        assert sum(state["histogram"]["counts"]) == ball().size
        options = dict(state["shown"], entry=2, exit=4, finest_level=0)
        del options["quality"]
        ask(page + "recipe", {"revision": state["revision"], "shown": options, "recipe": options})
        ask(page + "build", {})
        while not (build := json.loads(ask(page + "state")[1])["build"]).get("field"):
            assert "error" not in build, build
    with open(tmp_path / "ball.recipe.json") as file:
        assert json.load(file)["exposure"] == 0.5
    with slf.open(tmp_path / "ball.slf") as field:
        assert field.sphere.radius > 8
    studio.close()
    assert "studio at" in repr(studio)


def test_a_path_is_shown(tmp_path):
    np.save(tmp_path / "ball.npy", ball())
    try:
        studio = slf.studio(tmp_path / "ball.npy", tmp_path / "ball.slf")
    except slf.UnsupportedError as error:
        pytest.skip(str(error))
    with studio:
        page = studio.url + "studio/"
        state = json.loads(ask(page + "state")[1])
        assert state["name"] == "ball.npy"
        ask(page + "save", {})
    with open(tmp_path / "ball.recipe.json") as file:
        assert json.load(file) == {"input": "ball.npy"}


def test_scenes_of_python_are_refused(tmp_path):
    with pytest.raises(slf.UsageError, match="not for scenes"):
        slf.studio(slf.Scene(), tmp_path / "a.slf")
