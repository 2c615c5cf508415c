"""The view of a whole terrain: all of it is in the picture, as large as can be, and keeps its colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.places.framing import frame_terrain
from terrain.heightfield import Heightfield
from terrain.scene import open_scene
from terrain.stage import Stage

RNG = np.random.default_rng(4)


def field(heights, spacing_m, **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), (spacing_m, spacing_m), **others)


def island():
    holes = np.ones((65, 65), np.bool_)
    holes[40:60, 5:20] = False
    return field(RNG.uniform(0, 80, (65, 65)), 10.0, holes=holes)


TERRAINS = {
    "two by two posts": field([[0.0, 0.5], [0.2, 0.1]], 1.0),
    "300 km": field(RNG.uniform(0, 3000, (61, 61)), 5000.0),
    "flat": field(np.full((33, 33), 120.0), 30.0),
    "tall": field(RNG.uniform(0, 5000, (17, 17)), 30.0),
    "long": field(RNG.uniform(0, 50, (5, 129)), 30.0),
    "island": island(),
}
EVERY = pytest.mark.parametrize("terrain", TERRAINS.values(), ids=TERRAINS)


@EVERY
@pytest.mark.parametrize("aspect", [0.4, 1.0, 16 / 9, 4.0])
def test_framed_terrain_fills_the_picture_in_its_middle(terrain, aspect):
    camera = frame_terrain(terrain, aspect, 50.0)
    data = np.ones(terrain.heights_m.shape, np.bool_) if terrain.holes is None else ~terrain.holes
    (north, south), (west, east) = (np.flatnonzero(data.any(axis=axis))[[0, -1]] for axis in (1, 0))
    dx, dz = terrain.spacing_m
    box = [[x, y, z] for x in (west * dx, east * dx) for y in terrain.height_range_m for z in (north * dz, south * dz)]
    view = (np.array(box) - camera.eye_m) @ camera.view_from_eye().T
    assert (view[:, 2] < 0).all()
    half = np.tan(np.radians(25.0))
    reach = view[:, :2] / (-view[:, 2:] * half * [aspect, 1.0])  # -1 to 1 across the picture
    assert np.abs(reach).max() == pytest.approx(0.9)
    assert reach.max(axis=0) == pytest.approx(-reach.min(axis=0))


@EVERY
def test_framed_terrain_keeps_most_of_its_colours_in_the_haze(gpu, terrain):
    size_px = (128, 72)
    stage = Stage(gpu, open_scene(terrain), "reference")
    camera = frame_terrain(terrain)
    ground = np.isfinite(stage.positions(camera, size_px)[..., 0])
    hazy = stage.render(camera, size_px)[ground].astype(float)
    haze = 255 * np.array(stage._uniforms.horizon[:3])
    stage.set_look(replace(stage.look, fog=False))
    clear = stage.render(camera, size_px)[ground]
    stage.release()
    left = ((hazy - haze) * (clear - haze)).sum(axis=1) / np.square(clear - haze).sum(axis=1)
    assert ground.mean() > 0.02
    assert left.mean() > 0.75
    assert left.min() > 0.62
