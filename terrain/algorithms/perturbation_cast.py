"""The ray caster in float64 numpy: the paper's CPU version, and the oracle its GPU version is judged by.

All rays advance together: each step takes every ray that is still under way either past the node it is in, or one level
down into it, or through the surface of one cell. Map coordinates ``(u, v, h)`` as in `perturbation`; a ray is
``origin + t direction``, and t may count in any unit.

A hit is where a ray passes from above the surface to below it. A ray that starts below, under the ground or at the
map's open side, first has to come up: a surface seen from behind is not drawn, here as by every other renderer.

**Source**: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering", section 3.

**Deviations**

* The paper halves the bar of a pixel from front to back (equation 11) and looks up one address for each half. Here the
  bar is cut where the ray leaves a node of the pyramid, so that its projection never covers more than that node.
* The paper stops at the level whose cell is as long as the bar's projection (equation 12). Here it stops where half the
  distance between a node's two planes projects to less than the tolerance, which bounds the error on steep ground too;
  the surface is then the plane halfway between.
* At the last level the intersection is exact, for triangles, the bilinear and the bicubic (Catmull-Rom) surface.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.perturbation import Bounds, Floats, Interpolation, Single
from terrain.heightfield import surface_heights

Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_ROOT_WIDTH = 1e-13  # a root is known to this share of the ray's way through the cell


class Hits(NamedTuple):
    """What rays met: ``t`` (n,), inf for nothing; ``cell`` (n, 2) as (col, row), -1 for nothing; ``steps`` (n,)."""

    t: Floats
    cell: Ints
    steps: Ints


def surface_at(heights: Single, interpolation: Interpolation, u: Floats, v: Floats) -> Floats:
    """Height [m] of the surface at fractional posts (u, v), any shape; positions outside are moved to the rim."""
    rows, cols = heights.shape
    u, v = np.clip(u, 0, cols - 1), np.clip(v, 0, rows - 1)
    if interpolation == "triangles":
        return surface_heights(heights, u, v)
    col, row = np.minimum(u.astype(np.int64), cols - 2), np.minimum(v.astype(np.int64), rows - 2)
    reach, weights = ((0, 2), _linear_weights) if interpolation == "bilinear" else ((-1, 3), _catmull_rom_weights)
    along_u, along_v = weights(u - col), weights(v - row)
    height = np.zeros_like(u)
    for i, dv in enumerate(range(*reach)):
        for j, du in enumerate(range(*reach)):
            posts = heights[np.clip(row + dv, 0, rows - 1), np.clip(col + du, 0, cols - 1)]
            height += along_v[i] * along_u[j] * posts
    return height


def cast_rays(
    heights: Single, bounds: Bounds, origin: Floats, direction: Floats, *, interpolation: Interpolation = "triangles",
    t_start: float = 0.0, thickness_per_m: float = 0.0, cell_m: tuple[float, float] = (1.0, 1.0),
) -> Hits:  # fmt: skip
    """First hit of every ray.

    Parameters
    ----------
    heights : ndarray of float32, (rows, cols)
    bounds : Bounds
        `build_bounds` of the same heights and interpolation.
    origin, direction : ndarray of float64, (n, 3)
        Map coordinates ``(u, v, h)``; directions need not be unit vectors.
    interpolation : {"triangles", "bilinear", "bicubic"}
    t_start : float
        Where rays begin.
    thickness_per_m : float
        Level of detail: a node whose planes are no further apart than this times its distance from the ray's origin
        counts as its middle plane. Of such nodes in one another the widest counts.
    cell_m : tuple of float
        ``(du, dv)``, the size of a cell: what makes a distance of map coordinates.
    """
    rays = _Rays(heights, bounds, interpolation, origin, direction, t_start, thickness_per_m, cell_m)
    while rays.index.size:
        at_node = rays.level > 0
        rays.cross_nodes(np.flatnonzero(at_node))
        rays.cross_cells(np.flatnonzero(~at_node))
        rays.drop_done()
    return rays.hits


class _Rays:
    """The rays still under way; every array has one entry for each, and `index` tells which ray it is."""

    def __init__(
        self, heights: Single, bounds: Bounds, interpolation: Interpolation, origin: Floats, direction: Floats,
        t_start: float, thickness_per_m: float, cell_m: tuple[float, float],
    ) -> None:  # fmt: skip
        count = len(origin)
        self.heights, self.interpolation = heights, interpolation
        self.hits = Hits(np.full(count, np.inf), np.full((count, 2), -1, np.int64), np.zeros(count, np.int64))
        self.top, self.last_cell = len(bounds.levels), np.array(bounds.cells[::-1]) - 1
        self.nodes = np.concatenate([level.reshape(-1, 4) for level in bounds.levels])
        self.first_node = np.cumsum([0, *(level.shape[0] * level.shape[1] for level in bounds.levels)])
        self.node_cols = np.array([level.shape[1] for level in bounds.levels])

        lowest = np.array([0.0, 0.0, bounds.range_m[0]])
        highest = np.array([bounds.cells[1], bounds.cells[0], bounds.range_m[1]])
        still = direction == 0.0  # along an axis a ray is between the sides for every t, or for none
        moving = np.where(still, 1.0, direction)
        at_lowest, at_highest = (lowest - origin) / moving, (highest - origin) / moving
        self.metres = np.array([*cell_m, 1.0])
        self.thickness_per_m = thickness_per_m
        # A middle plane may lie half the allowed thickness below everything, and that grows with t.
        falling = direction[:, 2] + 0.5 * thickness_per_m * np.linalg.norm(direction * self.metres, axis=1)
        far = np.where(falling < 0.0, (lowest[2] - origin[:, 2]) / np.where(falling < 0.0, falling, -1.0), np.inf)
        at_lowest[:, 2] = np.where(direction[:, 2] < 0.0, far, at_lowest[:, 2])
        sides = np.sort([at_lowest, at_highest], axis=0)
        between = (lowest <= origin) & (origin <= highest)
        enter = np.where(still, np.where(between, -np.inf, np.inf), sides[0])
        leave = np.where(still, np.inf, sides[1])
        self.index = np.arange(count)
        self.origin, self.direction = origin, direction
        self.t = np.maximum(enter.max(axis=1), t_start)
        self.t_end = leave.min(axis=1)
        self.level = np.full(count, self.top)
        self.cell = np.zeros((count, 2), np.int64)
        self.is_above = np.ones(count, np.bool_)
        self.is_done = ~(self.t < self.t_end)
        self.drop_done()
        start = self._point(slice(None), self.t)
        self.cell = np.clip(np.floor(start[:, :2]).astype(np.int64), 0, self.last_cell)
        self.is_above = start[:, 2] > surface_at(heights, interpolation, start[:, 0], start[:, 1])

    def drop_done(self) -> None:
        """Keep the rays that are still under way."""
        if self.is_done.any():
            keep = ~self.is_done
            for name in ("index", "origin", "direction", "t", "t_end", "level", "cell", "is_above"):
                setattr(self, name, getattr(self, name)[keep])
            self.is_done = np.zeros(len(self.index), np.bool_)

    def cross_nodes(self, i: Ints) -> None:
        """Past the node, where the ray stays on its side of the bound; else to the bound and one level down."""
        if not i.size:
            return
        self.hits.steps[self.index[i]] += 1
        o, d, t = self.origin[i], self.direction[i], self.t[i]
        a, b, upper, lower, is_thin = self._widest_thin(i)
        level = self.level[i]
        corner, size = self.cell[i] >> level[:, None] << level[:, None], 1 << level
        t1, axis = self._exit(i, corner, size)

        bound = np.where(is_thin, 0.5 * (upper + lower), np.where(self.is_above[i], upper, lower))
        slope = d[:, 2] - a * d[:, 0] - b * d[:, 1]
        gap = o[:, 2] - bound - a * (o[:, 0] - corner[:, 0]) - b * (o[:, 1] - corner[:, 1])
        gap0, gap1 = gap + slope * t, gap + slope * t1
        side = np.where(self.is_above[i], 1.0, -1.0)
        is_clear = np.minimum(side * gap0, side * gap1) > 0.0
        root = _root(gap0, gap1, t, t1)

        # Middle planes of neighbours do not meet: below one at its rim is a hit too, the step between them.
        falls = np.where(self.is_above[i], np.minimum(gap0, gap1) <= 0.0, (gap0 > 0.0) & (gap1 <= 0.0))
        hit = is_thin & falls
        passed = is_clear | (is_thin & ~hit)
        self._finish(i[hit], root[hit])
        self.is_above[i[is_thin]] = gap1[is_thin] > 0.0
        self._advance(i[passed], t1[passed], axis[passed], corner[passed], size[passed])
        down = ~hit & ~passed
        into = i[down]
        self.t[into] = np.where(side * gap0 > 0.0, root, t)[down]
        self.level[into] -= 1
        self.cell[into] = self._cell_inside(into, corner[down], size[down])

    def _widest_thin(self, i: Ints) -> tuple[Floats, Floats, Floats, Floats, Flags]:
        """The planes of the rays' nodes, and whether they are thin.

        Of thin nodes in one another always the widest counts, whichever way the ray came, and whether a node is thin is
        a matter of the node and not of the ray: or neighbouring rays would see different surfaces, and gaps between.
        """
        planes, is_thin = self._planes(i, self.level[i])
        rising = np.flatnonzero(is_thin & (self.level[i] < self.top))
        while rising.size:
            wider, still = self._planes(i[rising], self.level[i[rising]] + 1)
            rising = rising[still]
            planes[rising] = wider[still]
            self.level[i[rising]] += 1
            rising = rising[self.level[i[rising]] < self.top]
        a, b, upper, lower = planes.T
        return a, b, upper, lower, is_thin

    def _planes(self, i: Ints, level: Ints) -> tuple[Floats, Flags]:
        """The bounding planes (n, 4) of the rays' nodes at given levels, and whether they are close together."""
        node = self.cell[i] >> level[:, None]
        flat = self.first_node[level - 1] + node[:, 1] * self.node_cols[level - 1] + node[:, 0]
        planes = self.nodes[flat].astype(np.float64)
        # No more than the distance to any point of the upper plane.
        half, slope = np.ldexp(0.5, level), planes[:, :2].T
        height = planes[:, 2] + half * slope.sum(axis=0)
        centre = np.column_stack([2.0 * half[:, None] * node + half[:, None], height]) - self.origin[i]
        reach = np.column_stack([half, half, half * np.abs(slope).sum(axis=0)])
        least_m = np.linalg.norm(centre * self.metres, axis=1) - np.linalg.norm(reach * self.metres, axis=1)
        return planes, planes[:, 2] - planes[:, 3] <= self.thickness_per_m * least_m

    def cross_cells(self, i: Ints) -> None:
        """Through the surface of one cell."""
        if not i.size:
            return
        self.hits.steps[self.index[i]] += 1
        corner, size = self.cell[i], np.ones(len(i), np.int64)
        t1, axis = self._exit(i, corner, size)
        if self.interpolation == "triangles":
            t_hit, is_above = self._cross_triangles(i, t1)
        else:
            t_hit, is_above = self._cross_patch(i, t1)
        hit = np.isfinite(t_hit)
        self._finish(i[hit], t_hit[hit])
        self.is_above[i] = is_above
        self._advance(i[~hit], t1[~hit], axis[~hit], corner[~hit], size[~hit])

    def _cross_triangles(self, i: Ints, t1: Floats) -> tuple[Floats, Flags]:
        """Both triangles of a cell: along the ray the gap is linear on either side of the diagonal."""
        t0, is_above = self.t[i], self.is_above[i]
        col, row = self.cell[i].T
        nw, ne = self.heights[row, col].astype(np.float64), self.heights[row, col + 1].astype(np.float64)
        sw, se = self.heights[row + 1, col].astype(np.float64), self.heights[row + 1, col + 1].astype(np.float64)
        # Seen in a mirror, a SW-NE diagonal is a NW-SE one: u = v in either case.
        mirror = (col + row) % 2 == 1
        nw, ne, sw, se = (
            np.where(mirror, ne, nw), np.where(mirror, nw, ne), np.where(mirror, se, sw), np.where(mirror, sw, se)
        )  # fmt: skip

        def gap(t: Floats) -> tuple[Floats, Floats]:
            u, v, h = self._point(i, t).T
            u, v = u - col, v - row
            u = np.where(mirror, 1.0 - u, u)
            height = nw + (ne - nw) * u + (sw - nw) * v + (nw + se - ne - sw) * np.minimum(u, v)
            return h - height, u - v

        (gap0, east0), (gap1, east1) = gap(t0), gap(t1)
        middle = np.where(east0 * east1 < 0.0, _root(east0, east1, t0, t1), t1)
        gap_middle = gap(middle)[0]
        first = is_above & (gap_middle <= 0.0)
        second = (gap_middle > 0.0) & (gap1 <= 0.0)
        t_hit = np.where(second, _root(gap_middle, gap1, middle, t1), np.inf)
        return np.where(first, _root(gap0, gap_middle, t0, middle), t_hit), gap1 > 0.0

    def _cross_patch(self, i: Ints, t1: Floats) -> tuple[Floats, Flags]:
        """A bilinear or bicubic cell: along the ray the gap is a polynomial of degree 2 or 6."""
        degree = 2 if self.interpolation == "bilinear" else 6
        t0 = self.t[i]
        share = np.linspace(0.0, 1.0, degree + 1)
        point = self._point(np.repeat(i, degree + 1), (t0[:, None] + (t1 - t0)[:, None] * share).ravel())
        # The cell's own polynomial: on its rim the neighbour's has the same value.
        u, v = (np.clip(point[:, k], np.repeat(self.cell[i, k], degree + 1), None) for k in (0, 1))
        u, v = (np.minimum(p, np.repeat(self.cell[i, k] + 1, degree + 1)) for k, p in enumerate((u, v)))
        gap = (point[:, 2] - surface_at(self.heights, self.interpolation, u, v)).reshape(-1, degree + 1)
        basis = np.array([[comb(degree, k) * s**k * (1 - s) ** (degree - k) for k in range(degree + 1)] for s in share])
        share_hit, is_above = first_descent(gap @ np.linalg.inv(basis).T, self.is_above[i])
        hit = np.isfinite(share_hit)
        return np.where(hit, t0 + (t1 - t0) * np.where(hit, share_hit, 0.0), np.inf), is_above

    def _point(self, i: Ints | slice, t: Floats) -> Floats:
        return self.origin[i] + self.direction[i] * t[:, None]

    def _exit(self, i: Ints, corner: Ints, size: Ints) -> tuple[Floats, Ints]:
        """Where rays leave their squares, and through which axis: 0 east or west, 1 north or south, -1 the end."""
        d = self.direction[i, :2]
        far = corner + np.where(d > 0.0, size[:, None], 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            leave = np.where(d == 0.0, np.inf, (far - self.origin[i, :2]) / d)
        axis = (leave[:, 1] < leave[:, 0]).astype(np.int64)
        t1 = np.minimum(leave.min(axis=1), self.t_end[i])
        return np.maximum(t1, self.t[i]), np.where(leave.min(axis=1) < self.t_end[i], axis, -1)

    def _cell_inside(self, i: Ints, corner: Ints, size: Ints) -> Ints:
        at = np.floor(self._point(i, self.t[i])[:, :2]).astype(np.int64)
        return np.clip(at, corner, np.minimum(corner + size[:, None] - 1, self.last_cell))

    def _advance(self, i: Ints, t1: Floats, axis: Ints, corner: Ints, size: Ints) -> None:
        """Into the next square of the same size, and one level up where that lies in another parent."""
        self.t[i] = t1
        cell = self._cell_inside(i, corner, size)
        for k in (0, 1):
            forward = self.direction[i, k] > 0.0
            cell[axis == k, k] = np.where(forward, corner[:, k] + size, corner[:, k] - 1)[axis == k]
        parent = self.level[i, None] + 1
        is_new = ((cell >> parent) != (corner >> parent)).any(axis=1)
        self.level[i] = np.minimum(self.level[i] + is_new, self.top)
        self.cell[i] = cell
        self.is_done[i[axis < 0]] = True

    def _finish(self, i: Ints, t: Floats) -> None:
        ray = self.index[i]
        self.t[i] = t
        self.hits.t[ray] = t
        level = self.level[i]
        corner = (self.cell[i] >> level[:, None]) << level[:, None]
        self.hits.cell[ray] = self._cell_inside(i, corner, 1 << level)
        self.is_done[i] = True


def first_descent(bernstein: Floats, is_above: Flags) -> tuple[Floats, Flags]:
    """Where polynomials on [0, 1] first fall from above zero to zero.

    A polynomial has no root where its Bernstein coefficients have one sign: steps of doubling and halving width walk
    along it and close in on the first place where that cannot be said.

    Parameters
    ----------
    bernstein : ndarray of float64, (n, degree + 1)
    is_above : ndarray of bool, (n,)
        Where it is False, the polynomial has to rise above zero first.

    Returns
    -------
    root : ndarray of float64, (n,)
        inf where there is none.
    is_above_after : ndarray of bool, (n,)
    """
    root, above = np.full(len(bernstein), np.inf), is_above.copy()
    position, width = np.zeros(len(bernstein)), np.ones(len(bernstein))
    leap = np.full(len(bernstein), 1e-9)  # past a rise, by more than rounding can hide; doubled where it was too short
    i = np.arange(len(bernstein))
    while i.size:
        part = _restrict(bernstein[i], position[i], position[i] + width[i])
        clear = np.where(above[i], (part > 0.0).all(axis=1), (part <= 0.0).all(axis=1))
        position[i[clear]] += width[i[clear]]
        width[i] = np.where(clear, np.minimum(2.0 * width[i], 1.0 - position[i]), 0.5 * width[i])
        closed = ~clear & (width[i] < _ROOT_WIDTH)
        falling, rising = i[closed & above[i]], i[closed & ~above[i]]
        root[falling], above[falling] = position[falling], False
        position[rising] = np.minimum(position[rising] + leap[rising], 1.0)
        leap[rising] *= 2.0
        width[rising] = 1.0 - position[rising]
        above[rising] = _restrict(bernstein[rising], position[rising], position[rising])[:, 0] > 0.0
        i = i[np.isinf(root[i]) & (width[i] > 0.0)]
    return root, above


def _restrict(bernstein: Floats, start: Floats, end: Floats) -> Floats:
    """Bernstein coefficients of the same polynomials on [start, end], by blossoming."""
    degree = bernstein.shape[1] - 1
    result = np.empty_like(bernstein)
    for k in range(degree + 1):
        points = bernstein
        for step in range(degree):
            s = (end if step < k else start)[:, None]
            points = points[:, :-1] * (1.0 - s) + points[:, 1:] * s
        result[:, k] = points[:, 0]
    return result


def _root(gap0: Floats, gap1: Floats, t0: Floats, t1: Floats) -> Floats:
    """Where a linear gap is zero, between ``t0`` and ``t1``; ``t0`` where it starts on the other side."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(gap0 * gap1 < 0.0, gap0 / (gap0 - gap1), np.where(gap0 > 0.0, 1.0, 0.0))
    return t0 + (t1 - t0) * share


def _linear_weights(s: Floats) -> tuple[Floats, ...]:
    return 1.0 - s, s


def _catmull_rom_weights(s: Floats) -> tuple[Floats, ...]:
    return (
        0.5 * s * (-1.0 + s * (2.0 - s)),
        1.0 + 0.5 * s * s * (-5.0 + 3.0 * s),
        0.5 * s * (1.0 + s * (4.0 - 3.0 * s)),
        0.5 * s * s * (s - 1.0),
    )
