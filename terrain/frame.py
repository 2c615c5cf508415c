"""What a renderer is given for one picture (`Frame`) and what it reports back (`FrameStats`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.heightfield import Heightfield

Output = Literal["shaded", "position", "levels", "normals", "overdraw", "flat"]
"""What a fragment writes; ``shaders/lib/output.glsl`` has one branch for each.

``shaded`` colour · ``position`` world position relative to the eye (xyz, float32) with w >= 1 · ``levels`` a colour per
level of detail · ``normals`` the normal of the drawn surface as colour · ``overdraw`` adds 1 · ``flat`` one colour
(lines of the wireframe view).
"""

LEAST_NEAR_M = 1e-4


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
    whole_px : tuple of int or None
        Size of the picture this frame is a tile of; None where it is the whole picture.
    corner_px : tuple of int
        The tile's lower left corner in that picture.
    """

    camera: Camera
    viewport_px: tuple[int, int]
    near_m: float = 0.1
    output: Output = "shaded"
    time_s: float = 0.0
    reversed_z: bool = True
    whole_px: tuple[int, int] | None = None
    corner_px: tuple[int, int] = (0, 0)

    def tile(self, corner_px: tuple[int, int], size_px: tuple[int, int]) -> Frame:
        """A part of this picture, drawn as a picture of its own."""
        return replace(self, viewport_px=size_px, whole_px=self.picture_px, corner_px=corner_px)

    @property
    def whole(self) -> Frame:
        """The picture this is a tile of: what is drawn is chosen for it, so that tiles meet."""
        return (
            self if self.whole_px is None else replace(self, viewport_px=self.whole_px, whole_px=None, corner_px=(0, 0))
        )

    @property
    def picture_px(self) -> tuple[int, int]:
        """Size of the whole picture."""
        return self.viewport_px if self.whole_px is None else self.whole_px

    @property
    def aspect(self) -> float:
        """Of the whole picture."""
        return self.picture_px[0] / self.picture_px[1]

    @cached_property
    def eye_m(self) -> npt.NDArray[np.float64]:
        return self.camera.eye_m

    @cached_property
    def pixels_per_radian(self) -> float:
        """K: a length x [m] at distance l [m] covers K x / l pixels."""
        return self.camera.pixels_per_radian(self.picture_px[1])

    @cached_property
    def side_planes(self) -> npt.NDArray[np.float64]:
        """Unit normals (4, 3) of the left, right, bottom and top planes of this tile, pointing inwards."""
        if self.whole_px is None:
            return self.camera.side_planes(self.aspect)
        x, y, _, w = self.clip_from_eye[:, :3]
        normals = np.stack([w + x, w - x, w + y, w - y])
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    @cached_property
    def clip_from_eye(self) -> npt.NDArray[np.float64]:
        clip = self.camera.clip_from_eye(self.aspect, self.near_m, self.reversed_z)
        if self.whole_px is not None:
            whole, size = np.array(self.whole_px), np.array(self.viewport_px)
            middle = (whole - 2.0 * np.array(self.corner_px) - size) / size
            clip[:2] = clip[:2] * (whole / size)[:, None] + middle[:, None] * clip[3]
        return clip

    @cached_property
    def corners(self) -> npt.NDArray[np.float64]:
        """Lower left and upper right corner (2, 2) of this tile in the whole picture, -1 to 1."""
        low = np.array(self.corner_px, np.float64)
        return np.stack([low, low + self.viewport_px]) / self.picture_px * 2.0 - 1.0


@dataclass
class FrameStats:
    """What one frame cost. Counts are exact; a figure that was not measured stays None.

    ``pending`` says in words what better thing is being made aside: the same view drawn later may show it.
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
    pending: str = ""
    extra: dict[str, float] = field(default_factory=dict)


def near_plane_m(camera: Camera, heightfield: Heightfield) -> float:
    """A small distance: float depth is as precise with a tiny near plane, and none must cut the ground."""
    spacing_m = min(heightfield.spacing_m)
    x, y, z = camera.position_m
    clearance_m = abs(float(y - heightfield.heights_at(x, z)))
    if not math.isfinite(clearance_m):
        clearance_m = spacing_m
    return max(min(0.1 * clearance_m, 0.01 * spacing_m), LEAST_NEAR_M)
