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
* *Neighbours at most one level apart* becomes ``|lambda_a - lambda_b| <= 1``: an exact L1 distance transform in place
  of pointers between neighbours.
* Table 4 becomes one rule: a shared edge has ``lambda_e = max`` of its two sides, from whichever side it is drawn.
* Quiet tiles are joined: four tiles that have reached their coarsest level become one tile of twice the size, and so
  on. Its level lies in [t - 1, t] for a tile of 2^t cells; on an edge towards smaller tiles it stays at t - 1. It may
  pass t - 1 by as much as its neighbours' tiles of half the size have passed t - 2: sizes of neighbours stay within a
  factor of two and everything stays continuous.
* Light is baked from the full terrain, so normals need no morph (section 2.3's second interpolation).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Nodes
from terrain.frame import Frame
from terrain.pyramid import BASE_LEVEL, Pyramid
from terrain.scene import Scene

Driver = Literal["distance", "time", "frames", "off"]
Grid = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Window = tuple[slice, slice]

LARGEST_TILE_LEVEL = 8  # joined tiles of up to 256 cells
TILES_PER_SIDE = 256  # that automatic tiles have at most
RAMP_GAP = 1.05  # successive ramp ends differ by at least this factor: every ramp has a width


def automatic_tile_cells(cells: tuple[int, int]) -> int:
    """Cells along the smallest tiles that suit a grid of ``cells`` (rows, columns): 8 up to 2049 posts, 16 up to 4097.

    Small tiles draw fewest triangles; more than `TILES_PER_SIDE` would cost more to select than they save.
    """
    size = 8
    while size < 64 and size * TILES_PER_SIDE < max(cells):
        size *= 2
    return size


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

    ``start`` and ``scale`` (levels, rows, cols) are the ramps: v = clip((tol - start) * scale, 0, 1). The smallest
    tiles have a ramp for each of their levels, joined ones a single ramp for their last. ``full`` is the tol at which a
    tile reaches its coarsest level, ``parts_full`` the tol at which all four parts of a joined tile have.
    """

    size_level: int
    minimum_m: Grid
    maximum_m: Grid
    start: Grid
    scale: Grid
    full: Grid
    parts_full: Grid


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
        self.tiers: list[_Tier] = []
        for t in range(self.size_level, last + 1):
            shape = [n >> (t - self.size_level) for n in largest]
            self.tiers.append(_build_tier(pyramid, t, shape, self.tiers[-1] if self.tiers else None))
        self._in_grid = self.tiers[0].full >= 0
        self._overhangs = not self._in_grid.all()
        # First and last post of all tiers' columns, one tier behind the other, and of their rows [m].
        counts = np.array([tier.full.shape for tier in self.tiers])
        sizes = [1 << tier.size_level for tier in self.tiers]
        self._rows, self._cols = (
            spacing * _edges(counts[:, axis].tolist(), sizes, self.cells[axis])
            for axis, spacing in ((0, self.spacing_m[1]), (1, self.spacing_m[0]))
        )
        self._first = (np.cumsum(counts, axis=0) - counts).tolist()
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
            lambda moves towards it by one level in ``morph_s`` seconds or ``morph_frames`` frames. ``off``: whole
            levels.
        starts_per_frame : int or None
            How many tiles may leave their level in one frame; the others wait at its end (the paper's queue).
        """
        if not len(visible.level):
            return _no_tiles()
        masks = self._visible_masks(visible)
        tolerance = np.float32(tolerance_px / frame.pixels_per_radian)
        stateless = driver in ("distance", "off") and starts_per_frame is None
        windows, fields = self._targets(frame, tolerance, masks, everywhere=not stateless)
        if stateless:
            self.reset()
        else:
            fields = self._drawn = self._follow(
                fields, self._step(frame, driver, morph_s, morph_frames), starts_per_frame
            )
        if driver == "off":
            fields = [np.floor(field) for field in fields]
        levels, joined = self._constrain(fields, windows)
        return self._collect(levels, joined, masks, windows)

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

    def _visible_masks(self, nodes: Nodes) -> list[Bools]:
        """Per tier: which tiles lie in a visible node."""
        rows, cols = self.tiers[0].minimum_m.shape
        unit = 1 << max(int(nodes.level.max()) - self.size_level, 0)
        mask = np.zeros((-(-rows // unit) * unit, -(-cols // unit) * unit), np.bool_)
        for level in range(self.size_level, int(nodes.level.max()) + 1):
            at = nodes.level == level
            size = 1 << (level - self.size_level)
            blocks = mask.reshape(mask.shape[0] // size, size, mask.shape[1] // size, size)
            blocks[nodes.row[at], :, nodes.col[at], :] = True
        masks = [mask[:rows, :cols] & self._in_grid if self._overhangs else mask[:rows, :cols]]
        for _ in self.tiers[1:]:
            masks.append(_join(masks[-1], np.logical_or))
        return masks

    def _targets(
        self, frame: Frame, tolerance: np.float32, masks: list[Bools], everywhere: bool
    ) -> tuple[list[Window], list[Grid]]:
        """Per tier: the window worth looking at, and in it the level wished for from the eye's position alone.

        The field holds lambda (0..t) for the smallest tiles, v (0..1) for joined ones. From large tiles to small: only
        where some part of a large tile has not reached its coarsest level do smaller tiles matter.
        """
        windows: list[Window] = []
        fields: list[Grid] = []
        eye = frame.eye_m
        gaps = tuple(
            np.square(np.maximum(np.maximum(edges[0] - at, at - edges[1]), 0.0)).astype(np.float32)
            for edges, at in ((self._rows, eye[2]), (self._cols, eye[0]))
        )
        window = _whole(masks[-1])
        for index in range(len(self.tiers) - 1, -1, -1):
            tier = self.tiers[index]
            gap_z, gap_x = (
                gap[first + w.start : first + w.stop]
                for gap, first, w in zip(gaps, self._first[index], window, strict=True)
            )
            tol = _tolerance_m(tier, window, gap_z, gap_x, np.float32(eye[1]), tolerance)
            windows.insert(0, window)
            fields.insert(0, _ramps(tier, window, tol))
            if index and everywhere:
                window = _whole(masks[index - 1])
            elif index:
                # A ring around what is visible counts too, so that turning the head changes nothing in the middle.
                needed = _grown(masks[index][window]) & (tol < tier.parts_full[window])
                margin = self.size_level + 2  # as far as a tile limits others, in parts of this tile
                window = _parts_window(_bounding_window(needed, window), window, margin)
        return windows, fields

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

    def _constrain(self, fields: list[Grid], windows: list[Window]) -> tuple[list[Grid], list[Bools]]:
        """Per tier: lambda under the neighbour rule, and which tiles exist: all of the smallest, the joined others."""
        levels = [_limit_slope(fields[0], self.size_level)]
        joined = [np.ones(levels[0].shape, np.bool_)]
        for index in range(1, len(self.tiers)):
            full = np.float32(self.tiers[index].size_level - 1)
            window, inner = windows[index], windows[index - 1]
            least = np.full(fields[index].shape, full)  # outside the smaller tiles' window all parts are full
            inside = tuple(
                slice(i.start // 2 - w.start, i.stop // 2 - w.start) for i, w in zip(inner, window, strict=True)
            )
            within = np.zeros(least.shape, np.bool_)
            if levels[-1].size:
                least[inside[0], inside[1]] = _join(levels[-1], np.minimum)
                within[inside[0], inside[1]] = True
            around = _bordered(least, full)  # what lies outside limits nothing
            limit = np.minimum(
                np.minimum(around[:-2, 1:-1], around[2:, 1:-1]), np.minimum(around[1:-1, :-2], around[1:-1, 2:])
            )
            level = np.minimum(full + fields[index], limit + 1)
            exists = ((least >= full) & (level >= full)) | ~within
            levels.append(np.where(exists, np.maximum(level, full), least))
            joined.append(exists)
        return levels, joined

    def _collect(
        self, levels: list[Grid], joined: list[Bools], masks: list[Bools], windows: list[Window]
    ) -> Tiles:  # fmt: skip
        """Visible tiles of all sizes with the levels of their edges."""
        parts: list[Tiles] = []
        covered = np.zeros(levels[-1].shape, np.bool_)
        for index in range(len(self.tiers) - 1, -1, -1):
            lam, exists, window = levels[index], joined[index], windows[index]
            t = self.tiers[index].size_level
            here = np.flatnonzero((exists > covered) & masks[index][window])
            if len(here):
                # What a neighbour of the same size offers at the shared edge: its lambda; t where it is part of a
                # larger tile; -1 where there are smaller ones; 0, which is never more than one's own, past the grid
                # and the window.
                offer = np.multiply(covered, np.float32(t + 1), dtype=np.float32)
                offer -= 1
                np.maximum(offer, np.where(exists, lam, np.float32(-1)) if index else lam, out=offer)
                if self._overhangs:
                    offer[self.tiers[index].full[window] < 0] = 0
                offer = _bordered(offer, np.float32(0))
                width, flat = offer.shape[1], offer.ravel()
                row, col = np.divmod(here, lam.shape[1])
                at = (row + 1) * width + (col + 1)
                own = flat[at]
                edge = np.empty((4, len(here)), np.float32)
                for side, step in zip(edge, (-width, width, -1, 1), strict=True):
                    np.take(flat, at + step, out=side, mode="clip")
                smaller = edge < 0
                np.maximum(edge, own, out=edge)
                edge[smaller] = t - 1
                level = np.minimum(own, edge.min(axis=0)).astype(np.int32)  # both are positive: this is the floor
                post = np.empty((len(here), 2), np.int32)
                post[:, 0], post[:, 1] = (col + window[1].start) << t, (row + window[0].start) << t
                parts.append(Tiles(post, np.full(len(here), t, np.int32), level, own, edge.T))
            if index:
                inner = windows[index - 1]
                gone = _doubled(covered | exists)
                covered = gone[
                    inner[0].start - 2 * window[0].start : inner[0].stop - 2 * window[0].start,
                    inner[1].start - 2 * window[1].start : inner[1].stop - 2 * window[1].start,
                ]
        return Tiles(*(np.concatenate(column) for column in zip(*parts[::-1], strict=True))) if parts else _no_tiles()


def tile_triangles(tiles: Tiles) -> int:
    """Triangles of the tiles: 2^(2 (t - L) + 1) each (section 2)."""
    return int(np.left_shift(2, 2 * (tiles.size_level - tiles.level).astype(np.int64)).sum())


def _build_tier(pyramid: Pyramid, size_level: int, shape: list[int], smaller: _Tier | None) -> _Tier:
    """Bounds and ramps of all tiles of 2^size_level cells, padded to ``shape`` by tiles that limit nothing."""
    stored = min(size_level, pyramid.top_level)
    minimum, maximum = pyramid.minimum(stored), pyramid.maximum(stored)
    missing = [(0, n - m) for n, m in zip(shape, minimum.shape, strict=True)]
    first = 0 if smaller is None else size_level - 1
    errors = [pyramid.error(stored, min(l, stored)) for l in range(first, size_level + 1)]
    errors = [np.pad(error, missing) for error in errors]
    floor = np.float32(1e-6) * np.float32(max(float(np.abs(maximum).max()), 1e-3))
    parts_full = np.zeros(shape, np.float32) if smaller is None else _join(smaller.full, np.maximum)
    below = errors[0] if smaller is None else np.maximum(errors[0], parts_full)
    start, scale = [], []
    for error in errors[1:]:
        end = np.maximum(error, np.maximum(below * np.float32(RAMP_GAP), floor))
        begin = np.maximum(below, end / 2)
        start.append(begin)
        scale.append(1 / (end - begin))
        below = end
    inside = np.pad(np.ones(minimum.shape, np.bool_), missing)
    return _Tier(
        size_level,
        np.pad(minimum, missing),
        np.pad(maximum, missing),
        np.where(inside, np.stack(start), np.float32(-2)),
        np.where(inside, np.stack(scale), np.float32(1)),
        np.where(inside, below, np.float32(-1)),
        parts_full,
    )


def _whole(mask: Bools) -> Window:
    return slice(0, mask.shape[0]), slice(0, mask.shape[1])


def _bounding_window(mask: Bools, outer: Window) -> Window:
    """The smallest window that holds all that is set in ``mask``, which lies in ``outer``; empty if nothing is."""
    bits = mask.view(np.uint8)  # their maximum is found faster than whether any is true
    rows, cols = np.flatnonzero(bits.max(axis=1, initial=0)), np.flatnonzero(bits.max(axis=0, initial=0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    (top, left), (last_row, last_col) = (w.start for w in outer), (int(rows[-1]) + 1, int(cols[-1]) + 1)
    return slice(top + int(rows[0]), top + last_row), slice(left + int(cols[0]), left + last_col)


def _parts_window(window: Window, outer: Window, margin: int) -> Window:
    """The window of tiles of half the size, widened by ``margin`` of them inside ``outer``, aligned to whole tiles."""
    rows, cols = (
        slice(
            max(2 * inner.start - margin, 2 * bound.start) // 2 * 2,
            max(min(2 * inner.stop + margin + 1, 2 * bound.stop) // 2 * 2, 2 * bound.start),
        )
        for inner, bound in zip(window, outer, strict=True)
    )
    return rows, cols


def _grown(mask: Bools) -> Bools:
    """The mask and a ring of one tile around it."""
    padded = _bordered(mask, np.bool_(False))
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return np.asarray(rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:])


def _join(parts: npt.NDArray[Any], how: np.ufunc) -> npt.NDArray[Any]:
    """Blocks of 2 x 2 joined by a ufunc; both sides are even."""
    return how(how(parts[::2, ::2], parts[1::2, ::2]), how(parts[::2, 1::2], parts[1::2, 1::2]))


def _doubled(mask: Bools) -> Bools:
    """Every element as 2 x 2: two bytes at a time across, then row by row."""
    return np.repeat((mask.view(np.uint8) * np.uint16(0x0101)).view(np.bool_), 2, axis=0)


def _bordered(field: npt.NDArray[Any], value: np.generic) -> npt.NDArray[Any]:
    """The field with a border of one tile."""
    result = np.full((field.shape[0] + 2, field.shape[1] + 2), value, field.dtype)
    result[1:-1, 1:-1] = field
    return result


def _edges(counts: list[int], sizes: list[int], cells: int) -> npt.NDArray[np.int64]:
    """First and last post (2, n) of tiles along one axis, one tier behind the other."""
    first = np.concatenate([np.arange(n) * size for n, size in zip(counts, sizes, strict=True)])
    return np.stack([first, np.minimum(first + np.repeat(sizes, counts), cells)])


def _tolerance_m(
    tier: _Tier, window: Window, gap_z: Grid, gap_x: Grid, eye_m: np.float32, tolerance: np.float32
) -> Grid:  # fmt: skip
    """The error [m] allowed at the nearest point of each tile; gaps: squared distances to its rows and columns."""
    tol = np.maximum(tier.minimum_m[window] - eye_m, eye_m - tier.maximum_m[window])
    np.maximum(tol, 0, out=tol)
    np.square(tol, out=tol)
    tol += gap_x
    tol += gap_z[:, None]
    np.sqrt(tol, out=tol)
    tol *= tolerance
    return tol


def _ramps(tier: _Tier, window: Window, tol: Grid) -> Grid:
    """The sum of the clipped ramps of a tier."""
    total: Grid | None = None
    for start, scale in zip(tier.start, tier.scale, strict=True):
        v = tol - start[window]
        v *= scale[window]
        np.maximum(v, 0, out=v)
        np.minimum(v, 1, out=v)
        total = v if total is None else np.add(total, v, out=total)
    assert total is not None  # every tier has a ramp
    return total


def _limit_slope(field: Grid, levels: int) -> Grid:
    """The largest field below ``field`` whose neighbours differ by at most 1, for values between 0 and ``levels``.

    A tile limits others up to a distance of ``levels`` - 1 tiles only: as many steps are an exact L1 distance
    transform, and cheaper than running minima.
    """
    field = field.copy()
    for _ in range(levels - 1):
        above = field + np.float32(1)
        for axis in (0, 1):
            here, there = (slice(1, None), slice(None, -1)) if axis == 0 else (np.s_[:, 1:], np.s_[:, :-1])
            np.minimum(field[here], above[there], out=field[here])
            np.minimum(field[there], above[here], out=field[there])
    return field


def _no_tiles() -> Tiles:
    none = np.zeros(0, np.int32)
    return Tiles(np.zeros((0, 2), np.int32), none, none, np.zeros(0, np.float32), np.zeros((0, 4), np.float32))


assert BASE_LEVEL == 3  # the smallest tiles, 8 cells, are the finest nodes of the pyramid
