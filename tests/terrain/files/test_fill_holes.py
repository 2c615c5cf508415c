"""Filled holes are smooth, within the range of the data, and leave the data alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from terrain.heightfield import fill_holes

SHAPES = arrays.array_shapes(min_dims=2, max_dims=2, min_side=2, max_side=40)


@given(st.data(), SHAPES, st.integers(0, 2**32 - 1))
def test_data_stays_and_holes_lie_within_its_range(data, shape, seed):
    rng = np.random.default_rng(seed)
    heights = rng.uniform(-100, 100, shape).astype(np.float32)
    holes = rng.random(shape) < data.draw(st.floats(0, 1))
    heights[holes] = np.nan
    filled = fill_holes(heights, holes)
    np.testing.assert_array_equal(filled[~holes], heights[~holes])
    assert filled.dtype == np.float32
    assert filled.flags.c_contiguous
    if holes.all():
        np.testing.assert_array_equal(filled, 0)
    else:
        assert filled.min() >= heights[~holes].min() - 1e-4
        assert filled.max() <= heights[~holes].max() + 1e-4


@pytest.mark.parametrize("size", [1, 4, 15, 60])
def test_a_hole_in_a_slope_is_bridged_without_a_step(size):
    row, col = np.mgrid[0:100, 0:120]
    slope = (2.0 * row + col).astype(np.float32)
    holes = np.zeros(slope.shape, bool)
    holes[20 : 20 + size, 30 : 30 + size] = True
    filled = fill_holes(np.where(holes, np.float32(np.inf), slope), holes)
    assert np.abs(np.diff(filled, axis=0)).max() <= 10  # the slope itself steps by 2 and 1 per post
    assert np.abs(np.diff(filled, axis=1)).max() <= 10


def test_the_argument_is_not_changed():
    heights = np.arange(12, dtype=np.float32).reshape(3, 4)
    holes = heights == 5
    fill_holes(heights, holes)
    np.testing.assert_array_equal(heights.ravel(), np.arange(12))
