"""Geomorphing tiles on the GPU: no gap in any morph state, nothing past the grid, drivers and budget as promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.accuracy import AccuracyMeter
from terrain.pyramid import build_pyramid
from terrain.renderers.geomorph import GeomorphRenderer, GeomorphSettings
from terrain.scene import Scene
from terrain.stage import Stage

SIZE = (200, 150)


def rough_scene(rows: int = 181, cols: int = 203) -> Scene:
    """Rough on one side, smooth on the other; no multiple of any tile."""
    z, x = np.mgrid[:rows, :cols]
    noise = np.random.default_rng(5).normal(size=(rows, cols))
    heights = 120 * np.sin(x / 19) * np.cos(z / 23) + noise * np.clip(x / 20 - 4, 0, 6)
    field = Heightfield(heights.astype(np.float32), (20.0, 20.0))
    return Scene(field, build_pyramid(field.heights_m))


@pytest.fixture
def stage(gpu):
    stage = Stage(gpu, rough_scene(), "geomorph")
    yield stage
    stage.release()


def inner(scene: Scene, count: int, seed: int) -> list[Camera]:
    """Cameras that see nothing but ground: high up, looking steeply down near the middle."""
    rng = np.random.default_rng(seed)
    width, depth = scene.heightfield.extent_m
    return [
        Camera(
            (width * rng.uniform(0.4, 0.6), rng.uniform(250, 600), depth * rng.uniform(0.4, 0.6)),
            rng.uniform(0, 360), rng.uniform(-90, -75), rng.uniform(-180, 180), 60.0,
        )
        for _ in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("driver", ["distance", "time", "frames", "off"])
@pytest.mark.parametrize("cells", [8, 16, 32])
def test_no_background_shows_through_in_any_morph_state(stage, driver, cells) -> None:
    """Teleports leave every driven morph half way; what is drawn must cover each pixel all the same."""
    settings = GeomorphSettings(tolerance_px=3.0, tile_cells=cells, driver=driver, morph_frames=7, morph_s=0.3)
    stage.set_renderer("geomorph", settings)
    target = stage.target(SIZE, "position")
    for i, camera in enumerate(inner(stage.scene, 12, cells)):
        frame = replace(stage.frame(camera, SIZE, time_s=0.05 * i), output="position")
        stage.draw_output(frame, target)
        assert (target.read()[..., 3] >= 1.0).all(), f"background in frame {i}"


def test_nothing_is_drawn_past_the_grid(stage) -> None:
    width, depth = stage.scene.heightfield.extent_m
    for tolerance in (0.5, 8.0, 64.0):
        stage.set_renderer("geomorph", GeomorphSettings(tolerance_px=tolerance))
        world = stage.positions(Camera((width / 2, 9000.0, depth / 2), 0.0, -90.0), SIZE)
        drawn = world[np.isfinite(world[..., 0])]
        assert drawn[:, 0].min() > -1.0
        assert drawn[:, 2].min() > -1.0
        assert drawn[:, 0].max() < width + 1.0
        assert drawn[:, 2].max() < depth + 1.0
        assert drawn[:, 0].max() > width - 60.0  # and the grid is drawn to its edge


def test_a_distance_driven_morph_forgets_where_the_eye_has_been(stage) -> None:
    cameras = inner(stage.scene, 6, 1)
    first = stage.render(cameras[0], SIZE)
    for camera in cameras[1:]:
        stage.render(camera, SIZE)
    np.testing.assert_array_equal(stage.render(cameras[0], SIZE), first)


@pytest.mark.parametrize("tolerance", [0.5, 1.0, 2.0, 4.0, 8.0])
def test_the_promise_holds_on_rough_ground(stage, tolerance) -> None:
    meter = AccuracyMeter(stage, (320, 240))
    renderer = GeomorphRenderer(stage.gpu, stage.scene, GeomorphSettings(tolerance_px=tolerance))
    cameras = [Camera((500.0 + 300 * i, 260.0, 3300.0), 20.0, -15.0) for i in range(6)]
    errors = []
    for camera in cameras:
        found = meter.measure(renderer, camera, 0.0, meter.truth(camera, "alternating"))
        assert found.holes_px == 0
        errors.append(np.abs(found.error_px[found.covered]))
    pooled = np.concatenate(errors)
    assert np.percentile(pooled, 99.9) <= tolerance
    assert pooled.max() <= 1.25 * tolerance
    assert pooled.max() > 0.1 * min(tolerance, 2.0)  # or the tolerance is not used
    renderer.release()
    meter.release()


def test_a_triangle_budget_is_kept_by_raising_the_tolerance(stage) -> None:
    camera = Camera((300.0, 250.0, 3300.0), 20.0, -12.0)
    stage.set_renderer("geomorph", GeomorphSettings(tolerance_px=0.5))
    stage.render(camera, SIZE)
    free = stage.renderer.stats.triangles
    budget = max(free // 4, 1000)
    settings = GeomorphSettings(tolerance_px=0.5, budget="triangles", budget_triangles=budget)
    stage.set_renderer("geomorph", settings)
    counts = []
    for _ in range(60):
        stage.render(camera, SIZE)
        counts.append(stage.renderer.stats.triangles)
    assert free > 1.5 * budget
    assert np.median(counts[40:]) == pytest.approx(budget, rel=0.2)
    stage.set_renderer("geomorph", replace(settings, budget="off"))
    stage.render(camera, SIZE)
    assert stage.renderer.stats.triangles == free


def test_all_tiles_of_one_mesh_share_one_draw_call(stage) -> None:
    for cells in (8, 16, 32, 64):
        stage.set_renderer("geomorph", GeomorphSettings(tile_cells=cells))
        stage.render(Camera((300.0, 250.0, 3300.0), 20.0, -12.0), SIZE)
        stats = stage.renderer.stats
        assert 1 <= stats.draw_calls <= cells.bit_length()
        assert stats.extra["tiles"] > stats.draw_calls
