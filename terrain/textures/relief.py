"""What a height field says about its own shape: slope, aspect, curvature, the area that drains through each post, and
where water would stand. Pure numpy, in bands of rows, so that a large grid needs little memory beside the result.

Heights are true heights: exaggeration is taken out. Past the grid's edge the surface goes on straight, so that a plane
has the same slope and no curvature everywhere, up to its last post.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Heightfield

Grid = npt.NDArray[np.float32]

BAND_ROWS = 256
LEVEL_M = 0.02  # posts that differ by no more are level: the steps in which heights are stored are larger
POOL_POSTS = 5  # a level square of this many posts along each side may be water
BANK_TANGENT = 1.5  # steeper banks are walls, and what lies between them a floor
DRY_RIM_SHARE = 0.1  # of a water's rim may lie below it: its outlets


class Shape(NamedTuple):
    """First and second derivatives of some rows of the surface, (rows, cols) each.

    ``east`` and ``south`` are metres per metre; ``east_east``, ``south_south`` and ``east_south`` their changes [1/m].
    """

    east: Grid
    south: Grid
    east_east: Grid
    south_south: Grid
    east_south: Grid


def shapes(heightfield: Heightfield) -> Iterator[tuple[slice, Shape]]:
    """The derivatives of the surface by central differences, band by band, each with the rows it holds."""
    dx, dz = heightfield.spacing_m
    for first in range(0, heightfield.rows, BAND_ROWS):
        rows = slice(first, min(first + BAND_ROWS, heightfield.rows))
        h = _padded(heightfield.heights_m, rows)
        h *= np.float32(1.0 / heightfield.exaggeration)
        west, middle, east = h[:, :-2], h[:, 1:-1], h[:, 2:]
        across, bend = east - west, east + west - 2.0 * middle
        yield (
            rows,
            Shape(
                across[1:-1] * np.float32(0.5 / dx),
                (middle[2:] - middle[:-2]) * np.float32(0.5 / dz),
                bend[1:-1] * np.float32(1.0 / dx**2),
                (middle[2:] + middle[:-2] - 2.0 * middle[1:-1]) * np.float32(1.0 / dz**2),
                (across[2:] - across[:-2]) * np.float32(0.25 / (dx * dz)),
            ),
        )


def slope_deg(shape: Shape) -> Grid:
    """Steepness [deg]."""
    return np.degrees(np.arctan(np.hypot(shape.east, shape.south)))


def aspect_deg(shape: Shape) -> Grid:
    """Where the slope faces: down it, clockwise from north [deg, 0..360)."""
    return np.degrees(np.arctan2(-shape.east, shape.south)) % np.float32(360.0)


def curvature_per_m(shape: Shape) -> Grid:
    """Mean curvature of the surface [1/m]: one over the radius of a sphere, positive where ground bulges out."""
    p, q, r, s, t = shape.east, shape.south, shape.east_east, shape.east_south, shape.south_south
    steep = 1.0 + p * p + q * q
    return -((1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t) / (2.0 * steep * np.sqrt(steep))


def smoothed(heightfield: Heightfield, posts: float) -> Heightfield:
    """The surface without what is narrower than a few times ``posts``: for shapes larger than its roughness."""
    from scipy import ndimage

    heights = heightfield.heights_m
    reach = [min(int(3.0 * posts), size - 1) for size in heights.shape]
    # Mirrored through its edge a plane goes on straight.
    padded = np.pad(heights, [(r, r) for r in reach], mode="reflect", reflect_type="odd")
    padded = ndimage.gaussian_filter(padded, posts, mode="nearest", truncate=3.0)
    inner = tuple(slice(r, r + size) for r, size in zip(reach, heights.shape, strict=True))
    return replace(heightfield, heights_m=np.ascontiguousarray(padded[inner]))


def drained_area_m2(heightfield: Heightfield, most_posts: int) -> npt.NDArray[np.float64]:
    """Area whose water passes through each post, its own included (rows, cols) [m^2]; 0 where there is no data.

    Water takes the steepest of the eight ways down, leaves hollows over their lowest pass, and ends at the edge of the
    grid and at ground without data. A grid of more than ``most_posts`` along a side is first reduced by means.
    """
    from terrain.synthetic.erosion import NEIGHBOURS, drain_pits, steepest_receivers, upstream_sum

    shape = tuple(min(size, most_posts) for size in heightfield.heights_m.shape)
    heights = _reduced(heightfield.heights_m, shape)
    dx, dz = (spacing * full / size for spacing, full, size in zip(
        heightfield.spacing_m, (heightfield.cols, heightfield.rows), shape[::-1], strict=True))  # fmt: skip
    ends = np.ones(shape, np.bool_)
    ends[1:-1, 1:-1] = False
    weights = np.full(shape, dx * dz)
    holes = np.zeros(shape, np.float32) if heightfield.holes is None else _reduced(heightfield.holes, shape)
    ends |= holes >= 0.5
    weights *= 1.0 - holes
    receivers, _ = steepest_receivers(heights, [1.0 / np.hypot(dr * dz, dc * dx) for dr, dc in NEIGHBOURS])
    drain_pits(heights, receivers, ends)
    area = upstream_sum(receivers, weights.ravel()).reshape(shape)
    area[holes >= 0.5] = 0.0
    return area


def standing_water(heightfield: Heightfield) -> npt.NDArray[np.bool_]:
    """Posts where water would stand: level ground that is wide enough, has low banks and nearly nowhere a way down."""
    from scipy import ndimage

    heights = heightfield.heights_m * np.float32(1.0 / heightfield.exaggeration)
    level = np.zeros(heights.shape, np.bool_)
    for first in range(0, heightfield.rows, BAND_ROWS):
        rows = slice(first, min(first + BAND_ROWS, heightfield.rows))
        h = _padded(heights, rows, replicate=True)
        highest = np.maximum(np.maximum(h[:-2], h[1:-1]), h[2:])
        lowest = np.minimum(np.minimum(h[:-2], h[1:-1]), h[2:])
        highest = np.maximum(np.maximum(highest[:, :-2], highest[:, 1:-1]), highest[:, 2:])
        lowest = np.minimum(np.minimum(lowest[:, :-2], lowest[:, 1:-1]), lowest[:, 2:])
        level[rows] = highest - lowest <= LEVEL_M
    if heightfield.holes is not None:
        level &= ~heightfield.holes
    # Wide enough: a square of posts fits in.
    squares = ndimage.minimum_filter(level.view(np.uint8), POOL_POSTS, mode="nearest")
    labels, count = ndimage.label(ndimage.maximum_filter(squares, POOL_POSTS, mode="nearest"), np.ones((3, 3)))
    if not count:
        return np.zeros(heights.shape, np.bool_)
    # Grown by the posts at its brim, which are as high but have others for neighbours.
    brim = np.bincount(labels.ravel(), heights.ravel()) / np.maximum(np.bincount(labels.ravel()), 1)
    beside = ndimage.maximum_filter(labels, 3)
    labels = np.where((labels == 0) & (np.abs(heights - brim[beside]) <= LEVEL_M), beside, labels)
    rim, low, walled = (np.zeros(count + 1) for _ in range(3))
    spacing = heightfield.spacing_m
    for axis in (0, 1):
        near, far = [slice(None)] * 2, [slice(None)] * 2
        near[axis], far[axis] = slice(None, -1), slice(1, None)
        for here, there in ((tuple(near), tuple(far)), (tuple(far), tuple(near))):
            bank = (labels[here] > 0) & (labels[there] != labels[here])
            owner, rise = labels[here][bank], heights[there][bank] - heights[here][bank]
            rim += np.bincount(owner, minlength=count + 1)
            low += np.bincount(owner, rise < -LEVEL_M, count + 1)
            walled += np.bincount(owner, rise > BANK_TANGENT * spacing[1 - axis], count + 1)
    holds = (low <= DRY_RIM_SHARE * rim) & (walled <= 0.5 * rim) & (rim > 0)
    holds[0] = False
    return holds[labels]


def _padded(heights: Grid, rows: slice, replicate: bool = False) -> Grid:
    """Some rows with one more post on every side; past the grid the surface goes on straight, or level."""
    first, last, (count, cols) = rows.start, rows.stop, heights.shape
    out = np.empty((last - first + 2, cols + 2), np.float32)
    low, high = max(first - 1, 0), min(last + 1, count)
    out[low - first + 1 : high - first + 1, 1:-1] = heights[low:high]
    steeper = 0.0 if replicate else 1.0
    if first == 0:
        out[0, 1:-1] = heights[0] + steeper * (heights[0] - heights[1])
    if last == count:
        out[-1, 1:-1] = heights[-1] + steeper * (heights[-1] - heights[-2])
    out[:, 0] = out[:, 1] + steeper * (out[:, 1] - out[:, 2])
    out[:, -1] = out[:, -2] + steeper * (out[:, -2] - out[:, -3])
    return out


def _reduced(values: npt.NDArray[np.generic], shape: tuple[int, ...]) -> Grid:
    """Means over blocks of posts that make a grid of ``shape``; the values themselves where it is their own."""
    reduced = values.astype(np.float32)
    for axis, size in enumerate(shape):
        if size == reduced.shape[axis]:
            continue
        bounds = np.arange(size) * reduced.shape[axis] // size
        counts = np.diff(bounds, append=reduced.shape[axis]).astype(np.float32)
        reduced = np.add.reduceat(reduced, bounds, axis=axis) / np.expand_dims(counts, 1 - axis)
    return reduced
