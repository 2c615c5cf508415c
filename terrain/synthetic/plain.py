"""``plain``: 4096 m of low, smooth ground with fields, into which a meandering river has cut its valley.

**Source** The river's course: Howard and Knutson, *Sufficient conditions for river meandering: a simulation approach*
(Water Resources Research 20, 1984). Each point of the centre line moves sideways with the curvature upstream of it,
weighted by distance; where two bends meet, the loop between them is cut off and stays behind as an oxbow.

**Deviations** The floor of the valley keeps the ridges that the moving river leaves behind: waves of the time at which
it was last there.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage, spatial

from terrain.synthetic.buildings import chance
from terrain.synthetic.noise import Grid, fbm, resample, smoothstep

EXTENT_M = 4096.0
_BASE_POSTS = 1025
_SPACING_M = EXTENT_M / (_BASE_POSTS - 1)
_HALF_WIDTH_M = 22.0
_POINT_M = 24.0  # between points of the centre line
_STEPS = 500
_MEMORY_M = 190.0  # how far downstream a bend is felt

Points = npt.NDArray[np.float64]


class _Valley(NamedTuple):
    """What the river left on the base grid."""

    age: Grid  # step at which the river was last there, -1 for never
    oxbow: Grid  # 1 in abandoned loops, 0 elsewhere
    distance_m: Grid  # from the centre line of today


def plain_heights(size: int, seed: int) -> Grid:
    """Heights (size, size) in metres; a finer grid adds fine relief and moves nothing else."""
    fine = 0.10 * fbm((seed, 30), 96, 5, size, 0.6)
    return resample(_base(seed), size) + fine.astype(np.float32)


@lru_cache(maxsize=2)
def _base(seed: int) -> Grid:
    """The plain at 4 m posts."""
    size = _BASE_POSTS
    valley = _valley(seed)
    inside = ndimage.distance_transform_edt(valley.age < 0.0).astype(np.float32) * np.float32(_SPACING_M)
    wander = 14.0 * fbm((seed, 31), 40, 3, size)
    scarp = smoothstep(
        4.0, 46.0, inside + wander * np.minimum(inside / 24.0, 1.0)
    )  # 0 on the valley floor, 1 on the plain
    apron = ndimage.gaussian_filter(smoothstep(0.0, 700.0, inside), 16.0)
    x = np.linspace(0.0, 1.0, size, dtype=np.float32)[None, :]
    upland = 6.5 * scarp + 9.0 * apron + (4.0 * apron + 0.5) * fbm((seed, 32), 3, 5, size, 0.45) + _fields(seed) * scarp
    ridges = 0.35 * np.sin(valley.age * (2.0 * np.pi / 25.0)) * (valley.age >= 0.0)
    floor = ndimage.gaussian_filter(ridges, 1.2) - 2.4 * valley.oxbow
    heights = 60.0 - 3.0 * x + upland + floor * (1.0 - scarp)
    bank = smoothstep(_HALF_WIDTH_M + 9.0, _HALF_WIDTH_M - 5.0, valley.distance_m)
    bed = 60.0 - 3.0 * x - 3.4 - 1.2 * smoothstep(_HALF_WIDTH_M, 0.0, valley.distance_m)
    levee = 0.7 * np.exp(-np.square((valley.distance_m - _HALF_WIDTH_M - 16.0) / 14.0))
    return np.ascontiguousarray((heights + levee * (1.0 - scarp)) * (1.0 - bank) + bed * bank, np.float32)


def _fields(seed: int) -> Grid:
    """Fields, each a little higher or lower than its neighbours, with ditches between; metres."""
    size = _BASE_POSTS
    at = np.linspace(0.0, EXTENT_M, size)
    x, z = np.meshgrid(at, at)
    x = x + 30.0 * fbm((seed, 33), 6, 2, size)
    z = z + 30.0 * fbm((seed, 34), 6, 2, size)
    u, v = 0.94 * x + 0.34 * z, -0.34 * x + 0.94 * z
    j = np.floor(v / 190.0).astype(np.int64)
    wide = 120.0 + 180.0 * chance(seed + 35, j)
    u = u + 400.0 * chance(seed + 36, j)
    i = np.floor(u / wide).astype(np.int64)
    to_side = np.minimum(np.minimum(u - i * wide, (i + 1) * wide - u), np.minimum(v - j * 190.0, (j + 1) * 190.0 - v))
    level = 0.5 * (chance(seed + 37, i, j) - 0.5)
    furrows = 0.04 * np.sin(np.where(chance(seed + 38, i, j) < 0.5, u, v) * (2.0 * np.pi / 17.0))
    soft = smoothstep(0.0, 14.0, to_side)
    ditch = np.where(chance(seed + 39, i, j) < 0.45, 0.6, 0.15) * (1.0 - smoothstep(1.0, 6.0, to_side))
    return np.asarray((level + furrows) * soft - ditch, np.float32)


def _valley(seed: int) -> _Valley:
    """Let the river wander and note where it has been."""
    rng = np.random.default_rng((seed, 40))
    x = np.arange(-1800.0, EXTENT_M + 700.0, _POINT_M)
    bends = np.zeros_like(x)
    for _ in range(5):
        bends += rng.uniform(10.0, 45.0) * np.sin(x / rng.uniform(80.0, 300.0) + rng.uniform(0.0, 6.3))
    line = np.column_stack([x, EXTENT_M * rng.uniform(0.45, 0.6) + bends])
    age = np.full((_BASE_POSTS, _BASE_POSTS), -1.0, np.float32)
    loops = np.zeros_like(age)
    for step in range(_STEPS):
        line, cut = _wandered(line)
        for loop in cut:
            loops[_cells(loop)] = 1.0
        passed = _cells(line)
        age[passed], loops[passed] = step, 0.0
    # The river is wider than its line: posts beside it take the step of the nearest post it touched.
    beside, nearest = ndimage.distance_transform_edt(age < 0.0, return_indices=True)
    age = np.where(beside * _SPACING_M < 1.3 * _HALF_WIDTH_M, age[tuple(nearest)], np.float32(-1.0))
    width_cells = 0.6 * _HALF_WIDTH_M / _SPACING_M
    oxbow = np.minimum(ndimage.gaussian_filter(loops, width_cells) * width_cells * 2.5, 1.0)
    return _Valley(age, oxbow, _distances_m(line, 140.0))


def _wandered(line: Points) -> tuple[Points, list[Points]]:
    """The centre line one step later, at even distances, and the loops that were cut off."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    bend = np.gradient(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))) * (_HALF_WIDTH_M * 2.0 / _POINT_M)
    reach = np.exp(-np.arange(0.0, 5.0 * _MEMORY_M, _POINT_M) / _MEMORY_M)
    felt = np.convolve(bend, reach / reach.sum())[: bend.size]
    rate = np.clip(2.5 * felt - bend, -0.6, 0.6)
    ends = np.minimum(np.arange(rate.size), np.arange(rate.size)[::-1]) / 20.0
    rate *= np.minimum(ends, 1.0)  # the ends outside the scene stay where they are
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    line = line + 18.0 * rate[:, None] * normal
    line, cut = _without_loops(line)
    line = _dense(line, _POINT_M)
    line[1:-1] = 0.03 * (line[:-2] + line[2:]) + 0.94 * line[1:-1]
    return line, cut


def _without_loops(line: Points) -> tuple[Points, list[Points]]:
    """Cut the loops whose necks are narrower than the river."""
    cut: list[Points] = []
    pairs = spatial.cKDTree(line).query_pairs(_HALF_WIDTH_M * 2.2, output_type="ndarray")
    necks = pairs[pairs[:, 1] - pairs[:, 0] > 8]
    if not necks.size:
        return line, cut
    keep, end = np.ones(len(line), np.bool_), -1
    for first, last in necks[np.lexsort((-necks[:, 1], necks[:, 0]))]:
        if first > end:
            keep[first + 1 : last] = False
            cut.append(line[first : last + 1])
            end = last
    return line[keep], cut


def _dense(line: Points, step_m: float) -> Points:
    """Points of a line at even distances."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    at = np.linspace(0.0, along[-1], max(int(along[-1] / step_m), 2))
    return np.column_stack([np.interp(at, along, line[:, axis]) for axis in (0, 1)])


def _cells(line: Points) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows and columns of the posts a line touches."""
    col, row = np.rint(_dense(line, 0.7 * _SPACING_M) / _SPACING_M).astype(np.int64).T
    inside = (col >= 0) & (col < _BASE_POSTS) & (row >= 0) & (row < _BASE_POSTS)
    return row[inside], col[inside]


def _distances_m(line: Points, reach_m: float) -> Grid:
    """Distance of each post from a line, ``reach_m`` at most."""
    touched = np.ones((_BASE_POSTS, _BASE_POSTS), np.bool_)
    touched[_cells(line)] = False
    row, col = np.nonzero(ndimage.distance_transform_edt(touched) * _SPACING_M < reach_m)
    exact, _ = spatial.cKDTree(_dense(line, 2.0)).query(np.column_stack([col, row]) * _SPACING_M)
    distance = np.full(touched.shape, reach_m, np.float32)
    distance[row, col] = np.minimum(exact, reach_m)
    return distance
