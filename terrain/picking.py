"""Which point of the ground lies under a point of the picture: a sight ray marched over the height field."""

from __future__ import annotations

import numpy as np

from terrain.camera import Camera
from terrain.heightfield import Heightfield

STEP_POSTS, STEP_SHARE = 0.5, 0.004  # steps of the ray: half a post, or this share of the distance where that is more
REFINEMENTS = 24  # halvings of the step that meets the ground


def pick_ground(
    heightfield: Heightfield, camera: Camera, aspect: float, screen: tuple[float, float]
) -> tuple[float, float, float] | None:
    """World position of the ground under a point of the picture, or None where there is none.

    Parameters
    ----------
    heightfield : Heightfield
    camera : Camera
    aspect : float
        Width over height of the picture.
    screen : tuple of float
        The point, 0..1 each, from the upper left corner.
    """
    tangent = np.tan(np.radians(camera.fov_deg) / 2.0)
    view = np.array([(2.0 * screen[0] - 1.0) * tangent * aspect, (1.0 - 2.0 * screen[1]) * tangent, -1.0])
    ray = view @ camera.view_from_eye()
    ray /= np.linalg.norm(ray)
    eye, (width, depth) = camera.eye_m, heightfield.extent_m
    low, high = heightfield.height_range_m
    spare = 1e-3 * (high - low + min(heightfield.spacing_m))  # so that the ray begins above and ends below the ground
    low, high = low - spare, high + spare
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.array([[0.0, low, 0.0], [width, high, depth]]) - eye) / ray
    inside = (eye >= [0.0, low, 0.0]) & (eye <= [width, high, depth])
    ends[:, ray == 0.0] = np.where(inside[ray == 0.0], [[-np.inf], [np.inf]], [[np.inf], [-np.inf]])
    first, last = max(ends.min(axis=0).max(), 0.0), ends.max(axis=0).min()
    if not first <= last:
        return None
    distances = _distances(first, last, STEP_POSTS * min(heightfield.spacing_m))

    def clearance(t: np.ndarray) -> np.ndarray:
        at = eye + ray * t[:, None]
        x, z = np.clip(at[:, 0], 0.0, width), np.clip(at[:, 2], 0.0, depth)  # rounding may leave the grid
        return np.asarray(at[:, 1] - heightfield.heights_at(x, z))

    above = clearance(distances)
    crossings = np.flatnonzero((above[:-1] > 0.0) & (above[1:] <= 0.0))
    if not crossings.size:
        return None
    near, far = (float(distances[crossings[0] + i]) for i in (0, 1))
    for _ in range(REFINEMENTS):
        middle = 0.5 * (near + far)
        near, far = (middle, far) if clearance(np.array([middle]))[0] > 0.0 else (near, middle)
    x, y, z = eye + ray * far
    post = round(z / heightfield.spacing_m[1]), round(x / heightfield.spacing_m[0])
    if heightfield.holes is not None and heightfield.holes[post]:
        return None
    return float(x), float(y), float(z)


def _distances(first: float, last: float, step_m: float) -> np.ndarray:
    """From ``first`` to ``last``: equal steps, and farther away steps in proportion to the distance."""
    begin = max(first, min(step_m / STEP_SHARE, last))
    near = np.arange(first, begin, step_m)
    growth = np.log1p(STEP_SHARE)
    count = int(np.ceil(np.log(max(last / max(begin, 1e-9), 1.0)) / growth)) + 1 if begin < last else 1
    far = begin * np.exp(growth * np.arange(count))
    return np.unique(np.minimum(np.concatenate([near, far, [last]]), last))
