"""Which quadtree nodes can be seen: those in the frustum that rise above the horizon.

**Source**: hierarchical frustum culling as in all five papers; the horizon is `terrain.algorithms.horizon`'s.

**Deviations**: the hierarchy is entered at the first level with nodes enough for whole arrays. How far a box reaches
along a plane's normal is a sum of one term for its columns, one for its rows and one for its heights: the first two are
computed once per column and row of each level, not per node. A level-of-detail surface joins posts of its own node, so
it never dips below the node's minimum, and the horizon needs no allowance for the tolerance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.horizon import rises_above_horizon
from terrain.frame import Frame
from terrain.pyramid import BASE_LEVEL
from terrain.scene import Scene

FIRST_NODES = 256  # the hierarchy is entered at a level of so many nodes at most, which cost little more than one

Ints = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


class Nodes(NamedTuple):
    """Quadtree nodes as flat arrays (n,): level, row and column in that level, and distance to the eye [m]."""

    level: Ints
    row: Ints
    col: Ints
    distance_m: Floats

    def take(self, mask: Bools | npt.NDArray[np.intp]) -> Nodes:
        return Nodes(self.level[mask], self.row[mask], self.col[mask], self.distance_m[mask])


class Culler:
    """The bounds of a scene, prepared for culling.

    Parameters
    ----------
    scene : Scene
    finest_level : int
        Level of the smallest nodes to be returned (nodes of 2^level cells).
    """

    def __init__(self, scene: Scene, finest_level: int) -> None:
        pyramid, terrain = scene.pyramid, scene.heightfield
        self.finest_level = max(finest_level, BASE_LEVEL)
        self.top_level = max(pyramid.top_level, self.finest_level)
        self.spacing_m = terrain.spacing_m
        self.cells = pyramid.cells
        self._scene = scene
        # All levels one behind the other: node (level, row, col) stands at offset[level] + row * width[level] + col.
        levels = range(self.finest_level, self.top_level + 1)
        stored = [min(l, pyramid.top_level) for l in levels]
        shapes = np.array([pyramid.node_shape(l) for l in levels])
        unused = np.zeros((self.finest_level, 2), np.int64)
        self._height, self._width = np.concatenate([unused, shapes]).T
        self._offset = _starts(self._height * self._width)
        bounds = [np.stack([pyramid.minimum(l), pyramid.maximum(l)], axis=-1).reshape(-1, 2) for l in stored]
        self._bounds = np.concatenate(bounds)  # (n, 2): both are fetched together
        self._occluder = None
        if terrain.holes is not None:
            minima = [pyramid.minimum(l) for l in range(BASE_LEVEL, pyramid.top_level + 1)]
            solid = _without_holes(terrain.holes, minima)
            self._occluder = np.concatenate([solid[l - BASE_LEVEL].ravel() for l in stored])
        # The near and far edge (2, n) [m] of the columns of all levels, and of the rows, likewise one behind the other.
        dx, dz = self.spacing_m
        self._first_row, self._first_col = _starts(self._height), _starts(self._width)
        self._row_edges = dz * _edges(self._height[self.finest_level :], self.finest_level, self.cells[0])
        self._col_edges = dx * _edges(self._width[self.finest_level :], self.finest_level, self.cells[1])

    def node_count(self, level: int) -> int:
        """Nodes of ``level`` in the whole grid."""
        return int(self._width[level] * self._height[level])

    def boxes(self, nodes: Nodes) -> tuple[Floats, Floats]:
        """Lower and upper corners (n, 3) of the nodes, world metres, cut off at the grid's far edges."""
        x, z = self._ground(nodes)
        low, high = self._bounds[self._index(nodes)].T.astype(np.float64)
        return np.stack([x[0], low, z[0]], axis=1), np.stack([x[1], high, z[1]], axis=1)

    def select(self, frame: Frame, *, horizon: bool = True, split_ratio: float | None = None) -> Nodes:
        """Nodes that may be seen in ``frame``.

        Parameters
        ----------
        frame : Frame
        horizon : bool
            Whether to drop nodes hidden behind nearer ground.
        split_ratio : float or None
            Nodes farther than ``split_ratio`` times their size are not split further; None splits to the finest level.

        Returns
        -------
        Nodes
            A partition of the visible part of the grid, nearest first.
        """
        nodes = self._in_frustum(frame, split_ratio)
        if horizon and len(nodes.level) > 1 and self._eye_above_ground(frame):
            nodes = nodes.take(np.flatnonzero(self._before_horizon(nodes, frame)))
        return nodes.take(np.argsort(nodes.distance_m))

    def _index(self, nodes: Nodes) -> npt.NDArray[np.int64]:
        """Where nodes stand among those of all levels."""
        return self._offset[nodes.level] + nodes.row * self._width[nodes.level] + nodes.col

    def _ground(self, nodes: Nodes) -> tuple[Floats, Floats]:
        """West and east, north and south edges (2, n) of nodes [m]."""
        x = np.take(self._col_edges, self._first_col[nodes.level] + nodes.col, axis=1)
        return x, np.take(self._row_edges, self._first_row[nodes.level] + nodes.row, axis=1)

    def _first_level(self, eye: Floats, split_ratio: float | None) -> int:
        """A level coarser than which every node would be split."""
        level = self.top_level
        farthest_m = np.inf
        if split_ratio is not None:
            low, high = self._bounds[-1]
            corners = (self._col_edges[:, -1] - eye[0], np.array([low, high]) - eye[1], self._row_edges[:, -1] - eye[2])
            farthest_m = float(np.sqrt(sum(np.square(c).max() for c in corners)))
            size_m = split_ratio * max(self.spacing_m)
        while level > self.finest_level and self.node_count(level - 1) <= FIRST_NODES:
            if split_ratio is not None and size_m * (1 << level) <= farthest_m:
                break
            level -= 1
        return level

    def _in_frustum(self, frame: Frame, split_ratio: float | None) -> Nodes:
        eye, normals = frame.eye_m, frame.side_planes
        x, z = self._col_edges - eye[0], self._row_edges - eye[2]
        east, up, south = normals.T[:, :, None]
        # How far columns and rows reach along each plane's normal (4, n), and their squared distances to the eye.
        reach_x, reach_z = np.maximum(east * x[0], east * x[1]), np.maximum(south * z[0], south * z[1])
        gap_x, gap_z = (np.square(np.maximum(np.maximum(edge[0], -edge[1]), 0.0)) for edge in (x, z))

        level = self._first_level(eye, split_ratio)
        row, col = np.divmod(np.arange(self.node_count(level)), self._width[level])
        found: list[tuple[int, npt.NDArray[np.intp], npt.NDArray[np.intp], Floats]] = []
        while True:
            at_row, at_col = row + self._first_row[level], col + self._first_col[level]
            bounds = np.take(self._bounds, self._offset[level] + row * self._width[level] + col, axis=0)
            bottom = np.subtract(bounds[:, 0], eye[1], dtype=np.float64)
            top = np.subtract(bounds[:, 1], eye[1], dtype=np.float64)
            reach = np.maximum(up * bottom, up * top)
            reach += np.take(reach_x, at_col, axis=1)
            reach += np.take(reach_z, at_row, axis=1)
            square = np.square(np.maximum(np.maximum(bottom, -top), 0.0))
            square += gap_x[at_col]
            square += gap_z[at_row]
            inside = reach.min(axis=0) >= 0.0
            done = inside
            if level > self.finest_level:
                size_m = np.inf if split_ratio is None else split_ratio * (1 << level) * max(self.spacing_m)
                done = inside & (square >= size_m * size_m)
            kept = np.flatnonzero(done)
            found.append((level, row[kept], col[kept], square[kept]))
            split = np.flatnonzero(inside & ~done)
            if not len(split):
                break
            level -= 1
            row = (2 * row[split] + np.array([[0], [0], [1], [1]])).ravel()
            col = (2 * col[split] + np.array([[0], [1], [0], [1]])).ravel()
            if self._height[level] < 2 * self._height[level + 1] or self._width[level] < 2 * self._width[level + 1]:
                in_grid = np.flatnonzero((row < self._height[level]) & (col < self._width[level]))
                row, col = row[in_grid], col[in_grid]
        levels, rows, cols, squares = zip(*found, strict=True)
        return Nodes(
            np.repeat(np.array(levels, np.int32), [len(r) for r in rows]),
            np.concatenate(rows, dtype=np.int32), np.concatenate(cols, dtype=np.int32),
            np.sqrt(np.concatenate(squares)),
        )  # fmt: skip

    def _eye_above_ground(self, frame: Frame) -> bool:
        """Ground hides what a sight ray meets after going below it, so the ray must start above it.

        From below, and from outside the grid, where rays may enter under its cut edge, nothing is certainly hidden.
        """
        x, y, z = frame.camera.position_m
        level = self.finest_level
        dx, dz = self.spacing_m
        row, col = math.floor(z / dz) >> level, math.floor(x / dx) >> level
        in_grid = 0 <= row < self._height[level] - 1 and 0 <= col < self._width[level] - 1  # the last may end half way
        if in_grid and y > self._bounds[row * self._width[level] + col, 1]:
            return True
        return bool(y > self._scene.heightfield.heights_at(x, z))  # NaN outside

    def _before_horizon(self, nodes: Nodes, frame: Frame) -> Bools:
        """Which nodes rise above the horizon made by nearer ones."""
        eye, at = frame.eye_m, self._index(nodes)
        x, z = self._ground(nodes)
        bounds = np.take(self._bounds, at, axis=0)
        occluder = bounds[:, 0] if self._occluder is None else self._occluder[at]
        bottom, top = (np.subtract(h, eye[1], dtype=np.float64).astype(np.float32) for h in (occluder, bounds[:, 1]))
        x, z = np.subtract(x, eye[0]).astype(np.float32), np.subtract(z, eye[2]).astype(np.float32)
        return rises_above_horizon(x, z, bottom, top, frame.camera.forward)


def _starts(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Where each of several groups starts that stand one behind the other."""
    return np.cumsum(counts) - counts


def _edges(counts: npt.NDArray[np.int64], finest_level: int, cells: int) -> npt.NDArray[np.int64]:
    """First and last post (2, n) of the nodes along one axis, all levels one behind the other."""
    first = np.concatenate([np.arange(n) << level for level, n in enumerate(counts.tolist(), finest_level)])
    size = np.repeat(1 << np.arange(finest_level, finest_level + len(counts)), counts)
    return np.stack([first, np.minimum(first + size, cells)])


def _without_holes(holes: Bools, minima: list[npt.NDArray[np.float32]]) -> list[npt.NDArray[np.float32]]:
    """Minima per level, with minus infinity where a node holds or touches a hole: it hides nothing for certain."""
    size = 1 << BASE_LEVEL
    rows, cols = minima[0].shape
    touched = np.zeros((rows * size + 2, cols * size + 2), np.bool_)
    touched[1 : holes.shape[0] + 1, 1 : holes.shape[1] + 1] = holes
    flags = np.zeros((rows, cols), np.bool_)
    for i in range(3):  # a post before and a post after the node count too: shading blends holes with their neighbours
        for j in range(3):
            shifted = touched[i : i + rows * size, j : j + cols * size]
            flags |= shifted.reshape(rows, size, cols, size).any(axis=(1, 3))
    result = []
    for minimum in minima:
        result.append(np.where(flags, np.float32(-np.inf), minimum))
        rows, cols = -(-flags.shape[0] // 2), -(-flags.shape[1] // 2)
        padded = np.zeros((rows * 2, cols * 2), np.bool_)
        padded[: flags.shape[0], : flags.shape[1]] = flags
        flags = np.asarray(padded.reshape(rows, 2, cols, 2).any(axis=(1, 3)))
    return result
