"""A beside B: the picture and what another algorithm or setting makes of the same view, split or subtracted.

A is what the session shows; B is a renderer of its own on the same stage.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.frame import Frame
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import Target, create_target
from terrain.measure.accuracy import drawn_by
from terrain.renderers import RENDERERS
from terrain.renderers.base import Renderer
from terrain.stage import Stage

Mode = Literal["off", "split", "difference"]
MODES: Mapping[Mode, str] = {"off": "off", "split": "side by side", "difference": "difference"}
DIVIDER_RANGE = (0.02, 0.98)


class Part(NamedTuple):
    """A target, and which part of the window's width shows it, as shares from the left."""

    target: Target
    left: float
    right: float


class Comparison:
    """What B is, and how it is shown.

    Attributes
    ----------
    mode : {"off", "split", "difference"}
    divider : float
        Where A ends and B begins, as a share of the width.
    algorithm : str
    settings : Settings
        Of B.
    """

    def __init__(self, algorithm: str = "reference") -> None:
        self.mode: Mode = "off"
        self.divider = 0.5
        self.algorithm = algorithm
        self.settings: Any = RENDERERS[algorithm].Settings()
        self._renderer: Renderer | None = None
        self._subtract: Geometry | None = None
        self._targets: list[Target] = []

    def choose(self, algorithm: str, settings: Any = None) -> None:
        """What B is from now on; without settings the tolerance goes along, all else is the algorithm's default."""
        if settings is None:
            settings = RENDERERS[algorithm].Settings(tolerance_px=self.settings.tolerance_px)
        same = algorithm == self.algorithm and replace(self.settings, tolerance_px=settings.tolerance_px) == settings
        if not same:
            self._drop_renderer()
        elif self._renderer is not None:
            self._renderer.settings = settings
        self.algorithm, self.settings = algorithm, settings

    def draw(self, stage: Stage, frame: Frame, picture: Target, view: Any) -> None:
        """Draw B's picture of a frame whose A has just been drawn into ``picture``, and the difference of the two."""
        if self.mode == "off":
            return
        if not self._targets or self._targets[0].size_px != picture.size_px:
            self._drop_targets()
            self._targets = [create_target(stage.gpu, picture.size_px) for _ in range(2)]
        if self._renderer is None:
            self._renderer = RENDERERS[self.algorithm](stage.gpu, stage.scene, self.settings)
        other, difference = self._targets
        with drawn_by(stage, self._renderer):
            if stage.frozen is not None:
                self._renderer.select(stage.frozen)
            stage.draw(frame, other, view)
        if self.mode == "difference":
            if self._subtract is None:
                self._subtract = Geometry(stage.gpu, "fullscreen", "view_difference")
            difference.framebuffer.use()
            stage.gpu.ctx.disable(moderngl.DEPTH_TEST)
            picture.texture.use(UNITS["u_extra0"])
            other.texture.use(UNITS["u_extra1"])
            self._subtract.render("flat", vertices=3)
            stage.gpu.ctx.enable(moderngl.DEPTH_TEST)

    def parts(self, picture: Target) -> list[Part]:
        """What to show of a picture, from left to right."""
        if self.mode == "off" or not self._targets or self._targets[0].size_px != picture.size_px:
            return [Part(picture, 0.0, 1.0)]
        other, difference = self._targets
        if self.mode == "difference":
            return [Part(difference, 0.0, 1.0)]
        return [Part(picture, 0.0, self.divider), Part(other, self.divider, 1.0)]

    def compose(self, picture: Target) -> npt.NDArray[np.uint8]:
        """What is shown, (height, width, 3) uint8, row 0 at the top."""
        width = picture.size_px[0]
        columns = [
            part.target.read()[:, round(part.left * width) : round(part.right * width), :3]
            for part in self.parts(picture)
        ]
        return np.ascontiguousarray(np.concatenate(columns, axis=1))

    def release(self) -> None:
        """Release what was made on the GPU; it is made again where it is needed."""
        self._drop_renderer()
        self._drop_targets()
        if self._subtract is not None:
            self._subtract.release()
            self._subtract = None

    def _drop_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.release()
            self._renderer = None

    def _drop_targets(self) -> None:
        for target in self._targets:
            target.release()
        self._targets = []
