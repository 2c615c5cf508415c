"""Which quadtree nodes can be seen: frustum culling, and horizon culling from one pass of azimuth bins.

**Source**: hierarchical frustum culling as in all five papers; horizon culling in the spirit of Downs, Moeller and
Sequin, *Occlusion horizons for driving through urban scenery* (I3D 2001), on the pyramid's bounds.

**Deviations**: the horizon is a table of 1024 azimuth bins holding the tangent of the elevation below which everything
farther is certainly hidden. Nodes are handled in bands of distance: a whole band is tested against the bins, then the
bins are raised by all nodes that end before the next band begins. A level-of-detail surface joins posts of its own
node, so it never dips below the node's minimum, and the bound needs no allowance for the tolerance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.frame import Frame
from terrain.pyramid import BASE_LEVEL
from terrain.scene import Scene

AZIMUTH_BINS = 1024
BAND_RATIO = 1.5  # distance ratio of successive bands: smaller hides a little more and costs numpy calls

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
        solid_minimum = [pyramid.minimum(l) for l in range(BASE_LEVEL, pyramid.top_level + 1)]
        if terrain.holes is not None:
            solid_minimum = _without_holes(terrain.holes, solid_minimum)
        # All levels one behind the other: node (level, row, col) stands at offset[level] + row * width[level] + col.
        levels = range(self.finest_level, self.top_level + 1)
        stored = [min(l, pyramid.top_level) for l in levels]
        self._minimum = np.concatenate([pyramid.minimum(l).ravel() for l in stored]).astype(np.float64)
        self._maximum = np.concatenate([pyramid.maximum(l).ravel() for l in stored]).astype(np.float64)
        self._occluder = np.concatenate([solid_minimum[l - BASE_LEVEL].ravel() for l in stored]).astype(np.float64)
        shapes = [pyramid.node_shape(l) for l in levels]
        sizes = [r * c for r, c in shapes]
        unused = [0] * self.finest_level
        self._offset = np.array(unused + list(np.cumsum([0, *sizes[:-1]])), np.int64)
        self._width = np.array(unused + [c for _, c in shapes], np.int64)
        self._height = np.array(unused + [r for r, _ in shapes], np.int64)

    def node_count(self, level: int) -> int:
        """Nodes of ``level`` in the whole grid."""
        return int(self._width[level] * self._height[level])

    def boxes(self, nodes: Nodes) -> tuple[Floats, Floats]:
        """Lower and upper corners (n, 3) of the nodes, world metres, cut off at the grid's far edges."""
        x0, x1, z0, z1 = self._ground(nodes.level, nodes.row, nodes.col)
        at = self._offset[nodes.level] + nodes.row * self._width[nodes.level] + nodes.col
        return np.stack([x0, self._minimum[at], z0], axis=1), np.stack([x1, self._maximum[at], z1], axis=1)

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
        nodes = nodes.take(np.argsort(nodes.distance_m, kind="stable"))
        if horizon and len(nodes.level) > 1 and self._eye_above_ground(frame):
            nodes = nodes.take(self._before_horizon(nodes, frame))
        return nodes

    def _ground(self, level: Ints, row: Ints, col: Ints) -> tuple[Floats, Floats, Floats, Floats]:
        """West, east, north and south edges of nodes [m]."""
        size = np.left_shift(1, level)
        dx, dz = self.spacing_m
        west, north = col * size, row * size
        east, south = np.minimum(west + size, self.cells[1]), np.minimum(north + size, self.cells[0])
        return np.float64(dx) * west, np.float64(dx) * east, np.float64(dz) * north, np.float64(dz) * south

    def _in_frustum(self, frame: Frame, split_ratio: float | None) -> Nodes:
        dx, dz = self.spacing_m
        eye, planes = frame.eye_m, frame.side_planes
        top = self.top_level
        row, col = (a.ravel().astype(np.int32) for a in np.mgrid[: self._height[top], : self._width[top]])
        found: list[Nodes] = []
        for level in range(top, self.finest_level - 1, -1):
            levels = np.full(row.shape, level, np.int32)
            x0, x1, z0, z1 = self._ground(levels, row, col)
            at = self._offset[level] + row * self._width[level] + col
            # The corner farthest along each plane's normal decides whether a box can be inside.
            x0, x1, z0, z1 = x0 - eye[0], x1 - eye[0], z0 - eye[2], z1 - eye[2]
            y0, y1 = self._minimum[at] - eye[1], self._maximum[at] - eye[1]
            inside = np.ones(row.shape, np.bool_)
            for nx, ny, nz in planes:
                reach = nx * (x1 if nx > 0 else x0) + ny * (y1 if ny > 0 else y0) + nz * (z1 if nz > 0 else z0)
                inside &= reach >= 0.0
            gap = [np.maximum(np.maximum(lo, -hi), 0.0) for lo, hi in ((x0, x1), (y0, y1), (z0, z1))]
            distance = np.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2)
            if level == self.finest_level:
                done = inside
            elif split_ratio is None:
                done = np.zeros(row.shape, np.bool_)
            else:
                done = inside & (distance >= split_ratio * (1 << level) * max(dx, dz))
            if done.any():
                found.append(Nodes(levels[done], row[done], col[done], distance[done]))
            split = inside & ~done
            if level == self.finest_level or not split.any():
                break
            row = (2 * row[split][:, None] + np.array([0, 0, 1, 1], np.int32)).ravel()
            col = (2 * col[split][:, None] + np.array([0, 1, 0, 1], np.int32)).ravel()
            in_grid = (row < self._height[level - 1]) & (col < self._width[level - 1])
            row, col = row[in_grid], col[in_grid]
        if not found:
            empty = np.zeros(0, np.int32)
            return Nodes(empty, empty, empty, np.zeros(0))
        return Nodes(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _eye_above_ground(self, frame: Frame) -> bool:
        """Ground hides what a sight ray meets after going below it, so the ray must start above it.

        From below, and from outside the grid, where rays may enter under its cut edge, nothing is certainly hidden.
        """
        x, y, z = frame.eye_m
        return bool(y > self._scene.heightfield.heights_at(x, z))  # NaN outside

    def _before_horizon(self, nodes: Nodes, frame: Frame) -> npt.NDArray[np.intp]:
        """Indices of the nodes (sorted by distance) that rise above the horizon made by nearer ones."""
        eye = frame.eye_m
        x0, x1, z0, z1 = self._ground(nodes.level, nodes.row, nodes.col)
        x0, x1, z0, z1 = x0 - eye[0], x1 - eye[0], z0 - eye[2], z1 - eye[2]
        at = self._offset[nodes.level] + nodes.row * self._width[nodes.level] + nodes.col
        top, bottom = self._maximum[at] - eye[1], self._occluder[at] - eye[1]

        gap_x, gap_z = np.maximum(np.maximum(x0, -x1), 0.0), np.maximum(np.maximum(z0, -z1), 0.0)
        near = np.hypot(gap_x, gap_z)
        far = np.hypot(np.maximum(np.abs(x0), np.abs(x1)), np.maximum(np.abs(z0), np.abs(z1)))
        around = near <= 0.0  # the eye is above this node: it fills the horizon
        near_safe = np.where(around, 1.0, near)
        # The highest and the certainly reached tangent of the elevation angle.
        highest = np.where(around, np.inf, np.where(top > 0, top / near_safe, top / far))
        reached = np.where(around, -np.inf, np.where(bottom > 0, bottom / far, bottom / near_safe))

        # Azimuths are counted from the sight line, so that no node in the frustum is cut by the seam behind the viewer
        # but those around or below the eye, which are never tested.
        forward = frame.camera.forward
        heading = np.arctan2(forward[0], -forward[2])
        centre = np.arctan2((x0 + x1) / 2, -(z0 + z1) / 2)
        corner_x, corner_z = np.stack([x0, x1, x0, x1]), np.stack([z0, z0, z1, z1])
        turn = np.arctan2(corner_x, -corner_z) - centre
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
        middle = centre - heading
        middle -= 2 * np.pi * np.round(middle / (2 * np.pi))
        scale = AZIMUTH_BINS / (2 * np.pi)
        first = (middle + turn.min(axis=0)) * scale + AZIMUTH_BINS / 2
        last = (middle + turn.max(axis=0)) * scale + AZIMUTH_BINS / 2
        seam = around | (first < 0) | (last >= AZIMUTH_BINS)
        test_first = np.where(seam, 0, np.floor(first)).astype(np.int64)
        test_count = np.where(seam, 1, np.floor(last) - np.floor(first) + 1).astype(np.int64)
        fill_first = np.where(seam, 0, np.ceil(first)).astype(np.int64)
        fill_count = np.where(seam, 0, np.maximum(np.floor(last) - np.ceil(first), 0)).astype(np.int64)

        by_near, by_far = np.argsort(near), np.argsort(far)
        near_sorted, far_sorted = near[by_near], far[by_far]
        test_bins, test_start, _ = _spans(test_first[by_near], test_count[by_near])
        fill_bins, fill_start, owner = _spans(fill_first[by_far], fill_count[by_far])
        fill_values = reached[by_far][owner]
        highest, seam_sorted = highest[by_near], seam[by_near]
        # Behind a hole nothing is hidden for certain: a ray may go below the ground through it.
        holes = by_near[np.isneginf(bottom[by_near])]
        near_holes, opened = near[holes], 0
        ceiling = np.full(AZIMUTH_BINS + 1, np.inf)

        bins = np.full(AZIMUTH_BINS + 1, -np.inf)
        visible = np.ones(len(near), np.bool_)
        start, filled = int(np.searchsorted(near_sorted, 0.0, "right")), 0
        while start < len(near):
            begin = near_sorted[start]
            stop = int(np.searchsorted(near_sorted, begin * BAND_RATIO, "right"))
            until = int(np.searchsorted(far_sorted, begin, "right"))
            if opened < len(holes):
                opening = holes[opened : int(np.searchsorted(near_holes, begin, "right"))]
                opened += len(opening)
                ceiling[_spans(test_first[opening], test_count[opening])[0]] = -np.inf
                if seam[opening].any():
                    break  # a hole below or behind the eye: all round it
            span = slice(fill_start[filled], fill_start[until])
            azimuth, values = fill_bins[span], fill_values[span]
            if opened:
                values = np.minimum(values, np.maximum(ceiling[azimuth], bins[azimuth]))
            np.maximum.at(bins, azimuth, values)
            filled = until
            first_bin = test_start[start]
            lowest = np.minimum.reduceat(
                bins[test_bins[first_bin : test_start[stop]]], test_start[start:stop] - first_bin
            )  # fmt: skip
            visible[start:stop] = (highest[start:stop] >= lowest) | seam_sorted[start:stop]
            start = stop
        return np.sort(by_near[visible])


def _spans(
    first: npt.NDArray[np.int64], count: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Ints]:
    """All integers of the ranges [first, first + count) one behind the other, where each range starts among them
    (n + 1), and the range each belongs to."""
    owner = np.repeat(np.arange(len(first), dtype=np.int32), count)
    start = np.zeros(len(first) + 1, np.int64)
    np.cumsum(count, out=start[1:])
    return np.arange(len(owner)) + (first - start[:-1])[owner], start, owner


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
