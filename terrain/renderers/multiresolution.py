"""Draws the approximation tree: all chosen patches in one draw call, front to back, the walls between them in another.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data".
"""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Culler, Nodes
from terrain.algorithms.multiresolution import (
    FINEST_LEVEL,
    ApproximationTree,
    build_preview,
    load_tree,
    select_patches,
)
from terrain.algorithms.patch_pool import PatchPool
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
        0, "TINs per resting frame",
        "Microstructures triangulated in each frame while the camera rests; 0 keeps what is drawn the same.",
        range=(0, 16),
    )  # fmt: skip
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
        self._uploaded_for: Any = None  # the settings at the last upload
        self._culler = Culler(scene, FINEST_LEVEL)
        self._worker = ThreadPoolExecutor(1, "approximation-tree")
        self._coming: Future[ApproximationTree] | None = self._worker.submit(load_tree, scene.heightfield)
        self._pool: PatchPool | None = None
        self._indices = gpu.ctx.buffer(reserve=4, dynamic=True)
        self._wall_corners = gpu.ctx.buffer(reserve=16, dynamic=True)
        self._geometry: Geometry | None = None
        self._wall_geometry: Geometry | None = None
        self._overhangs = False
        self._patches: Patches | None = None
        self._nodes: Nodes | None = None
        self._counts = 0, 0  # triangles of patches and of walls
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
        self.stats.uploaded_bytes = 0
        if not rests or refined or self._by_rung or settings != self._uploaded_for:
            self._upload(patches)
        self.stats.resident_bytes = (
            pool.resident_bytes + self._indices.size + self._wall_corners.size + tree.rtin.drop_rung.nbytes
        )

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
        covered = (shape[0] - 1) * tree.stride, (shape[1] - 1) * tree.stride
        self._overhangs = covered != (terrain.rows - 1, terrain.cols - 1)
        self._release_geometry()
        defines = {"CLIP_EDGES": 1} if self._overhangs else {}
        self._geometry = Geometry(self._gpu, "multiresolution", "mesh", (), self._indices, defines)
        corners = [(self._wall_corners, "4f", "in_corner")]
        self._wall_geometry = Geometry(self._gpu, "multiresolution_wall", "mesh", corners, defines=defines)

    def _upload(self, patches: Patches) -> None:
        """Write the triangles of the patches as one list of post numbers, and those of the walls."""
        assert self._pool is not None
        posts = self._pool.gather(patches)
        extracted = self._pool.extracted
        walls = self._pool.walls(patches) if self.settings.walls else np.empty((0, 3, 4), np.float32)
        _write(self._indices, posts)
        _write(self._wall_corners, walls)
        self._by_rung, self._uploaded_for = False, self.settings
        self._counts = len(posts) // 3, len(walls)
        self.stats.uploaded_bytes = posts.nbytes + walls.nbytes
        self.stats.triangles = sum(self._counts)
        self.stats.draw_calls = sum(count > 0 for count in self._counts)
        self.stats.extra = {
            "patches": len(patches.level), "new patches": extracted, "TINs": self._pool.count_tins(patches),
            "wall triangles": len(walls),
        }  # fmt: skip

    def draw(self, frame: Frame) -> None:
        geometry, walls, pool = self._geometry, self._wall_geometry, self._pool
        if geometry is None or walls is None or pool is None:
            return
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.enable_direct(GL_CLIP_DISTANCE0 + plane)
        program = geometry.program(frame.output)
        program["u_row_length"] = pool.tree.rtin.drop_rung.shape[1]
        program["u_stride"] = pool.tree.stride
        triangles, wall_triangles = self._counts
        if frame.output == "levels":
            self._draw_rungs(geometry, program)
        elif triangles:
            geometry.render(frame.output, moderngl.TRIANGLES, 3 * triangles)
        if wall_triangles:
            walls.program(frame.output)["u_stride"] = pool.tree.stride
            walls.render(frame.output, moderngl.TRIANGLES, 3 * wall_triangles)
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.disable_direct(GL_CLIP_DISTANCE0 + plane)

    def _draw_rungs(self, geometry: Geometry, program: moderngl.Program) -> None:
        """The levels view: a draw call for each rung, since a post number cannot tell what patch it belongs to."""
        assert self._pool is not None
        assert self._patches is not None
        rungs = np.unique(self._patches.rung)
        lists = [self._pool.gather(self._patches.take(self._patches.rung == rung)) for rung in rungs]
        if not lists:
            return
        _write(self._indices, np.concatenate(lists))
        self._by_rung = True
        first = 0
        for rung, posts in zip(rungs, lists, strict=True):
            program["u_level"] = float(rung)
            geometry.render("levels", moderngl.TRIANGLES, len(posts), first=first)
            first += len(posts)

    def boxes(self) -> Boxes:
        if self._nodes is None or self._patches is None:
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        lower, upper = self._culler.boxes(self._nodes)
        return Boxes(lower, upper, self._patches.rung.astype(np.int64))

    def _release_geometry(self) -> None:
        for geometry in (self._geometry, self._wall_geometry):
            if geometry is not None:
                geometry.release()

    def release(self) -> None:
        self._worker.shutdown(wait=True)
        self._release_geometry()
        self._indices.release()
        self._wall_corners.release()


def _write(buffer: moderngl.Buffer, data: npt.NDArray[Any]) -> None:
    """Write to the start of a buffer, which grows where it must."""
    if data.nbytes > buffer.size:
        buffer.orphan(2 * data.nbytes)
    if data.nbytes:
        buffer.write(np.ascontiguousarray(data))
