"""Stages that are released after the test that asked for them."""

from __future__ import annotations

import pytest

from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage


@pytest.fixture
def stages(gpu):
    """``stages("painter", terrain, mode="correct")``: a stage of a terrain and an algorithm."""
    made = []

    def make(algorithm, terrain, planes=(), **chosen):
        made.append(Stage(gpu, open_scene(terrain, planes), algorithm, RENDERERS[algorithm].Settings(**chosen)))
        return made[-1]

    yield make
    for stage in made:
        stage.release()
