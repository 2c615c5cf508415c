"""The reference: every triangle of the surface, in culled tiles. The truth of all accuracy figures and the base of all
speed-ups ("brute force with quadtree culling" in the papers)."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from terrain.algorithms.culling import Culler, Nodes
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes
from terrain.renderers.tile_mesh import build_tile_indices
from terrain.scene import Scene

TILE_LEVEL = 5  # tiles of 32 x 32 cells


class ReferenceRenderer:
    """Full-resolution mesh of the surface, frustum-culled, with a depth buffer."""

    name = "reference"
    title = "Reference (full mesh)"
    source = "The surface itself: every post, every triangle."
    Settings = base.Settings

    def __init__(self, gpu: Gpu, scene: Scene, settings: base.Settings, diagonal: Diagonal = "alternating") -> None:
        self.settings: Any = settings
        self.diagonal: Diagonal = diagonal
        self.stats = FrameStats()
        self._culler = Culler(scene, TILE_LEVEL)
        indices = build_tile_indices(1 << TILE_LEVEL, diagonal)
        self._index_buffer = gpu.ctx.buffer(indices.tobytes())
        self._tiles = gpu.ctx.buffer(reserve=8 * self._culler.node_count(TILE_LEVEL), dynamic=True)
        self._geometry = Geometry(gpu, "reference", "mesh", [(self._tiles, "2i /i", "in_tile")], self._index_buffer)
        self._nodes: Nodes | None = None
        self._triangles_per_tile = len(indices) // 3
        self.stats.resident_bytes = indices.nbytes + self._tiles.size

    def select(self, frame: Frame) -> None:
        self._nodes = nodes = self._culler.select(frame, horizon=False)
        posts = np.stack([nodes.col, nodes.row], axis=1) << TILE_LEVEL
        self._tiles.write(np.ascontiguousarray(posts, np.int32))
        self.stats.uploaded_bytes = posts.nbytes
        self.stats.triangles = self._triangles_per_tile * len(posts)
        self.stats.draw_calls = int(len(posts) > 0)
        self.stats.extra = {"tiles": len(posts)}

    def draw(self, frame: Frame) -> None:
        count = 0 if self._nodes is None else len(self._nodes.level)
        if count:
            self._geometry.program(frame.output)["u_tile_posts"] = (1 << TILE_LEVEL) + 1
            self._geometry.render(frame.output, moderngl.TRIANGLES, instances=count)

    def boxes(self) -> Boxes:
        if self._nodes is None:
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        lower, upper = self._culler.boxes(self._nodes)
        return Boxes(lower, upper, np.zeros(len(lower), np.int64))

    def release(self) -> None:
        for part in (self._geometry, self._index_buffer, self._tiles):
            part.release()
