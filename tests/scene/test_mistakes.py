"""Every mistake in a scene is one clear error, with its place."""

from __future__ import annotations

import pytest

import granphon as gp
from granphon.base.errors import SceneError
from tests.scene.mistakes import LATE, MISTAKES


def assert_told(message: str, place: str, words: list[str]) -> None:
    """One line, which begins with the place and has the words."""
    assert message.startswith(f"scene.yaml:{place}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


def check(text: str) -> None:
    """What ``granphon check`` does with a scene."""
    gp.Scene.from_text(text, "scene.yaml").cost()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_a_scene_is_one_error(name):
    text, place, *words = MISTAKES[name]
    with pytest.raises(SceneError) as caught:
        check(text)
    assert_told(str(caught.value), place, words)


@pytest.mark.parametrize("width", ["0 %", "1e400 %"])
def test_a_width_in_per_cent_is_only_converted_to_a_length_that_can_be(width):
    text, place, *_ = MISTAKES["width in per cent"]
    with pytest.raises(SceneError) as caught:
        check(text.replace("1 %", width))
    assert_told(str(caught.value), place, [width])
    assert "write" not in str(caught.value)


@pytest.mark.parametrize("name", LATE)
def test_a_mistake_that_a_run_finds_is_one_error(name, tmp_path):
    text, place, *words = LATE[name]
    scene = gp.Scene.from_text(text, "scene.yaml")
    with pytest.raises(SceneError) as caught:
        scene.run(tmp_path / "out", figures=False)
    assert_told(str(caught.value), place, words)
    assert not list(tmp_path.glob("out/*.nc"))


@pytest.mark.parametrize("width", ["-1 %", "0 %"])
def test_a_width_in_per_cent_that_is_not_above_zero_has_no_length(width):
    text, _, _, _, length = MISTAKES["width in per cent"]
    with pytest.raises(SceneError) as caught:
        check(text.replace("1 %", width))
    assert "9: packing.spread.uniform" in str(caught.value)
    assert length.strip("'") not in str(caught.value)
    assert "0 m" not in str(caught.value)
