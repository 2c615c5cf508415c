"""The pool hands out the triangles of any choice of patches, and swaps TINs in without opening a seam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terrain.algorithms.multiresolution import (
    FINEST_LEVEL,
    REFINED,
    ApproximationTree,
    build_preview,
    find_microstructures,
)
from terrain.algorithms.patch_pool import PatchPool, triangulate
from terrain.algorithms.refined_cells import refine_cells
from terrain.algorithms.rtin import build_rtin
from terrain.algorithms.rtin_mesh import Patches, extract_meshes
from terrain.breaklines import Breaklines
from terrain.heightfield import Heightfield


def tree_of(rows: int, cols: int, share: float = 1.0) -> ApproximationTree:
    rng = np.random.default_rng(rows)
    heights = (rng.normal(0, 1, (rows, cols)).cumsum(0).cumsum(1) / 12).astype(np.float32)
    rtin = build_rtin(heights, (1.0, 1.0), 6)
    return ApproximationTree(Heightfield(heights, (1.0, 1.0)), rtin, find_microstructures(rtin, share))


def whole(tree: ApproximationTree, level: int, rung: int) -> Patches:
    size = 1 << level
    count = [-(-(n - 1) // size) for n in (tree.heightfield.rows, tree.heightfield.cols)]
    row, col = (g.ravel().astype(np.int32) for g in np.indices(count))
    return Patches(np.full_like(row, level), row, col, np.full_like(row, rung))


def test_patches_come_in_their_order_and_repeat():
    tree = tree_of(129, 129)
    pool, patches = PatchPool(tree), whole(tree, 4, 36)
    patches = patches.take(np.random.default_rng(0).permutation(len(patches.level)))
    expected = extract_meshes(tree.rtin, patches).triangles.ravel()
    np.testing.assert_array_equal(pool.gather(patches), expected)
    assert pool.extracted == len(patches.level)
    np.testing.assert_array_equal(pool.gather(patches), expected)
    assert pool.extracted == 0
    again = patches.take(np.array([3, 3, 0]))
    np.testing.assert_array_equal(pool.gather(again), extract_meshes(tree.rtin, again).triangles.ravel())


def test_only_new_patches_are_extracted_and_nothing_gives_nothing():
    tree = tree_of(129, 129)
    pool, patches = PatchPool(tree), whole(tree, 5, 36)
    pool.gather(patches.take(np.arange(10)))
    pool.gather(patches)
    assert pool.extracted == len(patches.level) - 10
    nothing = patches.take(np.arange(0))
    assert len(pool.gather(nothing)) == 0
    assert len(pool.walls(nothing)) == 0


def test_full_pool_starts_anew_and_still_hands_out_the_view():
    tree = tree_of(129, 129)
    pool = PatchPool(tree, limit=1000)
    for rung in (8, 24, 40):
        patches = whole(tree, 4, rung)
        np.testing.assert_array_equal(pool.gather(patches), extract_meshes(tree.rtin, patches).triangles.ravel())
    assert pool.resident_bytes < 400_000


def edges_of(posts: np.ndarray) -> set[tuple[int, int]]:
    triangles = posts.reshape(-1, 3)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)
    return set(map(tuple, edges.tolist()))


def add_tins(pool: PatchPool, patches: Patches) -> int:
    """Make the TINs that wait; how many were tried."""
    waiting = pool.waiting_tins(patches)
    pool.add_tins(waiting, triangulate(pool.tree, waiting))
    return len(waiting.level)


@pytest.mark.parametrize("rung", [44, 60])
def test_tins_save_triangles_and_fit_their_neighbours(rung):
    tree = tree_of(65, 65, share=0.5)
    pool, patches = PatchPool(tree), whole(tree, 4, rung)
    before = len(pool.gather(patches))
    assert 0 < (tried := add_tins(pool, patches)) <= 0.5 * len(patches.level)
    assert add_tins(pool, patches) == 0
    assert 0 < pool.count_tins(patches) <= tried
    posts = pool.gather(patches)
    assert len(posts) < before
    edges, stride = edges_of(posts), tree.rtin.drop_rung.shape[1]
    for a, b in edges:  # an edge without a counterpart lies on the rim of the terrain: no T-vertices, no gaps
        if (b, a) not in edges:
            (ra, ca), (rb, cb) = divmod(a, stride), divmod(b, stride)
            assert (ra == rb and ra in (0, 64)) or (ca == cb and ca in (0, 64))


def test_patches_over_the_edge_stay_grids():
    tree = tree_of(50, 40)
    pool, patches = PatchPool(tree), whole(tree, 4, 48)
    add_tins(pool, patches)
    inside = ((patches.row + 1) * 16 < 50) & ((patches.col + 1) * 16 < 40)
    assert pool.count_tins(patches.take(~inside)) == 0
    assert pool.count_tins(patches.take(inside)) > 0


def test_preview_meshes_lie_on_every_fourth_post():
    tree = build_preview(tree_of(130, 67).heightfield)
    pool, patches = PatchPool(tree), whole(tree, FINEST_LEVEL, 0)
    posts = pool.gather(patches)
    assert posts.max() < tree.rtin.drop_rung.size
    assert add_tins(pool, patches) == 0
    mixed = patches._replace(rung=(patches.row % 2).astype(np.int32) * 60)
    assert len(pool.walls(mixed)) > 0
    assert len(pool.walls(patches)) == 0


def test_patches_with_lines_are_drawn_with_every_post_and_fit():
    plain = tree_of(65, 65)
    line = Breaklines((np.array([[3.5, 4.25, 9.0], [20.0, 4.25, 9.0], [29.75, 30.0, 12.0]]),))
    tree = replace(plain, refined=refine_cells(plain.heightfield, line, plain.rtin.drop_rung.shape, 6))
    patches = whole(tree, 3, 40)
    lined = tree.refined.index_of(patches.row, patches.col) >= 0
    patches = patches._replace(rung=np.where(lined, REFINED, 40).astype(np.int32))
    patches = patches.take(np.random.default_rng(1).permutation(len(lined)))
    pool = PatchPool(tree)
    posts = pool.gather(patches).reshape(-1, 3)
    edges_of(posts)
    assert set(range(65 * 65, 65 * 65 + len(tree.refined.vertices))) <= set(posts.ravel().tolist())
    some = patches.take(patches.rung == REFINED)
    np.testing.assert_array_equal(np.sort(pool.gather(some)), np.sort(tree.refined.triangles.ravel()))
    assert len(pool.walls(patches)) > 0
    first = patches.take((patches.rung != REFINED) | (patches.col == 0))
    assert len(pool.walls(first)) > len(PatchPool(plain).walls(first._replace(rung=first.rung)))  # fins
