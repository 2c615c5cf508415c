"""The hierarchy's errors are true bounds, and its meshes fit, for any grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.rtin import Ladder, build_rtin
from terrain.algorithms.rtin_mesh import Patches, extract_meshes


def rough(rows: int, cols: int, seed: int, scale: float = 20.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    heights = rng.normal(0, 1, (rows, cols)).cumsum(0).cumsum(1) / np.sqrt(rows * cols) * scale
    return (heights + rng.normal(0, scale / 10, (rows, cols))).astype(np.float32)


def tile_all(shape: tuple[int, int], level: int, rung: int) -> Patches:
    """Patches of one level and rung over the whole padded grid."""
    row, col = (g.ravel().astype(np.int32) for g in np.indices(((shape[0] - 1) >> level, (shape[1] - 1) >> level)))
    return Patches(np.full_like(row, level), row, col, np.full_like(row, rung))


def mesh_heights(padded: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Height of a mesh of post numbers at every post of the padded grid, in float64; NaN where nothing covers it."""
    stride = padded.shape[1]
    surface = np.full(padded.shape, np.nan)
    for triangle in triangles:
        row, col = np.divmod(triangle, stride)
        z = padded[row, col].astype(np.float64)
        r, c = (g.astype(np.float64) for g in np.mgrid[row.min() : row.max() + 1, col.min() : col.max() + 1])
        area = (col[1] - col[0]) * (row[2] - row[0]) - (col[2] - col[0]) * (row[1] - row[0])
        b1 = ((c - col[0]) * (row[2] - row[0]) - (col[2] - col[0]) * (r - row[0])) / area
        b2 = ((col[1] - col[0]) * (r - row[0]) - (c - col[0]) * (row[1] - row[0])) / area
        inside = (b1 >= -1e-12) & (b2 >= -1e-12) & (b1 + b2 <= 1 + 1e-12)
        window = surface[row.min() : row.max() + 1, col.min() : col.max() + 1]
        window[inside] = (z[0] + b1 * (z[1] - z[0]) + b2 * (z[2] - z[0]))[inside]
    return surface


def pad_to(heights: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    return np.pad(heights, [(0, s - n) for s, n in zip(shape, heights.shape, strict=True)], mode="edge")


grids = st.tuples(st.integers(2, 40), st.integers(2, 40), st.integers(0, 2**32 - 1))


@settings(max_examples=40)
@given(grid=grids, top=st.integers(1, 5), rung=st.integers(0, 90))
def test_mesh_error_never_exceeds_its_rungs_error(grid, top, rung):
    rows, cols, seed = grid
    heights, spacing = rough(rows, cols, seed), (3.0, 2.0)
    rtin = build_rtin(heights, spacing, top)
    meshes = extract_meshes(rtin, tile_all(rtin.drop_rung.shape, top, rung))
    padded = pad_to(heights, rtin.drop_rung.shape)
    surface = mesh_heights(padded, meshes.triangles)
    assert np.isfinite(surface).all()  # it covers every post
    error = np.abs(surface[:rows, :cols] - heights)
    assert error.max() <= rtin.ladder.error_m(rung) + 1e-5


@settings(max_examples=40)
@given(grid=grids, level=st.integers(1, 3), rung=st.integers(0, 80))
def test_neighbours_on_one_rung_fit_without_t_vertices(grid, level, rung):
    heights = rough(*grid)
    rtin = build_rtin(heights, (1.0, 1.0), 3)
    stride = rtin.drop_rung.shape[1]
    triangles = extract_meshes(rtin, tile_all(rtin.drop_rung.shape, level, rung)).triangles
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    directed = set(map(tuple, edges.tolist()))
    assert len(directed) == len(edges)  # every edge at most once each way: oriented alike, nothing overlaps
    for a, b in directed:
        if (b, a) not in directed:  # an edge with one triangle lies on the rim
            (ra, ca), (rb, cb) = divmod(a, stride), divmod(b, stride)
            last_row, last_col = rtin.drop_rung.shape[0] - 1, stride - 1
            assert (ra == rb and ra in (0, last_row)) or (ca == cb and ca in (0, last_col))


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (17, 17), (2, 33), (31, 9)])
def test_rung_zero_rebuilds_every_post_of_rough_ground(rows, cols):
    heights = rough(rows, cols, 1)
    rtin = build_rtin(heights, (1.0, 1.0), 3)
    padded = pad_to(heights, rtin.drop_rung.shape)
    surface = mesh_heights(padded, extract_meshes(rtin, tile_all(rtin.drop_rung.shape, 3, 0)).triangles)
    np.testing.assert_allclose(surface[:rows, :cols], heights, atol=2 * rtin.ladder.exact_m)


def test_plane_needs_two_triangles_a_patch():
    row, col = np.indices((33, 33))
    heights = (3 * row - 2 * col).astype(np.float32)
    rtin = build_rtin(heights, (1.0, 1.0), 4)
    meshes = extract_meshes(rtin, tile_all(rtin.drop_rung.shape, 4, 0))
    assert np.diff(meshes.starts).tolist() == [2, 2, 2, 2]


def test_one_needle_costs_only_the_triangles_around_it():
    heights = np.zeros((65, 65), np.float32)
    heights[33, 17] = 10.0
    rtin = build_rtin(heights, (1.0, 1.0), 6)
    meshes = extract_meshes(rtin, tile_all(rtin.drop_rung.shape, 6, 0))
    assert 8 <= len(meshes.triangles) < 80  # of 8192
    assert 33 * 65 + 17 in meshes.triangles


def test_vertex_is_never_dropped_before_one_that_needs_it():
    rtin = build_rtin(rough(65, 65, 5), (1.0, 1.0), 4)
    few, many = (set(extract_meshes(rtin, tile_all((65, 65), 4, rung)).triangles.ravel().tolist()) for rung in (56, 40))
    assert few < many
    assert set(np.flatnonzero(rtin.drop_rung.ravel() > 56)) == few  # every vertex above the rung is really there


def test_patches_of_mixed_sizes_come_out_as_if_extracted_alone():
    rtin = build_rtin(rough(65, 65, 8), (1.0, 1.0), 5)
    patches = Patches(*np.array([[5, 4, 3, 4], [0, 2, 7, 3], [0, 1, 7, 3], [36, 56, 0, 44]], np.int32))
    together = extract_meshes(rtin, patches)
    for i in range(4):
        alone = extract_meshes(rtin, patches.take(np.array([i])))
        own = together.triangles[together.starts[i] : together.starts[i + 1]]
        np.testing.assert_array_equal(own, alone.triangles)


def test_ladder_steps_agree_with_one_another():
    ladder = Ladder(exact_m=1e-4, base_m=0.25)
    rungs = np.arange(1, 40)
    errors = ladder.error_m(rungs)
    np.testing.assert_array_equal(ladder.coarsest_within(errors), rungs)
    np.testing.assert_array_equal(ladder.first_without(errors.astype(np.float32)), rungs)
    assert (ladder.error_m(ladder.coarsest_within(errors * 1.3)) <= errors * 1.3).all()
    assert ladder.coarsest_within([0.0, 0.1])[0] == 0
    assert ladder.first_without(np.array([0, 1e-5, 0.01], np.float32)).tolist() == [0, 0, 1]
