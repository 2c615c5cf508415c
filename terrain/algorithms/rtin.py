"""Right-triangulated irregular networks: how much every vertex of the alternating surface matters.

The alternating diagonals make the grid a binary tree of right triangles. A triangle is split by joining the midpoint of
its hypotenuse to its apex, so every post but the corners of the coarsest cells is the *midpoint* of exactly two
triangles (one at the terrain's edge). This module finds, for every post, the largest error of those two triangles if
they were not split, and from it the first rung of a ladder of errors at which the post may be left out.

Cells of ``size`` posts hold triangles of two kinds: *diagonal* ones, two in a cell, whose midpoint is the cell's
centre, and *fan* ones, four in a cell, whose midpoints are the centres of the cell's sides. Splitting the first gives
the second of the same size, splitting the second gives the first of half that size.

**Source** W. Evans, D. Kirkpatrick, G. Townsend, "Right-triangulated irregular networks", Algorithmica 30 (2001); the
per-vertex errors that make any cut free of T-vertices: P. Lindstrom, V. Pascucci, "Visualization of large terrains made
easy", Visualization 2001.

**Deviations** The error of a triangle is the exact maximum over every post it covers, not the deviation at its
midpoint: the midpoint alone delivers 1.5 to 1.6 times the error asked for. (The vertical distance of two nested
surfaces is largest at posts.)
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from terrain.progress import tell

Grid = npt.NDArray[np.float32]
Rungs = npt.NDArray[np.uint8]

STEPS_PER_OCTAVE = 8
"""Rungs to a doubling of the error: each allows 9 % more than the one before."""


@dataclass(frozen=True)
class Ladder:
    """The errors at which meshes are made: rung 0 is exact, rung r allows ``base_m`` * 2^((r - 1) / STEPS_PER_OCTAVE).

    Attributes
    ----------
    exact_m : float
        Error of rung 0: what float32 cannot tell apart in the relief.
    base_m : float
        Error of rung 1.
    """

    exact_m: float
    base_m: float

    def error_m(self, rung: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """The error each rung allows."""
        rung = np.asarray(rung, np.float64)
        return np.where(rung < 1, self.exact_m, self.base_m * np.exp2((rung - 1) / STEPS_PER_OCTAVE))

    def coarsest_within(self, error_m: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """The highest rung that allows no more than ``error_m``; rung 0 where none does."""
        ratio = np.maximum(np.asarray(error_m, np.float64) / self.base_m, 2.0**-8)
        # A hair of slack puts an error that *is* a rung's on that rung despite the logarithm's rounding.
        rung = np.floor(np.log2(ratio) * STEPS_PER_OCTAVE + 1e-9) + 1
        return np.clip(rung, 0, 254).astype(np.uint8)

    def first_without(self, error_m: Grid) -> Rungs:
        """The lowest rung whose allowed error is not below ``error_m``: there the vertex may be left out."""
        with np.errstate(divide="ignore"):
            rung = np.ceil(np.log2(error_m / np.float32(self.base_m)) * STEPS_PER_OCTAVE - 1e-6) + 1
        return np.where(error_m <= self.exact_m, 0, np.clip(rung, 1, 254)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Rtin:
    """The rung of every vertex of the hierarchy.

    Attributes
    ----------
    drop_rung : ndarray of uint8, (rows, cols) padded
        First rung whose mesh can do without the post. Never below that of a post that depends on it; 255 at the
        corners of the coarsest cells, which every mesh has. Padded past the far edges to whole coarsest cells; posts
        out there repeat the edge's heights and count for nothing.
    ladder : Ladder
    top_level : int
        The coarsest cells measure 2^top_level posts.
    """

    drop_rung: Rungs
    ladder: Ladder
    top_level: int


def padded_shape(rows: int, cols: int, top_level: int) -> tuple[int, int]:
    """Posts of the smallest grid of whole coarsest cells that holds ``rows`` x ``cols`` posts."""
    size = 1 << top_level
    return -(-(rows - 1) // size) * size + 1, -(-(cols - 1) // size) * size + 1


def build_rtin(heights_m: Grid, spacing_m: tuple[float, float], top_level: int) -> Rtin:
    """The rungs of a grid of posts.

    Parameters
    ----------
    heights_m : ndarray of float32, (rows, cols)
        Any size from 2 x 2.
    spacing_m : tuple of float
    top_level : int
        log2 of the coarsest cell's size in posts, 1 to 7.
    """
    rows, cols = heights_m.shape
    size = 1 << top_level
    padded_rows, padded_cols = padded_shape(rows, cols, top_level)
    # Heights are compared with each other only, so that it is the relief that says what float32 can tell apart.
    relief_m = max(float(heights_m.max()) - float(heights_m.min()), float(np.finfo(np.float32).tiny))
    ladder = Ladder(exact_m=relief_m * 2.0**-21, base_m=max(float(min(spacing_m)) / 256.0, relief_m * 2.0**-20))
    drop_rung = np.zeros((padded_rows, padded_cols), np.uint8)
    drop_rung[::size, ::size] = 255

    def band(first: int) -> list[list[Rungs]]:
        """Rungs of one row of coarsest cells, for every cell size."""
        last = min(first + size + 1, rows)
        pad = ((0, first + size + 1 - last), (0, padded_cols - cols))
        posts = np.pad(heights_m[first:last], pad, mode="edge")
        inside = None
        if any(width for pair in pad for width in pair):  # past the edges nothing is drawn
            inside = np.pad(np.ones((last - first, cols), np.float32), pad)
        return [_cell_rungs(posts, inside, 1 << level, first >> level, ladder) for level in range(1, top_level + 1)]

    starts = range(0, padded_rows - 1, size)
    with ThreadPoolExecutor() as pool:  # numpy releases the GIL inside the bands
        for number, (first, levels) in enumerate(zip(starts, pool.map(band, starts), strict=True)):
            tell("building the approximation tree", number / len(starts))
            strip = drop_rung[first : first + size + 1]
            for level, (centre, north, south, west, east) in enumerate(levels, 1):
                step, half = 1 << level, 1 << (level - 1)
                strip[half::step, half::step] = centre
                for target, rungs in (
                    (strip[:-1:step, half::step], north), (strip[step::step, half::step], south),
                    (strip[half::step, :-1:step], west), (strip[half::step, step::step], east),
                ):  # fmt: skip
                    np.maximum(target, rungs, out=target)
    _saturate(drop_rung, top_level)
    return Rtin(drop_rung, ladder, top_level)


def _saturate(drop_rung: Rungs, top_level: int) -> None:
    """Raise every vertex to those that can only be there together with it, fine to coarse."""
    for level in range(1, top_level + 1):
        step, half, quarter = 1 << level, 1 << (level - 1), 1 << (level - 1) >> 1
        centres = drop_rung[half::step, half::step]
        across, down = drop_rung[::step, half::step], drop_rung[half::step, ::step]
        if quarter:  # the sides' midpoints depend on the centres of the quarter cells around them
            fine = drop_rung[quarter::half, quarter::half]
            rows = np.maximum(fine[:, ::2], fine[:, 1::2])
            np.maximum(across[:-1], rows[::2], out=across[:-1])
            np.maximum(across[1:], rows[1::2], out=across[1:])
            cols = np.maximum(fine[::2], fine[1::2])
            np.maximum(down[:, :-1], cols[:, ::2], out=down[:, :-1])
            np.maximum(down[:, 1:], cols[:, 1::2], out=down[:, 1:])
        for side in (across[:-1], across[1:], down[:, :-1], down[:, 1:]):
            np.maximum(centres, side, out=centres)


@lru_cache(maxsize=32)
def _fan_layout(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Posts of the closed north, south, west and east triangles of a cell, one after another, and their starts."""
    row, col = (g.ravel() for g in np.indices((size + 1, size + 1)))
    triangles = (
        (row <= col) & (row + col <= size), (row >= col) & (row + col >= size),
        (col <= row) & (row + col <= size), (col >= row) & (row + col >= size),
    )  # fmt: skip
    posts = [np.flatnonzero(t) for t in triangles]
    starts = np.cumsum([0, *(len(p) for p in posts[:-1])])
    return np.concatenate(posts), starts


@lru_cache(maxsize=32)
def _corner_weights(size: int) -> tuple[Grid, Grid, Grid]:
    """Weights of (nw, ne, sw, se) at every post of a cell cut NW-SE and SW-NE, and of those and the centre in a fan."""
    v, u = (g.ravel() / size for g in np.indices((size + 1, size + 1)))
    low, high = np.minimum(u, v), np.maximum(u, v)
    nw_se = np.stack([1 - high, np.maximum(u - v, 0), np.maximum(v - u, 0), low])
    w = 1 - u  # mirrored east-west, SW-NE is NW-SE
    low, high = np.minimum(w, v), np.maximum(w, v)
    sw_ne = np.stack([np.maximum(w - v, 0), 1 - high, low, np.maximum(v - w, 0)])
    centre = 2 * np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    fan = np.stack([
        np.maximum(1 - u - v, 0), np.maximum(u - v, 0), np.maximum(v - u, 0), np.maximum(u + v - 1, 0), centre
    ])  # fmt: skip
    return nw_se.astype(np.float32), sw_ne.astype(np.float32), fan.astype(np.float32)


def _cell_rungs(posts: Grid, inside: Grid | None, size: int, first_row: int, ladder: Ladder) -> list[Rungs]:
    """Rungs of the centres and the north, south, west and east midpoints of all cells of ``size`` posts in a band."""
    n_rows, n_cols = (posts.shape[0] - 1) // size, (posts.shape[1] - 1) // size
    count = n_rows * n_cols
    nw_se, sw_ne, fan = _corner_weights(size)
    fan_posts, fan_starts = _fan_layout(size)

    def cells(grid: Grid) -> Grid:
        """(cell, post of the cell), each cell with all its borders."""
        windows = np.lib.stride_tricks.sliding_window_view(grid, (size + 1, size + 1))[::size, ::size]
        return windows.reshape(count, (size + 1) ** 2)

    height, counts = cells(posts), None if inside is None else cells(inside)
    height = height - height[:, :1]  # relative to a corner: small numbers keep their digits
    knots = [0, size, size * (size + 1), size * (size + 2), (size // 2) * (size + 2)]
    corners = np.ascontiguousarray(height[:, knots])

    distance = corners @ fan
    distance -= height
    np.abs(distance, out=distance)
    if counts is not None:
        distance *= counts
    sides = np.maximum.reduceat(distance[:, fan_posts], fan_starts, axis=1)

    odd = (np.add.outer(np.arange(n_rows) + first_row, np.arange(n_cols)) % 2 == 1).ravel()
    np.matmul(corners[:, :4], nw_se, out=distance)
    distance[odd] = corners[odd, :4] @ sw_ne
    distance -= height
    np.abs(distance, out=distance)
    if counts is not None:
        distance *= counts
    rungs = ladder.first_without(np.concatenate([distance.max(axis=1)[:, None], sides], axis=1))
    return list(rungs.reshape(n_rows, n_cols, 5).transpose(2, 0, 1))
