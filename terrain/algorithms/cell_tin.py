"""The TIN of one cell of the reference grid that lines cross: its corners, the lines' points, the lines as edges.

Most cells are crossed from side to side: the lines then cut the cell in convex parts. Where a line ends, bends or meets
another inside the cell, points are inserted one by one, and where a piece of a line is no edge yet, its middle.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Characteristics of hybrid terrain models".
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise

from terrain.algorithms.delaunay import Delaunay

Point = tuple[int, int]  # col, row in units
Piece = tuple[Point, Point]
Triangle = tuple[Point, Point, Point]  # counter-clockwise from above

UNITS = 1024
"""Lines are kept to 1 / UNITS of a post: float32 holds that exactly up to 16384 posts, and `Delaunay` is exact."""


def triangulate_cell(
    cell: tuple[int, int], points: set[Point], pieces: list[Piece], height_of: dict[Point, float]
) -> list[Triangle]:
    """Triangles of one cell.

    Parameters
    ----------
    cell : tuple of int
        Row and column of its north-west post.
    points : set of Point
        The lines' points inside the cell and on its sides, without posts.
    pieces : list of Piece
        The lines inside the cell, straight from point to point.
    height_of : dict
        Heights [m] of all points; what further points the triangles need is added.
    """
    row, col = cell
    corners = [(col, row), (col + 1, row), (col + 1, row + 1), (col, row + 1)]
    rim = [(c * UNITS, r * UNITS) for c, r in corners]
    ends = {end for piece in pieces for end in piece}
    if points <= ends and all(_on_rim(end, rim) for end in ends):
        parts = _cut_across(rim, ends, pieces)
        if parts is not None:
            return parts
    return _conforming(rim, points, pieces, height_of)


def _on_rim(point: Point, rim: list[Point]) -> bool:
    return point[0] in (rim[0][0], rim[2][0]) or point[1] in (rim[0][1], rim[2][1])


def _cut_across(rim: list[Point], ends: set[Point], pieces: list[Piece]) -> list[Triangle] | None:
    """A square cut by lines from rim to rim, the common case: all parts are convex. None where two lines cross."""
    (west, north), (east, south) = rim[0], rim[2]

    def along(point: Point) -> int:  # clockwise as seen from above, from the north-west corner
        col, row = point
        if row == north:
            return col - west
        if col == east:
            return UNITS + row - north
        return 2 * UNITS + east - col if row == south else 3 * UNITS + south - row

    parts = [sorted({*rim, *ends}, key=along)]
    for one, other in pieces:
        whole = next((part for part in parts if one in part and other in part), None)
        if whole is None:
            return None
        i, j = sorted((whole.index(one), whole.index(other)))
        parts.remove(whole)
        parts += [half for half in (whole[i : j + 1], whole[j:] + whole[: i + 1]) if len(half) > 2]
    return [(part[0], part[k + 1], part[k]) for part in parts for k in range(1, len(part) - 1)]


def _conforming(
    rim: list[Point], points: set[Point], pieces: list[Piece], height_of: dict[Point, float]
) -> list[Triangle]:
    """A Delaunay triangulation that has every piece as edges: where one is missing, its middle is added."""
    (west, north), (east, south) = rim[0], rim[2]
    mesh = Delaunay(UNITS)
    places = list(rim)
    known = set(rim)

    def add(point: Point, height: float) -> None:
        if point not in known:
            known.add(point)
            places.append(point)
            height_of.setdefault(point, height)
            mesh.add(point[0] - west, point[1] - north)

    def add_inside(point: Point, height: float) -> Point:
        """Rounding must not put a new point on a side: the cell beyond would lack it."""
        if point not in known:
            point = min(max(point[0], west + 1), east - 1), min(max(point[1], north + 1), south - 1)
        add(point, height)
        return point

    for point in sorted(points):
        add(point, height_of[point])
    parts = _without_crossings(pieces, add_inside, height_of)
    waiting = [smaller for part in parts for smaller in _at_points(part, places)]
    edges: set[tuple[Point, Point]] | None = None
    while waiting:
        one, other = waiting.pop()
        if edges is None:
            edges = {(places[a], places[b]) for t in mesh.used.tolist() for a, b in zip(t, t[1:] + t[:1], strict=True)}
        middle = (one[0] + other[0]) // 2, (one[1] + other[1]) // 2
        if (one, other) in edges or (other, one) in edges or middle in (one, other):
            continue
        if middle not in known:
            middle = add_inside(middle, (height_of[one] + height_of[other]) / 2)
            edges = None
        waiting += [(one, middle), (middle, other)]
    return [(places[c], places[b], places[a]) for a, b, c in mesh.used.tolist()]


def _without_crossings(
    pieces: list[Piece], add: Callable[[Point, float], Point], height_of: dict[Point, float]
) -> list[Piece]:
    """The pieces, cut where two cross; there the height is the mean of both."""
    cuts: dict[Piece, list[Point]] = {piece: [] for piece in pieces}
    for one, other in combinations(pieces, 2):
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = *one, *other
        turn = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
        if turn == 0:
            continue
        s = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / turn
        t = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / turn
        if 0 < s < 1 and 0 < t < 1:
            place = round(ax + s * (bx - ax)), round(ay + s * (by - ay))
            heights = [height_of[p] + k * (height_of[q] - height_of[p]) for (p, q), k in ((one, s), (other, t))]
            place = add(place, sum(heights) / 2)
            cuts[one].append(place)
            cuts[other].append(place)
    parts = []
    for (begin, end), inside in cuts.items():
        chain = sorted({begin, end, *inside}, key=lambda p: (p[0] - begin[0]) ** 2 + (p[1] - begin[1]) ** 2)
        parts += list(pairwise(chain))
    return parts


def _at_points(piece: Piece, places: list[Point]) -> list[Piece]:
    """A piece, cut at the points that lie on it."""
    (ax, ay), (bx, by) = piece
    across, along = bx - ax, by - ay
    on = []
    for x, y in places:
        reach = (x - ax) * across + (y - ay) * along
        if across * (y - ay) == along * (x - ax) and 0 <= reach <= across**2 + along**2:
            on.append((reach, (x, y)))
    chain = [point for _, point in sorted(on)]
    return list(pairwise(chain))
