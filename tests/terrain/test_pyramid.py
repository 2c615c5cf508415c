"""Pyramid bounds against a brute-force evaluation, on any size of grid; the cache against damage and races."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain import cache
from terrain.heightfield import Heightfield, surface_heights
from terrain.pyramid import BASE_LEVEL, BLOCK_LEVEL, build_pyramid, load_pyramid


def rough(rows: int, cols: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, cols)).astype(np.float32).cumsum(0).cumsum(1)


def surface_error(heights: np.ndarray, level: int) -> np.ndarray:
    """Distance at every post between the surface of ``level`` (edge posts repeated past the grid) and the posts."""
    size = 1 << level
    at = [np.minimum(np.arange(-(-(n - 1) // size) + 1) * size, n - 1) for n in heights.shape]
    row, col = np.mgrid[: heights.shape[0], : heights.shape[1]] / size
    return np.abs(surface_heights(np.ascontiguousarray(heights[np.ix_(*at)]), col, row) - heights)


def node_maximum(values: np.ndarray, level: int, shape: tuple[int, int]) -> np.ndarray:
    n = 1 << level
    nodes = np.ndindex(*shape)
    return np.array([values[i * n : (i + 1) * n + 1, j * n : (j + 1) * n + 1].max() for i, j in nodes]).reshape(shape)


@settings(max_examples=40)
@given(st.integers(2, 150), st.integers(2, 150), st.integers(0, 2**31))
def test_errors_are_the_largest_distance_at_a_post_and_monotone(rows: int, cols: int, seed: int) -> None:
    heights = rough(rows, cols, seed)
    pyramid = build_pyramid(heights)
    slack = 1e-5 * float(np.abs(heights).max())
    expected = np.zeros(pyramid.node_shape(BASE_LEVEL))
    for level in range(1, pyramid.top_level + 1):
        node_level = max(level, BASE_LEVEL)
        shape = pyramid.node_shape(node_level)
        finer = pyramid.error(node_level, level - 1)
        expected = np.maximum(node_maximum(surface_error(heights, level), node_level, shape), finer)
        found = pyramid.error_m[level]
        assert found.shape == shape
        assert (found >= expected - slack).all()
        if level <= BLOCK_LEVEL:
            np.testing.assert_allclose(found, expected, atol=slack)


@settings(max_examples=30)
@given(st.integers(2, 150), st.integers(2, 150), st.integers(0, 2**31))
def test_minimum_and_maximum_are_those_of_the_posts(rows: int, cols: int, seed: int) -> None:
    heights = rough(rows, cols, seed)
    pyramid = build_pyramid(heights)
    for level in range(BASE_LEVEL, pyramid.top_level + 1):
        shape = pyramid.node_shape(level)
        np.testing.assert_array_equal(pyramid.maximum(level), node_maximum(heights, level, shape))
        np.testing.assert_array_equal(pyramid.minimum(level), -node_maximum(-heights, level, shape))


def test_a_plane_has_no_error_inside_the_grid_but_where_it_ends_within_a_cell() -> None:
    row, col = np.mgrid[:129, :129]
    pyramid = build_pyramid((3 * row - 2 * col).astype(np.float32))
    assert max(float(e.max()) for e in pyramid.error_m) == 0.0


def test_a_needle_keeps_its_full_height_as_error_at_every_coarser_level() -> None:
    heights = np.zeros((65, 65), np.float32)
    heights[21, 43] = 100.0
    pyramid = build_pyramid(heights)
    assert [float(e.max()) for e in pyramid.error_m] == [0.0] + [100.0] * 6


def test_a_level_finer_than_asked_for_is_refused() -> None:
    with pytest.raises(ValueError, match="no error of surface level"):
        build_pyramid(rough(65, 65, 0)).error(4, 5)


def test_scaling_a_pyramid_is_the_pyramid_of_the_scaled_terrain() -> None:
    heights = rough(70, 90, 1)
    scaled, built = build_pyramid(heights).scaled(2.0), build_pyramid(heights * 2)
    for a, b in zip(scaled.error_m, built.error_m, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5)


def test_a_pyramid_comes_back_from_the_cache_unchanged(own_cache) -> None:
    terrain = Heightfield(rough(300, 280, 2), (30.0, 30.0))
    built, loaded = load_pyramid(terrain), load_pyramid(terrain)
    assert list(own_cache.glob("pyramids/*.npz"))
    for name in ("minimum_m", "maximum_m", "error_m"):
        for a, b in zip(getattr(built, name), getattr(loaded, name), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", None])
def test_a_damaged_entry_is_built_again(own_cache, damage) -> None:
    terrain = Heightfield(rough(300, 280, 3), (30.0, 30.0))
    built = load_pyramid(terrain)
    (entry,) = own_cache.glob("pyramids/*.npz")
    entry.write_bytes(entry.read_bytes()[:-2000] if damage is None else damage)
    np.testing.assert_array_equal(load_pyramid(terrain).error_m[3], built.error_m[3])


def test_the_cache_drops_its_oldest_entries_and_keeps_the_newest(own_cache, monkeypatch) -> None:
    monkeypatch.setattr(cache._drop_oldest, "__defaults__", (50_000,))
    for i in range(5):
        assert cache.store_arrays("kind", f"key{i}", {"a": np.full(5000, i, np.float32)})
    kept = {path.stem for path in own_cache.glob("kind/*.npz")}
    assert "key4" in kept
    assert "key0" not in kept


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("RELIEFSCOPE_CACHE", str(blocked))
    assert not cache.store_arrays("kind", "key", {"a": np.zeros(3)})
    assert cache.load_arrays("kind", "key") is None
