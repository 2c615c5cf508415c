"""Seeded noise on square grids, and the resampling the embedded scenes share.

Every octave is a cubic B-spline over a lattice of random numbers that depends on its key alone, never on the size of
the grid: a finer grid samples the same function at more posts. Octaves too fine for a grid are left out, so that a
coarse grid does not alias them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Grid = npt.NDArray[np.float32]
Key = tuple[int, ...]

_SPLINE_STD = 151.0 / 315.0  # of a bicubic B-spline over independent unit normals, averaged over the cell


def fbm(key: Key, cells: int, octaves: int, size: int, gain: float = 0.5) -> Grid:
    """Fractional Brownian motion: octaves of noise, each at twice the frequency and ``gain`` times the amplitude.

    Parameters
    ----------
    key : tuple of int
        Seeds the random numbers; the same key gives the same function at every size.
    cells : int
        Lattice cells across the grid in the coarsest octave.
    octaves : int
        Octaves asked for; those with more lattice cells than grid cells are left out.
    size : int
        Posts along each side.

    Returns
    -------
    ndarray of float32, (size, size)
        Mean about 0, standard deviation about 1 with all octaves in place.
    """
    total = np.zeros((size, size), np.float32)
    norm = np.float32(sum(gain ** (2 * o) for o in range(octaves)) ** -0.5)
    for octave in range(octaves):
        if octave and cells << octave > size - 1:
            break
        total += np.float32(gain**octave) * norm * lattice_noise((*key, octave), cells << octave, size)
    return total


def lattice_noise(key: Key, cells: int, size: int) -> Grid:
    """One octave, (size, size) float32 of unit standard deviation: a cubic B-spline over a lattice of unit normals."""
    lattice = np.random.default_rng(key).standard_normal((cells + 3, cells + 3), dtype=np.float32)
    at = np.linspace(0.0, cells, size)
    first = np.minimum(at.astype(np.int64), cells - 1)
    f = at - first
    weights = np.stack([(1 - f) ** 3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3]) / 6.0
    return _separable(lattice, first, weights) / np.float32(_SPLINE_STD)


def resample(grid: Grid, size: int) -> Grid:
    """The same square at ``size`` posts a side: Catmull-Rom, exact where posts coincide, linear beyond the rim."""
    if size == grid.shape[0]:
        return grid.copy()
    at = np.linspace(0.0, grid.shape[0] - 1.0, size)
    first = np.minimum(at.astype(np.int64), grid.shape[0] - 2)
    f = at - first
    weights = np.stack([-(f**3) + 2 * f**2 - f, 3 * f**3 - 5 * f**2 + 2, -3 * f**3 + 4 * f**2 + f, f**3 - f**2]) / 2.0
    return _separable(np.pad(grid, 1, mode="reflect", reflect_type="odd"), first, weights)


def refine(grid: Grid) -> Grid:
    """The grid with a post between every two, ``(2 n - 1)²``: the midpoints of Catmull-Rom splines."""
    for _ in range(2):
        padded = np.pad(grid, ((1, 1), (0, 0)), mode="reflect", reflect_type="odd")
        finer = np.empty((2 * grid.shape[0] - 1, grid.shape[1]), np.float32)
        finer[::2] = grid
        finer[1::2] = (9.0 * (grid[:-1] + grid[1:]) - padded[:-3] - padded[3:]) / 16.0
        grid = finer.T
    return np.ascontiguousarray(grid)


def smoothstep(low: float, high: float, x: npt.NDArray[np.floating]) -> Grid:
    """0 below ``low``, 1 above ``high``, smooth between; ``low > high`` falls instead of rising."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), np.float32)


def _separable(grid: Grid, first: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]) -> Grid:
    """Four-tap interpolation along rows, then columns: ``sum_k weights[k] * grid[first + k]``."""
    taps = weights.astype(np.float32)
    for _ in range(2):
        rows = taps[0][:, None] * grid[first]
        for k in range(1, 4):
            rows += taps[k][:, None] * grid[first + k]
        grid = rows.T
    return np.ascontiguousarray(grid)
