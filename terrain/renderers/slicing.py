"""Adaptive slicing: polygons first, then all slices front to back, then one pass that finds and shades the surface.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001.

Deviations: those of `terrain.algorithms.slicing`. Slices write nothing but depth and where the sight ray meets the
first of their planes that lies in the ground; shading happens once per pixel, in the pass that takes the secant steps.
Where the eye is outside the grid or in the ground, or the terrain has holes, a slice also asks whether the ray came
from above the ground: a cut side shows nothing, as in a mesh. Then each plane is a slice of its own, since what lies
behind a hit may count.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing import BOX_BITS, FACE_COUNT, LAST_NUMBER, Cut, name_slices, patches_of, select_cut
from terrain.algorithms.slicing_cost import PLANES_PER_SLICE, POLYGONS, X_SLICES, Y_SLICES, Z_SLICES, Speeds
from terrain.algorithms.slicing_tree import build_slice_tree
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.heightfield import Diagonal
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.renderers.slicing_bundles import BORDER_PX, PAPER_BORDER_PX, RAISE_PX, SliceBundles
from terrain.renderers.slicing_calibration import load_speeds
from terrain.renderers.slicing_fans import FanTiles
from terrain.scene import Scene
from terrain.textures.sky import Sky

SETTLED = 8  # frames a new viewport must stay before its speeds are measured
SAMPLES = 64  # frames over which estimates are compared with the clock


@dataclass(frozen=True)
class SlicingSettings(base.Settings):
    """Settings of adaptive slicing."""

    mode: str = setting(
        "hybrid", "Draw", "Boxes as slices or polygons, whichever is cheaper; or all of one kind.",
        choices=("hybrid", "slices", "polygons"),
    )  # fmt: skip
    rule: str = setting(
        "secant", "Slice counts",
        "Secant: few planes, the surface is found between them; paper: planes a pixel apart and a hard test.",
        choices=("secant", "paper"),
    )  # fmt: skip
    horizon: bool = setting(True, "Horizon culling", "Drop boxes hidden behind nearer ground (secant only).")
    coarse: bool = setting(
        False, "Coarser fans",
        "Polygons leave out posts where the tolerance allows it (secant only): faster from above over smooth ground.",
    )  # fmt: skip
    antialias: bool = setting(False, "Antialiased slices", "Opacity falls over one pixel at the edge of a slice.")
    figure: bool = setting(False, "Figure 4", "Sliced boxes as boxes, by direction; dark centres of triangle fans.")
    recalibrate: bool = setting(
        False, "Recalibrate", "Measure this machine's speeds anew instead of reading them from the cache.", rebuild=True
    )


class SlicingRenderer:
    """Boxes of terrain as bundles of slices or as polygons, by cost."""

    name = "slicing"
    title = "Adaptive slicing"
    source = "Röttger and Ertl, Hardware accelerated terrain rendering by adaptive slicing, 2001"
    Settings = SlicingSettings
    diagonal: Diagonal = "alternating"

    def __init__(self, gpu: Gpu, scene: Scene, settings: SlicingSettings) -> None:
        begin = time.perf_counter()
        self.settings: Any = settings
        self.stats = FrameStats()
        self._gpu, self._scene = gpu, scene
        self._tree = build_slice_tree(scene)
        self._bundles = SliceBundles(gpu, scene.heightfield.heights_m, scene.heightfield.spacing_m)
        self._tiles = FanTiles(gpu, self._tree.cells)
        self._box_names = gpu.ctx.buffer(reserve=4 << 12, dynamic=True)
        self._box_geometry = Geometry(gpu, "slicing_boxes", "slicing_figure", [(self._box_names, "1u /i", "in_slice")])
        self._sky = Sky(gpu)
        self._speeds: dict[tuple[int, int], Speeds] = {}
        self._fresh = settings.recalibrate
        self._viewport_px, self._still = (0, 0), 0
        self._cut: Cut | None = None
        self._names = np.zeros(0, np.uint32)
        self._samples: list[tuple[float, float]] = []
        self.stats.prepare_s = time.perf_counter() - begin

    def select(self, frame: Frame) -> None:
        settings = self.settings
        speeds = self._speeds_for(frame.viewport_px)
        self._compare()
        self._cut = cut = select_cut(
            self._tree,
            frame,
            speeds,
            settings.tolerance_px,
            settings.mode,
            settings.rule,
            settings.horizon,
            settings.coarse,
        )
        secant = settings.rule == "secant"
        each = not secant or settings.antialias or self._may_be_underground(frame)  # what lies behind a hit counts too
        per_slice = 1 if each else PLANES_PER_SLICE
        self._names = names = name_slices(cut, frame.eye_m, secant, per_slice)
        self._bundles.write_names(names[::-1] if settings.antialias else names, per_slice)
        uploaded = names.nbytes
        polygons = cut.direction == POLYGONS
        fans, sliced = cut.nodes.where(polygons), cut.nodes.where(~polygons)
        uploaded += self._tiles.write(fans, cut.stride[polygons], sliced)
        self._fill_stats(cut, uploaded)

    def draw(self, frame: Frame) -> None:
        if self._cut is None:
            return
        if self.settings.figure and frame.output == "shaded":
            self._draw_figure(frame, self._cut)
        else:
            self._draw_terrain(frame, self._cut)

    def boxes(self) -> Boxes:
        """The chosen boxes; their level is 0 for polygons, else the direction of the slices: 1 x, 2 y, 3 z."""
        if self._cut is None:
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        return Boxes(self._cut.lower_m, self._cut.upper_m, self._cut.direction.astype(np.int64))

    def release(self) -> None:
        for part in (self._tiles, self._bundles, self._sky, self._box_geometry, self._box_names):
            part.release()

    def _speeds_for(self, viewport_px: tuple[int, int]) -> Speeds:
        """The speeds of a viewport; while it is being resized, those of the last one."""
        self._still = self._still + 1 if viewport_px == self._viewport_px else 0
        self._viewport_px = viewport_px
        if viewport_px not in self._speeds and (not self._speeds or self._still >= SETTLED):
            begin = time.perf_counter()
            self._speeds[viewport_px] = load_speeds(self._gpu, viewport_px, anew=self._fresh)
            self.stats.prepare_s += time.perf_counter() - begin
        return self._speeds.get(viewport_px, next(reversed(self._speeds.values())))

    def _draw_terrain(self, frame: Frame, cut: Cut) -> None:
        self._tiles.draw(frame)
        if not self._bundles.slices:
            return
        paper, bundles, target = self.settings.rule == "paper", self._bundles, self._gpu.ctx.fbo
        self.stats.uploaded_bytes += bundles.write_records(cut, frame, PAPER_BORDER_PX if paper else BORDER_PX)
        if frame.output == "flat":
            bundles.draw(frame.output)
        elif self.settings.antialias and frame.output == "shaded":
            self._gpu.ctx.depth_func = ">="
            self._sky.draw()  # soft edges need it behind them
            self._gpu.ctx.depth_func = ">"
            bundles.draw_antialiased(frame.output, paper)
        else:
            underground = self._may_be_underground(frame)
            bundles.find(target, underground, 0.0 if paper else RAISE_PX)
            if frame.output == "overdraw":  # every fragment in front of what was found
                self._gpu.ctx.depth_func = ">="
                target.depth_mask = False
                bundles.draw(frame.output)
                target.depth_mask = True
                self._gpu.ctx.depth_func = ">"
            else:
                patches = cut.patches
                if frame.whole_px is not None:
                    sliced = cut.direction != POLYGONS
                    patches = patches_of(cut.lower_m[sliced], cut.upper_m[sliced], frame)
                bundles.resolve(frame.output, patches, paper, underground)

    def _may_be_underground(self, frame: Frame) -> bool:
        """Whether a ray may be in the ground without having met it from above."""
        terrain = self._scene.heightfield
        x, y, z = frame.eye_m
        ground_m = float(terrain.heights_at(x, z))  # NaN outside the grid
        return terrain.holes is not None or not y > ground_m

    def _draw_figure(self, frame: Frame, cut: Cut) -> None:
        """Figure 4: boxes instead of slices, fans with dark centres."""
        self._tiles.draw_centres(frame)
        boxes = np.flatnonzero(cut.direction != POLYGONS)
        if not len(boxes):
            return
        self._bundles.write_records(cut, frame, 0.0)
        faces = np.uint32(LAST_NUMBER) - np.arange(FACE_COUNT, dtype=np.uint32)
        names = (boxes.astype(np.uint32)[:, None] | faces << np.uint32(BOX_BITS)).ravel()
        if names.nbytes > self._box_names.size:
            self._box_names.orphan(2 * names.nbytes)
        self._box_names.write(names)
        self._bundles.bind()
        self._gpu.ctx.disable(moderngl.CULL_FACE)
        self._box_geometry.render("shaded", moderngl.TRIANGLE_STRIP, 4, instances=len(names))
        self._gpu.ctx.enable(moderngl.CULL_FACE)

    def _compare(self) -> None:
        """Keep the last frame's estimate and what the clock said."""
        measured_ms = self.stats.gpu_ms if self.stats.gpu_ms is not None else self.stats.frame_ms
        if self._cut is not None and measured_ms is not None:
            self._samples = [*self._samples[1 - SAMPLES :], (self._cut.cost_ms, measured_ms)]

    def _fill_stats(self, cut: Cut, uploaded: int) -> None:
        stats, slices = self.stats, len(self._names)
        stats.triangles = self._tiles.triangles
        stats.slices = slices
        stats.draw_calls = self._tiles.draw_calls + 2 * (slices > 0)
        stats.uploaded_bytes = uploaded
        stats.resident_bytes = self._bundles.resident_bytes + self._tiles.resident_bytes
        stats.extra = {
            "boxes of x-slices": float((cut.direction == X_SLICES).sum()),
            "boxes of y-slices": float((cut.direction == Y_SLICES).sum()),
            "boxes of z-slices": float((cut.direction == Z_SLICES).sum()),
            "polygon boxes": float((cut.direction == POLYGONS).sum()),
            "fans": stats.triangles / 8,
            "estimated ms": cut.cost_ms,
        }
        if self._samples:
            stats.extra["measured ms"] = self._samples[-1][1]
        if len(self._samples) > 3:
            stats.extra["rank correlation"] = rank_correlation(np.array(self._samples))
        speeds = next(reversed(self._speeds.values()))
        stats.extra |= {
            "µs per slice": 1e3 * speeds.slice_ms,
            "ns per slice pixel": 1e6 * speeds.slice_pixel_ms,
            "ns per plane and pixel": 1e6 * speeds.plane_pixel_ms,
            "ns per found pixel": 1e6 * speeds.found_pixel_ms,
            "ns per triangle": 1e6 * speeds.triangle_ms,
            "ns per polygon pixel": 1e6 * speeds.polygon_pixel_ms,
            "ms to look for slices": speeds.search_ms,
        }


def rank_correlation(samples: npt.NDArray[np.float64]) -> float:
    """Spearman's rank correlation of two columns (n, 2): 1 where their order agrees."""
    ranks = samples.argsort(axis=0).argsort(axis=0).astype(np.float64)
    ranks -= ranks.mean(axis=0)
    return float((ranks[:, 0] * ranks[:, 1]).sum() / np.sqrt((ranks**2).sum(axis=0).prod()))
