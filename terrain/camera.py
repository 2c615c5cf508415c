"""The camera: a float64 eye, three angles, and the matrices made from them.

Yaw is clockwise from north (0 looks along -z, 90 along +x), pitch positive up, roll positive clockwise, the field of
view vertical; all in degrees, as in the flight file. Matrices act on column vectors. No matrix holds the eye's
position: the GPU sees positions relative to the eye, so that a northing of 6 million metres does not shake the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A view of the world.

    Attributes
    ----------
    position_m : tuple of 3 float
        The eye ``(x, y, z)`` in world metres.
    yaw_deg, pitch_deg, roll_deg : float
    fov_deg : float
        Vertical field of view, above 0 and below 180 degrees.
    """

    position_m: tuple[float, float, float]
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    fov_deg: float = 60.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.position_m, self.yaw_deg, self.pitch_deg, self.roll_deg))):
            raise ValueError(f"expected a finite eye and angles, found {self}")
        if not 0.0 < self.fov_deg < 180.0:
            raise ValueError(f"expected a field of view between 0 and 180 degrees, found {self.fov_deg}")

    @property
    def eye_m(self) -> Floats:
        return np.array(self.position_m, np.float64)

    def view_from_eye(self) -> Floats:
        """Rotation (3, 3) from world axes to view axes (x right, y up, z towards the viewer)."""
        yaw, pitch, roll = (math.radians(a) for a in (self.yaw_deg, self.pitch_deg, self.roll_deg))
        cy, sy, cp, sp, cr, sr = (
            math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
        )  # fmt: skip
        forward = np.array([sy * cp, sp, -cy * cp])
        right = np.array([cy, 0.0, sy])
        up = np.array([-sy * sp, cp, cy * sp])  # right x forward
        # A clockwise roll of the camera turns its right axis downwards.
        return np.stack([cr * right - sr * up, sr * right + cr * up, -forward])

    @property
    def forward(self) -> Floats:
        """Unit vector (3,) along the sight line, world axes."""
        return -self.view_from_eye()[2]

    def clip_from_eye(self, aspect: float, near_m: float, reversed_z: bool = True) -> Floats:
        """Projection times rotation (4, 4) for positions relative to the eye; the far plane is at infinity.

        With ``reversed_z`` depth runs from 1 at the near plane to 0 at infinity for a clip volume 0..1, where floating
        point depth resolves every distance to the same relative precision; otherwise from -1 to 1 (OpenGL's default).
        """
        f = 1.0 / math.tan(math.radians(self.fov_deg) / 2.0)
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1], projection[3, 2] = f / aspect, f, -1.0
        if reversed_z:
            projection[2, 3] = near_m
        else:
            projection[2, 2], projection[2, 3] = -1.0, -2.0 * near_m
        rotation = np.eye(4)
        rotation[:3, :3] = self.view_from_eye()
        return projection @ rotation

    def side_planes(self, aspect: float) -> Floats:
        """Unit normals (4, 3) of the left, right, bottom and top planes, pointing inwards; all contain the eye."""
        f = 1.0 / math.tan(math.radians(self.fov_deg) / 2.0)
        view = np.array([[f / aspect, 0, -1], [-f / aspect, 0, -1], [0, f, -1], [0, -f, -1]], np.float64)
        normals = view @ self.view_from_eye()
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def pixels_per_radian(self, viewport_height_px: int) -> float:
        """K = p_y / (2 tan(fov / 2)): a length x at distance l covers K x / l pixels."""
        return viewport_height_px / (2.0 * math.tan(math.radians(self.fov_deg) / 2.0))

    def ray_directions(self, width_px: int, height_px: int) -> Floats:
        """World directions (height, width, 3) through the pixel centres, row 0 at the top, view depth 1 each."""
        t = math.tan(math.radians(self.fov_deg) / 2.0)
        x = ((np.arange(width_px) + 0.5) / width_px * 2.0 - 1.0) * t * width_px / height_px
        y = (1.0 - (np.arange(height_px) + 0.5) / height_px * 2.0) * t
        view = np.empty((height_px, width_px, 3))
        view[..., 0], view[..., 1], view[..., 2] = x[None, :], y[:, None], -1.0
        return view @ self.view_from_eye()
