"""What a file is for, by its name and content, and reading those that were dropped or chosen together."""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.opening.terrain import open_terrain
from terrain.errors import InputError
from terrain.files.encodings import detect
from terrain.flight.track_files import TRACK_SUFFIXES
from terrain.heightfield import Heightfield
from terrain.progress import tell

FLIGHT_SUFFIX = ".json"
PICTURE_SUFFIXES = (".jpg", ".jpeg", ".webp", ".bmp", ".gif", ".jp2")
_SAMPLED_TEXELS = 256


@dataclass
class Loaded:
    """What has been read: a terrain, an image over it, or both."""

    source: argparse.Namespace | None = None
    heightfield: Heightfield | None = None
    image: Any = None
    image_path: Path = Path()
    is_reload: bool = False
    flights: Sequence[Path] = ()


def is_flight(path: Path) -> bool:
    """Whether a name is that of a flight or a track."""
    return path.suffix.lower() in (FLIGHT_SUFFIX, *TRACK_SUFFIXES)


def read_all(paths: Sequence[Path], present: Heightfield, as_terrain: bool, flights: Sequence[Path]) -> Loaded:
    """Read what was dropped or chosen: the terrain first, then an image for it."""
    pictures = [path for path in paths if not as_terrain and _is_picture(path)]
    terrains = [path for path in paths if path not in pictures]
    if len(terrains) > 1 or len(pictures) > 1:
        raise InputError(f"Expected one terrain and one image at most, found {', '.join(path.name for path in paths)}.")
    loaded = Loaded(flights=flights)
    terrain = present
    if terrains:
        loaded.source = argparse.Namespace(
            terrain=str(terrains[0]), encoding=None, raw=None, spacing=None, height_scale=1.0
        )
        loaded.heightfield = terrain = read_terrain(loaded.source)
    if pictures:
        from terrain.textures.image_source import ImageSource

        tell("reading the image")
        loaded.image, loaded.image_path = ImageSource(pictures[0], terrain), pictures[0]
    return loaded


def read_terrain(source: argparse.Namespace) -> Heightfield:
    """A terrain with its bounds, which go into the cache: the window finds them there."""
    from terrain.scene import open_scene

    heightfield = open_terrain(source)
    open_scene(heightfield)
    return heightfield


def _is_picture(path: Path) -> bool:
    """Whether a file is a picture for the eye: of an image format, or of colours that do not encode heights."""
    suffix = path.suffix.lower()
    if suffix in PICTURE_SUFFIXES:
        return True
    if suffix not in (".png", ".tif", ".tiff"):
        return False
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(os.path.abspath(path)) as file:
                if file.count < 3 or file.dtypes[0] != "uint8":
                    return False
                shape = (3, min(file.height, _SAMPLED_TEXELS), min(file.width, _SAMPLED_TEXELS))
                return detect(*file.read([1, 2, 3], out_shape=shape)) is None
    except rasterio.errors.RasterioError:
        return False
