"""Declared and undeclared "no data" becomes holes; heights that only look like it stay heights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.files.voids import SENTINELS, find_voids


def hills(low=100.0, high=2000.0):
    return np.linspace(low, high, 1200, dtype=np.float32).reshape(30, 40)


def test_clean_grid_has_no_mask_and_no_note():
    notes: list[str] = []
    assert find_voids(hills(), None, notes) is None
    assert find_voids(hills(), -9999.0, notes) is None
    assert notes == []


@pytest.mark.parametrize(
    "number", [*SENTINELS, np.nan, np.inf, -np.inf, 3.4028235e38, -3.4028235e38, -3.4e38, 1.70141e38]
)
def test_undeclared_numbers_become_holes(number):
    values = hills()
    values[3:5, 7:20] = number
    notes: list[str] = []
    expected = np.zeros(values.shape, bool)
    expected[3:5, 7:20] = True
    np.testing.assert_array_equal(find_voids(values, None, notes), expected)
    assert notes[0].startswith("26 posts (2.17 %) hold")


@given(st.sets(st.sampled_from([*SENTINELS, np.nan, np.inf, -3.4e38]), min_size=2), st.floats(-3000, 3000))
def test_several_kinds_at_once_are_all_found(numbers, nodata):
    values = hills(-500, 4000)
    for place, number in enumerate(numbers):
        values[place, place : place + 3] = number
    values[29, 39] = np.float32(nodata)
    voids = find_voids(values, nodata, [])
    declared = values == np.float32(nodata)
    np.testing.assert_array_equal(voids, (np.abs(values) > 9000) | ~np.isfinite(values) | declared)


@pytest.mark.parametrize("nodata", [0.0, -9999.0, 1e20, float("nan"), float("inf"), -3.4e38])
def test_declared_number_becomes_holes(nodata):
    values = hills()
    values[::7, ::3] = nodata
    expected = np.zeros(values.shape, bool)
    expected[::7, ::3] = True
    np.testing.assert_array_equal(find_voids(values, nodata, []), expected)


def test_trench_that_reaches_a_sentinel_stays():
    assert find_voids(np.linspace(-9999, 0, 900, dtype=np.float32).reshape(30, 30), None, []) is None
    assert find_voids(np.linspace(-32768, 32767, 900, dtype=np.float32).reshape(30, 30), None, []) is None


def test_sentinel_inside_the_range_stays():
    values = hills(-60_000, 60_000)
    values[4, 4] = -9999
    assert find_voids(values, None, []) is None


def test_flat_grid_of_one_sentinel_is_all_hole():
    assert find_voids(np.full((5, 5), -9999, np.float32), None, []).all()
