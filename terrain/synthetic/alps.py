"""``alps``: ridged mountains with eroded valleys, 30.72 km across.

**Source** The landscape in balance between uplift and stream-power erosion: each post lies above the one it drains to
by distance times slope, ``slope = k U / area^m`` along rivers (Braun and Willett, 2013), limited by the slope at which
rock slides. Solved from coarse to fine, so that large valleys are there before small ones.

**Deviations** Glaciers are wide rivers: drainage area is spread sideways, wider where it is larger, which gives troughs
with flat floors and steep walls. Where a noise says so, floors are level: lakes. Below the finest eroded grid each
doubling roughens steep ground and cuts gullies along the steepest way down.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from terrain.synthetic.erosion import (
    ShiftedGrid,
    downstream_sum,
    drain_pits,
    steepest_receivers,
    upstream_sum,
)
from terrain.synthetic.noise import Grid, fbm, lattice_noise, refine, resample, smoothstep

EXTENT_M = 30720.0
_ERODED_EXTENT_M = 1.44 * EXTENT_M  # room to turn the scene in, and a rim to cut off
_TURN_RAD = math.radians(27.0)
_COARSEST_POSTS = 81
_ROUNDS = (48, 22, 7, 1)  # of erosion on grids of 81, 161, 321 and 641 posts
_BASE_POSTS = 513  # of what is cut out
_FLOOR_M, _SUMMIT_M = 600.0, 3980.0
_AREA_POWER = 0.45
_CHANNEL_AREA_M2 = 0.3e6  # where a slope becomes a stream
_TROUGHS = ((1.5e6, 70.0), (8e6, 130.0), (40e6, 230.0), (150e6, 330.0))  # drainage area [m²], half width [m]


def alps_heights(size: int, seed: int) -> Grid:
    """Heights (size, size) in metres; a finer grid adds gullies and rock, and moves nothing else."""
    heights = _eroded(seed)
    while heights.shape[0] < size:
        heights = _detailed(heights, seed)
    return resample(heights, size)


@lru_cache(maxsize=2)
def _eroded(seed: int) -> Grid:
    """The eroded landscape, 513 posts a side."""
    heights = (1500.0 + 600.0 * fbm((seed, 1), 3, 5, _COARSEST_POSTS)).astype(np.float32)
    for level, rounds in enumerate(_ROUNDS):
        size = ((_COARSEST_POSTS - 1) << level) + 1
        step_m = _ERODED_EXTENT_M / (size - 1)
        if level:
            heights = _warped(refine(heights), seed, level)
            heights += np.float32(0.12 * step_m) * lattice_noise((seed, 2, level), size - 1, size)
        heights, is_lake = _in_balance(heights, step_m, rounds, seed, level)
    heights, lake_share = _cut_out(heights), _cut_out(is_lake.astype(np.float32))
    lake, count = ndimage.label(lake_share > 0.5)
    if count:
        levels = np.asarray(ndimage.median(heights, lake, np.arange(count + 1)), np.float32)
        heights = np.where(lake > 0, levels[lake], heights)
    low, high = float(heights.min()), float(heights.max())
    stretch = np.float32(min(1.15, (_SUMMIT_M - _FLOOR_M) / (high - low)))
    return np.ascontiguousarray((heights - np.float32(low)) * stretch + np.float32(_FLOOR_M))


def _cut_out(eroded: Grid) -> Grid:
    """The turned square in the middle of the eroded one: neither its rim nor the directions of its grid show."""
    half = EXTENT_M / _ERODED_EXTENT_M * (eroded.shape[0] - 1) / 2.0
    at = np.linspace(-half, half, _BASE_POSTS)
    cosine, sine = math.cos(_TURN_RAD), math.sin(_TURN_RAD)
    middle = (eroded.shape[0] - 1) / 2.0
    row = middle + cosine * at[:, None] + sine * at[None, :]
    col = middle - sine * at[:, None] + cosine * at[None, :]
    return np.asarray(ndimage.map_coordinates(eroded, [row, col], order=3, mode="nearest"), np.float32)


def _in_balance(heights: Grid, step_m: float, rounds: int, seed: int, level: int) -> tuple[Grid, npt.NDArray[np.bool_]]:
    """Heights after rounds of: find the rivers, move half way to heights in balance with them; and where lakes are."""
    size = heights.shape[0]
    grid = ShiftedGrid(size, step_m, (seed, 3, level))
    uplift = np.exp(0.8 * fbm((seed, 4), 2, 4, size))
    rock_deg = 25.0 + 6.0 * fbm((seed, 5), 10, 6, size, 0.7)
    stream = 0.8 * _CHANNEL_AREA_M2**_AREA_POWER * uplift
    lakes = fbm((seed, 6), 9, 2, size) > 1.1
    rim = np.ones((size, size), np.bool_)
    rim[1:-1, 1:-1] = False
    lowlands = fbm((seed, 7), 2, 3, size)
    outlets = rim & (lowlands <= np.quantile(lowlands[rim], 0.3))
    wide = np.zeros((0, 0), np.float32)
    for _ in range(rounds):
        receivers, fall = steepest_receivers(heights, grid.per_m)
        flat = heights.ravel()
        with np.errstate(invalid="ignore"):
            way_m = np.where(fall > 0.0, (flat - flat[receivers]) / fall, np.float32(step_m))
        drain_pits(heights, receivers, outlets)
        area = upstream_sum(receivers, np.full(size * size, step_m**2, np.float32)).reshape(size, size)
        spread = _spread(area.astype(np.float32), step_m)
        wide = spread if not wide.size else 0.5 * (wide + spread)
        frost_deg = 16.0 * smoothstep(900.0, 2800.0, heights)
        rock_slope = np.tan(np.radians(np.clip(rock_deg + frost_deg, 14.0, 56.0)))
        river_slope = stream / wide**_AREA_POWER
        slope = river_slope * rock_slope / np.hypot(river_slope, rock_slope)
        slope[lakes & (wide > 20e6)] = 0.0
        balance = downstream_sum(receivers, slope.ravel() * way_m).reshape(size, size)
        heights = (0.5 * (heights + balance)).astype(np.float32)
    return _trimmed(grid.unshifted(heights), step_m), lakes & (wide > 20e6)


def _trimmed(heights: Grid, step_m: float) -> Grid:
    """Heights without teeth: no post far above all but its highest neighbours."""
    for _ in range(2):
        heights = np.minimum(heights, ndimage.percentile_filter(heights, 40, 3) + np.float32(0.5 * step_m))
    return heights


def _spread(area: Grid, step_m: float) -> Grid:
    """Drainage area as if water ran as wide as the glacier it once was."""
    wide = area
    for least, half_width_m in _TROUGHS:
        sigma = half_width_m / step_m
        if sigma < 0.4:
            continue
        lines = ndimage.gaussian_filter(np.sqrt(np.where(area >= least, area, 0.0)), sigma, truncate=2.5)
        wide = np.maximum(wide, np.minimum(np.square(lines * np.float32(sigma * 2.5066)), 4e9))
    return wide


def _warped(heights: Grid, seed: int, level: int) -> Grid:
    """Heights moved sideways by a smooth noise: no valley stays straight."""
    size = heights.shape[0]
    reach = 6.0 / level
    row, col = np.mgrid[0:size, 0:size].astype(np.float32)
    row += reach * fbm((seed, 8, level), 12, 3, size)
    col += reach * fbm((seed, 9, level), 12, 3, size)
    return ndimage.map_coordinates(heights, [row, col], order=1, mode="nearest")


def _detailed(coarse: Grid, seed: int) -> Grid:
    """Twice the resolution: rough rock and gullies where it is steep."""
    heights = refine(coarse)
    size = heights.shape[0]
    step_m = np.float32(EXTENT_M / (size - 1))
    slope_z, slope_x = np.gradient(heights, step_m)
    steep = smoothstep(0.1, 0.75, np.hypot(slope_x, slope_z))
    rough = lattice_noise((seed, 10, size), (size - 1) // 2, size)
    rough += 1.5 * lattice_noise((seed, 11, size), (size - 1) // 6, size)
    # High up frost leaves crests and teeth: noise folded at its zeros.
    crags = 1.0 - 2.0 * np.abs(lattice_noise((seed, 14, size), (size - 1) // 5, size)) - np.abs(rough)
    high = smoothstep(1900.0, 3000.0, heights)
    heights += step_m * steep * (0.1 * rough + 0.28 * high * crags)
    # Routing over ground rougher than the real one makes gullies wander instead of following the grid's directions.
    routed = heights + 0.6 * step_m * steep * lattice_noise((seed, 13, size), size - 1, size)
    per_m = [1.0 / (step_m * math.hypot(r, c)) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    receivers, _ = steepest_receivers(routed, per_m)
    passing = upstream_sum(receivers, np.ones(size * size, np.float32), 6)
    gully = np.minimum(np.log2(passing), 7.0).astype(np.float32).reshape(size, size) - 1.5
    depth_m = 0.42 * step_m * steep * smoothstep(-1.0, 1.0, fbm((seed, 12), 24, 3, size))
    heights -= depth_m * ndimage.gaussian_filter(gully, 0.7)
    return heights
