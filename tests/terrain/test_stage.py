"""The stage: exact positions, one picture whatever the depth convention, and stages that do not disturb each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Georeference, Heightfield
from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage

SIZE_PX = (160, 90)


def hills(posts: int = 65, spacing_m: float = 30.0, height_m: float = 300.0, **others) -> Heightfield:
    row, col = np.mgrid[:posts, :posts] / (posts - 1)
    heights = height_m * (np.sin(7 * col + 1) * np.cos(5 * row) + 0.3 * np.sin(31 * col * row))
    return Heightfield(heights.astype(np.float32), (spacing_m, spacing_m), **others)


def overview(terrain: Heightfield) -> Camera:
    width_m, depth_m = terrain.extent_m
    return Camera((width_m / 2, terrain.height_range_m[1] + 0.3 * depth_m, depth_m * 1.1), 5.0, -30.0)


@pytest.fixture
def stage(gpu):
    made = Stage(gpu, open_scene(hills()), "reference")
    yield made
    made.release()


def test_positions_lie_on_the_surface(stage):
    terrain = stage.scene.heightfield
    world = stage.positions(overview(terrain), SIZE_PX)
    seen = np.isfinite(world[..., 0])
    assert 0.3 < seen.mean() < 0.95  # ground, and sky above it
    truth = terrain.heights_at(world[seen][:, 0], world[seen][:, 2])
    assert np.nanmax(np.abs(truth - world[seen][:, 1])) < 0.03  # of 2 km


def test_positions_lie_on_the_sight_rays(stage):
    camera = overview(stage.scene.heightfield)
    world = stage.positions(camera, SIZE_PX)
    offset = world - camera.eye_m
    ray = camera.ray_directions(*SIZE_PX)
    across = np.linalg.norm(np.cross(offset, ray), axis=-1) / np.linalg.norm(ray, axis=-1)
    assert np.nanmax(across / np.linalg.norm(offset, axis=-1)) < 1e-4  # sub-pixel


def test_the_picture_does_not_depend_on_where_on_earth_the_grid_lies(gpu):
    pictures = []
    for easting, northing in ((0.0, 0.0), (1e6, 7e6)):
        place = Georeference("EPSG:32633", (30.0, 0.0, easting, 0.0, -30.0, northing))
        stage = Stage(gpu, open_scene(hills(georeference=place)), "reference")
        pictures.append(stage.render(overview(stage.scene.heightfield), SIZE_PX))
        stage.release()
    assert np.array_equal(*pictures)


def test_an_eye_a_million_metres_from_the_origin_sees_exact_positions(gpu):
    # 1500 km of terrain: world coordinates of a million metres, seen from two metres above the ground.
    terrain = hills(spacing_m=24_000.0, height_m=20.0)
    stage = Stage(gpu, open_scene(terrain), "reference")
    x, z = 1.2e6, 1.3e6
    camera = Camera((x, float(terrain.heights_at(x, z)) + 2.0, z), 20.0, -40.0)
    world = stage.positions(camera, SIZE_PX)
    stage.release()
    seen = np.isfinite(world[..., 0])
    assert seen.all()
    off = np.abs(terrain.heights_at(world[..., 0], world[..., 2]) - world[..., 1])
    assert off.max() < 1e-3


def test_a_ridge_a_metre_away_and_ridges_200_km_away_hide_each_other_correctly(gpu):
    # Two ridges 200 km off, the farther one 100 m behind and lower by 2 m at the same picture height, flicker unless
    # depth resolves 5e-4 of the distance.
    heights = np.zeros((2001, 5), np.float32)
    heights[1, :], heights[0, :] = 4000.0, 3990.0
    terrain = Heightfield(heights, (40_000.0, 100.0))
    stage = Stage(gpu, open_scene(terrain), "reference")
    camera = Camera((80_000.0, 1.0, 199_999.0), 0.0, 1.0, fov_deg=4.0)
    world = stage.positions(camera, SIZE_PX)
    stage.release()
    high = world[..., 1] > 2000.0
    assert high.any()
    assert (world[..., 2][high] > 95.0).all()  # never the ridge behind


@pytest.mark.parametrize("view", ["shaded", "wireframe", "boxes"])
def test_logarithmic_depth_gives_the_picture_of_reversed_z(gpu, view):
    scene = open_scene(hills())
    camera = overview(scene.heightfield)
    fallback = Gpu(gpu.ctx, clip_control=False)
    pictures, worlds = [], []
    for each in (gpu, fallback):
        if each is fallback:
            gpu.release_state()
        stage = Stage(each, scene, "reference")
        pictures.append(stage.render(camera, SIZE_PX, view).astype(int))
        worlds.append(stage.positions(camera, SIZE_PX))
        stage.release()
    fallback.release()
    gpu.prepare_state()
    difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
    if view == "wireframe":  # the hardware's bias of lines is not to the last bit that of the shader
        assert (difference > 8).mean() < 0.002
    else:
        assert difference.max() <= 1
    assert np.array_equal(np.isnan(worlds[0]), np.isnan(worlds[1]))
    assert np.nanmax(np.abs(worlds[0] - worlds[1])) < 1e-3


def test_two_stages_on_one_gpu_do_not_disturb_each_other(gpu):
    holes = np.zeros((65, 65), np.bool_)
    holes[20:40, 20:40] = True
    solid, holed = (Stage(gpu, open_scene(hills(holes=h)), "reference") for h in (None, holes))
    holed.set_look(replace(holed.look, fog=False, contours=True))
    camera = overview(solid.scene.heightfield)
    alone = [stage.render(camera, SIZE_PX) for stage in (solid, holed)]
    mixed = [stage.render(camera, SIZE_PX) for stage in (solid, holed)]
    missing = [np.isnan(stage.positions(camera, SIZE_PX)[..., 0]).sum() for stage in (solid, holed)]
    for stage in (solid, holed):
        stage.release()
    assert np.array_equal(alone[0], mixed[0])
    assert np.array_equal(alone[1], mixed[1])
    assert missing[1] > missing[0] + 50


def test_holes_are_where_the_data_is_missing(gpu):
    holes = np.zeros((65, 65), np.bool_)
    holes[20:40, 10:30] = True
    stage = Stage(gpu, open_scene(hills(holes=holes)), "reference")
    terrain = stage.scene.heightfield
    camera = Camera((960.0, 3000.0, 960.0), 0.0, -90.0)
    world = stage.positions(camera, (200, 200))
    stage.release()
    rays = camera.ray_directions(200, 200)
    foot = camera.eye_m + rays * (3000.0 / -rays[..., 1:2])  # near enough on low hills
    col, row = foot[..., 0] / 30.0, foot[..., 2] / 30.0
    well_inside = (col > 14) & (col < 26) & (row > 24) & (row < 36)
    well_outside = ((col < 5) | (col > 35) | (row < 15) | (row > 45)) & (col > 8) & (col < 56) & (row > 8) & (row < 56)
    assert terrain.holes is not None
    assert np.isnan(world[well_inside]).all()
    assert np.isfinite(world[well_outside]).all()


def test_a_renderer_that_cannot_be_made_leaves_the_old_one(stage, monkeypatch):
    class Broken:
        name = "broken"
        Settings = RENDERERS["reference"].Settings

        def __init__(self, *_):
            raise RuntimeError("no such luck")

    monkeypatch.setitem(RENDERERS, "broken", Broken)
    before = stage.renderer
    with pytest.raises(RuntimeError, match="no such luck"):
        stage.set_renderer("broken")
    assert stage.renderer is before
    assert stage.render(overview(stage.scene.heightfield), SIZE_PX).any()


def test_a_setting_without_rebuild_keeps_the_renderer(stage):
    before = stage.renderer
    stage.set_renderer("reference", replace(before.settings, tolerance_px=3.0))
    assert stage.renderer is before
    assert before.settings.tolerance_px == 3.0


@pytest.mark.parametrize("above_m", [0.01, 1.0, 100.0, 1e5])
def test_the_near_plane_stays_below_the_clearance_of_the_eye(stage, above_m):
    terrain = stage.scene.heightfield
    x, z = 700.0, 500.0
    camera = Camera((x, float(terrain.heights_at(x, z)) + above_m, z))
    assert 0.0 < stage.frame(camera, SIZE_PX).near_m < above_m


def test_release_leaves_a_gpu_that_others_can_use(gpu):
    for _ in range(2):
        stage = Stage(gpu, open_scene(hills()), "geomorph")
        assert stage.render(overview(stage.scene.heightfield), SIZE_PX).any()
        stage.release()
