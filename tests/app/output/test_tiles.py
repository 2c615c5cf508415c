"""A picture drawn in tiles is the picture drawn at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.output.rendering import draw_bands
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.frame_block import Look, pack_frame
from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.synthetic import make_scene

CAMERA = Camera((300.0, 190.0, 300.0), 130.0, -14.0, 6.0, 70.0)
SIZE = (96, 54)


@given(st.integers(1, 95), st.integers(1, 53), st.integers(1, 60), st.integers(1, 60))
def test_a_point_lies_where_it_lies_in_the_whole_picture(left, bottom, width, height):
    whole = Frame(CAMERA, SIZE)
    size = min(width, SIZE[0] - left), min(height, SIZE[1] - bottom)
    tile = whole.tile((left, bottom), size)
    assert (tile.whole, tile.aspect, tile.pixels_per_radian) == (whole, whole.aspect, whole.pixels_per_radian)
    point = np.append(CAMERA.forward + np.array([0.1, -0.2, 0.05]), 1.0)

    def pixel(frame):
        clip = frame.clip_from_eye @ point
        return (clip[:2] / clip[3] * 0.5 + 0.5) * frame.viewport_px

    assert pixel(tile) + np.array([left, bottom]) == pytest.approx(pixel(whole))
    inside = (pixel(tile) > 0).all() and (pixel(tile) < size).all()
    assert inside == bool((tile.side_planes @ point[:3] > 0).all())


def test_sight_rays_of_a_tile_are_those_of_its_pixels():
    terrain = make_scene("flat", 17, 0)
    whole = Frame(CAMERA, SIZE)
    rays = pack_frame(whole, terrain, Look())["ray"][:, :3].astype(np.float64)
    tile = pack_frame(whole.tile((24, 27), (48, 27)), terrain, Look())["ray"][:, :3]
    assert tile[0] == pytest.approx(rays[0] + 0.25 * rays[1] + 0.5 * rays[2], abs=1e-6)
    assert tile[1] == pytest.approx(0.5 * rays[1], abs=1e-6)
    assert tile[2] == pytest.approx(0.5 * rays[2], abs=1e-6)


@pytest.mark.parametrize("name", RENDERERS)
def test_tiles_make_the_picture_drawn_at_once(gpu, name):
    stage = Stage(gpu, open_scene(make_scene("waves", 65, 0)), name)
    try:
        whole = stage.render(CAMERA, SIZE).astype(int)
        bands = [band for band in draw_bands(stage, CAMERA, SIZE, "shaded", tile_px=40) if band is not None]
    finally:
        stage.release()
    tiled = np.concatenate(bands).astype(int)
    assert (len(bands), tiled.shape) == (2, whole.shape)
    off = np.abs(tiled - whole).max(axis=-1)
    assert whole.std() > 10.0
    assert np.percentile(off, 99) <= 3  # the sky's colours are interpolated between other corners
    assert (off > 24).mean() < 0.004  # pixels on edges may fall to either side
