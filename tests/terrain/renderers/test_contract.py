"""What every renderer promises (terrain/renderers/base.py), the same for all in the table: nobody is named here."""

from __future__ import annotations

import ctypes
from dataclasses import fields, replace
from typing import get_args

import numpy as np
import pytest
from scipy import ndimage

from terrain.camera import Camera
from terrain.frame import Output
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield, fill_holes
from terrain.measure.accuracy import AccuracyMeter
from terrain.measure.hidden import count_misplaced, shown_distances
from terrain.pyramid import build_pyramid
from terrain.renderers import RENDERERS
from terrain.renderers.base import Settings
from terrain.scene import Scene
from terrain.stage import Stage
from terrain.views import VIEWS

SIZE = (128, 96)
ALL = pytest.mark.parametrize("name", RENDERERS)


def make_scene(rows: int = 70, cols: int = 90, holes: bool = False) -> Scene:
    """Hills and a cliff; with holes, a disc without data in the middle."""
    z, x = np.mgrid[:rows, :cols] * 0.13
    heights = (40 * np.sin(x) * np.cos(0.8 * z) + 15 * np.sin(2.7 * x + z)).astype(np.float32)
    heights[rows // 2 :, : cols // 3] += 60
    disc = np.hypot(*(np.mgrid[:rows, :cols] - np.array([rows, cols])[:, None, None] / 2)) < 15 if holes else None
    if disc is not None:
        heights = fill_holes(heights, disc)
    field = Heightfield(heights, (10.0, 12.0), disc)
    return Scene(field, build_pyramid(field.heights_m))


SCENE = make_scene()
VIEWS_OF_HILLS = [
    Camera((450.0, 700.0, 420.0), 0.0, -90.0),
    Camera((60.0, 160.0, 800.0), 40.0, -15.0),
    Camera((455.0, 95.0, 300.0), 200.0, -5.0, 20.0, 80.0),
    Camera((-300.0, 250.0, 1100.0), 35.0, -12.0, 0.0, 40.0),
]


@pytest.fixture
def stage(gpu, name):
    stage = Stage(gpu, SCENE, name)
    yield stage
    stage.release()


def depth_misses(stage: Stage, meter: AccuracyMeter, camera: Camera) -> int:
    """Pixels that show what the reference hides."""
    frame = replace(stage.frame(camera, SIZE), output="position")
    target, pictures = stage.target(SIZE, "position"), []
    own = stage.renderer
    for renderer in (own, meter.reference(own.diagonal)):
        stage.renderer = renderer
        stage.draw_output(frame, target)
        pictures.append(shown_distances(target.read(), np.ones(SIZE[::-1], np.bool_)))
    stage.renderer = own
    return count_misplaced(*pictures, reach_px=4, slack=3.0 / frame.pixels_per_radian)


@ALL
def test_it_says_what_it_is(name) -> None:
    kind = RENDERERS[name]
    assert kind.name == name
    assert kind.title
    assert kind.source
    assert issubclass(kind.Settings, Settings)
    assert kind.Settings() == kind.Settings()
    assert all("label" in field.metadata for field in fields(kind.Settings))


@ALL
@pytest.mark.parametrize("tolerance", [0.5, 2.0])
def test_error_and_order_stay_within_the_promise_and_nothing_is_missing(stage, name, tolerance) -> None:
    stage.set_renderer(name, replace(stage.renderer.settings, tolerance_px=tolerance))
    meter = AccuracyMeter(stage, SIZE)
    for camera in VIEWS_OF_HILLS:
        meter.restart()
        found = meter.measure(stage.renderer, camera, 0.0, meter.truth(camera, stage.renderer.diagonal))
        error = np.abs(found.error_px[found.covered])
        assert error.size > 1000
        assert error.max() <= 1.25 * tolerance
        assert np.percentile(error, 99.9) <= 1.01 * tolerance
        assert found.holes_px == 0
        assert depth_misses(stage, meter, camera) == 0
    meter.release()


@ALL
def test_a_frame_drawn_twice_is_the_same_to_the_bit(stage) -> None:
    for camera in VIEWS_OF_HILLS[:2]:
        first, second = (stage.render(camera, SIZE) for _ in range(2))
        assert np.array_equal(first, second)


@ALL
def test_a_view_does_not_depend_on_where_one_was_before(stage) -> None:
    camera = VIEWS_OF_HILLS[1]
    first = stage.positions(camera, SIZE)
    for other in VIEWS_OF_HILLS:
        stage.positions(other, SIZE)
    again = stage.positions(camera, SIZE)
    assert np.array_equal(first, again, equal_nan=True)


@ALL
@pytest.mark.parametrize("output", get_args(Output))
def test_every_output_covers_what_the_position_covers(stage, output) -> None:
    frame = stage.frame(VIEWS_OF_HILLS[1], SIZE)
    kind = {"position": "position", "overdraw": "count"}.get(output, "colour")
    target = stage.target(SIZE, kind)
    stage.draw_output(replace(frame, output="position"), stage.target(SIZE, "position"))
    covered = stage.target(SIZE, "position").read()[..., 3] > 0.5
    assert 0.2 < covered.mean() < 1.0
    stage.draw_output(replace(frame, output=output), target)
    if output == "flat":
        return  # the lines of meshes; who has none may draw nothing
    assert np.array_equal(target.read_depth() > 0, covered)  # depth is written wherever something is drawn
    if output == "overdraw":
        assert (target.read()[..., 0][covered] >= 1).all()
    elif output in ("shaded", "levels", "normals"):
        assert len(np.unique(target.read()[..., :3][covered], axis=0)) > 3


@ALL
@pytest.mark.parametrize("view", VIEWS)
def test_every_view_can_be_drawn(stage, view) -> None:
    picture = stage.render(VIEWS_OF_HILLS[1], SIZE, view)
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert picture.std() > 1


@ALL
def test_boxes_hold_what_is_seen(stage) -> None:
    for camera in VIEWS_OF_HILLS:
        world = stage.positions(camera, SIZE)
        boxes = stage.renderer.boxes()
        assert boxes.lower_m.shape == boxes.upper_m.shape == (len(boxes.level), 3)
        assert (boxes.lower_m <= boxes.upper_m).all()
        seen = world[np.isfinite(world[..., 0])][::7]
        slack = 0.02 * np.linalg.norm(seen - camera.eye_m, axis=1)[:, None, None] + 0.01
        inside = (seen[:, None] >= boxes.lower_m - slack) & (seen[:, None] <= boxes.upper_m + slack)
        assert inside.all(axis=2).any(axis=1).all()


@ALL
def test_figures_are_filled(stage) -> None:
    target = stage.target(SIZE)
    stats = stage.draw(stage.frame(VIEWS_OF_HILLS[1], SIZE), target)
    assert stats.select_ms is not None
    assert stats.submit_ms is not None
    assert stats.draw_calls > 0
    assert stats.triangles > 0 or stats.slices or stats.ray_steps
    assert stats.resident_bytes > 0
    away = stage.draw(stage.frame(Camera((450.0, 9000.0, 450.0), 0.0, 80.0), SIZE), target)
    assert away.triangles == 0 or away.ray_steps is not None  # nothing in sight, nothing drawn


@ALL
def test_a_frozen_selection_is_drawn_from_elsewhere(stage) -> None:
    chosen, elsewhere = VIEWS_OF_HILLS[1], VIEWS_OF_HILLS[0]
    stage.freeze(stage.frame(chosen, SIZE))
    frozen = np.isfinite(stage.positions(elsewhere, SIZE)[..., 0])
    boxes = stage.renderer.boxes()
    stage.thaw()
    free = np.isfinite(stage.positions(elsewhere, SIZE)[..., 0])
    assert frozen.any()
    assert not (frozen & ~free).sum() > 0.01 * free.sum()  # nothing is drawn that was not there
    assert len(boxes.level)


@ALL
def test_settings_may_change_at_any_time(stage, name) -> None:
    fine = stage.positions(VIEWS_OF_HILLS[1], SIZE)
    stage.set_renderer(name, replace(stage.renderer.settings, tolerance_px=8.0))
    stage.positions(VIEWS_OF_HILLS[1], SIZE)
    stage.set_renderer(name, type(stage.renderer.settings)())
    assert np.array_equal(fine, stage.positions(VIEWS_OF_HILLS[1], SIZE), equal_nan=True)


@ALL
def test_switching_to_others_and_back_changes_nothing(stage, name) -> None:
    before = stage.render(VIEWS_OF_HILLS[1], SIZE)
    for other in RENDERERS:
        stage.set_renderer(other)
        stage.render(VIEWS_OF_HILLS[2], SIZE)
    stage.set_renderer(name)
    assert np.array_equal(before, stage.render(VIEWS_OF_HILLS[1], SIZE))


@ALL
def test_where_there_are_no_data_nothing_is_drawn(gpu, name) -> None:
    scene = make_scene(holes=True)
    stage = Stage(gpu, scene, name)
    reference = Stage(gpu, scene, "reference")
    holes = scene.heightfield.holes
    for camera in VIEWS_OF_HILLS:
        world = stage.positions(camera, SIZE)
        seen = world[np.isfinite(world[..., 0])]
        col, row = seen[:, 0] / 10.0, seen[:, 2] / 12.0
        around = [  # posts around each point; one that lies on the edge of a cell belongs to both
            holes[np.clip(f(row + e), 0, 69).astype(int), np.clip(g(col + d), 0, 89).astype(int)]
            for f, e in ((np.floor, -1e-3), (np.ceil, 1e-3)) for g, d in ((np.floor, -1e-3), (np.ceil, 1e-3))
        ]  # fmt: skip
        assert not np.all(around, axis=0).any()  # a cell without any data
    shown, truth = (np.isfinite(s.positions(VIEWS_OF_HILLS[0], SIZE)[..., 0]) for s in (stage, reference))
    rim = ndimage.maximum_filter(truth, 5) & ~ndimage.minimum_filter(truth, 5, mode="constant", cval=0)
    assert not ((shown != truth) & ~rim).any()
    stage.release()
    reference.release()


@ALL
@pytest.mark.parametrize("shape", [(2, 2), (2, 40), (3, 2), (17, 9)])
def test_tiny_grids_are_drawn(gpu, name, shape) -> None:
    heights = np.random.default_rng(0).uniform(0, 20, shape).astype(np.float32)
    field = Heightfield(heights, (10.0, 10.0))
    stage = Stage(gpu, Scene(field, build_pyramid(heights)), name)
    width, depth = field.extent_m
    camera = Camera((0.5 * width, 20.0 + 1.2 * max(width, depth), 0.5 * depth), 0.0, -90.0)
    meter = AccuracyMeter(stage, SIZE)
    found = meter.measure(stage.renderer, camera, 0.0, meter.truth(camera, stage.renderer.diagonal))
    assert found.covered.any()
    assert found.holes_px == 0
    assert np.abs(found.error_px).max() <= 1.25
    meter.release()
    stage.release()


@ALL
def test_who_stands_on_the_ground_sees_it(gpu, name) -> None:
    """Also where the two diagonal rules are metres apart."""
    heights = np.random.default_rng(3).uniform(0, 80, (33, 33)).astype(np.float32)
    field = Heightfield(heights, (90.0, 90.0))
    stage = Stage(gpu, Scene(field, build_pyramid(heights)), name)
    for x, z in np.random.default_rng(5).uniform(500.0, 2300.0, (12, 2)).tolist():
        camera = Camera((x, float(field.ground_at(x, z)) + 1.7, z), 30.0, -60.0)
        assert np.isfinite(stage.positions(camera, SIZE)[..., 0]).all()
    stage.release()


@ALL
def test_without_clip_control_the_picture_is_the_same(gpu, name) -> None:
    """Drivers that lack it (macOS) get a logarithmic depth written by fragments."""
    fallback = Gpu(gpu.ctx, clip_control=False)
    worlds = []
    try:
        for each in (gpu, fallback):
            if each is fallback:
                gpu.release_state()
            stage = Stage(each, SCENE, name)
            worlds.append([stage.positions(camera, SIZE) for camera in VIEWS_OF_HILLS])
            stage.release()
    finally:
        fallback.release()
        gpu.prepare_state()
    for camera, a, b in zip(VIEWS_OF_HILLS, *worlds, strict=True):
        distance = np.linalg.norm(a - camera.eye_m, axis=-1)
        assert (np.isnan(a[..., 0]) != np.isnan(b[..., 0])).mean() < 0.002
        differing = np.linalg.norm(a - b, axis=-1) > 1e-3 * distance  # NaN is no difference
        assert differing.mean() < 0.002


@ALL
def test_everything_is_released(gpu, name) -> None:
    stage = Stage(gpu, SCENE, "reference")

    def come_and_go() -> None:
        renderer = RENDERERS[name](gpu, SCENE, RENDERERS[name].Settings())
        own, stage.renderer = stage.renderer, renderer
        stage.render(VIEWS_OF_HILLS[1], SIZE)
        stage.positions(VIEWS_OF_HILLS[1], SIZE)
        stage.renderer = own
        renderer.release()
        keep.append(renderer)  # nothing may be left to the garbage collector

    keep: list = []
    come_and_go()  # compiles programs, which stay
    stage.render(VIEWS_OF_HILLS[1], SIZE)
    before = count_objects(gpu)
    for _ in range(2):
        come_and_go()
    assert count_objects(gpu) == before
    stage.release()


def count_objects(gpu: Gpu) -> dict[str, int]:
    """GL objects alive, by kind."""
    counts = {}
    for kind in ("Buffer", "Texture", "VertexArray", "Framebuffer", "Program", "Sampler", "Query"):
        exists = gpu.function(f"glIs{kind}", ctypes.c_ubyte, ctypes.c_uint)
        counts[kind] = sum(exists(name) for name in range(1, 4000))
    return counts
