"""TIN patches: greedy insertion, worst point first, inside a square of posts with a given rim.

A TIN patch takes the place of the adaptive grid patch of the same square and the same allowed error. Doellner's three
conditions hold by construction: its domain is the square; the corners are posts, with the posts' heights; and its rim
has exactly the vertices the grid patch has there, so that whatever fits the one fits the other without a T-vertex.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", sections
"Characteristics of hybrid terrain models" and "Approximation strategies"; greedy insertion after M. van Kreveld,
"Digital elevation models and TIN algorithms" (1997).

**Deviations** The paper stops at zero error or s points; here a TIN is made for an allowed error, and given up where it
needs more than s points. Its edges cut across the surface's cells, so the error is checked at every post *and* wherever
an edge of the TIN crosses an edge of the surface: between those both are flat, and the bound is exact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.delaunay import Change, Delaunay
from terrain.heightfield import surface_heights

Grid = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Tin(NamedTuple):
    """A triangulated patch.

    Attributes
    ----------
    col, row : ndarray of int64, (n,)
        The points, all of them posts, from the patch's north-west corner.
    height_m : ndarray of float64, (n,)
    triangles : ndarray of int64, (m, 3)
        Counter-clockwise from above.
    """

    col: Ints
    row: Ints
    height_m: Floats
    triangles: Ints


def greedy_tin(heights_m: Grid, rim: Bools, error_m: float, max_points: int) -> Tin | None:
    """The TIN of a square of posts that departs nowhere from the surface by more than ``error_m``.

    Parameters
    ----------
    heights_m : ndarray of float32, (n + 1, n + 1)
        Posts of the patch. Its first post lies on an even row and column of the terrain, so that the diagonals
        alternate as there.
    rim : ndarray of bool, (n + 1, n + 1)
        The posts of the rim to be vertices; only the outermost rows and columns are read. Corners always are.
    error_m : float
    max_points : int
        The paper's s.

    Returns
    -------
    Tin or None
        None where ``max_points`` points, or the rim, do not allow ``error_m``.
    """
    fit = _Fit(heights_m)
    fit.add_rim(rim)
    size = len(heights_m) - 1
    while True:
        worst = fit.worst_post()
        if fit.error[worst] > error_m:
            place = divmod(worst, size + 1)
        else:
            triangles = _with_surface_diagonals(fit.mesh.used, fit.post_of_vertex(), size)
            crossing = _worst_crossing(fit, triangles, error_m)
            if crossing is None:
                return fit.tin(triangles)
            free = [p for p in crossing if not fit.is_vertex[p] and 0 < p[0] < size and 0 < p[1] < size]
            if not free:
                return None
            place = max(free, key=lambda p: float(fit.error[p[0] * (size + 1) + p[1]]))
        if len(fit.z) >= max_points:
            return None
        fit.add(*place)


class _Fit:
    """A growing triangulation and, for every post, the triangle it lies in and its error there."""

    def __init__(self, heights_m: Grid) -> None:
        side = len(heights_m)
        self.surface = heights_m
        self.heights = heights_m.astype(np.float64).ravel()
        self.row, self.col = (g.ravel() for g in np.indices(heights_m.shape))
        self.mesh = Delaunay(side - 1)
        self.z: list[float] = [float(heights_m[r, c]) for r, c in ((0, 0), (0, -1), (-1, -1), (-1, 0))]
        self.is_vertex = np.zeros(heights_m.shape, np.bool_)
        self.is_vertex[[0, 0, -1, -1], [0, -1, -1, 0]] = True
        self.interior = np.zeros(heights_m.shape, np.bool_)
        self.interior[1:-1, 1:-1] = True
        self.owner = np.zeros(len(self.heights), np.int64)
        self.error = np.zeros(len(self.heights))
        self._assign(np.arange(len(self.heights)), np.arange(self.mesh.count))

    def add_rim(self, rim: Bools) -> None:
        """Insert the chosen posts of the outermost rows and columns."""
        chosen = rim & ~self.interior & ~self.is_vertex
        for row, col in np.argwhere(chosen).tolist():
            self.add(row, col)

    def add(self, row: int, col: int) -> None:
        """Insert a post that is no vertex yet."""
        self.is_vertex[row, col] = True
        change: Change = self.mesh.add(col, row)
        self.z.append(float(self.surface[row, col]))
        gone = np.zeros(len(self.mesh.triangles), np.bool_)
        gone[change.removed] = True
        self._assign(np.flatnonzero(gone[self.owner]), change.created)

    def worst_post(self) -> int:
        """The post inside the rim with the largest error. (The rim's own error is the neighbours' affair too.)"""
        return int(np.argmax(np.where(self.interior.ravel(), self.error, -1.0)))

    def post_of_vertex(self) -> Ints:
        """Row times side plus column of every vertex, all of them posts."""
        return np.array(self.mesh.y) * len(self.surface) + np.array(self.mesh.x)

    def tin(self, triangles: Ints) -> Tin:
        """The result; rows run downwards, so that counter-clockwise becomes clockwise and is turned round."""
        return Tin(np.array(self.mesh.x), np.array(self.mesh.y), np.array(self.z), triangles[:, ::-1])

    def _assign(self, posts: Ints, triangles: Ints) -> None:
        """Find the triangle of each post among some, and its error there."""
        corners = self.mesh.triangles[triangles]
        x, y = np.array(self.mesh.x)[corners], np.array(self.mesh.y)[corners]
        dx, dy = np.roll(x, -1, axis=1) - x, np.roll(y, -1, axis=1) - y
        px, py = self.col[posts, None, None], self.row[posts, None, None]
        side = dx * (py - y) - dy * (px - x)  # (post, triangle, edge): twice the area towards each edge
        home = np.argmax(side.min(axis=2) >= 0, axis=1)
        areas = side[np.arange(len(posts)), home][:, [1, 2, 0]]  # opposite to each corner
        z = np.array(self.z)[corners][home]
        self.owner[posts] = triangles[home]
        surface = (areas * z).sum(axis=1) / areas.sum(axis=1)
        self.error[posts] = np.abs(surface - self.heights[posts])


def _with_surface_diagonals(triangles: Ints, post: Ints, size: int) -> Ints:
    """The triangles, with every whole unit cell cut the way the surface cuts it (Delaunay leaves that open)."""
    row, col = np.divmod(post[triangles], size + 1)
    unit = (np.ptp(row, axis=1) == 1) & (np.ptp(col, axis=1) == 1)
    cell_row, cell_col = row.min(axis=1), col.min(axis=1)
    cell = np.where(unit, cell_row * size + cell_col, -1)
    order = np.argsort(cell, kind="stable")
    pair = np.flatnonzero((cell[order][1:] == cell[order][:-1]) & (cell[order][1:] >= 0))
    if not len(pair):
        return triangles
    one, other = order[pair], order[pair + 1]
    r, c = cell_row[one], cell_col[one]
    vertex_at = np.full((size + 1) ** 2, -1, np.int64)
    vertex_at[post] = np.arange(len(post))
    nw, ne, sw, se = (vertex_at[(r + i) * (size + 1) + c + j] for i in (0, 1) for j in (0, 1))
    even = ((r + c) % 2 == 0)[:, None]
    result = triangles.copy()
    # Counter-clockwise with y growing along the rows, as all triangles of the mesh.
    result[one] = np.where(even, np.stack([nw, ne, se], 1), np.stack([nw, ne, sw], 1))
    result[other] = np.where(even, np.stack([nw, se, sw], 1), np.stack([ne, se, sw], 1))
    return result


def _worst_crossing(fit: _Fit, triangles: Ints, error_m: float) -> list[tuple[int, int]] | None:
    """The posts (row, col) of the cell where an edge of the TIN departs most from the surface, if by too much."""
    side = len(fit.surface)
    edges = np.unique(
        np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), 1), axis=0
    )
    post = fit.post_of_vertex()
    (r0, r1), (c0, c1) = (np.divmod(post[edges], side)[i].T for i in (0, 1))
    along_grid = (r0 == r1) | (c0 == c1)  # runs along edges of the surface, and posts are checked already
    r0, r1, c0, c1 = (a[~along_grid] for a in (r0, r1, c0, c1))
    z = np.array(fit.z)[edges[~along_grid]]
    owners, places = [], []
    for start, end in ((c0, c1), (r0, r1), (c0 + r0, c1 + r1), (c0 - r0, c1 - r1)):
        count = np.maximum(np.abs(end - start) - 1, 0)  # lines of this family strictly between the ends
        owner = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count) + 1
        owners.append(owner)
        places.append(step / np.abs(end - start)[owner])
    owner, t = np.concatenate(owners), np.concatenate(places)
    if not len(owner):
        return None
    col, row = c0[owner] + t * (c1 - c0)[owner], r0[owner] + t * (r1 - r0)[owner]
    cell_row, cell_col = (np.minimum(a.astype(np.int64), side - 2) for a in (row, col))
    height = z[owner, 0] + t * (z[owner, 1] - z[owner, 0])
    error = np.abs(height - surface_heights(fit.surface, col, row))
    worst = int(np.argmax(error))
    if error[worst] <= error_m:
        return None
    r, c = int(cell_row[worst]), int(cell_col[worst])
    return [(r + i, c + j) for i in (0, 1) for j in (0, 1)]
