"""A draped image: a photograph or map laid over the terrain.

Where image and terrain both say where they lie on the Earth, the image goes there, even if it covers only part of the
terrain or the terrain only part of it; otherwise it is stretched over the whole terrain. The shader maps posts to the
image by an affine map: between coordinate systems that is an approximation, and where it would be wrong by more than
half a texel, the image is warped to the terrain's own coordinate system first.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.heightfield import Georeference, Heightfield

MOST_TEXELS = 8192  # per side: every driver of OpenGL 3.3 in use takes this
FIT_POSTS = 9  # per side: where the affine map is compared with the exact one
TOLERATED_TEXELS = 0.5


@dataclass(frozen=True, eq=False)
class DrapeImage:
    """An image and where it lies on the grid.

    Attributes
    ----------
    pixels : ndarray of uint8, (rows, cols, 4)
        RGBA, sRGB, row 0 first; alpha 0 where the image holds no data.
    image_from_post : ndarray of float64, (2, 3)
        Texture coordinates (0..1, origin at the corner of pixel (0, 0)) = ``image_from_post @ (col, row, 1)``.
    name : str
    notes : tuple of str
        What was decided while reading, one sentence each.
    """

    pixels: npt.NDArray[np.uint8]
    image_from_post: npt.NDArray[np.float64]
    name: str
    notes: tuple[str, ...] = ()


def read_drape(path: str | Path, heightfield: Heightfield, most_texels: int = MOST_TEXELS) -> DrapeImage:
    """Read an image to be draped over ``heightfield``; anything GDAL reads.

    Parameters
    ----------
    path : str or Path
    heightfield : Heightfield
    most_texels : int
        Largest width and height of the texture; a larger image is downsampled.

    Raises
    ------
    InputError
        If the file is no image, or lies wholly beside the terrain.
    """
    import rasterio  # 128 ms to import
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    path = Path(path)
    notes: list[str] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as source:
                pixels = _read_rgba(source, most_texels, notes)
                crs, map_from_pixel = source.crs, source.transform
                full_size = (source.width, source.height)
    except (RasterioError, OSError, ValueError) as error:
        raise InputError(f"Expected an image in {path.name}, which cannot be read as one ({error}).") from None

    place = heightfield.georeference
    if crs is None or map_from_pixel.is_identity or place is None:
        which = "The image" if place is not None else "The terrain"
        notes.append(f"{which} does not say where it lies: the image covers the whole terrain.")
        return DrapeImage(pixels, _whole_extent(heightfield), path.name, tuple(notes))
    try:
        image_from_post, worst_texels = _fit_affine(heightfield, place, crs, map_from_pixel, full_size, pixels.shape)
        if worst_texels > TOLERATED_TEXELS:
            notes.append(f"Warped from {crs.to_string()[:40]} to the terrain's coordinate system.")
            pixels, image_from_post = _warp(pixels, heightfield, place, crs, map_from_pixel, full_size, image_from_post)
    except (RasterioError, np.linalg.LinAlgError) as error:
        raise InputError(f"{path.name}: its coordinate system does not match the terrain's ({error}).") from None
    covered = _covered_share(heightfield, image_from_post)
    if covered == 0.0:
        raise InputError(f"{path.name} lies beside the terrain: their extents do not overlap.")
    if covered < 0.995:
        notes.append(f"The image covers {covered:.0%} of the terrain.")
    return DrapeImage(pixels, image_from_post, path.name, tuple(notes))


def _read_rgba(source: Any, most_texels: int, notes: list[str]) -> npt.NDArray[np.uint8]:
    """(rows, cols, 4): bands or a colour table as RGBA, downsampled to the limit, other depths stretched to 8 bits."""
    from rasterio.enums import ColorInterp, Resampling

    shrink = max(1.0, max(source.width, source.height) / most_texels)
    rows, cols = max(1, round(source.height / shrink)), max(1, round(source.width / shrink))
    if shrink > 1.0:
        notes.append(f"Downsampled from {source.width} x {source.height} to {cols} x {rows} texels.")
    interpretation = list(source.colorinterp)
    alpha_band = interpretation.index(ColorInterp.alpha) + 1 if ColorInterp.alpha in interpretation else None
    bands = [b for b in source.indexes if b != alpha_band]
    is_table = interpretation[0] == ColorInterp.palette
    resampling = Resampling.nearest if is_table else Resampling.average
    shape = (rows, cols)
    out = np.empty((rows, cols, 4), np.uint8)
    if is_table:
        table = np.zeros((256, 4), np.uint8)
        for index, colour in source.colormap(1).items():
            table[min(index, 255)] = colour
        out[:] = table[source.read(1, out_shape=shape, resampling=resampling).astype(np.uint8)]
    else:
        chosen = bands[:3] if len(bands) >= 3 else [bands[0]] * 3
        data = source.read(chosen, out_shape=(3, *shape), resampling=resampling)
        if data.dtype != np.uint8:
            data = _stretch(data)
            notes.append("Stretched to 8 bits between its 1st and 99th percentile.")
        out[..., :3] = np.moveaxis(data, 0, -1)
        mask = source.dataset_mask(out_shape=shape, resampling=Resampling.nearest)
        out[..., 3] = mask
    return out


def _stretch(data: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    values = np.nan_to_num(data.astype(np.float32))
    low, high = np.percentile(values[:, ::4, ::4], [1.0, 99.0])
    return np.clip((values - low) * (255.0 / max(float(high - low), 1e-9)), 0, 255).astype(np.uint8)


def _whole_extent(heightfield: Heightfield) -> npt.NDArray[np.float64]:
    """Each post stands for the area around it, as a pixel does."""
    cols, rows = heightfield.cols, heightfield.rows
    return np.array([[1.0 / cols, 0.0, 0.5 / cols], [0.0, 1.0 / rows, 0.5 / rows]])


def _fit_affine(
    heightfield: Heightfield, place: Georeference, crs: Any, map_from_pixel: Any, full_size: tuple[int, int],
    shape: tuple[int, ...],
) -> tuple[npt.NDArray[np.float64], float]:  # fmt: skip
    """Affine map from posts to texture coordinates, and how far it is off at worst [texels of the image]."""
    from rasterio.crs import CRS
    from rasterio.warp import transform

    col, row = np.meshgrid(
        np.linspace(0, heightfield.cols - 1, FIT_POSTS), np.linspace(0, heightfield.rows - 1, FIT_POSTS)
    )
    map_x, map_y = (v.ravel() for v in place.to_map(col, row))
    terrain_crs = CRS.from_user_input(place.crs)
    if terrain_crs != crs:
        map_x, map_y = (np.asarray(v) for v in transform(terrain_crs, crs, map_x, map_y))
    pixel_col, pixel_row = _apply(~map_from_pixel, map_x, map_y)
    exact = np.stack([pixel_col / full_size[0], pixel_row / full_size[1]], axis=1)
    if not np.isfinite(exact).all():
        raise np.linalg.LinAlgError("the terrain has no place in the image's coordinate system")
    posts = np.stack([col.ravel(), row.ravel(), np.ones(col.size)], axis=1)
    solution, *_ = np.linalg.lstsq(posts, exact, rcond=None)
    off = np.abs(posts @ solution - exact) * [shape[1], shape[0]]
    return solution.T, float(off.max())


def _apply(matrix: Any, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> tuple[Any, Any]:
    """An affine matrix on arrays of coordinates."""
    return matrix.a * x + matrix.b * y + matrix.c, matrix.d * x + matrix.e * y + matrix.f


def _compose(outer: Any, inner: Any) -> Any:
    """The affine matrix that applies ``inner``, then ``outer``: affine 2 multiplies with ``*``, affine 3 with ``@``."""
    product = np.reshape(outer, (3, 3)) @ np.reshape(inner, (3, 3))
    return type(outer)(*product[:2].ravel().tolist())


def _warp(
    pixels: npt.NDArray[np.uint8], heightfield: Heightfield, place: Georeference, crs: Any, map_from_pixel: Any,
    full_size: tuple[int, int], image_from_post: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float64]]:  # fmt: skip
    """The image resampled along the terrain's columns and rows, at its own resolution, and its exact map."""
    from affine import Affine
    from rasterio.crs import CRS
    from rasterio.enums import Resampling
    from rasterio.warp import reproject

    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], np.float64)
    post_from_image = np.linalg.inv(np.vstack([image_from_post, [0, 0, 1]]))
    covered = corners @ post_from_image[:2].T
    limit = np.array([heightfield.cols, heightfield.rows], np.float64) - 0.5
    margin = 0.02 * (covered.max(axis=0) - covered.min(axis=0)) + 1.0  # the affine map is only nearly right
    low = np.maximum(covered.min(axis=0) - margin, -0.5)
    high = np.minimum(covered.max(axis=0) + margin, limit)
    if not (high > low).all():
        return pixels, image_from_post  # beside the terrain
    texels_per_post = max(
        float(np.hypot(*(image_from_post[:, 0] * pixels.shape[1::-1]))),
        float(np.hypot(*(image_from_post[:, 1] * pixels.shape[1::-1]))),
    )
    size = np.clip(np.ceil((high - low) * texels_per_post), 1, MOST_TEXELS).astype(int)
    step = (high - low) / size
    a, b, c, d, e, f = place.map_from_post
    post_from_texel = Affine(step[0], 0, low[0], 0, step[1], low[1])
    scaled = _compose(map_from_pixel, Affine.scale(full_size[0] / pixels.shape[1], full_size[1] / pixels.shape[0]))
    warped = np.zeros((4, size[1], size[0]), np.uint8)
    reproject(
        np.ascontiguousarray(np.moveaxis(pixels, -1, 0)), warped, src_transform=scaled, src_crs=crs,
        dst_transform=_compose(Affine(a, b, c, d, e, f), post_from_texel), dst_crs=CRS.from_user_input(place.crs),
        resampling=Resampling.bilinear,
    )  # fmt: skip
    exact = np.array([[1 / (step[0] * size[0]), 0, 0], [0, 1 / (step[1] * size[1]), 0]])
    exact[:, 2] = -low * np.diag(exact[:, :2])
    return np.ascontiguousarray(np.moveaxis(warped, 0, -1)), exact


def _covered_share(heightfield: Heightfield, image_from_post: npt.NDArray[np.float64]) -> float:
    """Share of the terrain's area that the image covers, on a grid of 101 x 101 points."""
    col, row = np.meshgrid(np.linspace(0, heightfield.cols - 1, 101), np.linspace(0, heightfield.rows - 1, 101))
    uv = np.stack([col, row, np.ones_like(col)], axis=-1) @ image_from_post.T
    return float(((uv > 0.0) & (uv < 1.0)).all(axis=-1).mean())
