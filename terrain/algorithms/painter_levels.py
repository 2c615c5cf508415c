"""Level of detail for the painter: tiles at different levels, the fans that stitch them, and the order inside fans.

A tile of level l is a grid of cells of 2^l posts, cut SW-NE like the full grid, so that the surfaces nest and their
errors are found at posts. Neighbouring tiles differ by at most one level. Towards a coarser neighbour the odd posts of
the shared edge move onto even ones, and the triangles there become fans.

Source: Alonso and Joan-Arinyo, section 7 and figures 21 to 23.

Deviations:

* Fans are ordered by 2 x 2 cells at once: such a *block* is the smallest convex piece of a stitched tile. Blocks go by
  rank like cells; inside one the order follows from ten lines, and a table holds it for every side of every line and
  every combination of stitched edges (`order_blocks`). The paper's 24 cases, and their two orders by slope, are in it.
* Odd posts move along the diagonal (north and east edges to the east and north, south and west edges to the west and
  south), as in the paper, except beside a north-west or south-east corner between two coarser neighbours: there they
  move to the corner, because the other way would leave an upright sliver.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from terrain.algorithms.painter import Foot, far_to_near

Ints = npt.NDArray[np.int64]

NORTH, EAST, SOUTH, WEST = 1, 2, 4, 8  # edges towards a coarser neighbour

# The lines inside a block, as (field of Foot, k): at unit cell size, a post p lies on line (a, b, k) if a x + b y = k.
BLOCK_LINES = (
    ("west", 1), ("north", 1), ("sum", 1), ("sum", 2), ("sum", 3),
    ("steep", 2), ("steep", 4), ("shallow", 2), ("shallow", 4), ("difference", 0),
)  # fmt: skip
_COEFFICIENTS = {
    "west": (1, 0), "north": (0, 1), "sum": (1, 1), "difference": (1, -1), "steep": (2, 1), "shallow": (1, 2)
}  # fmt: skip
_FIELD = np.array([Foot._fields.index(name) for name, _ in BLOCK_LINES])
_CONSTANT = np.array([k for _, k in BLOCK_LINES])

# Corners (row, col) of the eight triangles of a block before stitching, counter-clockwise seen from above: cell by
# cell, the north-west triangle first.
BLOCK_TRIANGLES = np.array(
    [
        [(i + a, j + b) for a, b in corners]
        for i in (0, 1)
        for j in (0, 1)
        for corners in (((0, 0), (1, 0), (0, 1)), ((0, 1), (1, 0), (1, 1)))
    ]
)


def stitch(row: npt.ArrayLike, col: npt.ArrayLike, cells: npt.ArrayLike, edges: npt.ArrayLike) -> tuple[Ints, Ints]:
    """Where the posts (row, col) of a tile of ``cells`` cells a side are drawn when ``edges`` are stitched."""
    row, col, cells, edges = np.broadcast_arrays(*(np.asarray(a, np.int64) for a in (row, col, cells, edges)))
    north, east, south, west = ((edges & bit) != 0 for bit in (NORTH, EAST, SOUTH, WEST))
    odd_row, odd_col = row % 2 == 1, col % 2 == 1
    row_step = np.select(
        [odd_row & (col == 0) & west, odd_row & (col == cells) & east],
        [np.where((row == 1) & north, -1, 1), np.where((row == cells - 1) & south, 1, -1)],
        0,
    )
    col_step = np.select(
        [odd_col & (row == 0) & north, odd_col & (row == cells) & south],
        [np.where((col == 1) & west, -1, 1), np.where((col == cells - 1) & east, 1, -1)],
        0,
    )
    return row + row_step, col + col_step


@lru_cache(maxsize=1)
def order_blocks() -> npt.NDArray[np.uint32]:
    """Orders of the eight triangles of a block for every combination of stitched edges and every side of O'.

    Returns
    -------
    ndarray of uint32, (16, 1024)
        ``[edges, sides]``: bit i of ``sides`` is set where O' lies on the larger side of ``BLOCK_LINES[i]``; the k-th
        three bits of an entry name the k-th triangle, far to near. Sides that no O' has hold any order.
    """
    sides = np.arange(1 << len(BLOCK_LINES))
    table = np.empty((16, len(sides)), np.uint32)
    for edges in range(16):
        # before[t]: the triangles that must come before t, as bits, for every combination of sides.
        before = np.zeros((8, len(sides)), np.int64)
        corners = np.stack(stitch(BLOCK_TRIANGLES[..., 0], BLOCK_TRIANGLES[..., 1], 2, edges), -1)
        for t, u, line, t_is_larger in _shared_edges(corners):
            t_is_nearer = ((sides >> line) & 1 == 1) == t_is_larger
            before[t] |= np.where(t_is_nearer, 1 << u, 0)
            before[u] |= np.where(t_is_nearer, 0, 1 << t)
        done = np.zeros(len(sides), np.int64)
        entry = np.zeros(len(sides), np.int64)
        for k in range(8):
            is_ready = ((before & ~done) == 0) & ((done >> np.arange(8)[:, None]) & 1 == 0)
            # A cycle means that no O' has these sides: go on with any triangle that is left.
            is_left = (done >> np.arange(8)[:, None]) & 1 == 0
            chosen = np.where(is_ready.any(0), is_ready.argmax(0), is_left.argmax(0))
            entry |= chosen << (3 * k)
            done |= 1 << chosen
        table[edges] = entry
    return table


def _shared_edges(corners: Ints) -> list[tuple[int, int, int, bool]]:
    """Edges between two triangles of a block: (t, u, index of the line, whether t lies on its larger side)."""
    owners: dict[frozenset[tuple[int, int]], list[int]] = {}
    for t, triangle in enumerate(corners.tolist()):
        posts = [tuple(p) for p in triangle]
        if len(set(posts)) == 3:  # stitching leaves some triangles without area
            for i in range(3):
                owners.setdefault(frozenset((posts[i], posts[i - 1])), []).append(t)
    shared = []
    for edge, triangles in owners.items():
        if len(triangles) == 2:
            t, u = triangles
            for line, (name, k) in enumerate(BLOCK_LINES):
                a, b = _COEFFICIENTS[name]
                if all(a * col + b * row == k for row, col in edge):
                    larger = bool((a * corners[t, :, 1] + b * corners[t, :, 0]).max() > k)
                    shared.append((t, u, line, larger))
                    break
            else:
                raise AssertionError(f"edge {sorted(edge)} lies on none of the ten lines")
    return shared


def order_stitched(cells: int, edges: int, local: npt.ArrayLike) -> Ints:
    """Triangles of one tile far to near, with fans at ``edges``: blocks by rank, then the table.

    Parameters
    ----------
    cells : int
        Cells along one side, even.
    edges : int
        Sum of NORTH, EAST, SOUTH, WEST.
    local : array_like of int, (6,)
        `Foot.seen_from` the tile's north-west post at its level.

    Returns
    -------
    ndarray of int64, (2 * cells * cells, 3, 2)
        Posts (row, col) in cells of the tile; where the fans are, some triangles have no area.
    """
    foot = Foot(*(int(v) for v in np.asarray(local)))
    half = cells // 2
    row = 2 * np.repeat(far_to_near(half, foot.north // 2), half)
    col = 2 * np.tile(far_to_near(half, foot.west // 2), half)
    is_larger = foot.seen_from(row, col)[_FIELD] >= _CONSTANT[:, None]
    sides = (is_larger << np.arange(len(BLOCK_LINES))[:, None]).sum(0)
    # Only the tile's own border is stitched, so an inner block has no edges; corners need to know both of theirs.
    order = order_blocks()[_edges_of_blocks(row, col, cells, edges), sides].astype(np.int64)
    triangle = (order[:, None] >> (3 * np.arange(8))) & 7
    corner = BLOCK_TRIANGLES[triangle] + np.stack([row, col], -1)[:, None, None, :]
    return np.stack(stitch(corner[..., 0], corner[..., 1], cells, edges), -1).reshape(-1, 3, 2)


def _edges_of_blocks(row: Ints, col: Ints, cells: int, edges: int) -> Ints:
    touching = NORTH * (row == 0) + EAST * (col == cells - 2) + SOUTH * (row == cells - 2) + WEST * (col == 0)
    return edges & touching


def clamp_local(local: Ints, cells: npt.ArrayLike) -> Ints:
    """Feet seen from tiles (6, ...), moved onto the tile's border where that changes no order: keys of equal orders."""
    low = np.array([0, 0, 0, -1, 0, 0]).reshape(6, *[1] * (local.ndim - 1)) * np.asarray(cells)
    high = np.array([1, 1, 2, 1, 3, 3]).reshape(6, *[1] * (local.ndim - 1)) * np.asarray(cells)
    return np.clip(local, low, high)


def tile_edges(levels: Ints) -> Ints:
    """Edges of each tile (rows, cols) that meet a coarser neighbour."""
    edges = np.zeros_like(levels)
    is_coarser = levels[:-1] > levels[1:]
    edges[1:] |= np.where(is_coarser, NORTH, 0)
    edges[:-1] |= np.where(levels[1:] > levels[:-1], SOUTH, 0)
    edges[:, 1:] |= np.where(levels[:, :-1] > levels[:, 1:], WEST, 0)
    edges[:, :-1] |= np.where(levels[:, 1:] > levels[:, :-1], EAST, 0)
    return edges
