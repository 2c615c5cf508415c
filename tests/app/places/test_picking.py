"""Picked points lie on the surface and on the sight line, and nothing lies before them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.places.picking import first_hit, is_solid, profile_between, relief_at
from terrain.heightfield import Heightfield

SPACING_M = (10.0, 8.0)
DIAGONALS = ("alternating", "uniform")
unit, inner = st.floats(0.0, 1.0), st.floats(0.001, 0.999)


def rough(seed, rows=24, cols=31, relief_m=60.0, holes=None):
    heights = np.random.default_rng(seed).uniform(0.0, relief_m, (rows, cols)).astype(np.float32)
    return Heightfield(heights, SPACING_M, holes)


def plane(east, south, rows=12, cols=15):
    """A plane that rises by ``east`` and ``south`` per metre."""
    z, x = np.meshgrid(np.arange(rows) * SPACING_M[1], np.arange(cols) * SPACING_M[0], indexing="ij")
    return Heightfield((500.0 + east * x + south * z).astype(np.float32), SPACING_M)


@given(st.integers(0, 20), unit, unit, st.floats(61.0, 2000.0), inner, inner, st.sampled_from(DIAGONALS))
def test_the_picked_point_is_the_first_of_the_surface_on_the_ray(seed, ex, ez, height, tx, tz, diagonal):
    terrain = rough(seed)
    width, depth = terrain.extent_m
    eye = np.array([ex * width, height, ez * depth])
    target = np.array([tx * width, float(terrain.heights_at(tx * width, tz * depth, diagonal)), tz * depth])
    least = 1e-3 * min(SPACING_M)
    target[1] -= least  # rather into the ground than along it
    found = first_hit(terrain, eye, target - eye, diagonal)
    assert found is not None
    assert abs(found[1] - float(terrain.heights_at(found[0], found[2], diagonal))) < least
    along = (target - eye) / np.linalg.norm(target - eye)
    reach = float((found - eye) @ along)
    assert np.linalg.norm(found - eye - reach * along) < least
    assert reach <= np.linalg.norm(target - eye) + least
    before = eye + np.linspace(0.0, reach - least, 1000)[:, None] * along
    ground = terrain.heights_at(before[:, 0], before[:, 2], diagonal)
    assert not (before[:, 1] < ground - least).any()


@settings(max_examples=40)
@given(st.integers(0, 5), unit, unit)
def test_straight_down_is_the_height_of_the_ground(seed, x, z):
    terrain = rough(seed)
    x, z = x * terrain.extent_m[0], z * terrain.extent_m[1]
    found = first_hit(terrain, np.array([x, 1e4, z]), np.array([0.0, -1.0, 0.0]))
    assert found == pytest.approx([x, float(terrain.heights_at(x, z)), z], abs=1e-6)


def test_rays_into_the_sky_and_beside_the_terrain_meet_nothing():
    terrain = rough(0)
    assert first_hit(terrain, np.array([50.0, 100.0, 50.0]), np.array([0.3, 0.1, 0.2])) is None
    assert first_hit(terrain, np.array([-50.0, 100.0, 50.0]), np.array([-1.0, -1.0, 0.0])) is None
    assert first_hit(terrain, np.array([-50.0, 100.0, 50.0]), np.array([0.0, -1.0, 0.0])) is None


def test_from_below_the_ground_is_not_seen_but_what_lies_beyond_is():
    x = np.arange(31) * SPACING_M[0]
    ridge = np.maximum(0.0, 100.0 - np.abs(x - 150.0))
    terrain = Heightfield(np.tile(ridge, (24, 1)).astype(np.float32), SPACING_M)
    assert first_hit(terrain, np.array([95.0, -100.0, 71.0]), np.array([0.0, 1.0, 0.0])) is None
    found = first_hit(terrain, np.array([20.0, -10.0, 71.0]), np.array([1.0, 0.5, 0.0]))  # out of the plain
    assert found == pytest.approx([60.0, 10.0, 71.0])


def test_far_away_eyes_pick_as_exactly_as_near_ones():
    terrain = rough(3)
    target = np.array([123.4, 0.0, 98.7])
    target[1] = float(terrain.heights_at(target[0], target[2]))
    up = np.array([0.2, 1.0, -0.1])
    near = first_hit(terrain, target + 200.0 * up, -up)
    far = first_hit(terrain, target + 2e5 * up, -up)
    assert near == pytest.approx(target, abs=1e-6)
    assert far == pytest.approx(target, abs=1e-6)


def test_holes_are_looked_through():
    holes = np.zeros((24, 31), np.bool_)
    holes[8:14, 8:14] = True
    terrain = rough(1, holes=holes)
    down = np.array([0.0, -1.0, 0.0])
    assert first_hit(terrain, np.array([105.0, 500.0, 90.0]), down) is None
    assert not is_solid(terrain, 105.0, 90.0)
    assert is_solid(terrain, 50.0, 30.0)
    # From the south-east over the hole: the ground beyond it is met instead.
    found = first_hit(terrain, np.array([105.0, 80.0, 90.0]), np.array([-1.0, -0.8, -1.0]))
    assert found is not None
    assert is_solid(terrain, found[0], found[2])


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), unit, unit)
def test_slope_and_aspect_of_planes_are_exact_to_the_edge(east, south, x, z):
    terrain = plane(east, south)
    x, z = x * terrain.extent_m[0], z * terrain.extent_m[1]
    relief = relief_at(terrain, x, z)
    steepness = math.hypot(east, south)
    assert relief.height_m == pytest.approx(500.0 + east * x + south * z, abs=1e-3)
    assert relief.slope_deg == pytest.approx(math.degrees(math.atan(steepness)), abs=0.01)
    if steepness > 0.01:
        # Downhill: against the gradient; north is -z.
        expected = math.degrees(math.atan2(-east, south)) % 360.0
        assert abs((relief.aspect_deg - expected + 180.0) % 360.0 - 180.0) < 0.2


def test_level_ground_faces_nowhere_and_exaggeration_changes_nothing():
    assert relief_at(plane(0.0, 0.0), 40.0, 40.0).aspect_deg is None
    terrain = rough(2)
    plain, tall = relief_at(terrain, 77.0, 66.0), relief_at(terrain.exaggerated(3.0), 77.0, 66.0)
    assert tall.height_m == pytest.approx(plain.height_m, rel=1e-5)
    assert tall.slope_deg == pytest.approx(plain.slope_deg, rel=1e-5)


def test_slope_and_aspect_at_posts_are_those_of_gdal(tmp_path):
    """Horn's formula, as ``gdaldem slope`` and ``aspect`` have it, written out for one post."""
    terrain = rough(4)
    row, col = 9, 13
    z = terrain.heights_m[row - 1 : row + 2, col - 1 : col + 2].astype(float)
    dx = ((z[0, 2] + 2 * z[1, 2] + z[2, 2]) - (z[0, 0] + 2 * z[1, 0] + z[2, 0])) / (8 * SPACING_M[0])
    dy = ((z[2, 0] + 2 * z[2, 1] + z[2, 2]) - (z[0, 0] + 2 * z[0, 1] + z[0, 2])) / (8 * SPACING_M[1])
    aspect = math.degrees(math.atan2(dy, -dx))  # from the east, counter-clockwise
    compass = (90.0 - aspect) % 360.0
    relief = relief_at(terrain, col * SPACING_M[0], row * SPACING_M[1])
    assert relief.slope_deg == pytest.approx(math.degrees(math.atan(math.hypot(dx, dy))))
    assert relief.aspect_deg == pytest.approx(compass)


# Profiles


@settings(max_examples=40)
@given(st.integers(0, 5), unit, unit, unit, unit)
def test_profiles_are_exact_between_their_points_too(seed, ax, az, bx, bz):
    terrain = rough(seed)
    size = np.array(terrain.extent_m)
    start, end = np.array([ax, az]) * size, np.array([bx, bz]) * size
    profile = profile_between(terrain, start, end)
    assert profile.length_m == pytest.approx(math.dist(start, end))
    assert (np.diff(profile.distance_m) >= 0.0).all()
    if profile.length_m < 1e-6:
        return
    at = np.linspace(0.0, profile.length_m, 500)
    x, z = (start + at[:, None] / profile.length_m * (end - start)).T
    expected = terrain.heights_at(np.clip(x, 0, size[0]), np.clip(z, 0, size[1]))
    assert np.interp(at, profile.distance_m, profile.height_m) == pytest.approx(expected, abs=1e-6)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), unit, unit)
def test_on_a_plane_the_way_along_the_ground_and_the_climb_are_known(east, south, bx, bz):
    terrain = plane(east, south)
    end = np.array([bx, bz]) * terrain.extent_m
    profile = profile_between(terrain, np.zeros(2), end)
    rise = east * end[0] + south * end[1]
    assert profile.surface_m == pytest.approx(math.hypot(*end, rise), abs=1e-2)
    up, down = profile.climb_m
    assert up - down == pytest.approx(rise, abs=1e-2)
    assert min(up, down) < 1e-2


def test_profiles_have_gaps_where_there_is_no_ground():
    holes = np.zeros((24, 31), np.bool_)
    holes[:, 10:14] = True
    terrain = rough(1, holes=holes)
    profile = profile_between(terrain, np.array([50.0, 40.0]), np.array([200.0, 40.0]))
    gaps = profile.x_m[np.isnan(profile.height_m)]
    assert gaps.min() > 94.0
    assert gaps.max() < 136.0
    assert np.isfinite(profile.height_m[profile.x_m < 94.0]).all()
    assert profile.surface_m < 150.0 + np.abs(np.diff(profile.height_m[np.isfinite(profile.height_m)])).sum()


def test_even_the_narrowest_gap_is_a_gap():
    holes = np.zeros((24, 31), np.bool_)
    holes[:, 10] = True
    terrain = rough(1, holes=holes)
    profile = profile_between(terrain, np.array([92.0, 41.0]), np.array([108.0, 43.0]))
    assert np.isnan(profile.height_m).any()
    assert np.isfinite(profile.height_m[[0, -1]]).all()


def test_profiles_leave_the_terrain_with_a_gap():
    profile = profile_between(rough(1), np.array([-50.0, 40.0]), np.array([50.0, 40.0]))
    assert np.isnan(profile.height_m[profile.x_m < 0.0]).all()
    assert np.isfinite(profile.height_m[profile.x_m > 0.0]).all()
