"""Geomorphing tiles: draws what `terrain.algorithms.geomorph` selects, all tiles of one mesh in one instanced draw."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import moderngl
import numpy as np

from terrain.algorithms.culling import Culler
from terrain.algorithms.geomorph import TileLevels, Tiles, automatic_tile_cells, tile_triangles
from terrain.algorithms.morph_targets import build_morph_targets, morph_targets_shape
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import GL_CLIP_DISTANCE0, Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.renderers.tile_mesh import build_tile_indices
from terrain.scene import Scene

SMALL_NODES_CELLS = 224  # up to this distance the nodes that are culled are as small as the smallest tiles
LARGEST_GAIN, SMALLEST_GAIN = 0.6, 0.02  # how much of the gap between cost and budget one frame closes, in powers
RECORD_WORDS = 8  # of 32 bits per tile: north-west post, level; lambda of the interior and of the four edges


@dataclass(frozen=True)
class GeomorphSettings(base.Settings):
    """Settings of the geomorphing tiles."""

    tile_cells: int = setting(
        0, "Tile size", "Cells along the smallest tiles; 0 suits them to the terrain.",
        unit="cells", choices=(0, 8, 16, 32, 64), rebuild=True,
    )  # fmt: skip
    join: bool = setting(True, "Join quiet tiles", "Draw four tiles at their coarsest level as one.", rebuild=True)
    horizon: bool = setting(True, "Horizon culling", "Drop tiles hidden behind nearer ground.")
    driver: str = setting(
        "distance", "Morph driven by",
        "Distance: nothing moves while the eye rests; time, frames: changes take a fixed while; off: levels switch.",
        choices=("distance", "time", "frames", "off"),
    )  # fmt: skip
    morph_s: float = setting(1.0, "Morph time", "Seconds per level when driven by time.", unit="s", range=(0.1, 5.0))
    morph_frames: int = setting(30, "Morph frames", "Frames per level when driven by frames.", range=(1, 240))
    starts_per_frame: int = setting(
        65536, "Starts per frame", "Tiles that may leave their level in one frame; the others wait.", range=(1, 65536)
    )
    budget: str = setting(
        "off", "Fixed cost", "Raise the tolerance until a frame stays within the budget below.",
        choices=("off", "triangles", "milliseconds"),
    )  # fmt: skip
    budget_triangles: int = setting(100_000, "Triangle budget", "Triangles per frame.", range=(1_000, 2_000_000))
    budget_ms: float = setting(16.0, "Time budget", "Milliseconds per frame.", unit="ms", range=(1.0, 200.0))

    def unhurried(self) -> Self:
        driver = self.driver if self.driver == "off" else "distance"
        return replace(self, driver=driver, starts_per_frame=65536, budget="off")


class GeomorphRenderer:
    """Tiles at continuous levels, morphed in the vertex shader."""

    name = "geomorph"
    title = "Geomorphing tiles"
    source = "Larsen and Christensen, Real-time terrain rendering using smooth hardware optimized level of detail, 2003"
    Settings = GeomorphSettings
    diagonal: Diagonal = "alternating"

    def __init__(self, gpu: Gpu, scene: Scene, settings: GeomorphSettings) -> None:
        self.settings: Any = settings
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        tile_cells = settings.tile_cells or automatic_tile_cells(scene.pyramid.cells)
        self._levels = TileLevels(scene, tile_cells, settings.join)
        self._culler = Culler(scene, self._levels.size_level)
        self._tile_count = int(np.prod(self._levels.tiers[0].minimum_m.shape))
        meshes = [build_tile_indices(1 << k) for k in range(self._levels.size_level + 1)]
        self._index_buffers = [gpu.ctx.buffer(mesh.tobytes()) for mesh in meshes]
        self._instances = [gpu.ctx.buffer(reserve=4 * RECORD_WORDS, dynamic=True) for _ in meshes]
        size = 1 << self._levels.tiers[-1].size_level
        heights_m = scene.heightfield.heights_m
        rows, cols = morph_targets_shape(heights_m.shape, size)
        self._posts = gpu.ctx.texture((cols, rows), 2, dtype="f4")
        for row, band in build_morph_targets(heights_m, size):
            self._posts.write(band, viewport=(0, row, cols, len(band)))
        self._posts.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._overhangs = any(n % size for n in scene.pyramid.cells)
        defines = {"CLIP_EDGES": 1} if self._overhangs else {}
        self._geometry = [
            Geometry(
                gpu, "geomorph", "mesh", [(tiles, "3i 1f 4f /i", "in_tile", "in_lam", "in_edge_lam")], mesh, defines
            )
            for tiles, mesh in zip(self._instances, self._index_buffers, strict=True)
        ]
        self._tiles: Tiles | None = None
        self._counts = np.zeros(len(meshes), np.int64)  # tiles per mesh of 2^k cells per side
        self._tolerance_px = settings.tolerance_px
        self._excess, self._gain = 0.0, LARGEST_GAIN
        self._static_bytes = 8 * rows * cols + sum(mesh.nbytes for mesh in meshes)

    def select(self, frame: Frame) -> None:
        settings = self.settings
        tolerance = self._steered_tolerance()
        split_ratio = SMALL_NODES_CELLS / (1 << self._levels.size_level)
        visible = self._culler.select(frame, horizon=settings.horizon, split_ratio=split_ratio)
        queue = settings.starts_per_frame if settings.starts_per_frame < self._tile_count else None
        self._tiles = tiles = self._levels.select(
            frame, visible, tolerance, settings.driver, settings.morph_s, settings.morph_frames, queue
        )
        self._upload(tiles, frame)
        self.stats.triangles = tile_triangles(tiles)
        self.stats.draw_calls = int(np.count_nonzero(self._counts))
        self.stats.resident_bytes = self._static_bytes + sum(buffer.size for buffer in self._instances)
        self.stats.extra = {
            "tiles": len(tiles.lam), "cells per tile": 1 << self._levels.size_level, "steered tolerance [px]": tolerance
        }  # fmt: skip

    def _steered_tolerance(self) -> float:
        """The tolerance that keeps the last frame's cost within the budget, never below the one asked for."""
        settings, stats = self.settings, self.stats
        cost, budget = 0.0, 1.0
        if settings.budget == "triangles":
            cost, budget = stats.triangles, settings.budget_triangles
        elif settings.budget == "milliseconds" and stats.frame_ms is not None:
            cost, budget = stats.frame_ms, settings.budget_ms
        if settings.budget == "off":
            self._tolerance_px = settings.tolerance_px
        elif cost > 0:
            # Triangles fall about in proportion to the tolerance, but on even ground by leaps: where a step went past
            # the budget, the next ones are shorter.
            excess = math.log(cost / budget)
            crossed = excess * self._excess < 0
            self._gain = max(0.5 * self._gain, SMALLEST_GAIN) if crossed else min(1.1 * self._gain, LARGEST_GAIN)
            self._excess = excess
            self._tolerance_px *= math.exp(self._gain * min(max(excess, -1.4), 1.4))
        self._tolerance_px = float(np.clip(self._tolerance_px, settings.tolerance_px, 1024.0))
        return self._tolerance_px

    def _upload(self, tiles: Tiles, frame: Frame) -> None:
        """One record per tile, tiles of one mesh side by side, the finest and nearest first."""
        mesh = tiles.size_level - tiles.level
        # Sixteen bits are order enough, and are sorted many times faster: finest mesh first, then by log distance (the
        # upper bits of a float).
        dx, dz = self._scene.heightfield.spacing_m
        half = np.left_shift(1, tiles.size_level).astype(np.float32) / 2
        x = (tiles.post[:, 0].astype(np.float32) + half) * np.float32(dx) - np.float32(frame.eye_m[0])
        z = (tiles.post[:, 1].astype(np.float32) + half) * np.float32(dz) - np.float32(frame.eye_m[2])
        nearness = (x * x + z * z).view(np.int32) >> 18
        rank = len(self._counts) - 1 - mesh
        order = np.argsort(((rank << 13) + nearness).astype(np.uint16), kind="stable")
        records = np.empty((len(order), RECORD_WORDS), np.int32)
        records[:, :2], records[:, 2] = tiles.post, tiles.level
        records[:, 3], records[:, 4:] = tiles.lam.view(np.int32), tiles.edge_lam.view(np.int32)
        records = np.take(records, order, axis=0)
        self._counts = np.bincount(mesh, minlength=len(self._geometry))
        last = np.cumsum(self._counts[::-1])[::-1]  # the finest mesh comes first
        for buffer, stop, count in zip(self._instances, last, self._counts, strict=True):
            data = records[stop - count : stop]
            if data.nbytes > buffer.size:
                buffer.orphan(2 * data.nbytes)
            if count:
                buffer.write(data)
        self.stats.uploaded_bytes = records.nbytes

    def draw(self, frame: Frame) -> None:
        self._posts.use(UNITS["u_morph"])
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.enable_direct(GL_CLIP_DISTANCE0 + plane)
        for mesh in reversed(range(len(self._geometry))):
            if self._counts[mesh]:
                geometry = self._geometry[mesh]
                geometry.program(frame.output)["u_cells"] = 1 << mesh
                geometry.render(frame.output, moderngl.TRIANGLES, instances=int(self._counts[mesh]))
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.disable_direct(GL_CLIP_DISTANCE0 + plane)

    def boxes(self) -> Boxes:
        tiles = self._tiles
        if tiles is None or not len(tiles.lam):
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        lower, upper = self._levels.boxes(tiles)
        return Boxes(lower, upper, tiles.level.astype(np.int64))

    def release(self) -> None:
        self._posts.release()
        for geometry in self._geometry:
            geometry.release()
        for buffer in (*self._index_buffers, *self._instances):
            buffer.release()
