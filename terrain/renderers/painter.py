"""Painter's ordering: draws every triangle far to near without a depth test.

Four paths, switchable: *procedural* draws runs of tiles as strips whose order the shader computes from the vertex
number; *cells* does so triangle by triangle with the general rule, without sectors; *indexed* is the paper's, one call
per tile from index buffers, orders of straddling tiles uploaded as needed; *shuffled* is its experiment with indices in
random order.

Source: Alonso and Joan-Arinyo, sections 5, 6.1 and 8.

Deviations: heights come from one texture instead of a vertex buffer per tile. Depth is written, with a test that always
passes, so that sky, boxes and flight paths are hidden properly. A frozen selection keeps its order and is drawn with a
depth test, so that one can watch it from elsewhere (figure 13).

Where each fragment costs, as on a software rasteriser, the z-buffer mode is the faster one, by 2 to 18 % at depths 3 to
6: it shades 1.02 fragments per pixel, painting 1.20. The order itself is free: a wrong one is no faster.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Culler, Nodes
from terrain.algorithms.painter import FIXED_FOOT, Foot, classify_tiles, foot_at
from terrain.algorithms.painter_errors import LevelErrors, load_level_errors
from terrain.algorithms.painter_levels import order_blocks, tile_edges
from terrain.algorithms.painter_tiles import (
    CELLS,
    TileGrid,
    Tiles,
    build_order,
    build_shuffled_order,
    order_indexed,
    order_runs,
)
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.scene import Scene

Ints = npt.NDArray[np.int64]

MAX_DEPTH = 8
STRIP_LEVEL = 5  # the procedural paths order tiles of at most 32 cells, whatever the depth of the quadtree


@dataclass(frozen=True)
class PainterSettings(base.Settings):
    """Settings of the painter."""

    mode: str = setting(
        "correct", "Mode",
        "Correct: far to near, no depth test; z-buffer: a fixed order and a depth test; wrong: a fixed order, no test.",
        choices=("correct", "z-buffer", "wrong"),
    )  # fmt: skip
    path: str = setting(
        "procedural", "Order from",
        "Procedural: strips by vertex number; cells: triangles by vertex number; indexed: index buffers, one call per "
        "tile; shuffled: indices in random order, for the z-buffer mode.",
        choices=("procedural", "cells", "indexed", "shuffled"),
    )  # fmt: skip
    depth: int = setting(
        7, "Quadtree depth", "Tiles are the nodes this far below the root.", range=(0, MAX_DEPTH), rebuild=True
    )
    levels: bool = setting(True, "Level of detail", "Draw far tiles coarser, within the tolerance.")
    horizon: bool = setting(True, "Horizon culling", "Drop tiles hidden behind nearer ground.")
    painted: float = setting(
        100.0, "Painted", "Share of the picture's triangles that are drawn: watch the painter paint.", unit="%",
        range=(0.0, 100.0),
    )  # fmt: skip
    randomness: float = setting(
        0.0, "Randomness", "Share of triangles at random places in the shuffled path.", unit="%", range=(0.0, 100.0)
    )
    colours: str = setting(
        "sectors", "Levels view shows", "Sectors around the eye's foot point, or levels of detail.",
        choices=("sectors", "levels"),
    )  # fmt: skip


# Kinds of draw calls.
NUMBERED_STRIPS, NUMBERED_TRIANGLES, STRIPS, LISTS = range(4)
PRIMITIVES = (moderngl.TRIANGLE_STRIP, moderngl.TRIANGLES, moderngl.TRIANGLE_STRIP, moderngl.TRIANGLES)


class Calls(NamedTuple):
    """Draw calls in order, as arrays: kind, ``u_run`` (n, 4), first index, and number of vertices or indices."""

    kind: Ints
    run: npt.NDArray[np.int32] | Ints
    first: Ints
    vertices: Ints


class OrderBuffer:
    """An index buffer that holds the orders used lately, each at its place."""

    def __init__(self, gpu: Gpu) -> None:
        self.buffer: moderngl.Buffer = gpu.ctx.buffer(reserve=4 << 16, dynamic=True)
        self._places: dict[Any, tuple[int, int]] = {}
        self._used = 0

    def fetch(
        self, keys: Sequence[Any], build: Callable[[Any], npt.NDArray[np.uint32]]
    ) -> tuple[list[tuple[int, int]], int]:
        """First index and number of indices of each order, and the bytes uploaded for those that were missing."""
        missing = {key: build(key) for key in keys if key not in self._places}
        size = sum(order.nbytes for order in missing.values())
        if self._used + size > self.buffer.size:  # start again with what this frame needs
            missing = {key: missing[key] if key in missing else build(key) for key in keys}
            size = sum(order.nbytes for order in missing.values())
            self.buffer.orphan(max(self.buffer.size, 2 * size))
            self._places, self._used = {}, 0
        for key, order in missing.items():
            self.buffer.write(order.tobytes(), offset=self._used)
            self._places[key] = (self._used // 4, len(order))
            self._used += order.nbytes
        return [self._places[key] for key in keys], size


class PainterRenderer:
    """The whole surface, or its levels of detail, in back-to-front order.

    Attributes
    ----------
    writes_depth : bool
        Depth is written although nothing tests it: sky, boxes and flight paths do. False only to measure what it costs.
    """

    name = "painter"
    title = "Painter's ordering"
    source = "Alonso and Joan-Arinyo, Back-to-front ordering of triangles in digital terrain models over regular grids"
    Settings = PainterSettings
    diagonal: Diagonal = "uniform"

    def __init__(self, gpu: Gpu, scene: Scene, settings: PainterSettings) -> None:
        self.settings: Any = settings
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        self.writes_depth = True
        cells = scene.pyramid.cells
        # A tile keeps 2 x 2 cells, so that it can be stitched.
        self._tile_level = max((max(cells) - 1).bit_length() - settings.depth, 1)
        self._culler = Culler(scene, self._tile_level)
        self._node_level = self._culler.finest_level
        self._errors: LevelErrors | None = None  # made when levels are first asked for
        table = order_blocks()
        self._orders = gpu.ctx.texture(table.shape[::-1], 1, table.tobytes(), dtype="u4")
        self._orders.filter = moderngl.NEAREST, moderngl.NEAREST
        self._strips, self._lists = OrderBuffer(gpu), OrderBuffer(gpu)
        self._numbered = Geometry(gpu, "painter", "mesh")
        strips, lists = (Geometry(gpu, "painter", "mesh", (), b.buffer) for b in (self._strips, self._lists))
        self._geometry = (self._numbered, self._numbered, strips, lists)  # by kind of call
        self._nodes: Nodes | None = None
        self._foot = FIXED_FOOT
        self._grid = TileGrid(cells, self._tile_level)
        self._tiles = Tiles(*(np.zeros(0, np.int64) for _ in range(4)))
        self._calls = Calls(*(np.zeros(0, np.int64) for _ in range(4)))

    def select(self, frame: Frame) -> None:
        settings = self.settings
        self._nodes = nodes = self._culler.select(frame, horizon=settings.horizon)
        by_number = settings.path in ("procedural", "cells") and not settings.levels
        tile_level = min(self._tile_level, STRIP_LEVEL) if by_number else self._tile_level
        self._grid = TileGrid(self._scene.pyramid.cells, tile_level)
        row, col = self._grid.inside(nodes.row, nodes.col, self._node_level)
        level = edges = np.zeros(len(row), np.int64)
        if settings.levels and settings.path != "shuffled":
            levels = self._select_levels(frame)
            level, edges = levels[row, col], tile_edges(levels)[row, col]
        self._tiles = Tiles(row, col, level, edges)
        self._order(self._foot_of(frame))
        self.stats.triangles = self._grid.triangles(self._tiles)
        self.stats.resident_bytes = self._orders.width * self._orders.height * 4
        self.stats.resident_bytes += self._strips.buffer.size + self._lists.buffer.size
        self.stats.extra = {"tiles": len(row), "stitched tiles": int(np.count_nonzero(edges))}

    def _select_levels(self, frame: Frame) -> Ints:
        """Level of every tile of the terrain, seen or not: neighbours must know each other's."""
        terrain, size = self._scene.heightfield, 1 << self._tile_level
        if self._errors is None:
            begin = time.perf_counter()
            self._errors = load_level_errors(terrain, size)
            self.stats.prepare_s = time.perf_counter() - begin
        x, y, z = frame.eye_m
        rows, cols = self._grid.cells
        tile_rows, tile_cols = self._grid.shape
        gap_x = _gap_m(x, np.arange(tile_cols) * size, size, cols, terrain.spacing_m[0])
        gap_z = _gap_m(z, np.arange(tile_rows) * size, size, rows, terrain.spacing_m[1])
        shift = self._node_level - self._tile_level
        row, col = (np.arange(n) >> shift for n in self._grid.shape)
        pyramid = self._scene.pyramid
        lower, upper = (b(self._node_level)[np.ix_(row, col)] for b in (pyramid.minimum, pyramid.maximum))
        gap_y = np.maximum(np.maximum(lower - y, y - upper), 0.0)
        distance_m = np.sqrt(gap_x**2 + gap_y**2 + gap_z[:, None] ** 2)
        return self._errors.select(self.settings.tolerance_px * distance_m / frame.pixels_per_radian)

    def _foot_of(self, frame: Frame) -> Foot:
        if self.settings.mode != "correct":
            return FIXED_FOOT
        dx, dz = self._scene.heightfield.spacing_m
        return foot_at(float(frame.eye_m[0]) / dx, float(frame.eye_m[2]) / dz)

    def _order(self, foot: Foot) -> None:
        """Turn the chosen tiles into draw calls, far to near as seen from ``foot``."""
        self._foot = foot
        if self.settings.path in ("procedural", "cells"):
            runs = order_runs(foot, self._tiles, self._grid, cells_only=self.settings.path == "cells")
            kind = np.where(runs.run[:, 2] < CELLS, NUMBERED_STRIPS, NUMBERED_TRIANGLES)
            self._calls = Calls(kind, runs.run, np.zeros_like(kind), runs.vertices)
            self.stats.uploaded_bytes = 0
        else:
            self._calls, self.stats.uploaded_bytes = self._indexed_calls(foot)
        self.stats.draw_calls = len(self._calls.kind)

    def _indexed_calls(self, foot: Foot) -> tuple[Calls, int]:
        """One call per tile, and the bytes of the orders that had to be uploaded for it."""
        drawn = order_indexed(foot, self._tiles, self._grid)
        if self.settings.path == "shuffled":
            cells = 1 << self._tile_level
            places, uploaded = self._lists.fetch(
                [self.settings.randomness], lambda percent: build_shuffled_order(cells, percent / 100.0)
            )
            kind, place = np.full(len(drawn.order), LISTS), np.zeros_like(drawn.order)
        else:
            is_stitched = np.array([key[1] != 0 for key in drawn.keys], np.bool_)
            of_strips, strip_bytes = self._strips.fetch([k for k in drawn.keys if k[1] == 0], build_order)
            of_lists, list_bytes = self._lists.fetch([k for k in drawn.keys if k[1] != 0], build_order)
            places, uploaded = of_strips + of_lists, strip_bytes + list_bytes
            place = np.argsort(np.argsort(is_stitched, kind="stable"))[drawn.order]
            kind = np.where(is_stitched[drawn.order], LISTS, STRIPS)
        first, count = np.array(places, np.int64).reshape(-1, 2)[place].T
        return Calls(kind, drawn.run, first, count), uploaded

    def draw(self, frame: Frame) -> None:
        ctx, settings = self._gpu.ctx, self.settings
        program = self._numbered.program(frame.output)
        values = {
            "u_foot": tuple(self._foot), "u_tiles": (*self._grid.shape, self._grid.tile_level),
            "u_colours": int(settings.colours == "levels"),
        }  # fmt: skip
        for name, value in values.items():
            if name in program:
                program[name] = value
        self._orders.use(UNITS["u_extra0"])
        # Lines keep their picture's depth test; and so does a frozen order, which can then be watched from anywhere.
        is_painted = settings.mode != "z-buffer" and frame.output != "flat" and self._foot == self._foot_of(frame)
        if is_painted and self.writes_depth:
            ctx.depth_func = "1"  # always: the last write is the nearest
        elif is_painted:
            ctx.disable(moderngl.DEPTH_TEST)  # which stops depth writes too
        arrays = [geometry.array(frame.output) for geometry in self._geometry]
        run_uniform: Any = program["u_run"]
        kind, run, first, count = (a.tolist() for a in self._painted())
        for k, r, f, n in zip(kind, run, first, count, strict=True):
            run_uniform.value = r
            arrays[k].render(PRIMITIVES[k], n, first=f)
        ctx.depth_func = ">"
        ctx.enable(moderngl.DEPTH_TEST)

    def _painted(self) -> Calls:
        """The calls that make the first share of the picture, the last of them cut short."""
        calls, share = self._calls, self.settings.painted / 100.0
        if share >= 1.0 or not len(calls.kind):
            return calls
        before = np.cumsum(calls.vertices) - calls.vertices
        count = np.clip(int(share * calls.vertices.sum()) - before, 0, calls.vertices)
        kept = count > 0
        return Calls(calls.kind[kept], calls.run[kept], calls.first[kept], count[kept])

    def boxes(self) -> Boxes:
        nodes = self._nodes
        if nodes is None or not len(nodes.level):
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        lower, upper = self._culler.boxes(nodes)
        row, col = nodes.row.astype(np.int64) << self._node_level, nodes.col.astype(np.int64) << self._node_level
        return Boxes(lower, upper, classify_tiles(self._foot, row, col, 1 << self._node_level))

    def release(self) -> None:
        for geometry in self._geometry:
            geometry.release()
        for part in (self._orders, self._strips.buffer, self._lists.buffer):
            part.release()


def _gap_m(eye_m: float, first: Ints, size: int, count: int, spacing_m: float) -> npt.NDArray[np.float64]:
    """Distance along one axis between the eye and lines of tiles that start at post ``first``."""
    last = np.minimum(first + size, count)
    return np.maximum(np.maximum(first * spacing_m - eye_m, eye_m - last * spacing_m), 0.0)
