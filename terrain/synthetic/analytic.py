"""Scenes with a closed form, for tests: 1024 m across, x east and z south of the north-west post, metres."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.synthetic.noise import Grid

EXTENT_M = 1024.0


def flat_heights(size: int, seed: int) -> Grid:
    """A level plane: ``y = 100``."""
    return np.full((size, size), 100.0, np.float32)


def ramp_heights(size: int, seed: int) -> Grid:
    """An inclined plane: ``y = x / 4 + z / 8``."""
    x, z = _posts_m(size)
    return (x / 4.0 + z / 8.0).astype(np.float32)


def cone_heights(size: int, seed: int) -> Grid:
    """A cone on a plane: ``y = max(0, 200 - r / 2)``, r the distance from the centre (512, 512)."""
    x, z = _posts_m(size)
    return np.maximum(0.0, 200.0 - np.hypot(x - EXTENT_M / 2.0, z - EXTENT_M / 2.0) / 2.0).astype(np.float32)


def step_heights(size: int, seed: int) -> Grid:
    """A cliff one cell wide, north to south: ``y = 100`` where ``x >= 512``, else 0."""
    x, z = _posts_m(size)
    return np.where((x >= EXTENT_M / 2.0) & (z >= 0.0), np.float32(100.0), np.float32(0.0))


def needle_heights(size: int, seed: int) -> Grid:
    """One post 200 m high in a plane: ``y = 200`` at row and column ``size // 2``, else 0."""
    heights = np.zeros((size, size), np.float32)
    heights[size // 2, size // 2] = 200.0
    return heights


def waves_heights(size: int, seed: int) -> Grid:
    """Smooth waves 256 m long: ``y = 50 + 25 sin(2 pi x / 256) cos(2 pi z / 256)``."""
    x, z = _posts_m(size)
    return (50.0 + 25.0 * np.sin(2.0 * np.pi * x / 256.0) * np.cos(2.0 * np.pi * z / 256.0)).astype(np.float32)


def _posts_m(size: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """World x (1, size) and z (size, 1) of the posts."""
    at = np.linspace(0.0, EXTENT_M, size)
    return at[None, :], at[:, None]
