"""The painter's work for one view: which tiles, at which level, in which order, and by which pattern each is drawn.

Source: Alonso and Joan-Arinyo, sections 5 (algorithm 1, figure 14) and 8.

Deviations: the paper draws one tile per call from an index buffer (`order_indexed`). `order_runs` does without index
buffers: neighbouring tiles of one pattern become one draw call, whose order the shader computes from the vertex number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.painter import (
    FIXED_FOOT,
    NE2,
    STRADDLING,
    SW1,
    Foot,
    classify_tiles,
    order_cells,
    order_strips,
    rank_tiles,
)
from terrain.algorithms.painter_levels import clamp_local, order_stitched

Ints = npt.NDArray[np.int64]

# What a run of tiles is drawn by: the strips of one of the six sectors, or
CELLS, BLOCKS, INDEXED = 6, 7, 8
MAX_RUN_VERTICES = 1 << 28  # the shader divides vertex numbers exactly up to 2^30
_ROWS = np.array([True, False, True, True, False, True, False, False])  # patterns that are strips along rows


class Tiles(NamedTuple):
    """Tiles to be drawn, as flat arrays (n,): row and column in the grid of tiles, level, and stitched edges."""

    row: Ints
    col: Ints
    level: Ints
    edges: Ints

    def take(self, order: Ints) -> Tiles:
        return Tiles(self.row[order], self.col[order], self.level[order], self.edges[order])


class TileGrid(NamedTuple):
    """The grid of square tiles of 2^tile_level posts that covers ``cells`` (rows, cols) of the terrain."""

    cells: tuple[int, int]
    tile_level: int

    @property
    def shape(self) -> tuple[int, int]:
        return -(-self.cells[0] >> self.tile_level), -(-self.cells[1] >> self.tile_level)

    def inside(self, row: npt.ArrayLike, col: npt.ArrayLike, node_level: int) -> tuple[Ints, Ints]:
        """Rows and columns of the tiles inside quadtree nodes of ``node_level``, not below the tiles' own."""
        shift = node_level - self.tile_level
        step = np.arange(1 << shift)
        rows = (np.asarray(row, np.int64)[:, None, None] << shift) + step[:, None]
        cols = (np.asarray(col, np.int64)[:, None, None] << shift) + step
        rows, cols = (a.ravel() for a in np.broadcast_arrays(rows, cols))
        is_inside = (rows < self.shape[0]) & (cols < self.shape[1])
        return rows[is_inside], cols[is_inside]

    def triangles(self, tiles: Tiles) -> int:
        """Triangles of tiles: two per cell inside the grid, one less for every post that stitching takes away."""
        size = 1 << self.tile_level
        rows = np.minimum(size, self.cells[0] - tiles.row * size)
        cols = np.minimum(size, self.cells[1] - tiles.col * size)
        cell = 1 << tiles.level
        total = 2 * (-(-rows // cell) * -(-cols // cell))
        for edge, length in ((1, cols), (2, rows), (4, cols), (8, rows)):
            total -= np.where(tiles.edges & edge, length // (2 * cell), 0)
        return int(total.sum())


class Runs(NamedTuple):
    """Draw calls in order: ``run`` (n, 4) is ``u_run`` of painter.vert, ``vertices`` (n,) their number of vertices."""

    run: npt.NDArray[np.int32]
    vertices: Ints


def order_runs(foot: Foot, tiles: Tiles, grid: TileGrid, cells_only: bool = False) -> Runs:
    """Tiles far to near as runs: neighbours in rank with one pattern, level and set of stitched edges.

    A tile inside one sector is drawn by that sector's strips, one that straddles by cells, a stitched one by blocks;
    with ``cells_only`` every unstitched tile goes by cells, and the whole terrain is one run.
    """
    size = 1 << grid.tile_level
    rank = rank_tiles(foot, tiles.row, tiles.col, grid.shape, size)
    order = np.argsort(rank)
    rank, tiles = rank[order], tiles.take(order)
    sector = classify_tiles(foot, tiles.row * size, tiles.col * size, size)
    pattern = np.where((sector == STRADDLING) | cells_only, CELLS, sector)
    pattern = np.where(tiles.edges != 0, BLOCKS, pattern)
    part = rank // max(MAX_RUN_VERTICES // (6 * size * size), 1)
    same = np.stack([rank - np.arange(len(rank)), pattern, tiles.level, tiles.edges, part])
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(same, axis=1) != 0).any(0)])) if len(rank) else order
    count = np.diff(np.append(starts, len(rank)))
    pattern, cells = pattern[starts], np.int64(size) >> tiles.level[starts]
    # A strip names its first and last post twice, to join the next one; strips along rows start one vertex later.
    per_tile = np.where(pattern < CELLS, cells * (2 * cells + 4), 6 * cells * cells)
    run = np.stack([rank[starts], tiles.level[starts], pattern, tiles.edges[starts]], axis=1)
    return Runs(run.astype(np.int32), count * per_tile + _ROWS[pattern])


class IndexedTiles(NamedTuple):
    """Draw calls of single tiles in order: ``run`` as in `Runs`, and for each tile where its order is in ``keys``."""

    run: npt.NDArray[np.int32]
    order: Ints
    keys: list[tuple[int, ...]]


def order_indexed(foot: Foot, tiles: Tiles, grid: TileGrid) -> IndexedTiles:
    """Tiles far to near, and for each the key of its order: equal keys, equal order (`build_order`)."""
    size = 1 << grid.tile_level
    tiles = tiles.take(np.argsort(rank_tiles(foot, tiles.row, tiles.col, grid.shape, size)))
    row, col = tiles.row * size, tiles.col * size
    sector = classify_tiles(foot, row, col, size)
    cells = np.int64(size) >> tiles.level
    local = clamp_local(foot.seen_from(row, col, tiles.level), cells)
    local[3:, tiles.edges == 0] = 0  # only fans have edges in these directions
    # In the NW and SE sectors no bisector is near, in the others it is far to one side.
    is_pure = (sector != STRADDLING) & (tiles.edges == 0)
    local[2] = np.where(is_pure, np.where((sector >= NE2) & (sector <= SW1), 2 * cells - 1, 0), local[2])
    table = np.concatenate([cells[None], tiles.edges[None], local])
    run = np.stack([tiles.row * grid.shape[1] + tiles.col, tiles.level, np.full(len(row), INDEXED), sector], axis=1)
    if not len(row):
        return IndexedTiles(run.astype(np.int32), row, [])
    _, first, order = np.unique(_numbered(table), return_index=True, return_inverse=True)
    return IndexedTiles(run.astype(np.int32), order, [tuple(k) for k in table[:, first].T.tolist()])


def _numbered(table: Ints) -> Ints:
    """One number per column of a table, equal for equal columns; np.unique on columns is ten times slower."""
    number = np.zeros(table.shape[1], np.int64)
    for row in table:
        number = np.unique(number, return_inverse=True)[1] * (np.ptp(row) + 1) + (row - row.min())
    return number


def build_order(key: tuple[int, ...]) -> npt.NDArray[np.uint32]:
    """Post indices of one order: strips, or for stitched tiles (``key[1]`` not 0) a list of triangles."""
    cells, edges, *local = key
    if edges == 0:
        return order_strips(cells, *local[:3])
    post = order_stitched(cells, edges, local)
    return (post[..., 0] * (cells + 1) + post[..., 1]).reshape(-1).astype(np.uint32)


def build_shuffled_order(cells: int, randomness: float, seed: int = 0) -> npt.NDArray[np.uint32]:
    """A list of all triangles of a tile, a share of them (0 ... 1) at random places (6.1, table 4)."""
    corner = order_cells(cells, cells, FIXED_FOOT)
    post = corner[..., 0] * (cells + 1) + corner[..., 1]
    random = np.random.default_rng(seed)
    moved = random.permutation(len(post))[: round(randomness * len(post))]
    post[np.sort(moved)] = post[moved]
    return post.reshape(-1).astype(np.uint32)
