"""The height each post is morphed to, for all levels of detail in one grid.

**Source**: Larsen and Christensen (see `terrain.algorithms.geomorph`), table 3.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

Grid = npt.NDArray[np.float32]


def build_morph_targets(heights_m: Grid, cells: int) -> Grid:
    """Height of every post, and the height it is morphed to (table 3): (rows, cols, 2) float32.

    A post belongs to the levels up to the one at which its row or column becomes odd, and is morphed at that level
    only: an edge midpoint to the middle of its edge, a centre to the middle of its cell's diagonal. So one height per
    post is enough for all levels.

    Parameters
    ----------
    heights_m : ndarray of float32, (rows, cols)
    cells : int
        Cells along the largest tiles; the grid is padded to whole ones by repeating its last row and column.
    """
    pad = [(0, -(n - 1) % cells) for n in heights_m.shape]
    posts = np.pad(heights_m, pad, mode="edge")
    result = np.empty((*posts.shape, 2), np.float32)
    with ThreadPoolExecutor() as pool:  # bands of one row of tiles stay in the processor's cache
        list(pool.map(lambda row: _morph_band(posts, result, row, cells), range(0, posts.shape[0] - 1, cells)))
    return result


def _morph_band(posts: Grid, result: Grid, first: int, cells: int) -> None:
    """Fill rows ``first`` to ``first + cells``; the last is shared with the next band, which writes the same."""
    band, half = posts[first : first + cells + 1], np.float32(0.5)
    result[first : first + cells + 1, :, 0] = band
    target = result[first : first + cells + 1, :, 1]
    target[...] = band
    for level in range(cells.bit_length() - 1):
        size, step = 1 << level, 2 << level
        grid = band[::size, ::size]
        nw, ne, sw, se = grid[:-1:2, :-1:2], grid[:-1:2, 2::2], grid[2::2, :-1:2], grid[2::2, 2::2]
        target[::step, size::step] = half * (grid[::2, :-1:2] + grid[::2, 2::2])
        target[size::step, ::step] = half * (grid[:-1:2, ::2] + grid[2::2, ::2])
        even = np.add.outer(np.arange(nw.shape[0]) + first // step, np.arange(nw.shape[1])) % 2 == 0
        target[size::step, size::step] = half * np.where(even, nw + se, sw + ne)
