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

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Nodes
from terrain.algorithms.tile_tiers import Tier, build_tier, sum_ramps, tile_edges, tolerance_m
from terrain.algorithms.tile_windows import (
    Window,
    bordered,
    bounding_window,
    doubled,
    grown,
    join_parts,
    parts_window,
    whole,
)
from terrain.frame import Frame
from terrain.scene import Scene

Driver = Literal["distance", "time", "frames", "off"]
Grid = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

LARGEST_TILE_LEVEL = 8  # joined tiles of up to 256 cells
TILES_PER_SIDE = 256  # that automatic tiles have at most


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
        self.tiers: list[Tier] = []
        for t in range(self.size_level, last + 1):
            shape = [n >> (t - self.size_level) for n in largest]
            self.tiers.append(build_tier(pyramid, t, shape, self.tiers[-1] if self.tiers else None))
        self._in_grid = self.tiers[0].full >= 0
        self._overhangs = not self._in_grid.all()
        # First and last post of all tiers' columns, one tier behind the other, and of their rows [m].
        counts = np.array([tier.full.shape for tier in self.tiers])
        sizes = [1 << tier.size_level for tier in self.tiers]
        self._rows, self._cols = (
            spacing * tile_edges(counts[:, axis].tolist(), sizes, self.cells[axis])
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
            masks.append(join_parts(masks[-1], np.logical_or))
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
        window = whole(masks[-1])
        for index in range(len(self.tiers) - 1, -1, -1):
            tier = self.tiers[index]
            gap_z, gap_x = (
                gap[first + w.start : first + w.stop]
                for gap, first, w in zip(gaps, self._first[index], window, strict=True)
            )
            tol = tolerance_m(tier, window, gap_z, gap_x, np.float32(eye[1]), tolerance)
            windows.insert(0, window)
            fields.insert(0, sum_ramps(tier, window, tol))
            if index and everywhere:
                window = whole(masks[index - 1])
            elif index:
                # A ring around what is visible counts too, so that turning the head changes nothing in the middle.
                needed = grown(masks[index][window]) & (tol < tier.parts_full[window])
                margin = self.size_level + 2  # as far as a tile limits others, in parts of this tile
                window = parts_window(bounding_window(needed, window), window, margin)
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
                least[inside[0], inside[1]] = join_parts(levels[-1], np.minimum)
                within[inside[0], inside[1]] = True
            around = bordered(least, full)  # what lies outside limits nothing
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
                offer = bordered(offer, np.float32(0))
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
                gone = doubled(covered | exists)
                covered = gone[
                    inner[0].start - 2 * window[0].start : inner[0].stop - 2 * window[0].start,
                    inner[1].start - 2 * window[1].start : inner[1].stop - 2 * window[1].start,
                ]
        return Tiles(*(np.concatenate(column) for column in zip(*parts[::-1], strict=True))) if parts else _no_tiles()


def tile_triangles(tiles: Tiles) -> int:
    """Triangles of the tiles: 2^(2 (t - L) + 1) each (section 2)."""
    return int(np.left_shift(2, 2 * (tiles.size_level - tiles.level).astype(np.int64)).sum())


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
