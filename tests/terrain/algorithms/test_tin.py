"""TIN patches keep their error everywhere, keep their rim, and survive flat, collinear and sliver-prone ground."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.tin import Tin, greedy_tin
from terrain.heightfield import surface_heights


def rough(side: int, seed: int, scale: float = 5.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    heights = rng.normal(0, 1, (side, side)).cumsum(0).cumsum(1) / side * scale
    return (heights + rng.normal(0, scale / 8, (side, side))).astype(np.float32)


def rim_of(side: int, seed: int, share: float) -> np.ndarray:
    rim = np.random.default_rng(seed).random((side, side)) < share
    rim[1:-1, 1:-1] = False
    return rim


def corner_areas(tin: Tin) -> np.ndarray:
    """Twice the signed areas, positive where counter-clockwise seen from above (row 0 is north)."""
    (ax, bx, cx), (ay, by, cy) = tin.col[tin.triangles].T, tin.row[tin.triangles].T
    return -((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))


def largest_error(tin: Tin, heights: np.ndarray, samples: int = 40) -> float:
    """Largest vertical distance to the surface over random points of every triangle, its corners and its edges."""
    rng = np.random.default_rng(0)
    weights = np.concatenate([np.eye(3), rng.dirichlet((1, 1, 1), samples), rng.dirichlet((0.02, 1, 1), samples)])
    col, row, z = (a[tin.triangles] @ weights.T for a in (tin.col, tin.row, tin.height_m))
    limit = len(heights) - 1
    truth = surface_heights(heights, np.clip(col, 0, limit), np.clip(row, 0, limit))
    return float(np.abs(z - truth).max())


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), error=st.floats(0.05, 3.0), side=st.sampled_from([5, 9, 17]))
def test_error_stays_within_the_allowed_one_between_the_posts_too(seed, error, side):
    heights = rough(side, seed)
    tin = greedy_tin(heights, np.ones((side, side), bool), error, 10_000)
    assert tin is not None
    assert largest_error(tin, heights) <= error + 1e-5
    areas = corner_areas(tin)
    assert (areas > 0).all()
    assert areas.sum() == 2 * (side - 1) ** 2


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), share=st.floats(0, 1))
def test_rim_has_exactly_the_vertices_it_was_given(seed, share):
    heights, rim = rough(9, seed), rim_of(9, seed, share)
    tin = greedy_tin(heights, rim, 1e3, 1000)
    assert tin is not None
    rim[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    on_rim = (np.abs(tin.row - 4) == 4) | (np.abs(tin.col - 4) == 4)
    assert {(int(r), int(c)) for r, c in zip(tin.row[on_rim], tin.col[on_rim], strict=True)} == {
        (int(r), int(c)) for r, c in np.argwhere(rim)
    }
    np.testing.assert_array_equal(tin.height_m, heights[tin.row.astype(int), tin.col.astype(int)])


def test_zero_error_rebuilds_the_surface():
    heights = rough(9, 3)
    tin = greedy_tin(heights, np.ones((9, 9), bool), 0.0, 1000)
    assert tin is not None
    assert len(tin.triangles) == 128
    assert largest_error(tin, heights) < 1e-6


def test_flat_square_is_two_triangles():
    heights = np.full((17, 17), 7.0, np.float32)
    tin = greedy_tin(heights, np.zeros((17, 17), bool), 0.0, 1000)
    assert tin is not None
    assert len(tin.triangles) == 2


def test_straight_ridge_gives_few_triangles_and_none_without_area():
    row = np.indices((17, 17))[0]
    heights = (4.0 - np.abs(row - 5)).astype(np.float32)  # all points that matter lie on one line
    tin = greedy_tin(heights, np.ones((17, 17), bool), 0.01, 1000)
    assert tin is not None
    assert largest_error(tin, heights) <= 0.01
    assert (corner_areas(tin) > 0).all()
    inner = np.count_nonzero((tin.row % 16 != 0) & (tin.col % 16 != 0))
    assert inner <= 60  # of 225


def test_one_post_wide_wall_is_kept():
    heights = np.zeros((17, 17), np.float32)
    heights[:, 8] = 100.0  # nothing but slivers
    tin = greedy_tin(heights, np.ones((17, 17), bool), 0.5, 1000)
    assert tin is not None
    assert largest_error(tin, heights) <= 0.5 + 1e-4


def test_too_few_points_or_too_coarse_a_rim_give_nothing():
    heights = rough(9, 1)
    assert greedy_tin(heights, np.ones((9, 9), bool), 0.0, 40) is None
    heights[1::2, 0] += 50.0  # the rim leaves out what it would need
    assert greedy_tin(heights, np.zeros((9, 9), bool), 0.5, 1000) is None
