"""The choice of tiles: fine enough, no finer than that, near ones in time, never more than there is room for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.textures.pages import ABSENT, Pages, Slots
from terrain.textures.select import (
    Selection,
    select_for_levels,
    select_levels,
    select_tiles,
    split_near,
    texel_errors_px2,
)
from terrain.textures.tree import TILE_PX, TextureTree

EXTENT_M = 10_000.0
SIZES = st.tuples(st.integers(1, 12_000), st.integers(1, 12_000))
EYES = st.tuples(st.floats(-12e3, 22e3), st.floats(1.0, 9e3), st.floats(-12e3, 22e3))


def tree_of(size, image_from_post=None):
    """An image over 1001 x 1001 posts of 10 m."""
    whole = np.array([[0.001, 0.0, 0.0], [0.0, 0.001, 0.0]])
    return TextureTree(size, whole if image_from_post is None else np.asarray(image_from_post), (10.0, 10.0))


def frame_at(eye, yaw=30.0, pitch=-20.0):
    return Frame(Camera(tuple(eye), yaw, pitch), (320, 180))


def boxes(count=16, height_m=200.0):
    """The ground as count x count boxes."""
    size = EXTENT_M / count
    row, col = (a.ravel() for a in np.mgrid[:count, :count])
    lower = np.stack([col * size, np.zeros(count**2), row * size], axis=1)
    return lower, lower + np.array([size, height_m, size])


def test_gamma_of_level_ground_below_is_the_area_of_its_projection():
    tree, eye = tree_of((1000, 1000)), np.array([5000.0, 800.0, 5000.0])
    frame = frame_at(eye, 0.0, -90.0)
    point = np.array([[5000.0, 0.0, 5000.0]])
    gamma, distance = texel_errors_px2(tree, point, point, frame)
    side_px = 10.0 * frame.pixels_per_radian / 800.0
    assert distance == pytest.approx(800.0)
    assert gamma == pytest.approx(side_px**2, rel=1e-6)


@given(st.floats(-35.0, 35.0), st.floats(-15.0, 15.0))
def test_gamma_is_the_projected_area_anywhere_in_the_picture(across_deg, up_deg):
    tree, eye = tree_of((100_000, 100_000)), np.array([5000.0, 1000.0, 5000.0])
    frame = frame_at(eye, 0.0, -45.0)
    way = Camera((0.0, 0.0, 0.0), across_deg, -45.0 + up_deg).forward
    spot = eye + way * (-1000.0 / way[1])
    gamma, _ = texel_errors_px2(tree, spot[None], spot[None], frame)
    clip = frame.clip_from_eye[[0, 1, 3], :3]
    corner = spot - eye + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]])
    x, y, w = clip @ corner.T
    px = np.stack([x / w * 160, y / w * 90])
    area = abs(np.linalg.det(np.stack([px[:, 1] - px[:, 0], px[:, 2] - px[:, 0]])))
    assert gamma[0] == pytest.approx(area, rel=0.02)


@given(SIZES, EYES, st.floats(0.25, 16.0))
def test_levels_are_the_coarsest_within_the_tolerance(size, eye, tolerance):
    tree, frame = tree_of(size), frame_at(eye)
    lower, upper = boxes()
    level, _ = select_levels(tree, lower, upper, frame, tolerance)
    gamma = texel_errors_px2(tree, lower, upper, frame)[0]
    assert ((gamma * 4.0**level <= tolerance * (1 + 1e-9)) | (level == 0)).all()
    assert ((gamma * 4.0 ** (level + 1) > tolerance * (1 - 1e-9)) | (level == tree.top_level)).all()


@settings(max_examples=40)
@given(SIZES, EYES, st.sampled_from([0.0, 0.3]), st.integers(1, 40))
def test_every_cell_under_a_box_is_covered_by_one_wanted_tile_no_coarser_than_the_box_needs(size, eye, turn, count):
    c, s = np.cos(turn) * 0.0013, np.sin(turn) * 0.0013
    tree = tree_of(size, [[c, -s, 0.1], [s, c, -0.2]])  # turned, and over a part of the ground only
    frame = frame_at(eye)
    lower, upper = boxes(count)
    needed, distance = select_levels(tree, lower, upper, frame, 1.0)
    chosen = select_for_levels(tree, lower, upper, needed, distance)
    level_of = dict(zip(chosen.cell.tolist(), chosen.level.tolist(), strict=True))
    wanted = set(chosen.tiles.tolist())
    rng = np.random.default_rng(count)
    for box in rng.integers(0, len(lower), 20):
        x, z = rng.uniform(lower[box, [0, 2]], upper[box, [0, 2]])
        px = tree.px_from_ground @ [x, z, 1.0]
        if ((px < 0) | (px >= size)).any():
            continue
        col, row = (px // TILE_PX).astype(int)
        level = level_of[int(tree.number_of(0, row, col))]
        assert level <= needed[box]
        assert int(tree.number_of(level, row >> level, col >> level)) in wanted


@given(SIZES, EYES)
def test_ancestors_come_before_their_descendants_and_near_tiles_first(size, eye):
    tree = tree_of(size)
    chosen = select_tiles(tree, *boxes(), frame_at(eye), 1.0)
    assert len(set(chosen.tiles.tolist())) == len(chosen.tiles)
    place = {number: i for i, number in enumerate(chosen.tiles.tolist())}
    level, row, col = tree.locate(chosen.tiles)
    assert level[0] == tree.top_level
    assert (np.diff(level) <= 0).all()
    for i in np.flatnonzero(level < tree.top_level):
        assert place[int(tree.number_of(level[i] + 1, row[i] // 2, col[i] // 2))] < i


@given(SIZES, EYES, st.integers(1, 60))
def test_no_more_tiles_are_wanted_than_there_is_room_for(size, eye, room):
    chosen = select_tiles(tree_of(size), *boxes(), frame_at(eye), 0.05, room)
    assert 1 <= len(chosen.tiles) <= room


@given(st.integers(2, 12), st.lists(st.integers(0, 30), min_size=1, max_size=120))
def test_the_least_recently_used_slot_is_given_away(count, tiles):
    slots, order = Slots(count), []
    where = {}
    for frame, tile in enumerate(tiles):
        if tile in where:
            slots.touch(np.array([where[tile]]), frame)
            order.remove(tile)
        else:
            slot, evicted = slots.take(0, tile, frame)
            if evicted is None:
                assert len(order) < count
            else:
                assert evicted == (0, order[0])
                assert where.pop(order.pop(0)) == slot
            where[tile] = slot
        order.append(tile)
        assert slots.used == len(order) <= count


def test_slots_needed_in_this_frame_are_never_given_away():
    slots = Slots(2)
    slots.take(0, 1, frame=5)
    slots.take(0, 2, frame=5)
    assert slots.take(0, 3, frame=5) is None
    assert slots.take(0, 3, frame=6) is not None


@settings(max_examples=40)
@given(SIZES, st.integers(0, 2**32 - 1))
def test_a_cell_shows_its_finest_resident_ancestor_that_is_no_finer_than_wanted(size, seed):
    rng = np.random.default_rng(seed)
    tree = tree_of(size)
    pages = Pages(tree)
    resident = rng.random(tree.tile_count) < 0.4
    pages.slot[resident] = np.flatnonzero(resident)  # any numbers that tell the tiles apart
    cell = rng.integers(0, tree.shapes[0].prod(), 30)
    level = rng.integers(0, tree.top_level + 1, 30)
    slot, shown = pages.shown(Selection(cell, level, np.zeros(0, np.int64)))
    for i in range(30):
        row, col = divmod(int(cell[i]), int(tree.shapes[0, 1]))
        up = [int(tree.number_of(k, row >> k, col >> k)) for k in range(level[i], tree.top_level + 1)]
        expected = next((number for number in up if resident[number]), ABSENT)
        assert slot[i] == expected
        if expected != ABSENT:
            assert shown[i] == tree.locate(expected)[0]


@settings(max_examples=40)
@given(SIZES, EYES, st.integers(1, 6))
def test_splitting_keeps_all_visible_ground_and_never_asks_for_more(size, eye, count):
    tree, frame = tree_of(size), frame_at(eye)
    lower, upper = boxes(count)
    small_lower, small_upper = split_near(tree, lower, upper, frame, 1.0)
    rng = np.random.default_rng(count)
    spots = np.stack([rng.uniform(0, EXTENT_M, 400), rng.uniform(0, 200, 400), rng.uniform(0, EXTENT_M, 400)], axis=1)
    seen = ((spots - frame.eye_m) @ frame.side_planes.T >= 0).all(axis=1)
    held = ((spots[:, None] >= small_lower) & (spots[:, None] <= small_upper)).all(axis=2).any(axis=1)
    assert held[seen].all()
    whole = select_for_levels(tree, lower, upper, *select_levels(tree, lower, upper, frame, 1.0))
    assert len(select_tiles(tree, lower, upper, frame, 1.0).tiles) <= len(whole.tiles)


def test_near_ground_of_a_coarse_terrain_does_not_need_every_tile():
    tree = tree_of((100_000, 100_000))  # 10 pixels per metre, on ground of which one box is known
    lower, upper = boxes(1, 0.0)
    frame = frame_at((5000.0, 100.0, 5000.0), 0.0, -30.0)
    chosen = select_tiles(tree, lower, upper, frame, 1.0)
    assert len(chosen.tiles) < 150
    assert chosen.level.min() <= 2  # a pixel is 0.64 m wide at 100 m, and texels of level 2 are 0.4 m
