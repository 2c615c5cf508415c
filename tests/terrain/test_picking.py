"""Which ground lies under a point of the picture, against the position target's answer and on simple surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.picking import pick_ground


def field(heights, **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), (10.0, 10.0), **others)


LEVEL = field(np.full((41, 61), 25.0))
Z, X = np.mgrid[:90, :120] * 0.2
HILLS = field(60 * np.sin(X) * np.cos(0.7 * Z) + 15 * np.sin(2.3 * X + Z))


@given(st.floats(-30, 30), st.floats(-80, -20), st.floats(0.2, 0.8), st.floats(0.2, 0.8))
def test_on_level_ground_it_is_where_the_ray_meets_the_plane(yaw, pitch, across, down):
    camera = Camera((300.0, 180.0, 200.0), yaw, pitch, fov_deg=20.0)
    half = np.tan(np.radians(10.0))
    ray = np.array([(2 * across - 1) * half * 1.5, (1 - 2 * down) * half, -1.0]) @ camera.view_from_eye()
    expected = camera.eye_m + ray * (25.0 - 180.0) / ray[1]
    found = pick_ground(LEVEL, camera, 1.5, (across, down))
    if 0 < expected[0] < 600 and 0 < expected[2] < 400:
        assert np.allclose(found, expected, atol=1e-3)
    else:
        assert found is None


@settings(deadline=None)
@given(st.floats(0, 360), st.floats(-60, -2), st.floats(5, 1150), st.floats(5, 850), st.floats(2, 300))
def test_it_lies_on_the_surface_and_on_the_ray_and_nothing_lies_before_it(yaw, pitch, x, z, above):
    camera = Camera((x, float(HILLS.heights_at(x, z)) + above, z), yaw, pitch)
    found = pick_ground(HILLS, camera, 1.0, (0.5, 0.5))
    along = np.linspace(0.0, 1.0, 4000)[:, None]
    if found is None:
        points = camera.eye_m + along * 2000.0 * camera.forward
        gap = points[:, 1] - HILLS.heights_at(points[:, 0], points[:, 2])
        assert not (gap < -1.0).any()  # a ray may graze a crest between two steps
        return
    found = np.array(found)
    assert abs(found[1] - HILLS.heights_at(found[0], found[2])) < 1e-2
    assert np.linalg.norm(np.cross(found - camera.eye_m, camera.forward)) < 1e-6 * np.linalg.norm(found - camera.eye_m)
    before = camera.eye_m + along[:-40] * (found - camera.eye_m)
    assert (before[:, 1] - HILLS.heights_at(before[:, 0], before[:, 2])).min() > -1.0


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 30.0), (90.0, 90.0), (180.0, 1.0)])
def test_there_is_no_ground_in_the_sky(yaw, pitch):
    assert pick_ground(LEVEL, Camera((300.0, 50.0, 200.0), yaw, pitch), 1.0, (0.5, 0.5)) is None


def test_straight_down_it_is_below_the_eye_and_from_afar_it_is_found_too():
    assert np.allclose(pick_ground(LEVEL, Camera((123.0, 90.0, 77.0), 0.0, -90.0), 1.0, (0.5, 0.5)), (123, 25, 77))
    far = Camera((300.0, 5_000.0, 40_000.0), 0.0, -np.degrees(np.arctan2(4975.0, 39_800.0)))
    assert np.allclose(pick_ground(LEVEL, far, 1.0, (0.5, 0.5)), (300.0, 25.0, 200.0), atol=1.0)


def test_ground_without_data_is_not_there():
    holes = np.zeros((41, 61), bool)
    holes[15:25, 25:35] = True
    terrain = field(np.full((41, 61), 25.0), holes=holes)
    assert pick_ground(terrain, Camera((300.0, 90.0, 200.0), 0.0, -90.0), 1.0, (0.5, 0.5)) is None
