"""Where an image lies on the grid of posts.

Where image and terrain both say where they lie on the Earth, the image goes there, even if it covers only part of the
terrain or the terrain only part of it; otherwise it is stretched over the whole terrain. Posts are mapped to the image
by an affine map: between coordinate systems that is an approximation, and where it would be wrong by more than half a
pixel, the image is read warped to the terrain's own coordinate system.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Georeference, Heightfield
from terrain.textures.array_source import whole_extent
from terrain.textures.tree import MOST_CELLS, TILE_PX

FIT_POSTS = 9  # per side: where the affine map is compared with the exact one
TOLERATED_PX = 0.5

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placement:
    """An image's place, and how it must be read to lie there.

    Attributes
    ----------
    image_from_post : ndarray of float64, (2, 3)
        Image coordinates (0..1) = ``image_from_post @ (col, row, 1)``.
    size_px : tuple of int
        (width, height) of the image as it must be read.
    warp : dict or None
        Options of ``rasterio.vrt.WarpedVRT`` where the image must be warped.
    notes : tuple of str
    """

    image_from_post: Floats
    size_px: tuple[int, int]
    warp: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()


def place_image(dataset: Any, heightfield: Heightfield) -> Placement:
    """The place of an open rasterio dataset.

    Raises
    ------
    numpy.linalg.LinAlgError, rasterio.errors.RasterioError
        If its coordinate system has no relation to the terrain's.
    """
    size_px, crs, map_from_pixel = (dataset.width, dataset.height), dataset.crs, dataset.transform
    place = heightfield.georeference
    if crs is None or map_from_pixel.is_identity or place is None:
        which = "The image" if place is not None else "The terrain"
        note = f"{which} does not say where it lies: the image covers the whole terrain."
        return Placement(whole_extent(heightfield), size_px, notes=(note,))
    image_from_post, worst_px = _fit_affine(heightfield, place, crs, map_from_pixel, size_px)
    if worst_px <= TOLERATED_PX or covered_share(heightfield, image_from_post) == 0.0:
        return Placement(image_from_post, size_px)
    return _place_warped(heightfield, place, crs, size_px, image_from_post)


def _fit_affine(
    heightfield: Heightfield, place: Georeference, crs: Any, map_from_pixel: Any, size_px: tuple[int, int]
) -> tuple[Floats, float]:
    """Affine map from posts to image coordinates, and how far it is off at worst [pixels of the image]."""
    from rasterio.crs import CRS
    from rasterio.warp import transform

    col, row = np.meshgrid(
        np.linspace(0, heightfield.cols - 1, FIT_POSTS), np.linspace(0, heightfield.rows - 1, FIT_POSTS)
    )
    map_x, map_y = (v.ravel() for v in place.to_map(col, row))
    terrain_crs = CRS.from_user_input(place.crs)
    if terrain_crs != crs:
        map_x, map_y = (np.asarray(v) for v in transform(terrain_crs, crs, map_x, map_y))
    inverse = ~map_from_pixel
    pixel_col = inverse.a * map_x + inverse.b * map_y + inverse.c
    pixel_row = inverse.d * map_x + inverse.e * map_y + inverse.f
    exact = np.stack([pixel_col / size_px[0], pixel_row / size_px[1]], axis=1)
    if not np.isfinite(exact).all():
        raise np.linalg.LinAlgError("the terrain has no place in the image's coordinate system")
    posts = np.stack([col.ravel(), row.ravel(), np.ones(col.size)], axis=1)
    solution, *_ = np.linalg.lstsq(posts, exact, rcond=None)
    off = np.abs(posts @ solution - exact) * size_px
    return solution.T, float(off.max())


def _place_warped(
    heightfield: Heightfield, place: Georeference, crs: Any, size_px: tuple[int, int], image_from_post: Floats
) -> Placement:
    """The part of the terrain under the image, along the terrain's columns and rows at the image's own resolution."""
    from affine import Affine
    from rasterio.crs import CRS
    from rasterio.enums import Resampling

    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], np.float64)
    post_from_image = np.linalg.inv(np.vstack([image_from_post, [0, 0, 1]]))
    covered = corners @ post_from_image[:2].T
    margin = 0.02 * (covered.max(axis=0) - covered.min(axis=0)) + 1.0  # the affine map is only nearly right
    low = np.maximum(covered.min(axis=0) - margin, -0.5)
    high = np.minimum(covered.max(axis=0) + margin, np.array([heightfield.cols, heightfield.rows]) - 0.5)
    px_per_post = np.hypot(*(image_from_post[:, :2] * np.array(size_px)[:, None]))
    size = np.clip(np.ceil((high - low) * px_per_post.max()), 1, MOST_CELLS * TILE_PX).astype(int)
    step = (high - low) / size
    a, b, c, d, e, f = place.map_from_post
    transform = Affine(
        a * step[0], b * step[1], a * low[0] + b * low[1] + c, d * step[0], e * step[1], d * low[0] + e * low[1] + f
    )
    warp = {
        "crs": CRS.from_user_input(place.crs), "transform": transform, "width": int(size[0]), "height": int(size[1]),
        "resampling": Resampling.bilinear, "add_alpha": True,
    }  # fmt: skip
    exact = np.zeros((2, 3))
    exact[[0, 1], [0, 1]] = 1.0 / (high - low)
    exact[:, 2] = -low / (high - low)
    note = f"Warped from {crs.to_string()[:40]} to the terrain's coordinate system."
    return Placement(exact, (int(size[0]), int(size[1])), warp, (note,))


def covered_share(heightfield: Heightfield, image_from_post: Floats) -> float:
    """Share of the terrain's area that the image covers: exact, however small."""
    corners = np.array([[0, 0, 1], [heightfield.cols - 1, 0, 1], [heightfield.cols - 1, heightfield.rows - 1, 1],
                        [0, heightfield.rows - 1, 1]], np.float64)  # fmt: skip
    terrain = corners @ image_from_post.T
    cut = terrain
    for axis in (0, 1):  # Sutherland and Hodgman: cut off at each side of the image in turn
        for side, limit in ((1.0, 0.0), (-1.0, 1.0)):
            inside = side * (cut[:, axis] - limit)
            kept: list[Floats] = []
            for here, there, p, q in zip(cut, np.roll(cut, -1, axis=0), inside, np.roll(inside, -1), strict=True):
                if p >= 0:
                    kept.append(here)
                if (p >= 0) != (q >= 0):
                    kept.append(here + (there - here) * (p / (p - q)))
            if len(kept) < 3:
                return 0.0
            cut = np.array(kept)
    return min(_area(cut) / max(_area(terrain), 1e-300), 1.0)


def _area(polygon: Floats) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
