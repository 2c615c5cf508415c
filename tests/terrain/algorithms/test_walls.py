"""Walls close exactly the gaps between patches: from the higher edge to the lower, on the side it is seen from."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.rtin import Rtin, build_rtin
from terrain.algorithms.rtin_mesh import Patches, extract_meshes
from terrain.algorithms.walls import build_walls

Spans = dict[tuple[bool, int, int], list[float]]


def rough(side: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(0, 1, (side, side)).cumsum(0).cumsum(1) / side * 20 + rng.normal(0, 2, (side, side))).astype(
        "f4"
    )


def random_patches(rng: np.random.Generator, spread: int, gaps: float) -> Patches:
    """A random quadtree over 64 cells with random rungs, some of it not drawn."""
    chosen, queue = [], [(4, r, c) for r in range(4) for c in range(4)]
    while queue:
        level, row, col = queue.pop()
        if level > 2 and rng.random() < 0.4:
            queue += [(level - 1, 2 * row + i, 2 * col + j) for i in (0, 1) for j in (0, 1)]
        elif rng.random() >= gaps:
            chosen.append((level, row, col, 30 + rng.integers(0, spread + 1)))
    return Patches(*np.array(chosen or [(4, 0, 0, 40)], np.int32).T)


def add_edge(spans: Spans, start: tuple, end: tuple) -> None:
    """Note the height at the middle of every cell side under a straight edge between (row, col, height) corners."""
    (ra, ca, ha), (rb, cb, hb) = start, end
    along_row = ra == rb
    if not along_row and ca != cb:
        return
    first, last = (ca, cb) if along_row else (ra, rb)
    for cell in range(int(min(first, last)), int(np.ceil(max(first, last)))):
        if min(first, last) <= cell + 0.5 <= max(first, last):
            t = (cell + 0.5 - first) / (last - first)
            spans[along_row, int(ra if along_row else ca), cell].append(ha + t * (hb - ha))


def gaps_of(rtin: Rtin, patches: Patches, heights: np.ndarray) -> Spans:
    """Heights of the edges that have no counterpart, at the middles of cell sides: two where there is a gap."""
    triangles, stride = extract_meshes(rtin, patches).triangles, rtin.drop_rung.shape[1]
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    present, spans = set(map(tuple, edges.tolist())), defaultdict(list)
    for a, b in present:
        if (b, a) not in present:
            (ra, ca), (rb, cb) = divmod(a, stride), divmod(b, stride)
            add_edge(spans, (ra, ca, float(heights[ra, ca])), (rb, cb, float(heights[rb, cb])))
    return spans


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), spread=st.integers(0, 60), gaps=st.floats(0, 0.3))
def test_walls_reach_from_the_higher_edge_to_the_lower_and_stand_nowhere_else(seed, spread, gaps):
    heights = rough(65, seed)
    rtin = build_rtin(heights, (1.0, 1.0), 4)
    patches = random_patches(np.random.default_rng(seed), spread, gaps)
    walls = build_walls(rtin, patches, 2, heights)
    uppers, lowers = defaultdict(list), defaultdict(list)
    for quad in walls.reshape(-1, 6, 5).astype(np.float64):
        assert np.sign(quad[:, 3]).tolist() == [1, -1, -1, 1, -1, 1]
        assert len(set(np.abs(quad[:, 3]).tolist())) == 1
        for spans, here, there in ((uppers, quad[0], quad[5]), (lowers, quad[1], quad[2])):
            add_edge(spans, *((c[1], c[0], c[2] + c[4]) for c in (here, there)))
    expected = {place: sorted(pair) for place, pair in gaps_of(rtin, patches, heights).items() if len(pair) == 2}
    for place, (low, high) in expected.items():
        if high - low > 1e-3:
            assert abs(max(uppers[place]) - high) < 1e-3
            assert abs(min(lowers[place]) - low) < 1e-3
    for place, tops in uppers.items():
        low, high = expected.get(place, (0.0, 0.0))
        assert max(tops) - min(lowers[place]) <= high - low + 1e-3


def test_wall_faces_the_lower_patch():
    heights = np.zeros((33, 33), np.float32)
    heights[8, 16] = 5.0  # a peak on the edge between two patches; the coarser one passes below it
    rtin = build_rtin(heights, (1.0, 1.0), 4)
    for rungs, facing in (((0, 200), 1.0), ((200, 0), -1.0)):
        patches = Patches(*np.array([[4, 4], [0, 0], [0, 1], rungs], np.int32))
        walls = build_walls(rtin, patches, 4, heights)
        assert len(walls)
        walls[..., 2] += walls[..., 4]
        corners = walls[:, :, [0, 2, 1]].astype(np.float64)  # x east, y up, z south
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (normals[:, 0] * facing >= 0).all()
        assert (normals[:, 0] * facing > 0).any()
        assert not normals[:, 1:].any()
        upright = normals.any(axis=1)  # beside them, level edges have a vertex more on one side
        assert set(np.abs(walls[upright, :, 3]).ravel().tolist()) == {4.0 if facing > 0 else 3.0}  # east, west


def test_patches_that_fit_and_patches_alone_have_no_walls():
    heights = rough(33, 6)
    rtin = build_rtin(heights, (1.0, 1.0), 4)
    both = Patches(*np.array([[4, 4], [0, 0], [0, 1], [0, 70]], np.int32))
    assert len(build_walls(rtin, both, 4, heights))
    assert not len(build_walls(rtin, both._replace(rung=np.array([40, 40], np.int32)), 4, heights))
    assert not len(build_walls(rtin, both.take(np.array([0])), 4, heights))
    assert not len(build_walls(rtin, both.take(np.arange(0)), 4, heights))
