"""Bounds over a height map that let a ray skip what it cannot hit.

A surface is a base plane plus a scalar perturbation along its normal, ``F = G(v) + n h(G(v))`` (equation 6). The bars
of the viewing ray are projected onto the base plane and subdivided until the height there decides which half to follow;
the multilevel height map answers, for a square of 2^l x 2^l cells, how high the perturbation can be.

Map coordinates are ``(u, v, h)``: u in columns, v in rows, h in metres along the base plane's normal
(`terrain.planes.BasePlane`).

**Source**: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering", sections 2 and 3.

**Deviations**

* The paper's level n-1 holds the maximum of four *posts*, which does not bound the surface between them: a node here
  covers *cells*, posts on its rim included.
* Beside the maximum a node keeps the minimum: it bounds rays from below, and together they say how much a node hides.
* ``sloped=True`` bounds the surface by two parallel *planes* through the node instead of two constants, "coefficients
  of the plane equation" in the paper's words. On smooth ground their distance falls with the square of the node's size,
  the paper's with the size itself: fewer steps, and a level of detail that stops earlier at the same error.
  ``sloped=False`` is the paper's form; everything else is the same.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from terrain.frame import Frame

Floats = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Interpolation = Literal["triangles", "bilinear", "bicubic"]

_EXACT_LEVEL = 3  # bounds above this level come from the planes of this level: 4 % looser, no full-resolution pass each
_NO_BOUND = np.float32(-1e30)
_TOP_NODES = 8  # the coarsest level has at most this many nodes along a side
_ROUNDING = 4e-7  # float32 arithmetic on the GPU may be wrong by this share of the numbers it adds


@dataclass(frozen=True, eq=False)
class Bounds:
    """Two planes per node, between which the surface lies.

    Attributes
    ----------
    levels : tuple of ndarray of float32, (rows, cols, 4)
        Level 1 first (nodes of 2 x 2 cells), every next one of twice the size. Per node ``(a, b, upper, lower)``: at
        ``(du, dv)`` posts from the node's north-west post the surface lies between ``lower + a du + b dv`` and
        ``upper + a du + b dv`` metres.
    widened : tuple of ndarray of float32, (rows, cols, 4)
        The same slopes with bounds that hold half a node further out on every side: for bundles of rays. Level 2 first.
    cells : tuple of int
        ``(rows, cols)`` of cells.
    range_m : tuple of float
        The whole surface lies strictly between these two heights.
    """

    levels: tuple[Single, ...]
    widened: tuple[Single, ...]
    cells: tuple[int, int]
    range_m: tuple[float, float]


def build_bounds(
    heights: Single, interpolation: Interpolation = "triangles", *, sloped: bool = True,
    holes: npt.NDArray[np.bool_] | None = None,
) -> Bounds:  # fmt: skip
    """Bound the surface over every node of the quadtree.

    Parameters
    ----------
    heights : ndarray of float32, (rows, cols)
    interpolation : {"triangles", "bilinear", "bicubic"}
        Bicubic surfaces overshoot their posts; the bounds allow for it.
    sloped : bool
        Planes through the node; False for constant bounds, the paper's maximum pyramid.
    holes : ndarray of bool, (rows, cols), or None
        Posts without data. Nodes on their rim get no lower bound, so that no level of detail moves the rim.
    """
    rows, cols = heights.shape[0] - 1, heights.shape[1] - 1
    top = max(1, int(np.ceil(np.log2(max(rows, cols) / _TOP_NODES))))
    over, under = _overshoot(heights) if interpolation == "bicubic" else (None, None)
    slopes = _slopes(heights, top) if sloped else None
    levels: list[Single] = []
    if holes is not None:
        corners = (holes[:-1, :-1], holes[:-1, 1:], holes[1:, :-1], holes[1:, 1:])
        rim = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    for level in range(1, top + 1):
        shape = (-(-rows >> level), -(-cols >> level))
        a, b = slopes[level - 1] if slopes is not None else (np.zeros(shape, np.float32),) * 2
        if level <= _EXACT_LEVEL:
            upper, lower = _bound_posts(heights, a, b, 1 << level)
            if over is not None and under is not None:
                upper += _block_max(over, 1 << level)
                lower -= _block_max(under, 1 << level)
        else:
            upper, lower = _bound_nodes(levels[_EXACT_LEVEL - 1], a, b, level - _EXACT_LEVEL)
        largest = np.maximum(np.abs(upper), np.where(lower > _NO_BOUND, np.abs(lower), np.float32(0)))
        pad = _ROUNDING * (largest + (np.abs(a) + np.abs(b)) * (1 << level))
        upper, lower = upper + pad, lower - pad
        if holes is not None:
            lower[_block_max(rim, 1 << level)] = _NO_BOUND
        nodes = np.empty((*shape, 4), np.float32)
        nodes[..., 0], nodes[..., 1], nodes[..., 2], nodes[..., 3] = a, b, upper, np.maximum(lower, _NO_BOUND)
        levels.append(nodes)
    widened = [
        _widen(fine, coarse, 1 << level) for level, (fine, coarse) in enumerate(itertools.pairwise(levels), start=1)
    ]
    low, high = float(heights.min()), float(heights.max())
    if over is not None and under is not None:
        low, high = low - float(under.max()), high + float(over.max())
    margin = 1e-6 * max(abs(low), abs(high), 1e-3)
    return Bounds(tuple(levels), tuple(widened), (rows, cols), (low - margin, high + margin))


def select_nodes(
    bounds: Bounds, spacing_m: tuple[float, float], frame: Frame, tolerance_px: float
) -> tuple[Floats, Floats, npt.NDArray[np.int64]]:
    """Boxes of the nodes in view whose planes are thin enough for ``tolerance_px``, none smaller than 8 x 8 cells.

    Parameters
    ----------
    bounds : Bounds
        Of a terrain that lies level at the origin.
    spacing_m : tuple of float
        ``(dx, dz)``.
    frame : Frame
    tolerance_px : float

    Returns
    -------
    lower_m, upper_m : ndarray of float64, (n, 3)
    level : ndarray of int64, (n,)
    """
    top = len(bounds.levels)
    row, col = (a.ravel() for a in np.indices(bounds.levels[-1].shape[:2]))
    found: list[tuple[Floats, Floats, npt.NDArray[np.int64]]] = []
    for level in range(top, min(top, _EXACT_LEVEL) - 1, -1):
        shape = bounds.levels[level - 1].shape
        in_grid = (row < shape[0]) & (col < shape[1])
        row, col = row[in_grid], col[in_grid]
        node, size = bounds.levels[level - 1][row, col].astype(np.float64), 1 << level
        slope = node[:, :2] * size
        west_north = np.stack([col, row], axis=1) * size
        east_south = np.minimum(west_north + size, bounds.cells[::-1])
        lower = np.insert(west_north * np.array(spacing_m), 1, node[:, 3] + np.minimum(slope, 0).sum(axis=1), axis=1)
        upper = np.insert(east_south * np.array(spacing_m), 1, node[:, 2] + np.maximum(slope, 0).sum(axis=1), axis=1)
        low, high = lower - frame.eye_m, upper - frame.eye_m
        seen = np.all([(np.where(p > 0, high, low) @ p) >= 0 for p in frame.side_planes], axis=0)
        distance = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=1)
        thin = 0.5 * (node[:, 2] - node[:, 3]) * frame.pixels_per_radian <= tolerance_px * distance
        stop = seen & (thin | (level == min(top, _EXACT_LEVEL)))
        found.append((lower[stop], upper[stop], np.full(np.count_nonzero(stop), level, np.int64)))
        row, col = row[seen & ~stop], col[seen & ~stop]
        row = (2 * row[:, None] + [0, 0, 1, 1]).ravel()
        col = (2 * col[:, None] + [0, 1, 0, 1]).ravel()
    lower, upper, levels = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return lower, upper, levels


def _overshoot(heights: Single) -> tuple[Single, Single]:
    """How far the bicubic surface of every cell may rise above and fall below the bilinear one [m].

    The patch's Bezier control points less the bilinear surface at the same place; a patch lies in their convex hull.
    """
    padded = np.pad(heights, 1, mode="edge")
    along_v = _bezier(padded[:-3], padded[1:-2], padded[2:-1], padded[3:])
    over: Single = np.zeros((heights.shape[0] - 1, heights.shape[1] - 1), np.float32)
    under: Single = np.zeros_like(over)
    nw, ne, sw, se = heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]
    for i, row in enumerate(along_v):
        west, east = nw + (sw - nw) * np.float32(i / 3), ne + (se - ne) * np.float32(i / 3)
        for j, control in enumerate(_bezier(row[:, :-3], row[:, 1:-2], row[:, 2:-1], row[:, 3:])):
            rise = control - (west + (east - west) * np.float32(j / 3))
            np.maximum(over, rise, out=over)
            np.maximum(under, -rise, out=under)
    return over, under


def _bezier(before: Single, first: Single, last: Single, after: Single) -> tuple[Single, ...]:
    """Control points of the Catmull-Rom segment from ``first`` to ``last``."""
    sixth = np.float32(1 / 6)
    return first, first + (last - before) * sixth, last - (after - first) * sixth, last


def _slopes(heights: Single, top: int) -> list[tuple[Single, Single]]:
    """Least-squares slopes [m per post] of the cells' mean heights over every node, per level from 1."""
    mean: Floats = (heights[:-1, :-1] + heights[1:, :-1]) + (heights[:-1, 1:] + heights[1:, 1:])
    mean *= np.float32(0.25)
    along_u: Floats | None = None
    along_v: Floats | None = None
    result = []
    for level in range(1, top + 1):
        mean = _even(mean)
        half = 0.25 * (1 << level)  # from the parent's centre to a child's
        west, east = _pairs(mean, 1)
        north, south = _pairs(mean, 0)
        across, down = (
            half * _sum2(east - west, 0).astype(np.float64),
            half * _sum2(south - north, 1).astype(np.float64),
        )
        along_u = across if along_u is None else across + _sum4(_even(along_u))
        along_v = down if along_v is None else down + _sum4(_even(along_v))
        mean = _sum4(mean).astype(np.float64)
        n = float(1 << level)
        spread = n * n * (n * n - 1.0) / 12.0  # sum of squared offsets over the node's n x n cells
        result.append(((along_u / spread).astype(np.float32), (along_v / spread).astype(np.float32)))
    return result


def _even(a: Floats) -> Floats:
    """Repeat the last row and column where their number is odd."""
    return np.pad(a, ((0, a.shape[0] % 2), (0, a.shape[1] % 2)), mode="edge") if any(n % 2 for n in a.shape) else a


def _pairs(a: Floats, axis: int) -> tuple[Floats, Floats]:
    return (a[:, ::2], a[:, 1::2]) if axis == 1 else (a[::2], a[1::2])


def _sum2(a: Floats, axis: int) -> Floats:
    return np.add(*_pairs(a, axis))


def _sum4(a: Floats) -> Floats:
    return _sum2(_sum2(a, 0), 1)


def _bound_posts(heights: Single, a: Single, b: Single, size: int) -> tuple[Single, Single]:
    """Largest and smallest distance of the posts of every node, its rim included, from the plane with its slopes."""
    rows, cols = a.shape
    padded = np.full((rows * size + 1, cols * size + 1), np.nan, np.float32)
    padded[: heights.shape[0], : heights.shape[1]] = heights
    upper, lower = np.full(a.shape, -np.inf, np.float32), np.full(a.shape, np.inf, np.float32)
    for i in range(size + 1):
        for j in range(size + 1):
            distance = padded[i : i + (rows - 1) * size + 1 : size, j : j + (cols - 1) * size + 1 : size] - (
                a * j + b * i
            )
            np.fmax(upper, distance, out=upper)
            np.fmin(lower, distance, out=lower)
    return upper, lower


def _bound_nodes(fine: Single, a: Single, b: Single, depth: int) -> tuple[Single, Single]:
    """Bounds of nodes ``depth`` levels above ``fine``, from the corners of the fine nodes' planes."""
    count, size = 1 << depth, 1 << _EXACT_LEVEL
    row, col = np.arange(fine.shape[0]), np.arange(fine.shape[1])
    parent = np.ix_(row >> depth, col >> depth)
    here_a, here_b = a[parent], b[parent]
    dv, du = ((row & (count - 1)) * size)[:, None], ((col & (count - 1)) * size)[None, :]
    upper, lower = (fine[..., k] - (here_a * du + here_b * dv) for k in (2, 3))
    # The planes differ by a linear function over the fine node: its extremes are at the corners.
    da, db = (fine[..., 0] - here_a) * size, (fine[..., 1] - here_b) * size
    upper = upper + np.maximum(da, 0) + np.maximum(db, 0)
    lower = lower + np.minimum(da, 0) + np.minimum(db, 0)
    return _block_max(upper, count), -_block_max(-lower, count)


def _block_max(a: Single, size: int) -> Single:
    """Maximum over blocks of ``size`` x ``size``; the last ones may be partial."""
    starts = [np.arange(0, n, size) for n in a.shape]
    return np.maximum.reduceat(np.maximum.reduceat(a, starts[0], axis=0), starts[1], axis=1)


def _widen(fine: Single, coarse: Single, fine_size: int) -> Single:
    """Coarse nodes with bounds over the 4 x 4 fine nodes around their centre instead of 2 x 2."""
    rows, cols = coarse.shape[:2]
    padded = np.full((2 * rows + 2, 2 * cols + 2, 4), np.nan, np.float32)
    padded[1 : fine.shape[0] + 1, 1 : fine.shape[1] + 1] = fine
    result = coarse.copy()
    for i in range(4):
        for j in range(4):
            near = padded[i : i + 2 * rows : 2, j : j + 2 * cols : 2]
            da, db = near[..., 0] - coarse[..., 0], near[..., 1] - coarse[..., 1]
            offset = coarse[..., 0] * np.float32((j - 1) * fine_size) + coarse[..., 1] * np.float32((i - 1) * fine_size)
            rise = np.maximum(da * fine_size, 0) + np.maximum(db * fine_size, 0)
            fall = np.minimum(da * fine_size, 0) + np.minimum(db * fine_size, 0)
            result[..., 2] = np.fmax(result[..., 2], near[..., 2] - offset + rise)
            result[..., 3] = np.fmin(result[..., 3], near[..., 3] - offset + fall)
    return result
