"""Any raster GDAL reads -> a `Raster`: numbers, what the file says about them, and nothing decided yet.

GDAL is handed files nobody vouches for, so what a file claims is checked before anything of that size is read: posts,
bytes to decode, bytes per block. Grids beyond `MAX_POSTS` are read at every n-th post.

**Source** GDAL raster data model, https://gdal.org/user/raster_data_model.html.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.files import encodings
from terrain.progress import Cancelled, tell

Floats32 = npt.NDArray[np.float32]

MAX_SIDE = 8200
"""Posts per side that are read in full: 2^13 + 1 and a little."""
MAX_POSTS = 70_000_000
STRIP_POSTS = 1 << 22
"""Posts read between two words about the progress."""
TEXT_BYTES = 1 << 20
"""Bytes of a text file that are looked at in one go."""
MAX_BLOCK_ROW_BYTES = 300 << 20
"""GDAL holds one row of blocks in memory, or decodes each block once per row of posts."""
MAX_DECODED_BYTES = 4 << 30
"""About ten seconds of decompression."""
MAX_PICTURE_BYTES = 400 << 20
"""The same for formats that some drivers decode as a whole."""

_RANDOM_ACCESS = {"GTiff", "COG", "VRT", "EHdr", "ENVI", "HFA", "AIG", "SRTMHGT", "DTED", "netCDF"}
_TEXT = {"AAIGrid", "GRASSASCIIGrid", "ISG", "XYZ"}
_GDAL_OPTIONS = {
    "GDAL_NUM_THREADS": "ALL_CPUS",
    "GDAL_CACHEMAX": MAX_BLOCK_ROW_BYTES + (20 << 20),
    "GDAL_HTTP_CONNECTTIMEOUT": 3,  # a local file may name remote ones
    "GDAL_HTTP_TIMEOUT": 10,
    "GDAL_HTTP_MAX_RETRY": 0,
}
_UNITS_M = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot", "international feet"), 0.3048),
    **dict.fromkeys(("us survey foot", "us survey feet", "ussurveyfoot", "us-ft", "ftus", "foot_us"), 1200 / 3937),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), 1000.0),
    **dict.fromkeys(("dm", "decimetre", "decimeter"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 0.001),
    **dict.fromkeys(("fathom", "fathoms"), 1.8288),
}


@dataclass
class Raster:
    """What a file holds, before it becomes a terrain.

    Attributes
    ----------
    values : ndarray of float32, (rows, cols)
        Stored numbers, or heights where the file packs them in colours; voids not yet found.
    factor : int
        Every how many posts of the file were read along each side.
    masked : ndarray of bool, (rows, cols), or None
        Posts the file itself marks as absent (alpha, mask band).
    stored : dtype or None
        Type of the numbers in the file; None where the values are decoded heights.
    nodata : float or None
        The stored number that means "no data".
    scale, offset : float
        ``height = values * scale + offset`` in the file's unit.
    unit_m : float
        Metres per unit of height.
    map_from_pixel : tuple of 6 float or None
        ``(a, b, c, d, e, f)`` of ``values`` at pixel *corners*, GDAL's convention; None where the file does not say.
    crs : rasterio.crs.CRS or None
    spacing_m : tuple of float or None
        Between posts of the file, where it has no georeference and says so all the same.
    notes : list of str
    """

    values: Floats32
    factor: int = 1
    masked: npt.NDArray[np.bool_] | None = None
    stored: np.dtype[Any] | None = None
    nodata: float | None = None
    scale: float = 1.0
    offset: float = 0.0
    unit_m: float = 1.0
    map_from_pixel: tuple[float, float, float, float, float, float] | None = None
    crs: Any = None
    spacing_m: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)


def read_raster(path: Path, encoding: encodings.Encoding | None) -> Raster:
    """Read a file through GDAL.

    Parameters
    ----------
    path : Path
    encoding : {"terrarium", "mapbox", "grey"} or None
        How colours mean heights; None finds out.

    Raises
    ------
    InputError
        If GDAL cannot read it, if it holds no heights, or if it claims more than can be read.
    """
    import rasterio  # 130 ms, and the embedded scenes need none of it
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings(), rasterio.Env(**_GDAL_OPTIONS):
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            dataset = rasterio.open(os.path.abspath(path))
        except Exception as error:  # drivers of hostile files raise whatever they like
            raise InputError(
                f"expected a raster that GDAL reads, found {path.name} ({_cause(error, path)}); "
                "give another file, or --raw WxH,dtype,endian for bare numbers"
            ) from error
        with dataset:
            factor = _reduction(dataset, path)
            try:
                return _read(dataset, path, factor, encoding)
            except (InputError, MemoryError, Cancelled):
                raise
            except Exception as error:
                raise InputError(
                    f"expected {dataset.width} x {dataset.height} readable posts in {path.name}, "
                    f"found damaged data ({_cause(error, path)}); get a fresh copy of the file"
                ) from error


def reduction(cols: int, rows: int) -> int:
    """Every how many posts a grid of that size is read."""
    return max(1, math.ceil(max(cols, rows) / MAX_SIDE), math.ceil(math.sqrt(cols * rows / MAX_POSTS)))


def reduction_note(cols: int, rows: int, factor: int) -> str:
    return (
        f"{cols} x {rows} posts are more than {MAX_SIDE} per side or {MAX_POSTS // 10**6} million: "
        f"one in {factor} was read along each side."
    )


def _cause(error: Exception, path: Path) -> str:
    """GDAL's own words, without the folder."""
    text = str(error.__cause__ or error) or type(error).__name__
    return text.replace(f"{os.path.abspath(path.parent)}{os.sep}", "")[:200].strip(" .")


def _reduction(dataset: Any, path: Path) -> int:
    """Check what the header claims, and tell every how many posts to read."""
    cols, rows, count = dataset.width, dataset.height, dataset.count
    if count == 0:
        parts = [name.rsplit(":", 1)[-1] for name in dataset.subdatasets[:6]]
        found = f"several grids ({', '.join(parts)})" if parts else "none"
        raise InputError(
            f"expected one grid of heights in {path.name}, found {found}; write the one you want to a GeoTIFF"
        )
    if min(cols, rows) < 2:
        raise InputError(f"expected at least 2 x 2 posts in {path.name}, found {cols} x {rows}; give a larger grid")
    kind = np.dtype("complex64" if "complex" in dataset.dtypes[0] else dataset.dtypes[0])
    if kind.kind not in "iuf":
        raise InputError(
            f"expected real heights in {path.name}, found numbers of type {dataset.dtypes[0]}; "
            "write the part you want as real numbers"
        )
    size = path.stat().st_size
    if dataset.driver in _TEXT and path.is_file() and cols * rows > size:
        raise InputError(f"expected {cols} x {rows} numbers in {path.name}, found {size} bytes; the header is wrong")
    if path.suffix.lower() == ".flt" and dataset.driver == "EHdr" and kind != np.float32:
        raise InputError(
            f"expected {cols} x {rows} float32 ({4 * cols * rows} bytes) in {path.name}, found {size} bytes; "
            "correct the .hdr file or get a fresh copy"
        )
    interleaved = str(dataset.tags(ns="IMAGE_STRUCTURE").get("INTERLEAVE", "")).upper() == "PIXEL"
    bands = count if interleaved else 1
    factor = reduction(cols, rows)
    overview = max((level for level in dataset.overviews(1) if level <= factor), default=1)
    decoded = cols * rows // overview**2 * kind.itemsize * max(bands, 4 if count in (3, 4) else 1)
    limit = MAX_DECODED_BYTES if dataset.driver in _RANDOM_ACCESS else MAX_PICTURE_BYTES
    if decoded > limit:
        raise InputError(
            f"expected at most {limit >> 20} MB of posts in a {dataset.driver} file, found {cols} x {rows} "
            f"({decoded >> 20} MB) in {path.name}; crop it, or write a GeoTIFF with overviews (gdaladdo)"
        )
    block_rows, block_cols = dataset.block_shapes[0]
    block_row = block_rows * max(block_cols, cols) * kind.itemsize * bands
    if block_row > MAX_BLOCK_ROW_BYTES:
        raise InputError(
            f"expected rows of blocks below {MAX_BLOCK_ROW_BYTES >> 20} MB in {path.name}, found {block_row >> 20} MB "
            f"(blocks of {block_cols} x {block_rows} posts, {bands} bands); rewrite it: gdal_translate -co TILED=YES"
        )
    return factor


def _read(dataset: Any, path: Path, factor: int, encoding: encodings.Encoding | None) -> Raster:
    from rasterio.windows import Window

    notes: list[str] = []
    # A whole number of source posts per post: a fractional step would shake the grid by up to half a post.
    rows, cols = max(2, dataset.height // factor), max(2, dataset.width // factor)
    width, height = min(cols * factor, dataset.width), min(rows * factor, dataset.height)
    area = {"window": Window(0, 0, width, height), "out_shape": (rows, cols)}
    raster = Raster(np.empty((0, 0), np.float32), factor, notes=notes)
    _read_bands(dataset, path, area, encoding, raster)
    if factor > 1:
        notes.append(reduction_note(dataset.width, dataset.height, factor))
    raster.crs = _crs(dataset, notes)
    if raster.stored is not None:
        _calibrate(dataset, raster)
    if not dataset.transform.is_identity:  # rasterio gives the identity where the file says nothing
        a, b, c, d, e, f = dataset.transform[:6]
        x, y = width / cols, height / rows
        raster.map_from_pixel = (a * x, b * y, c, d * x, e * y, f)
    return raster


def _crs(dataset: Any, notes: list[str]) -> Any:
    from rasterio.errors import CRSError

    try:
        crs = dataset.crs
        return crs if crs and crs.to_wkt() else None
    except CRSError as error:
        notes.append(f"The file's coordinate system is damaged and was left out ({error}).")
        return None


def _read_bands(
    dataset: Any, path: Path, area: dict[str, Any], encoding: encodings.Encoding | None, raster: Raster
) -> None:
    """Fill in values, mask, stored type and nodata."""
    from rasterio.enums import MaskFlags

    meaning = [color.name for color in dataset.colorinterp[:4]]
    if "alpha" in meaning:
        raster.masked = dataset.read(meaning.index("alpha") + 1, **area) == 0
    elif MaskFlags.per_dataset in dataset.mask_flag_enums[0]:
        raster.masked = dataset.read_masks(1, **area) == 0
    raster.stored, raster.nodata = np.dtype(dataset.dtypes[0]), dataset.nodatavals[0]

    if meaning[:3] == ["red", "green", "blue"]:
        rgb = dataset.read([1, 2, 3], window=area["window"], out_shape=(3, *area["out_shape"]))
    elif meaning[0] == "palette" and raster.stored == np.uint8:
        table = np.zeros((4, 256), np.uint8)
        for index, color in dataset.colormap(1).items():
            table[:, index] = color
        indices = dataset.read(1, **area)
        rgb = table[:3, indices]
        clear = (table[3] == 0)[indices]
        if raster.nodata is not None:
            clear |= indices == raster.nodata
        raster.masked = clear if raster.masked is None else raster.masked | clear
        if encoding is None and encodings.detect(*rgb) is None:
            raster.notes.append("The picture has a palette of colours: its indices were taken as heights.")
            raster.values = indices.astype(np.float32)
            return
    else:
        _read_numbers(dataset, path, area, encoding, raster, meaning)
        return
    raster.values, black = encodings.heights_from_rgb(*rgb, encoding=encoding, name=path.name, notes=raster.notes)
    if black is not None:  # packed: the bytes themselves mean nothing
        raster.masked = black if raster.masked is None else raster.masked | black
        raster.stored = raster.nodata = None


def _read_numbers(
    dataset: Any, path: Path, area: dict[str, Any], encoding: str | None, raster: Raster, meaning: list[str]
) -> None:
    if encoding in ("terrarium", "mapbox"):
        raise InputError(
            f"expected red, green and blue bands for the {encoding} encoding, "
            f"found {', '.join(meaning)} in {path.name}; leave --encoding out"
        )
    if dataset.count - meaning.count("alpha") > 1:
        raster.notes.append(f"The file has {dataset.count} bands: band 1 was taken as heights.")
    if raster.stored == np.uint8 and dataset.scales[0] == 1.0:
        raster.notes.append("Heights have 8 bits: whole units only, so slopes come in steps.")
    raster.values = _read_strips(dataset, area)
    if dataset.driver == "GRASSASCIIGrid":
        first, step = raster.factor // 2, raster.factor  # the posts that GDAL reads
        stars = _find_stars(path, dataset.shape)[first::step, first::step]
        raster.values[stars[: len(raster.values), : raster.values.shape[1]]] = np.nan


def _find_stars(path: Path, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Posts (rows, cols) for which a GRASS text grid says ``*``, no data; GDAL takes them for 0."""
    found = np.zeros(math.prod(shape), np.bool_)
    with path.open("rb") as file:
        body = 0
        while b":" in file.readline():  # the header
            body = file.tell()
        file.seek(body)
        begin, cut_off = 0, b""
        while begin < found.size and (text := file.read(TEXT_BYTES)):
            text = cut_off + text
            words = text.split()
            cut_off = b"" if text[-1:].isspace() else words.pop()
            stars = [word == b"*" for word in words[: found.size - begin]]
            found[begin : begin + len(stars)] = stars
            begin += len(stars)
        found[begin : begin + 1] = cut_off == b"*"  # where the file ends without a line break
    return found.reshape(shape)


def _read_strips(dataset: Any, area: dict[str, Any]) -> Floats32:
    """Band 1 as float32, in strips of whole blocks between which is told how far the reading is."""
    from rasterio.windows import Window

    (rows, cols), window = area["out_shape"], area["window"]
    values = np.empty((rows, cols), np.float32)
    factor = round(window.height / rows)
    block_rows = dataset.block_shapes[0][0]
    step = max(1, round(STRIP_POSTS / (cols * block_rows))) * block_rows  # source rows = rows of the grid times factor
    for row in range(0, rows, step):
        count = min(step, rows - row)
        strip = Window(0, row * factor, window.width, min(count * factor, window.height - row * factor))
        dataset.read(1, window=strip, out=values[row : row + count])
        tell("reading", (row + count) / rows)
    return values


def _calibrate(dataset: Any, raster: Raster) -> None:
    """Fill in scale, offset and unit."""
    scale, offset = dataset.scales[0], dataset.offsets[0]
    if not (math.isfinite(scale) and math.isfinite(offset) and scale != 0):
        raster.notes.append(f"The file's scale {scale:g} and offset {offset:g} make no sense and were left out.")
    elif (scale, offset) != (1.0, 0.0):
        raster.notes.append(f"Heights are stored numbers times {scale:g} plus {offset:g}, as the file says.")
        raster.scale, raster.offset = scale, offset
    unit = (dataset.units[0] or "").strip()
    unit_m = _UNITS_M.get(unit.lower())
    if unit_m is None:
        raster.notes.append(f"The unit of height {unit!r} is unknown: metres were assumed.")
    elif not unit and raster.crs is not None:
        unit, unit_m = _vertical_unit(raster.crs)
    if unit_m not in (None, 1.0):
        raster.notes.append(f"Heights are in {unit} ({unit_m:.6g} m) and were converted to metres.")
        raster.unit_m = unit_m


def _vertical_unit(crs: Any) -> tuple[str, float]:
    """Unit of a compound CRS's vertical part, in WKT 1."""
    found = re.search(r'VERT_CS\[.*?UNIT\["([^"]*)",([0-9.eE+-]+)', crs.to_wkt(), re.DOTALL)
    return (found[1], float(found[2])) if found and 0 < float(found[2]) < 1e6 else ("", 1.0)
