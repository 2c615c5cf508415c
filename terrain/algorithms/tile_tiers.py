"""Tiles of one size: their bounds, and the ramps along which their levels follow the error allowed.

**Source**: Larsen and Christensen (see `terrain.algorithms.geomorph`), section 2.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrain.algorithms.tile_windows import Window, join_parts
from terrain.pyramid import BASE_LEVEL, Pyramid

Grid = npt.NDArray[np.float32]

RAMP_GAP = 1.05  # successive ramp ends differ by at least this factor: every ramp has a width


@dataclass(frozen=True, eq=False)
class Tier:
    """Static data of all tiles of one size, arrays (rows, cols).

    ``start`` and ``scale`` (levels, rows, cols) are the ramps: v = clip((tol - start) * scale, 0, 1). The smallest
    tiles have a ramp for each of their levels, joined ones a single ramp for their last. ``full`` is the tol at which a
    tile reaches its coarsest level, ``parts_full`` the tol at which all four parts of a joined tile have.
    """

    size_level: int
    minimum_m: Grid
    maximum_m: Grid
    start: Grid
    scale: Grid
    full: Grid
    parts_full: Grid


def build_tier(pyramid: Pyramid, size_level: int, shape: list[int], smaller: Tier | None) -> Tier:
    """Bounds and ramps of all tiles of 2^size_level cells, padded to ``shape`` by tiles that limit nothing."""
    stored = min(size_level, pyramid.top_level)
    minimum, maximum = pyramid.minimum(stored), pyramid.maximum(stored)
    missing = [(0, n - m) for n, m in zip(shape, minimum.shape, strict=True)]
    first = 0 if smaller is None else size_level - 1
    errors = [pyramid.error(stored, min(l, stored)) for l in range(first, size_level + 1)]
    errors = [np.pad(error, missing) for error in errors]
    floor = np.float32(1e-6) * np.float32(max(float(np.abs(maximum).max()), 1e-3))
    parts_full = np.zeros(shape, np.float32) if smaller is None else join_parts(smaller.full, np.maximum)
    below = errors[0] if smaller is None else np.maximum(errors[0], parts_full)
    start, scale = [], []
    for error in errors[1:]:
        end = np.maximum(error, np.maximum(below * np.float32(RAMP_GAP), floor))
        begin = np.maximum(below, end / 2)
        start.append(begin)
        scale.append(1 / (end - begin))
        below = end
    inside = np.pad(np.ones(minimum.shape, np.bool_), missing)
    return Tier(
        size_level,
        np.pad(minimum, missing),
        np.pad(maximum, missing),
        np.where(inside, np.stack(start), np.float32(-2)),
        np.where(inside, np.stack(scale), np.float32(1)),
        np.where(inside, below, np.float32(-1)),
        parts_full,
    )


def tile_edges(counts: list[int], sizes: list[int], cells: int) -> npt.NDArray[np.int64]:
    """First and last post (2, n) of tiles along one axis, one tier behind the other."""
    first = np.concatenate([np.arange(n) * size for n, size in zip(counts, sizes, strict=True)])
    return np.stack([first, np.minimum(first + np.repeat(sizes, counts), cells)])


def tolerance_m(
    tier: Tier, window: Window, gap_z: Grid, gap_x: Grid, eye_m: np.float32, tolerance: np.float32
) -> Grid:  # fmt: skip
    """The error [m] allowed at the nearest point of each tile; gaps: squared distances to its rows and columns."""
    tol = np.maximum(tier.minimum_m[window] - eye_m, eye_m - tier.maximum_m[window])
    np.maximum(tol, 0, out=tol)
    np.square(tol, out=tol)
    tol += gap_x
    tol += gap_z[:, None]
    np.sqrt(tol, out=tol)
    tol *= tolerance
    return tol


def sum_ramps(tier: Tier, window: Window, tol: Grid) -> Grid:
    """The sum of the clipped ramps of a tier."""
    total: Grid | None = None
    for start, scale in zip(tier.start, tier.scale, strict=True):
        v = tol - start[window]
        v *= scale[window]
        np.maximum(v, 0, out=v)
        np.minimum(v, 1, out=v)
        total = v if total is None else np.add(total, v, out=total)
    assert total is not None  # every tier has a ramp
    return total


assert BASE_LEVEL == 3  # the smallest tiles, 8 cells, are the finest nodes of the pyramid
