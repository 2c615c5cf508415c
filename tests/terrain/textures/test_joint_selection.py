"""Geometry patches and texture patches are chosen together: alpha and gamma within their thresholds, and no finer than
that, as the paper's recursion would choose them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.culling import Culler
from terrain.algorithms.multiresolution import FINEST_LEVEL, MARGIN, load_tree, select_patches
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.renderers.multiresolution import MultiresolutionSettings
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.select import select_levels, split_near, texel_errors_px2
from terrain.textures.tree import TextureTree


def hills(rows: int = 193, cols: int = 257) -> Heightfield:
    row, col = np.indices((rows, cols))
    heights = 60 * np.sin(row / 9.0) * np.cos(col / 13.0) + np.random.default_rng(0).normal(0, 1, (rows, cols))
    return Heightfield(heights.astype(np.float32), (10.0, 10.0))


TERRAIN = hills()
SCENE = open_scene(TERRAIN)
TREE, CULLER = load_tree(TERRAIN), Culler(SCENE, FINEST_LEVEL)
IMAGE = TextureTree((5000, 4000), whole_extent(TERRAIN), TERRAIN.spacing_m)


@settings(max_examples=30)
@given(
    x=st.floats(-300, 2900), z=st.floats(-300, 2300), y=st.floats(5, 3000), yaw=st.floats(0, 360),
    pitch=st.floats(-90, 10), tau=st.floats(0.25, 8), tau_px2=st.floats(0.25, 16),
)  # fmt: skip
def test_alpha_and_gamma_are_within_their_thresholds_and_no_finer(x, z, y, yaw, pitch, tau, tau_px2):
    frame = Frame(Camera((x, y, z), yaw, pitch), (1280, 720))
    patches, nodes = select_patches(TREE, CULLER, frame, tau)
    lower, upper = CULLER.boxes(nodes)
    # Alpha by hand: a segment of the error's length at the nearest point of the box, seen squarely.
    nearest = np.clip(frame.eye_m, lower, upper)
    away = np.maximum(np.linalg.norm(nearest - frame.eye_m, axis=1), 1e-9)
    error_m, ladder = TREE.rtin.ladder.error_m(patches.rung), TREE.rtin.ladder
    alpha_px = frame.pixels_per_radian * error_m / away
    assert ((alpha_px <= tau * (1 + 1e-6)) | (patches.rung == 0)).all()
    coarser_px = frame.pixels_per_radian * ladder.error_m(patches.rung + 1) / np.maximum(nodes.distance_m, 1e-9)
    assert ((coarser_px > MARGIN * tau * (1 - 1e-6)) | (patches.rung == 254)).all()

    # Gamma by the paper's recursion: descend while it is above the threshold, climb while the parent's is not.
    lower, upper = split_near(IMAGE, lower, upper, frame, tau_px2)
    level, _ = select_levels(IMAGE, lower, upper, frame, tau_px2)
    gamma, _ = texel_errors_px2(IMAGE, lower, upper, frame)
    for i in range(0, len(level), 7):
        climbed = 0
        while climbed < IMAGE.top_level and gamma[i] * 4.0 ** (climbed + 1) <= tau_px2:
            climbed += 1
        assert level[i] == climbed
        assert gamma[i] * 4.0 ** level[i] <= tau_px2 or level[i] == 0


@pytest.fixture
def stage(gpu):
    stage = Stage(gpu, SCENE, "multiresolution", MultiresolutionSettings())
    yield stage
    stage.release()


def test_textures_are_chosen_for_the_patches_drawn_and_look_as_with_any_renderer(stage, monkeypatch):
    rng = np.random.default_rng(5)
    pixels = np.kron(rng.integers(0, 255, (40, 50, 3)), np.ones((20, 20, 1))).astype(np.uint8)
    stage.drape.trees.add(ArraySource("squares", pixels, whole_extent(TERRAIN)))
    asked = []
    update = stage.drape.trees.update
    monkeypatch.setattr(
        stage.drape.trees, "update", lambda frame, lower, *rest: (asked.append(lower), update(frame, lower, *rest))
    )
    camera = Camera((1280.0, 260.0, 1900.0), 10.0, -12.0)
    picture = stage.render(camera, (240, 150))
    np.testing.assert_array_equal(asked[-1], stage.renderer.boxes().lower_m)
    assert len(asked[-1]) > 50
    stage.set_renderer("reference")
    reference = stage.render(camera, (240, 150))
    assert len(asked[-1]) < 5000
    assert (np.abs(picture.astype(int) - reference).max(axis=2) > 40).mean() < 0.02
    assert picture.std() > 20
