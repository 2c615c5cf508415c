"""The embedded scene of three base planes: the wall stands in the ground, the slab hangs over it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays
from terrain.heightfield import Heightfield
from terrain.synthetic.slabs import EXTENT_M, RELIEF_M, build_slabs, planes_beside, slabs_heights


def hills(size=257, seed=0):
    return Heightfield(slabs_heights(size, seed), (EXTENT_M / (size - 1),) * 2)


def first_hit(plane, origin, direction):
    g = plane.map_from_world
    heights = plane.heightfield.heights_m
    o, d = (g @ [*origin, 1.0])[None, :3], (g[:3, :3] @ direction)[None]
    return cast_rays(heights, build_bounds(heights), o, d).t[0]


def test_the_wall_is_rooted_in_the_ground_and_rises_above_it():
    terrain = hills()
    wall, _ = build_slabs(terrain)
    corners = wall.corners_m((0.0, 0.4))
    ground = terrain.heights_at(corners[:, 0], corners[:, 2])
    above = corners[:, 1] - ground
    assert (above > 15).sum() == 4
    assert (above < 0).sum() == 4


def test_between_the_ground_and_the_slab_there_is_room_and_its_face_looks_down():
    terrain = hills()
    _, slab = build_slabs(terrain)
    normal = slab.world_from_plane[:3, :3] @ [0.0, 1.0, 0.0]
    assert normal[1] < -0.9
    centre = slab.corners_m((0.0, 0.0)).mean(axis=0)
    ground = float(terrain.heights_at(centre[0], centre[2]))
    t = first_hit(slab, (centre[0], ground + 1.7, centre[2]), np.array([0.0, 1.0, 0.0]))
    assert 10 < t < 60
    assert np.isinf(first_hit(slab, (centre[0], centre[1] + 50, centre[2]), np.array([0.0, -1.0, 0.0])))


def test_the_hills_are_the_same_at_every_size_and_others_with_another_seed():
    assert np.allclose(slabs_heights(129, 1)[::2, ::2], slabs_heights(65, 1), atol=1e-3)
    assert not np.allclose(slabs_heights(65, 1), slabs_heights(65, 2), atol=1.0)
    for seed in range(20):
        heights = slabs_heights(65, seed)
        assert heights.min() >= 0
        assert heights.max() <= RELIEF_M


def test_planes_stand_beside_their_own_scene_only():
    terrain = hills(33)
    assert planes_beside(terrain) == ()
    assert planes_beside(replace(terrain, name="planes")) == ()  # a file of that name
    assert len(planes_beside(replace(terrain, name="planes", notes=("Embedded scene, seed 0: hills",)))) == 2
