"""The meter judged: the reference against itself, a shifted terrain, a torn and a bent mesh, and a float64 oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.accuracy import Accuracy, AccuracyMeter, Pool, count_holes, geometric_error_px, silhouette_shift
from terrain.pyramid import build_pyramid
from terrain.renderers import RENDERERS
from terrain.renderers.geomorph import GeomorphRenderer, GeomorphSettings
from terrain.renderers.reference import ReferenceRenderer
from terrain.scene import Scene
from terrain.stage import Stage

SIZE = (240, 160)


def hills(shift_m: float = 0.0) -> Scene:
    z, x = np.mgrid[:130, :150] * 0.11
    heights = (60 * np.sin(x) * np.cos(0.7 * z) + 25 * np.sin(2.3 * x + z) + shift_m).astype(np.float32)
    field = Heightfield(heights, (20.0, 25.0))
    return Scene(field, build_pyramid(field.heights_m))


CAMERAS = [Camera((300.0 + 40 * i, 260.0, 2900.0 - 50 * i), 25.0 + 2 * i, -14.0) for i in range(5)]
DOWN = Camera((1500.0, 900.0, 1500.0), 0.0, -90.0)


@pytest.fixture
def stage(gpu):
    stage = Stage(gpu, hills(), "reference")
    yield stage
    stage.release()


@pytest.fixture
def meter(stage):
    meter = AccuracyMeter(stage, SIZE)
    yield meter
    meter.release()


def measure(meter: AccuracyMeter, renderer, cameras=CAMERAS) -> Accuracy:
    total = Accuracy()
    meter.restart()
    for i, camera in enumerate(cameras):
        total.add(meter.measure(renderer, camera, i / 24, meter.truth(camera, renderer.diagonal)))
    return total


@pytest.mark.parametrize("diagonal", ["alternating", "uniform"])
def test_the_reference_against_itself_has_no_error(stage, meter, diagonal) -> None:
    renderer = ReferenceRenderer(stage.gpu, stage.scene, ReferenceRenderer.Settings(), diagonal)
    found = measure(meter, renderer)
    renderer.release()
    assert found.error.count > 50_000
    assert found.error.maximum < 0.02
    assert found.holes_px == found.differing_px == 0
    assert found.silhouette.maximum == 0.0
    assert found.popping.maximum < 0.01


def test_the_other_diagonal_rule_is_told_apart(stage, meter) -> None:
    renderer = ReferenceRenderer(stage.gpu, stage.scene, ReferenceRenderer.Settings(), "uniform")
    renderer.diagonal = "alternating"
    assert measure(meter, renderer).error.maximum > 0.05
    renderer.release()


def test_a_terrain_shifted_by_a_known_amount_gives_that_amount(gpu, meter) -> None:
    shifted = Stage(gpu, hills(shift_m=5.0), "reference")
    other = AccuracyMeter(shifted, SIZE)
    frame = meter.stage.frame(DOWN, SIZE)
    target = other._draw_positions(shifted.renderer, shifted.frame(DOWN, SIZE))
    meter._draw_positions(meter.stage.renderer, frame)  # the unshifted terrain's textures and frame block
    meter.stage.measure_error(target, meter._errors[0], "alternating")
    data = meter._errors[0].read()
    covered = data[..., 3] > 0.5
    np.testing.assert_allclose(data[..., 1][covered], 5.0, atol=0.05)
    expected = geometric_error_px(shifted.positions(DOWN, SIZE), DOWN, SIZE[1], hills().heightfield)
    np.testing.assert_allclose(data[..., 0][covered], expected[covered], atol=0.01)
    assert 0.5 < data[..., 0].max() < 1.0
    other.release()
    shifted.release()


@pytest.mark.parametrize("name", sorted(RENDERERS))
def test_the_gpu_agrees_with_float64(stage, meter, name) -> None:
    renderer = RENDERERS[name](stage.gpu, stage.scene, replace(RENDERERS[name].Settings(), tolerance_px=4.0))
    camera = CAMERAS[0]
    found = meter.measure(renderer, camera, 0.0, meter.truth(camera, renderer.diagonal))
    drawn = meter._positions[0].read()
    world = np.where(drawn[..., 3:] > 0.5, drawn[..., :3] + camera.eye_m, np.nan)
    expected = geometric_error_px(world, camera, SIZE[1], stage.scene.heightfield, renderer.diagonal)
    difference = np.abs(found.error_px - expected)[found.covered]
    # Rounded corners are not charged: up to 1/256 px where surfaces are parallel, more where they are seen edge on.
    assert np.isnan(difference).mean() < 1e-3  # points of the rim, a rounding error outside the grid
    assert np.nanpercentile(difference, 99) < 0.006
    renderer.release()


class TornRenderer(GeomorphRenderer):
    """Drops one tile of every mesh size."""

    def select(self, frame) -> None:
        super().select(frame)
        self._counts = np.maximum(self._counts - 1, 0)


def test_a_torn_mesh_has_holes(stage, meter) -> None:
    settings = GeomorphSettings(tile_cells=8, tolerance_px=0.5)
    whole, torn = (kind(stage.gpu, stage.scene, settings) for kind in (GeomorphRenderer, TornRenderer))
    assert measure(meter, whole, [DOWN]).holes_px == 0
    assert measure(meter, torn, [DOWN]).holes_px > 20
    whole.release()
    torn.release()


def test_a_loosened_tolerance_shows_in_error_and_popping(stage, meter) -> None:
    results = []
    for tolerance in (0.5, 4.0):
        renderer = GeomorphRenderer(stage.gpu, stage.scene, GeomorphSettings(tolerance_px=tolerance, driver="off"))
        results.append(measure(meter, renderer))
        renderer.release()
    fine, coarse = results
    assert fine.error.maximum < 0.75
    assert coarse.error.maximum > 2 * fine.error.maximum
    assert coarse.popping.maximum > fine.popping.maximum > 0.0


def test_holes_need_terrain_all_around() -> None:
    truth = np.zeros((20, 20), bool)
    truth[6:, :] = True
    covered = truth.copy()
    assert count_holes(covered, truth) == 0
    covered[6] = False  # a silhouette lower by one pixel is no hole
    assert count_holes(covered, truth) == 0
    covered[12, 9] = False
    assert count_holes(covered, truth) == 1


def test_a_lower_silhouette_is_granted_as_far_as_promised_and_a_slit_below_it_is_not() -> None:
    truth = np.zeros((30, 30), bool)
    truth[6:, :] = True
    covered = truth.copy()
    covered[6:10] = False  # four rows lower, each column but the outermost with terrain all around
    assert count_holes(covered, truth, tolerance_px=1.0) > 0
    assert count_holes(covered, truth, tolerance_px=4.0) == 0
    covered[6:20, 15] = False  # open to the sky, but deeper than any promise
    assert count_holes(covered, truth, tolerance_px=4.0) > 5


def test_the_silhouette_shift_is_counted_per_column() -> None:
    truth = np.zeros((10, 4), bool)
    truth[5:] = True
    covered = truth.copy()
    covered[5:8, 2] = False
    assert silhouette_shift(covered, truth).tolist() == [0, 0, 3, 0]


@given(st.lists(st.floats(0, 1e4, width=32), min_size=1, max_size=300))
def test_pooled_percentiles_are_within_one_bin(values) -> None:
    pool = Pool()
    for part in np.array_split(np.array(values, np.float32), 3):
        pool.add(part)
    assert pool.maximum == np.float32(max(values))
    assert pool.mean == pytest.approx(np.mean(values, dtype=np.float64), rel=1e-5, abs=1e-9)
    for share in (50, 99, 99.9):
        exact = float(np.sort(np.array(values, np.float32))[int(np.ceil(len(values) * share / 100)) - 1])
        assert exact / 1.002 <= max(pool.percentile(share), 1e-6) <= max(exact * 1.012, 1.1e-6)


def test_a_silhouette_lowered_below_the_pictures_edge_is_no_hole():
    truth = np.ones((12, 20), np.bool_)
    covered = truth.copy()
    covered[:3, 4:8] = False
    assert count_holes(covered, truth, tolerance_px=4.0) == 0
    assert count_holes(covered, truth, tolerance_px=1.0) == 4  # the third row lies deeper than the promise
    covered[2:5, 12] = False
    assert count_holes(covered, truth, tolerance_px=4.0) == 3
