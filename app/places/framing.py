"""Where to look from: height above the ground, and the view that shows a whole terrain."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from app.flying.controls import Clearance
from terrain.camera import Camera
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

FRAME_YAW_DEG, FRAME_PITCH_DEG = 20.0, -30.0
FRAME_FILLED = 0.9  # share of the picture's width or height that the terrain takes
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
    """The camera that sees the whole terrain from the south-south-west, a little from above, as large as can be."""
    camera = Camera((0.0, 0.0, 0.0), FRAME_YAW_DEG, FRAME_PITCH_DEG, 0.0, fov_deg)
    (west, east), (north, south) = _data_extent_m(heightfield)
    corners = np.array(list(product((west, east), heightfield.height_range_m, (north, south))))
    x, y, z = (corners @ camera.view_from_eye().T).T  # right, up and towards the eye
    half_y = FRAME_FILLED * math.tan(math.radians(fov_deg) / 2)
    away = max(_fitting(x, z, half_y * aspect), _fitting(y, z, half_y)) - z
    eye = np.array([_centred(x, away), _centred(y, away), (away + z)[0]]) @ camera.view_from_eye()
    return replace(camera, position_m=tuple(eye.tolist()))


def _data_extent_m(heightfield: Heightfield) -> list[tuple[float, float]]:
    """From where to where the terrain holds data, west to east and north to south."""
    data = np.True_ if heightfield.holes is None else ~heightfield.holes
    found = [np.flatnonzero(np.broadcast_to(data, heightfield.heights_m.shape).any(axis=axis)) for axis in (0, 1)]
    return [(at[0] * step, at[-1] * step) for at, step in zip(found, heightfield.spacing_m, strict=True)]


def _fitting(side: Floats, z: Floats, half: float) -> float:
    """How far back an eye must stand so that every point lies within ``half`` times its distance to either side."""
    return float(np.max(half * z - side) + np.max(half * z + side)) / (2 * half)


def _centred(side: Floats, away: Floats) -> float:
    """Where to the side the eye must stand so that points reach equally far to the picture's two edges."""
    reach = np.subtract.outer(side, side) / np.add.outer(away, away)
    i, j = np.unravel_index(reach.argmax(), reach.shape)  # the two that reach farthest
    return float((side[i] * away[j] + side[j] * away[i]) / (away[i] + away[j]))
