"""Slices draw the reference's surface: everywhere, with no hole, no solid side and no seam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import minimum_filter

import terrain.renderers.slicing as slicing
from terrain.algorithms.slicing_cost import POLYGONS, X_SLICES, Y_SLICES, Z_SLICES, Speeds
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield
from terrain.pyramid import build_pyramid
from terrain.renderers.reference import ReferenceRenderer
from terrain.renderers.slicing import SlicingRenderer, SlicingSettings, rank_correlation
from terrain.renderers.slicing_bundles import AXIS_STEP, pack_cells, pack_records
from terrain.renderers.slicing_calibration import load_speeds, measure_speeds
from terrain.scene import Scene
from terrain.stage import Stage

SIZE = (160, 120)
# Slices are cheap here, so that a hybrid picture of a small terrain holds both kinds.
SPEEDS = Speeds(
    vertex_ms=6e-5, pixel_ms=2e-6, slice_ms=3e-4, slice_pixel_ms=2e-6, plane_pixel_ms=2e-7, found_pixel_ms=8e-6,
    triangle_ms=8e-5, polygon_pixel_ms=8e-6, search_ms=0.0,
)  # fmt: skip


@pytest.fixture(autouse=True)
def known_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slicing, "load_speeds", lambda gpu, viewport_px, anew: SPEEDS)


def hills(posts: int = 129) -> np.ndarray:
    random = np.random.default_rng(5)
    row, col = np.indices((posts, posts))
    heights = 50 * np.sin(row / 13.0) * np.cos(col / 17.0) + 12 * np.sin((row - col) / 4.0)
    return heights + random.normal(0, 1.0, heights.shape)


def cliffs(posts: int = 129) -> np.ndarray:
    row, col = np.indices((posts, posts))
    return 60.0 * ((row // 23 + col // 31) % 2) + 0.05 * row


def scene_of(heights: np.ndarray, holes: np.ndarray | None = None) -> Scene:
    terrain = Heightfield(np.ascontiguousarray(heights, np.float32), (10.0, 10.0), holes)
    return Scene(terrain, build_pyramid(terrain.heights_m))


SCENES = {"hills": hills(), "cliffs": cliffs(), "flat": np.zeros((129, 129))}
WAYS = {
    "slices": SlicingSettings(mode="slices"),
    "slices and triangles": SlicingSettings(),
    "coarser fans": SlicingSettings(mode="polygons", coarse=True),
}
CAMERAS = {
    "eye height": Camera((200.0, 66.0, 1100.0), 40.0, -3.0),
    "low": Camera((640.0, 120.0, 1250.0), 10.0, -12.0),
    "45 degrees": Camera((640.0, 500.0, 1100.0), 20.0, -45.0),
    "from above": Camera((650.0, 900.0, 630.0), 0.0, -90.0),
    "edge from outside": Camera((-300.0, 40.0, 500.0), 90.0, -2.0),
    "corner from outside": Camera((-250.0, 160.0, 1500.0), 50.0, -8.0, 15.0),
}


def positions(stage: Stage, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """World positions and where there is terrain."""
    world = stage.positions(camera, SIZE)
    return world, ~np.isnan(world[..., 0])


def error_px(scene: Scene, frame: Frame, world: np.ndarray) -> np.ndarray:
    """Vertical distance to the surface, in pixels, of covered positions (n, 3)."""
    off_m = np.abs(world[:, 1] - scene.heightfield.heights_at(world[:, 0], world[:, 2]))
    return np.nan_to_num(off_m) * frame.pixels_per_radian / np.linalg.norm(world - frame.eye_m, axis=1)


@pytest.mark.parametrize("terrain", SCENES)
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("way", WAYS)
def test_every_way_shows_what_the_mesh_shows(gpu: Gpu, terrain: str, camera: str, way: str) -> None:
    scene, settings = scene_of(SCENES[terrain]), WAYS[way]
    stage = Stage(gpu, scene, "reference")
    try:
        expected, is_expected = positions(stage, CAMERAS[camera])
        stage.renderer.release()
        stage.renderer = SlicingRenderer(gpu, scene, settings)
        found, is_found = positions(stage, CAMERAS[camera])
        frame = stage.frame(CAMERAS[camera], SIZE)
        assert stage.renderer.stats.slices or settings.coarse, "slices are drawn"
        errors = error_px(scene, frame, found[is_found])
        assert np.percentile(errors, 99.9) <= (1.0 if settings.coarse else 0.5)
        if not settings.coarse:
            assert np.percentile(errors, 99) <= 0.25
        assert not (minimum_filter(is_expected, 3) & ~is_found).any(), "no hole"
        assert not (minimum_filter(~is_expected, 3) & is_found).any(), "no solid side"
        both = is_expected & is_found
        off_m = np.linalg.norm(found[both] - expected[both], axis=1)
        distance_m = np.linalg.norm(expected[both] - frame.eye_m, axis=1)
        assert (off_m < 0.05 * distance_m).mean() > 0.975, "the same hill is in front"
    finally:
        stage.release()


@pytest.mark.parametrize("camera", ["low", "45 degrees", "edge from outside"])
@pytest.mark.parametrize("mode", ["hybrid", "slices"])
def test_posts_without_data_are_holes_one_sees_through(gpu: Gpu, camera: str, mode: str) -> None:
    holes = np.zeros((129, 129), np.bool_)
    holes[60:80, 50:75] = holes[100:104, 60:64] = True
    scene = scene_of(hills(), holes)
    stage = Stage(gpu, scene, "reference")
    try:
        expected, is_expected = positions(stage, CAMERAS[camera])
        stage.renderer.release()
        stage.renderer = SlicingRenderer(gpu, scene, SlicingSettings(mode=mode))
        found, is_found = positions(stage, CAMERAS[camera])
        assert not (minimum_filter(is_expected, 5) & ~is_found).any()
        assert not (minimum_filter(~is_expected, 5) & is_found).any()
        both = minimum_filter(is_expected & is_found, 3)
        off_m = np.linalg.norm(found[both] - expected[both], axis=1)
        assert (off_m < 30.0).mean() > 0.97, "the same ground is seen through holes"
    finally:
        stage.release()


@pytest.fixture
def stage(gpu: Gpu):
    scene = scene_of(hills())
    stage = Stage(gpu, scene, "reference")
    stage.renderer.release()
    stage.renderer = SlicingRenderer(gpu, scene, SlicingSettings())
    yield stage
    stage.release()


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("tolerance", [1.0, 6.0])
def test_no_seam_opens_between_coarser_fans_and_slices(
    gpu: Gpu, camera: str, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(hills())
    stage = Stage(gpu, scene, "reference")
    try:
        _, is_expected = positions(stage, CAMERAS[camera])
        is_mixed = []
        for factor in (1.0, 2.0, 4.0, 8.0, 16.0):
            speeds = replace(SPEEDS, triangle_ms=factor * SPEEDS.triangle_ms)
            monkeypatch.setattr(slicing, "load_speeds", lambda gpu, viewport_px, anew, speeds=speeds: speeds)
            stage.renderer.release()
            stage.renderer = SlicingRenderer(gpu, scene, SlicingSettings(tolerance_px=tolerance, coarse=True))
            _, is_found = positions(stage, CAMERAS[camera])
            inner = minimum_filter(is_expected, 3 if tolerance < 2 else 17)
            assert not (inner & ~is_found).any()
            stats = stage.renderer.stats
            is_mixed.append(bool(stats.slices and stats.triangles))
        assert any(is_mixed) or tolerance > 2 or camera == "from above"
    finally:
        stage.release()


def test_a_needle_beside_flat_ground_stays_as_thin_as_it_is(gpu: Gpu) -> None:
    """Flat ground leaves out posts; the tile next to it, which keeps all of its own, must not be bent to fit."""
    heights = np.zeros((129, 129))
    heights[62, 65] = 400.0  # one post inside its tile
    scene, camera = scene_of(heights), Camera((650.0, 500.0, 900.0), 0.0, -50.0)
    stage = Stage(gpu, scene, "reference")
    try:
        expected, _ = positions(stage, camera)
        stage.renderer.release()
        stage.renderer = SlicingRenderer(gpu, scene, SlicingSettings(mode="polygons", coarse=True))
        found, _ = positions(stage, camera)
        assert stage.renderer.stats.triangles < 10_000, "posts are left out"
        assert np.nanmax(np.abs(found - expected)[minimum_filter(~np.isnan(expected), 3)]) < 2.0
    finally:
        stage.release()


def test_the_picture_is_the_references(stage: Stage) -> None:
    camera = CAMERAS["low"]
    found = stage.render(camera, SIZE).astype(float)
    slicing_renderer = stage.renderer
    stage.renderer = ReferenceRenderer(stage.gpu, stage.scene, ReferenceRenderer.Settings())
    expected = stage.render(camera, SIZE).astype(float)
    stage.renderer.release()
    stage.renderer = slicing_renderer
    assert np.abs(found - expected).mean() < 1.5
    assert (np.abs(found - expected).max(axis=-1) < 40).mean() > 0.98


def test_depth_is_that_of_the_surface(stage: Stage) -> None:
    camera = CAMERAS["low"]
    world, covered = positions(stage, camera)
    frame = stage.frame(camera, SIZE)
    depth = stage.target(SIZE, "position").read_depth()
    view_depth = (world - frame.eye_m) @ camera.forward
    assert np.allclose(depth[covered], frame.near_m / view_depth[covered], rtol=1e-3)
    assert (depth[~covered] == 0).all()


def test_the_papers_rule_errs_more_at_a_larger_tolerance(stage: Stage) -> None:
    camera, errors, counts = CAMERAS["45 degrees"], [], []
    stage.renderer.release()
    stage.renderer = SlicingRenderer(stage.gpu, stage.scene, SlicingSettings(rule="paper", mode="slices"))
    for tolerance in (0.5, 1.0, 8.0):
        stage.renderer.settings = SlicingSettings(rule="paper", mode="slices", tolerance_px=tolerance)
        world, covered = positions(stage, camera)
        errors.append(error_px(stage.scene, stage.frame(camera, SIZE), world[covered]).mean())
        counts.append(stage.renderer.stats.slices)
    assert errors == sorted(errors)
    assert counts == sorted(counts, reverse=True)
    assert errors[1] < 1.0


def test_overdraw_counts_every_pixel_that_is_shown(stage: Stage) -> None:
    stage.renderer.settings = SlicingSettings(mode="slices")
    camera = CAMERAS["low"]
    _, covered = positions(stage, camera)
    frame = replace(stage.frame(camera, SIZE), output="overdraw")
    target = stage.target(SIZE, "count")
    stage.draw_output(frame, target)
    counts = target.read()[..., 0]
    assert (counts[minimum_filter(covered, 3)] >= 1).all()
    assert counts.max() < 100


def test_antialiased_slices_soften_the_skyline_and_nothing_else(stage: Stage) -> None:
    camera = CAMERAS["low"]
    hard = stage.render(camera, SIZE).astype(float)
    stage.renderer.settings = SlicingSettings(antialias=True)
    soft = stage.render(camera, SIZE).astype(float)
    changed = np.abs(soft - hard).max(axis=-1)
    assert (changed > 3).any()
    assert np.median(changed) <= 3
    assert changed.mean() < 10
    assert soft.sum(axis=-1).min() > 0.9 * hard.sum(axis=-1).min(), "edges blend with the sky, not with black"


def test_figure_4_shows_boxes_and_dark_fan_centres(stage: Stage) -> None:
    camera = CAMERAS["low"]
    stage.renderer.settings = SlicingSettings(figure=True, mode="polygons")
    picture = stage.render(camera, SIZE)
    assert (picture.max(axis=-1) < 40).any(), "dark centres"
    stage.renderer.settings = SlicingSettings(figure=True, mode="slices")
    colours = stage.render(camera, SIZE)[60:].reshape(-1, 3)
    assert len(np.unique(colours[colours.max(axis=1) > 40], axis=0)) < 40, "flat colours of boxes"


def test_levels_are_directions(stage: Stage) -> None:
    stage.render(CAMERAS["45 degrees"], SIZE, view="levels")
    boxes = stage.renderer.boxes()
    assert set(boxes.level) <= {POLYGONS, X_SLICES, Y_SLICES, Z_SLICES}
    assert (boxes.upper_m >= boxes.lower_m).all()


def test_views_draw_without_an_error(stage: Stage) -> None:
    for view in ("wireframe", "boxes", "overdraw", "levels", "normals"):
        assert stage.render(CAMERAS["low"], SIZE, view=view).std() > 1


def test_a_frozen_choice_can_be_seen_from_elsewhere(stage: Stage) -> None:
    stage.freeze(stage.frame(CAMERAS["low"], SIZE))
    assert stage.render(CAMERAS["corner from outside"], SIZE).std() > 1
    stage.thaw()


def test_a_look_at_nothing_but_sky_draws_nothing(stage: Stage) -> None:
    _, covered = positions(stage, Camera((640.0, 400.0, 640.0), 0.0, 60.0))
    assert not covered.any()
    assert stage.renderer.stats.slices == 0


def test_stats_tell_what_was_chosen(stage: Stage) -> None:
    target = stage.target(SIZE)
    for frame_ms in (4.0, 5.0, 6.0, 7.0, 8.0):
        stats = stage.draw(stage.frame(CAMERAS["low"], SIZE), target)
        stats.frame_ms = frame_ms  # as whoever presents the frame does
    sliced = sum(stats.extra[f"boxes of {axis}-slices"] for axis in "xyz")
    assert sliced > 0
    assert sliced + stats.extra["polygon boxes"] == len(stage.renderer.boxes().level)
    assert stats.extra["fans"] == stats.triangles / 8
    assert stats.extra["estimated ms"] > 0
    assert stats.extra["ns per plane and pixel"] == pytest.approx(1e6 * SPEEDS.plane_pixel_ms)
    assert stats.extra["measured ms"] == 7.0
    assert -1.0 <= stats.extra["rank correlation"] <= 1.0


def test_a_driver_without_clip_control_sees_the_same(gpu: Gpu) -> None:
    plain = Gpu(gpu.ctx, clip_control=False)
    scene = scene_of(hills())
    try:
        counts = []
        for context in (gpu, plain):
            context.prepare_state()
            if context is plain:
                gpu.release_state()
                context.prepare_state()
            stage = Stage(context, scene, "reference")
            stage.renderer.release()
            stage.renderer = SlicingRenderer(context, scene, SlicingSettings())
            counts.append(positions(stage, CAMERAS["low"])[1])
            stage.release()
        assert (counts[0] != counts[1]).mean() < 0.002
    finally:
        plain.programs.release()
        gpu.prepare_state()


def test_packed_cells_pass_through_the_corners_of_every_cell(gpu: Gpu) -> None:
    heights = np.random.default_rng(1).normal(0, 10, (300, 37)).astype(np.float32)
    texture = pack_cells(gpu, heights)
    x, y, z, w = np.frombuffer(texture.read(), np.float32).reshape(299, 36, 4).transpose(2, 0, 1)
    texture.release()
    is_sw_ne = np.indices((299, 36)).sum(axis=0) % 2
    for v in (0, 1):
        for u in (0, 1):
            across = np.abs(is_sw_ne - u)
            found = x + y * across + z * v + w * np.minimum(across, v)
            assert np.allclose(found, heights[v : v + 299, u : u + 36], atol=1e-5)


def test_the_eye_is_never_between_two_planes(stage: Stage) -> None:
    frame = stage.frame(CAMERAS["45 degrees"], SIZE)
    stage.renderer.settings = SlicingSettings(mode="slices")
    stage.renderer.select(frame)
    cut = stage.renderer._cut
    sliced = cut.direction != POLYGONS
    records = pack_records(cut, frame, 0.1).reshape(-1, 8)[: len(cut.planes)][sliced]
    axis = np.array([{X_SLICES: 0, Y_SLICES: 1, Z_SLICES: 2}[d] for d in cut.direction[sliced]])
    assert (records[:, 3] == axis * AXIS_STEP + cut.planes[sliced]).all()
    low, high = records[np.arange(len(axis)), axis], records[np.arange(len(axis)), 4 + axis]
    assert (low * high > 0).all(), "the eye is never between two planes"


@pytest.mark.parametrize("camera", ["low", "45 degrees", "corner from outside"])
def test_patches_hold_every_pixel_of_a_slice_and_little_else(stage: Stage, camera: str) -> None:
    stage.renderer.settings = SlicingSettings(mode="slices")
    _, covered = positions(stage, CAMERAS[camera])
    inside = np.zeros_like(covered)
    for left, bottom, right, top in np.round(stage.renderer._cut.patches * [*SIZE, *SIZE]).astype(int):
        assert not inside[SIZE[1] - top : SIZE[1] - bottom, left:right].any(), "no pixel is looked at twice"
        inside[SIZE[1] - top : SIZE[1] - bottom, left:right] = True
    assert inside[covered].all()
    assert inside.mean() < covered.mean() + 0.3


def test_rank_correlation_is_that_of_the_order() -> None:
    x = np.array([3.0, 1.0, 7.0, 5.0])
    assert rank_correlation(np.stack([x, np.exp(x)], axis=1)) == pytest.approx(1.0)
    assert rank_correlation(np.stack([x, -x], axis=1)) == pytest.approx(-1.0)


def test_speeds_are_measured_once_per_viewport(
    gpu: Gpu, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    monkeypatch.setenv("RELIEFSCOPE_CACHE", str(tmp_path))
    first = load_speeds(gpu, (64, 48))
    assert all(value >= 0 for value in vars(first).values())
    assert first.slice_ms > 0
    monkeypatch.setattr(
        "terrain.renderers.slicing_calibration.measure_speeds", lambda *_: pytest.fail("measured again")
    )
    assert load_speeds(gpu, (64, 48)) == first
    monkeypatch.setattr("terrain.renderers.slicing_calibration.measure_speeds", lambda *_: replace(first, slice_ms=9.0))
    assert load_speeds(gpu, (64, 48), anew=True).slice_ms == 9.0
    assert load_speeds(gpu, (64, 48)).slice_ms == 9.0


def test_measuring_speeds_leaves_no_gl_error(gpu: Gpu) -> None:
    speeds = measure_speeds(gpu, (64, 48))
    assert speeds.triangle_ms > 0
    assert gpu.ctx.error == "GL_NO_ERROR"


def test_a_window_being_resized_is_not_measured_at_every_size(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[tuple[int, int]] = []
    monkeypatch.setattr(slicing, "load_speeds", lambda gpu, size, anew: measured.append(size) or SPEEDS)
    for width in range(100, 110):
        stage.renderer.select(stage.frame(CAMERAS["low"], (width, 80)))
    assert measured == [(100, 80)]
    for _ in range(20):
        stage.renderer.select(stage.frame(CAMERAS["low"], (120, 80)))
    assert measured == [(100, 80), (120, 80)]
