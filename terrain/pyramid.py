"""Bounds of the surface: minimum, maximum and error of every quadtree node, as flat arrays per level.

A *node* of level k covers 2^k x 2^k cells; the finest nodes stored have level `BASE_LEVEL` (8 x 8 cells). The *surface*
of level l joins every 2^l-th post by the alternating diagonal rule on cells of 2^l posts. That rule nests: an edge of
level l runs along edges of level 0, so the largest vertical distance between the two surfaces is found at a post.

Grids need not measure 2^n + 1 posts. Past its far edges the grid repeats its last row and column, cells reach over the
edge, and whoever draws them clips at the edge; so the nesting, and with it every bound, stays exact.

Levels up to `BLOCK_LEVEL` are exact; above, errors add up level by level and are upper bounds.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from terrain.cache import load_arrays, store_arrays
from terrain.heightfield import Heightfield
from terrain.progress import tell

BASE_LEVEL = 3
BLOCK_LEVEL = 6
BLOCK = 1 << BLOCK_LEVEL
CACHE_VERSION = 1

Grid = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Quadtree bounds of a height field.

    Attributes
    ----------
    minimum_m, maximum_m : tuple of ndarray of float32
        Index k - BASE_LEVEL holds the lowest and highest post of every node of level k, shape `node_shape(k)`.
    error_m : tuple of ndarray of float32
        Index l holds the largest vertical distance between the surface of level l and the full surface, per node of
        level max(l, BASE_LEVEL). Monotone: never below the errors of finer levels in the same node.
    cells : tuple of int
        Cells of the grid, (rows - 1, cols - 1).
    """

    minimum_m: tuple[Grid, ...]
    maximum_m: tuple[Grid, ...]
    error_m: tuple[Grid, ...]
    cells: tuple[int, int]

    @property
    def top_level(self) -> int:
        """The level at which one node covers the whole grid."""
        return BASE_LEVEL + len(self.minimum_m) - 1

    def node_shape(self, level: int) -> tuple[int, int]:
        """Rows and columns of nodes of ``level``."""
        return -(-self.cells[0] >> level), -(-self.cells[1] >> level)

    def minimum(self, level: int) -> Grid:
        """Lowest post of every node of ``level``, BASE_LEVEL <= level <= top_level."""
        return self.minimum_m[level - BASE_LEVEL]

    def maximum(self, level: int) -> Grid:
        """Highest post of every node of ``level``, BASE_LEVEL <= level <= top_level."""
        return self.maximum_m[level - BASE_LEVEL]

    def error(self, node_level: int, surface_level: int) -> Grid:
        """Largest vertical error [m] of the surface of ``surface_level`` in every node of ``node_level``.

        Raises
        ------
        ValueError
            If the surface is coarser than the node, or either level is not in the pyramid.
        """
        if not max(surface_level, BASE_LEVEL) <= node_level <= self.top_level or surface_level < 0:
            raise ValueError(f"no error of surface level {surface_level} per node of level {node_level}")
        error = self.error_m[surface_level]
        for _ in range(node_level - max(surface_level, BASE_LEVEL)):
            error = _reduce(error, np.maximum)
        return error

    def scaled(self, factor: float) -> Pyramid:
        """The pyramid of the same grid with heights times a positive ``factor``."""
        scale = np.float32(factor)
        return Pyramid(
            tuple(a * scale for a in self.minimum_m),
            tuple(a * scale for a in self.maximum_m),
            tuple(a * scale for a in self.error_m),
            self.cells,
        )


def load_pyramid(heightfield: Heightfield) -> Pyramid:
    """The pyramid of a height field, from the disk cache where it was built before."""
    key = f"{heightfield.sha256}-v{CACHE_VERSION}"
    cells = (heightfield.rows - 1, heightfield.cols - 1)
    arrays = load_arrays("pyramids", key)
    if arrays is not None:
        count = sum(name.startswith("minimum") for name in arrays)
        try:
            minimum = tuple(arrays[f"minimum{i}"] for i in range(count))
            maximum = tuple(arrays[f"maximum{i}"] for i in range(count))
            return Pyramid(minimum, maximum, tuple(arrays[f"error{i}"] for i in range(count + BASE_LEVEL)), cells)
        except KeyError:
            pass  # an entry of another make: build it again
    pyramid = build_pyramid(heightfield.heights_m)
    if min(cells) > 2 * BLOCK:  # smaller ones are quicker to build than to keep
        named = {"minimum": pyramid.minimum_m, "maximum": pyramid.maximum_m, "error": pyramid.error_m}
        store_arrays("pyramids", key, {f"{n}{i}": a for n, arrays in named.items() for i, a in enumerate(arrays)})
    return pyramid


def build_pyramid(heights_m: Grid) -> Pyramid:
    """Bounds of a grid of posts (rows, cols) float32; 4097 x 4097 posts take about a second."""
    cell_rows, cell_cols = heights_m.shape[0] - 1, heights_m.shape[1] - 1
    block_rows, block_cols = -(-cell_rows // BLOCK), -(-cell_cols // BLOCK)
    # Bands of about a million posts stay in the processor's cache; numpy releases the GIL inside them.
    band = max(1, (1 << 20) // (BLOCK * BLOCK * block_cols))
    starts = range(0, block_rows, band)
    with ThreadPoolExecutor() as pool:
        bands = []
        for bounds in pool.map(lambda r: _block_bounds(heights_m, r, min(r + band, block_rows)), starts):
            bands.append(bounds)
            tell("finding bounds", len(bands) / len(starts))
    minimum, maximum, *errors = (np.concatenate(parts, axis=0) for parts in zip(*bands, strict=True))

    top = max(BASE_LEVEL, math.ceil(math.log2(max(cell_rows, cell_cols, 1))))
    minima, maxima = (
        [_crop(minimum, cell_rows, cell_cols, BASE_LEVEL)],
        [_crop(maximum, cell_rows, cell_cols, BASE_LEVEL)],
    )
    for _ in range(BASE_LEVEL, top):
        minima.append(_reduce(minima[-1], np.minimum))
        maxima.append(_reduce(maxima[-1], np.maximum))
    error_m = [np.zeros_like(minima[0])]
    error_m += [_crop(e, cell_rows, cell_cols, max(l, BASE_LEVEL)) for l, e in enumerate(errors, 1) if l <= top]
    for level in range(1, len(error_m)):
        finer = error_m[level - 1] if level <= BASE_LEVEL else _reduce(error_m[level - 1], np.maximum)
        np.maximum(error_m[level], finer, out=error_m[level])
    for level in range(BLOCK_LEVEL + 1, top + 1):
        step = _level_step(heights_m, level)
        error_m.append(_reduce(error_m[-1], np.maximum) + step)
    return Pyramid(tuple(minima), tuple(maxima), tuple(error_m), (cell_rows, cell_cols))


@lru_cache(maxsize=64)
def _diagonal_weights(size: int, row: int, col: int) -> tuple[float, float, float, float]:
    """(u, v) of a post in a cell of ``size`` posts, and its diagonal weight for NW-SE and SW-NE cells.

    With d = nw + se - ne - sw the surface in a cell is nw + (ne - nw) u + (sw - nw) v + d w, where the weight w is
    min(u, v) under a NW-SE diagonal and max(0, u + v - 1) under a SW-NE one.
    """
    u, v = col / size, row / size
    return u, v, min(u, v), max(0.0, u + v - 1.0)


def _block_bounds(heights: Grid, first: int, last: int) -> tuple[Grid, ...]:
    """Bounds of block rows ``first`` to ``last``: minimum, maximum, and the errors of levels 1 to BLOCK_LEVEL.

    The posts are reordered to (row in block, col in block, block row, block col), so that one numpy call handles the
    same post of every cell along contiguous memory.
    """
    rows = np.minimum(np.arange(first * BLOCK, last * BLOCK + 1), heights.shape[0] - 1)
    block_cols = -(-(heights.shape[1] - 1) // BLOCK)
    strip = heights[rows[0] : rows[-1] + 1]
    strip = np.pad(
        strip, ((0, len(rows) - len(strip)), (0, block_cols * BLOCK + 1 - heights.shape[1])), mode="edge"
    )  # fmt: skip
    posts = np.empty((BLOCK + 1, BLOCK + 1, last - first, block_cols), np.float32)
    interior = strip[:-1, :-1].reshape(last - first, BLOCK, block_cols, BLOCK)
    posts[:BLOCK, :BLOCK] = interior.transpose(1, 3, 0, 2)
    posts[BLOCK, :BLOCK] = strip[BLOCK::BLOCK, :-1].reshape(last - first, block_cols, BLOCK).transpose(2, 0, 1)
    posts[:BLOCK, BLOCK] = strip[:-1, BLOCK::BLOCK].reshape(last - first, BLOCK, block_cols).transpose(1, 0, 2)
    posts[BLOCK, BLOCK] = strip[BLOCK::BLOCK, BLOCK::BLOCK]

    size = 1 << BASE_LEVEL
    offsets = [(i, j) for i in range(size + 1) for j in range(size + 1)]
    first_i, first_j = offsets[0]
    lowest = _of_cells(posts, size, first_i, first_j).copy()
    highest = lowest.copy()
    for i, j in offsets[1:]:
        values = _of_cells(posts, size, i, j)
        np.minimum(lowest, values, out=lowest)
        np.maximum(highest, values, out=highest)

    # In-grid posts only count: past the far edge nothing is drawn.
    in_rows = (np.arange(BLOCK + 1)[:, None, None, None] + BLOCK * np.arange(first, last)[:, None]) < heights.shape[0]
    in_cols = (np.arange(BLOCK + 1)[:, None, None] + BLOCK * np.arange(block_cols)) < heights.shape[1]
    in_grid = None if in_rows.all() and in_cols.all() else (in_rows & in_cols).astype(np.float32)

    errors = []
    for level in range(1, BLOCK_LEVEL + 1):
        error = _level_error(posts, in_grid, 1 << level, first)
        for _ in range(BASE_LEVEL - level):  # a finer cell than the finest node: reduce to nodes
            error = np.maximum(
                np.maximum(error[::2, ::2], error[1::2, ::2]), np.maximum(error[::2, 1::2], error[1::2, 1::2])
            )
        errors.append(error)
    return tuple(_to_rows(a) for a in (lowest, highest, *errors))


def _of_cells(posts: Grid, size: int, row: int, col: int) -> Grid:
    """Post (row, col) of every cell of ``size`` posts: (cell row, cell col, block row, block col)."""
    stop = BLOCK + 1 - size
    return posts[row : row + stop : size, col : col + stop : size]


def _level_error(posts: Grid, in_grid: Grid | None, size: int, first_block_row: int) -> Grid:
    """Largest distance at a post between the surface on cells of ``size`` posts and the full one, per cell."""
    nw, ne = _of_cells(posts, size, 0, 0), _of_cells(posts, size, 0, size)
    sw, se = _of_cells(posts, size, size, 0), _of_cells(posts, size, size, size)
    slope_u, slope_v, bend = ne - nw, sw - nw, nw + se - ne - sw
    cells = BLOCK // size
    if cells > 1:  # an even number of cells per block: the diagonal alternates inside the block
        odd = (np.add.outer(np.arange(cells), np.arange(cells)) % 2)[:, :, None, None]
    else:
        blocks = np.add.outer(np.arange(first_block_row, first_block_row + posts.shape[2]), np.arange(posts.shape[3]))
        odd = (blocks % 2)[None, None]
    bend_even, bend_odd = np.where(odd == 0, bend, np.float32(0)), np.where(odd == 1, bend, np.float32(0))
    error = np.zeros_like(bend)
    surface, term = np.empty_like(bend), np.empty_like(bend)
    for row in range(size + 1):
        base = nw + slope_v * np.float32(row / size)
        for col in range(size + 1):
            u, _, weight_even, weight_odd = _diagonal_weights(size, row, col)
            np.multiply(slope_u, np.float32(u), out=surface)
            surface += base
            if weight_even:
                np.multiply(bend_even, np.float32(weight_even), out=term)
                surface += term
            if weight_odd:
                np.multiply(bend_odd, np.float32(weight_odd), out=term)
                surface += term
            surface -= _of_cells(posts, size, row, col)
            np.abs(surface, out=surface)
            if in_grid is not None:
                surface *= _of_cells(in_grid, size, row, col)
            np.maximum(error, surface, out=error)
    return error


def _to_rows(cells: Grid) -> Grid:
    """(cell row, cell col, block row, block col) back to (row, col)."""
    n, m, block_rows, block_cols = cells.shape
    return np.ascontiguousarray(cells.transpose(2, 0, 3, 1)).reshape(block_rows * n, block_cols * m)


def _crop(grid: Grid, cell_rows: int, cell_cols: int, level: int) -> Grid:
    """Drop the nodes that lie wholly past the far edges."""
    return np.ascontiguousarray(grid[: -(-cell_rows >> level), : -(-cell_cols >> level)])


def _reduce(grid: Grid, join: np.ufunc) -> Grid:
    """Join blocks of 2 x 2; an odd last row or column stands alone."""
    for axis in (0, 1):
        even, odd = (grid[::2], grid[1::2]) if axis == 0 else (grid[:, ::2], grid[:, 1::2])
        joined = even.copy()
        target = joined[: odd.shape[0]] if axis == 0 else joined[:, : odd.shape[1]]
        join(target, odd, out=target)
        grid = joined
    return grid


def _level_step(heights: Grid, level: int) -> Grid:
    """Largest distance between the surfaces of ``level`` and ``level`` - 1, per cell of ``level``."""
    half = 1 << (level - 1)
    count = [-(-(n - 1) >> level) for n in heights.shape]
    rows, cols = (np.minimum(np.arange(2 * c + 1) * half, n - 1) for c, n in zip(count, heights.shape, strict=True))
    posts = heights[np.ix_(rows, cols)]
    corner = posts[::2, ::2]
    nw, ne, sw, se = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    even = np.add.outer(np.arange(count[0]), np.arange(count[1])) % 2 == 0
    centre = np.where(even, nw + se, sw + ne) / 2
    step = np.abs(posts[1::2, 1::2] - centre)
    for surface, post in (
        ((nw + ne) / 2, posts[:-1:2, 1::2]),
        ((sw + se) / 2, posts[2::2, 1::2]),
        ((nw + sw) / 2, posts[1::2, :-1:2]),
        ((ne + se) / 2, posts[1::2, 2::2]),
    ):
        np.maximum(step, np.abs(post - surface), out=step)
    return step.astype(np.float32)
