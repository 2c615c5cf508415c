"""How fast this machine draws slices and polygons: the constants of adaptive slicing's cost model, measured once.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001, section 4: "we are
measuring two characteristic constants at the start up".

Deviation: nine constants instead of two, on a flat terrain made for the purpose and drawn by the renderer's own
programs; kept in the disk cache per renderer string and viewport.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import astuple

import moderngl
import numpy as np

from terrain.algorithms.slicing import Cut, name_slices
from terrain.algorithms.slicing_cost import PLANES_PER_SLICE, UNSEEN, Y_SLICES, Speeds
from terrain.algorithms.slicing_tree import Nodes
from terrain.cache import load_arrays, store_arrays
from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import create_target
from terrain.heightfield import Heightfield
from terrain.renderers.slicing_bundles import SliceBundles
from terrain.renderers.tile_mesh import build_tile_indices

CALIBRATION_VERSION = 3
CELLS, TILE = 256, 32  # of the flat terrain, and of its polygon tiles
CELL_PX = 1.5  # size of a cell in the picture where triangles are timed
SMALL_SLICES, SMALL_PX, PLACES = 8192, 4.0, 8  # small slices: how many, their size, at how many places squared
LARGE_SLICES = 12
REPEATS = 5
EVERYWHERE = np.array([[0.0, 0.0, 1.0, 1.0]], np.float32)


def load_speeds(gpu: Gpu, viewport_px: tuple[int, int], anew: bool = False) -> Speeds:
    """The speeds for a viewport: from the cache, or measured (under a second).

    Parameters
    ----------
    gpu : Gpu
    viewport_px : tuple of int
        ``(width, height)``.
    anew : bool
        Measure even if the cache has them.
    """
    identity = f"{gpu.name}|{gpu.version}|{viewport_px}|{CALIBRATION_VERSION}"
    key = hashlib.sha256(identity.encode()).hexdigest()[:32]
    cached = None if anew else load_arrays("slicing-speeds", key)
    if cached is not None and cached.get("speeds", np.zeros(0)).shape == (len(Speeds.__dataclass_fields__),):
        return Speeds(*(float(v) for v in cached["speeds"]))
    speeds = measure_speeds(gpu, viewport_px)
    store_arrays("slicing-speeds", key, {"speeds": np.array(astuple(speeds))})
    return speeds


def measure_speeds(gpu: Gpu, viewport_px: tuple[int, int]) -> Speeds:
    """Draw known numbers of slices, triangles and pixels, and time them; leaves another framebuffer bound."""
    bench = _Bench(gpu, viewport_px)
    try:
        return bench.measure()
    finally:
        bench.release()


class _Bench:
    """A flat terrain seen from straight above, and what is timed on it."""

    def __init__(self, gpu: Gpu, viewport_px: tuple[int, int]) -> None:
        self._gpu, self._viewport = gpu, viewport_px
        self._flat = Heightfield(np.zeros((CELLS + 1, CELLS + 1), np.float32), (1.0, 1.0))
        ctx, size = gpu.ctx, (CELLS + 1, CELLS + 1)
        self._heights = ctx.texture(size, 1, self._flat.heights_m, dtype="f4")
        self._heights.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._ground = ctx.texture(size, 4, np.full((*size, 4), 255, np.uint8))
        self._ground.build_mipmaps()
        self._ground.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
        self._bundles = SliceBundles(gpu, self._flat.heights_m, self._flat.spacing_m)
        self._block = FrameBlock(gpu)
        self._target = create_target(gpu, viewport_px)
        first = np.stack(np.meshgrid(*[np.arange(0, CELLS, TILE)] * 2), axis=-1).reshape(-1, 2).astype(np.int32)
        first = np.roll(first, -(len(first) + CELLS // TILE) // 2, axis=0)  # that in the middle of the picture first
        self._tile_count = len(first)
        self._tiles = ctx.buffer(first)
        self._indices = ctx.buffer(build_tile_indices(TILE))
        content = [(self._tiles, "2i /i", "in_tile")]
        self._polygons = Geometry(gpu, "reference", "mesh", content, self._indices)

    def measure(self) -> Speeds:
        pixels = self._viewport[0] * self._viewport[1]
        triangles = 2 * CELLS * CELLS

        far = self._look_from(CELL_PX)
        triangle_ms = self._time_ms(lambda: self._draw_polygons(self._tile_count)) / triangles
        self._write_slices(far, SMALL_SLICES, SMALL_PX / CELL_PX, above=True, places=PLACES)
        search_ms = self._time_ms(lambda: self._draw_slices(0))
        slice_ms = (self._time_ms(lambda: self._draw_slices(SMALL_SLICES)) - search_ms) / SMALL_SLICES

        # From so near that one tile fills the picture.
        near = self._look_from(1.2 * max(self._viewport) / TILE)
        filled_ms = self._time_ms(lambda: self._draw_polygons(1))
        self._write_slices(near, LARGE_SLICES, float(CELLS), above=True)
        pixel_ms = (self._time_ms(lambda: self._draw_slices(LARGE_SLICES)) - search_ms) / (LARGE_SLICES * pixels)
        planes = LARGE_SLICES * PLANES_PER_SLICE
        self._write_slices(near, planes, float(CELLS), above=True, per_slice=PLANES_PER_SLICE)
        plane_ms = (self._time_ms(lambda: self._draw_slices(LARGE_SLICES)) - search_ms) / (LARGE_SLICES * pixels)
        plane_ms = (plane_ms - pixel_ms) / (PLANES_PER_SLICE - 1)
        self._write_slices(near, 1, float(CELLS), above=False)
        found_ms = self._time_ms(lambda: self._draw_slices(1, resolve=True)) - search_ms

        least = 1e-9  # a timer that stands still must not make anything free
        return Speeds(
            vertex_ms=max(triangle_ms * 8 / 10, least),  # a fan: 8 triangles of 10 vertices
            pixel_ms=max(pixel_ms, least),
            slice_ms=max(slice_ms, least),
            slice_pixel_ms=max(pixel_ms - plane_ms, least),
            plane_pixel_ms=max(plane_ms, least),
            found_pixel_ms=max(found_ms / pixels, least),
            triangle_ms=max(triangle_ms, least),
            polygon_pixel_ms=max((filled_ms - 2 * TILE * TILE * UNSEEN * triangle_ms) / pixels, least),
            search_ms=max(search_ms, 0.0),
        )

    def _look_from(self, cell_px: float) -> Frame:
        """From above the middle, where a cell has this many pixels."""
        camera = Camera((CELLS / 2 + 0.5, 1.0, CELLS / 2 + 0.5), 0.0, -90.0)
        height_m = camera.pixels_per_radian(self._viewport[1]) / cell_px
        camera = Camera((CELLS / 2 + 0.5, height_m, CELLS / 2 + 0.5), 0.0, -90.0)
        frame = Frame(camera, self._viewport, 0.1 * height_m, reversed_z=self._gpu.reversed_z)
        self._gpu.prepare_state()
        self._block.write(frame, self._flat, Look())
        self._heights.use(UNITS["u_heights"])
        self._ground.use(UNITS["u_ground"])
        return frame

    def _write_slices(
        self, frame: Frame, count: int, size_m: float, above: bool, places: int = 1, per_slice: int = 1
    ) -> None:
        """Stacks of horizontal slices of this size, all above the ground or all in it; ``places`` x ``places`` of them.

        One behind the other they would keep but one thread of a software rasteriser busy.
        """
        boxes = places * places
        centre = CELLS / 2 + (np.indices((places, places)).reshape(2, -1).T - (places - 1) / 2) * CELLS / (4 * places)
        lower, upper = np.zeros((boxes, 3)), np.zeros((boxes, 3))
        lower[:, ::2], upper[:, ::2] = centre - size_m / 2, centre + size_m / 2
        depth_m = 0.01 * frame.eye_m[1]
        lower[:, 1], upper[:, 1] = (depth_m, 2 * depth_m) if above else (-depth_m, 0.0)
        one = np.ones(boxes, np.int32)
        each = count // boxes
        cut = Cut(Nodes(one, one, one), lower, upper, one * Y_SLICES, one * each, 0 * one, EVERYWHERE, 0.0)
        self._bundles.write_records(cut, frame, 0.0)
        self._bundles.write_names(name_slices(cut, frame.eye_m, False, per_slice), per_slice)

    def _draw_polygons(self, tiles: int) -> None:
        self._polygons.program("shaded")["u_tile_posts"] = TILE + 1
        self._polygons.render("shaded", moderngl.TRIANGLES, instances=tiles)

    def _draw_slices(self, count: int, resolve: bool = False) -> None:
        self._bundles.slices = count
        self._bundles.find(self._target.framebuffer, False)
        if resolve:
            self._bundles.resolve("shaded", EVERYWHERE, False)

    def _time_ms(self, draw: Callable[[], None]) -> float:
        """The shortest of a few runs, after one that compiles and uploads; in a run, as often as a clock can see."""
        ctx = self._gpu.ctx
        often = 1 if self._gpu.is_software else 8
        times = []
        for _ in range(1 + REPEATS):
            self._target.framebuffer.use()
            ctx.finish()
            begin = time.perf_counter()
            for _ in range(often):
                self._target.framebuffer.clear(depth=0.0)
                draw()
            ctx.finish()
            times.append((time.perf_counter() - begin) * 1e3 / often)
        return min(times[1:])

    def release(self) -> None:
        self._bundles.release()
        self._target.release()
        for part in (self._polygons, self._block, self._heights, self._ground, self._tiles, self._indices):
            part.release()
