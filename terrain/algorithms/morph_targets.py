"""The height each post is morphed to, for all levels of detail in one grid.

**Source**: Larsen and Christensen (see `terrain.algorithms.geomorph`), table 3.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

Grid = npt.NDArray[np.float32]


def morph_targets_shape(heights_shape: tuple[int, int], cells: int) -> tuple[int, int]:
    """Rows and columns of posts, padded to whole tiles of ``cells`` cells."""
    rows, cols = (n + -(n - 1) % cells for n in heights_shape)
    return rows, cols


def build_morph_targets(heights_m: Grid, cells: int) -> Iterator[tuple[int, Grid]]:
    """Height of every post, and the height it is morphed to (table 3), band by band from north to south.

    A post belongs to the levels up to the one at which its row or column becomes odd, and is morphed at that level
    only: an edge midpoint to the middle of its edge, a centre to the middle of its cell's diagonal. So one height per
    post is enough for all levels.

    Parameters
    ----------
    heights_m : ndarray of float32, (rows, cols)
    cells : int
        Cells along the largest tiles; the grid is padded to whole ones by repeating its last row and column.

    Yields
    ------
    int
        The first row of a band of ``cells`` + 1 rows; the last is the first of the next band again.
    ndarray of float32, (cells + 1, padded cols, 2)
    """
    rows, _ = morph_targets_shape(heights_m.shape, cells)
    at_work: deque[tuple[int, Future[Grid]]] = deque()
    workers = os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:  # numpy releases the GIL; the caller uploads meanwhile
        for first in range(0, rows - 1, cells):
            at_work.append((first, pool.submit(_morph_band, heights_m, first, cells)))
            if len(at_work) > workers:
                row, band = at_work.popleft()
                yield row, band.result()
        for row, band in at_work:
            yield row, band.result()


def _morph_band(heights_m: Grid, first: int, cells: int) -> Grid:
    """The band of rows ``first`` to ``first + cells``."""
    band = heights_m[first : first + cells + 1]
    missing = (0, cells + 1 - band.shape[0]), (0, -(band.shape[1] - 1) % cells)
    if missing != ((0, 0), (0, 0)):
        band = np.pad(band, missing, mode="edge")
    result = np.empty((*band.shape, 2), np.float32)
    result[:, :, 0] = result[:, :, 1] = band
    target, half = result[:, :, 1], np.float32(0.5)
    for level in range(cells.bit_length() - 1):
        size, step = 1 << level, 2 << level
        grid = band[::size, ::size]
        nw, ne, sw, se = grid[:-1:2, :-1:2], grid[:-1:2, 2::2], grid[2::2, :-1:2], grid[2::2, 2::2]
        target[::step, size::step] = half * (grid[::2, :-1:2] + grid[::2, 2::2])
        target[size::step, ::step] = half * (grid[:-1:2, ::2] + grid[2::2, ::2])
        even = np.add.outer(np.arange(nw.shape[0]) + first // step, np.arange(nw.shape[1])) % 2 == 0
        target[size::step, size::step] = half * np.where(even, nw + se, sw + ne)
    return result
