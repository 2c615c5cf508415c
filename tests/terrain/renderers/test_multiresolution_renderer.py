"""What the multiresolution renderer draws is within its tolerance, without holes, and within the grid."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.ndimage import minimum_filter

from terrain.breaklines import Breaklines
from terrain.camera import Camera
from terrain.gpu.context import GL_CLIP_DISTANCE0
from terrain.heightfield import Heightfield
from terrain.renderers.multiresolution import MultiresolutionRenderer, MultiresolutionSettings
from terrain.scene import open_scene
from terrain.stage import Stage

SIZE = (240, 150)


def ridges(rows: int, cols: int, spacing: float = 10.0) -> Heightfield:
    rng = np.random.default_rng(7)
    row, col = np.indices((rows, cols))
    heights = 120 * np.abs(np.sin(row / 11.0) * np.cos(col / 17.0)) + rng.normal(0, 2, (rows, cols))
    return Heightfield(heights.astype(np.float32), (spacing, spacing))


def cliffs() -> Heightfield:
    heights = np.zeros((97, 97), np.float32)
    heights[30:60, 20:75] = 80.0
    heights[64:70, 40:90] = 25.0
    return Heightfield(heights, (10.0, 10.0))


@pytest.fixture
def stage_of(stages):
    return partial(stages, "multiresolution")


def views(terrain: Heightfield) -> list[Camera]:
    width, depth = terrain.extent_m
    peak = float(terrain.heights_m.max())
    low = float(terrain.heights_at(width * 0.3, depth * 0.6)) + 12
    return [
        Camera((width * 0.5, peak + 30, depth * 1.02), 0, -12),
        Camera((width * 0.3, low, depth * 0.6), 70, -5),
        Camera((width * 0.8, peak + 400, depth * 0.1), 215, -40),
        Camera((width * 0.5, peak + 900, depth * 0.5), 10, -90),
    ]


def positions(stage: Stage, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """World positions of the covered pixels (n, 3), and which pixels are covered."""
    world = stage.positions(camera, SIZE)
    covered = np.isfinite(world[..., 0])
    return world[covered], covered


def errors_px(stage: Stage, camera: Camera) -> np.ndarray:
    """Distance to the surface of each covered pixel, to first order, on the screen."""
    terrain = stage.scene.heightfield
    world, _ = positions(stage, camera)
    (dx, dz), (width, depth) = terrain.spacing_m, terrain.extent_m
    x, z = np.clip(world[:, 0], 0, width), np.clip(world[:, 2], 0, depth)
    height, step = terrain.heights_at(x, z), 1e-4
    east = (terrain.heights_at(np.where(x > dx, x - step, x + step), z) - height) / step
    south = (terrain.heights_at(x, np.where(z > dz, z - step, z + step)) - height) / step
    up = 1 / np.sqrt(1 + east**2 + south**2)
    distance = np.linalg.norm(world - camera.eye_m, axis=1)
    return camera.pixels_per_radian(SIZE[1]) * np.abs(world[:, 1] - height) * up / distance


def holes_px(stage: Stage, reference: Stage, camera: Camera) -> int:
    """Pixels of sky where the reference has ground, there and as far around as its outline may shift."""
    reach = 2 * int(np.ceil(stage.renderer.settings.tolerance_px)) + 1
    inside = minimum_filter(positions(reference, camera)[1], max(reach, 3), mode="constant", cval=0)
    return int(np.count_nonzero(inside & ~positions(stage, camera)[1]))


@pytest.fixture
def reference_of(gpu) -> Iterator:
    stages = []

    def make(terrain: Heightfield) -> Stage:
        stages.append(Stage(gpu, open_scene(terrain), "reference"))
        return stages[-1]

    yield make
    for stage in stages:
        stage.release()


@pytest.mark.parametrize("terrain", [ridges(193, 257), ridges(100, 157), cliffs()], ids=["ridges", "odd", "cliffs"])
@pytest.mark.parametrize("tau", [0.5, 4.0])
def test_every_pixel_is_within_the_tolerance_and_none_is_missing(stage_of, reference_of, terrain, tau):
    stage, reference = stage_of(terrain, tolerance_px=tau), reference_of(terrain)
    for camera in views(terrain):
        assert holes_px(stage, reference, camera) == 0
        assert errors_px(stage, camera).max() <= tau * 1.02 + 0.01


def test_without_walls_there_are_holes(stage_of, reference_of):
    terrain = ridges(193, 257)
    stage, reference = stage_of(terrain, tolerance_px=8.0, walls=False), reference_of(terrain)
    assert sum(holes_px(stage, reference, camera) for camera in views(terrain)) > 0


@pytest.mark.parametrize("shape", [(2, 2), (2, 40), (17, 17), (18, 33), (129, 130)])
def test_any_grid_is_drawn_whole_and_never_beyond_its_edges(stage_of, reference_of, shape):
    terrain = ridges(*shape)
    stage, reference = stage_of(terrain, tolerance_px=1.0), reference_of(terrain)
    width, depth = terrain.extent_m
    for camera in views(terrain):
        world, covered = positions(stage, camera)
        assert (world[:, [0, 2]] >= -0.01).all()
        assert (world[:, [0, 2]] <= [width + 0.01, depth + 0.01]).all()
        assert holes_px(stage, reference, camera) == 0
    assert covered.any()


def test_tins_save_triangles_keep_the_tolerance_and_never_change_a_view(stage_of, reference_of):
    terrain = ridges(193, 257)
    stage, reference = stage_of(terrain, tolerance_px=2.0, tins=True), reference_of(terrain)
    without = stage_of(terrain, tolerance_px=2.0)
    camera, other = views(terrain)[:2]
    first = stage.render(camera, SIZE)
    without.render(camera, SIZE)
    assert stage.renderer.stats.extra["TINs"] > 0
    assert stage.renderer.stats.triangles < without.renderer.stats.triangles
    stage.render(other, SIZE)
    np.testing.assert_array_equal(stage.render(camera, SIZE), first)
    assert holes_px(stage, reference, camera) == 0
    assert errors_px(stage, camera).max() <= 2.04


def test_tins_made_aside_arrive_within_the_same_bound(stage_of, reference_of):
    terrain = ridges(193, 257)
    stage, reference = stage_of(terrain, tolerance_px=2.0, tins=True, preview=True), reference_of(terrain)
    camera = views(terrain)[0]
    renderer = stage.renderer
    assert isinstance(renderer, MultiresolutionRenderer)
    renderer.finish()
    arrived = 0
    for _ in range(200):
        stage.render(camera, SIZE)
        assert renderer.stats.extra["TINs"] >= arrived
        arrived = int(renderer.stats.extra["TINs"])
        renderer.finish()
        if not renderer.stats.pending:
            break
    assert arrived > 0
    assert not renderer.stats.pending
    assert errors_px(stage, camera).max() <= 2.04
    assert holes_px(stage, reference, camera) == 0


def test_frozen_selection_is_drawn_from_another_eye(stage_of, reference_of):
    terrain = ridges(193, 257)
    stage, reference = stage_of(terrain, tolerance_px=1.0, horizon=False), reference_of(terrain)
    above, beside = views(terrain)[3], views(terrain)[0]
    stage.freeze(stage.frame(above, SIZE))
    triangles = stage.renderer.stats.triangles
    assert holes_px(stage, reference, above) == 0
    _, covered = positions(stage, beside)
    assert covered.any()
    assert stage.renderer.stats.triangles == triangles


def test_levels_view_draws_the_same_pixels_and_leaves_the_picture_alone(stage_of):
    terrain = ridges(193, 257)
    stage = stage_of(terrain, tolerance_px=1.0)
    camera = views(terrain)[0]
    before = stage.render(camera, SIZE)
    levels = stage.render(camera, SIZE, "levels")
    assert len(np.unique(levels.reshape(-1, 3), axis=0)) > 3
    np.testing.assert_array_equal(stage.render(camera, SIZE), before)


def test_boxes_hold_the_drawn_surface(stage_of):
    terrain = ridges(193, 257)
    stage = stage_of(terrain, tolerance_px=4.0, walls=False, horizon=False)
    camera = views(terrain)[3]
    world, _ = positions(stage, camera)
    boxes = stage.renderer.boxes()
    assert len(boxes.level) == stage.renderer.stats.extra["patches"]
    slack = 0.05
    inside = np.zeros(len(world), bool)
    for lower, upper in zip(boxes.lower_m - slack, boxes.upper_m + slack, strict=True):
        inside |= ((world >= lower) & (world <= upper)).all(axis=1)
    assert inside.all()


def test_preview_is_replaced_by_the_tree(stage_of):
    terrain = ridges(193, 257)
    stage = stage_of(terrain, tolerance_px=1.0, preview=True)
    camera = views(terrain)[0]
    assert stage.render(camera, SIZE).any()
    renderer = stage.renderer
    assert isinstance(renderer, MultiresolutionRenderer)
    renderer.finish()
    assert errors_px(stage, camera).max() <= 1.03
    assert renderer.stats.prepare_s > 0


def test_drawing_raises_no_gl_error_and_leaves_clipping_off(stage_of, gpu):
    stage = stage_of(ridges(50, 70))
    camera = views(stage.scene.heightfield)[0]
    stage.render(camera, SIZE)
    frame = stage.frame(camera, SIZE)
    assert gpu.ctx.error is not None  # forget what came before
    for output in ("shaded", "position", "levels", "normals", "overdraw", "flat"):
        stage.renderer.select(frame)
        stage.renderer.draw(replace(frame, output=output))
        assert gpu.ctx.error == "GL_NO_ERROR", output
    is_enabled = gpu.function("glIsEnabled", ctypes.c_ubyte, ctypes.c_uint)
    assert is_enabled is not None
    assert not is_enabled(GL_CLIP_DISTANCE0)


def test_nothing_in_sight_draws_nothing(stage_of):
    terrain = ridges(50, 50)
    stage = stage_of(terrain)
    assert not positions(stage, Camera((0.0, 5000.0, 0.0), 0, 60))[1].any()
    assert stage.renderer.stats.triangles == 0


def road(terrain: Heightfield, rise_m: float) -> Breaklines:
    """A line across the terrain that rises above its ground."""
    points = np.array([[20.0, 30.5], [90.25, 80.0], [200.5, 90.75]])
    x, z = points.T * np.array(terrain.spacing_m)[:, None]
    return Breaklines((np.column_stack([points, terrain.heights_at(x, z) + rise_m]),))


def test_lines_are_drawn_with_their_heights_and_leave_no_hole(gpu, reference_of):
    terrain = ridges(193, 257)
    scene = open_scene(terrain, breaklines=road(terrain, 40.0))
    stage = Stage(gpu, scene, "multiresolution", MultiresolutionSettings(tolerance_px=1.0))
    reference = reference_of(terrain)
    try:
        for camera in views(terrain):
            assert holes_px(stage, reference, camera) == 0
        above = views(terrain)[3]
        world, _ = positions(stage, above)
        begin, end = scene.breaklines.lines[0][:2] * [10.0, 10.0, 1.0]
        step = (end - begin)[:2]
        t = (world[:, [0, 2]] - begin[:2]) @ step / (step @ step)
        off_m = np.abs((world[:, [0, 2]] - begin[:2]) @ [-step[1], step[0]]) / np.hypot(*step)
        on_line = (off_m < 0.5) & (t > 0) & (t < 1)
        assert on_line.sum() > 5
        off_line_m = np.abs(world[on_line, 1] - begin[2] - t[on_line] * (end - begin)[2])
        assert np.median(off_line_m) < 10  # half a metre aside the flank is that much lower
        rise = world[:, 1] - terrain.heights_at(*np.clip(world[:, [0, 2]], 0, terrain.extent_m).T)
        assert np.abs(rise[on_line]).max() > 30
        assert (np.abs(rise) > 5).mean() < 0.1
        assert stage.renderer.stats.extra["patches with lines"] > 10
        far = Camera((1200.0, 400_000.0, 900.0), 0, -90, 0, 10.0)  # the line is less than half a pixel high
        stage.render(far, SIZE)
        assert stage.renderer.stats.extra["patches with lines"] == 0
    finally:
        stage.release()


def test_a_line_that_is_drawn_only_near_by_ends_without_a_gap(gpu, reference_of):
    terrain = ridges(193, 257)
    camera = Camera((250.0, 190.0, 250.0), 105, -12)
    for rise in (3.0, -3.0):
        scene = open_scene(terrain, breaklines=road(terrain, rise))
        stage = Stage(gpu, scene, "multiresolution", MultiresolutionSettings(tolerance_px=8.0))
        try:
            assert holes_px(stage, reference_of(terrain), camera) == 0
            refined = stage.renderer._pool.tree.refined  # type: ignore[attr-defined]
            assert 0 < stage.renderer.stats.extra["patches with lines"] < len(refined.patches)
        finally:
            stage.release()
