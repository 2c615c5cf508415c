"""The horizon against sight rays: what it hides is hidden along every ray, and what stands behind a wall is hidden."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms import horizon
from terrain.algorithms.horizon import rises_above_horizon

SIZE_M = 10.0
RAYS = np.linspace(0, 2 * np.pi, 1001)


def tiles(seed: int, eye: tuple[float, float]) -> tuple[np.ndarray, ...]:
    """Edges, bottoms and tops of 12 x 12 boxes in random order: walls and plains at about the height of the eye."""
    rng = np.random.default_rng(seed)
    row, col = (a.ravel()[rng.permutation(144)] for a in np.mgrid[:12, :12])
    x = np.stack([col, col + 1]) * SIZE_M - eye[0]
    z = np.stack([row, row + 1]) * SIZE_M - eye[1]
    bottom = rng.normal(-2.0, 4.0, 144)
    return tuple(a.astype(np.float32) for a in (x, z, bottom, bottom + rng.exponential(1.0, 144)))


def crossed(x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (rays, boxes) at which level rays from the eye enter and leave boxes; those that miss enter last."""
    east, south = np.sin(RAYS)[:, None] + 1e-12, -np.cos(RAYS)[:, None] + 1e-12
    to_x, to_z = np.sort([x[0] / east, x[1] / east], axis=0), np.sort([z[0] / south, z[1] / south], axis=0)
    return np.maximum(np.maximum(to_x[0], to_z[0]), 1e-9), np.maximum(np.minimum(to_x[1], to_z[1]), 1e-9)


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1), st.floats(1, 119), st.floats(1, 119), st.floats(0, 360), st.booleans(),
    st.sampled_from([32, 1024]),
)  # fmt: skip
def test_what_is_hidden_is_hidden_along_every_ray(seed, x_m, z_m, yaw_deg, holed, bins) -> None:
    x, z, bottom, top = tiles(seed, (x_m, z_m))
    if holed:
        bottom[::29] = -np.inf
    yaw = np.radians(yaw_deg)
    with mock.patch.multiple(horizon, AZIMUTH_BINS=bins, _WIDTH=bins + 1):
        visible = rises_above_horizon(x, z, bottom, top, np.array([np.sin(yaw), -0.1, -np.cos(yaw)]))
    enter, leave = crossed(x, z)
    hits = leave > enter
    # Ground in a box is sure to reach this tangent somewhere, and nothing in a box is seen above the other.
    reached = np.where(hits, bottom / np.where(bottom > 0, leave, enter), -np.inf)
    highest = top / np.where(top > 0, enter, leave)
    for box in np.flatnonzero(~visible):
        for ray in np.flatnonzero(leave[:, box] > enter[:, box] + 1e-3):
            nearer = leave[ray] <= enter[ray, box] + 1e-3
            pierced = nearer & hits[ray] & np.isneginf(bottom)
            if pierced.any():  # only what comes before the first hole hides
                nearer &= leave[ray] <= enter[ray][pierced].min() + 1e-3
            assert reached[ray][nearer].max(initial=-np.inf) >= highest[ray, box] - 1e-3


@pytest.mark.parametrize("height_m", [6.0, 2.0, -3.0], ids=["above", "low", "below the eye"])
def test_behind_a_wall_only_what_rises_above_it_is_seen(height_m) -> None:
    """Ground 40 to 71 m away that reaches a height for certain; behind it boxes a little lower and a little higher."""
    x = np.array([[-50, -5, -5], [50, 5, 5]], np.float32)
    z = np.array([[-50, -160, -160], [-40, -150, -150]], np.float32)
    bottom = np.array([height_m, -1e3, -1e3], np.float32)
    # Wherever in its box the ground reaches that height, and wherever in theirs the others are highest.
    tangent = height_m / (np.hypot(50, 50) if height_m > 0 else 40)
    highest = np.array([tangent - 0.01, tangent + 0.01]) * (150 if height_m > 0 else np.hypot(160, 5))
    top = np.array([height_m + 1, *highest], np.float32)
    assert rises_above_horizon(x, z, bottom, top, np.array([0.0, 0.0, -1.0])).tolist() == [True, False, True]
    assert rises_above_horizon(x, z, bottom, top, np.array([0.0, 0.0, 1.0])).all(), "the seam is straight behind"
