"""Tile levels: partition, neighbour rule, promise, and a watertight surface in every morph state.

`tile_mesh` is the vertex shader's twin: shaders/geomorph.vert in numpy.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.culling import Culler
from terrain.algorithms.geomorph import TileLevels, Tiles, automatic_tile_cells, tile_triangles
from terrain.algorithms.morph_targets import build_morph_targets, morph_targets_shape
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.heightfield import Heightfield, surface_heights
from terrain.pyramid import build_pyramid
from terrain.renderers.tile_mesh import build_tile_indices
from terrain.scene import Scene


def fractal_scene(rows: int, cols: int, seed: int, amplitude_m: float = 400.0) -> Scene:
    """Midpoint-like noise: sums of interpolated random grids, rough in places."""
    rng = np.random.default_rng(seed)
    z, x = np.mgrid[:rows, :cols]
    heights = np.zeros((rows, cols))
    for octave in range(6):
        step = 64 >> octave
        grid = rng.normal(size=(rows // step + 3, cols // step + 3)).astype(np.float32)
        heights += surface_heights(grid, x / step, z / step) * amplitude_m / 2**octave
    heights *= np.clip((x + z) / (rows + cols) * 2, 0.05, 1)  # smooth in one corner, rough in the other
    field = Heightfield(heights.astype(np.float32), (30.0, 25.0))
    return Scene(field, build_pyramid(field.heights_m))


SCENE = fractal_scene(161, 193, 1)


def select(scene: Scene, camera: Camera, cells: int, tolerance_px: float = 1.0, join: bool = True, **options) -> Tiles:
    levels = TileLevels(scene, cells, join)
    frame = Frame(camera, (640, 360))
    visible = Culler(scene, levels.size_level).select(frame, horizon=False, split_ratio=16.0)
    return levels.select(frame, visible, tolerance_px, **options)


def tile_mesh(scene: Scene, tiles: Tiles, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Posts (n, 2) as (col, row), heights (n,) and triangles (m, 3) of one tile, as the vertex shader computes them."""
    heights = scene.heightfield.heights_m
    last = np.array([scene.heightfield.cols - 1, scene.heightfield.rows - 1])

    def height(post: np.ndarray) -> np.ndarray:
        col, row = np.clip(post, 0, last).T
        return heights[row, col]

    level, cells = int(tiles.level[index]), 1 << int(tiles.size_level[index] - tiles.level[index])
    origin = tiles.post[index]
    j, i = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1))
    ij = np.stack([j.ravel(), i.ravel()], axis=1)
    if cells == 1 and (origin >> level).sum() % 2:
        ij = np.stack([1 - ij[:, 1], ij[:, 0]], axis=1)
    post = origin + (ij << level)
    v = np.full(len(post), np.clip(tiles.lam[index] - np.float32(level), 0, 1), np.float32)
    at_level = np.full(len(post), level)
    sides = [ij[:, 1] == 0, ij[:, 1] == cells, ij[:, 0] == 0, ij[:, 0] == cells]
    corner = (sides[0] | sides[1]) & (sides[2] | sides[3])
    for side in (3, 2, 1, 0):  # north wins at corners, as in the shader
        lam = tiles.edge_lam[index, side]
        at_level[sides[side]] = int(lam)
        v[sides[side]] = lam - np.float32(int(lam))
    for axis, pair in ((0, sides[0] | sides[1]), (1, (sides[2] | sides[3]) & ~(sides[0] | sides[1]))):
        post[pair, axis] = (post[pair, axis] >> at_level[pair]) << at_level[pair]
    v[corner] = 0
    size = 1 << at_level
    odd = (post >> at_level[:, None]) & 1
    reach = odd * size[:, None]
    coarse = (post >> (at_level + 1)[:, None]).sum(axis=1) % 2
    reach[:, 1] = np.where((odd.sum(axis=1) == 2) & (coarse == 1), -size, reach[:, 1])
    middle = np.float32(0.5) * (height(post - reach) + height(post + reach))
    own = height(post)
    return post, own + v * (middle - own), build_tile_indices(cells).reshape(-1, 3)


def edge_profile(post: np.ndarray, height: np.ndarray, axis: int, at: int) -> dict[int, float]:
    """Posts along the line where coordinate ``axis`` equals ``at``: position -> height."""
    on = post[:, axis] == at
    return dict(zip(post[on, 1 - axis].tolist(), height[on].tolist(), strict=True))


def assert_watertight(scene: Scene, tiles: Tiles) -> None:
    """Every stretch of edge shared by two tiles has the same posts and the same bits of height from both sides."""
    size = 1 << tiles.size_level
    meshes = [tile_mesh(scene, tiles, k) for k in range(len(size))]
    owner = {}
    for k in range(len(size)):
        col, row = tiles.post[k] >> 3
        for r in range(row, row + (size[k] >> 3)):
            for c in range(col, col + (size[k] >> 3)):
                assert (r, c) not in owner, "tiles overlap"
                owner[r, c] = k
    for (r, c), k in owner.items():
        for axis, other in ((0, owner.get((r, c + 1))), (1, owner.get((r + 1, c)))):
            if other is None or other == k:
                continue
            at = int(tiles.post[other, axis])
            first = max(tiles.post[k, 1 - axis], tiles.post[other, 1 - axis])
            last = min(tiles.post[k, 1 - axis] + size[k], tiles.post[other, 1 - axis] + size[other])
            a, b = (
                {p: h for p, h in edge_profile(post, height, axis, at).items() if first <= p <= last}
                for post, height, _ in (meshes[k], meshes[other])
            )
            assert a == b


@settings(max_examples=25)
@given(
    st.floats(-2000, 8000), st.floats(5, 4000), st.floats(-2000, 6000), st.floats(0, 360), st.floats(-90, 30),
    st.sampled_from([8, 16, 32, 64]), st.sampled_from([0.5, 1.0, 2.0, 8.0, 40.0]), st.booleans(),
)  # fmt: skip
def test_any_view_is_watertight(x, y, z, yaw, pitch, cells, tolerance, join) -> None:
    tiles = select(SCENE, Camera((x, y, z), yaw, pitch), cells, tolerance, join)
    assert_watertight(SCENE, tiles)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([8, 16, 32]), st.booleans())
def test_any_assignment_of_levels_is_watertight(seed, cells, join) -> None:
    """Levels far from what any view would choose, as when one side reverses a morph before the other has ended."""
    rng = np.random.default_rng(seed)
    levels = TileLevels(SCENE, cells, join)
    masks = [np.ones(tier.minimum_m.shape, bool) for tier in levels.tiers]
    windows = [(slice(0, m.shape[0]), slice(0, m.shape[1])) for m in masks]
    fields = [rng.uniform(-1, levels.size_level + 3, masks[0].shape).clip(0, levels.size_level).astype(np.float32)]
    fields += [rng.uniform(-0.5, 1.5, m.shape).clip(0, 1).astype(np.float32) for m in masks[1:]]
    if seed % 3 == 0:
        fields[0][:] = levels.size_level  # everything may join
    lam, joined = levels._constrain(fields, windows)
    tiles = levels._collect(lam, joined, masks, windows)
    inside = (tiles.post[:, 0] < SCENE.heightfield.cols - 1) & (tiles.post[:, 1] < SCENE.heightfield.rows - 1)
    assert_watertight(SCENE, Tiles(*(a[inside] for a in tiles)))


@settings(max_examples=25)
@given(
    st.floats(0, 5000), st.floats(100, 4000), st.floats(0, 4000), st.floats(0.25, 8), st.sampled_from([8, 16, 32, 64])
)
def test_inside_a_tile_the_error_stays_within_the_tolerance(x, y, z, tolerance, cells) -> None:
    camera = Camera((x, y, z), 30.0, -40.0)
    frame = Frame(camera, (640, 360))
    tiles = select(SCENE, camera, cells, tolerance)
    heights = SCENE.heightfield.heights_m
    dx, dz = SCENE.heightfield.spacing_m
    for k in np.random.default_rng(0).permutation(len(tiles.lam))[:20]:
        if (tiles.edge_lam[k] != tiles.lam[k]).any():
            continue  # its border follows a neighbour
        post, height, _ = tile_mesh(SCENE, tiles, k)
        size = 1 << int(tiles.size_level[k])
        col, row = tiles.post[k]
        rows, cols = np.mgrid[
            row : min(row + size, heights.shape[0] - 1) + 1, col : min(col + size, heights.shape[1] - 1) + 1
        ]
        level = int(tiles.level[k])
        grid = np.empty(((size >> level) + 1,) * 2, np.float32)
        grid[(post[:, 1] - row) >> level, (post[:, 0] - col) >> level] = height
        if (tiles.post[k] >> level).sum() % 2:
            continue  # surface_heights counts diagonals from the tile's own corner
        drawn = surface_heights(grid, (cols - col) / (1 << level), (rows - row) / (1 << level))
        error = np.abs(drawn - heights[rows, cols])
        # A joined tile is as far away as its nearest part only where that part lies: every post counts by itself, at
        # the heights of its part.
        below = np.zeros(rows.shape)
        for i, j in itertools.product(range(0, rows.shape[0], cells), range(0, rows.shape[1], cells)):
            part = slice(i, i + cells + 1), slice(j, j + cells + 1)
            low, high = heights[rows, cols][part].min(), heights[rows, cols][part].max()
            below[part] = max(low - y, y - high, 0.0)
        gap = np.stack([cols * dx - x, rows * dz - z, below])
        distance = np.linalg.norm(gap, axis=0)
        assert (error <= tolerance * distance / frame.pixels_per_radian * 1.001 + 0.05).all()


def test_neighbouring_levels_differ_by_at_most_one_and_follow_the_distance() -> None:
    levels = TileLevels(SCENE, 16, False)
    frame = Frame(Camera((100.0, 600.0, 100.0), 135.0, -20.0), (640, 360))
    masks = [np.ones(levels.tiers[0].minimum_m.shape, bool)]
    windows, fields = levels._targets(frame, np.float32(1 / frame.pixels_per_radian), masks, everywhere=True)
    (lam,), _ = levels._constrain(fields, windows)
    assert np.abs(np.diff(lam, axis=0)).max() <= 1.0
    assert np.abs(np.diff(lam, axis=1)).max() <= 1.0
    assert (lam <= fields[0]).all()
    # The rule is exact: each value is its target, or limited by a target as many tiles away.
    r, c = np.indices(lam.shape)
    expected = [(fields[0] + np.abs(r - i) + np.abs(c - j)).min() for i, j in zip(r.ravel(), c.ravel(), strict=True)]
    np.testing.assert_allclose(lam.ravel(), expected, atol=1e-6)


def test_a_small_step_of_the_eye_moves_levels_a_little() -> None:
    levels = TileLevels(SCENE, 8, True)
    masks = [np.ones(tier.minimum_m.shape, bool) for tier in levels.tiers]
    previous = None
    for step in range(200):
        frame = Frame(Camera((500.0 + 0.5 * step, 700.0, 900.0), 90.0), (640, 360))
        windows, fields = levels._targets(frame, np.float32(1 / frame.pixels_per_radian), masks, everywhere=True)
        current, _ = levels._constrain(fields, windows)
        if previous is not None:
            assert max(np.abs(a - b).max() for a, b in zip(current, previous, strict=True)) < 0.2
        previous = current


def test_tiles_cover_each_visible_cell_exactly_once_within_the_grid() -> None:
    tiles = select(SCENE, Camera((2500.0, 30000.0, 2000.0), 0.0, -90.0, fov_deg=60.0), 8, 2.0)
    count = np.zeros((SCENE.heightfield.rows - 1, SCENE.heightfield.cols - 1), int)
    for post, t in zip(tiles.post, tiles.size_level, strict=True):
        count[post[1] : post[1] + (1 << t), post[0] : post[0] + (1 << t)] += 1
    assert (count == 1).all()


@pytest.mark.parametrize("shape", [(33, 65), (40, 51), (2, 2)])
def test_a_post_is_morphed_to_the_surface_of_the_next_coarser_level(shape) -> None:
    heights = np.random.default_rng(3).normal(size=shape).astype(np.float32)
    rows, cols = morph_targets_shape(shape, 16)
    assert all((n - 1) % 16 == 0 and 0 <= n - m < 16 for n, m in zip((rows, cols), shape, strict=True))
    posts = np.full((rows, cols, 2), np.nan, np.float32)
    for row, band in build_morph_targets(heights, 16):
        shared = posts[row : row + 1]
        np.testing.assert_array_equal(np.where(np.isnan(shared), band[:1], shared), band[:1])
        posts[row : row + 17] = band
    np.testing.assert_array_equal(posts[: shape[0], : shape[1], 0], heights)
    row, col = np.indices(posts.shape[:2])
    for level in range(4):
        coarse = np.ascontiguousarray(posts[:: 2 << level, :: 2 << level, 0])
        surface = surface_heights(coarse, col / (2 << level), row / (2 << level))
        on_level = ((row | col) % (1 << level) == 0) & ((row | col) % (2 << level) != 0)
        np.testing.assert_allclose(posts[on_level, 1], surface[on_level], atol=1e-6)
    stays = (row | col) % 16 == 0
    np.testing.assert_array_equal(posts[stays, 1], posts[stays, 0])


@pytest.mark.parametrize(
    ("posts", "expected"), [(2, 8), (1025, 8), (2049, 8), (2050, 16), (4097, 16), (8193, 32), (16385, 64), (40001, 64)]
)
def test_automatic_tiles_are_the_smallest_of_which_there_are_not_too_many(posts, expected) -> None:
    assert automatic_tile_cells((posts - 1, 1)) == automatic_tile_cells((1, posts - 1)) == expected


def test_flat_ground_is_joined_to_a_handful_of_triangles() -> None:
    field = Heightfield(np.zeros((513, 513), np.float32), (10.0, 10.0))
    scene = Scene(field, build_pyramid(field.heights_m))
    camera = Camera((2560.0, 40000.0, 2560.0), 0.0, -90.0)
    assert tile_triangles(select(scene, camera, 16)) <= 32
    assert tile_triangles(select(scene, camera, 16, join=False)) == 2 * 32 * 32


def test_switching_without_morph_draws_whole_levels() -> None:
    tiles = select(SCENE, Camera((0.0, 500.0, 0.0), 135.0, -10.0), 16, driver="off")
    assert (tiles.lam == np.floor(tiles.lam)).all()
    assert (tiles.edge_lam == np.floor(tiles.edge_lam)).all()
    assert_watertight(SCENE, tiles)


def follow(driver: str, cameras: list[Camera], dt_s: float = 0.1, **options) -> list[Tiles]:
    levels = TileLevels(SCENE, 8, True)
    culler = Culler(SCENE, 3)
    result = []
    for i, camera in enumerate(cameras):
        frame = Frame(camera, (640, 360), time_s=i * dt_s)
        visible = culler.select(frame, horizon=False, split_ratio=16.0)
        result.append(levels.select(frame, visible, 1.0, driver, **options))
        if i % 15 < 2:
            assert_watertight(SCENE, result[-1])
    return result


@pytest.mark.parametrize(("driver", "options"), [("time", {"morph_s": 1.0}), ("frames", {"morph_frames": 10})])
def test_a_driven_morph_moves_at_its_rate_and_arrives(driver, options) -> None:
    here, there = Camera((500.0, 900.0, 500.0), 135.0, -30.0), Camera((3500.0, 900.0, 3000.0), 135.0, -30.0)
    tiles = follow(driver, [here, *[there] * 60], **options)
    target = select(SCENE, there, 8)
    np.testing.assert_array_equal(tiles[-1].post, target.post)
    np.testing.assert_allclose(tiles[-1].lam, target.lam, atol=1e-5)
    # Before it arrives, every tile moves by a tenth of a level per frame at most.
    largest = []
    for before, after in itertools.pairwise(tiles[1:20]):
        lam = {
            tuple(p): l for p, t, l in zip(before.post.tolist(), before.size_level, before.lam, strict=True) if t == 3
        }
        moved = [
            abs(lam[tuple(p)] - l)
            for p, t, l in zip(after.post.tolist(), after.size_level, after.lam, strict=True)
            if t == 3 and tuple(p) in lam
        ]
        largest.append(max(moved))
    assert max(largest) == pytest.approx(0.1, abs=1e-5)


def test_the_queue_limits_how_many_tiles_leave_their_level_in_a_frame() -> None:
    here, there = Camera((500.0, 900.0, 500.0), 135.0, -30.0), Camera((3500.0, 900.0, 3000.0), 135.0, -30.0)
    levels = TileLevels(SCENE, 8, False)
    culler = Culler(SCENE, 3)
    drawn = []
    for camera in [here, *[there] * 120]:
        frame = Frame(camera, (640, 360))
        levels.select(frame, culler.select(frame, split_ratio=16.0), 1.0, starts_per_frame=10)
        assert levels._drawn is not None
        drawn.append(levels._drawn[0].copy())
    changes = [int((np.floor(a) != np.floor(b)).sum()) for a, b in itertools.pairwise(drawn)]
    assert max(changes) == 10
    assert changes[-1] == 0


@pytest.mark.parametrize("shape", [(2, 2), (2, 300), (300, 2), (9, 9), (17, 40), (64, 65)])
@pytest.mark.parametrize("cells", [8, 64])
def test_any_size_of_grid_can_be_drawn(shape, cells) -> None:
    rng = np.random.default_rng(0)
    field = Heightfield(rng.normal(size=shape).astype(np.float32) * 20, (10.0, 10.0))
    scene = Scene(field, build_pyramid(field.heights_m))
    centre = field.extent_m[0] / 2, field.extent_m[1] / 2
    tiles = select(scene, Camera((centre[0], 4000.0, centre[1]), 0.0, -90.0, fov_deg=90.0), cells, 0.5)
    assert len(tiles.lam)
    assert_watertight(scene, tiles)


def test_a_view_without_any_small_tile_is_drawn_by_large_ones() -> None:
    """High above gentle ground every window of smaller tiles is empty."""
    scene = fractal_scene(600, 700, 2, amplitude_m=1.0)
    tiles = select(scene, Camera((9000.0, 60000.0, 7000.0), 0.0, -90.0, fov_deg=20.0), 8)
    assert tiles.size_level.min() > 5
    assert_watertight(scene, tiles)


def test_edges_of_the_terrain_keep_the_level_of_their_tile() -> None:
    scene = fractal_scene(33, 1025, 3)  # joined tiles of 256 cells reach far past the south edge
    tiles = select(scene, Camera((3000.0, 900.0, 400.0), 60.0, -30.0), 16)
    rows, cols = scene.pyramid.cells
    first, last = tiles.post, tiles.post + np.left_shift(1, tiles.size_level)[:, None]
    at_edge = np.stack([first[:, 1] == 0, last[:, 1] >= rows, first[:, 0] == 0, last[:, 0] >= cols], axis=1)
    assert at_edge[:, 1].sum() > 10
    np.testing.assert_array_equal(tiles.edge_lam[at_edge], np.repeat(tiles.lam[:, None], 4, axis=1)[at_edge])
