"""What a picture shows although the truth hides it, and where neither can be judged.

Holes and errors along the surface say nothing about order: a mesh drawn in the wrong order shows points of the true
surface, only not those that should be seen.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from terrain.camera import Camera
from terrain.heightfield import Diagonal, Heightfield

Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float32]


def count_misplaced(distance_m: Floats, truth_m: Floats, reach_px: int, slack: float) -> int:
    """Pixels that show what the truth hides: nearer or farther than everything it shows around them.

    A surface that errs by less than ``reach_px`` shows at each pixel what the truth shows within that reach, or
    something in between; beside the skyline anything farther. In front only blocks of 3 x 3 count:
    what is thinner may be the tip of a needle that the truth's rounded corners missed, or a crest that the truth just
    hides and that an error within the promise lifts into sight.

    Parameters
    ----------
    distance_m, truth_m : ndarray, (height, width)
        Distance to what is drawn and to the truth; infinite where there is sky.
    reach_px : int
        Pixels this near to the picture's edge are left out.
    slack : float
        Relative distance granted: a surface may err along the ray too.
    """
    size, inner = 2 * reach_px + 1, slice(reach_px, -reach_px)
    nearest = ndimage.minimum_filter(truth_m, size)[inner, inner]
    farthest = ndimage.maximum_filter(truth_m, size)[inner, inner]
    shown = distance_m[inner, inner]
    too_near = np.isfinite(shown) & (shown < nearest * (1 - slack))
    too_far = np.isfinite(shown) & (shown > farthest * (1 + slack))
    blocks = ndimage.binary_erosion(too_near, np.ones((3, 3)))
    return int((too_far | blocks).sum())


def passes_below(
    camera: Camera, size_px: tuple[int, int], terrain: Heightfield, diagonal: Diagonal, margin_px: float = 0.0
) -> Bools:
    """Pixels (height, width) whose sight ray starts below the ground, or enters the terrain's area below it.

    What they show is the inside of an open sheet: holes and errors mean nothing there.
    """
    rays = camera.ray_directions(*size_px)
    eye, (width, depth) = camera.eye_m, terrain.extent_m
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = [
            ((np.array([0.0, side]) - eye[axis]) / rays[..., axis, None]) for axis, side in ((0, width), (2, depth))
        ]
    # A ray parallel to a side, on it: nan, and neither enters nor leaves there.
    enter = np.fmax.reduce([np.nanmin(e, axis=-1, initial=np.inf) for e in ends] + [np.zeros(rays.shape[:2])])
    leave = np.fmin.reduce([np.nanmax(e, axis=-1, initial=-np.inf) for e in ends])
    x, y, z = np.moveaxis(eye + rays * np.where(np.isfinite(enter), enter, 0.0)[..., None], -1, 0)
    ground = terrain.heights_at(np.clip(x, 0.0, width), np.clip(z, 0.0, depth), diagonal)
    margin_m = margin_px * np.linalg.norm(rays, axis=-1) * enter / camera.pixels_per_radian(size_px[1])
    return np.asarray((enter <= leave) & (y < ground + margin_m))


def shown_distances(positions: Floats, judged: Bools) -> Floats:
    """Distances (height, width) to what is drawn; infinite for sky and where nothing is judged."""
    return np.where((positions[..., 3] > 0.5) & judged, np.linalg.norm(positions[..., :3], axis=-1), np.inf)


def has_edges(distance_m: Floats, reach_px: int) -> Bools:
    """Pixels with sky or another piece of surface within reach."""
    size = 2 * reach_px + 1
    nearest, farthest = ndimage.minimum_filter(distance_m, size), ndimage.maximum_filter(distance_m, size)
    return np.asarray(np.isinf(farthest) | (farthest > 1.5 * nearest))
