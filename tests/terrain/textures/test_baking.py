"""Topographic baking: design rules on ground whose answer is known, and tiles that end in the bits of one bake."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures import baking
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.baking import RULES, bake_order, tile_rects
from terrain.textures.look import LookSettings

CLEAR = LookSettings(fog=False, palette="plaster")
SIZE_PX = (120, 90)


def field(heights, spacing_m=10.0, **others):
    return Heightfield(np.ascontiguousarray(heights, np.float32), (spacing_m, spacing_m), **others)


def hills(rows=150, cols=131, holes=None):
    z, x = np.mgrid[:rows, :cols] * 0.17
    return field(60 * np.sin(x) * np.cos(0.7 * z) + 20 * np.sin(2.3 * x + z) + 3 * np.sin(9 * x), holes=holes)


@pytest.fixture
def staged(gpu):
    made = []

    def make(terrain, look=CLEAR):
        made.append(Stage(gpu, open_scene(terrain), "reference", look=look))
        return made[-1]

    yield make
    for stage in made:
        stage.release()


@pytest.fixture
def small_tiles(monkeypatch):
    monkeypatch.setattr(baking, "TILE_POSTS", 32)


def from_above(terrain):
    width_m, depth_m = terrain.extent_m
    return Camera((width_m / 2, terrain.height_range_m[1] + 1.2 * depth_m, depth_m / 2), 0.0, -90.0, fov_deg=45.0)


def grey_image(terrain):
    return ArraySource("grey", np.full((8, 8, 3), 128, np.uint8), whole_extent(terrain))


def textures(stage):
    """Every level of colour and, where it is kept, light."""
    baker = stage._ground._baker
    found = []
    for texture in (baker.colour, baker.light):
        if texture is not None:
            levels = int(math.log2(max(texture.size))) + 1
            found += [np.frombuffer(texture.read(level=level), np.uint8) for level in range(levels)]
    return found


def draw(stage, camera):
    """One frame within the stage's budget."""
    return stage.render(camera, SIZE_PX)


@pytest.mark.parametrize(
    ("rule", "with_light"), [("sunlight", False), ("sunlight", True), ("hillshade", True), ("slope", False)]
)
def test_tiles_baked_one_by_one_end_in_the_bits_of_one_bake(staged, small_tiles, rule, with_light):
    holes = np.zeros((150, 131), bool)
    holes[40:60, 50:90] = True
    terrain = hills(holes=holes)
    look = replace(CLEAR, shading=rule, sun_azimuth_deg=100.0, sun_elevation_deg=15.0)
    at_once, stage = staged(terrain, look), staged(terrain, replace(CLEAR, shading="sunlight"))
    for each in (at_once, stage):
        each.set_images([grey_image(terrain)] * with_light)
    camera = from_above(terrain)
    draw(at_once, camera)
    draw(stage, camera)
    stage.bake_budget_ms = 1e-6
    stage.set_look(look)
    frames = 0
    while not frames or stage.is_loading:
        draw(stage, camera)
        frames += 1
    assert frames == 25  # one tile at a time
    for one, other in zip(textures(at_once), textures(stage), strict=True):
        assert np.array_equal(one, other)


def test_the_old_light_stays_until_a_tile_has_its_turn(staged, small_tiles):
    terrain = hills()
    camera = from_above(terrain)
    stage = staged(terrain)
    old = draw(stage, camera)
    stage.bake_budget_ms = 1e-6
    stage.set_look(replace(CLEAR, sun_azimuth_deg=120.0))
    between = draw(stage, camera)
    assert stage.is_loading
    same = (between == old).all(axis=-1).mean()
    assert 0.7 < same < 0.995  # one tile of 25 has changed
    while stage.is_loading:
        new = draw(stage, camera)
    assert (new == old).all(axis=-1).mean() < 0.5


def test_a_sun_that_moves_on_lets_no_tile_wait_for_ever(staged, small_tiles):
    terrain = hills()
    stage, camera = staged(terrain), from_above(terrain)
    draw(stage, camera)
    stage.bake_budget_ms = 1e-6
    for step in range(50):
        stage.set_look(replace(CLEAR, sun_azimuth_deg=100.0 + step))
        draw(stage, camera)
    baker = stage._ground._baker
    assert baker._baked_at.min() > baker._turn - 30


def test_pictures_off_screen_are_finished_at_once(staged):
    terrain = hills()
    camera, look = from_above(terrain), replace(CLEAR, sun_azimuth_deg=120.0)
    stage, fresh = staged(terrain), staged(terrain, look)
    draw(stage, camera)
    stage.set_look(look)
    assert np.array_equal(draw(stage, camera), draw(fresh, camera))
    assert not stage.is_loading


def test_tiles_in_sight_come_first_then_the_longest_waiting_then_the_nearest():
    terrain = field(np.zeros((129, 129)))
    tiles = tile_rects((129, 129), 32)
    north = Frame(Camera((645.0, 50.0, 700.0), 0.0, -5.0), (16, 9))
    baked_at = np.zeros(len(tiles), np.int64)
    order = bake_order(tiles, baked_at, terrain, north)
    row = tiles[order][:, 1] // 32
    behind = row >= 2
    assert not behind[:4].any()
    assert row[0] == 1  # the nearest in sight: what lies under the eye itself is not
    baked_at[order[0]] = 1
    assert bake_order(tiles, baked_at, terrain, north)[0] == order[1]


def test_tiles_cover_every_post_once():
    counts = np.zeros((70, 101), int)
    for x, y, width, height in tile_rects((101, 70), 32):
        counts[y : y + height, x : x + width] += 1
    assert (counts == 1).all()


def ground_grey(stage):
    """The baked colour of the middle of the grid."""
    draw(stage, from_above(stage.scene.heightfield))
    baker = stage._ground._baker
    width, height = baker.colour.size
    pixels = np.frombuffer(baker.colour.read(), np.uint8).reshape(height, width, 4)
    return pixels[height // 3 : -height // 3, width // 3 : -width // 3, :3].mean()


def ramp_towards(azimuth_deg, rise):
    """A plane that faces a direction; high in relief, so that its tint is about the same everywhere."""
    z, x = np.mgrid[:65, :65] * 10.0
    a = math.radians(azimuth_deg)
    return field(-rise * (math.sin(a) * (x - 320) - math.cos(a) * (z - 320)))


def test_slope_shading_asks_how_steep_not_where_it_faces_nor_for_the_sun(staged):
    look = replace(CLEAR, shading="slope")
    greys = {rise: [ground_grey(staged(ramp_towards(a, rise), look)) for a in (0, 90, 215)] for rise in (0.2, 0.8, 1.6)}
    for same in greys.values():
        assert np.ptp(same) < 2.0
    means = [np.mean(same) for same in greys.values()]
    assert means[0] > means[1] + 15
    assert means[1] > means[2] + 15
    stage = staged(ramp_towards(90, 0.8), replace(look, sun_azimuth_deg=10.0, sun_elevation_deg=3.0))
    assert abs(ground_grey(stage) - greys[0.8][1]) < 1.0


def test_hillshade_models_slopes_that_the_sun_leaves_in_shadow(staged):
    facing, turned = ramp_towards(305.0, 0.9), ramp_towards(125.0, 0.9)
    contrast = {}
    for rule in ("sunlight", "hillshade"):
        look = replace(CLEAR, shading=rule)
        contrast[rule] = ground_grey(staged(facing, look)) - ground_grey(staged(turned, look))
    assert 10 < contrast["hillshade"] < 0.85 * contrast["sunlight"]
    # Two slopes in shadow, turned against each other: one light alone shows them alike.
    sides = [ramp_towards(azimuth, 0.9) for azimuth in (125.0, 165.0)]
    one, other = (ground_grey(staged(side, replace(CLEAR, shading="hillshade"))) for side in sides)
    assert abs(one - other) > 6
    one, other = (ground_grey(staged(side, CLEAR)) for side in sides)
    assert abs(one - other) < 2


def test_light_alone_is_even_on_level_ground_and_follows_the_rule_elsewhere(staged):
    for rule in RULES:
        stage = staged(field(np.zeros((40, 40))), replace(CLEAR, shading=rule))
        stage.set_images([grey_image(stage.scene.heightfield)])
        draw(stage, from_above(stage.scene.heightfield))
        light = np.frombuffer(stage._ground._baker.light.read(), np.uint8)
        assert abs(int(light[0]) - 128) <= 3
