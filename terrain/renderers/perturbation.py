"""Perturbed base planes: one sight ray per pixel through the multilevel height map of each plane.

A pass over blocks of 8 x 8 pixels first takes whole bundles of rays as far as all of them surely stay above ground; the
rays then go on from there. Nothing is tessellated, and nothing is chosen on the CPU: the level of detail is found by
each ray. Planes and ordinary polygons meet in the depth buffer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, cast

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.perturbation import Interpolation, build_bounds, select_nodes
from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import create_target
from terrain.heightfield import Diagonal
from terrain.planes import BasePlane
from terrain.renderers import base
from terrain.renderers.base import Boxes, setting
from terrain.scene import Scene

BLOCK_PX = 8
PACKED_CELLS = 40_000_000  # up to here (640 MB) the corners of a cell lie in one texel: one fetch instead of four
STEPS_PER_HUE = 8.0
FARTHEST_CELL = 1 << 30  # the eye may be farther from a finely sampled plane than integers reach


@dataclass(frozen=True)
class PerturbationSettings(base.Settings):
    """Settings of the ray caster."""

    detail: bool = setting(True, "Level of detail", "Stop where the error falls below the tolerance; off: every cell.")
    interpolation: str = setting(
        "triangles", "Surface", "Between posts: the triangles all algorithms share, or a smooth surface.",
        choices=("triangles", "bilinear", "bicubic"), rebuild=True,
    )  # fmt: skip
    bounds: str = setting(
        "planes", "Bounds", "Of a node: two planes, or two heights (the paper's maximum pyramid).",
        choices=("planes", "heights"), rebuild=True,
    )  # fmt: skip
    bundles: bool = setting(True, "Ray bundles", "Start rays where bundles of 8 x 8 pixels may first meet the ground.")
    step_limit: int = setting(1000, "Step limit", "Nodes a ray may visit before it counts as a hit.", range=(8, 4000))
    level_view: str = setting(
        "levels", "Levels view", "What the levels view shows: where rays end, or how many steps they take.",
        choices=("levels", "steps"),
    )  # fmt: skip


class PerturbationRenderer:
    """Base planes perturbed by height maps, cast ray by ray."""

    name = "perturbation"
    title = "Perturbed base planes"
    source = "Vyatkin, Pavlov and Romanyuk, Real-time hybrid terrain rendering"
    Settings = PerturbationSettings
    diagonal: Diagonal = "alternating"
    limits: ClassVar[Mapping[str, str]] = {
        "needles/fast flight": "a flank passes within 1/256 px of a pixel's centre: the reference is rounded onto it"
    }

    def __init__(self, gpu: Gpu, scene: Scene, settings: PerturbationSettings) -> None:
        begin = time.perf_counter()
        self.settings: Any = settings
        self._gpu = gpu
        self._chosen: Frame | None = None
        self._planes = [
            _Plane(gpu, plane, settings, None if index == 0 else plane.colour)
            for index, plane in enumerate((BasePlane(scene.heightfield), *scene.planes))
        ]
        self._starts: tuple[moderngl.Framebuffer, moderngl.Texture] | None = None
        self._no_starts = _nearest(gpu.ctx.texture((1, 1), 2, np.array([0, 99], np.float32).tobytes(), dtype="f4"))
        self._white = _nearest(gpu.ctx.texture((1, 1), 4, b"\xff" * 4))
        self.stats = FrameStats(
            resident_bytes=sum(plane.resident_bytes for plane in self._planes),
            prepare_s=time.perf_counter() - begin,
        )

    def select(self, frame: Frame) -> None:
        self._chosen = frame

    def draw(self, frame: Frame) -> None:
        ctx = self._gpu.ctx
        wireframe, ctx.wireframe = ctx.wireframe, False  # the fragments draw the lines themselves
        self.stats.draw_calls = sum(self._draw_plane(plane, frame) for plane in self._planes)
        self.stats.triangles = 2 * self.stats.draw_calls  # rectangles over the picture
        ctx.wireframe = wireframe
        self.stats.ray_steps = None
        if frame.output == "levels" and self.settings.level_view == "steps":
            self.stats.ray_steps = float(self.count_steps(frame).mean())

    def count_steps(self, frame: Frame) -> npt.NDArray[np.float32]:
        """Nodes every pixel's ray visits, (height, width), row 0 at the top; those of the bundles are not in it."""
        ctx = self._gpu.ctx
        bound = ctx.fbo
        target = create_target(self._gpu, frame.viewport_px, "count")
        target.framebuffer.use()
        target.framebuffer.clear(depth=0.0)
        ctx.enable(moderngl.BLEND)
        ctx.blend_func = moderngl.ONE, moderngl.ONE  # the planes' steps add up
        ctx.depth_func = "1"
        for plane in self._planes:
            self._draw_plane(plane, replace(frame, output="overdraw"), {"COUNT_STEPS": 1})
        ctx.depth_func = ">"
        ctx.disable(moderngl.BLEND)
        steps = np.asarray(target.read()[..., 0], np.float32).copy()
        target.release()
        bound.use()
        return steps

    def _draw_plane(self, plane: _Plane, frame: Frame, defines: Mapping[str, int] = MappingProxyType({})) -> int:
        """Draw one plane into the bound target; returns the number of draw calls."""
        rectangle = plane.rectangle(frame)
        if rectangle is None:
            return 0
        settings, gpu = self.settings, self._gpu
        view = plane.look_from(frame)
        bundled = settings.bundles and not view.is_below and bool(plane.bounds.widened)
        if bundled:
            target = gpu.ctx.fbo
            self._draw_starts(plane, view, frame)
            target.use()
        chosen = self._chosen if self._chosen is not None else frame
        switches = {"FROM_BELOW": view.needs_sign}
        geometry = plane.geometry({**defines, **{name: 1 for name, used in switches.items() if used}})
        program = geometry.program(frame.output)
        thickness = 2.0 * settings.tolerance_px / chosen.pixels_per_radian if settings.detail else 0.0
        by_steps = settings.level_view == "steps"
        # A middle plane may lie half a node's thickness below everything.
        plane.set_view(program, view, 0.5 * thickness * plane.farthest_m(chosen))
        _set(program, "u_rectangle", rectangle)
        _set(program, "u_blocks_per_px", 1.0 / BLOCK_PX if bundled else 0.0)
        _set(program, "u_thickness", thickness)
        _set(program, "u_chosen_eye", tuple(view.map_from_world @ (chosen.eye_m - frame.eye_m)))
        _set(program, "u_cell_m", plane.plane.heightfield.spacing_m)
        _set(program, "u_step_limit", settings.step_limit)
        _set(program, "u_view_scale", (0.0, 1.0 / STEPS_PER_HUE) if by_steps else (1.0, 0.0))
        plane.bind(program)
        starts = self._starts[1] if bundled and self._starts is not None else self._no_starts
        starts.use(UNITS["u_extra0"])
        if plane.colour is not None:
            self._white.use(UNITS["u_extra3"])
            _set(program, "u_ground", UNITS["u_extra3"])
            _set(program, "u_albedo", plane.colour)
        geometry.render(frame.output, moderngl.TRIANGLE_STRIP, vertices=4)
        return 1 + bundled

    def _draw_starts(self, plane: _Plane, view: _View, frame: Frame) -> None:
        """Fill the blocks' starts."""
        ctx = self._gpu.ctx
        width, height = frame.viewport_px
        size = (-(-width // BLOCK_PX), -(-height // BLOCK_PX))
        if self._starts is None or self._starts[0].size != size:
            self._release_starts()
            texture = _nearest(ctx.texture(size, 2, dtype="f4"))
            self._starts = ctx.framebuffer([texture]), texture
        self._starts[0].use()
        self._starts[0].clear()  # with alpha 1 whatever blending is on leaves what is written
        program = plane.beams.program("flat")
        plane.set_view(program, view)
        _set(program, "u_rectangle", (-1.0, -1.0, 1.0, 1.0))
        _set(program, "u_block_px", float(BLOCK_PX))
        plane.widened.use(UNITS["u_extra1"])
        plane.beams.render("flat", moderngl.TRIANGLE_STRIP, vertices=4)

    def boxes(self) -> Boxes:
        """The nodes whose middle planes rays may end on, down to 8 x 8 cells."""
        terrain = self._planes[0]
        if self._chosen is None:
            return Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
        tolerance = self.settings.tolerance_px if self.settings.detail else 0.0
        lower, upper, level = select_nodes(terrain.bounds, terrain.plane.heightfield.spacing_m, self._chosen, tolerance)
        return Boxes(lower, upper, level)

    def _release_starts(self) -> None:
        for part in self._starts or ():
            part.release()

    def release(self) -> None:
        self._release_starts()
        for plane in self._planes:
            plane.release()
        self._no_starts.release()
        self._white.release()


@dataclass(frozen=True)
class _View:
    """A plane seen from an eye: what the shaders need to know, in map coordinates."""

    map_from_world: npt.NDArray[np.float64]  # (3, 3)
    eye_cell: tuple[int, ...]
    eye_part: tuple[float, float]
    eye_h: float
    inwards: tuple[float, float]
    is_below: bool  # the eye is under the surface
    needs_sign: bool  # rays may start under the surface


class _Plane:
    """One base plane on the GPU."""

    def __init__(
        self, gpu: Gpu, plane: BasePlane, settings: PerturbationSettings, colour: tuple[float, float, float] | None
    ) -> None:
        terrain = plane.heightfield
        self.plane, self.colour, self._gpu = plane, colour, gpu
        interpolation = cast(Interpolation, settings.interpolation)
        self.bounds = build_bounds(
            terrain.heights_m, interpolation, sloped=settings.bounds == "planes", holes=terrain.holes
        )
        self._map_from_world = plane.map_from_world
        self._corners_m = plane.corners_m(self.bounds.range_m)
        ctx = gpu.ctx
        self.pyramid = _mip_texture(gpu, self.bounds.levels)
        self.widened = _mip_texture(gpu, self.bounds.widened or self.bounds.levels)
        self._defines = {} if settings.interpolation == "triangles" else {settings.interpolation.upper(): 1}
        if colour is not None:
            self._defines["PLANE"] = 1
        self._packed = self._posts = None
        heights = terrain.heights_m
        if heights.size <= PACKED_CELLS:
            self._defines["PACKED"] = 1
            corners = np.stack([heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]], axis=-1)
            self._packed = _nearest(ctx.texture((terrain.cols - 1, terrain.rows - 1), 4, corners.data, dtype="f4"))
        if colour is not None:
            self._posts = _nearest(ctx.texture((terrain.cols, terrain.rows), 1, heights.data, dtype="f4"))
        textures = (self.pyramid, self.widened, self._packed, self._posts)
        self.resident_bytes = sum(_bytes_of(texture) for texture in textures if texture is not None)
        self._geometries: dict[tuple[str, ...], Geometry] = {}
        self.beams = Geometry(gpu, "perturbation", "perturbation_beam")

    def geometry(self, defines: dict[str, int]) -> Geometry:
        """The pass over the picture, in one variant."""
        key = tuple(sorted(defines))
        if key not in self._geometries:
            self._geometries[key] = Geometry(
                self._gpu, "perturbation", "perturbation", defines={**self._defines, **defines}
            )
        return self._geometries[key]

    def rectangle(self, frame: Frame) -> tuple[float, float, float, float] | None:
        """The part of the picture the plane can fill, in clip coordinates; None where it cannot be seen."""
        clip = np.concatenate([self._corners_m - frame.eye_m, np.ones((8, 1))], axis=1) @ frame.clip_from_eye.T
        if (clip[:, 3] <= 0.0).all():
            return None
        if (clip[:, 3] <= frame.near_m).any():  # partly behind the eye
            return -1.0, -1.0, 1.0, 1.0
        place = clip[:, :2] / clip[:, 3:]
        pixel = 2.0 / np.array(frame.viewport_px)
        low = np.clip(place.min(axis=0) - pixel, -1.0, 1.0)
        high = np.clip(place.max(axis=0) + pixel, -1.0, 1.0)
        return None if (low >= high).any() else (low[0], low[1], high[0], high[1])

    def look_from(self, frame: Frame) -> _View:
        """The eye and its rays in the plane's map."""
        u, v, h = (self._map_from_world @ np.append(frame.eye_m, 1.0))[:3]
        rows, cols = self.bounds.cells
        is_inside = 0.0 <= u <= cols and 0.0 <= v <= rows
        is_below = is_near = False
        if is_inside:
            terrain = self.plane.heightfield
            dx, dz = terrain.spacing_m
            clearance = h - float(terrain.heights_at(u * dx, v * dz))
            row, col = max(int(v) - 1, 0), max(int(u) - 1, 0)
            steepest = float(np.ptp(terrain.heights_m[row : row + 4, col : col + 4])) / min(dx, dz)
            is_below = clearance <= 0.0
            is_near = clearance <= 4.0 * frame.near_m * math.hypot(1.0, steepest)  # the near plane may cut the ground
        cell = tuple(math.floor(np.clip(x, -FARTHEST_CELL, FARTHEST_CELL)) for x in (u, v))
        return _View(
            self._map_from_world[:3, :3], cell, (u - cell[0], v - cell[1]), h,
            (1e-20 if 2 * u < cols else -1e-20, 1e-20 if 2 * v < rows else -1e-20),
            is_below, is_near or not is_inside or self.plane.heightfield.holes is not None,
        )  # fmt: skip

    def farthest_m(self, frame: Frame) -> float:
        """Distance from the eye to the farthest corner."""
        return float(np.linalg.norm(self._corners_m - frame.eye_m, axis=1).max())

    def set_view(self, program: moderngl.Program, view: _View, below_m: float = 0.0) -> None:
        low, high = self.bounds.range_m[0] - below_m, self.bounds.range_m[1]
        margin = 1e-6 * max(abs(low - view.eye_h), abs(high - view.eye_h))  # flat ground must keep some thickness
        h = np.float32(view.eye_h)
        _set(program, "u_map_from_world", tuple(view.map_from_world.T.ravel()))
        _set(program, "u_cells", self.bounds.cells[::-1])
        _set(program, "u_eye_cell", view.eye_cell)
        _set(program, "u_eye_map", (*view.eye_part, float(h), view.eye_h - float(h)))
        _set(program, "u_range", (low - view.eye_h - margin, high - view.eye_h + margin))
        _set(program, "u_inwards", view.inwards)
        _set(program, "u_top_level", len(self.bounds.levels))

    def bind(self, program: moderngl.Program) -> None:
        self.pyramid.use(UNITS["u_pyramid"])
        if self._packed is not None:
            self._packed.use(UNITS["u_packed"])
        if self._posts is not None:
            self._posts.use(UNITS["u_extra2"])
        # The terrain's posts are the stage's own texture.
        _set(program, "u_posts", UNITS["u_heights" if self._posts is None else "u_extra2"])

    def release(self) -> None:
        for part in (self.pyramid, self.widened, self._packed, self._posts, self.beams, *self._geometries.values()):
            if part is not None:
                part.release()


def _set(program: moderngl.Program, name: str, value: Any) -> None:
    """Set a uniform, where the variant uses it."""
    if name in program:
        program[name] = value


def _nearest(texture: moderngl.Texture) -> moderngl.Texture:
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _mip_texture(gpu: Gpu, levels: tuple[npt.NDArray[np.float32], ...]) -> moderngl.Texture:
    """One mip level per level; padded so that every level is exactly half the one before."""
    whole = 1 << (len(levels) - 1)
    rows, cols = (-(-n // whole) * whole for n in levels[0].shape[:2])
    texture = gpu.ctx.texture((cols, rows), 4, dtype="f4")
    texture.build_mipmaps(0, len(levels) - 1)
    for number, level in enumerate(levels):
        short = ((0, (rows >> number) - level.shape[0]), (0, (cols >> number) - level.shape[1]), (0, 0))
        whole_level = np.pad(level, short) if any(missing for _, missing in short) else level
        texture.write(np.ascontiguousarray(whole_level).data, level=number)
    texture.filter = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)
    return texture


def _bytes_of(texture: moderngl.Texture) -> int:
    mips = 4 / 3 if texture.filter[0] == moderngl.NEAREST_MIPMAP_NEAREST else 1.0
    return int(texture.width * texture.height * texture.components * 4 * mips)
