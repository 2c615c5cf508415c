"""What a renderer is given for one picture (`Frame`) and what it reports back (`FrameStats`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera

Output = Literal["shaded", "position", "levels", "normals", "overdraw", "flat"]
"""What a fragment writes; ``shaders/lib/output.glsl`` has one branch for each.

``shaded`` colour · ``position`` world position relative to the eye (xyz, float32) with w >= 1 · ``levels`` a colour per
level of detail · ``normals`` the normal of the drawn surface as colour · ``overdraw`` adds 1 · ``flat`` one colour
(lines of the wireframe view).
"""


@dataclass(frozen=True)
class Frame:
    """One picture to be drawn.

    Attributes
    ----------
    camera : Camera
        Where the picture is drawn from.
    viewport_px : tuple of int
        ``(width, height)``.
    near_m : float
        Distance of the near plane; stays below the eye's clearance, so that it never clips the hill that hides others.
    output : Output
        What fragments write.
    time_s : float
        Time on the clock that drives time-controlled animation.
    reversed_z : bool
        Depth convention of the bound target (`Camera.clip_from_eye`).
    """

    camera: Camera
    viewport_px: tuple[int, int]
    near_m: float = 0.1
    output: Output = "shaded"
    time_s: float = 0.0
    reversed_z: bool = True

    @property
    def aspect(self) -> float:
        return self.viewport_px[0] / self.viewport_px[1]

    @cached_property
    def eye_m(self) -> npt.NDArray[np.float64]:
        return self.camera.eye_m

    @cached_property
    def pixels_per_radian(self) -> float:
        """K: a length x [m] at distance l [m] covers K x / l pixels."""
        return self.camera.pixels_per_radian(self.viewport_px[1])

    @cached_property
    def side_planes(self) -> npt.NDArray[np.float64]:
        return self.camera.side_planes(self.aspect)

    @cached_property
    def clip_from_eye(self) -> npt.NDArray[np.float64]:
        return self.camera.clip_from_eye(self.aspect, self.near_m, self.reversed_z)


@dataclass
class FrameStats:
    """What one frame cost. Counts are exact; a figure that was not measured stays None.

    ``frame_ms`` is the whole frame as measured by who presents it. ``extra`` holds figures of one algorithm only, keyed
    by a short label for the panel (``"tiles"``, ``"fans"`` ...).
    """

    triangles: int = 0
    draw_calls: int = 0
    slices: int | None = None
    ray_steps: float | None = None
    uploaded_bytes: int = 0
    resident_bytes: int = 0
    prepare_s: float = 0.0
    select_ms: float | None = None
    submit_ms: float | None = None
    gpu_ms: float | None = None
    frame_ms: float | None = None
    extra: dict[str, float] = field(default_factory=dict)
