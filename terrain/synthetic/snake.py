"""``snake``: a scaly snake coiled on winding ridges and fractal noise, 2048 m across; a stress scene.

After figure 7 of Roettger and Ertl, *Hardware accelerated terrain rendering by adaptive slicing* ("a highly detailed
fractal snake"): detail at every size, round flanks that end in vertical walls, nothing flat that could be simplified.
Scales carry smaller scales, and the ground is made of ridges that wind like snakes, large and small.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage, spatial

from terrain.synthetic.noise import Grid, fbm, lattice_noise, resample, smoothstep

EXTENT_M = 2048.0
_BASE_POSTS = 1025
_TURNS = 2.4
_TAIL_M, _HEAD_M = 850.0, 190.0  # distances of the two ends from the middle
_STRAIGHT_M = 170.0  # of neck and head
_GIRTH_M = 56.0  # largest half width of the body
_SCALE_M = 30.0
_CHAIN_M = 2.0  # between points of the spine

Floats = npt.NDArray[np.float64]


def snake_heights(size: int, seed: int) -> Grid:
    """Heights (size, size) in metres; a finer grid adds finer scales and noise, and moves nothing else."""
    spine = _spine(seed)
    length_m = _CHAIN_M * (len(spine) - 1)
    along, aside, level, distance = (resample(field, size) for field in _beside(seed))
    heights = _ground(size, seed)
    body = np.flatnonzero(distance < 1.3 * _GIRTH_M)  # no sign, so no jump of sign where two coils are near
    along, aside, level = along.ravel()[body], aside.ravel()[body], level.ravel()[body]
    half_m = _half_width_m(along, length_m)
    share = np.clip(aside / np.maximum(half_m, 1.0), -1.0, 1.0)
    rounding = np.sqrt(1.0 - np.square(share))
    bare = smoothstep(120.0, 200.0, length_m - along)  # the head has lower scales
    skin = _scales(along, np.arcsin(share) * half_m, EXTENT_M / (size - 1)) * (0.35 + 0.65 * bare)
    top = level + half_m * (0.3 + 0.9 * rounding) + skin * rounding + _face(length_m - along, aside)
    ground = heights.ravel()[body]
    heights.ravel()[body] = np.where(np.abs(aside) < half_m, np.maximum(top, ground), ground)
    return heights


def _spine(seed: int) -> Floats:
    """Points (n, 2) of the spine, tail first: a spiral with bends, `_CHAIN_M` apart."""
    rng = np.random.default_rng((seed, 50))
    start, bend_phase = 2.0 * math.pi * rng.random(2)
    turn = np.linspace(0.0, 1.0, 4000)
    around = start + 2.0 * math.pi * _TURNS * turn
    out = _TAIL_M + (_HEAD_M - _TAIL_M) * turn
    bends = 0.5 * np.cumsum(np.r_[0.0, out[1:] * np.diff(around)]) / 38.0
    out = out + 36.0 * np.sin(bends + bend_phase) * np.minimum(turn * 12.0, 1.0) * np.minimum((1.0 - turn) * 7.0, 1.0)
    line = EXTENT_M / 2.0 + np.column_stack([out * np.cos(around), out * np.sin(around)])
    ahead = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    line = np.vstack([line, line[-1] + _STRAIGHT_M * ahead])  # the head looks where the neck points
    passed = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    even = np.arange(0.0, passed[-1], _CHAIN_M)
    return np.column_stack([np.interp(even, passed, line[:, axis]) for axis in (0, 1)])


@lru_cache(maxsize=2)
def _beside(seed: int) -> tuple[Grid, Grid, Grid, Grid]:
    """Fields of the base grid: distance from the tail along the spine, signed distance aside of it, level of the
    ground under it, and distance from it."""
    spine = _spine(seed)
    tangent = np.gradient(spine, axis=0) / _CHAIN_M
    level = ndimage.gaussian_filter1d(_at(_ground(257, seed), spine), 40.0, mode="nearest")
    at = np.linspace(0.0, EXTENT_M, _BASE_POSTS)
    x, z = np.meshgrid(at, at)
    untouched = np.ones((_BASE_POSTS, _BASE_POSTS), np.bool_)
    col, row = np.rint(spine * ((_BASE_POSTS - 1) / EXTENT_M)).astype(np.int64).T
    untouched[row, col] = False
    far_m = 1.6 * _GIRTH_M
    near = ndimage.distance_transform_edt(untouched) * (EXTENT_M / (_BASE_POSTS - 1)) < far_m
    place = np.column_stack([x[near], z[near]])
    distance, nearest = spatial.cKDTree(spine).query(place)
    apart = place - spine[nearest]
    along, aside, base, apart_m = (np.full(near.shape, value, np.float32) for value in (-far_m, far_m, 0.0, far_m))
    along[near] = nearest * _CHAIN_M + np.sum(apart * tangent[nearest], axis=1)
    aside[near] = tangent[nearest, 0] * apart[:, 1] - tangent[nearest, 1] * apart[:, 0]
    base[near] = level[nearest]
    apart_m[near] = distance
    return along, aside, base, apart_m


def _half_width_m(along: Grid, length_m: float) -> Grid:
    """Half width of the body: a long tail, a neck, a wide head that ends in a round snout."""
    to_snout = length_m - along
    body = _GIRTH_M * np.sqrt(smoothstep(-0.05 * length_m, 0.6 * length_m, along) * smoothstep(0.0, 60.0, along))
    neck = 1.0 - 0.42 * smoothstep(420.0, 190.0, to_snout)
    head = 0.72 * np.exp(-np.square((to_snout - 82.0) / 46.0))
    snout = np.sqrt(np.clip(to_snout / 46.0, 0.0, 1.0))
    return np.asarray(body * (neck + head) * snout, np.float32)


def _scales(along: Grid, around: Grid, step_m: float) -> Grid:
    """Rows of overlapping scales with keels; each carries smaller scales, as far as the grid shows them."""
    relief = np.zeros_like(along)
    size_m, tall_m = _SCALE_M, 4.5
    while size_m >= 4.0 * step_m and size_m > 1.0:
        v = around / (0.62 * size_m)
        u = along / size_m + np.abs(np.mod(v, 1.0) - 0.5)  # rows are zigzags
        row = np.floor(u)
        across = 2.0 * np.abs(np.mod(v + 0.5 * np.mod(row, 2.0), 1.0) - 0.5)  # every second row is shifted by half
        # Each scale rises towards its free end and has a keel along its middle.
        relief += tall_m * ((u - row) * (1.0 - np.square(across)) + 0.25 * smoothstep(0.16, 0.0, across))
        size_m, tall_m = size_m / 3.0, tall_m / 3.4
    return relief


def _face(to_snout: Grid, aside: Grid) -> Grid:
    """Eyes with slit pupils, brows and nostrils."""
    from_eye = np.hypot(to_snout - 78.0, np.abs(aside) - 34.0)
    eye = 13.0 * np.sqrt(np.maximum(1.0 - np.square(from_eye / 13.0), 0.0))
    pupil = 3.0 * ((np.abs(np.abs(aside) - 34.0) < 1.6) & (from_eye < 9.0))
    brow = 6.0 * np.exp(-np.square((from_eye - 15.0) / 3.5))
    nostril = 5.0 * np.exp(-np.square(np.hypot(to_snout - 20.0, np.abs(aside) - 11.0) / 3.5))
    return np.asarray(eye - pupil + brow - nostril, np.float32)


def _ground(size: int, seed: int) -> Grid:
    """Winding ridges at four sizes over fractal noise."""
    ground = 40.0 + 26.0 * fbm((seed, 51), 3, 10, size, 0.52)
    for octave, (cells, tall_m) in enumerate(((9, 15.0), (22, 7.0), (53, 3.2), (128, 1.5))):
        if octave and cells > size // 4:
            break
        winding = np.abs(
            lattice_noise((seed, 52, octave), cells, size) + 0.5 * fbm((seed, 53, octave), 2 * cells, 2, size)
        )
        ground += np.float32(tall_m) * np.sqrt(np.maximum(1.0 - np.square(winding / 0.34), 0.0))
    return ground


def _at(grid: Grid, points: Floats) -> Floats:
    """Values of a grid at the posts nearest to places."""
    last = grid.shape[0] - 1
    col, row = np.clip(np.rint(points * (last / EXTENT_M)), 0, last).astype(np.int64).T
    return np.asarray(grid[row, col], np.float64)
