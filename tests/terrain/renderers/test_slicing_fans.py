"""Fans cover the ground once, and tiles meet whatever their size and stride."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.algorithms.slicing_tree import Nodes
from terrain.renderers.slicing_fans import build_fan_indices, split_nodes
from terrain.renderers.tile_mesh import build_tile_indices


@pytest.mark.parametrize(("cells", "stride"), [(8, 1), (8, 4), (16, 2), (32, 8)])
@pytest.mark.parametrize("step", [1, 2])
def test_fans_cover_their_tile_once(cells: int, stride: int, step: int) -> None:
    step = min(step, stride)
    corners = build_fan_indices(cells, stride, step).reshape(-1, 3)
    row, col = np.divmod(corners.astype(np.int64), cells + 1)
    twice = (row[:, 1] - row[:, 0]) * (col[:, 2] - col[:, 0]) - (col[:, 1] - col[:, 0]) * (row[:, 2] - row[:, 0])
    assert (twice > 0).all(), "counter-clockwise from above"
    assert twice.sum() == 2 * cells * cells
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    inner = {tuple(e) for e in edges.tolist()}
    rims = [(a, b) for a, b in inner if (b, a) not in inner]
    assert len(rims) == 4 * cells // step, "open edges are those of the border alone"


def test_fans_of_single_cells_are_the_triangles_of_the_surface() -> None:
    def sets(indices: np.ndarray) -> set[frozenset[int]]:
        return {frozenset(t) for t in indices.reshape(-1, 3).tolist()}

    assert sets(build_fan_indices(8, 1, 1)) == sets(build_tile_indices(8))


def test_nodes_split_into_the_tiles_inside_the_grid() -> None:
    nodes = Nodes(*(np.array(a, np.int32) for a in ([5, 3], [0, 6], [0, 1])))
    posts = split_nodes(nodes, 3, (100, 24))
    assert len(posts) == 4 * 3 + 1
    assert posts.max(axis=0).tolist() == [16, 48]
    assert len(np.unique(posts, axis=0)) == len(posts)
