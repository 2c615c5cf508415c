"""The look: light, palettes, water and contours, on terrains whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.frame_block import mean_density, pack_frame
from terrain.heightfield import Heightfield
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures.look import LookSettings, automatic_interval_m, look_uniforms, shading_defines, sun_direction
from terrain.textures.palettes import PALETTES, read_palette

SIZE_PX = (160, 120)
CLEAR = LookSettings(fog=False)


def field(heights, spacing_m=10.0, **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), (spacing_m, spacing_m), **others)


def ramp(posts=65, rise=0.4):
    """Rises to the east."""
    return field(np.tile(np.arange(posts) * 10.0 * rise, (posts, 1)))


@pytest.fixture
def staged(gpu):
    made = []

    def make(terrain, look=CLEAR, algorithm="reference"):
        made.append(Stage(gpu, open_scene(terrain), algorithm, look=look))
        return made[-1]

    yield make
    for stage in made:
        stage.release()


def from_above(terrain, height_m=800.0):
    width_m, depth_m = terrain.extent_m
    return Camera((width_m / 2, terrain.height_range_m[1] + height_m, depth_m / 2), 0.0, -90.0, fov_deg=30.0)


def lightness(colours):
    """CIE L* of sRGB (..., 3) uint8."""
    linear = np.where(colours / 255 <= 0.04045, colours / 255 / 12.92, ((colours / 255 + 0.055) / 1.055) ** 2.4)
    y = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(y > 0.008856, 116 * np.cbrt(y) - 16, 903.3 * y)


@pytest.mark.parametrize("name", PALETTES)
def test_palettes_are_complete(name):
    palette = read_palette(name)
    assert palette.colours.shape == (2, 256, 3)
    assert palette.title
    assert palette.help.endswith(".")


@pytest.mark.parametrize("name", ["atlas", "cividis", "desert", "plaster"])
def test_lightness_of_measuring_palettes_rises_so_that_colour_blind_eyes_can_read_them(name):
    rise = np.diff(lightness(read_palette(name).colours[0][::8].astype(float)))
    assert rise.min() >= 0.0


@given(st.floats(0, 360), st.floats(0, 90))
def test_sun_direction_is_a_unit_vector_of_that_elevation(azimuth, elevation):
    x, y, z = sun_direction(replace(CLEAR, sun_azimuth_deg=azimuth, sun_elevation_deg=elevation))
    assert np.isclose(x * x + y * y + z * z, 1.0)
    assert np.isclose(y, np.sin(np.radians(elevation)))


def test_the_sun_stands_where_the_compass_says():
    east = sun_direction(replace(CLEAR, sun_azimuth_deg=90.0, sun_elevation_deg=0.0))
    assert np.allclose(east, (1, 0, 0), atol=1e-9)
    south = sun_direction(replace(CLEAR, sun_azimuth_deg=180.0, sun_elevation_deg=0.0))
    assert np.allclose(south, (0, 0, 1), atol=1e-9)


@given(st.floats(0.01, 9000))
def test_automatic_contours_are_round_and_neither_few_nor_many(relief_m):
    interval = automatic_interval_m(relief_m)
    assert 8 <= relief_m / interval <= 32
    mantissa = interval / 10 ** np.floor(np.log10(interval) + 1e-9)
    assert np.isclose(mantissa, [1, 2, 5, 10]).any()


def test_what_is_off_is_not_compiled():
    assert shading_defines(replace(CLEAR, contours=False)) == {}
    assert shading_defines(LookSettings(fog=True, contours=True)) == {"FOG": 1, "CONTOURS": 1}
    assert shading_defines(LookSettings(fog_height_m=300.0)) == {"FOG": 1, "HEIGHT_FOG": 1}


@pytest.mark.parametrize(("azimuth", "elevation"), [(305.0, 34.0), (90.0, 3.0), (200.0, 89.0), (0.0, 90.0)])
def test_the_disc_of_the_sun_is_in_the_middle_of_a_look_at_it(staged, azimuth, elevation):
    stage = staged(ramp(), replace(CLEAR, sun_azimuth_deg=azimuth, sun_elevation_deg=elevation))
    eye = (320.0, 2000.0, 320.0)
    light = lightness(stage.render(Camera(eye, azimuth, elevation, 10.0, fov_deg=10.0), SIZE_PX).astype(int))
    disc = light > (light.max() + np.median(light)) / 2
    row, col = np.nonzero(disc)
    assert abs(row.mean() - SIZE_PX[1] / 2) < 1.0
    assert abs(col.mean() - SIZE_PX[0] / 2) < 1.0
    radius_px = 0.0152 * stage.frame(Camera(eye, fov_deg=10.0), SIZE_PX).pixels_per_radian
    assert disc.sum() == pytest.approx(np.pi * radius_px**2, rel=0.1)
    stage.set_look(replace(CLEAR, sun_azimuth_deg=azimuth + 180.0, sun_elevation_deg=elevation))
    behind = lightness(stage.render(Camera(eye, azimuth, elevation / 3, fov_deg=10.0), SIZE_PX).astype(int))
    assert np.ptp(behind) < 0.5 * (light.max() - np.median(light))


def test_haze_takes_the_share_of_the_colour_that_koschmieder_says(staged):
    """A wall at several distances, with and without haze: what is left of its contrast to the horizon."""
    heights = np.zeros((65, 65))
    heights[:8] = 400.0
    stage = staged(field(heights))
    for distance_m in (20.0, 150.0, 400.0):
        camera = Camera((320.0, 60.0, 78.5 + distance_m), 0.0, 0.0, fov_deg=4.0)
        stage.set_look(CLEAR)
        clear = stage.render(camera, SIZE_PX)[40:80, 60:100].mean(axis=(0, 1))
        stage.set_look(replace(CLEAR, fog=True, visibility_km=0.4))
        hazy = stage.render(camera, SIZE_PX)[40:80, 60:100].mean(axis=(0, 1))
        horizon = 255 * np.array(stage._uniforms.horizon[:3])
        left = float(np.dot(hazy - horizon, clear - horizon) / np.dot(clear - horizon, clear - horizon))
        assert left == pytest.approx(np.exp(-3.912 * distance_m / 400.0), abs=0.01)


@given(st.floats(0.0, 50.0))
def test_mean_density_is_the_mean_of_haze_that_thins_out(rise):
    height = (np.arange(20_000) + 0.5) / 20_000 * rise
    assert mean_density(rise) == pytest.approx(np.exp(-height).mean(), rel=1e-5)


def density(look, terrain, eye_height_m):
    """Of the haze [1/m] that a frame with its eye above the lowest ground lays over every point."""
    camera = Camera((0.0, terrain.height_range_m[0] + eye_height_m, 0.0))
    return float(pack_frame(Frame(camera, SIZE_PX), terrain, look_uniforms(look, terrain))["fog"][0])


def test_automatic_haze_parts_ridges_seen_from_the_ground_and_thins_as_the_eye_rises():
    terrain = ramp(257)
    diagonal_m = np.hypot(np.hypot(*terrain.extent_m), np.ptp(terrain.height_range_m))
    low, higher, highest = (density(LookSettings(), terrain, rise * diagonal_m) for rise in (0.0, 0.02, 1.0))
    assert low > higher > highest
    assert 0.3 < np.exp(-low * 0.5 * diagonal_m) < 0.5
    for rise in (1.0, 10.0, 1000.0):  # straight down through all of it, from however high
        assert np.exp(-density(LookSettings(), terrain, rise * diagonal_m) * rise * diagonal_m) > 0.85


def test_a_visibility_that_was_asked_for_is_the_same_from_every_height():
    terrain, asked = ramp(), LookSettings(visibility_km=30.0)
    assert density(asked, terrain, 0.0) == density(asked, terrain, 1e5) == pytest.approx(3.912 / 30e3)


def test_a_slope_is_brighter_with_the_sun_on_it(staged):
    stage = staged(ramp())
    camera = from_above(stage.scene.heightfield)
    brightness = {}
    for azimuth in (90.0, 270.0):
        stage.set_look(replace(CLEAR, sun_azimuth_deg=azimuth))
        brightness[azimuth] = stage.render(camera, SIZE_PX).mean()
    assert brightness[270.0] > brightness[90.0] + 25  # the ramp rises to the east: it faces west


def test_a_wall_casts_a_shadow_away_from_the_sun(staged):
    heights = np.zeros((129, 129))
    heights[:, 60:64] = 150.0
    stage = staged(field(heights), replace(CLEAR, palette="plaster", sun_azimuth_deg=270.0, sun_elevation_deg=40.0))
    picture = stage.render(from_above(stage.scene.heightfield, 2000.0), (200, 200)).mean(axis=-1)
    west, east = picture[100, 60:80].mean(), picture[100, 108:116].mean()
    assert east < west - 40


def test_light_does_not_change_with_level_of_detail(staged):
    rng = np.random.default_rng(3)
    terrain = field(rng.normal(0, 0.02, (129, 129)).cumsum(0).cumsum(1))
    pictures = []
    for tolerance in (0.25, 16.0):
        stage = staged(terrain, algorithm="geomorph")
        stage.set_renderer("geomorph", replace(stage.renderer.settings, tolerance_px=tolerance))
        pictures.append(stage.render(from_above(terrain, 2600.0), SIZE_PX).astype(int))
        drawn = stage.renderer.stats.triangles
        pictures.append(drawn)
    assert pictures[1] > pictures[3]  # other triangles
    difference = np.abs(pictures[0] - pictures[2]).mean()
    assert difference < 2.0


def test_water_covers_exactly_what_lies_below_its_level(staged):
    terrain = ramp(129)
    level_m = 250.0
    stage = staged(terrain)
    camera = from_above(terrain, 1500.0)
    world = stage.positions(camera, SIZE_PX)
    dry = stage.render(camera, SIZE_PX).astype(int)
    stage.set_look(replace(CLEAR, water=True, water_level_m=level_m))
    wet = stage.render(camera, SIZE_PX).astype(int)
    changed = np.abs(wet - dry).max(axis=-1) > 4
    inside = np.isfinite(world[..., 0])
    assert not changed[inside & (world[..., 1] > level_m + 1.0)].any()
    assert changed[inside & (world[..., 1] < level_m - 15.0)].all()


def test_beside_the_terrain_and_below_its_edge_water_is_deep(staged):
    terrain = ramp(129)  # its eastern edge stands 500 m above its western one
    camera = Camera((1800.0, 1500.0, 640.0), -90.0, -50.0)  # from the east, in below the high edge
    stage = staged(terrain, replace(CLEAR, water=True, water_level_m=100.0))
    sea = stage.render(camera, SIZE_PX).astype(int)[np.isnan(stage.positions(camera, SIZE_PX)[..., 0])]
    stage.set_look(CLEAR)
    assert len(sea) > 0.3 * SIZE_PX[0] * SIZE_PX[1]
    assert np.ptp(sea.mean(axis=-1)) < 40  # the backdrop shines through nowhere


def test_contours_lie_at_multiples_of_their_interval(staged):
    terrain = ramp(129)
    stage = staged(terrain)
    camera = from_above(terrain, 600.0)
    world = stage.positions(camera, SIZE_PX)[60]
    plain = stage.render(camera, SIZE_PX)[60].astype(int)
    stage.set_look(replace(CLEAR, contours=True, contour_interval_m=20.0))
    lined = stage.render(camera, SIZE_PX)[60].astype(int)
    off_m = np.abs((world[:, 1] + 10.0) % 20.0 - 10.0)
    per_px_m = np.abs(np.gradient(world[:, 1]))
    cover = np.abs(lined - plain).max(axis=-1)
    assert (cover[off_m > 2.5 * per_px_m] <= 2).all()
    assert (cover[off_m < 0.4 * per_px_m] > 15).all()
    assert (off_m < 0.4 * per_px_m).sum() >= 3


def test_fog_takes_more_of_what_is_far(staged):
    stage = staged(field(np.zeros((129, 129)), 1000.0))
    camera = Camera((64_000.0, 800.0, 128_000.0), 0.0, -10.0)
    clear = stage.render(camera, SIZE_PX).astype(int)
    stage.set_look(LookSettings(fog=True, visibility_km=60.0))
    hazy = stage.render(camera, SIZE_PX).astype(int)
    change = np.abs(hazy - clear).sum(axis=-1)[:, 80]
    assert change[45] > change[115] + 30  # towards the horizon, at the foot of the picture


def test_haze_with_a_height_lies_in_the_valleys(staged):
    row, _ = np.mgrid[:129, :129]
    stage = staged(field(np.where(row < 64, 2000.0, 0.0), 1000.0))
    low, high = Camera((64_000.0, 300.0, 128_000.0), 0.0, -3.0), Camera((64_000.0, 2300.0, 62_000.0), 0.0, -3.0)
    changes = []
    for camera in (low, high):
        stage.set_look(CLEAR)
        clear = stage.render(camera, SIZE_PX).astype(int)
        stage.set_look(LookSettings(visibility_km=200.0, fog_height_m=300.0))
        changes.append(np.abs(stage.render(camera, SIZE_PX).astype(int) - clear)[100].mean())
    assert changes[0] > 2 * changes[1]
