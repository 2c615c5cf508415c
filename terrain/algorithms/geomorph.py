"""Smooth hardware-optimised level of detail: which tile is drawn at which (fractional) level.

**Source**: B. D. Larsen and N. J. Christensen, *Real-time terrain rendering using smooth hardware optimized level of
detail*, Journal of WSCG 11 (2003): tiles (section 2), levels by screen-space error (2.1), neighbours one level apart
(2.2), morphing (2.3, tables 3 and 4), drivers of the morph (end of 2.3), the queue of changes and a fixed frame cost
(3, 4).

**Deviations**

* A tile's level is one continuous number lambda instead of a level and a morph variable: its integer part is the level
  drawn, its fraction the v of table 3. With ``tol = tolerance * distance / K`` the ramp of level l runs from
  ``t0 = max(eps_l, eps_{l+1} / 2)`` to ``eps_{l+1}``, so that the drawn surface ``(1 - v) S_l + v S_{l+1}`` errs by
  tol at most.
* *Neighbours at most one level apart* becomes ``|lambda_a - lambda_b| <= 1``: an exact L1 distance transform, two
  running minima per axis, in place of pointers between neighbours.
* Table 4 becomes one rule: a shared edge has ``lambda_e = max`` of its two sides, from whichever side it is drawn.
* Quiet tiles are joined: four tiles that have reached their coarsest level become one tile of twice the size, and so
  on. Its level lies in (t - 1, t] for a tile of 2^t cells; on an edge towards smaller tiles it stays at t - 1. The same
  distance transform on the joined tiles keeps sizes of neighbours within a factor of two and everything continuous.
* Light is baked from the full terrain, so normals need no morph (section 2.3's second interpolation).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Nodes
from terrain.frame import Frame
from terrain.pyramid import BASE_LEVEL, Pyramid
from terrain.scene import Scene

Driver = Literal["distance", "time", "frames", "off"]
Grid = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

LARGEST_TILE_LEVEL = 8  # joined tiles of up to 256 cells
RAMP_GAP = 1.05  # successive ramp ends differ by at least this factor: every ramp has a width


class Tiles(NamedTuple):
    """Tiles to draw as flat arrays (n,): what the vertex shader is told of each.

    ``size_level`` t: the tile has 2^t cells; ``level`` L: it is drawn with 2^(t - L) cells per side; ``lam``: lambda of
    its interior; ``edge_lam`` (n, 4): lambda of its north, south, west and east edge; ``post`` (n, 2): its north-west
    post (col, row).
    """

    post: npt.NDArray[np.int32]
    size_level: npt.NDArray[np.int32]
    level: npt.NDArray[np.int32]
    lam: Grid
    edge_lam: Grid


@dataclass(frozen=True, eq=False)
class _Tier:
    """Static data of all tiles of one size, arrays (rows, cols).

    ``start`` and ``scale`` (levels, rows, cols) are the ramps: v = clip((tol - start) * scale, 0, 1). The smallest tiles
    have a ramp for each of their levels, joined ones a single ramp for their last.
    """

    size_level: int
    minimum_m: Grid
    maximum_m: Grid
    start: Grid
    scale: Grid


class TileLevels:
    """Levels of all tiles of a scene for any eye.

    Parameters
    ----------
    scene : Scene
    tile_cells : int
        Cells along the smallest tiles: 8, 16, 32 or 64.
    join : bool
        Whether quiet tiles are joined to larger ones.
    """

    def __init__(self, scene: Scene, tile_cells: int, join: bool) -> None:
        pyramid = scene.pyramid
        self.spacing_m = scene.heightfield.spacing_m
        self.cells = pyramid.cells
        self.size_level = tile_cells.bit_length() - 1
        last = min(max(pyramid.top_level, self.size_level), LARGEST_TILE_LEVEL) if join else self.size_level
        largest = [-(-n >> last) << (last - self.size_level) for n in self.cells]  # smallest tiles, padded
        self.tiers = [
            _build_tier(pyramid, t, self.size_level, [n >> (t - self.size_level) for n in largest])
            for t in range(self.size_level, last + 1)
        ]
        self._drawn: list[Grid] | None = None  # lambda as drawn, per tier: what time- and frame-driven morphs move
        self._time_s: float | None = None

    def select(
        self, frame: Frame, visible: Nodes, tolerance_px: float, driver: Driver = "distance",
        morph_s: float = 1.0, morph_frames: int = 30, starts_per_frame: int | None = None,
    ) -> Tiles:  # fmt: skip
        """The tiles that show the visible nodes, nearest sizes first.

        Parameters
        ----------
        frame : Frame
        visible : Nodes
            What culling left over; nodes may be larger than tiles.
        tolerance_px : float
        driver : {"distance", "time", "frames", "off"}
            ``distance``: lambda follows the eye's position, nothing moves while the eye rests. ``time`` and ``frames``:
            lambda moves towards it by one level in ``morph_s`` seconds or ``morph_frames`` frames. ``off``: whole levels.
        starts_per_frame : int or None
            How many tiles may leave their level in one frame; the others wait at its end (the paper's queue).
        """
        if not len(visible.level):
            return _no_tiles()
        mask = self._visible_mask(visible)
        stateless = driver in ("distance", "off") and starts_per_frame is None
        window = self._window(mask) if stateless else (slice(0, mask.shape[0]), slice(0, mask.shape[1]))
        fields = self._targets(frame, tolerance_px, window)
        if not stateless:
            step = self._step(frame, driver, morph_s, morph_frames)
            fields = self._drawn = self._follow(fields, step, starts_per_frame)
        else:
            self.reset()
        levels = self._constrain(fields)
        if driver == "off":
            levels = [np.floor(level) for level in levels]
        return self._collect(levels, mask[window], window)

    def reset(self) -> None:
        """Forget what was drawn: the next selection starts at its targets."""
        self._drawn, self._time_s = None, None

    def boxes(self, tiles: Tiles) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Lower and upper corners (n, 3) of tiles, world metres."""
        low, high = np.zeros(len(tiles.lam)), np.zeros(len(tiles.lam))
        for tier in self.tiers:
            at = tiles.size_level == tier.size_level
            col, row = (tiles.post[at] >> tier.size_level).T
            low[at], high[at] = tier.minimum_m[row, col], tier.maximum_m[row, col]
        first = tiles.post.astype(np.float64)
        last = np.minimum(first + np.left_shift(1, tiles.size_level)[:, None], self.cells[::-1])
        first, last = first * self.spacing_m, last * self.spacing_m
        lower = np.stack([first[:, 0], low, first[:, 1]], axis=1)
        return lower, np.stack([last[:, 0], high, last[:, 1]], axis=1)

    def _visible_mask(self, nodes: Nodes) -> Bools:
        """Which smallest tiles lie in a visible node; padded to whole tiles of the largest size."""
        rows, cols = self.tiers[0].minimum_m.shape
        unit = 1 << max(int(nodes.level.max()) - self.size_level, 0)
        mask = np.zeros((-(-rows // unit) * unit, -(-cols // unit) * unit), np.bool_)
        for level in range(self.size_level, int(nodes.level.max()) + 1):
            at = nodes.level == level
            size = 1 << (level - self.size_level)
            blocks = mask.reshape(mask.shape[0] // size, size, mask.shape[1] // size, size)
            blocks[nodes.row[at], :, nodes.col[at], :] = True
        return mask[:rows, :cols]

    def _window(self, mask: Bools) -> tuple[slice, slice]:
        """The part of the grid that can influence a visible tile: lambda reaches as far as it has levels."""
        unit = 1 << (self.tiers[-1].size_level - self.size_level)
        margin = max(self.size_level, 2 * unit)
        window = []
        for axis in (0, 1):
            found = np.flatnonzero(mask.any(axis=1 - axis))
            first = max(int(found[0]) - margin, 0) // unit * unit
            last = min(-(-(int(found[-1]) + 1 + margin) // unit) * unit, mask.shape[axis])
            window.append(slice(first, last))
        return window[0], window[1]

    def _targets(self, frame: Frame, tolerance_px: float, window: tuple[slice, slice]) -> list[Grid]:
        """Per tier: lambda wished for from the eye's position alone, (0..t) for the smallest tiles, v for joined ones."""
        eye, (dx, dz) = frame.eye_m, self.spacing_m
        tolerance = np.float32(tolerance_px / frame.pixels_per_radian)
        fields = []
        for tier in self.tiers:
            shift = tier.size_level - self.size_level
            rows, cols = (slice(w.start >> shift, w.stop >> shift) for w in window)
            minimum, maximum = tier.minimum_m[rows, cols], tier.maximum_m[rows, cols]
            size = 1 << tier.size_level
            gap_x = _gap(np.arange(cols.start, cols.start + minimum.shape[1]) * size, size, self.cells[1], dx, eye[0])
            gap_z = _gap(np.arange(rows.start, rows.start + minimum.shape[0]) * size, size, self.cells[0], dz, eye[2])
            height = np.float32(eye[1])
            tol = np.maximum(minimum - height, height - maximum)
            np.maximum(tol, 0, out=tol)
            np.square(tol, out=tol)
            tol += (gap_x**2)[None, :]
            tol += (gap_z**2)[:, None]
            np.sqrt(tol, out=tol)
            tol *= tolerance
            total = np.zeros_like(tol)
            for start, scale in zip(tier.start, tier.scale, strict=True):
                v = tol - start[rows, cols]
                v *= scale[rows, cols]
                total += np.clip(v, 0, 1, out=v)
            fields.append(total)
        return fields

    def _step(self, frame: Frame, driver: Driver, morph_s: float, morph_frames: int) -> float:
        """Levels by which lambda may move in this frame."""
        elapsed = 0.0 if self._time_s is None else abs(frame.time_s - self._time_s)
        self._time_s = frame.time_s
        if driver == "time":
            return elapsed / max(morph_s, 1e-3)
        return 1.0 / max(morph_frames, 1) if driver == "frames" else np.inf

    def _follow(self, targets: list[Grid], step: float, starts_per_frame: int | None) -> list[Grid]:
        """Move what was drawn towards the targets by ``step`` levels; hold back what exceeds the queue."""
        if self._drawn is None:
            return targets
        moved = []
        for tier, (target, drawn) in enumerate(zip(targets, self._drawn, strict=True)):
            change = np.clip(target - drawn, -np.float32(step), np.float32(step))
            new = drawn + change
            if starts_per_frame is not None and tier == 0:
                leaving = np.flatnonzero(np.floor(new) != np.floor(drawn))
                if len(leaving) > starts_per_frame:
                    # Those that miss most detail go first; the others wait at the end of their level.
                    order = np.argsort(change.ravel()[leaving], kind="stable")
                    waiting = leaving[order[starts_per_frame:]]
                    old = drawn.ravel()[waiting]
                    new.ravel()[waiting] = np.clip(
                        new.ravel()[waiting], np.floor(old), np.floor(old) + np.float32(0.999)
                    )
            moved.append(new)
        return moved

    def _constrain(self, fields: list[Grid]) -> list[Grid]:
        """Per tier: lambda under the neighbour rule. A tile of size t > the smallest exists where lambda > t - 1."""
        levels = [_limit_slope(fields[0])]
        for tier, field in zip(self.tiers[1:], fields[1:], strict=True):
            finer = levels[-1]
            least = np.minimum(
                np.minimum(finer[::2, ::2], finer[1::2, ::2]), np.minimum(finer[::2, 1::2], finer[1::2, 1::2])
            )
            full = least >= tier.size_level - 1
            levels.append(_limit_slope(np.where(full, np.float32(tier.size_level - 1) + field, least)))
        return levels

    def _collect(self, levels: list[Grid], mask: Bools, window: tuple[slice, slice]) -> Tiles:
        """Visible tiles of all sizes with the levels of their edges."""
        masks = [mask]
        for _ in self.tiers[1:]:
            finer = masks[-1]
            masks.append(finer[::2, ::2] | finer[1::2, ::2] | finer[::2, 1::2] | finer[1::2, 1::2])
        parts: list[Tiles] = []
        covered = np.zeros(levels[-1].shape, np.bool_)
        for index in range(len(self.tiers) - 1, -1, -1):
            tier, lam = self.tiers[index], levels[index]
            t = tier.size_level
            joined = np.ones(lam.shape, np.bool_) if index == 0 else lam > t - 1
            row, col = np.nonzero(joined & ~covered & masks[index])
            if len(row):
                # What a neighbour of the same size offers at the shared edge: its lambda; t where it is part of a larger
                # tile; t - 1 where there are smaller ones.
                offer = np.where(covered, np.float32(t), np.where(joined, lam, np.float32(t - 1)))
                offer = np.pad(offer, 1, mode="edge")
                own = lam[row, col]
                edge = np.stack(
                    [offer[row, col + 1], offer[row + 2, col + 1], offer[row + 1, col], offer[row + 1, col + 2]], axis=1
                )
                shared = np.maximum(edge, own[:, None])
                edge = shared if index == 0 else np.where(edge <= t - 1, np.float32(t - 1), shared)
                level = np.floor(np.minimum(own, edge.min(axis=1))).astype(np.int32)
                shift = t - self.size_level
                post = np.stack([col + (window[1].start >> shift), row + (window[0].start >> shift)], axis=1) << t
                parts.append(Tiles(post.astype(np.int32), np.full(len(row), t, np.int32), level, own, edge))
            if index:
                covered = np.repeat(np.repeat(covered | joined, 2, axis=0), 2, axis=1)
        return Tiles(*(np.concatenate(column) for column in zip(*parts[::-1], strict=True))) if parts else _no_tiles()


def tile_triangles(tiles: Tiles) -> int:
    """Triangles of the tiles: 2^(2 (t - L) + 1) each (section 2)."""
    return int(np.left_shift(2, 2 * (tiles.size_level - tiles.level).astype(np.int64)).sum())


def _build_tier(pyramid: Pyramid, size_level: int, smallest: int, shape: list[int]) -> _Tier:
    """Bounds and ramps of all tiles of 2^size_level cells, padded to ``shape`` by tiles that limit nothing."""
    stored = min(size_level, pyramid.top_level)
    minimum, maximum = pyramid.minimum(stored), pyramid.maximum(stored)
    first = 0 if size_level == smallest else size_level - 1
    errors = [pyramid.error(stored, min(l, stored)) for l in range(first, size_level + 1)]
    floor = np.float32(1e-6) * np.float32(max(float(np.abs(maximum).max()), 1e-3))
    below = errors[0]
    start, scale = [], []
    for error in errors[1:]:
        end = np.maximum(error, np.maximum(below * np.float32(RAMP_GAP), floor))
        begin = np.maximum(below, end / 2)
        start.append(begin)
        scale.append(1 / (end - begin))
        below = end
    missing = [(0, n - m) for n, m in zip(shape, minimum.shape, strict=True)]
    along = [(0, 0), *missing]
    return _Tier(
        size_level,
        np.pad(minimum, missing),
        np.pad(maximum, missing),
        np.pad(np.stack(start), along, constant_values=-2.0),
        np.pad(np.stack(scale), along, constant_values=1.0),
    )


def _gap(first: npt.NDArray[np.int64], size: int, cells: int, spacing_m: float, eye_m: float) -> Grid:
    """Distance [m] along one axis from the eye to intervals of ``size`` cells, 0 inside."""
    low = first * spacing_m - eye_m
    high = np.minimum(first + size, cells) * spacing_m - eye_m
    return np.maximum(np.maximum(low, -high), 0.0).astype(np.float32)


def _limit_slope(field: Grid) -> Grid:
    """The largest field below ``field`` whose neighbours differ by at most 1: an exact L1 distance transform."""
    for axis in (0, 1):
        shape = (-1, 1) if axis == 0 else (1, -1)
        ramp = np.arange(field.shape[axis], dtype=np.float32).reshape(shape)
        forward = np.minimum.accumulate(field - ramp, axis=axis) + ramp
        flipped = np.flip(forward + ramp, axis)
        field = np.flip(np.minimum.accumulate(flipped, axis=axis), axis) - ramp
    return field


def _no_tiles() -> Tiles:
    none = np.zeros(0, np.int32)
    return Tiles(np.zeros((0, 2), np.int32), none, none, np.zeros(0, np.float32), np.zeros((0, 4), np.float32))


assert BASE_LEVEL == 3  # the smallest tiles, 8 cells, are the finest nodes of the pyramid
