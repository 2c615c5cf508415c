"""`Heightfield` -> GeoTIFF, for ``reliefscope make`` and for other programs."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np

from terrain.errors import InputError
from terrain.heightfield import Heightfield


def write_geotiff(heightfield: Heightfield, path: str | os.PathLike[str]) -> Path:
    """Write true heights as float32, holes as NaN.

    The file appears under its name only when it is complete. Without a georeference the north-west post lies at map
    position (0, 0), and map units are metres.

    Parameters
    ----------
    heightfield : Heightfield
    path : path
        An existing file is replaced.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    path = Path(path)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    georeference, (dx, dz) = heightfield.georeference, heightfield.spacing_m
    a, b, c, d, e, f = georeference.map_from_post if georeference else (dx, 0.0, 0.0, 0.0, -dz, 0.0)
    heights = heightfield.heights_m / np.float32(heightfield.exaggeration)
    if heightfield.holes is not None:
        heights[heightfield.holes] = np.nan
    try:
        with warnings.catch_warnings(), rasterio.Env(GDAL_NUM_THREADS="ALL_CPUS"):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(
                os.path.abspath(part),
                "w",
                driver="GTiff",
                width=heightfield.cols,
                height=heightfield.rows,
                count=1,
                dtype="float32",
                crs=georeference.crs if georeference else None,
                # posts are points; GDAL wants the corner of the pixel around the first
                transform=rasterio.Affine(a, b, c - (a + b) / 2, d, e, f - (d + e) / 2),
                nodata=None if heightfield.holes is None else np.nan,
                compress="deflate",
                predictor=3,
                tiled=True,
                BIGTIFF="IF_SAFER",
            ) as dataset:
                dataset.write(heights, 1)
                dataset.units = ("metre",)
                if georeference:  # without one, the tag makes GDAL invent a local system
                    dataset.update_tags(AREA_OR_POINT="Point")
        part.replace(path)
    except (OSError, ValueError, rasterio.errors.RasterioError) as error:
        raise InputError(f"expected to write {path}, found that it cannot be ({error}); choose another") from error
    finally:
        part.unlink(missing_ok=True)
    return path
