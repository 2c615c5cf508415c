"""The approximation tree chooses patches that tile what is seen, each within the tolerance at its distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.culling import Culler
from terrain.algorithms.multiresolution import (
    COARSEST_LEVEL,
    FINEST_LEVEL,
    PREVIEW_STRIDE,
    build_preview,
    find_microstructures,
    load_tree,
    select_patches,
)
from terrain.algorithms.rtin import build_rtin
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.scene import Scene, open_scene


def hills(rows: int, cols: int, seed: int = 0, spacing: float = 10.0) -> Scene:
    rng = np.random.default_rng(seed)
    row, col = np.indices((rows, cols))
    heights = 60 * np.sin(row / 9.0) * np.cos(col / 13.0) + rng.normal(0, 1, (rows, cols))
    return open_scene(Heightfield(heights.astype(np.float32), (spacing, spacing)))


def look(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = -20.0) -> Frame:
    return Frame(Camera((x, y, z), yaw, pitch), (1280, 720))


@settings(max_examples=20)
@given(
    rows=st.integers(2, 300), cols=st.integers(2, 300), yaw=st.floats(0, 360), pitch=st.floats(-90, 20),
    x=st.floats(-500, 3500), z=st.floats(-500, 3500), y=st.floats(1, 4000), tau=st.floats(0.25, 8),
)  # fmt: skip
def test_patches_keep_the_tolerance_and_never_overlap(rows, cols, yaw, pitch, x, z, y, tau):
    scene = hills(rows, cols)
    tree, culler, frame = load_tree(scene.heightfield), Culler(scene, FINEST_LEVEL), look(x, y, z, yaw, pitch)
    patches, nodes = select_patches(tree, culler, frame, tau)
    alpha_px = tree.rtin.ladder.error_m(patches.rung) * frame.pixels_per_radian / np.maximum(nodes.distance_m, 1e-9)
    assert ((alpha_px <= tau * (1 + 1e-6)) | (patches.rung == 0)).all()
    assert ((patches.level >= FINEST_LEVEL) & (patches.level <= tree.coarsest_level)).all()
    lower, upper = culler.boxes(nodes)
    reach = np.linalg.norm(np.maximum(np.maximum(lower - frame.eye_m, frame.eye_m - upper), 0), axis=1)
    assert (nodes.distance_m <= reach + 1e-6).all()  # alpha is taken at the nearest point of the box, or nearer
    ground = np.zeros([-(-n // 8) for n in (rows, cols)], int)
    for level, row, col in zip(patches.level, patches.row, patches.col, strict=True):
        span = 1 << (level - FINEST_LEVEL)
        ground[row * span : (row + 1) * span, col * span : (col + 1) * span] += 1
    assert ground.max(initial=0) <= 1


def test_looking_down_from_afar_covers_the_whole_grid_with_coarse_patches():
    scene = hills(200, 300)
    tree, culler = load_tree(scene.heightfield), Culler(scene, FINEST_LEVEL)
    patches, nodes = select_patches(tree, culler, look(1500, 60_000, 1000, pitch=-90), 1.0)
    assert set(patches.level.tolist()) == {COARSEST_LEVEL}
    assert len(patches.level) == 2 * 3
    assert (np.diff(nodes.distance_m) >= 0).all()


def test_wider_tolerance_never_takes_a_finer_rung():
    scene = hills(257, 257)
    tree, culler, frame = load_tree(scene.heightfield), Culler(scene, FINEST_LEVEL), look(1300, 200, 2500)
    rungs = [select_patches(tree, culler, frame, tau)[0].rung.sum() for tau in (0.25, 0.5, 1, 2, 4, 8)]
    assert rungs == sorted(rungs)
    assert rungs[0] < rungs[-1]


def test_microstructures_are_where_the_ground_is_rough():
    heights = np.zeros((257, 257), np.float32)
    heights[64:96, 128:160] = np.random.default_rng(1).normal(0, 5, (32, 32))
    rtin = build_rtin(heights, (1.0, 1.0), 7)
    expected = np.zeros((32, 32), bool)
    expected[8:12, 16:20] = True
    np.testing.assert_array_equal(find_microstructures(rtin, share=16 / 1024)[0], expected)
    assert not any(flags.any() for flags in find_microstructures(build_rtin(heights * 0, (1.0, 1.0), 7)))


def test_about_the_papers_share_of_patches_are_microstructures():
    finest = find_microstructures(load_tree(hills(513, 513).heightfield).rtin)[0]
    assert 0.13 < finest.mean() < 0.17


def test_tree_from_the_cache_equals_the_built_one(own_cache):
    scene = hills(600, 520)
    built = load_tree(scene.heightfield)
    assert list(own_cache.glob("multiresolution/*.npz"))
    kept = load_tree(replace(scene.heightfield))
    np.testing.assert_array_equal(built.rtin.drop_rung, kept.rtin.drop_rung)
    assert built.rtin.ladder == kept.rtin.ladder


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (5, 300), (257, 257), (259, 130), (258, 1027)])
def test_preview_covers_the_patches_of_the_whole_grid(rows, cols):
    scene = hills(rows, cols)
    preview = build_preview(scene.heightfield)
    padded = [(n - 1) * PREVIEW_STRIDE for n in preview.rtin.drop_rung.shape]
    assert padded[0] >= rows - 1
    assert padded[1] >= cols - 1
    assert preview.coarsest_level == load_tree(scene.heightfield).coarsest_level
