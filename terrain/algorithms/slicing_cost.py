"""What slices and polygons cost, and how many slices a box needs: formulas of adaptive slicing over arrays of boxes.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001, sections 3 and 4.

Deviations: those of `terrain.algorithms.slicing`. `paper_bundles` holds the paper's formulas, `refined_bundles` the
default ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing_tree import STRIDES

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]

POLYGONS, X_SLICES, Y_SLICES, Z_SLICES = 0, 1, 2, 3

# Ground that rises between two planes, seen by neither, may be this much of the tolerance high. At 1 single pixels
# leaked: chords run in four directions, rays in all.
PEAK_PX = 0.8
# A box that needs more slices is split; a leaf of 8 cells is cut every 1/64 of a cell at most.
MOST_SLICES = 512
LEAF_CELLS = 64
# Planes never come closer than this share of the tolerance: what is thinner shows in one pixel or not at all. (With the
# paper's whole pixel, single pixels leaked between the treetops of a city.)
DENSEST = 0.2
# Where peaks ask for planes this many times denser still, slices would miss too many: such boxes are polygons.
NEEDLES = 6.0
# Polygon boxes are drawn in tiles of 8, 16 and 32 cells.
TILE_LEVELS = (3, 4, 5)
# Where all its posts lie this near [tolerances] to the surface of every 2nd, 4th ... post, a tile is drawn with those;
# next to its border, where those of a finer neighbour are kept, the error may be twice as large.
FAN_ERROR_PX = 0.9
# A triangle that no pixel shows costs this share of one that some pixel does.
UNSEEN = 0.3
# Seen along the ground most triangles are hidden by others: so many are shown, and so many more per sine of the angle.
SHOWN_LEVEL, SHOWN_PER_SINE = 0.2, 4.0
# So many planes of a bundle are looked at by one slice.
PLANES_PER_SLICE = 8
# Faces of its own that close a bundle, on average.
FACES = 2
# By drawn frames: pixels of a slice cost this many times what those of one that fills the picture do, since rasterisers
# work on blocks; those of triangles, so many times; a triangle, this many times what it does on level ground; pixels
# that show slices, so many times; pixels beside them in which slices are looked for, so many times.
BLOCKS, TRIANGLE_BLOCKS, TRIANGLE, FOUND, IN_VAIN = 2.0, 2.5, 1.2, 1.1, 0.5


def tile_strides(level: int) -> range:
    """Strides of fans in a tile of ``level``, as powers of two: at least 2 x 2 cells remain."""
    return range(1 + min(level - 1, STRIDES))


@dataclass(frozen=True)
class Speeds:
    """How long a machine takes; measured by the renderer's calibration.

    Attributes
    ----------
    vertex_ms, pixel_ms : float
        The paper's 1 / vtx_speed and 1 / rst_speed (section 4).
    slice_ms, slice_pixel_ms : float
        One slice of a few pixels, and one more of its pixels that passes the depth test.
    plane_pixel_ms : float
        One plane looked at for one of these pixels.
    found_pixel_ms : float
        One pixel whose surface is looked for between two planes, and shaded.
    triangle_ms, polygon_pixel_ms : float
        One triangle of a polygon box that is shown, and one of its pixels.
    search_ms : float
        Preparing to find slices, whether there are any or not.
    """

    vertex_ms: float
    pixel_ms: float
    slice_ms: float
    slice_pixel_ms: float
    plane_pixel_ms: float
    found_pixel_ms: float
    triangle_ms: float
    polygon_pixel_ms: float
    search_ms: float


class View(NamedTuple):
    """What the formulas need of a view: tolerance [px], K [px per (size / distance)], its pixels, post spacing [m].

    ``coarse``: whether polygons may leave out posts.
    """

    tolerance_px: float
    pixels_per_radian: float
    pixels: int
    spacing_m: tuple[float, float]
    coarse: bool = False


class Boxes(NamedTuple):
    """Boxes relative to the eye: corners (n, 3) [m], the share in the frustum and cells (n,), heights (n, k) [m]."""

    lower_m: Floats
    upper_m: Floats
    inside: Floats
    cells: Floats
    peak_m: Floats  # column k: over chords of 2^(k + 1) cells
    error_m: Floats  # column k: of the surface of every 2^(k + 1)-th post; asked for by `View.coarse` only


class Bundles(NamedTuple):
    """How boxes would be sliced, and what that or their polygons would cost: arrays (n,)."""

    direction: Ints
    planes: Ints
    slices_ms: Floats
    polygons_ms: Floats
    stride: Ints  # of polygons: every 2^stride-th post


def projected_px(length_m: Floats, distance_m: Floats, cosine: Floats | float, pixels_per_radian: float) -> Floats:
    """x'(x, l, theta) of section 3: pixels of a segment at a distance, seen under an angle with this cosine."""
    return np.asarray(length_m * cosine * np.float32(pixels_per_radian) / distance_m)


def paper_bundles(boxes: Boxes, view: View, speeds: Speeds) -> Bundles:
    """Sections 3 and 4 as printed: distance and angle of sight are the least over the eight corners."""
    size = boxes.upper_m - boxes.lower_m
    is_upper = (np.arange(8)[:, None] >> np.arange(3) & 1).astype(np.bool_)
    corner = np.where(is_upper, boxes.upper_m[:, None], boxes.lower_m[:, None])  # (n, 8, 3)
    distance = np.maximum(np.sqrt(np.einsum("nci,nci->nc", corner, corner)), np.float32(1e-3))
    sine = np.abs(corner[..., 1]) / distance
    near, least_sine, most_sine = distance.min(axis=1), sine.min(axis=1), sine.max(axis=1)
    most_cosine = np.sqrt(np.maximum(1 - least_sine * least_sine, 0))
    scale, per_px = view.pixels_per_radian, np.float32(1.0 / view.tolerance_px)

    facing = _facing(boxes, view)
    is_x = facing == X_SLICES
    along, width = np.where(is_x, size[:, 0], size[:, 2]), np.where(is_x, size[:, 2], size[:, 0])
    count_y = np.ceil(projected_px(size[:, 1], near, most_cosine, scale) * per_px).clip(1)
    count_xz = np.ceil(projected_px(along, near, 1.0, scale) * per_px).clip(1)

    vertex_ms = np.float32(speeds.vertex_ms)

    def raster_ms(area_m2: Floats, cosine: Floats) -> Floats:
        return np.asarray(area_m2 * cosine * np.float32(speeds.pixel_ms) * (np.float32(scale) / near) ** 2)

    ground_ms = raster_ms(size[:, 0] * size[:, 2], most_sine)
    cost_y = count_y * (4 * vertex_ms + ground_ms)
    cost_xz = count_xz * (4 * vertex_ms + raster_ms(width * size[:, 1], most_cosine))
    centre = boxes.lower_m + boxes.upper_m
    from_above = np.abs(centre[:, 1]) > np.hypot(centre[:, 0], centre[:, 2])  # above 45 degrees
    from_above &= boxes.upper_m[:, 1] < 0
    fans = boxes.cells / np.float32(4)  # (s / 2)^2 fans of 10 vertices each
    return Bundles(
        np.where(from_above, np.int32(Y_SLICES), facing),
        np.where(from_above, count_y, count_xz).clip(1, MOST_SLICES).astype(np.int32),
        np.where(from_above, cost_y, cost_xz).astype(np.float32),
        np.asarray(10 * fans * vertex_ms + ground_ms, np.float32),
        np.zeros(len(boxes.cells), np.int32),
    )


def refined_bundles(boxes: Boxes, view: View, speeds: Speeds) -> Bundles:
    """Planes as far apart as secant steps allow; costs by the pixels that are really touched."""
    lower, upper = boxes.lower_m, boxes.upper_m
    size, centre = upper - lower, (lower + upper) * np.float32(0.5)
    (dx, dz), scale = (np.float32(s) for s in view.spacing_m), np.float32(view.pixels_per_radian)
    across = np.maximum(np.hypot(centre[:, 0], centre[:, 2]), np.float32(1e-3))
    below = np.abs(centre[:, 1])
    distance = np.hypot(across, below)
    gap = np.maximum(np.maximum(lower, -upper), 0)
    near = np.sqrt(gap[:, 0] ** 2 + gap[:, 1] ** 2 + gap[:, 2] ** 2).clip(np.float32(1e-3))
    pixel = near * np.float32(view.tolerance_px) / scale  # the paper's spacing [m]
    chord = chord_cells(boxes.peak_m, pixel * np.float32(PEAK_PX))
    is_needles = chord * max(dx, dz) * np.float32(NEEDLES) < np.float32(DENSEST) * pixel
    # Perspective makes the near part of a box count more than its centre, the more the box surrounds the eye.
    per_m = scale / np.sqrt(distance * near)
    most_px = np.float32(view.pixels)
    slice_pixel_ms = np.float32(BLOCKS * speeds.slice_pixel_ms) * boxes.inside
    plane_pixel_ms = np.float32(speeds.plane_pixel_ms) * boxes.inside

    def slices_ms(count: Floats, width_m: Floats, height_m: Floats) -> Floats:
        many = (count > np.float32(MOST_SLICES)) & (boxes.cells > np.float32(LEAF_CELLS + 0.5))
        slice_px = np.minimum(width_m * height_m * per_m * per_m, most_px)
        slices = np.ceil(count * np.float32(1 / PLANES_PER_SLICE))
        cost = (slices + np.float32(FACES)) * np.float32(speeds.slice_ms)
        cost += slices * slice_px * slice_pixel_ms + count * slice_px * plane_pixel_ms
        return np.where(many | is_needles, np.float32(np.inf), cost)

    facing = _facing(boxes, view)
    is_x = facing == X_SLICES
    along, width = np.where(is_x, size[:, 0], size[:, 2]), np.where(is_x, size[:, 2], size[:, 0])
    square = np.abs(np.where(is_x, centre[:, 0], centre[:, 2])) / across  # 1 where the slices are seen face on
    spacing = np.maximum(chord * np.where(is_x, dx, dz), np.float32(DENSEST) * pixel)
    count_xz = np.ceil(along / spacing - np.float32(1e-3)).clip(1)
    tall = size[:, 1] * across / distance
    cost_xz = slices_ms(count_xz, width * square, tall)
    cost_xz[(gap[:, 0] <= 0) & (gap[:, 2] <= 0)] = np.inf  # the eye stands over or in the box: none faces it

    drop = -upper[:, 1]
    reach = np.hypot(np.maximum(-lower[:, 0], upper[:, 0]), np.maximum(-lower[:, 2], upper[:, 2]))
    tangent = np.maximum(drop, np.float32(1e-3)) / reach  # the flattest ray that meets the box's top
    spacing = np.maximum(chord * min(dx, dz), np.float32(DENSEST) * pixel) * tangent
    count_y = np.ceil(size[:, 1] / spacing - np.float32(1e-3)).clip(1)
    side = np.sqrt(size[:, 0] * size[:, 2])
    deep = side * below / distance
    cost_y = slices_ms(count_y, side, deep)
    cost_y[drop <= 0] = np.inf

    horizontal = cost_y < cost_xz
    # What a box shows: its ground, and half of the side it turns to the eye.
    shown = np.minimum(side * (deep + np.float32(0.5) * tall) * per_m * per_m, most_px) * boxes.inside
    stride, triangles = np.zeros(len(pixel), np.int32), 2 * boxes.cells
    if view.coarse:
        allowed_m = pixel[:, None] * np.float32(FAN_ERROR_PX)
        stride = (boxes.error_m <= allowed_m).sum(axis=1, dtype=np.int32)
        triangles = np.ldexp(boxes.cells, 1 - 2 * stride)
    visible = np.minimum(np.float32(SHOWN_LEVEL) + np.float32(SHOWN_PER_SINE) * below / distance, 1)
    dear = np.float32(UNSEEN) * triangles + visible * np.minimum(triangles * boxes.inside, shown)
    return Bundles(
        np.where(horizontal, np.int32(Y_SLICES), facing),
        np.where(horizontal, count_y, count_xz).clip(1, MOST_SLICES).astype(np.int32),
        np.minimum(cost_y, cost_xz)
        + np.float32(FOUND * speeds.found_pixel_ms + BLOCKS * speeds.slice_pixel_ms + speeds.plane_pixel_ms) * shown,
        dear * np.float32(TRIANGLE * speeds.triangle_ms)
        + np.float32(TRIANGLE_BLOCKS * speeds.polygon_pixel_ms) * shown,
        stride,
    )


def search_cost_ms(patches: Floats, viewport_px: tuple[int, int], speeds: Speeds) -> float:
    """What it takes to look for slices in rectangles (k, 4) of the picture, whether there are any or not."""
    share = float(((patches[:, 2] - patches[:, 0]) * (patches[:, 3] - patches[:, 1])).sum())
    return speeds.search_ms + IN_VAIN * share * viewport_px[0] * viewport_px[1] * speeds.found_pixel_ms


def chord_cells(peak_m: Floats, allowed_m: Floats) -> Floats:
    """The longest chord [cells] over which ground rises by at most ``allowed_m``.

    Linear between the chords that are known: nothing rises over a chord of no length, ``peak_m[:, k]`` over one of
    2^(k + 1) cells.

    Parameters
    ----------
    peak_m : ndarray (n, k), not falling along k
    allowed_m : ndarray (n,)
    """
    below, length = np.zeros(len(peak_m), np.float32), np.float32(0)
    chord = np.zeros(len(peak_m), np.float32)
    for k in range(peak_m.shape[1]):  # each reached in full adds its share of the next
        peak, further = peak_m[:, k], np.float32(2 ** (k + 1))
        share = (allowed_m - below) / np.maximum(peak - below, np.float32(1e-30))
        chord += np.clip(share, 0.0, 1.0) * (further - length)
        below, length = peak, further
    return chord


def _facing(boxes: Boxes, view: View) -> Ints:
    """X_SLICES or Z_SLICES, whichever faces the viewer: the eye is never between such a box's first and last plane."""
    x, z = (np.maximum(boxes.lower_m[:, i], -boxes.upper_m[:, i]) / np.float32(view.spacing_m[i // 2]) for i in (0, 2))
    return np.where(x > z, np.int32(X_SLICES), np.int32(Z_SLICES))
