"""Exact incremental Delaunay triangulation of a square, for points with small whole-numbered coordinates.

Points come from a grid, so many lie on one line or one circle: just what triangulation in floating point trips over.
Here every coordinate is a whole number of at most `LARGEST`, each test is a sum of products below 2^53, and float64
decides it exactly; no sliver of zero area ever arises, and no tolerance is needed.

**Source** A. Bowyer, "Computing Dirichlet tessellations", and D. Watson, "Computing the n-dimensional Delaunay
tessellation", The Computer Journal 24 (1981).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

LARGEST = 1 << 12
"""Largest coordinate: the in-circle test sums products of four differences and a factor of at most 12."""


class Change(NamedTuple):
    """What adding a point did: triangles by number that ceased to be, and those that now are. The numbers of the first
    may be used again by the second."""

    removed: Ints
    created: Ints


class Delaunay:
    """A Delaunay triangulation that grows point by point.

    Attributes
    ----------
    x, y : list of int
        Coordinates of the points; the first four are the corners of the square.
    triangles : ndarray of int64, (capacity, 3)
        Points of each triangle, counter-clockwise (x right, y up); only the first ``count`` are in use.
    """

    def __init__(self, size: int) -> None:
        if not 1 <= size <= LARGEST:
            raise ValueError(f"expected a square of 1 to {LARGEST} units, found {size}")
        self.x, self.y = [0, size, size, 0], [0, 0, size, size]
        self.triangles = np.zeros((64, 3), np.int64)
        self._circles = np.zeros((64, 4))
        self.count = 0
        self._append(np.array([[0, 1, 2], [0, 2, 3]]), np.empty(0, np.int64))

    @property
    def used(self) -> Ints:
        """The triangles (count, 3)."""
        return self.triangles[: self.count]

    def add(self, x: int, y: int) -> Change:
        """Add a point inside the square or on its rim that is not there yet.

        Raises
        ------
        ValueError
            If the point lies outside or is there already.
        """
        size = self.x[1]
        if not (0 <= x <= size and 0 <= y <= size):
            raise ValueError(f"expected a point within 0 .. {size}, found ({x}, {y})")
        # Every triangle whose circumcircle holds the point goes; their union is seen from it without obstruction.
        hit = self._circles[: self.count] @ np.array([x * x + y * y, x, y, 1.0]) > 0.0
        removed = np.flatnonzero(hit)
        if not len(removed):
            raise ValueError(f"the point ({x}, {y}) is in the triangulation already")
        old = self.triangles[removed]
        start, end = old.ravel(), old[:, [1, 2, 0]].ravel()
        inner = (start[:, None] == end) & (end[:, None] == start)
        rim = ~inner.any(axis=1)
        start, end = start[rim], end[rim]
        xs, ys = np.array(self.x), np.array(self.y)
        # A rim edge in line with the point is the side of the square that the point lies on.
        area = (xs[start] - x) * (ys[end] - y) - (xs[end] - x) * (ys[start] - y)
        start, end = start[area > 0], end[area > 0]
        self.x.append(x)
        self.y.append(y)
        created = self._append(np.stack([start, end, np.full_like(start, len(self.x) - 1)], axis=1), removed)
        return Change(removed, created)

    def _append(self, new: Ints, free: Ints) -> Ints:
        """Store triangles, in the places of removed ones first; returns their numbers. Never fewer than were freed."""
        numbers = np.concatenate([free, np.arange(self.count, self.count + len(new) - len(free))])
        self.count += len(new) - len(free)
        while self.count > len(self.triangles):
            self.triangles = np.concatenate([self.triangles, np.zeros_like(self.triangles)])
            self._circles = np.concatenate([self._circles, np.zeros_like(self._circles)])
        self.triangles[numbers] = new
        self._circles[numbers] = _circles(np.array(self.x, np.float64)[new], np.array(self.y, np.float64)[new])
        return numbers


def _circles(x: Floats, y: Floats) -> Floats:
    """Coefficients of (x^2 + y^2, x, y, 1), positive inside the circumcircle of counter-clockwise triangles (n, 3)."""
    (ax, bx, cx), (ay, by, cy) = x.T, y.T
    a, b, c = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    return np.stack([
        -((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)),
        a * (by - cy) + b * (cy - ay) + c * (ay - by),
        a * (cx - bx) + b * (ax - cx) + c * (bx - ax),
        a * (bx * cy - cx * by) + b * (cx * ay - ax * cy) + c * (ax * by - bx * ay),
    ], axis=1)  # fmt: skip
