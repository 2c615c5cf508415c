"""Base planes: where they stand, and that their transform takes them back."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays
from terrain.heightfield import Heightfield
from terrain.planes import BasePlane, place_plane


def test_a_placed_plane_maps_its_own_posts_back():
    heights = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    plane = BasePlane(Heightfield(heights, (2.0, 3.0)), place_plane((1e5, 20.0, -3e6), 30.0, 70.0, 10.0))
    post = np.array([4.0 * 2.0, heights[3, 4], 3 * 3.0, 1.0])
    world = plane.world_from_plane @ post
    np.testing.assert_allclose(plane.map_from_world @ world, [4.0, 3.0, heights[3, 4], 1.0], atol=1e-8)
    assert np.allclose(plane.world_from_plane[:3, :3] @ plane.world_from_plane[:3, :3].T, np.eye(3))


def test_a_wall_tilted_upright_is_hit_by_level_rays():
    """Tilted by 90 degrees about its columns' axis the plane's normal lies along z: a wall."""
    wall = BasePlane(Heightfield(np.full((5, 9), 0.25, np.float32), (1.0, 1.0)), place_plane((10.0, 0.0, 20.0), 0, 90))
    g = wall.map_from_world
    origin, direction = np.array([12.0, -2.0, 50.0, 1.0]), np.array([0.0, 0.0, -1.0, 0.0])
    o, d = (g @ origin)[None, :3], (g @ direction)[None, :3]
    heights = wall.heightfield.heights_m
    hits = cast_rays(heights, build_bounds(heights), o, d)
    np.testing.assert_allclose(hits.t, 50.0 - 20.25, rtol=1e-9)


def test_a_plane_that_is_no_plane_is_refused():
    flat = Heightfield(np.zeros((2, 2), np.float32), (1.0, 1.0))
    with pytest.raises(ValueError, match="invertible"):
        BasePlane(flat, np.diag([1.0, 0.0, 1.0, 1.0]))
    with pytest.raises(ValueError, match="affine"):
        BasePlane(flat, np.full((4, 4), np.nan))
