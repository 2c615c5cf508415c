"""Cells refined by lines: the lines are edges of the mesh, their heights are kept, and nothing gapes."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from terrain.algorithms import refined_cells
from terrain.algorithms.cell_tin import UNITS
from terrain.algorithms.refined_cells import RefinedCells, load_refined, refine_cells, widened
from terrain.algorithms.rtin import padded_shape
from terrain.breaklines import Breaklines
from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.pyramid import build_pyramid

TOP = 5


def hills(rows: int = 33, cols: int = 41) -> Heightfield:
    row, col = np.indices((rows, cols))
    heights = 20 * np.sin(row / 4.0) * np.cos(col / 5.0) + np.random.default_rng(1).normal(0, 1, (rows, cols))
    return Heightfield(heights.astype(np.float32), (10.0, 10.0))


def refine(terrain: Heightfield, *lines) -> RefinedCells:
    points = [np.array([(*p, np.nan)[:3] for p in line], float) for line in lines]
    return refine_cells(terrain, Breaklines(tuple(points)), padded_shape(terrain.rows, terrain.cols, TOP), TOP)


def corners(terrain: Heightfield, refined: RefinedCells) -> np.ndarray:
    """(m, 3, 3): column, row and height of the corners of all triangles."""
    shape = padded_shape(terrain.rows, terrain.cols, TOP)
    row, col = (g.ravel() for g in np.indices(shape))
    inside = np.minimum(row, terrain.rows - 1), np.minimum(col, terrain.cols - 1)
    posts = np.column_stack([col, row, terrain.heights_m[inside]])
    return np.concatenate([posts, refined.vertices])[refined.triangles].astype(np.float64)


def doubled_areas(triangles: np.ndarray) -> np.ndarray:
    (x0, y0), (x1, y1), (x2, y2) = (triangles[:, i, :2].T for i in range(3))
    return (y1 - y0) * (x2 - x0) - (x1 - x0) * (y2 - y0)  # rows run downwards


def edges_of(triangles: np.ndarray) -> Counter:
    places = [[tuple(point[:2]) for point in triangle] for triangle in triangles.tolist()]
    return Counter((t[i], t[(i + 1) % 3]) for t in places for i in range(3))


def check_watertight(terrain: Heightfield, refined: RefinedCells) -> None:
    """Each patch is covered once, and only at the rims of refined patches beside plain ones may an edge stand alone."""
    triangles = corners(terrain, refined)
    assert (doubled_areas(triangles) > 0).all()
    for i in range(len(refined.patches)):
        own = triangles[refined.starts[i] : refined.starts[i + 1]]
        assert doubled_areas(own).sum() == pytest.approx(2 * 64)
    edges = edges_of(triangles)
    assert max(edges.values(), default=1) == 1
    patches = set(map(tuple, refined.patches.tolist()))
    for a, b in edges:
        if (b, a) in edges:
            continue
        middle_col, middle_row = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        if a[0] == b[0]:
            sides = [(int(middle_row // 8), int(a[0] // 8) - 1), (int(middle_row // 8), int(a[0] // 8))]
            assert a[0] % 8 == 0
        else:
            sides = [(int(a[1] // 8) - 1, int(middle_col // 8)), (int(a[1] // 8), int(middle_col // 8))]
            assert a[1] % 8 == 0
        assert sum(side in patches for side in sides) == 1


def covered_share(terrain: Heightfield, refined: RefinedCells, begin, end) -> float:
    """Share of a line from ``begin`` to ``end`` that edges of the mesh lie on, to within a unit or two."""
    begin, end = np.array(begin, float), np.array(end, float)
    length = np.hypot(*(end - begin))
    along = (end - begin) / length
    total = 0.0
    for a, b in edges_of(corners(terrain, refined)):
        a, b = np.array(a) - begin, np.array(b) - begin
        off = [abs(p[0] * along[1] - p[1] * along[0]) for p in (a, b)]
        s, t = sorted((a @ along, b @ along))
        if max(off) < 2 / UNITS and t > 0 and s < length:
            total += (min(t, length) - max(s, 0)) / 2  # every inner edge is there twice
    return total / length


def test_line_is_in_the_mesh_with_its_heights():
    terrain = hills()
    line = [(3.3, 4.7, 50.0), (12.6, 9.1, 60.0), (12.6, 20.4, 40.0)]
    refined = refine(terrain, line)
    check_watertight(terrain, refined)
    for (*begin, z0), (*end, z1) in pairwise(line):
        assert covered_share(terrain, refined, begin, end) == pytest.approx(1, abs=0.01)
        step = np.array(end) - begin
        t = (refined.vertices[:, :2] - begin) @ step / (step @ step)
        off = np.abs((refined.vertices[:, :2] - begin) @ [-step[1], step[0]]) / np.hypot(*step)
        on = (off < 2 / UNITS) & (t > -1e-3) & (t < 1 + 1e-3)
        assert on.sum() > 8
        np.testing.assert_allclose(refined.vertices[on, 2], z0 + t[on] * (z1 - z0), atol=0.02)


def test_line_without_heights_lies_on_the_surface():
    terrain = hills()
    refined = refine(terrain, [(2.25, 3.5), (20.75, 17.5)])
    col, row, height = refined.vertices.astype(np.float64).T
    np.testing.assert_allclose(height, terrain.heights_at(col * 10, row * 10), atol=1e-4)
    assert max(map(np.max, refined.departure_m)) < 5


coordinate = st.integers(-3 * 4, 44 * 4).map(lambda n: n / 4) | st.floats(-5, 45)


@settings(max_examples=60)
@given(lines=st.lists(st.lists(st.tuples(coordinate, coordinate, st.floats(-50, 50)), min_size=2, max_size=5),
                      min_size=1, max_size=3))  # fmt: skip
@example([[(0, 0, 0), (6.25, 30.421875, 0), (4.59765625, -4.2265625, 0), (22, 32.75, 0), (0.69921875, -3, 0)]])
def test_any_lines_leave_a_whole_mesh(lines):
    """Crossing, collinear and repeated ones, along edges of the grid, through posts, and partly outside."""
    check_watertight(terrain := hills(33, 41), refine(terrain, *lines))


@pytest.mark.parametrize(
    "lines",
    [
        [[(4, 4), (4, 12)], [(4, 8), (20, 8)]],
        [[(1, 1), (9, 9)], [(9, 1), (1, 9)]],
        [[(2.5, 2.5), (2.5, 2.5), (6.5, 2.5)], [(3.5, 2.5), (9.5, 2.5)]],
        [[(5.25, 5.25), (5.75, 5.75)], [(5.25, 5.75), (5.75, 5.25)], [(5.5, 5.1), (5.5, 5.9)]],
    ],
    ids=["along the grid", "through posts and across", "one over the other", "three in one cell"],
)
def test_awkward_lines_are_in_the_mesh(lines):
    terrain = hills()
    refined = refine(terrain, *lines)
    check_watertight(terrain, refined)
    if len(refined.triangles):
        for line in lines:
            assert covered_share(terrain, refined, line[0], line[-1]) == pytest.approx(1, abs=0.01)


def test_only_what_is_inside_counts():
    terrain = hills()
    inside = refine(terrain, [(5.5, 6.5, 1.0), (9.5, 6.5, 1.0)])
    assert len(refine(terrain, [(-9.5, -3.0), (-1.0, 50.0)]).patches) == 0
    assert len(refine(terrain, [(50.0, -10.0), (-10.0, 1e9)]).patches) <= 5
    partly = refine(terrain, [(-500.0, 6.5, 1.0), (9.5, 6.5, 1.0)])
    assert set(map(tuple, partly.vertices.tolist())) >= set(map(tuple, inside.vertices.tolist())) - {(5.5, 6.5, 1.0)}
    assert partly.vertices[:, 0].min() == 0


def test_bounds_and_departures_hold_the_lines():
    terrain = hills()
    refined = refine(terrain, [(5.5, 6.5, 500.0), (9.5, 6.5, 500.0)])
    pyramid = widened(build_pyramid(terrain.heights_m), refined)
    assert pyramid.maximum(3)[0, :2].tolist() == [500.0, 500.0]
    assert pyramid.maximum(pyramid.top_level)[0, 0] == 500.0
    assert refined.departure_m[0][0, 0] > 450
    assert refined.departure_m[-1].max() == refined.departure_m[0].max()
    assert refined.departure_m[0][2:].max() == 0


def test_fins_stand_only_beside_a_patch_drawn_without_the_line():
    refined = refine(hills(), [(5.5, 6.5, 30.0), (9.5, 6.5, 30.0)])
    assert refined.patches.tolist() == [[0, 0], [0, 1]]
    both = refined.index_of(np.array([0, 0, 3], np.int32), np.array([0, 1, 3], np.int32))
    assert both.tolist() == [0, 1, -1]
    assert len(refined.fins_of(both[:2])) == 0
    fins = refined.fins_of(both[:1])
    assert len(fins) == 2
    assert (fins[:, :, 0] == 8).all()


def test_a_crowd_of_lines_in_one_cell_is_refused():
    lines = [[(5 + i / 300, 5.0), (5 + i / 300, 6.0)] for i in range(1, 250)]
    with pytest.raises(InputError, match="simplify"):
        refine(hills(), *lines)


def test_refined_cells_from_the_cache_equal_those_made(own_cache, monkeypatch):
    monkeypatch.setattr(refined_cells, "KEPT_CELLS", 10)
    terrain, shape = hills(), padded_shape(33, 41, TOP)
    lines = Breaklines((np.array([[3.3, 4.7, 50.0], [25.6, 19.1, 60.0]]),))
    made = load_refined(terrain, lines, shape, TOP)
    monkeypatch.setattr(refined_cells, "refine_cells", None)  # not asked again
    kept = load_refined(terrain, lines, shape, TOP)
    assert kept.counts == made.counts
    for name in ("vertices", "patches", "triangles", "starts", "fins", "fin_patches", "cell_height_m"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(made, name))
    assert len(kept.departure_m) == len(made.departure_m)
    assert all(map(np.array_equal, kept.departure_m, made.departure_m))
    with pytest.raises(TypeError):
        load_refined(terrain, lines.scaled(2.0), shape, TOP)
