"""The debug views: what they show can be counted."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.views import VIEWS, frustum_segments, overdraw_figures

SIZE_PX = (240, 160)


@pytest.fixture
def plane(gpu):
    stage = Stage(gpu, open_scene(Heightfield(np.zeros((33, 33), np.float32), (10.0, 10.0))), "reference")
    yield stage
    stage.release()


@pytest.fixture
def ridge(gpu):
    heights = np.zeros((129, 129), np.float32)
    heights[64] = 300.0
    stage = Stage(gpu, open_scene(Heightfield(heights, (10.0, 10.0))), "reference")
    yield stage
    stage.release()


DOWN = Camera((160.0, 200.0, 160.0), 0.0, -90.0)


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_draws_something_of_its_own(ridge, view):
    camera = Camera((640.0, 500.0, 1300.0), 0.0, -25.0)
    shaded = ridge.render(camera, SIZE_PX)
    picture = ridge.render(camera, SIZE_PX, view)
    assert picture.std() > 3.0
    if view != "shaded":
        assert (np.abs(picture.astype(int) - shaded).max(axis=-1) > 12).mean() > 0.01


def test_a_plane_seen_from_above_is_drawn_once(plane):
    assert plane.overdraw(DOWN, SIZE_PX) == (1.0, 1.0)


def test_overdraw_figures_count_covered_pixels_only():
    assert overdraw_figures(np.array([[0, 2], [4, 0]], np.float32)) == (3.0, 4.0)
    assert overdraw_figures(np.zeros((2, 2), np.float32)) == (0.0, 0.0)


def test_normals_of_a_plane_point_up(plane):
    picture = plane.render(DOWN, SIZE_PX, "normals")
    assert np.abs(picture[80, 120].astype(int) - [128, 128, 255]).max() <= 1


def test_lines_behind_a_ridge_are_hidden(gpu):
    # Two terrains that differ only behind a ridge look the same from the other side of it.
    rough = np.random.default_rng(1).uniform(0.0, 30.0, (40, 129)).astype(np.float32)
    pictures = []
    for behind in (np.zeros_like(rough), rough):
        heights = np.zeros((129, 129), np.float32)
        heights[64], heights[:40] = 300.0, behind
        stage = Stage(gpu, open_scene(Heightfield(heights, (10.0, 10.0))), "reference")
        camera = Camera((640.0, 20.0, 900.0), 0.0, 25.0)
        pictures.append(stage.render(camera, SIZE_PX, "wireframe").astype(int))
        shaded = stage.render(camera, SIZE_PX).astype(int)
        stage.release()
    assert (np.abs(pictures[0] - shaded).max(axis=-1) > 10).mean() > 0.05  # there are lines
    differs = np.abs(pictures[0] - pictures[1]).max(axis=-1) > 6
    assert differs.mean() < 0.005  # the light of hidden hills reaches over the ridge's ends


def test_lines_are_plain_near_the_eye_and_fade_where_they_are_dense(gpu):
    # Cells of 10 m, seen from 30 m above: some 30 px wide at the bottom, far below a pixel at the horizon.
    terrain = Heightfield(np.zeros((513, 513), np.float32), (10.0, 10.0))
    stage = Stage(gpu, open_scene(terrain), "reference")
    camera = Camera((2560.0, 30.0, 5100.0), 0.0, -10.0)
    shaded, wires = (
        stage.render(camera, SIZE_PX, view).astype(float).mean(axis=-1) for view in ("shaded", "wireframe")
    )
    positions = stage.positions(camera, SIZE_PX)
    stage.release()
    distance_m = np.linalg.norm(positions - camera.eye_m, axis=-1)
    kept = wires / np.maximum(shaded, 1.0)
    near, far = kept[distance_m < 80.0], kept[distance_m > 2000.0]
    assert near.min() < 0.6, "a line is seen"
    assert np.median(near) > 0.95, "the ground between lines is as it was"
    assert far.mean() > 0.75, "where all is lines the ground is still seen"
    assert kept[np.isnan(distance_m)].mean() > 0.99, "the sky has no lines"


def test_boxes_frame_the_terrain(plane):
    shaded = plane.render(DOWN, SIZE_PX).astype(int)
    boxes = plane.render(DOWN, SIZE_PX, "boxes").astype(int)
    changed = np.abs(boxes - shaded).max(axis=-1) > 30
    assert 0 < changed.mean() < 0.2


def test_a_frozen_selection_does_not_follow_the_eye(ridge):
    near = Camera((640.0, 320.0, 1100.0), 0.0, -5.0)
    away = Camera((640.0, 320.0, 1100.0), 180.0, -5.0)
    ridge.render(near, SIZE_PX)
    seen_ahead = ridge.renderer.stats.triangles
    ridge.freeze(ridge.frame(near, SIZE_PX))
    ridge.render(away, SIZE_PX)
    assert ridge.renderer.stats.triangles == seen_ahead
    ridge.thaw()
    ridge.render(away, SIZE_PX)
    assert ridge.renderer.stats.triangles != seen_ahead


def test_the_frozen_frustum_is_drawn(ridge):
    low, high = Camera((640.0, 320.0, 1100.0), 0.0, -5.0), Camera((640.0, 1500.0, 1300.0), 0.0, -60.0)
    ridge.freeze(ridge.frame(low, SIZE_PX))
    frozen = ridge.render(high, SIZE_PX).astype(int)
    orange = (frozen[..., 0] > 200) & (frozen[..., 2] < 110)
    assert orange.sum() > 50


def test_the_corners_of_a_frustum_lie_on_its_side_planes():
    camera = Camera((1.0, 2.0, 3.0), 30.0, -20.0, 10.0, 50.0)
    points = frustum_segments(camera, 1.5, 100.0).reshape(-1, 3) - camera.eye_m
    distance = points @ camera.side_planes(1.5).T
    assert distance.min() > -1e-9
    assert np.isclose((points @ camera.forward).max(), 100.0)
