"""Draws the approximation tree: all chosen patches in one draw call, front to back, the walls between them in another.

Texture patches are chosen together with them: the stage takes the boxes of the patches, splits those near the eye while
a texel's visual error gamma is above its threshold, and climbs from each to the coarsest texture patch within it.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data".
"""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Self

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Culler, Nodes
from terrain.algorithms.multiresolution import (
    FINEST_LEVEL,
    REFINED,
    ApproximationTree,
    all_patches,
    build_preview,
    load_tree,
    select_patches,
)
from terrain.algorithms.patch_pool import PatchPool, triangulate
from terrain.algorithms.refined_cells import RefinedCells, widened
from terrain.algorithms.rtin_mesh import Patches
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import GL_CLIP_DISTANCE0, Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.heightfield import Diagonal
from terrain.progress import listening
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.scene import Scene
from terrain.textures.streaming import give_way

_FRAGMENTS: tuple[tuple[str, dict[str, int]], ...] = (("mesh", {}), ("multiresolution_gouraud", {"GOURAUD": 1}))
_NO_PATCHES = Patches(*(np.empty(0, np.int32) for _ in range(4)))
TINS_ASIDE = 8  # made at once while one flies on
VERTEX_TEXELS = 1024  # to a row of the texture that holds the lines' vertices


@dataclass(frozen=True)
class MultiresolutionSettings(base.Settings):
    """Settings of the multiresolution renderer."""

    horizon: bool = setting(True, "Horizon culling", "Drop patches hidden behind nearer ground.")
    walls: bool = setting(True, "Walls", "Close the gaps between patches of different error or size.")
    detail: bool = setting(
        True, "Level of detail", "Choose patches by their error on the screen; off, every triangle is drawn."
    )
    gouraud: bool = setting(
        False, "Gouraud shading", "Light at the vertices in place of baked light: what the paper compares with."
    )
    tins: bool = setting(
        False, "TINs", "Triangulate the microstructures freely: a few per cent fewer triangles, made in seconds.",
        rebuild=True,
    )  # fmt: skip
    preview: bool = setting(
        False, "Preview", "Show what there is while the tree of a new terrain and its TINs are built: do not wait.",
        rebuild=True,
    )  # fmt: skip

    def unhurried(self) -> Self:
        return replace(self, preview=False)


class MultiresolutionRenderer:
    """Patches of adaptive triangles and TINs, chosen by their error on the screen."""

    name = "multiresolution"
    title = "Multiresolution patches"
    source = "Doellner, Integrated multiresolution modeling of terrain geometry and terrain texture data, 2000"
    Settings = MultiresolutionSettings
    diagonal: Diagonal = "alternating"
    boxes_hold_ground = True

    def __init__(self, gpu: Gpu, scene: Scene, settings: MultiresolutionSettings) -> None:
        self.settings: Any = settings
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        self._begun = time.perf_counter()
        self._uploaded_for: Any = None  # the settings at the last upload
        self._culler = Culler(scene, FINEST_LEVEL)
        self._worker = ThreadPoolExecutor(1, "approximation-tree", initializer=give_way)
        self._doing = ""  # what the worker says
        self._pool: PatchPool | None = None
        self._tins: tuple[Patches, Future[list[Any]] | None] = _NO_PATCHES, None  # being triangulated
        self._indices = gpu.ctx.buffer(reserve=4, dynamic=True)
        self._wall_corners = gpu.ctx.buffer(reserve=16, dynamic=True)
        self._geometries: dict[str, tuple[Geometry, Geometry]] = {}  # of patches and of walls, by fragment stage
        self._line_vertices: moderngl.Texture | None = None
        self._overhangs = False
        self._patches: Patches | None = None
        self._nodes: Nodes | None = None
        self._counts = 0, 0  # triangles of patches and of walls
        self._by_rung = False  # how the patches in the index buffer are sorted: for the levels view by rung
        self._coming: Future[ApproximationTree] | None = None
        if settings.preview:
            self._use(build_preview(scene.heightfield))
            self._coming = self._worker.submit(self._load)
        else:
            self._use(load_tree(scene.heightfield, scene.breaklines))
        self.stats.prepare_s = time.perf_counter() - self._begun

    def select(self, frame: Frame) -> None:
        settings = self.settings
        pool = self._current_pool()
        tree = pool.tree
        if settings.detail:
            patches, self._nodes = select_patches(
                tree, self._culler, frame, settings.tolerance_px, horizon=settings.horizon
            )
        else:
            patches, self._nodes = all_patches(tree, self._culler)
        rests = self._patches is not None and all(map(np.array_equal, patches, self._patches))
        refined = self._add_tins(pool, patches) if settings.tins else False
        self._patches = patches
        self.stats.pending = self._doing if self._coming is not None else "making TINs" if self._tins[1] else ""
        self.stats.uploaded_bytes = 0
        if not rests or refined or self._by_rung or settings != self._uploaded_for:
            self._upload(patches)
        self.stats.resident_bytes = (
            pool.resident_bytes + self._indices.size + self._wall_corners.size + tree.rtin.drop_rung.nbytes
        )

    def _add_tins(self, pool: PatchPool, patches: Patches) -> bool:
        """Make the TINs that are still to be tried among the patches, all at once, or in a preview some aside; whether
        there are new ones."""
        if not self.settings.preview:
            waiting = pool.waiting_tins(patches)
            pool.add_tins(waiting, triangulate(pool.tree, waiting))
            return len(waiting.level) > 0
        asked, coming = self._tins
        arrived = coming is not None and coming.done()
        if coming is not None and arrived:
            pool.add_tins(asked, coming.result())
        if coming is None or arrived:
            asked = pool.waiting_tins(patches)
            asked = asked.take(np.arange(min(len(asked.level), TINS_ASIDE)))
            self._tins = asked, self._worker.submit(triangulate, pool.tree, asked) if len(asked.level) else None
        return arrived

    def finish(self) -> None:
        """Wait until what is being built aside, the tree or some TINs, is there for the next `select`."""
        for coming in (self._coming, self._tins[1]):
            if coming is not None:
                coming.result()

    @property
    def fine_structures(self) -> tuple[int, int]:
        """Cells that imported lines refine, and the triangles these have; waits for the tree."""
        refined = self._current_pool().tree.refined
        return (0, 0) if refined is None else refined.counts

    def _load(self) -> ApproximationTree:
        """The tree, built aside; says how far it is."""

        def hear(doing: str, share: float) -> None:
            self._doing = f"{doing}, {share:.0%}"

        self._doing = "building the approximation tree"
        with listening(hear):
            return load_tree(self._scene.heightfield, self._scene.breaklines)

    def _current_pool(self) -> PatchPool:
        """The meshes of the tree, or of its preview while the tree is being built."""
        if self._coming is not None and self._coming.done():
            tree, self._coming = self._coming.result(), None
            self._use(tree)
            self.stats.prepare_s = time.perf_counter() - self._begun
        assert self._pool is not None
        return self._pool

    def _use(self, tree: ApproximationTree) -> None:
        self._pool, self._patches = PatchPool(tree), None
        self._tins = _NO_PATCHES, None
        terrain, shape = self._scene.heightfield, tree.rtin.drop_rung.shape
        covered = (shape[0] - 1) * tree.stride, (shape[1] - 1) * tree.stride
        self._overhangs = covered != (terrain.rows - 1, terrain.cols - 1)
        self._release_geometry()
        defines = {"CLIP_EDGES": 1} if self._overhangs else {}
        refined = {}
        if tree.refined is not None and len(tree.refined.patches):
            refined = {"BREAKLINES": 1}
            self._line_vertices = _vertex_texture(self._gpu, tree.refined)
            self._culler = Culler(
                replace(self._scene, pyramid=widened(self._scene.pyramid, tree.refined)), FINEST_LEVEL
            )
        corners = [(self._wall_corners, "4f 1f", "in_corner", "in_above")]
        for fragment, light in _FRAGMENTS:
            chosen = defines | light
            self._geometries[fragment] = (
                Geometry(self._gpu, "multiresolution", fragment, (), self._indices, chosen | refined),
                Geometry(self._gpu, "multiresolution_wall", fragment, corners, defines=chosen),
            )

    def _upload(self, patches: Patches) -> None:
        """Write the triangles of the patches as one list of post numbers, and those of the walls."""
        assert self._pool is not None
        posts = self._pool.gather(patches)
        extracted = self._pool.extracted
        walls = self._pool.walls(patches) if self.settings.walls else np.empty((0, 3, 5), np.float32)
        _write(self._indices, posts)
        _write(self._wall_corners, walls)
        self._by_rung, self._uploaded_for = False, self.settings
        self._counts = len(posts) // 3, len(walls)
        self.stats.uploaded_bytes = posts.nbytes + walls.nbytes
        self.stats.triangles = sum(self._counts)
        self.stats.draw_calls = sum(count > 0 for count in self._counts)
        tins = self._pool.count_tins(patches) if self.settings.tins else 0
        self.stats.extra = {
            "patches": len(patches.level), "new patches": extracted, "TINs": tins, "wall triangles": len(walls),
            "patches with lines": int(np.count_nonzero(patches.rung == REFINED)),
        }  # fmt: skip

    def draw(self, frame: Frame) -> None:
        pool = self._pool
        if pool is None:
            return
        is_gouraud = self.settings.gouraud and frame.output == "shaded"
        geometry, walls = self._geometries["multiresolution_gouraud" if is_gouraud else "mesh"]
        if self._overhangs:
            for plane in (0, 1):
                self._gpu.ctx.enable_direct(GL_CLIP_DISTANCE0 + plane)
        program = geometry.program(frame.output)
        program["u_row_length"] = pool.tree.rtin.drop_rung.shape[1]
        program["u_stride"] = pool.tree.stride
        if self._line_vertices is not None:
            self._line_vertices.use(UNITS["u_extra0"])
            program["u_post_count"] = pool.tree.rtin.drop_rung.size
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
        for pair in self._geometries.values():
            for geometry in pair:
                geometry.release()
        self._geometries.clear()
        if self._line_vertices is not None:
            self._line_vertices.release()
            self._line_vertices = None

    def release(self) -> None:
        self._worker.shutdown(wait=True)
        self._release_geometry()
        self._indices.release()
        self._wall_corners.release()


def _vertex_texture(gpu: Gpu, refined: RefinedCells) -> moderngl.Texture:
    """The vertices of the lines as texels, row by row."""
    rows = -(-len(refined.vertices) // VERTEX_TEXELS) or 1
    texels = np.zeros((rows * VERTEX_TEXELS, 4), np.float32)
    texels[: len(refined.vertices), :3] = refined.vertices
    texture = gpu.ctx.texture((VERTEX_TEXELS, rows), 4, texels.data, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def _write(buffer: moderngl.Buffer, data: npt.NDArray[Any]) -> None:
    """Write to the start of a buffer, which grows where it must."""
    if data.nbytes > buffer.size:
        buffer.orphan(2 * data.nbytes)
    if data.nbytes:
        buffer.write(np.ascontiguousarray(data))
