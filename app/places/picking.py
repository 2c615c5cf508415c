"""What a sight line meets, and what the ground is like there and along a line. Pure functions in float64.

The surface is flat between its edges, and all edges lie on four families of lines of the grid: columns, rows and both
diagonals. Between two of their crossings a ray nears the ground evenly and a profile is straight: nothing is marched,
missed or rounded, at any distance.

**Source** slope and aspect: Horn, *Hill shading and the reflectance map*, Proceedings of the IEEE 69 (1981), as in GIS;
here interpolated between the posts. Past its edges the terrain goes on as it ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Diagonal, Heightfield

Floats = npt.NDArray[np.float64]
FLAT_DEG = 1e-3  # a gentler slope faces nowhere


def first_hit(
    heightfield: Heightfield, eye_m: Floats, direction: Floats, diagonal: Diagonal = "alternating"
) -> Floats | None:
    """The first point (3,) of the ground that a ray enters from above; None where there is none.

    From below the ground is not seen, as it is not drawn.

    Parameters
    ----------
    heightfield : Heightfield
        Holes in it are looked through.
    eye_m, direction : ndarray of float64, (3,)
        World metres; the direction's length does not matter.
    diagonal : {"alternating", "uniform"}
        Of the surface that is drawn.
    """
    begin, end = _span_over(heightfield, eye_m, direction)
    if begin >= end:
        return None
    start_m, step_m = eye_m + begin * direction, (end - begin) * direction
    share = _crossings(heightfield, start_m[[0, 2]], (start_m + step_m)[[0, 2]])
    x, y, z = (start_m + share[:, None] * step_m).T
    above = y - _heights(heightfield, x, z, diagonal)
    (meets,) = np.nonzero((above[:-1] >= 0.0) & (above[1:] < 0.0))
    if not meets.size:
        return None
    # Between two crossings the height above ground is linear: its zero is exact.
    part = above[meets] / (above[meets] - above[meets + 1])
    where = share[meets] + part * (share[meets + 1] - share[meets])
    points = start_m + where[:, None] * step_m
    solid = is_solid(heightfield, points[:, 0], points[:, 2])
    if not solid.any():
        return None
    point: Floats = points[np.argmax(solid)]
    point[1] = _heights(heightfield, point[0], point[2], diagonal)
    return point


def _span_over(heightfield: Heightfield, eye_m: Floats, direction: Floats) -> tuple[float, float]:
    """Where on a ray, in multiples of its direction, the box around the terrain begins and ends."""
    (width, depth), (low, high) = heightfield.extent_m, heightfield.height_range_m
    pad = 1e-6 * max(high - low, 1e-3 * width, 1e-3)
    begin, end = 0.0, math.inf
    lowest, highest = (0.0, low - pad, 0.0), (width, high + pad, depth)
    for eye, step, lower, upper in zip(eye_m, direction, lowest, highest, strict=True):
        if step == 0.0:
            if not lower <= eye <= upper:
                return 0.0, 0.0
            continue
        near, far = sorted(((lower - eye) / step, (upper - eye) / step))
        begin, end = max(begin, near), min(end, far)
    return begin, end


def _crossings(heightfield: Heightfield, from_m: Floats, to_m: Floats) -> Floats:
    """Shares (n,) of the way between two places (x, z) at which it crosses an edge of the surface; from 0 to 1."""
    (c0, r0), (c1, r1) = (place / np.array(heightfield.spacing_m) for place in (from_m, to_m))
    shares = [np.array([0.0, 1.0])]
    for a, b in ((c0, c1), (r0, r1), (c0 - r0, c1 - r1), (c0 + r0, c1 + r1)):
        if a != b:
            lines = np.arange(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)
            shares.append((lines - a) / (b - a))
    return np.unique(np.clip(np.concatenate(shares), 0.0, 1.0))


def _heights(heightfield: Heightfield, x_m: npt.ArrayLike, z_m: npt.ArrayLike, diagonal: Diagonal) -> Floats:
    """Heights at places that rounding may have put a little beside the terrain."""
    width, depth = heightfield.extent_m
    return heightfield.heights_at(np.clip(x_m, 0.0, width), np.clip(z_m, 0.0, depth), diagonal)


def is_solid(heightfield: Heightfield, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Whether there is ground at places: on the terrain and, as it is drawn, nearer to posts with data than without."""
    x, z = np.asarray(x_m, np.float64), np.asarray(z_m, np.float64)
    width, depth = heightfield.extent_m
    inside = (x >= 0.0) & (x <= width) & (z >= 0.0) & (z <= depth)
    holes = heightfield.holes
    if holes is None:
        return inside
    col, row = np.clip(x, 0.0, width) / heightfield.spacing_m[0], np.clip(z, 0.0, depth) / heightfield.spacing_m[1]
    c = np.minimum(col.astype(np.int64), heightfield.cols - 2)
    r = np.minimum(row.astype(np.int64), heightfield.rows - 2)
    u, v = col - c, row - r
    north = holes[r, c] * (1.0 - u) + holes[r, c + 1] * u
    south = holes[r + 1, c] * (1.0 - u) + holes[r + 1, c + 1] * u
    return inside & (north * (1.0 - v) + south * v <= 0.5)


@dataclass(frozen=True)
class Relief:
    """How the ground lies at a place.

    Attributes
    ----------
    height_m : float
        True height, without exaggeration.
    slope_deg : float
    aspect_deg : float or None
        Where it faces, clockwise from the grid's north; None where it is flat.
    """

    height_m: float
    slope_deg: float
    aspect_deg: float | None


def relief_at(heightfield: Heightfield, x_m: float, z_m: float, diagonal: Diagonal = "alternating") -> Relief:
    """Height, slope and aspect of the ground at a place of the terrain."""
    height = float(_heights(heightfield, x_m, z_m, diagonal)) / heightfield.exaggeration
    (dx, dz), rows, cols = heightfield.spacing_m, heightfield.rows, heightfield.cols
    col, row = min(max(x_m / dx, 0.0), cols - 1.0), min(max(z_m / dz, 0.0), rows - 1.0)
    c, r = min(int(col), cols - 2), min(int(row), rows - 2)
    h = _around(heightfield.heights_m, r, c) / heightfield.exaggeration
    # Horn's differences at the four posts around the place, then between them.
    weighted_rows, weighted_cols = h[:-2] + 2.0 * h[1:-1] + h[2:], h[:, :-2] + 2.0 * h[:, 1:-1] + h[:, 2:]
    east = (weighted_rows[:, 2:] - weighted_rows[:, :-2]) / (8.0 * dx)
    south = (weighted_cols[2:] - weighted_cols[:-2]) / (8.0 * dz)
    u, v = np.array([1.0 - (col - c), col - c]), np.array([1.0 - (row - r), row - r])
    up_east, up_south = float(v @ east @ u), float(v @ south @ u)
    slope = math.degrees(math.atan(math.hypot(up_east, up_south)))
    aspect = math.degrees(math.atan2(-up_east, up_south)) % 360.0 if slope > FLAT_DEG else None
    return Relief(height, slope, aspect)


def _around(heights_m: npt.NDArray[np.float32], row: int, col: int) -> Floats:
    """Posts (4, 4) from one before (row, col) to two after it; past an edge the grid goes on straight."""
    rows, cols = heights_m.shape
    block = heights_m[max(row - 1, 0) : row + 3, max(col - 1, 0) : col + 3].astype(np.float64)
    missing = ((int(row == 0), int(row + 2 == rows)), (int(col == 0), int(col + 2 == cols)))
    return np.pad(block, missing, mode="reflect", reflect_type="odd")


@dataclass(frozen=True, eq=False)
class Profile:
    """The ground along a straight line on the map.

    Attributes
    ----------
    distance_m : ndarray of float64, (n,)
        From the first end, level, increasing.
    height_m : ndarray of float64, (n,)
        True heights; NaN where there is no ground.
    x_m, z_m : ndarray of float64, (n,)
        World places.
    """

    distance_m: Floats
    height_m: Floats
    x_m: Floats
    z_m: Floats

    @property
    def length_m(self) -> float:
        """Level distance between the ends."""
        return float(self.distance_m[-1])

    @property
    def surface_m(self) -> float:
        """Length along the ground, where there is some."""
        lengths = np.hypot(np.diff(self.distance_m), np.diff(self.height_m))
        return float(np.nansum(lengths))

    def place_at(self, distance_m: float) -> tuple[float, float]:
        """World x and z at a distance."""
        x, z = (float(np.interp(distance_m, self.distance_m, values)) for values in (self.x_m, self.z_m))
        return x, z

    @property
    def climb_m(self) -> tuple[float, float]:
        """Metres up and metres down from the first end to the second, both positive."""
        steps = np.diff(self.height_m)
        return float(np.nansum(np.maximum(steps, 0.0))), float(np.nansum(np.maximum(-steps, 0.0)))


def profile_between(
    heightfield: Heightfield, from_m: Floats, to_m: Floats, diagonal: Diagonal = "alternating"
) -> Profile:
    """The exact profile between two places (x, z): a point at every edge of the surface, and one in every gap."""
    share = _crossings(heightfield, from_m, to_m)
    middle = 0.5 * (share[:-1] + share[1:])
    place = from_m + middle[:, None] * (to_m - from_m)
    in_gap = middle[~is_solid(heightfield, *place.T)]
    share = np.union1d(share, in_gap)
    x, z = from_m[:, None] + (to_m - from_m)[:, None] * share
    height = _heights(heightfield, x, z, diagonal) / heightfield.exaggeration
    height[~is_solid(heightfield, x, z) | np.isin(share, in_gap)] = np.nan
    return Profile(share * math.dist(from_m, to_m), height, x, z)
