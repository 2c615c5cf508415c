"""Slope, aspect, curvature, drainage and standing water, on surfaces whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.heightfield import Heightfield
from terrain.textures import relief
from terrain.textures.relief import aspect_deg, curvature_per_m, drained_area_m2, shapes, slope_deg, standing_water


def field(heights, spacing_m=(10.0, 10.0), **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), spacing_m, **others)


def whole(terrain, figure):
    """A figure of every post."""
    return np.concatenate([figure(shape) for _, shape in shapes(terrain)])


def grid(rows, cols, spacing_m=(10.0, 10.0)):
    """x and z [m] of every post, from the middle of the grid."""
    z, x = np.mgrid[:rows, :cols].astype(np.float64)
    return (x - (cols - 1) / 2) * spacing_m[0], (z - (rows - 1) / 2) * spacing_m[1]


@given(st.floats(-2, 2), st.floats(-2, 2), st.integers(2, 9), st.integers(2, 9))
def test_a_plane_has_one_slope_one_aspect_and_no_curvature_up_to_its_last_post(east, south, rows, cols):
    x, z = grid(rows, cols, (10.0, 25.0))
    terrain = field(east * x + south * z, (10.0, 25.0))
    assert np.allclose(whole(terrain, slope_deg), np.degrees(np.arctan(np.hypot(east, south))), atol=0.02)
    assert np.allclose(whole(terrain, curvature_per_m), 0.0, atol=1e-5)
    if np.hypot(east, south) > 0.01:
        down = np.degrees(np.arctan2(-east, south)) % 360.0
        off = (whole(terrain, aspect_deg) - down + 180.0) % 360.0 - 180.0
        assert np.abs(off).max() < 0.5


@pytest.mark.parametrize(("east", "south", "faces"), [(-1, 0, 90), (1, 0, 270), (0, -1, 180), (0, 1, 0), (-1, -1, 135)])
def test_ground_faces_where_it_falls(east, south, faces):
    x, z = grid(5, 5)
    assert np.allclose(whole(field(east * x + south * z), aspect_deg) % 360.0, faces, atol=1e-3)


def test_a_cone_has_one_slope_everywhere_but_at_its_top():
    x, z = grid(65, 65)
    steep = whole(field(400.0 - 0.5 * np.hypot(x, z)), slope_deg)
    away = np.hypot(x, z) > 60.0
    assert np.allclose(steep[away], np.degrees(np.arctan(0.5)), atol=0.3)


def test_a_sphere_bends_by_one_over_its_radius_and_a_bowl_the_other_way():
    x, z = grid(81, 61)
    dome = np.sqrt(1500.0**2 - x**2 - z**2)
    assert np.allclose(whole(field(dome), curvature_per_m)[1:-1, 1:-1], 1 / 1500.0, rtol=0.03)
    assert np.allclose(whole(field(-dome), curvature_per_m)[1:-1, 1:-1], -1 / 1500.0, rtol=0.03)


def test_exaggerated_heights_count_as_what_they_truly_are():
    x, z = grid(9, 9)
    terrain = field(0.3 * x + 0.001 * z * z)
    assert np.allclose(whole(terrain.exaggerated(4.0), slope_deg), whole(terrain, slope_deg), atol=1e-3)


def test_bands_join_without_a_seam(monkeypatch):
    rng = np.random.default_rng(1)
    terrain = field(rng.normal(0, 5, (50, 20)))
    at_once = [whole(terrain, figure) for figure in (slope_deg, curvature_per_m)]
    water = standing_water(terrain)
    monkeypatch.setattr(relief, "BAND_ROWS", 7)
    for one, other in zip(at_once, (slope_deg, curvature_per_m), strict=True):
        assert np.array_equal(one, whole(terrain, other))
    assert np.array_equal(water, standing_water(terrain))


def test_all_rain_on_a_slope_leaves_at_its_foot():
    _, z = grid(20, 30)
    area = drained_area_m2(field(1000.0 - z), 100)
    assert np.allclose(area[-1, 1:-1], 19 * 100.0)  # a column of posts of 100 m^2 each; the upper edge keeps its own
    assert np.allclose(area[0, 1:-1], 100.0)


def test_a_bowl_fills_and_drains_over_its_lowest_pass():
    x, z = grid(41, 41)
    heights = 0.01 * (x**2 + z**2)
    heights[0, 20] = heights[1, 20] = 10.0  # a notch in the rim
    area = drained_area_m2(field(heights), 100)
    assert area[0, 20] > 0.9 * 39 * 39 * 100.0
    assert area.sum() >= area.size * 100.0


@pytest.mark.parametrize("shape", [(2, 2), (2, 9), (40, 3), (97, 61)])
@pytest.mark.parametrize("most", [16, 200])
def test_drainage_of_any_size_loses_no_water(shape, most):
    heights = np.random.default_rng(5).normal(0, 10, shape)
    area = drained_area_m2(field(heights), most)
    assert area.shape == tuple(min(side, most) for side in shape)
    cell_m2 = 100.0 * heights.size / area.size
    assert area.min() >= cell_m2 * (1 - 1e-6)
    edge = np.ones(area.shape, bool)
    edge[1:-1, 1:-1] = False
    assert np.isclose(area[edge].sum(), area.size * cell_m2)  # all that fell has arrived at the edge


def test_ground_without_data_takes_water_and_gives_none():
    x, _ = grid(21, 21)
    holes = np.zeros((21, 21), bool)
    holes[:, 10] = True
    area = drained_area_m2(field(1000.0 - x, holes=holes), 100)
    assert np.allclose(area[1:-1, 9], 900.0)
    assert np.allclose(area[1:-1, 11], 100.0)


def lake(level=100.0):
    """A level floor in a valley with gentle banks, open to the south by one post."""
    x, z = grid(60, 60)
    return np.maximum(level + 0.4 * (np.hypot(x, z) - 150.0), level)


def test_water_stands_on_a_floor_with_banks_around_it():
    heights = lake()
    water = standing_water(field(heights))
    assert np.array_equal(water, heights == 100.0)


def test_a_lake_keeps_its_water_though_it_has_an_outlet():
    heights = lake()
    outlet = np.flatnonzero(heights[:, 30] == 100.0)[-1] + 1
    heights[outlet:, 30] = 95.0
    assert standing_water(field(heights))[30, 30]


def test_a_terrace_a_slope_and_a_floor_between_walls_hold_no_water():
    x, _ = grid(40, 40)
    assert not standing_water(field(0.1 * x)).any()
    terrace = np.where(np.abs(x) < 80.0, 50.0, 50.0 - 0.2 * x)
    assert not standing_water(field(terrace)).any()
    street = np.where(np.abs(x) < 80.0, 0.0, 60.0)
    assert not standing_water(field(street)).any()


def test_the_lower_floor_of_a_step_may_hold_water_but_never_the_upper():
    x, _ = grid(40, 40)
    water = standing_water(field(np.where(x < 0, 0.0, 8.0)))
    assert water[:, :20].all()
    assert not water[:, 20:].any()
