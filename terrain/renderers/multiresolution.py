"""Draws the approximation tree: all chosen patches in one draw call, front to back, then the walls between them.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data".
"""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from terrain.algorithms.culling import Culler, Nodes
from terrain.algorithms.multiresolution import (
    FINEST_LEVEL,
    ApproximationTree,
    build_preview,
    load_tree,
    select_patches,
)
from terrain.algorithms.patch_pool import PatchPool
from terrain.algorithms.rtin import STEEPEST
from terrain.algorithms.rtin_mesh import Patches
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import GL_CLIP_DISTANCE0, Gpu
from terrain.gpu.geometry import Geometry
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.scene import Scene


@dataclass(frozen=True)
class MultiresolutionSettings(base.Settings):
    """Settings of the multiresolution renderer."""

    horizon: bool = setting(True, "Horizon culling", "Drop patches hidden behind nearer ground.")
    walls: bool = setting(True, "Walls", "Close the gaps between patches of different error or size.")
    tins: int = setting(
        2, "TINs per resting frame", "Microstructures triangulated in each frame while the camera rests.", range=(0, 16)
    )
    preview: bool = setting(
        False, "Preview", "Show every fourth post while the tree of a new terrain is built, instead of waiting for it.",
        rebuild=True,
    )  # fmt: skip


class MultiresolutionRenderer:
    """Patches of adaptive triangles and TINs, chosen by their error on the screen."""

    name = "multiresolution"
    title = "Multiresolution patches"
    source = "Doellner, Integrated multiresolution modeling of terrain geometry and terrain texture data, 2000"
    Settings = MultiresolutionSettings
    diagonal: Diagonal = "alternating"

    def __init__(self, gpu: Gpu, scene: Scene, settings: MultiresolutionSettings) -> None:
        self.settings: Any = settings
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        self._begun = time.perf_counter()
        self._culler = Culler(scene, FINEST_LEVEL)
        self._worker = ThreadPoolExecutor(1, "approximation-tree")
        self._coming: Future[ApproximationTree] | None = self._worker.submit(load_tree, scene.heightfield)
        self._pool: PatchPool | None = None
        self._indices = gpu.ctx.buffer(reserve=4, dynamic=True)
        self._geometry: Geometry | None = None
        self._overhangs = False
        self._patches: Patches | None = None
        self._nodes: Nodes | None = None
        self._chosen_eye_m = np.zeros(3)
        self._wall = (0.0, 0.0)
        self._walls = np.empty(0, np.int32)
        self._by_rung = False  # how the patches in the index buffer are sorted: for the levels view by rung

    def select(self, frame: Frame) -> None:
        settings = self.settings
        pool = self._current_pool()
        tree = pool.tree
        patches, self._nodes = select_patches(
            tree, self._culler, frame, settings.tolerance_px, horizon=settings.horizon
        )
        rests = self._patches is not None and all(map(np.array_equal, patches, self._patches))
        refined = pool.refine(patches, settings.tins) if rests and settings.tins else 0
        self._patches = patches
        self._chosen_eye_m = frame.eye_m
        error_per_m = settings.tolerance_px / frame.pixels_per_radian
        # Both sides may err, each straight down by 1 / STEEPEST times its error.
        self._wall = 2.0 / STEEPEST * error_per_m, 2.0 / STEEPEST * float(tree.rtin.ladder.exact_m)
        self.stats.uploaded_bytes = 0
        if not rests or refined or self._by_rung or settings.walls != (len(self._walls) > 0):
            self._upload(patches)
        self.stats.draw_calls = 1
        self.stats.resident_bytes = pool.resident_bytes + self._indices.size + tree.rtin.drop_rung.nbytes

    def finish(self) -> None:
        """Wait until the tree is built, so that the next `select` uses it."""
        if self._coming is not None:
            self._coming.result()

    def _current_pool(self) -> PatchPool:
        """The meshes of the tree, or of its preview while the tree is being built."""
        if self._coming is not None and (not self.settings.preview or self._coming.done()):
            self._use(self._coming.result())
            self._coming = None
            self.stats.prepare_s = time.perf_counter() - self._begun
        if self._pool is None:
            self._use(build_preview(self._scene.heightfield))
        assert self._pool is not None
        return self._pool

    def _use(self, tree: ApproximationTree) -> None:
        self._pool, self._patches = PatchPool(tree), None
        terrain, shape = self._scene.heightfield, tree.rtin.drop_rung.shape
        self._overhangs = ((shape[0] - 1) * tree.stride, (shape[1] - 1) * tree.stride) != (
            terrain.rows - 1,
            terrain.cols - 1,
        )
        if self._geometry is not None:
            self._geometry.release()
        defines = {"CLIP_EDGES": 1} if self._overhangs else {}
        self._geometry = Geometry(self._gpu, "multiresolution", "mesh", (), self._indices, defines)

    def _upload(self, patches: Patches) -> None:
        """Write the triangles of the patches, and of their walls, as one list of post numbers."""
        assert self._pool is not None
        posts = self._pool.gather(patches)
        extracted = self._pool.extracted
        self._walls = self._pool.walls(patches) if self.settings.walls else np.empty(0, np.int32)
        self._write(np.concatenate([posts, self._walls]))
        self._by_rung = False
        self.stats.triangles = (len(posts) + len(self._walls)) // 3
        self.stats.extra = {
            "patches": len(patches.level), "new patches": extracted, "TINs": self._pool.count_tins(patches),
            "wall triangles": len(self._walls) // 3,
        }  # fmt: skip

    def _write(self, posts: np.ndarray[Any, np.dtype[np.int32]]) -> None:
        if posts.nbytes > self._indices.size:
            self._indices.orphan(2 * posts.nbytes)
        if len(posts):
            self._indices.write(posts)
        self.stats.uploaded_bytes += posts.nbytes

    def draw(self, frame: Frame) -> None:
        geometry, pool = self._geometry, self._pool
        if geometry is None or pool is None or not self.stats.triangles:
            return
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.enable_direct(GL_CLIP_DISTANCE0 + plane)
        program = geometry.program(frame.output)
        program["u_row_length"] = pool.tree.rtin.drop_rung.shape[1]
        program["u_stride"] = pool.tree.stride
        program["u_chosen_eye"] = tuple(self._chosen_eye_m - frame.eye_m)
        program["u_wall"] = self._wall
        if frame.output == "levels":
            self._draw_rungs(geometry, program)
        else:
            geometry.render(frame.output, moderngl.TRIANGLES, 3 * self.stats.triangles)
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.disable_direct(GL_CLIP_DISTANCE0 + plane)

    def _draw_rungs(self, geometry: Geometry, program: moderngl.Program) -> None:
        """The levels view: a draw call for each rung, since a post number cannot tell what patch it belongs to."""
        assert self._pool is not None
        assert self._patches is not None
        first = 0
        lists = []
        ranges = []
        for rung in np.unique(self._patches.rung):
            posts = self._pool.gather(self._patches.take(self._patches.rung == rung))
            lists.append(posts)
            ranges.append((int(rung), first, len(posts)))
            first += len(posts)
        uploaded = self.stats.uploaded_bytes
        self._write(np.concatenate([*lists, self._walls]))
        self.stats.uploaded_bytes = uploaded
        self._by_rung = True
        for rung, start, count in [*ranges, (0, first, len(self._walls))]:
            program["u_level"] = float(rung)
            geometry.render("levels", moderngl.TRIANGLES, count, first=start)

    def boxes(self) -> Boxes:
        if self._nodes is None or self._patches is None:
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        lower, upper = self._culler.boxes(self._nodes)
        return Boxes(lower, upper, self._patches.rung.astype(np.int64))

    def release(self) -> None:
        self._worker.shutdown(wait=True)
        if self._geometry is not None:
            self._geometry.release()
        self._indices.release()
