"""The triangulation is Delaunay and covers its square, whatever lies on one line or circle."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain.algorithms.delaunay import LARGEST, Delaunay


def exact_in_circle(a, b, c, p) -> int:
    """Sign of the in-circle determinant in Python's unbounded integers."""
    rows = [(q[0] - p[0], q[1] - p[1], (q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2) for q in (a, b, c)]
    (ax, ay, aq), (bx, by, bq), (cx, cy, cq) = rows
    return aq * (bx * cy - cx * by) - bq * (ax * cy - cx * ay) + cq * (ax * by - bx * ay)


def check(mesh: Delaunay) -> None:
    points = list(zip(mesh.x, mesh.y, strict=True))
    total = 0
    for triangle in mesh.used.tolist():
        a, b, c = (points[v] for v in triangle)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        assert area > 0  # counter-clockwise, no slivers of zero area
        total += area
        assert all(exact_in_circle(a, b, c, p) <= 0 for p in points)
    assert total == 2 * mesh.x[1] ** 2
    assert len(set(points)) == len(points)


@settings(max_examples=40)
@given(size=st.sampled_from([1, 2, 4, 7, LARGEST]), data=st.data())
def test_any_points_of_a_grid_give_a_delaunay_triangulation(size, data):
    mesh = Delaunay(size)
    places = st.tuples(st.integers(0, size), st.integers(0, size))
    for x, y in data.draw(st.lists(places, max_size=20, unique=True)):
        if (x, y) not in {(0, 0), (size, 0), (size, size), (0, size)}:
            mesh.add(x, y)
    check(mesh)


def test_full_grid_and_points_on_one_line():
    mesh = Delaunay(4)
    for x in range(5):
        for y in range(5):
            if (x % 4, y % 4) != (0, 0):
                mesh.add(x, y)
    check(mesh)
    assert mesh.count == 32
    rim = Delaunay(64)
    for x in range(1, 64):
        rim.add(x, 0)
    check(rim)


def test_change_tells_which_triangles_went_and_came():
    mesh = Delaunay(8)
    before = mesh.used.copy()
    change = mesh.add(4, 4)
    assert len(change.removed) == 2
    assert len(change.created) == 4
    assert (before[change.removed] >= 0).all()
    assert (mesh.triangles[change.created] == 4).any(axis=1).all()
    assert len(mesh.add(8, 4).created) == 3 - 1  # on the rim: one triangle becomes two


@pytest.mark.parametrize("point", [(-1, 0), (0, 9), (0, 0), (8, 8)])
def test_point_outside_or_there_already_is_refused(point):
    with pytest.raises(ValueError, match="point"):
        Delaunay(8).add(*point)
