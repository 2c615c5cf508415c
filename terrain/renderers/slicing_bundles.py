"""The GPU's side of slices: packed heights, one small record per box, one word per slice, and the passes over them.

A record holds two texels: the box's lower corner, and the axis together with the number of planes; its upper corner and
the width of the border. ``shaders/lib/slices.glsl`` reads them.
"""

from __future__ import annotations

import ctypes
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing import Cut
from terrain.algorithms.slicing_cost import Y_SLICES, Z_SLICES
from terrain.frame import Frame, Output
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS

RECORDS_PER_ROW = 256
AXIS_STEP = 1024  # more than the most planes
GL_COLOR = 0x1800
# How far slices reach over their box [px]: corners of triangles are rounded to 1/256 px, and no ray may slip between.
BORDER_PX = 0.1
PAPER_BORDER_PX = 1.0  # section 5
RAISE_PX = 0.1  # how far they reach over the ground, beside coarser polygons


class SliceBundles:
    """Draws bundles of slices of one height field.

    Parameters
    ----------
    gpu : Gpu
    heights_m : ndarray of float32, (rows, cols)
    spacing_m : tuple of float
        dx, dz.
    """

    def __init__(self, gpu: Gpu, heights_m: npt.NDArray[np.float32], spacing_m: tuple[float, float]) -> None:
        self._gpu = gpu
        self.slices = 0
        self.planes_per_slice = 1
        self._packed = pack_cells(gpu, heights_m)
        self._spacing_m = np.array(spacing_m)
        self._per_cell = (1 / self._packed.width, 1 / self._packed.height)
        self._measures: dict[str, tuple[float, ...]] = {}
        self._names = gpu.ctx.buffer(reserve=4 << 12, dynamic=True)
        self._records = self._texture((2 * RECORDS_PER_ROW, 16), 4, "f4")
        self._patches = gpu.ctx.buffer(reserve=16 << 8, dynamic=True)
        content = [(self._names, "1u /i", "in_slice")]
        patches = [(self._patches, "4f /i", "in_patch")]
        self._found, self._resolve, self._direct = (
            {
                key: Geometry(gpu, vertex, fragment, slices, defines=dict.fromkeys(key, 1))
                for key in keys
            }
            for vertex, fragment, slices, keys in (
                ("slicing", "slicing", content, ((), ("FROM_ABOVE_ONLY",))),
                ("slicing_resolve", "slicing_resolve", patches, ((), ("HARD_TEST",), ("FROM_ABOVE_ONLY",))),
                ("slicing", "slicing_direct", content, ((), ("ANTIALIASED",), ("ANTIALIASED", "HARD_TEST"))),
            )
        )  # fmt: skip
        self._hits: tuple[moderngl.Texture, moderngl.Framebuffer, Any] | None = None
        clear = gpu.function("glClearBufferfv", None, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
        assert clear is not None  # in OpenGL 3.0
        self._clear = clear

    @property
    def resident_bytes(self) -> int:
        """Bytes of packed heights and buffers on the GPU."""
        hits = 0 if self._hits is None else 8 * self._hits[0].width * self._hits[0].height
        records = 16 * self._records.width * self._records.height
        return 16 * self._packed.width * self._packed.height + self._names.size + records + hits

    def write_names(self, names: npt.NDArray[np.uint32], planes_per_slice: int = 1) -> None:
        """Upload the slices to be drawn, in order (`terrain.algorithms.slicing.name_slices`)."""
        self.slices, self.planes_per_slice = len(names), planes_per_slice
        if names.nbytes > self._names.size:
            self._names.orphan(2 * names.nbytes)
        self._names.write(np.ascontiguousarray(names))

    def write_records(self, cut: Cut, frame: Frame, border_px: float) -> int:
        """Upload the boxes of a cut as they stand around the eye of ``frame``; returns the number of bytes."""
        dx, dz = self._spacing_m
        first = np.floor(frame.eye_m[[0, 2]] / self._spacing_m)  # as u_eye_post
        past = frame.eye_m[[0, 2]] / self._spacing_m - first
        self._measures = {"u_posts_from_m": (1 / dx, 1 / dz, *past), "u_per_cell": self._per_cell}
        records = pack_records(cut, frame, border_px)
        if len(records) > self._records.height:
            self._records.release()
            self._records = self._texture((2 * RECORDS_PER_ROW, 2 * len(records)), 4, "f4")
        self._records.write(records, viewport=(0, 0, 2 * RECORDS_PER_ROW, len(records)))
        return records.nbytes

    def find(self, target: moderngl.Framebuffer, from_above_only: bool, raise_px: float = RAISE_PX) -> None:
        """Find the first slice hit at each pixel, in front of what is in ``target`` already; its depth is updated."""
        hits, framebuffer = self._hits_of(target)
        framebuffer.use()
        self._clear(GL_COLOR, 0, (ctypes.c_float * 4)(0.0, 0.0, 0.0, 0.0))
        self.bind()
        key = ("FROM_ABOVE_ONLY",) if from_above_only else ()
        self._found[key].program("shaded")["u_raise_px"] = raise_px
        self._render(self._found[key], "shaded")
        hits.use(UNITS["u_extra1"])
        target.use()

    def resolve(
        self, output: Output, patches: npt.NDArray[np.float32], hard_test: bool, from_above_only: bool = False
    ) -> None:
        """Write what was found inside ``patches`` (`patches_of`) into the bound target."""
        key = ("HARD_TEST",) if hard_test else ("FROM_ABOVE_ONLY",) if from_above_only else ()
        ctx = self._gpu.ctx
        self.bind()
        if patches.nbytes > self._patches.size:
            self._patches.orphan(2 * patches.nbytes)
        self._patches.write(patches)
        ctx.disable(moderngl.CULL_FACE)
        ctx.depth_func = "1"  # always: a point found on the slice itself has the very depth that is there
        self._tell(self._resolve[key].program(output))
        self._resolve[key].render(output, moderngl.TRIANGLE_STRIP, 4, instances=len(patches))
        ctx.depth_func = ">"
        ctx.enable(moderngl.CULL_FACE)

    def draw(self, output: Output) -> None:
        """Draw all of each slice into the bound target, in ground or not."""
        self.bind()
        self._render(self._direct[()], output)

    def draw_antialiased(self, output: Output, hard_test: bool) -> None:
        """Blend slices into the bound target; they must come back to front."""
        ctx = self._gpu.ctx
        self.bind()
        ctx.enable(moderngl.BLEND)
        ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._render(self._direct[("ANTIALIASED", "HARD_TEST") if hard_test else ("ANTIALIASED",)], output)
        ctx.disable(moderngl.BLEND)

    def release(self) -> None:
        """Release everything on the GPU."""
        for geometries in (self._found, self._resolve, self._direct):
            for geometry in geometries.values():
                geometry.release()
        self._release_hits()
        for part in (self._packed, self._names, self._records, self._patches):
            part.release()

    def bind(self) -> None:
        """Bind heights and records to their units."""
        self._packed.use(UNITS["u_packed"])
        self._records.use(UNITS["u_extra0"])

    def _render(self, geometry: Geometry, output: Output) -> None:
        ctx = self._gpu.ctx
        ctx.disable(moderngl.CULL_FACE)  # both sides of a slice are seen
        self._tell(geometry.program(output))
        geometry.render(output, moderngl.TRIANGLE_STRIP, 4, instances=self.slices)
        ctx.enable(moderngl.CULL_FACE)

    def _tell(self, program: moderngl.Program) -> None:
        for name, value in {**self._measures, "u_planes_per_slice": self.planes_per_slice}.items():
            if name in program:
                program[name] = value

    def _hits_of(self, target: moderngl.Framebuffer) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        """Where hits are kept: a texture that shares the target's depth."""
        depth = target.depth_attachment
        if self._hits is None or self._hits[2] is not depth or self._hits[0].size != target.size:
            self._release_hits()
            hits = self._texture((target.width, target.height), 2, "f4")
            self._hits = hits, self._gpu.ctx.framebuffer([hits], depth), depth
        return self._hits[:2]

    def _release_hits(self) -> None:
        if self._hits is not None:
            self._gpu.release_framebuffer(self._hits[1])
            self._hits[0].release()
            self._hits = None

    def _texture(self, size: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
        texture = self._gpu.ctx.texture(size, components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture


def pack_cells(gpu: Gpu, heights_m: npt.NDArray[np.float32]) -> moderngl.Texture:
    """What every cell's height is made of (``shaders/lib/packed.glsl``) in one RGBA32F texel: one fetch a sample."""
    rows, cols = heights_m.shape
    texture = gpu.ctx.texture((cols - 1, rows - 1), 4, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    band = 256  # rows at a time: the copies of a large terrain need not exist at once
    for first in range(0, rows - 1, band):
        h = heights_m[first : first + band + 1]
        nw, ne, sw, se = h[:-1, :-1], h[:-1, 1:], h[1:, :-1], h[1:, 1:]
        bend = nw + se - ne - sw
        is_nw_se = np.add.outer(np.arange(first, first + len(nw)), np.arange(cols - 1)) % 2 == 0
        cut = np.where(is_nw_se, [nw, ne - nw, sw - nw, bend], [ne, nw - ne, se - ne, -bend])
        texture.write(np.ascontiguousarray(cut.transpose(1, 2, 0)), viewport=(0, first, cols - 1, len(nw)))
    return texture


def pack_records(cut: Cut, frame: Frame, border_px: float) -> npt.NDArray[np.float32]:
    """The records of a cut's boxes: (rows of RECORDS_PER_ROW boxes, 12 * RECORDS_PER_ROW) float32."""
    boxes = len(cut.planes)
    lower, upper = cut.lower_m - frame.eye_m, cut.upper_m - frame.eye_m
    gap = np.maximum(np.maximum(lower, -upper), 0.0)
    border = border_px * np.sqrt(gap[:, 0] ** 2 + gap[:, 1] ** 2 + gap[:, 2] ** 2) / frame.pixels_per_radian
    axis = np.select([cut.direction == Y_SLICES, cut.direction == Z_SLICES], [1, 2], 0)
    rows = -(-boxes // RECORDS_PER_ROW)
    records = np.zeros((rows * RECORDS_PER_ROW, 8), np.float32)
    used = records[:boxes]
    used[:, 0:3], used[:, 3], used[:, 4:7], used[:, 7] = lower, axis * AXIS_STEP + cut.planes, upper, border
    return records.reshape(rows, -1)
