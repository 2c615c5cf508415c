"""Painter's back-to-front ordering: in which order to draw the triangles of a grid so that no depth test is needed.

A height field has no overhangs, so of two triangles on one sight line the one whose plan lies farther from the eye's
foot point O' is hidden. Two triangles that share an edge are therefore in order when the one on O''s side of that edge
comes later; an order that satisfies this for every edge is a correct order for every sight line.

Source: S. Alonso-Ferreira, R. Joan-Arinyo, *Back-to-front ordering of triangles in digital terrain models over regular
grids*. Numbers in comments are its sections. Cells are cut SW-NE (figure 1a); sectors are named as there, with north at
row 0.

Deviations:

* O' enters as integers (`Foot`): exact floors of its coordinates and of their sums along the directions of all edges.
  So posts, edges and the bisector itself are no special cases, and the shader decides exactly as numpy does.
* The cell that holds O' may belong to no sector: its order follows its own diagonal, and its tile straddles.
* Tiles are ordered by rank (rows of tiles, far rows first; in each the far tiles first) instead of by recursion over
  the quadtree: another order of the same kind, which the shader can compute from a number.
* `order_cells` is the general rule that needs no sectors: cells by rank, then a half-plane test in each cell.
"""

from __future__ import annotations

from fractions import Fraction
from math import floor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Diagonal

Ints = npt.NDArray[np.int64]

NE1, NE2, NW, SW1, SW2, SE, STRADDLING = range(7)
SECTOR_NAMES = ("NE1", "NE2", "NW", "SW1", "SW2", "SE", "straddling")

RESTART = 0xFFFFFFFF  # ends a triangle strip in an index buffer

# Directions of a strip, and the (row, col) steps of each: from the first cell to the first post, from a post to the one
# across the strip, and along the strip. East- and westbound strips turn counter-clockwise seen from above.
EASTBOUND, WESTBOUND, SOUTHBOUND, NORTHBOUND = range(4)
_FIRST = np.array([(0, 0), (1, 1), (0, 0), (1, 1)])
_ACROSS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
_ALONG = np.array([(0, 1), (0, -1), (1, 0), (-1, 0)])

# Figures 5 and 7: the direction of the strips of each sector. NE1 and SW1 lie where sight lines are flatter than the
# bisector and are drawn by rows, NE2 and SW2 by columns. A strip meets the nearer triangle of each cell second.
STRIP_OF_SECTOR = (WESTBOUND, SOUTHBOUND, EASTBOUND, EASTBOUND, NORTHBOUND, WESTBOUND)

_FAR = 1 << 28  # beyond every grid line, and within the shader's integers


class Foot(NamedTuple):
    """The foot point O' = (col, row) of the eye in posts, as exact floors along the directions of all edges.

    A grid line ``a col + b row = k`` with integer k has O' on its larger side, or through it, just where the floor of
    ``a col + b row`` is at least k. On the line itself either order is right.
    """

    west: int  # floor(col): as many columns of cells lie wholly west of O'
    north: int  # floor(row)
    sum: int  # floor(col + row): SW-NE diagonals
    difference: int  # floor(col - row): NW-SE diagonals
    steep: int  # floor(2 col + row): edges of stitching fans
    shallow: int  # floor(col + 2 row)

    def seen_from(self, row: npt.ArrayLike, col: npt.ArrayLike, level: npt.ArrayLike = 0) -> Ints:
        """The foot in cells of 2^level posts, counted from the post (row, col): (6, ...) in the order of the fields."""
        row, col, level = np.asarray(row, np.int64), np.asarray(col, np.int64), np.asarray(level, np.int64)
        offset = np.stack(np.broadcast_arrays(col, row, col + row, col - row, 2 * col + row, col + 2 * row))
        own = np.array(self, np.int64).reshape(6, *[1] * (offset.ndim - 1))
        return (own - offset) >> level


FIXED_FOOT = Foot(-_FAR, _FAR, -_FAR, -_FAR, -_FAR, _FAR)
"""A foot for which every tile lies in NE1: the fixed order of the paper's z-buffer and wrong modes (6)."""


def foot_at(col: float, row: float) -> Foot:
    """The foot point at fractional post (col, row), anywhere in the plane.

    Raises
    ------
    ValueError
        If a coordinate is not finite.
    """
    if not (abs(col) < np.inf and abs(row) < np.inf):
        raise ValueError(f"expected a finite foot point, found ({col}, {row})")
    x, y = Fraction(col), Fraction(row)  # sums of floats round; an eye just off the bisector must not
    return Foot(*(min(max(floor(v), -_FAR), _FAR) for v in (x, y, x + y, x - y, 2 * x + y, x + 2 * y)))


def far_to_near(count: int, before: int) -> Ints:
    """Lines 0 ... count - 1 ordered far to near when ``before`` of them lie wholly before O'."""
    before = min(max(before, 0), count)
    return np.concatenate([np.arange(before), np.arange(count - 1, before - 1, -1)])


def rank_of(line: npt.ArrayLike, count: int, before: int) -> Ints:
    """Position of a line in `far_to_near`."""
    line, before = np.asarray(line, np.int64), min(max(before, 0), count)
    return np.where(line < before, line, before + count - 1 - line)


def rank_tiles(foot: Foot, row: Ints, col: Ints, shape: tuple[int, int], tile_cells: int) -> Ints:
    """Rank of tiles (row, col) of a grid of ``shape`` tiles: lower ranks are drawn first (figure 14)."""
    rows, cols = shape
    return rank_of(row, rows, foot.north // tile_cells) * cols + rank_of(col, cols, foot.west // tile_cells)


def classify_tiles(foot: Foot, row: Ints, col: Ints, tile_cells: int) -> Ints:
    """Sector of square tiles that start at post (row, col), or STRADDLING (4.1, 4.2)."""
    west, north, diagonal, *_ = foot.seen_from(row, col)
    is_west, is_east = west >= tile_cells, west <= 0
    is_north, is_south = north >= tile_cells, north <= 0
    # Every cell of the tile is cut north-west, or south-east, of O'.
    is_above, is_below = diagonal >= 2 * tile_cells - 1, diagonal <= 0
    return np.select(
        [
            is_north & is_west,
            is_south & is_east & is_below,
            is_north & is_east & is_below,
            is_north & is_east & is_above,
            is_south & is_west & is_above,
            is_south & is_west & is_below,
        ],
        [NW, SE, NE1, NE2, SW1, SW2],
        STRADDLING,
    )


def order_cells(rows: int, cols: int, foot: Foot, diagonal: Diagonal = "uniform") -> Ints:
    """The general rule: triangles of a grid of rows x cols cells far to near, for either kind of diagonal.

    Rows of cells by rank, in each row cells by rank, and in each cell first the triangle beyond the diagonal's line as
    seen from O'. Cells by rank settle every edge between two cells, the half-plane test the edge inside.

    Returns
    -------
    ndarray of int64, (2 * rows * cols, 3, 2)
        Posts (row, col) of the corners, counter-clockwise seen from above.
    """
    row, col = np.repeat(far_to_near(rows, foot.north), cols), np.tile(far_to_near(cols, foot.west), rows)
    nw, ne, sw, se = ((row + i, col + j) for i in (0, 1) for j in (0, 1))

    def pair(first: tuple[tuple[Ints, Ints], ...], second: tuple[tuple[Ints, Ints], ...]) -> Ints:
        return np.stack([np.stack([np.stack(p, -1) for p in triangle], -2) for triangle in (first, second)], 1)

    north_west, south_east = (nw, sw, ne), (ne, sw, se)
    is_south_east = foot.sum >= row + col + 1
    ordered = np.where(
        is_south_east[:, None, None, None], pair(north_west, south_east), pair(south_east, north_west)
    )  # fmt: skip
    if diagonal == "alternating":
        north_east, south_west = (nw, se, ne), (nw, sw, se)
        is_north_east = foot.difference >= col - row
        other = np.where(
            is_north_east[:, None, None, None], pair(south_west, north_east), pair(north_east, south_west)
        )  # fmt: skip
        ordered = np.where(((row + col) % 2 == 0)[:, None, None, None], other, ordered)
    return ordered.reshape(-1, 3, 2)


def order_strips(cells: int, west: int, north: int, diagonal: int) -> npt.NDArray[np.uint32]:
    """The paper's order of a square tile as triangle strips: one of the six of 4.1, or cut as in 4.2.

    Parameters
    ----------
    cells : int
        Cells along one side of the tile.
    west, north, diagonal : int
        The first three of `Foot.seen_from` the tile's north-west post. Values beyond the tile act as its border.

    Returns
    -------
    ndarray of uint32
        Posts ``row * (cells + 1) + col``; every strip ends with RESTART.
    """
    west, north = min(max(west, 0), cells), min(max(north, 0), cells)
    strips = [_lines(EASTBOUND, 0, north, 0, west)]  # NW of O'
    strips += _bisected(0, north, west, cells, diagonal)
    # The SW quadrant is the NE quadrant turned by half a turn about the tile's centre.
    turned = _bisected(0, cells - north, cells - west, cells, 2 * cells - 1 - diagonal)
    strips += [_turned(part, cells) for part in turned]
    south_east = _lines(WESTBOUND, cells, north, cells, west)
    if len(south_east) and diagonal > west + north:  # O' lies in the last cell, beyond its diagonal: turn that cell
        south_east[-1, 3] -= 1
        south_east = np.concatenate([south_east[south_east[:, 3] > 0], [(EASTBOUND, north, west, 1)]])
    return _expand(np.concatenate([*strips, south_east]), cells + 1)


def _lines(direction: int, row_from: int, row_to: int, col_from: int, col_to: int) -> Ints:
    """Strips (direction, row, col, length) that fill a rectangle of cells.

    A rectangle is given by its far and near borders: rows from ``row_from`` to ``row_to`` are drawn in that order, and
    likewise the columns, upwards or downwards.
    """
    row_step, col_step = (1 if row_to > row_from else -1), (1 if col_to > col_from else -1)
    rows = np.arange(row_from, row_to, row_step) - (row_step < 0)
    cols = np.arange(col_from, col_to, col_step) - (col_step < 0)
    if not (len(rows) and len(cols)):
        return np.empty((0, 4), np.int64)
    by_rows = direction in (EASTBOUND, WESTBOUND)
    lines = np.empty((len(rows) if by_rows else len(cols), 4), np.int64)
    lines[:, 0], lines[:, 3] = direction, len(cols) if by_rows else len(rows)
    lines[:, 1], lines[:, 2] = (rows, cols[0]) if by_rows else (rows[0], cols)
    return lines


def _bisected(top: int, bottom: int, left: int, right: int, diagonal: int) -> list[Ints]:
    """Strips of a rectangle of cells in the NE quadrant (figures 11 and 12).

    Cells with row + col < ``diagonal`` belong to NE2, the others to NE1. The square on the bisector is drawn by columns
    and rows in turn; a rectangle beyond it comes before, the one on this side after.
    """
    rows, cols = bottom - top, right - left
    if rows <= 0 or cols <= 0:
        return []
    limit = diagonal - top - left  # from the rectangle's own corner
    # NE12 where the bisector leaves through the top, NE22 where it leaves through the right side: the square's own
    # diagonal cells belong to NE2 or to NE1.
    column_first = limit < cols
    main = limit - 1 if column_first else limit
    first, last = max(0, main - cols + 1), min(rows - 1, main)
    if first > last:  # the bisector passes beside the rectangle
        return [
            _lines(WESTBOUND, top, bottom, right, left) if limit <= 0 else _lines(SOUTHBOUND, top, bottom, right, left)
        ]
    size, west, east = last - first + 1, left + main - last, left + main - first + 1
    beyond = (
        _lines(SOUTHBOUND, top, top + first, right, left)
        if first
        else _lines(WESTBOUND, top, top + last + 1, right, east)
    )
    k = np.arange(size)
    column = np.stack([np.full(size, SOUTHBOUND), np.full(size, top + first), east - 1 - k, k + column_first], -1)
    row = np.stack([np.full(size, WESTBOUND), top + first + k, np.full(size, east - 1), k + (not column_first)], -1)
    square = np.stack([row, column] if column_first else [column, row], 1).reshape(-1, 4)
    before = (
        _lines(WESTBOUND, top + last + 1, bottom, right, left)
        if last < rows - 1
        else _lines(SOUTHBOUND, top + first, bottom, west, left)
    )
    return [beyond, square[square[:, 3] > 0], before]


def _turned(strips: Ints, cells: int) -> Ints:
    """Strips turned by half a turn about the centre of a square tile."""
    direction, row, col, length = strips.T
    return np.stack([direction ^ 1, cells - 1 - row, cells - 1 - col, length], -1)


def _expand(strips: Ints, posts: int) -> npt.NDArray[np.uint32]:
    """Post indices of strips (direction, row, col, length) in a tile of ``posts`` posts a side."""
    direction, row, col, length = strips.T
    # South- and northbound strips start with their first post twice, which turns them counter-clockwise too.
    lead = (direction >= SOUTHBOUND).astype(np.int64)
    count = 2 * (length + 1) + lead + 1
    end = np.cumsum(count)
    strip = np.repeat(np.arange(len(strips)), count)
    k = np.maximum(np.arange(end[-1]) - (end - count + lead)[strip], 0)
    first = np.stack([row, col], -1) + _FIRST[direction]
    step = np.array([posts, 1])
    index = (
        (first @ step)[strip]
        + (_ALONG @ step)[direction][strip] * (k >> 1)
        + (_ACROSS @ step)[direction][strip] * (k & 1)
    )
    index[end - 1] = RESTART
    return index.astype(np.uint32)
