"""The stage: one terrain on one GPU, the renderer that is on, and everything all renderers share.

It owns the terrain's textures, the frame's uniform block, the sky and the render targets, calls the renderer, and reads
pictures, positions and counts back. Nothing here knows an algorithm by name.
"""

from __future__ import annotations

import time
from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame, FrameStats, Output
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import FrameBlock, Look
from terrain.gpu.geometry import Geometry
from terrain.gpu.targets import Target, create_target
from terrain.renderers import RENDERERS
from terrain.renderers.base import Renderer
from terrain.scene import Scene
from terrain.textures.ground import Ground, palette_texture


class Stage:
    """One scene, drawn by one renderer at a time.

    Parameters
    ----------
    gpu : Gpu
    scene : Scene
    algorithm : str
        A key of `terrain.renderers.RENDERERS`.
    """

    def __init__(self, gpu: Gpu, scene: Scene, algorithm: str = "reference") -> None:
        self.gpu, self.scene = gpu, scene
        gpu.programs.defines.pop("HOLES", None)
        if scene.heightfield.holes is not None:
            gpu.programs.defines["HOLES"] = 1
        self.look = Look(sun=(-0.55, 0.6, -0.58, 1.0))
        self.block = FrameBlock(gpu)
        self.ground = Ground(gpu, scene.heightfield)
        self._palette = palette_texture(
            gpu, np.array([[70, 100, 50], [140, 130, 90], [150, 140, 130], [250, 250, 255]], np.uint8)
        )
        self._sky = Geometry(gpu, "fullscreen", "sky")
        self._targets: dict[str, Target] = {}
        self.ground.bake(self._palette, self.look, self.block)
        self.renderer: Renderer = self._make(algorithm, None)

    def _make(self, algorithm: str, settings: Any) -> Renderer:
        kind = RENDERERS[algorithm]
        return kind(self.gpu, self.scene, kind.Settings() if settings is None else settings)

    def set_renderer(self, algorithm: str, settings: Any = None) -> None:
        """Switch to an algorithm, or give the current one other settings; it is rebuilt only where it must be."""
        current = self.renderer
        if algorithm == current.name and settings is not None:
            changed = {
                f.name for f in fields(settings) if getattr(settings, f.name) != getattr(current.settings, f.name)
            }
            rebuild = any(f.name in changed and f.metadata.get("rebuild") for f in fields(settings))
            if not rebuild:
                current.settings = settings
                return
        current.release()
        self.renderer = self._make(algorithm, settings)

    def frame(self, camera: Camera, viewport_px: tuple[int, int], time_s: float = 0.0) -> Frame:
        """The frame of a camera over this terrain, with a near plane below the eye's clearance."""
        return Frame(camera, viewport_px, self._near_m(camera), "shaded", time_s, self.gpu.reversed_z)

    def _near_m(self, camera: Camera) -> float:
        terrain = self.scene.heightfield
        x, y, z = camera.position_m
        smallest = 0.01 * min(terrain.spacing_m)
        clearance = float(y - terrain.heights_at(x, z))
        if not np.isfinite(clearance):
            clearance = max(terrain.spacing_m)
        return max(0.1 * abs(clearance), smallest)

    def target(self, size_px: tuple[int, int], kind: Any = "colour") -> Target:
        """The stage's own target of a kind, made again when the size changes."""
        target = self._targets.get(kind)
        if target is None or target.size_px != size_px:
            if target is not None:
                target.release()
            self._targets[kind] = target = create_target(self.gpu, size_px, kind)
        return target

    def draw(self, frame: Frame, target: Target, select: bool = True) -> FrameStats:
        """Draw the terrain and the sky into ``target``."""
        gpu = self.gpu
        gpu.prepare_state()
        self.ground.bind()
        stats = self.renderer.stats
        if select:
            begin = time.perf_counter()
            self.renderer.select(frame)
            stats.select_ms = (time.perf_counter() - begin) * 1e3
        self.block.write(frame, self.scene.heightfield, self.look)
        target.framebuffer.use()
        target.framebuffer.clear(depth=0.0)
        begin = time.perf_counter()
        self.renderer.draw(frame)
        if frame.output == "shaded":
            gpu.ctx.depth_func = ">="
            self._sky.render("shaded", vertices=3)
            gpu.ctx.depth_func = ">"
        stats.submit_ms = (time.perf_counter() - begin) * 1e3
        return stats

    def render(self, camera: Camera, size_px: tuple[int, int], output: Output = "shaded") -> npt.NDArray[Any]:
        """A picture: (height, width, 4) uint8, or float32 positions for ``output="position"``."""
        frame = replace(self.frame(camera, size_px), output=output)
        target = self.target(size_px, "position" if output == "position" else "colour")
        self.draw(frame, target)
        return target.read()

    def release(self) -> None:
        self.renderer.release()
        for target in self._targets.values():
            target.release()
        self._sky.release()
        self._palette.release()
        self.ground.release()
        self.block.release()
