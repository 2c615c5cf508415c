"""The stage: one terrain on one GPU, the renderer that is on, and everything all renderers share.

It owns the terrain's textures, the frame's uniform block, sky, water and the render targets, calls the renderer, and
reads pictures, positions and counts back. Nothing here knows an algorithm by name.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.drape import Drape
from terrain.frame import Frame, FrameStats, Output, near_plane_m
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.geometry import Geometry
from terrain.gpu.lines import Lines
from terrain.gpu.targets import Kind, Target, create_target
from terrain.gpu.timer import GpuTimer
from terrain.heightfield import Diagonal
from terrain.renderers import RENDERERS
from terrain.renderers.base import Boxes, Renderer
from terrain.scene import Scene
from terrain.textures.ground import Ground
from terrain.textures.layers import LayerStack, layer_defines, plain_stack
from terrain.textures.look import LookSettings, bake_design, look_uniforms, shading_defines
from terrain.textures.sky import Sky
from terrain.textures.tree import TileSource
from terrain.textures.trees import FIGURES
from terrain.views import Overlays, View, overdraw_figures

# Views of what a fragment writes; all others draw over the shaded picture.
_OUTPUTS: dict[View, Output] = {"levels": "levels", "normals": "normals", "overdraw": "overdraw"}
_BACKDROP = (0.09, 0.10, 0.12, 1.0)  # behind the terrain where there is no sky


class Stage:
    """One scene, drawn by one renderer at a time.

    Several stages may share a GPU: each brings its own switches and textures when it draws.

    Parameters
    ----------
    gpu : Gpu
    scene : Scene
    algorithm : str
        A key of `terrain.renderers.RENDERERS`.
    settings : Settings or None
        The algorithm's own; None takes its defaults.
    look : LookSettings

    Attributes
    ----------
    scene : Scene
    renderer : Renderer
    look : LookSettings
    frozen : Frame or None
        The frame for which what is drawn was chosen, while the selection is frozen.
    drape : Drape
        What lies over the ground.
    bake_budget_ms : float
        Time a frame may take to bake light anew after a change; what is not baked yet keeps its old light meanwhile.
        Unlimited at first: every picture is finished.
    """

    def __init__(
        self, gpu: Gpu, scene: Scene, algorithm: str = "geomorph", settings: Any = None,
        look: LookSettings = LookSettings(),  # noqa: B008 (frozen)
    ) -> None:  # fmt: skip
        self.gpu, self.scene, self.look = gpu, scene, look
        self.frozen: Frame | None = None
        self.draws_legends = True
        self.bake_budget_ms = math.inf
        self.drape = Drape(gpu, scene, look.texture_budget_mib << 20)
        self._uniforms = self._find_uniforms()
        self._block = FrameBlock(gpu)
        self._ground = Ground(gpu, scene.heightfield)
        self._overlays = Overlays(gpu)
        self._sky = Sky(gpu)
        self._water = Geometry(gpu, "fullscreen", "water")
        self._targets: dict[str, Target] = {}
        self._timer = None if gpu.is_software else GpuTimer(gpu.ctx)
        self._activate()
        self.renderer: Renderer = self._make(algorithm if algorithm in RENDERERS else "reference", settings)

    @property
    def lines(self) -> Lines:
        """For lines of one's own over a picture just drawn into the bound target."""
        return self._overlays.lines

    def _make(self, algorithm: str, settings: Any) -> Renderer:
        kind = RENDERERS[algorithm]
        return kind(self.gpu, self.scene, kind.Settings() if settings is None else settings)

    def _activate(self) -> None:
        """Make this stage's compile-time switches the GPU's: another stage may have drawn before."""
        programs = self.gpu.programs
        programs.defines.pop("HOLES", None)
        if self.scene.heightfield.holes is not None:
            programs.defines["HOLES"] = 1
        programs.shading_defines = {**shading_defines(self.look), **layer_defines(self.drape.stack)}

    def set_renderer(self, algorithm: str, settings: Any = None) -> None:
        """Switch to an algorithm, or give the current one other settings; it is rebuilt only where it must be.

        If the new renderer cannot be made, the old one stays.
        """
        current = self.renderer
        if algorithm == current.name and settings is not None:
            changed = {
                f.name for f in fields(settings) if getattr(settings, f.name) != getattr(current.settings, f.name)
            }
            if not any(f.name in changed and f.metadata.get("rebuild") for f in fields(settings)):
                current.settings = settings
                self._reselect()
                return
        self._activate()
        self.renderer = self._make(algorithm, settings)
        current.release()
        self._reselect()

    def set_look(self, look: LookSettings) -> None:
        """Change the look; what must be baked again is baked with the next frames."""
        if look.texture_budget_mib != self.look.texture_budget_mib:
            self.drape.trees.set_budget(look.texture_budget_mib << 20)
        self.look = look
        self._uniforms = self._find_uniforms()

    def set_layers(self, layers: LayerStack, sources: Mapping[str, TileSource]) -> None:
        """Show layers over the ground: see `Drape.lay`."""
        self.drape.lay(layers, sources)
        self._uniforms = self._find_uniforms()

    def animate_layers(self, share: float) -> None:
        """Go to a share of the time from the first key frame of the layers to their last, 0..1."""
        span = self.drape.stack.time_range
        if span is not None:
            self.drape.go_to(span[0] + share * (span[1] - span[0]))
            self._uniforms = self._find_uniforms()

    def set_images(self, sources: Sequence[TileSource]) -> None:
        """Lay images on the ground, each over those before it, instead of what lay there."""
        named = {str(number): source for number, source in enumerate(sources)}
        self.set_layers(plain_stack(list(named)), named)

    def _find_uniforms(self) -> Look:
        """What of the frame's uniform block look and layers decide."""
        return replace(look_uniforms(self.look, self.scene.heightfield), **self.drape.uniforms())

    @property
    def is_loading(self) -> bool:
        """Whether the next picture will be another though nothing moves."""
        return bool(self.unfinished)

    @property
    def unfinished(self) -> list[str]:
        """What is still made ready while frames are drawn, in words."""
        parts = {
            "reading images": self.drape.trees.is_loading,
            "baking light": not self._ground.is_done,
            self.renderer.stats.pending: bool(self.renderer.stats.pending),
        }
        return [words for words, is_on in parts.items() if is_on]

    def freeze(self, frame: Frame) -> None:
        """Keep what is chosen for ``frame`` until `thaw`, wherever one flies; its frustum is drawn."""
        self.frozen = frame
        self._reselect()

    def thaw(self) -> None:
        """Choose anew for every frame again."""
        self.frozen = None

    def _reselect(self) -> None:
        if self.frozen is not None:
            self.renderer.select(self.frozen)

    def frame(self, camera: Camera, size_px: tuple[int, int], time_s: float = 0.0) -> Frame:
        """The frame of a camera over this terrain, with a near plane below the eye's clearance."""
        return Frame(
            camera, size_px, near_plane_m(camera, self.scene.heightfield), "shaded", time_s, self.gpu.reversed_z
        )

    def target(self, size_px: tuple[int, int], kind: Kind = "colour") -> Target:
        """The stage's own target of a kind, made again when the size changes."""
        target = self._targets.get(kind)
        if target is None or target.size_px != size_px:
            if target is not None:
                target.release()
            self._targets[kind] = target = create_target(self.gpu, size_px, kind)
        return target

    def draw(self, frame: Frame, target: Target, view: View = "shaded", choose: bool = True) -> FrameStats:
        """Choose and draw one frame into ``target``: terrain, sky, water and what the view adds.

        Without ``choose`` what was chosen before is drawn again: a picture in tiles is chosen once, for the whole.

        Returns
        -------
        FrameStats
            The renderer's, with ``select_ms`` and ``submit_ms`` of this frame and, on hardware, ``gpu_ms`` of a frame
            shortly before.
        """
        stats = self._prepare(frame, choose)
        self._stream_tiles(frame, stats)
        begin = time.perf_counter()
        with self._timer.measure() if self._timer is not None else nullcontext():
            self._draw_view(frame, target, view)
        stats.submit_ms = (time.perf_counter() - begin) * 1e3
        stats.gpu_ms = self._timer.oldest_ms() if self._timer is not None else None
        return stats

    def draw_output(self, frame: Frame, target: Target) -> FrameStats:
        """Choose and draw only the surface, writing ``frame.output``: for measurements."""
        stats = self._prepare(frame)
        self._draw_surface(frame, target)
        return stats

    def _prepare(self, frame: Frame, choose: bool = True) -> FrameStats:
        """Everything before the first draw call of a frame: switches, state, bakes, selection, uniforms."""
        self._activate()
        self.gpu.prepare_state()
        self._ground.want_light(bool(self.drape.stack.layers))
        design = bake_design(self.look)
        self._ground.bake(design, self._uniforms, self._block, frame, self.bake_budget_ms)
        if self.frozen is None and choose:
            begin = time.perf_counter()
            self.renderer.select(frame.whole)
            self.renderer.stats.select_ms = (time.perf_counter() - begin) * 1e3
        self._ground.bind()
        self._block.write(frame, self.scene.heightfield, self._uniforms)
        return self.renderer.stats

    def load_tiles(self, frame: Frame, within_s: float = 0.02) -> bool:
        """Read on for a moment what a frame needs of images; whether all of it is there.

        Raises
        ------
        InputError
            If nothing at all of an image can be read.
        """
        if not self.drape.trees.count:
            return True
        if self._draws_patches and self.frozen is None:
            self.renderer.select(frame.whole)
        return self.drape.load(self.frozen or frame, self._patches, self.look.texture_tolerance_px2, within_s)

    def _stream_tiles(self, frame: Frame, stats: FrameStats) -> None:
        """Bring what lies on the terrain up to date for what can be seen of it, and bind it."""
        self.drape.stream(self.frozen or frame, self._patches, self.look.texture_tolerance_px2)
        figures = self.drape.trees.figures
        stats.extra = {name: value for name, value in stats.extra.items() if name not in FIGURES} | figures

    @property
    def _draws_patches(self) -> bool:
        """Whether texture patches are chosen for the renderer's own patches of ground (base.py)."""
        return bool(getattr(self.renderer, "boxes_hold_ground", False))

    @property
    def _patches(self) -> Boxes | None:
        return self.renderer.boxes() if self._draws_patches and self.drape.trees.count else None

    def _draw_surface(self, frame: Frame, target: Target) -> None:
        target.framebuffer.use()
        is_picture = frame.output in ("shaded", "levels", "normals")
        target.framebuffer.clear(*(_BACKDROP if is_picture else (0.0, 0.0, 0.0, 0.0)), depth=0.0)
        if frame.output == "overdraw":
            self.gpu.ctx.enable(moderngl.BLEND)
            self.gpu.ctx.blend_func = moderngl.ONE, moderngl.ONE
        self.renderer.draw(frame)
        self.gpu.ctx.disable(moderngl.BLEND)

    def _draw_view(self, frame: Frame, target: Target, view: View) -> None:
        output = _OUTPUTS.get(view, "shaded")
        if view == "error":
            errors = self._measure_errors(frame)
            target.framebuffer.use()
            target.framebuffer.clear(depth=0.0)
            self._overlays.draw_error(errors, self.renderer.settings.tolerance_px)
        elif output == "overdraw":
            counts = self.target(frame.viewport_px, "count")
            self._draw_surface(replace(frame, output="overdraw"), counts)
            target.framebuffer.use()
            target.framebuffer.clear(depth=0.0)
            self._overlays.draw_overdraw(counts, self.draws_legends and frame.corner_px == (0, 0))
        else:
            if view == "wireframe" and not self.gpu.reversed_z:
                self.gpu.programs.shading_defines["BELOW_LINES"] = 1  # until the next frame
            self._draw_surface(replace(frame, output=output), target)
        if output == "shaded" and view != "error":
            self._draw_surroundings()
        if view == "wireframe":
            self._overlays.draw_wires(target, lambda: self.renderer.draw(replace(frame, output="flat")))
        elif view == "boxes":
            self._overlays.draw_boxes(frame, self.renderer.boxes())
        if self.frozen is not None:
            far_m = 0.6 * math.hypot(*self.scene.heightfield.extent_m)
            self._overlays.draw_frustum(frame, self.frozen, far_m)

    def _draw_surroundings(self) -> None:
        """Sky where nothing was drawn, then water over both."""
        ctx = self.gpu.ctx
        ctx.depth_func = ">="
        self._sky.draw()
        ctx.depth_func = ">"
        if self.look.water:
            ctx.enable(moderngl.BLEND)
            ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
            self._water.render("shaded", vertices=3)
            ctx.disable(moderngl.BLEND)

    def render(
        self, camera: Camera, size_px: tuple[int, int], view: View = "shaded", time_s: float = 0.0
    ) -> npt.NDArray[np.uint8]:
        """A picture (height, width, 3) uint8, sRGB, row 0 at the top, with all that images have to show."""
        target, frame = self.target(size_px), self.frame(camera, size_px, time_s)
        while not self.load_tiles(frame):
            pass
        self.draw(frame, target, view)
        return np.ascontiguousarray(target.read()[..., :3])

    def positions(self, camera: Camera, size_px: tuple[int, int], time_s: float = 0.0) -> npt.NDArray[np.float64]:
        """World positions (height, width, 3) float64 at pixel centres, row 0 at the top; NaN where there is sky."""
        target = self.target(size_px, "position")
        frame = replace(self.frame(camera, size_px, time_s), output="position")
        self.draw_output(frame, target)
        data = target.read()
        world = data[..., :3] + frame.eye_m
        world[data[..., 3] < 0.5] = np.nan
        return world

    def errors(self, camera: Camera, size_px: tuple[int, int], time_s: float = 0.0) -> npt.NDArray[np.float32]:
        """How far the picture is from the truth (height, width, 4), row 0 at the top.

        Signed geometric error [px], vertical error [m], distance [m], and 1 where there is terrain, else 0: against the
        reference surface of the diagonal rule that the renderer promises.
        """
        frame = self.frame(camera, size_px, time_s)
        self._prepare(frame)
        return self._measure_errors(frame).read()

    def measure_error(self, positions: Target, errors: Target, diagonal: Diagonal) -> None:
        """Fill ``errors`` from the position target of the frame just drawn, as `errors` gives them."""
        errors.framebuffer.use()
        self._overlays.measure_error(positions, diagonal)

    def _measure_errors(self, frame: Frame) -> Target:
        positions, errors = (self.target(frame.viewport_px, kind) for kind in ("position", "error"))
        self._draw_surface(replace(frame, output="position"), positions)
        self.measure_error(positions, errors, self.renderer.diagonal)
        return errors

    def corners(self, camera: Camera, size_px: tuple[int, int], time_s: float = 0.0) -> npt.NDArray[np.float32]:
        """How many corners of drawn triangles lie in each pixel (height, width), row 0 at the top; hidden ones too."""
        target = self.target(size_px, "count")
        frame = replace(self.frame(camera, size_px, time_s), output="overdraw")
        self._prepare(frame)
        self.gpu.ctx.disable(moderngl.DEPTH_TEST)
        with self.gpu.corners_only():
            self._draw_surface(frame, target)
        self.gpu.ctx.enable(moderngl.DEPTH_TEST)
        counts: npt.NDArray[np.float32] = target.read()[..., 0]
        return counts

    def overdraw(self, camera: Camera, size_px: tuple[int, int], time_s: float = 0.0) -> tuple[float, float]:
        """Mean and maximum number of times a covered pixel is drawn."""
        target = self.target(size_px, "count")
        self.draw_output(replace(self.frame(camera, size_px, time_s), output="overdraw"), target)
        return overdraw_figures(target.read()[..., 0])

    def release(self) -> None:
        """Release everything the stage made on the GPU."""
        self.renderer.release()
        for target in self._targets.values():
            target.release()
        for part in (self._overlays, self._sky, self._water, self._ground, self.drape.trees, self._block):
            part.release()
