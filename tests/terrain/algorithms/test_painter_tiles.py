"""What the painter draws for a view: every tile once, far to near, in few runs and with few orders."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from painter_orders import code, coordinates, doubled_area, eyes_over, levels_over, triangles_of_strips, violations

from terrain.algorithms.painter import FIXED_FOOT, foot_at
from terrain.algorithms.painter_errors import build_level_errors
from terrain.algorithms.painter_levels import order_stitched, tile_edges
from terrain.algorithms.painter_tiles import (
    BLOCKS,
    CELLS,
    TileGrid,
    Tiles,
    build_order,
    build_shuffled_order,
    order_indexed,
    order_runs,
)


def all_tiles(grid: TileGrid, levels: np.ndarray | None = None) -> Tiles:
    row, col = (a.ravel() for a in np.mgrid[: grid.shape[0], : grid.shape[1]])
    levels = np.zeros(grid.shape, np.int64) if levels is None else levels
    return Tiles(row, col, levels.ravel(), tile_edges(levels).ravel())


def triangles_of_index_buffers(foot, tiles: Tiles, grid: TileGrid) -> np.ndarray:
    drawn = order_indexed(foot, tiles, grid)
    orders = [build_order(key) for key in drawn.keys]
    whole = []
    for (tile, level, _, _), order in zip(drawn.run.tolist(), drawn.order, strict=True):
        cells = (1 << grid.tile_level) >> level
        if drawn.keys[order][1] == 0:
            triangles = triangles_of_strips(orders[order], cells + 1)
        else:
            triangles = np.stack(np.divmod(orders[order].astype(np.int64), cells + 1), -1).reshape(-1, 3, 2)
        whole.append((triangles << level) + (np.array(divmod(tile, grid.shape[1])) << grid.tile_level))
    return np.concatenate(whole)


@given(col=coordinates, row=coordinates)
@settings(max_examples=80)
def test_index_buffers_are_in_order_for_any_eye(col, row):
    grid = TileGrid((20, 28), 2)
    triangles = triangles_of_index_buffers(foot_at(col, row), all_tiles(grid), grid)
    assert doubled_area(triangles).sum() == 2 * 20 * 28
    assert violations(triangles, col, row) == 0


@pytest.mark.parametrize("seed", range(6))
def test_index_buffers_are_in_order_with_levels_and_fans(seed):
    grid = TileGrid((32, 40), 3)
    tiles = all_tiles(grid, levels_over(grid.shape, seed))
    for eye in eyes_over(32, 15, seed):
        assert violations(triangles_of_index_buffers(foot_at(*eye), tiles, grid), *eye) == 0, eye


def test_a_handful_of_orders_serves_all_tiles():
    """Six for tiles inside sectors, and few more: tiles on one axis straddle alike, and so do those on the bisector."""
    grid = TileGrid((256, 256), 3)
    drawn = order_indexed(foot_at(101.3, 77.8), all_tiles(grid), grid)
    assert len(drawn.run) == 1024
    assert len(drawn.keys) < 24


def test_the_fixed_foot_needs_one_order_and_no_upload_when_the_eye_moves():
    grid = TileGrid((64, 64), 3)
    assert order_indexed(FIXED_FOOT, all_tiles(grid), grid).keys == [(8, 0, 0, 8, 0, 0, 0, 0)]


def test_the_general_rule_draws_the_whole_terrain_in_one_call():
    grid = TileGrid((256, 512), 5)
    runs = order_runs(foot_at(100.2, 33.3), all_tiles(grid), grid, cells_only=True)
    assert runs.run.tolist() == [[0, 0, CELLS, 0]]
    assert runs.vertices.tolist() == [6 * 256 * 512]


def test_runs_end_before_vertex_numbers_outgrow_the_shaders_division():
    grid = TileGrid((16384, 16384), 5)
    runs = order_runs(foot_at(100.2, 33.3), all_tiles(grid), grid, cells_only=True)
    assert runs.vertices.max() <= 1 << 28
    assert runs.vertices.sum() == 6 * 16384 * 16384
    assert len(runs.run) == 7


def test_strips_need_a_call_where_the_sector_changes_in_a_row_of_tiles():
    grid = TileGrid((256, 512), 5)
    runs = order_runs(foot_at(100.2, 33.3), all_tiles(grid), grid)
    assert len(runs.run) <= 4 * grid.shape[0]
    assert (runs.run[:, 0] == np.sort(runs.run[:, 0])).all()


def test_a_gap_between_tiles_and_a_change_of_level_or_edges_end_a_run():
    grid, foot = TileGrid((64, 64), 3), foot_at(-9.0, 200.0)  # all tiles lie in NE1 or NE2
    row = np.zeros(8, np.int64)
    level = np.array([0, 0, 1, 1, 1, 0, 0, 0])
    edges = np.array([0, 4, 0, 0, 0, 0, 0, 0])
    tiles = Tiles(row, np.array([7, 6, 5, 4, 3, 2, 1, 0]), level, edges)
    runs = order_runs(foot, tiles.take(np.array([0, 1, 2, 3, 4, 5, 7])), grid)
    assert runs.run[:, 0].tolist() == [0, 1, 2, 5, 7]
    assert runs.run[:, 1].tolist() == [0, 0, 1, 0, 0]
    assert runs.run[1].tolist() == [1, 0, BLOCKS, 4]


def test_no_tiles_need_no_calls():
    grid, none = TileGrid((64, 64), 3), Tiles(*(np.zeros(0, np.int64) for _ in range(4)))
    assert len(order_runs(foot_at(0, 0), none, grid).run) == 0
    assert len(order_indexed(foot_at(0, 0), none, grid).run) == 0
    assert grid.triangles(none) == 0


@given(rows=st.integers(1, 40), cols=st.integers(1, 40), seed=st.integers(0, 100))
@settings(max_examples=60)
def test_triangles_are_counted_as_they_are_drawn(rows, cols, seed):
    grid = TileGrid((rows, cols), 3)
    allowed_m = np.random.default_rng(seed).choice([-1.0, 1.0], grid.shape)
    levels = build_level_errors(np.zeros((rows + 1, cols + 1), np.float32), 8).select(allowed_m)
    tiles, drawn = all_tiles(grid, levels), 0
    for r, c, level, edges in zip(*tiles, strict=True):
        posts = (order_stitched(8 >> level, int(edges), np.zeros(6, int)) << level) + np.array([r, c]) * 8
        drawn += int((doubled_area(np.minimum(posts, [rows, cols])) > 0).sum())
    assert grid.triangles(tiles) == drawn


def test_tiles_of_a_node_stay_inside_the_grid():
    row, col = TileGrid((20, 36), 2).inside([0, 1], [2, 0], 4)
    expected = [(0, 8), (1, 8), (2, 8), (3, 8), (4, 0), (4, 1), (4, 2), (4, 3)]
    assert sorted(zip(row.tolist(), col.tolist(), strict=True)) == expected


@pytest.mark.parametrize("randomness", [0.0, 0.5, 1.0])
def test_shuffling_moves_the_asked_share_and_loses_no_triangle(randomness):
    ordered, shuffled = (build_shuffled_order(16, r).reshape(-1, 3) for r in (0.0, randomness))
    moved = (ordered != shuffled).any(1).mean()
    assert moved == pytest.approx(randomness, abs=0.02)
    assert sorted(map(tuple, ordered.tolist())) == sorted(map(tuple, shuffled.tolist()))
    assert len(np.unique(code(ordered[:, :2]))) == 2 * 16 * 16
