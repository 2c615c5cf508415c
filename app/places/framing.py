"""Where to look from: height above the ground, and the view that shows a whole terrain."""

from __future__ import annotations

import math

from app.flying.controls import Clearance
from terrain.camera import Camera
from terrain.heightfield import Heightfield

FRAME_YAW_DEG, FRAME_PITCH_DEG = 20.0, -24.0
LEAST_CLEARANCE_SPACINGS = 0.06  # 1.8 m above posts 30 m apart: eye height


def ground_m(heightfield: Heightfield, x_m: float, z_m: float) -> float:
    """Height of the ground below a position, as every renderer draws it; beside the terrain, of its lowest point."""
    height = float(heightfield.ground_at(x_m, z_m))
    return height if math.isfinite(height) else heightfield.height_range_m[0]


def clearance_above(heightfield: Heightfield) -> Clearance:
    """The function that gives a position's height above this terrain."""
    return lambda x, y, z: y - ground_m(heightfield, x, z)


def least_clearance_m(heightfield: Heightfield) -> float:
    """How near to the ground the eye may come."""
    return LEAST_CLEARANCE_SPACINGS * min(heightfield.spacing_m)


def frame_terrain(heightfield: Heightfield, aspect: float = 16 / 9, fov_deg: float = 60.0) -> Camera:
    """The camera that sees the whole terrain from the south-south-west, a little from above."""
    width, depth = heightfield.extent_m
    low, high = heightfield.height_range_m
    radius = 0.5 * math.hypot(width, depth, high - low)
    half_angle = math.atan(math.tan(math.radians(fov_deg) / 2) * min(1.0, aspect))
    # Seen flat, a terrain fills far less than its bounding sphere: 0.8 of the sphere's distance still shows it all.
    distance = 0.8 * radius / math.sin(half_angle)
    camera = Camera((0.0, 0.0, 0.0), FRAME_YAW_DEG, FRAME_PITCH_DEG, 0.0, fov_deg)
    x, y, z = (width / 2, (low + high) / 2, depth / 2) - distance * camera.forward
    return Camera(
        (float(x), max(float(y), high + 0.01 * radius), float(z)), FRAME_YAW_DEG, FRAME_PITCH_DEG, 0.0, fov_deg
    )
