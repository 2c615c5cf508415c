"""What a renderer is. Read this first; everything else in this package is an implementation.

Adding an algorithm: one pure module in ``terrain/algorithms/``, one renderer here, its shaders under the same stem, one
line in the table of ``terrain/renderers/__init__.py``. It then appears by itself in the panel, the command line, the
contract tests, the chart and the stability suite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt

from terrain.frame import Frame, FrameStats
from terrain.gpu.context import Gpu
from terrain.heightfield import Diagonal
from terrain.scene import Scene
from terrain.settings import setting as setting


@dataclass(frozen=True)
class Settings:
    """Settings every algorithm has; each adds its own fields in a frozen subclass."""

    tolerance_px: float = setting(
        1.0, "Tolerance", "Allowed geometric error on the screen.", unit="px", range=(0.25, 16.0)
    )

    def unhurried(self) -> Self:
        """These settings without what depends on earlier frames (animation, budgets): for films and large pictures."""
        return self


class Boxes(NamedTuple):
    """Axis-aligned boxes for the boxes view: corners (n, 3) in world metres, and a level (n,) that colours them."""

    lower_m: npt.NDArray[np.float64]
    upper_m: npt.NDArray[np.float64]
    level: npt.NDArray[np.int64]


class Renderer(Protocol):
    """One algorithm drawing one scene.

    The stage calls `select` (CPU, timed on its own), then `draw` into the bound and cleared target, in whatever
    ``frame.output`` asks for. `draw` may be called several times after one `select` (other outputs, wireframe) and,
    with the selection frozen, with another camera: what it draws was chosen by the last `select`, where it is drawn
    from is the frame's. It draws the surface with ``shaders/lib/output.glsl``, writes depth, restores what GL state it
    changes, and fills `stats`.

    A renderer whose `boxes` bound all the ground it draws may say so by a class attribute ``boxes_hold_ground = True``:
    what lies on the ground is then chosen for them.
    """

    name: str  # "slicing": the stem
    title: str  # "Adaptive slicing"
    source: str  # the paper
    Settings: Any  # the subclass of Settings it takes
    diagonal: Diagonal  # the surface it promises to draw
    settings: Any  # an instance of Settings; the stage assigns a new one when a setting changes
    stats: FrameStats

    def __init__(self, gpu: Gpu, scene: Scene, settings: Any) -> None: ...
    def select(self, frame: Frame) -> None: ...
    def draw(self, frame: Frame) -> None: ...
    def boxes(self) -> Boxes: ...
    def release(self) -> None: ...
