"""Every mistake in a scene is one clear error, with its place."""

from __future__ import annotations

import pytest

import granphon as gp
from granphon.base.errors import SceneError
from tests.scene.mistakes import MISTAKES


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_a_scene_is_one_error(name):
    text, place, *words = MISTAKES[name]
    with pytest.raises(SceneError) as caught:
        gp.Scene.from_text(text, "scene.yaml")
    message = str(caught.value)
    assert message.startswith(f"scene.yaml:{place}")
    assert "\n" not in message
    for word in words:
        assert word in message
