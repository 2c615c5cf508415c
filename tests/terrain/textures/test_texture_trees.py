"""Texture trees on the GPU: every pixel shows the tile it should, whatever is missing, evicted or broken.

Tiles of the sources here tell by their colour which tile they are.
"""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.atlas import SLOTS_PER_LAYER
from terrain.textures.look import LookSettings
from terrain.textures.tree import SLOT_PX, TILE_PX
from terrain.textures.trees import UPLOAD_BYTES

SIZE_PX = (160, 100)
CLEAR = LookSettings(fog=False)
POSTS, SPACING_M = 129, 10.0
EXTENT_M = (POSTS - 1) * SPACING_M


def colour_of(level, row, col):
    return np.array([20 + 28 * level, 20 + row % 16 * 14, 20 + col % 16 * 14], np.uint8)


class CodedSource:
    """Each tile in its own colour. Those named in ``broken`` cannot be read; fine ones wait for the gate."""

    notes, is_final, name = (), True, "coded"

    def __init__(self, terrain, size_px, broken=(), closed_below=0):
        self.size_px, self.image_from_post = size_px, whole_extent(terrain)
        self.broken, self.revision = set(broken), 0
        self.gate, self._closed_below = threading.Event(), closed_below
        self.read = []

    def read_tile(self, level, row, col):
        if level < self._closed_below:
            self.gate.wait(10.0)
        if (level, row, col) in self.broken:
            raise OSError("damaged")
        self.read.append((level, row, col))
        tile = np.full((SLOT_PX, SLOT_PX, 4), 255, np.uint8)
        tile[..., :3] = colour_of(level, row, col)
        return tile

    def close(self):
        self.gate.set()


def flat():
    return Heightfield(np.zeros((POSTS, POSTS), np.float32), (SPACING_M, SPACING_M))


@pytest.fixture
def staged(gpu):
    made = []

    def make(*sources, terrain=None, algorithm="reference", look=CLEAR):
        stage = Stage(gpu, open_scene(terrain or flat()), algorithm, look=look)
        made.append((stage, sources))
        stage.set_images(sources)
        return stage

    yield make
    for stage, sources in made:
        for source in sources:
            source.close()
        stage.release()
    assert not any(thread.name.startswith("tiles-") for thread in threading.enumerate())


def oblique(x=0.35, z=0.9, height_m=60.0, yaw=10.0, pitch=-18.0):
    return Camera((x * EXTENT_M, height_m, z * EXTENT_M), yaw, pitch)


def draw_once(stage, camera):
    """A picture as the window draws it: with what is there."""
    target = stage.target(SIZE_PX)
    stage.draw(stage.frame(camera, SIZE_PX), target)
    return target.read()[..., :3].astype(int)


def texels_of(stage, source, camera):
    """Level 0 pixel (height, width, 2) seen in each pixel of the picture; NaN where there is none."""
    world = stage.positions(camera, SIZE_PX)
    posts = np.stack([world[..., 0] / SPACING_M, world[..., 2] / SPACING_M, np.ones(world.shape[:2])], axis=-1)
    return posts @ source.image_from_post.T * source.size_px


def levels_shown(picture, px):
    """Level of the tile each pixel shows (-1 where there is none), having checked that it is a tile over that pixel."""
    height, width = px.shape[:2]
    level = np.full((height, width), -1)
    with np.errstate(invalid="ignore"):
        for k in range(8):
            reach = TILE_PX << k
            inner = (np.abs((px + reach / 2) % reach - reach / 2) > 2.0).all(axis=-1)  # clear of the tile's edge
            tile = np.floor(px / reach)
            expected = np.stack(
                [20.0 + 28 * k + 0 * tile[..., 0], 20 + tile[..., 1] % 16 * 14, 20 + tile[..., 0] % 16 * 14], -1
            )
            level[(np.abs(picture - expected).max(axis=-1) <= 4) & inner] = k
    return level


def inner_share(picture, px, stage):
    """Share of the ground's pixels that show a tile over them; pixels at the edge of a tile are not judged."""
    seen = np.isfinite(px[..., 0]) & (px > 2).all(axis=-1)
    level = levels_shown(picture, px)
    with np.errstate(invalid="ignore"):
        at_edge = (np.abs((px + TILE_PX / 2) % TILE_PX - TILE_PX / 2) <= 2.0).any(axis=-1)
    judged = seen & ~at_edge
    return (level[judged] >= 0).mean(), level, judged


@pytest.mark.parametrize("algorithm", RENDERERS)
def test_every_pixel_shows_the_tile_that_was_chosen_for_it(staged, algorithm):
    terrain = flat()
    source = CodedSource(terrain, (3000, 2200))
    stage = staged(source, terrain=terrain, algorithm=algorithm)
    camera = oblique()
    picture = stage.render(camera, SIZE_PX).astype(int)
    px = texels_of(stage, source, camera)
    share, level, judged = inner_share(picture, px, stage)
    assert judged.sum() > 3000
    assert share == 1.0
    member = stage.drape.trees._members[0]
    chosen = np.full(member.pages.tree.shapes[0], -1)
    chosen.ravel()[member.selection.cell] = member.selection.level
    col, row = (np.floor(px[judged] / TILE_PX).astype(int)).T
    assert np.array_equal(level[judged], chosen[row, col])
    assert len(np.unique(level[judged])) >= 3  # near and far


def test_filtering_knows_no_edges_of_tiles(staged):
    """A ramp stays a ramp, across tiles and levels."""
    terrain = flat()
    row, col = np.mgrid[:1500, :1500]
    ramp = np.stack([col * 200 / 1500, row * 200 / 1500, 0 * row], axis=-1).astype(np.uint8)
    source = ArraySource("ramp", ramp, whole_extent(terrain))
    stage = staged(source, terrain=terrain)
    camera = oblique()
    picture = stage.render(camera, SIZE_PX).astype(int)
    px = texels_of(stage, source, camera)
    seen = np.isfinite(px[..., 0])
    assert np.abs(picture[seen][:, :2] - px[seen] * 200 / 1500).max() <= 4.0


def test_parents_are_shown_until_tiles_come(staged):
    terrain = flat()
    source = CodedSource(terrain, (3000, 3000), closed_below=3)
    stage = staged(source, terrain=terrain)
    camera = oblique()
    px = texels_of(stage, source, camera)
    for _ in range(25):  # all that can be read is there long before
        draw_once(stage, camera)
        stage.drape.trees.wait(0.01)
    picture = draw_once(stage, camera)
    share, level, judged = inner_share(picture, px, stage)
    assert share == 1.0
    assert level[judged].min() == 3  # nothing finer can be read yet
    assert stage.is_loading
    assert stage.renderer.stats.extra["textures missing"] > 0
    source.gate.set()
    picture = stage.render(camera, SIZE_PX).astype(int)
    share, level, judged = inner_share(picture, px, stage)
    assert share == 1.0
    assert level[judged].min() == 0
    assert not stage.is_loading
    assert stage.renderer.stats.extra["textures missing"] == 0


def test_whatever_is_evicted_no_pixel_ever_shows_a_wrong_tile_and_the_budget_holds(staged):
    """A flight over an image of which the budget holds a part, drawn without ever waiting."""
    terrain = flat()
    source = CodedSource(terrain, (20_000, 20_000))
    stage = staged(source, terrain=terrain, look=replace(CLEAR, texture_budget_mib=16, texture_tolerance_px2=0.7))
    slots = 16 * 2**20 // (4 * SLOT_PX * SLOT_PX)
    assert slots % SLOTS_PER_LAYER == 0
    there = np.linspace(0.1, 0.9, 5)
    for way in [*there, *there[::-1], *there]:  # what was evicted comes into view again
        camera = oblique(way, 1.0 - 0.8 * way, 30.0, 40.0)
        at_once = draw_once(stage, camera)
        assert stage.drape.trees.uploaded_bytes <= UPLOAD_BYTES
        px = texels_of(stage, source, camera)
        while not stage.load_tiles(stage.frame(camera, SIZE_PX)):
            pass
        for picture in (at_once, draw_once(stage, camera)):
            share, _, judged = inner_share(picture, px, stage)
            assert judged.sum() > 1000
            assert share == 1.0 or len(source.read) <= slots  # in the first picture the root may not be there yet
        assert stage.drape.trees._slots.used <= slots
        assert stage.drape.trees.resident_bytes <= 16 * 2**20
    assert len(source.read) > 3 * slots  # two of three had to go


def test_a_tile_that_cannot_be_read_is_told_once_and_its_parent_shown(staged):
    terrain = flat()
    camera = Camera((0.35 * EXTENT_M, 100.0, 0.5 * EXTENT_M), 0.0, -90.0)  # above the edge between tiles 0 and 1
    source = CodedSource(terrain, (1500, 1500), broken={(1, 1, 1), (0, 2, 2)})
    stage = staged(source, terrain=terrain, look=replace(CLEAR, texture_tolerance_px2=8.0))
    stage.render(camera, SIZE_PX)
    picture = draw_once(stage, camera)
    share, level, judged = inner_share(picture, texels_of(stage, source, camera), stage)
    assert share == 1.0
    assert set(np.unique(level[judged])) == {1, 2}
    (message,) = stage.drape.trees.take_messages()
    assert "coded: tile 1, 1 of level 1" in message
    for _ in range(3):
        draw_once(stage, camera)
    assert stage.drape.trees.take_messages() == []
    assert not stage.is_loading


def test_an_image_of_which_nothing_can_be_read_is_refused(staged):
    terrain = flat()
    stage = staged(CodedSource(terrain, (100, 100), broken={(0, 0, 0)}), terrain=terrain)
    with pytest.raises(InputError, match="coded"):
        stage.render(oblique(), SIZE_PX)


def test_several_images_lie_over_one_another_where_each_has_something_to_show(staged):
    terrain = flat()
    red = np.zeros((64, 64, 4), np.uint8)
    red[:, :32] = (200, 0, 0, 255)
    blue = np.zeros((64, 64, 4), np.uint8)
    blue[32:] = (0, 0, 200, 128)
    sources = [ArraySource(name, pixels, whole_extent(terrain)) for name, pixels in (("red", red), ("blue", blue))]
    bare = staged(terrain=terrain)
    camera = Camera((EXTENT_M / 2, 1000.0, EXTENT_M / 2), 0.0, -90.0, fov_deg=50.0)
    ground = bare.render(camera, (100, 100)).astype(int)
    picture = staged(*sources, terrain=terrain).render(camera, (100, 100)).astype(int)
    for (row, col), expected in (
        ((25, 25), [200, 0, 0]), ((25, 75), ground[25, 75]),
        ((75, 25), [100, 0, 100]), ((75, 75), [*(ground[75, 75] / 2)[:2], 100 + ground[75, 75, 2] / 2]),
    ):  # fmt: skip
        assert np.abs(picture[row, col] - expected).max() <= 3, (row, col)


def test_changed_content_is_read_again_and_the_old_shown_meanwhile(staged):
    terrain = flat()
    source = ArraySource("one", np.full((300, 300, 3), 90, np.uint8), whole_extent(terrain))
    stage = staged(source, terrain=terrain)
    camera = Camera((EXTENT_M / 2, 500.0, EXTENT_M / 2), 0.0, -90.0)
    assert np.abs(stage.render(camera, SIZE_PX)[50, 80].astype(int) - 90).max() <= 2
    source.replace(np.full((300, 300, 3), 180, np.uint8))
    assert np.abs(draw_once(stage, camera)[50, 80] - 90).max() <= 2
    assert stage.is_loading
    assert np.abs(stage.render(camera, SIZE_PX)[50, 80].astype(int) - 180).max() <= 2


def test_a_larger_image_that_comes_takes_nothing_from_the_others(staged):
    terrain = flat()
    noise = np.random.default_rng(2).integers(0, 256, (3000, 3000, 3), np.uint8)
    small, large = (ArraySource("", noise[:size, :size], whole_extent(terrain)) for size in (600, 3000))
    stage = staged(small, terrain=terrain)
    camera = oblique()
    before = stage.render(camera, SIZE_PX)
    stage.drape.trees.add(large)  # the tables must grow for it; nothing of it is resident yet
    assert np.array_equal(draw_once(stage, camera), before)


def test_images_may_come_and_go_and_the_budget_may_change(staged):
    terrain = flat()
    coded, small = CodedSource(terrain, (2000, 2000)), CodedSource(terrain, (100, 3000))
    stage = staged(coded, terrain=terrain)
    camera = oblique()
    alone = stage.render(camera, SIZE_PX)
    number = stage.drape.trees.add(small)
    stage.render(camera, SIZE_PX)
    stage.drape.trees.remove(number)
    assert np.array_equal(stage.render(camera, SIZE_PX), alone)
    stage.set_look(replace(CLEAR, texture_budget_mib=64))
    assert np.array_equal(stage.render(camera, SIZE_PX), alone)
    stage.set_images([])
    bare = staged(terrain=terrain)
    assert np.array_equal(stage.render(camera, SIZE_PX), bare.render(camera, SIZE_PX))


def test_the_same_picture_twice(staged):
    terrain = flat()
    pictures = [
        staged(CodedSource(terrain, (5000, 5000)), terrain=terrain).render(oblique(), SIZE_PX) for _ in range(2)
    ]
    assert np.array_equal(*pictures)


def test_the_same_picture_wherever_tiles_lie_in_the_atlas(staged):
    terrain = flat()
    noise = np.random.default_rng(1).integers(0, 256, (2000, 2000, 3), np.uint8)
    pictures = []
    for before in ([], [oblique(0.7, 0.5, yaw=-60.0), oblique(0.2, 0.4, yaw=100.0), oblique(yaw=-30.0)]):
        stage = staged(ArraySource("noise", noise, whole_extent(terrain)), terrain=terrain)
        for camera in before:
            stage.render(camera, SIZE_PX)
        pictures.append(stage.render(oblique(), (960, 600)))  # rounding shows in few pixels
    assert np.array_equal(*pictures)


def test_no_more_images_than_the_shaders_know_are_taken(staged):
    terrain = flat()
    sources = [ArraySource(str(i), np.zeros((4, 4, 3), np.uint8), whole_extent(terrain)) for i in range(17)]
    with pytest.raises(InputError, match="at most 8 layers"):
        staged(*sources, terrain=terrain)


@pytest.mark.parametrize("algorithm", ["reference", "multiresolution"])
def test_the_tiles_of_a_large_picture_meet(staged, algorithm):
    """Each tile asks only for what it shows, at the levels of the whole picture."""
    terrain = flat()
    source = CodedSource(terrain, (9000, 9000))
    stage = staged(source, terrain=terrain, algorithm=algorithm, look=replace(CLEAR, texture_tolerance_px2=0.25))
    camera = oblique()
    whole = stage.render(camera, SIZE_PX).astype(int)
    px = texels_of(stage, source, camera)
    asked = len(stage.drape.trees._members[0].selection.tiles)
    frame, parts = stage.frame(camera, SIZE_PX), []
    for left in (0, 80):
        tile = frame.tile((left, 0), (80, SIZE_PX[1]))
        while not stage.load_tiles(tile):
            pass
        assert len(stage.drape.trees._members[0].selection.tiles) < asked
        target = stage.target(tile.viewport_px)
        stage.draw(tile, target, choose=left == 0)
        parts.append(target.read()[..., :3].astype(int))
    assert np.array_equal(levels_shown(np.concatenate(parts, axis=1), px), levels_shown(whole, px))
