"""The terrain itself: a regular grid of posts, and the piecewise linear surface between them.

World axes: x east, y up, z south, metres, origin at the north-west post. Grids are indexed ``(row, col)``, row 0 north,
so post ``(row, col)`` lies at ``(col * dx, heights_m[row, col], row * dz)``.

The diagonal of each cell is part of the surface's definition:

* ``alternating`` (RTIN, triangle fans): cell (row, col) is cut NW-SE where row + col is even and SW-NE where it is odd,
  so that each 2 x 2 block of cells with an even origin is a fan around its centre post;
* ``uniform`` (Alonso and Joan-Arinyo, figure 1a): every cell is cut SW-NE.

``shaders/lib/surface.glsl`` holds the same two rules; ``tests/terrain/test_surface_twins.py`` compares the two.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

Diagonal = Literal["alternating", "uniform"]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Georeference:
    """Where the grid lies on the Earth.

    Attributes
    ----------
    crs : str
        ``"EPSG:32611"`` or WKT.
    map_from_post : tuple of 6 float
        ``(a, b, c, d, e, f)``: ``map_x = a col + b row + c``, ``map_y = d col + e row + f``, at the posts.
    geographic : bool
        Whether map coordinates are degrees (longitude, latitude) instead of lengths.
    """

    crs: str
    map_from_post: tuple[float, float, float, float, float, float]
    geographic: bool = False

    def to_map(self, col: npt.ArrayLike, row: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Map coordinates of (fractional) posts."""
        a, b, c, d, e, f = self.map_from_post
        col, row = np.asarray(col, np.float64), np.asarray(row, np.float64)
        return a * col + b * row + c, d * col + e * row + f

    def to_post(self, map_x: npt.ArrayLike, map_y: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Fractional ``(col, row)`` of map coordinates: the inverse of `to_map`."""
        a, b, c, d, e, f = self.map_from_post
        x, y = np.asarray(map_x, np.float64) - c, np.asarray(map_y, np.float64) - f
        determinant = a * e - b * d
        return (e * x - b * y) / determinant, (a * y - d * x) / determinant


@dataclass(frozen=True, eq=False)
class Heightfield:
    """A grid of posts.

    Attributes
    ----------
    heights_m : ndarray of float32, (rows, cols), C-contiguous
        Finite everywhere: posts without data hold interpolated heights, so that the geometry has no gaps.
    spacing_m : tuple of float
        ``(dx, dz)``: metres between columns and between rows.
    holes : ndarray of bool, (rows, cols), or None
        True where the source had no data: nothing is drawn there. None when there are no such posts.
    name : str
        What to call the terrain.
    georeference : Georeference or None
    notes : tuple of str
        What was decided while reading the source, one sentence each, for ``reliefscope info``.
    exaggeration : float
        Factor already multiplied into ``heights_m``; true heights are ``heights_m / exaggeration``.

    Raises
    ------
    ValueError
        If a contract above is broken.
    """

    heights_m: npt.NDArray[np.float32]
    spacing_m: tuple[float, float]
    holes: npt.NDArray[np.bool_] | None = None
    name: str = "terrain"
    georeference: Georeference | None = None
    notes: tuple[str, ...] = field(default=())
    exaggeration: float = 1.0

    def __post_init__(self) -> None:
        heights, (dx, dz) = self.heights_m, self.spacing_m
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ValueError(f"expected a grid of at least 2 x 2 posts, found shape {heights.shape}")
        if heights.dtype != np.float32 or not heights.flags.c_contiguous:
            raise ValueError(f"expected C-contiguous float32 heights, found {heights.dtype}")
        if not (0 < dx < np.inf and 0 < dz < np.inf):
            raise ValueError(f"expected a positive post spacing in metres, found {self.spacing_m}")
        if not np.isfinite(heights.sum(dtype=np.float64)):
            raise ValueError("expected finite heights; fill holes first (fill_holes) and mark them in `holes`")
        if self.holes is not None and (self.holes.shape != heights.shape or self.holes.dtype != np.bool_):
            raise ValueError(f"expected a bool hole mask of shape {heights.shape}, found {self.holes.shape}")

    @property
    def rows(self) -> int:
        return int(self.heights_m.shape[0])

    @property
    def cols(self) -> int:
        return int(self.heights_m.shape[1])

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width (east-west) and depth (north-south) in metres."""
        return (self.cols - 1) * self.spacing_m[0], (self.rows - 1) * self.spacing_m[1]

    @cached_property
    def height_range_m(self) -> tuple[float, float]:
        """Lowest and highest post that holds data (exaggeration included)."""
        heights = self.heights_m if self.holes is None else self.heights_m[~self.holes]
        return (float(heights.min()), float(heights.max())) if heights.size else (0.0, 0.0)

    @cached_property
    def sha256(self) -> str:
        """Identity of the content (heights, spacing, holes): the key of every cache made from it."""
        digest = hashlib.sha256(np.array([*self.heights_m.shape, *self.spacing_m], np.float64).tobytes())
        digest.update(self.heights_m.data.cast("B"))
        if self.holes is not None:
            digest.update(np.packbits(self.holes).tobytes())
        return digest.hexdigest()

    def exaggerated(self, factor: float) -> Heightfield:
        """The same terrain with true heights times ``factor`` (not cumulative)."""
        if factor == self.exaggeration:
            return self
        heights = self.heights_m * np.float32(factor / self.exaggeration)
        return replace(self, heights_m=heights, exaggeration=factor)

    def heights_at(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike, diagonal: Diagonal = "alternating") -> Floats:
        """Height of the surface at world positions, in float64; NaN outside the grid.

        Parameters
        ----------
        x_m, z_m : array_like
            World coordinates, any matching shapes.
        diagonal : {"alternating", "uniform"}

        Returns
        -------
        ndarray of float64
        """
        x, z = np.broadcast_arrays(np.asarray(x_m, np.float64), np.asarray(z_m, np.float64))
        return surface_heights(self.heights_m, x / self.spacing_m[0], z / self.spacing_m[1], diagonal)

    def ground_at(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> Floats:
        """Height to stand on, in float64; NaN outside the grid: no surface that a renderer draws is above it."""
        return np.maximum(self.heights_at(x_m, z_m, "alternating"), self.heights_at(x_m, z_m, "uniform"))


def surface_heights(
    heights: npt.NDArray[np.float32], col: Floats, row: Floats, diagonal: Diagonal = "alternating"
) -> Floats:
    """Height of the surface at fractional posts; NaN outside. The twin of ``surface_height`` in GLSL."""
    rows, cols = heights.shape
    with np.errstate(invalid="ignore"):
        outside = ~((col >= 0) & (col <= cols - 1) & (row >= 0) & (row <= rows - 1))
    col, row = np.where(outside, 0.0, col), np.where(outside, 0.0, row)
    c, r = np.minimum(col.astype(np.int64), cols - 2), np.minimum(row.astype(np.int64), rows - 2)
    u, v = col - c, row - r
    nw, ne = heights[r, c].astype(np.float64), heights[r, c + 1].astype(np.float64)
    sw, se = heights[r + 1, c].astype(np.float64), heights[r + 1, c + 1].astype(np.float64)
    # NW-SE diagonal: u >= v is the north-east triangle (nw, ne, se), else the south-west one (nw, se, sw).
    nw_se = np.where(u >= v, nw + (ne - nw) * u + (se - ne) * v, nw + (se - sw) * u + (sw - nw) * v)
    # SW-NE diagonal: u + v <= 1 is the north-west triangle (nw, ne, sw), else the south-east one (ne, se, sw).
    sw_ne = np.where(
        u + v <= 1.0, nw + (ne - nw) * u + (sw - nw) * v, se + (sw - se) * (1.0 - u) + (ne - se) * (1.0 - v)
    )
    is_nw_se = ((r + c) % 2 == 0) if diagonal == "alternating" else np.zeros(r.shape, np.bool_)
    return np.where(outside, np.nan, np.where(is_nw_se, nw_se, sw_ne))


def fill_holes(heights: npt.NDArray[np.float32], holes: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Heights with every hole post interpolated from the data around it.

    Pull-push: means of 2 x 2 blocks of data are taken until every block holds some, then interpolated back into the
    holes. The fill is smooth, stays within the range of the data, and meets the rim of each hole. A grid with no data
    at all becomes flat zero.

    Parameters
    ----------
    heights : ndarray of float32, (rows, cols)
        Any values in holes, also NaN.
    holes : ndarray of bool, (rows, cols)

    Returns
    -------
    ndarray of float32, (rows, cols)
        A new array.

    References
    ----------
    S. Gortler et al., *The Lumigraph*, SIGGRAPH 1996, section 3.4 (pull-push).
    """
    filled = np.where(holes, np.float32(0), heights)
    if not holes.any() or holes.all():
        return filled
    rows, cols = holes.shape
    blocks = ((rows + 1) // 2, (cols + 1) // 2)
    total, count = np.zeros(blocks, np.float32), np.zeros(blocks, np.uint8)
    for corner in np.ndindex(2, 2):
        part = (slice(corner[0], None, 2), slice(corner[1], None, 2))
        within = (slice((rows + 1 - corner[0]) // 2), slice((cols + 1 - corner[1]) // 2))  # blocks cut by an edge
        total[within] += filled[part]
        count[within] += ~holes[part]
    total /= np.maximum(count, 1)
    coarse = fill_holes(total, count == 0)
    for row in range(0, rows, 512):  # in bands: a whole interpolated grid would double the memory
        band = slice(row, min(row + 512, rows))
        np.copyto(filled[band], _interpolated(coarse, band, cols), where=holes[band])
    return filled


def _interpolated(blocks: npt.NDArray[np.float32], band: slice, cols: int) -> npt.NDArray[np.float32]:
    """Block means, bilinearly interpolated at the posts of some rows: each post is 3/4 its block and 1/4 the next."""

    def ends(first: int, last: int, count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        post = np.arange(first, last)
        return post // 2, np.clip(post // 2 + np.where(post % 2, 1, -1), 0, count - 1)

    near, far = ends(band.start, band.stop, blocks.shape[0])
    quarter = np.float32(0.25)
    mixed = blocks[near] + (blocks[far] - blocks[near]) * quarter
    near, far = ends(0, cols, blocks.shape[1])
    return mixed[:, near] + (mixed[:, far] - mixed[:, near]) * quarter
