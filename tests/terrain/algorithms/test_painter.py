"""The painter's order is right: of two triangles that share an edge, the one on the eye's side comes later. Exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from painter_orders import code, coordinates, doubled_area, eyes_over, triangles_of_strips, violations

from terrain.algorithms import painter
from terrain.algorithms.painter import Foot, classify_tiles, foot_at, order_cells, order_strips, rank_tiles


def strips_seen_from(cells: int, foot: Foot, row: int = 0, col: int = 0) -> np.ndarray:
    return order_strips(cells, *(int(v) for v in foot.seen_from(row, col)[:3]))


sizes = st.integers(1, 33)


@pytest.mark.parametrize("cells", range(1, 34))
def test_strips_are_in_order_for_every_size_of_tile(cells):
    for eye in eyes_over(cells, 42, seed=cells):
        triangles = triangles_of_strips(strips_seen_from(cells, foot_at(*eye)), cells + 1)
        assert violations(triangles, *eye) == 0, eye


@given(cells=sizes, col=coordinates, row=coordinates)
@settings(max_examples=400)
def test_strips_are_in_order_for_any_eye(cells, col, row):
    triangles = triangles_of_strips(strips_seen_from(cells, foot_at(col, row)), cells + 1)
    assert violations(triangles, col, row) == 0


@given(rows=sizes, cols=sizes, col=coordinates, row=coordinates, diagonal=st.sampled_from(["uniform", "alternating"]))
@settings(max_examples=500)
def test_the_general_rule_is_in_order_for_any_eye_and_either_diagonal(rows, cols, col, row, diagonal):
    assert violations(order_cells(rows, cols, foot_at(col, row), diagonal), col, row) == 0


@pytest.mark.parametrize("diagonal", ["uniform", "alternating"])
@pytest.mark.parametrize("cells", range(1, 34, 8))
def test_the_general_rule_is_in_order_for_every_kind_of_eye(cells, diagonal):
    for eye in eyes_over(cells, 56, seed=100 + cells):
        assert violations(order_cells(cells, cells, foot_at(*eye), diagonal), *eye) == 0, eye


@given(cells=sizes, col=coordinates, row=coordinates)
@settings(max_examples=100)
def test_strips_draw_every_triangle_of_the_uniform_grid_once_and_counter_clockwise(cells, col, row):
    triangles = triangles_of_strips(strips_seen_from(cells, foot_at(col, row)), cells + 1)
    assert (doubled_area(triangles) == 1).all()

    def identities(of: np.ndarray) -> set[bytes]:
        return {np.sort(code(t)).tobytes() for t in of}

    whole = order_cells(cells, cells, foot_at(0.0, 0.0))
    assert (doubled_area(whole) == 1).all()
    assert len(triangles) == len(whole) == 2 * cells * cells
    assert identities(triangles) == identities(whole)


def test_the_check_sees_a_wrong_order():
    eye = (2.3, 5.1)
    order = order_cells(6, 6, foot_at(*eye))
    assert violations(order[::-1], *eye) > 80  # every edge but those whose lines pass through the eye
    assert violations(np.concatenate([order[:20], order[30:], order[20:30]]), *eye) > 0
    assert violations(order_cells(6, 6, foot_at(5.1, 2.3)), *eye) > 0


def test_a_tile_inside_one_sector_has_the_papers_order():
    """Figures 5 and 7: rows in NE1, NW, SW1 and SE, columns in NE2 and SW2, far lines and far ends first."""
    foot = foot_at(8.4, 8.7)
    row, col = (2 * a.ravel() for a in np.mgrid[:8, :8])
    sectors = classify_tiles(foot, row, col, 2)
    assert set(sectors) == {*range(6), painter.STRADDLING}
    #         0 1 2
    # posts:  3 4 5   a column starts with its first post twice, which turns it counter-clockwise
    #         6 7 8
    first_line = {
        painter.NE1: [5, 2, 4, 1, 3, 0],
        painter.NE2: [1, 1, 2, 4, 5, 7, 8],
        painter.NW: [0, 3, 1, 4, 2, 5],
        painter.SW1: [3, 6, 4, 7, 5, 8],
        painter.SW2: [7, 7, 6, 4, 3, 1, 0],
        painter.SE: [8, 5, 7, 4, 6, 3],
    }
    for sector, r, c in zip(sectors, row, col, strict=True):
        if sector != painter.STRADDLING:
            order = strips_seen_from(2, foot, r, c).tolist()
            assert order[: order.index(painter.RESTART)] == first_line[sector], painter.SECTOR_NAMES[sector]
            assert order.count(painter.RESTART) == 2


def test_sectors_lie_around_the_foot_as_in_figure_4():
    tile = {painter.NE1: (-2, 9), painter.NE2: (-9, 2), painter.NW: (-3, -3), painter.SE: (3, 3),
            painter.SW1: (2, -9), painter.SW2: (9, -2)}  # fmt: skip
    for sector, (row, col) in tile.items():
        assert classify_tiles(foot_at(0.5, 0.25), np.array([row]), np.array([col]), 1) == sector
    assert classify_tiles(foot_at(0.5, 0.75), np.array([0]), np.array([0]), 1) == painter.STRADDLING


@given(col=coordinates, row=coordinates)
@settings(max_examples=150)
def test_tiles_by_rank_make_one_order_of_the_whole_terrain(col, row):
    foot, tile, shape = foot_at(col, row), 4, (5, 7)
    tile_row, tile_col = (a.ravel() for a in np.mgrid[: shape[0], : shape[1]])
    rank = rank_tiles(foot, tile_row, tile_col, shape, tile)
    assert sorted(rank) == list(range(35))
    whole = []
    for t in np.argsort(rank):
        origin = np.array([tile_row[t], tile_col[t]]) * tile
        whole.append(triangles_of_strips(strips_seen_from(tile, foot, *origin), tile + 1) + origin)
    assert violations(np.concatenate(whole), col, row) == 0


def test_the_foot_is_exact_where_sums_of_floats_round():
    assert foot_at(1e-300, 5.0).sum == 5
    assert foot_at(-1e-300, 5.0) == Foot(-1, 5, 4, -6, 4, 9)
    assert foot_at(0.1, 0.9).sum == 1  # the double nearest to 0.1 is above it by more than 0.9's lies below
    assert foot_at(2.0, 3.0) == Foot(2, 3, 5, -1, 7, 8)


@pytest.mark.parametrize("eye", [(math.nan, 0.0), (0.0, math.inf)])
def test_an_eye_nowhere_is_refused(eye):
    with pytest.raises(ValueError, match="finite foot point"):
        foot_at(*eye)
