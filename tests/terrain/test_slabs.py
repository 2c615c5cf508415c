"""The embedded scene of three base planes: the wall stands in the ground, the slab hangs over it."""

from __future__ import annotations

import numpy as np

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays
from terrain.synthetic.slabs import build_slabs, build_slabs_terrain


def first_hit(plane, origin, direction):
    g = plane.map_from_world
    heights = plane.heightfield.heights_m
    o, d = (g @ [*origin, 1.0])[None, :3], (g[:3, :3] @ direction)[None]
    return cast_rays(heights, build_bounds(heights), o, d).t[0]


def test_the_wall_is_rooted_in_the_ground_and_rises_above_it():
    terrain = build_slabs_terrain(257)
    wall, _ = build_slabs(terrain)
    corners = wall.corners_m((0.0, 0.4))
    ground = terrain.heights_at(corners[:, 0], corners[:, 2])
    above = corners[:, 1] - ground
    assert (above > 15).sum() == 4
    assert (above < 0).sum() == 4


def test_between_the_ground_and_the_slab_there_is_room_and_its_face_looks_down():
    terrain = build_slabs_terrain(257)
    _, slab = build_slabs(terrain)
    normal = slab.world_from_plane[:3, :3] @ [0.0, 1.0, 0.0]
    assert normal[1] < -0.9
    centre = slab.corners_m((0.0, 0.0)).mean(axis=0)
    ground = float(terrain.heights_at(centre[0], centre[2]))
    t = first_hit(slab, (centre[0], ground + 1.7, centre[2]), np.array([0.0, 1.0, 0.0]))
    assert 10 < t < 60
    assert np.isinf(first_hit(slab, (centre[0], centre[1] + 50, centre[2]), np.array([0.0, -1.0, 0.0])))


def test_the_hills_depend_on_the_seed_alone():
    assert np.array_equal(build_slabs_terrain(65, 1).heights_m, build_slabs_terrain(65, 1).heights_m)
    assert not np.array_equal(build_slabs_terrain(65, 1).heights_m, build_slabs_terrain(65, 2).heights_m)
    assert np.ptp(build_slabs_terrain(65).heights_m) <= 60.001
