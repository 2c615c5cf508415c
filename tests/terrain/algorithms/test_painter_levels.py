"""Stitched tiles are watertight, in order for every eye, and never worse than the error they were chosen by."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from painter_orders import coordinates, doubled_area, eyes_over, levels_over, violations

from terrain.algorithms.painter import foot_at, order_strips, rank_tiles
from terrain.algorithms.painter_errors import build_level_errors
from terrain.algorithms.painter_levels import (
    BLOCK_TRIANGLES,
    EAST,
    NORTH,
    SOUTH,
    WEST,
    clamp_local,
    order_blocks,
    order_stitched,
    stitch,
    tile_edges,
)  # fmt: skip
from terrain.heightfield import surface_heights

TILE = 8


def terrain_triangles(levels: np.ndarray, col: float, row: float) -> np.ndarray:
    """All triangles of a terrain of tiles in drawing order, as posts."""
    foot, edges = foot_at(col, row), tile_edges(levels)
    tile_row, tile_col = (a.ravel() for a in np.mgrid[: levels.shape[0], : levels.shape[1]])
    whole = []
    for t in np.argsort(rank_tiles(foot, tile_row, tile_col, levels.shape, TILE)):
        r, c = tile_row[t], tile_col[t]
        level, origin = int(levels[r, c]), np.array([r, c]) * TILE
        local = clamp_local(foot.seen_from(*origin, level), TILE >> level)
        whole.append((order_stitched(TILE >> level, int(edges[r, c]), local) << level) + origin)
    return np.concatenate(whole)


@pytest.mark.parametrize("seed", range(6))
def test_levels_and_fans_are_in_order_for_every_kind_of_eye(seed):
    levels = levels_over((4, 5), seed)
    for eye in eyes_over(4 * TILE, 42, seed):
        assert violations(terrain_triangles(levels, *eye), *eye) == 0, eye


@given(seed=st.integers(0, 10_000), col=coordinates, row=coordinates)
@settings(max_examples=100)
def test_levels_and_fans_are_in_order_for_any_eye(seed, col, row):
    assert violations(terrain_triangles(levels_over((3, 4), seed), col, row), col, row) == 0


@pytest.mark.parametrize("seed", range(8))
def test_stitched_tiles_leave_no_gap_and_no_loose_post(seed):
    levels = levels_over((5, 5), seed)
    triangles = terrain_triangles(levels, 11.3, 7.9)
    area = doubled_area(triangles)
    assert (area >= 0).all()
    assert area.sum() == 2 * (5 * TILE) ** 2
    triangles = triangles[area > 0]
    edges = np.concatenate([triangles[:, [i, i - 1]] for i in range(3)])
    code = np.sort(edges[..., 0] * 1000 + edges[..., 1], axis=1)
    edge, count = np.unique(code, axis=0, return_counts=True)
    row, col = np.divmod(edge, 1000)
    on_border = ((row == 0) | (row == 5 * TILE)).all(1) & (row[:, 0] == row[:, 1])
    on_border |= ((col == 0) | (col == 5 * TILE)).all(1) & (col[:, 0] == col[:, 1])
    assert (count == np.where(on_border, 1, 2)).all()


@pytest.mark.parametrize("edges", range(16))
def test_a_stitched_block_covers_itself_exactly(edges):
    corners = np.stack(stitch(BLOCK_TRIANGLES[..., 0], BLOCK_TRIANGLES[..., 1], 2, edges), -1)
    area = doubled_area(corners)
    assert (area >= 0).all()
    assert area.sum() == 8
    assert (area > 0).sum() == 8 - edges.bit_count()  # every post that goes takes one triangle along


def test_every_entry_of_the_table_names_all_eight_triangles():
    names = (order_blocks()[..., None] >> (3 * np.arange(8, dtype=np.uint32))) & 7
    assert (np.sort(names, -1) == np.arange(8)).all()


def test_fans_have_their_centre_at_the_diagonals_end_as_in_figure_21():
    assert stitch(0, 1, 4, NORTH) == (0, 2)
    assert stitch(1, 4, 4, EAST) == (0, 4)
    assert stitch(4, 3, 4, SOUTH) == (4, 2)
    assert stitch(3, 0, 4, WEST) == (4, 0)
    assert stitch(0, 1, 4, NORTH | WEST) == (0, 0)
    assert stitch(1, 0, 4, NORTH | WEST) == (0, 0)
    assert stitch(4, 3, 4, SOUTH | EAST) == (4, 4)
    assert stitch(3, 4, 4, SOUTH | EAST) == (4, 4)
    assert stitch(0, 1, 4, EAST | SOUTH | WEST) == (0, 1)
    assert stitch(1, 1, 4, 15) == (1, 1)


def test_an_unstitched_tile_has_the_same_triangles_as_its_strips():
    local = foot_at(2.2, 3.7).seen_from(0, 0)
    mesh = {tuple(sorted(map(tuple, t))) for t in order_stitched(6, 0, local).tolist()}
    indices = order_strips(6, *(int(v) for v in local[:3]))
    posts = set(indices[indices < 49].tolist())
    assert len(mesh) == 72
    assert posts == {7 * r + c for t in mesh for r, c in t}


def fan_surface(heights: np.ndarray, level: int, edges: int) -> np.ndarray:
    """Largest vertical distance of one stitched tile from the full surface, sampled at all posts and crossings."""
    cells = (heights.shape[0] - 1) >> level
    worst = 0.0
    for triangle in order_stitched(cells, edges, np.zeros(6, np.int64)) << level:
        if doubled_area(triangle[None])[0]:
            i, j = (a.ravel() / 16 for a in np.mgrid[:17, :17])
            a, b, c = (np.float64(p) for p in triangle)
            i, j = i[i + j <= 1], j[i + j <= 1]
            row, col = (a[k] + (b[k] - a[k]) * i + (c[k] - a[k]) * j for k in (0, 1))
            h = [float(heights[tuple(p)]) for p in triangle]
            drawn = h[0] + (h[1] - h[0]) * i + (h[2] - h[0]) * j
            worst = max(worst, float(np.abs(drawn - surface_heights(heights, col, row, "uniform")).max()))
    return worst


EDGES = (NORTH, EAST, SOUTH, WEST)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("edges", [0, *EDGES, NORTH | WEST, SOUTH | EAST, NORTH | EAST, NORTH | EAST | WEST, 15])
def test_no_drawn_triangle_is_further_off_than_its_error_says(edges, seed):
    heights = np.random.default_rng(seed).normal(0, 10, (TILE + 1, TILE + 1)).astype(np.float32)
    errors = build_level_errors(heights, TILE)
    for level in range(3):
        fans = errors.fan_m[level, [i for i, edge in enumerate(EDGES) if edges & edge], 0, 0]
        assert fan_surface(heights, level, edges) <= max(errors.surface_m[level, 0, 0], *fans, 0.0) + 1e-5


@pytest.mark.parametrize("pair", [(NORTH, WEST), (SOUTH, EAST)])
def test_errors_are_no_larger_than_what_is_drawn(pair):
    """Both edges of a special corner, alone and together, reach the error that is claimed for them."""
    heights = np.random.default_rng(9).normal(0, 10, (TILE + 1, TILE + 1)).astype(np.float32)
    errors = build_level_errors(heights, TILE)
    for level in range(3):
        claimed = max(errors.surface_m[level, 0, 0], *errors.fan_m[level, [EDGES.index(e) for e in pair], 0, 0])
        drawn = max(fan_surface(heights, level, edges) for edges in (0, *pair, pair[0] | pair[1]))
        assert drawn == pytest.approx(claimed, abs=1e-4)


@given(seed=st.integers(0, 1000), allowed=st.floats(0.0, 30.0))
@settings(max_examples=15)
def test_selected_levels_keep_the_tolerance_with_their_fans(seed, allowed):
    random = np.random.default_rng(seed)
    heights = (random.normal(0, 1, (25, 33)) * random.uniform(0, 10, (25, 33))).astype(np.float32)
    allowed_m = np.linspace(0, allowed, 12).reshape(3, 4)
    errors = build_level_errors(heights, TILE)
    levels = errors.select(allowed_m)
    edges = tile_edges(levels)
    assert max(np.abs(np.diff(levels, axis=axis)).max() for axis in (0, 1)) <= 1
    row, col = np.indices(levels.shape)
    assert (errors.surface_m[levels, row, col] <= allowed_m).all()
    for i, edge in enumerate((NORTH, EAST, SOUTH, WEST)):
        assert (errors.fan_m[levels, i, row, col] <= allowed_m)[edges & edge != 0].all()


def test_a_plane_is_drawn_as_coarsely_as_tiles_allow():
    row, col = np.mgrid[:33, :33]
    errors = build_level_errors((2.0 * row + 3.0 * col).astype(np.float32), TILE)
    assert (errors.select(np.full((4, 4), 1e-3)) == 2).all()


def test_cells_end_at_the_grids_far_edges():
    """1 + 20 posts in tiles of 8: the last tile has 4 cells, so level 2 fits it; with 22 posts only level 0 does."""
    allowed = np.full((3, 3), 1e9)
    assert build_level_errors(np.zeros((21, 21), np.float32), TILE).select(allowed).max() == 2
    levels = build_level_errors(np.zeros((22, 22), np.float32), TILE).select(allowed)
    assert levels[-1].tolist() == levels[:, -1].tolist() == [0, 0, 0]
    assert levels[0, 0] == 2
