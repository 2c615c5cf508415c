"""The waste meter on scenes whose answer is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from generators import finish

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.accuracy import AccuracyMeter
from terrain.measure.waste import greedy_triangles, measure_waste, small_share, visible_points
from terrain.scene import open_scene
from terrain.stage import Stage

SIZE_PX = (240, 160)
SPACING_M = 10.0


def plane_from(gpu, height_m):
    """A plane of 257 x 257 posts, its centre seen from straight above."""
    stage = Stage(gpu, open_scene(Heightfield(np.zeros((257, 257), np.float32), (SPACING_M, SPACING_M))), "reference")
    return stage, Camera((1280.0, height_m, 1280.0), 0.0, -90.0)


def cell_px(camera):
    """Edge of a cell on the screen."""
    return camera.pixels_per_radian(SIZE_PX[1]) * SPACING_M / camera.position_m[1]


def count(points, weight, error_px):
    return finish(greedy_triangles(points, np.broadcast_to(weight, len(points)), error_px))


def grid_points(height, side=60):
    z, x = np.mgrid[0 : 1 : side * 1j, 0 : 1 : side * 1j] * 100.0
    return np.column_stack([x.ravel(), height(x, z).ravel(), z.ravel()])


@pytest.mark.parametrize(("height_m", "is_small"), [(100.0, False), (700.0, False), (1200.0, True), (2500.0, True)])
def test_triangles_are_small_where_there_are_several_to_a_pixel(gpu, height_m, is_small):
    stage, camera = plane_from(gpu, height_m)
    area_px = cell_px(camera) ** 2 / 2
    assert area_px < 0.7 if is_small else area_px > 1.9
    share = small_share(stage.corners(camera, SIZE_PX))
    assert share > 0.95 if is_small else share < 0.05
    stage.release()


def test_every_triangle_has_three_corners(gpu):
    stage, camera = plane_from(gpu, 2500.0)  # the whole plane is in the picture, in 64 pixels of margin
    corners = stage.corners(camera, SIZE_PX)
    assert corners.sum() == 3 * 2 * 256**2 == 3 * stage.renderer.stats.triangles
    stage.release()


def test_corners_leave_the_pictures_after_them_as_they_are(gpu):
    stage, camera = plane_from(gpu, 300.0)
    before = stage.render(camera, SIZE_PX)
    stage.corners(camera, SIZE_PX)
    assert np.array_equal(stage.render(camera, SIZE_PX), before)
    stage.release()


def test_a_picture_without_triangles_has_no_share_of_small_ones():
    assert small_share(np.zeros((20, 20), np.float32)) is None


@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_a_plane_needs_two_triangles(slope):
    assert count(grid_points(lambda x, z: slope * x - 0.3 * slope * z), 1.0, 0.01) <= 2


def test_a_roof_needs_few_and_a_bowl_more_the_nearer_one_looks():
    roof = count(grid_points(lambda x, z: np.abs(x - z)), 1.0, 0.5)
    assert 2 < roof < 60
    bowl = grid_points(lambda x, z: ((x - 50) ** 2 + (z - 50) ** 2) / 100)
    counts = [count(bowl, 1.0, error) for error in (2.0, 1.0, 0.5)]
    # A quadratic surface is approximated twice as well by twice as many triangles.
    assert all(1.4 < finer / coarser < 2.9 for coarser, finer in pairwise(counts))


def test_what_counts_twice_as_much_needs_as_much_as_half_the_error():
    bowl = grid_points(lambda x, z: ((x - 50) ** 2 + (z - 50) ** 2) / 100)
    assert count(bowl, 2.0, 1.0) == count(bowl, 1.0, 0.5)


def test_nothing_seen_needs_nothing():
    assert count(np.zeros((0, 3)), 1.0, 1.0) == 0


def test_weights_are_the_pixels_of_a_metre(gpu):
    stage, camera = plane_from(gpu, 500.0)
    meter = AccuracyMeter(stage, SIZE_PX)
    points, weight = visible_points(stage, meter, stage.renderer, camera)
    distance_m = np.linalg.norm(points - camera.eye_m, axis=1)
    np.testing.assert_allclose(weight, camera.pixels_per_radian(SIZE_PX[1]) / distance_m, rtol=1e-3)
    assert len(points) == pytest.approx(SIZE_PX[0] * SIZE_PX[1] / 16, rel=0.05)
    meter.release()
    stage.release()


def test_a_plane_drawn_post_by_post_is_all_waste(gpu):
    stage, camera = plane_from(gpu, 300.0)
    meter = AccuracyMeter(stage, SIZE_PX)
    waste = finish(measure_waste(stage, stage.renderer, meter, camera))
    assert waste.covered_px == SIZE_PX[0] * SIZE_PX[1]
    assert (waste.overdraw_mean, waste.overdraw_max) == (1.0, 1.0)
    assert waste.triangles > 1000 > waste.needed
    assert waste.needed <= 2
    assert waste.ray_steps is None
    meter.release()
    stage.release()
