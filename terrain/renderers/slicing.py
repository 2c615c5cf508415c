"""Draws adaptive slicing: polygons first, then all slices front to back, then one pass that finds the surface.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing import Cut, build_slice_tree, select_cut
from terrain.algorithms.slicing_cost import POLYGONS, X_SLICES, Y_SLICES, Speeds
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.renderers.tile_mesh import build_tile_indices
from terrain.scene import Scene

RECORDS_PER_ROW = 256
FAN_LEVELS = (3, 4, 5)


@dataclass(frozen=True)
class SlicingSettings(base.Settings):
    mode: str = setting("hybrid", "Draw", "", choices=("hybrid", "slices", "polygons"))
    rule: str = setting("secant", "Slice counts", "", choices=("secant", "paper"))


class SlicingRenderer:
    name = "slicing"
    title = "Adaptive slicing"
    source = "Röttger, Ertl: Hardware Accelerated Terrain Rendering by Adaptive Slicing, VMV 2001."
    Settings = SlicingSettings

    def __init__(self, gpu: Gpu, scene: Scene, settings: SlicingSettings) -> None:
        self.settings: Any = settings
        self.diagonal: Diagonal = "alternating"
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        self.speeds = Speeds(9500.0, 157000.0, 4e-4, 2.5e-6, 8e-5, 3e-6, 5.0)
        self._tree = build_slice_tree(scene.pyramid, scene.heightfield.spacing_m)
        self._packed = pack_cells(gpu, scene.heightfield.heights_m)
        self._fans = {}
        for level in FAN_LEVELS:
            indices = gpu.ctx.buffer(build_tile_indices(1 << level).tobytes())
            tiles = gpu.ctx.buffer(reserve=1 << 16, dynamic=True)
            self._fans[level] = (
                indices,
                tiles,
                Geometry(gpu, "reference", "mesh", [(tiles, "2i /i", "in_tile")], indices),
            )
        self._slices = gpu.ctx.buffer(reserve=1 << 20, dynamic=True)
        self._slice_geometry = Geometry(gpu, "slicing", "slicing", [(self._slices, "1u /i", "in_slice")])
        self._resolve = Geometry(gpu, "fullscreen", "slicing_resolve")
        self._records = None
        self._hits = None
        self._cut: Cut | None = None

    def select(self, frame: Frame) -> None:
        s = self.settings
        self._cut = cut = select_cut(self._tree, frame, self.speeds, s.tolerance_px, s.mode, s.rule)
        words = slice_words(cut, frame.eye_m, s.rule == "secant")
        self._slices.orphan(max(words.nbytes, 16))
        self._slices.write(words)
        self._slice_count = len(words)
        tri = 0
        for level, (_, tiles, _) in self._fans.items():
            pass
        polygons = cut.direction == POLYGONS
        self._fan_counts = {}
        for level in FAN_LEVELS:
            of = polygons & (cut.level == level if level < FAN_LEVELS[-1] else cut.level >= level)
            post = tiles_of(cut.level[of], cut.row[of], cut.col[of], level, self._tree.cells)
            self._fans[level][1].orphan(max(post.nbytes, 16))
            self._fans[level][1].write(post)
            self._fan_counts[level] = len(post)
            tri += 2 * 4**level * len(post)
        self.stats.triangles = tri
        self.stats.slices = len(words)

    def draw(self, frame: Frame) -> None:
        gpu, cut = self._gpu, self._cut
        target = gpu.ctx.fbo
        for level, (_, _, geometry) in self._fans.items():
            if self._fan_counts[level]:
                geometry.program(frame.output)["u_tile_posts"] = (1 << level) + 1
                geometry.render(frame.output, moderngl.TRIANGLES, instances=self._fan_counts[level])
        if not self._slice_count:
            return
        size = target.size
        if self._hits is None or self._hits[0].size != size or self._hits[2] is not target.depth_attachment:
            texture = gpu.ctx.texture(size, 1, dtype="u4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._hits = texture, gpu.ctx.framebuffer([texture], target.depth_attachment), target.depth_attachment
        self._write_records(frame)
        texture, hits, _ = self._hits
        hits.use()
        clear_colour(gpu)
        gpu.ctx.disable(moderngl.CULL_FACE)
        self._records.use(UNITS["u_extra0"])
        self._packed.use(UNITS["u_packed"])
        self._resolve.program(frame.output)["u_hard"] = float(self.settings.rule == "paper")
        self._slice_geometry.render("shaded", moderngl.TRIANGLE_STRIP, 4, instances=self._slice_count)
        target.use()
        texture.use(UNITS["u_extra1"])
        self._resolve.render(frame.output, moderngl.TRIANGLES, vertices=3)
        gpu.ctx.enable(moderngl.CULL_FACE)

    def _write_records(self, frame: Frame) -> None:
        cut = self._cut
        n = len(cut.count)
        rows = -(-n // RECORDS_PER_ROW)
        data = np.zeros((rows * RECORDS_PER_ROW, 3, 4), np.float32)
        lower, upper = cut.lower_m - frame.eye_m, cut.upper_m - frame.eye_m
        near_gap = np.linalg.norm(np.maximum(np.maximum(lower, -upper), 0), axis=1)
        pixel = near_gap / frame.pixels_per_radian
        paper = self.settings.rule == "paper"
        axis = np.choose(cut.direction, (0, 0, 1, 2))
        i = np.arange(n)
        lo, hi = lower[i, axis], upper[i, axis]
        lo = np.where(axis == 1, lo - (0.25 * pixel), lo)
        forward = np.abs(lo) < np.abs(hi)
        data[:n, 0, :3], data[:n, 1, :3] = lower, upper
        data[:n, 0, 3] = cut.count
        data[:n, 1, 3] = pixel * (1.0 if paper else 0.1)
        data[:n, 2, 0] = axis
        data[:n, 2, 1] = np.where(forward, lo, hi)
        data[:n, 2, 2] = np.where(forward, hi, lo)
        data[:n, 2, 3] = cut.direction
        if self._records is None or self._records.size[1] < rows:
            self._records = self._gpu.ctx.texture((RECORDS_PER_ROW * 3, rows * 2), 4, dtype="f4")
            self._records.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._records.write(data.tobytes(), viewport=(0, 0, RECORDS_PER_ROW * 3, rows))

    def boxes(self) -> Boxes:
        cut = self._cut
        return Boxes(cut.lower_m, cut.upper_m, cut.direction.astype(np.int64))

    def release(self) -> None:
        pass


def clear_colour(gpu):
    import ctypes

    gpu.function("glClearBufferuiv", None, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)(
        0x1800, 0, (ctypes.c_uint * 4)(0, 0, 0, 0)
    )


def slice_words(cut, eye, faces):
    box = np.repeat(np.arange(len(cut.count)), cut.count)
    start = np.cumsum(cut.count) - cut.count
    number = np.arange(len(box)) - np.repeat(start, cut.count)
    words = (box | number << 20).astype(np.uint32)
    if not faces:
        return words
    lower, upper = cut.lower_m - eye, cut.upper_m - eye
    # a ray can leave through a face that looks away from the eye
    leaving = np.stack(
        [
            lower[:, 0] < 0,
            upper[:, 0] > 0,
            lower[:, 1] < 0,
            np.zeros(len(lower), bool),
            lower[:, 2] < 0,
            upper[:, 2] > 0,
        ],
        1,
    )
    leaving[cut.direction == POLYGONS] = False
    leaving[cut.direction == X_SLICES, :2] = False
    leaving[cut.direction == Y_SLICES, 2] = False
    leaving[cut.direction == 3, 4:] = False
    more = leaving.sum(1)
    fbox, face = np.nonzero(leaving)
    fwords = (fbox | (4095 - face) << 20).astype(np.uint32)
    total = cut.count + more
    out = np.empty(total.sum(), np.uint32)
    tstart = np.cumsum(total) - total
    out[tstart[box] + number] = words
    rank = np.arange(len(fbox)) - np.repeat(np.cumsum(more) - more, more)
    out[tstart[fbox] + cut.count[fbox] + rank] = fwords
    return out


def pack_cells(gpu: Gpu, heights: npt.NDArray[np.float32]) -> moderngl.Texture:
    corners = np.stack([heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]], axis=-1)
    texture = gpu.ctx.texture((corners.shape[1], corners.shape[0]), 4, np.ascontiguousarray(corners).data, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def tiles_of(level, row, col, size_level, cells):
    split = 1 << (level - size_level)
    n = split * split
    owner = np.repeat(np.arange(len(level)), n)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(n) - n, n)
    r = (row[owner] * split[owner] + number // split[owner]) << size_level
    c = (col[owner] * split[owner] + number % split[owner]) << size_level
    keep = (r < cells[0]) & (c < cells[1])
    return np.stack([c, r], axis=1)[keep].astype(np.int32)
