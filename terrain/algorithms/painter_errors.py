"""Errors of the painter's levels of detail, and the level of every tile that keeps a tolerance.

A level is chosen by its largest vertical error at the tile's least distance, the fans it forces upon its neighbours
included; so the error on the screen never exceeds the tolerance. The paper (section 7) leaves the choice open.

Errors are exact: surfaces of SW-NE cells nest, so a tile is furthest from the full surface at a post; the new edges of
a fan cross the full grid's edges in posts and halfway between two posts, and nowhere else.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from terrain.cache import load_arrays, store_arrays
from terrain.heightfield import Heightfield

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Grid = npt.NDArray[np.float32]

CACHE_VERSION = 1
BAND_POSTS = 1 << 19  # posts handled at once: they stay in the processor's cache


@dataclass(frozen=True, eq=False)
class LevelErrors:
    """Largest vertical error [m] of every tile at every level, and of the fans it may carry.

    Attributes
    ----------
    surface_m : ndarray of float32, (levels, tile rows, tile cols)
        Error of the tile's own surface. Infinite where the grid's far edge cuts the tile off inside a cell.
    fan_m : ndarray of float32, (levels, 4, tile rows, tile cols)
        Error of the triangles along the north, east, south and west edge when it is stitched.
    """

    surface_m: Grid
    fan_m: Grid

    def select(self, allowed_m: Floats) -> Ints:
        """Level of every tile (rows, cols), given the vertical error [m] that is allowed in each of them."""
        count, (rows, cols) = len(self.surface_m), allowed_m.shape
        is_allowed = self.surface_m <= allowed_m
        for level in range(1, count):
            # A tile of this level may force fans of the next finer one upon its neighbours.
            fits = self.fan_m[level - 1] <= allowed_m
            is_allowed[level, :-1] &= fits[0, 1:]
            is_allowed[level, :, 1:] &= fits[1, :, :-1]
            is_allowed[level, 1:] &= fits[2, :-1]
            is_allowed[level, :, :-1] &= fits[3, :, 1:]
        levels = np.logical_and.accumulate(is_allowed[1:], 0).sum(0)
        # Neighbours differ by at most one: the lower envelope of cones, axis by axis, is exact for this distance.
        for axis, n in ((0, rows), (1, cols)):
            i = np.arange(n).reshape((-1, 1) if axis == 0 else (1, -1))
            levels = np.minimum.accumulate(levels - i, axis) + i
            levels = np.flip(np.minimum.accumulate(np.flip(levels + i, axis), axis), axis) - i
        return levels.astype(np.int64)


def load_level_errors(heightfield: Heightfield, tile_cells: int) -> LevelErrors:
    """The errors of a height field, from the disk cache where they were built before."""
    key = f"{heightfield.sha256}-{tile_cells}-v{CACHE_VERSION}"
    arrays = load_arrays("painter", key)
    if arrays is not None and arrays.keys() == {"surface_m", "fan_m"}:
        return LevelErrors(**arrays)
    errors = build_level_errors(heightfield.heights_m, tile_cells)
    # Small grids are quicker to build than to keep, and exaggerated heights come and go with a slider.
    if heightfield.heights_m.size > BAND_POSTS and heightfield.exaggeration == 1.0:
        store_arrays("painter", key, {"surface_m": errors.surface_m, "fan_m": errors.fan_m})
    return errors


def build_level_errors(heights_m: Grid, tile_cells: int) -> LevelErrors:
    """Errors of a grid of posts (rows, cols) in tiles of ``tile_cells`` cells, a power of two and at least 2.

    A tile keeps 2 x 2 cells, so that it can be stitched: there are log2(tile_cells) levels.
    """
    rows, cols = (n - 1 for n in heights_m.shape)
    tile_rows, tile_cols = -(-rows // tile_cells), -(-cols // tile_cells)
    count = tile_cells.bit_length() - 1
    step = max(1, BAND_POSTS // (tile_cells * tile_cells * tile_cols))

    def band(first: int) -> tuple[Grid, Grid]:
        last = min(first + step, tile_rows)
        posts = heights_m[first * tile_cells : last * tile_cells + 1]
        missing = (last - first) * tile_cells + 1 - posts.shape[0], tile_cols * tile_cells + 1 - posts.shape[1]
        padded = np.pad(posts, ((0, missing[0]), (0, missing[1])), mode="edge")
        levels = range(count)
        surface = np.stack([_surface_error(padded, tile_cells, level) for level in levels])
        return surface, np.stack([_fan_errors(padded, tile_cells, level) for level in levels])

    with ThreadPoolExecutor() as pool:  # numpy releases the GIL
        bands = list(pool.map(band, range(0, tile_rows, step)))
    surface_m = np.concatenate([surface for surface, _ in bands], axis=1)
    for level in range(1, count):  # past the far edge there are no posts: cells must end there
        if rows % tile_cells % (1 << level):
            surface_m[level:, -1] = np.inf
        if cols % tile_cells % (1 << level):
            surface_m[level:, :, -1] = np.inf
    return LevelErrors(surface_m, np.concatenate([fans for _, fans in bands], axis=2))


def _surface_error(padded: Grid, tile_cells: int, level: int) -> Grid:
    """Largest distance between the surface on cells of 2^level posts and the full one, per tile."""
    size = 1 << level
    corner = padded[::size, ::size]
    nw, ne, sw, se = (c[..., None] for c in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    worst = np.zeros(nw.shape[:2], np.float32)
    if size == 1:
        return _tile_maximum(worst, tile_cells, tile_cells)
    u = np.arange(size + 1, dtype=np.float32) / np.float32(size)
    for i in range(size + 1):
        posts = sliding_window_view(padded[i : padded.shape[0] - size + i : size], size + 1, axis=1)[:, ::size]
        v = np.float32(i / size)
        # Posts up to the diagonal lie in the north-west triangle, the others in the south-east one.
        for start, slope, own in (
            (nw + (sw - nw) * v, ne - nw, slice(0, size + 1 - i)),
            (sw + (ne - se) * (1 - v), se - sw, slice(size + 1 - i, size + 1)),
        ):
            if own.start < own.stop:
                error = slope * u[own]
                error += start
                error -= posts[..., own]
                np.abs(error, out=error)
                np.maximum(worst, error.max(-1), out=worst)
    return _tile_maximum(worst, tile_cells >> level, tile_cells >> level)


def _fan_errors(padded: Grid, tile_cells: int, level: int) -> Grid:
    """Errors of the fans along the north, east, south and west edges: (4, tile rows, tile cols)."""
    # Turned and mirrored grids keep their diagonals: every edge is an east edge, both corners are north-west.
    east = [_east_fan_error(grid, tile_cells, level) for grid in _views(padded)]
    corner = [_corner_fan_error(grid, tile_cells, level) for grid in _views(padded)]
    north_west = np.maximum(corner[0], corner[1].T)
    south_east = np.maximum(corner[2][::-1, ::-1], corner[3].T[::-1, ::-1])
    return np.stack(
        [
            np.maximum(east[3].T[::-1, ::-1], north_west),
            np.maximum(east[0], south_east),
            np.maximum(east[1].T, south_east),
            np.maximum(east[2][::-1, ::-1], north_west),
        ]
    )


def _views(grid: Grid) -> tuple[Grid, Grid, Grid, Grid]:
    """The grid with its east, south, west and north edge in the east, and SW-NE diagonals in each."""
    return grid, grid.T, grid[::-1, ::-1], grid[::-1, ::-1].T


def _east_fan_error(padded: Grid, tile_cells: int, level: int) -> Grid:
    """Largest error of the fans along the east edge of every tile when every second post of that edge is gone.

    A fan covers the two cells beside such a post. It has its centre at the north end b0 of the edge::

        a0 --- b0      north of a1-b0 nothing changes; the edge b0-a2 is new. Rows of the full grid cross it
        |    / /|      halfway between two posts, its columns and diagonals in posts: there the error is largest.
        a1  / / |
        |  / /  |
        a2 --- b2
    """
    s = 1 << level
    posts = sliding_window_view(padded, (2 * s + 1, s + 1))[:: 2 * s, tile_cells - s :: tile_cells]
    b0, a1, a2, b2 = posts[..., 0, s], posts[..., s, 0], posts[..., 2 * s, 0], posts[..., 2 * s, s]
    y, x = np.mgrid[: 2 * s + 1, s:-1:-1].astype(np.float32) / np.float32(s)  # south and west of b0, in cells
    upper = np.stack([1 - x, 2 * x - y, y - x, 0 * x])
    lower = np.stack([1 - y / 2, 0 * x, x, y / 2 - x])
    weight = np.where(y <= 2 * x, upper, lower)
    surface = np.tensordot(np.stack([b0, a1, a2, b2], -1), weight, 1)
    worst = (np.abs(surface - posts) * (y >= x)).max((2, 3))
    k = np.arange(1, 2 * s, 2)
    crossing = (posts[..., k, s - k // 2] + posts[..., k, s - k // 2 - 1]) / 2
    edge = b0[..., None] + (a2 - b0)[..., None] * (k / np.float32(2 * s)).astype(np.float32)
    worst = np.maximum(worst, np.abs(edge - crossing).max(-1))
    return _tile_maximum(worst, tile_cells // (2 * s), 1)


def _corner_fan_error(padded: Grid, tile_cells: int, level: int) -> Grid:
    """Largest error of the northern triangle at the north-west corner of a tile stitched north and west.

    It joins the corner, the second post of the north edge and the first inner post. Its new edge, NW-SE, crosses the
    full grid's diagonals halfway between two posts.
    """
    s = 1 << level
    posts = sliding_window_view(padded, (s + 1, 2 * s + 1))[::tile_cells, ::tile_cells]
    corner, end, inner = posts[..., 0, 0], posts[..., 0, 2 * s], posts[..., s, s]
    y, x = np.mgrid[: s + 1, : 2 * s + 1].astype(np.float32) / np.float32(s)
    weight = np.stack([1 - (x + y) / 2, (x - y) / 2, y])
    surface = np.tensordot(np.stack([corner, end, inner], -1), weight, 1)
    worst = (np.abs(surface - posts) * ((y <= x) & (y <= 2 - x))).max((2, 3))
    k = np.arange(s)
    crossing = (posts[..., k, k + 1] + posts[..., k + 1, k]) / 2
    edge = corner[..., None] + (inner - corner)[..., None] * ((k + np.float32(0.5)) / np.float32(s)).astype(np.float32)
    return np.maximum(worst, np.abs(edge - crossing).max(-1))


def _tile_maximum(values: Grid, row_count: int, col_count: int) -> Grid:
    """Maxima over ``row_count`` x ``col_count`` values."""
    rows, cols = values.shape[0] // row_count, values.shape[1] // col_count
    return values.reshape(rows, row_count, cols, col_count).max((1, 3))
