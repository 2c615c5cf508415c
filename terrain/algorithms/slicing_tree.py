"""The quadtree of bounding boxes that adaptive slicing cuts, with what its slice counts need: how far peaks stand out.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001, section 4.

Deviation: beside its lowest and highest post a box knows, for chords of 2, 4, 8 ... cells, how far ground rises over
their middle anywhere in it. A ray that passes over the ground at two planes of slices that far apart can miss a peak of
at most this height. (The pyramid's errors do not tell: a ridge along posts of a coarse level costs that level nothing.)
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Culler
from terrain.pyramid import BASE_LEVEL, Pyramid
from terrain.scene import Scene

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]

STRIDES = 3  # every 2nd, 4th or 8th post: both ends of a box of 8 cells stay
CHORDS = 7  # chords of 2 to 2^7 cells; boxes are rarely wider, and planes never farther apart than a box is wide


class Nodes(NamedTuple):
    """Quadtree nodes (n,): node (level, row, col) covers the cells from (row << level, col << level) on."""

    level: Ints
    row: Ints
    col: Ints

    def where(self, kept: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Nodes:
        return Nodes(self.level[kept], self.row[kept], self.col[kept])


@dataclass(frozen=True, eq=False)
class SliceTree:
    """The boxes of a scene; all levels one behind the other, so that nodes of mixed levels are looked up at once.

    Attributes
    ----------
    culler : Culler
        Finds the nodes a cut starts from.
    lowest_m, highest_m : ndarray of float32 (n,)
    peak_m : ndarray of float32 (n, CHORDS)
        Column k: the most that ground rises over the middle of a chord of 2^(k + 1) cells.
    error_m : ndarray of float32 (n, STRIDES)
        Column k: the most that the surface of every 2^(k + 1)-th post is off; infinite where the box's tiles
        (`terrain.renderers.slicing_fans`) are too small for it, or reach over the grid's far edges.
    offset, rows, cols : ndarray of int32, by level
        Node (level, row, col) stands at offset[level] + row * cols[level] + col.
    cells : tuple of int
        Cells of the grid, (rows, cols).
    spacing_m : tuple of float
    """

    culler: Culler
    lowest_m: Floats
    highest_m: Floats
    peak_m: Floats
    error_m: Floats
    offset: Ints
    rows: Ints
    cols: Ints
    cells: tuple[int, int]
    spacing_m: tuple[float, float]

    def number(self, nodes: Nodes) -> npt.NDArray[np.int64]:
        """Where the nodes stand in the flat arrays."""
        return np.asarray(self.offset[nodes.level] + nodes.row.astype(np.int64) * self.cols[nodes.level] + nodes.col)

    def corners(
        self, nodes: Nodes, origin_m: npt.NDArray[np.float64] | float = 0.0
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Lower and upper corners (n, 3) of the nodes' boxes relative to ``origin_m``, cut off at the grid's edges."""
        number = self.number(nodes)
        dx, dz = self.spacing_m
        west, north = nodes.col << nodes.level, nodes.row << nodes.level
        size = np.left_shift(np.int32(1), nodes.level)
        lower, upper = np.empty((3, len(number))).T, np.empty((3, len(number))).T  # columns are what numpy works along
        lower[:, 0], upper[:, 0] = west * dx, np.minimum(west + size, self.cells[1]) * dx
        lower[:, 1], upper[:, 1] = self.lowest_m[number], self.highest_m[number]
        lower[:, 2], upper[:, 2] = north * dz, np.minimum(north + size, self.cells[0]) * dz
        return lower - origin_m, upper - origin_m

    def children(self, nodes: Nodes) -> tuple[npt.NDArray[np.intp], Nodes]:
        """The children of nodes above BASE_LEVEL: whose each is, and which; at the far edges fewer than four."""
        offset = np.arange(4, dtype=np.int32)
        child = Nodes(
            np.repeat(nodes.level - np.int32(1), 4),
            (2 * nodes.row[:, None] + offset // 2).ravel(),
            (2 * nodes.col[:, None] + offset % 2).ravel(),
        )
        exists = (child.row < self.rows[child.level]) & (child.col < self.cols[child.level])
        return np.repeat(np.arange(len(nodes.row)), 4)[exists], child.where(exists)


def build_slice_tree(scene: Scene) -> SliceTree:
    """The tree of a scene; 4097 x 4097 posts take about a second."""
    pyramid = scene.pyramid
    levels = range(BASE_LEVEL, pyramid.top_level + 1)
    shapes = [pyramid.node_shape(level) for level in levels]
    with ThreadPoolExecutor() as pool:  # numpy releases the GIL
        chords = list(pool.map(lambda k: _peaks(scene.heightfield.heights_m, 1 << k, *shapes[0]), range(CHORDS)))
    peaks = [np.stack(chords, axis=-1)]
    np.maximum.accumulate(peaks[0], axis=-1, out=peaks[0])  # a longer chord passes over whatever a shorter one does
    for _ in levels[1:]:
        peaks.append(_join_four(peaks[-1]))
    below = np.zeros(BASE_LEVEL, np.int32)
    sizes = [rows * cols for rows, cols in shapes]
    return SliceTree(
        Culler(scene, BASE_LEVEL),
        np.concatenate([pyramid.minimum(k).ravel() for k in levels]),
        np.concatenate([pyramid.maximum(k).ravel() for k in levels]),
        np.ascontiguousarray(np.concatenate([p.reshape(-1, CHORDS) for p in peaks])),
        np.ascontiguousarray(np.concatenate([_errors(pyramid, level).reshape(STRIDES, -1).T for level in levels])),
        np.concatenate([below, np.cumsum([0, *sizes[:-1]], dtype=np.int32)]).astype(np.int32),
        np.concatenate([below, [s[0] for s in shapes]]).astype(np.int32),
        np.concatenate([below, [s[1] for s in shapes]]).astype(np.int32),
        pyramid.cells,
        scene.heightfield.spacing_m,
    )


def _peaks(heights: Floats, half: int, rows: int, cols: int) -> Floats:
    """How far posts rise over the middle of chords of 2 ``half`` cells: the most per node of BASE_LEVEL (rows, cols).

    Chords run along rows, columns and both diagonals. Those longer than 4 cells are centred at every quarter of their
    length, at least once per node.
    """
    size = 1 << BASE_LEVEL
    step = min(max(half // 2, 1), size)
    per = size // step
    peaks = np.zeros((rows * per + 1, cols * per + 1), np.float32)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        first = [-(-half // step) * step if moves else 0 for moves in (down, right)]
        stop = [n - half if moves else n for moves, n in zip((down, right), heights.shape, strict=True)]
        if first[0] >= stop[0] or first[1] >= stop[1]:
            continue

        (r0, c0), (r1, c1), i, j = first, stop, half * down, half * right
        rise = heights[r0:r1:step, c0:c1:step] - np.float32(0.5) * (
            heights[r0 - i : r1 - i : step, c0 - j : c1 - j : step]
            + heights[r0 + i : r1 + i : step, c0 + j : c1 + j : step]
        )
        part = peaks[first[0] // step :, first[1] // step :][: rise.shape[0], : rise.shape[1]]
        np.maximum(part, rise[: part.shape[0], : part.shape[1]], out=part)
    # A node's last row and column of posts are the next node's first: their flanks lie in both.
    inner = peaks[:-1, :-1].reshape(rows, per, cols, per).max(axis=(1, 3))
    south, east = peaks[per::per, :-1].reshape(rows, cols, per), peaks[:-1, per::per].reshape(rows, per, cols)
    return np.maximum.reduce([inner, south.max(axis=2), east.max(axis=1), peaks[per::per, per::per]])


def _errors(pyramid: Pyramid, level: int) -> Floats:
    """Errors of coarser surfaces per node of ``level``, (STRIDES, rows, cols)."""
    errors = np.full((STRIDES, *pyramid.node_shape(level)), np.inf, np.float32)
    rows, cols = (cells >> level for cells in pyramid.cells)  # nodes that end inside the grid
    for k in range(min(level - 1, STRIDES)):  # at least 2 x 2 of its cells in a tile
        errors[k, :rows, :cols] = pyramid.error(level, k + 1)[:rows, :cols]
    return errors


def _join_four(values: Floats) -> Floats:
    """The largest of each 2 x 2 nodes, (rows, cols, k); an odd last row or column stands alone."""
    rows, cols = values.shape[:2]
    values = np.pad(values, ((0, rows % 2), (0, cols % 2), (0, 0)))
    rows_joined = np.maximum(values[::2], values[1::2])
    return np.maximum(rows_joined[:, ::2], rows_joined[:, 1::2])
