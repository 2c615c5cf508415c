"""What a length on the screen means: how far the ground is below a point of the picture, and round lengths in words."""

from __future__ import annotations

import math

import numpy as np

from app.places.framing import least_clearance_m
from terrain.camera import Camera
from terrain.heightfield import Heightfield

RAY_STEPS = 512


def ground_depth_m(
    heightfield: Heightfield, camera: Camera, size_px: tuple[float, float], pixel: tuple[float, float]
) -> float | None:
    """View depth of the ground seen at a pixel (x to the right, y down) of a picture; None for the sky.

    The sight ray is followed in steps that grow with the distance, as what is seen grows smaller: what lies between two
    steps and is narrower than 3 % of its distance may be missed.
    """
    width, height = size_px
    tangent = math.tan(math.radians(camera.fov_deg) / 2.0)
    across = (2.0 * pixel[0] / width - 1.0) * tangent * width / height
    up = (1.0 - 2.0 * pixel[1] / height) * tangent
    ray = np.array([across, up, -1.0]) @ camera.view_from_eye()
    low, high = heightfield.height_range_m
    far_m = 2.0 * math.hypot(*heightfield.extent_m, high - low) + float(np.linalg.norm(camera.eye_m))
    depths = np.geomspace(max(least_clearance_m(heightfield), 1e-6 * far_m), far_m, RAY_STEPS)
    x, y, z = (start + depths * step for start, step in zip(camera.position_m, ray, strict=True))
    with np.errstate(invalid="ignore"):
        is_below = y <= heightfield.heights_at(x, z)
    first = int(np.argmax(is_below))
    return float(depths[first]) if is_below[first] else None


def round_length_m(longest_m: float) -> float:
    """The longest length of 1, 2 or 5 times a power of ten that is not above ``longest_m``."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest_m * (1.0 + 1e-9))


def length_text(length_m: float) -> str:
    """``"2 km"``, ``"3.2 km"``, ``"50 m"``, ``"5 cm"``."""
    if length_m >= 1e3:
        return f"{length_m / 1e3:.3g} km" if length_m < 1e6 else f"{length_m / 1e3:,.0f} km"
    if length_m >= 1.0:
        return f"{length_m:.3g} m"
    return f"{100.0 * length_m:.2g} cm"


def heading_text(yaw_deg: float) -> str:
    """``"7° N"``, ``"90° E"``: a heading and the nearest of eight points of the compass."""
    points = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
    degrees = round(yaw_deg) % 360
    return f"{degrees}° {points[round(degrees / 45.0) % 8]}"
