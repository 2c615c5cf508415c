"""Files -> `Heightfield`.

One function, in the order a file is understood: unpack it, read its numbers, find the posts without data, place it on
the ground in metres, say what was decided. Whatever is wrong with a file becomes one line of `InputError`.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from terrain.errors import InputError
from terrain.files.encodings import ENCODINGS, Encoding
from terrain.files.placement import DEFAULT_SPACING_M, Placement, flipped, place
from terrain.files.raster import Raster, read_raster
from terrain.files.raw import RAW_SUFFIXES, apply_beside, read_beside, read_npy, read_npz, read_raw
from terrain.files.unpack import unpacked
from terrain.files.voids import find_voids
from terrain.heightfield import Heightfield, fill_holes
from terrain.progress import tell

_HIGHEST_M = 1e7


def read_heightfield(
    path: str | os.PathLike[str],
    *,
    encoding: Encoding | None = None,
    raw: str | None = None,
    spacing_m: float | None = None,
    height_scale: float = 1.0,
) -> Heightfield:
    """Read a terrain.

    Parameters
    ----------
    path : path
        Any raster GDAL reads, also in ``.zip``, ``.gz`` or ``.bz2``; ``.npy`` and ``.npz``; ``.r16`` and ``.r32``.
    encoding : {"terrarium", "mapbox", "grey"}, optional
        How colours mean heights; found out where not given.
    raw : str, optional
        ``"WxH[,dtype][,endian]"``: read the file as bare numbers.
    spacing_m : float, optional
        Metres between posts, instead of what the file says.
    height_scale : float
        Factor to all heights (0.3048 for feet the file does not mention).

    Returns
    -------
    Heightfield
        Row 0 north where the file says where north is; ``notes`` tell what was decided.

    Raises
    ------
    InputError
        If the file or an option cannot be used.
    """
    path = Path(path)
    try:
        _check(path, encoding, spacing_m, height_scale)
        notes: list[str] = []
        tell("opening")
        with unpacked(path, notes) as file:
            raster = _read(file, encoding, raw)
            if raster.map_from_pixel is None:
                apply_beside(raster, read_beside(file))
        raster.notes[:0] = notes
        return _heightfield(raster, file.stem, spacing_m, height_scale)
    except InputError as error:
        raise InputError(_one_line(str(error))) from error
    except MemoryError as error:
        raise InputError(_one_line(f"expected {path.name} to fit into memory, found too little; crop it")) from error


def _check(path: Path, encoding: str | None, spacing_m: float | None, height_scale: float) -> None:
    """The options, and that there is a file with something in it."""
    if encoding is not None and encoding not in ENCODINGS:
        raise InputError(f"expected an encoding of {', '.join(ENCODINGS)}, found {encoding!r}; choose one of them")
    if spacing_m is not None and not 1e-4 <= spacing_m <= 1e6:
        raise InputError(f"expected a spacing between 0.1 mm and 1000 km, found {spacing_m:g} m; give metres")
    if height_scale == 0 or not math.isfinite(height_scale):
        raise InputError(f"expected a height scale other than 0, found {height_scale:g}; give metres per unit")
    try:
        exists, ordinary = path.exists(), path.is_file() or path.is_dir()  # a pipe would never end
        empty = path.is_file() and path.stat().st_size == 0
    except (OSError, ValueError) as error:  # a name no file can have, a folder nobody may enter
        raise InputError(f"expected a terrain file, found a name that does not open ({error}); correct it") from error
    if not exists:
        raise InputError(f"expected a terrain file, found nothing at {path}; correct the path")
    if not ordinary or empty:
        raise InputError(f"expected a terrain file, found {'an empty file' if empty else 'a device'} at {path}")


def _read(file: Path, encoding: Encoding | None, raw: str | None) -> Raster:
    suffix = file.suffix.lower()
    try:
        if raw is not None or suffix in RAW_SUFFIXES:
            return read_raw(file, raw)
        if suffix == ".npy":
            return read_npy(file)
        if suffix == ".npz":
            return read_npz(file)
    except OSError as error:
        raise InputError(f"expected a readable file, found {file.name} ({error.strerror}); check its rights") from error
    return read_raster(file, encoding)


def _heightfield(raster: Raster, name: str, spacing_m: float | None, height_scale: float) -> Heightfield:
    notes = raster.notes
    tell("looking for posts without data")
    heights, holes = raster.values, find_voids(raster.values, raster.nodata, notes)
    if raster.masked is not None and raster.masked.any():
        notes.append(f"{int(raster.masked.sum())} posts are masked in the file (transparent or black): holes.")
        holes = raster.masked if holes is None else holes | raster.masked
    if holes is not None and holes.all():
        raise InputError(f"expected heights in {name}, found {holes.size} posts without data; give another file")
    scale, offset = (factor * raster.unit_m * height_scale for factor in (raster.scale, raster.offset))
    with np.errstate(over="ignore", invalid="ignore"):  # in posts without data
        if scale != 1.0:
            heights *= np.float32(scale)
        if offset != 0.0:
            heights += np.float32(offset)
    if height_scale != 1.0:
        notes.append(f"Heights were multiplied by {height_scale:g} as asked.")
    placement = _placement(raster, spacing_m)
    if placement.flip_rows or placement.flip_cols:
        heights[...] = flipped(heights, placement)
    if holes is not None:
        tell("filling holes")
        holes = np.ascontiguousarray(flipped(holes, placement))
        heights = fill_holes(heights, holes)
    low, high = float(heights.min()), float(heights.max())
    if not (low >= -_HIGHEST_M and high <= _HIGHEST_M):
        raise InputError(
            f"expected heights within {_HIGHEST_M:g} m in {name}, found {low:g} to {high:g}; "
            "the byte order or number type may be wrong, or give --height-scale"
        )
    return Heightfield(heights, placement.spacing_m, holes, name, placement.georeference, tuple(notes))


def _placement(raster: Raster, spacing_m: float | None) -> Placement:
    if raster.map_from_pixel is not None:
        rows, cols = raster.values.shape
        asked_m = None if spacing_m is None else spacing_m * raster.factor
        return place((rows, cols), raster.map_from_pixel, raster.crs, raster.notes, asked_m)
    if spacing_m is not None:
        raster.notes.append(f"Spacing {spacing_m:g} m as asked.")
    elif raster.spacing_m is None:
        raster.notes.append(
            f"The file says nothing about spacing: {DEFAULT_SPACING_M:g} m between posts assumed (see --spacing)."
        )
    known = raster.spacing_m or (DEFAULT_SPACING_M, DEFAULT_SPACING_M)
    dx, dz = known if spacing_m is None else (spacing_m, spacing_m)
    return Placement((dx * raster.factor, dz * raster.factor))


def _one_line(text: str) -> str:
    """Text without line breaks, control characters and the undecodable parts of file names."""
    clean = "".join(character if character.isprintable() else " " for character in text)
    return " ".join(clean.split())
