"""Numbers without a georeference -> `Raster`: ``.npy``, ``.npz``, bare ``.r16``/``.r32``, and the JSON beside a file.

The JSON (``NAME.json`` for ``NAME.r16``, ``NAME_anything.r16`` or a grey ``NAME.png``) may say ``width``, ``height``,
``dtype``, ``endian`` ("little", "big"), ``spacing_m`` (or ``pixel_m_approx``; one number or [x, z]), and ``min_m`` with
``max_m``: what the least and the greatest number of an integer type stand for.

Arrays are never unpickled, and a header cannot claim more than the file holds.
"""

from __future__ import annotations

import json
import math
import re
import sys
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, TypeGuard

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.files.raster import MAX_DECODED_BYTES, Raster, reduction, reduction_note
from terrain.files.unpack import unpack_member

Endian = Literal["<", ">"]

RAW_SUFFIXES = {".r16": "uint16", ".r32": "float32", ".raw": None}
_NUMBERS = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float16", "float32", "float64")
_BY_SIZE = {1: "uint8", 2: "uint16", 4: "float32", 8: "float64"}
_ENDIANS: dict[str, Endian] = {"little": "<", "le": "<", "big": ">", "be": ">"}
_HELP = "give --raw WxH[,dtype,endian], for example --raw 1025x1025,uint16,little"


@dataclass(frozen=True)
class Stored:
    """A grid of numbers inside a file."""

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, int]
    offset: int = 0
    transposed: bool = False


def read_npy(path: Path) -> Raster:
    """Read a two-dimensional array, row 0 north."""
    with path.open("rb") as file:
        try:
            shape, transposed, dtype = _npy_header(file)
        except (ValueError, TypeError, SyntaxError, EOFError, RecursionError, MemoryError) as error:
            raise InputError(
                f"expected an array of numbers in {path.name}, found something else ({error}); "
                "write it with numpy.save(path, heights)"
            ) from error
        offset = file.tell()
    if len(shape) == 3 and shape[0] == 1:
        shape = shape[1:]
    if len(shape) != 2 or dtype.kind not in "iuf":
        raise InputError(
            f"expected a two-dimensional array of numbers in {path.name}, found {dtype} of shape {shape}; "
            "write the heights alone: numpy.save(path, heights)"
        )
    size, claimed = path.stat().st_size, offset + shape[0] * shape[1] * dtype.itemsize
    if claimed > size:
        raise InputError(f"expected {claimed} bytes in {path.name}, found {size}; get a fresh copy of the file")
    return _raster(Stored(path, dtype, (shape[0], shape[1]), offset, transposed), [])


def _npy_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, Fortran order and type. The header is parsed as a literal: nothing is executed."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, transposed, dtype = read(file)
    return tuple(shape), transposed, dtype


def read_npz(path: Path) -> Raster:
    """Read the only two-dimensional array of an ``.npz``."""
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory(prefix="reliefscope-") as folder:
            grids = [name for name in archive.namelist()[:1000] if _is_grid(archive, name)]
            if len(grids) != 1:
                found = ", ".join(name.removesuffix(".npy") for name in grids[:6]) or "none"
                raise InputError(
                    f"expected exactly one two-dimensional array in {path.name}, found {found}; "
                    "write the heights alone with numpy.save"
                )
            raster = read_npy(unpack_member(archive, grids[0], Path(folder), path))
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise InputError(f"expected an intact .npz file, found {path.name} ({error}); get a fresh copy") from error
    raster.notes.append(f"The array {grids[0].removesuffix('.npy')!r} was taken as heights.")
    return raster


def _is_grid(archive: zipfile.ZipFile, name: str) -> bool:
    """Whether an entry's header promises a grid of numbers."""
    with archive.open(name) as stream:
        try:
            shape, _, dtype = _npy_header(stream)
        except (ValueError, TypeError, SyntaxError):
            return False
    return len(shape) == 2 and min(shape) > 1 and dtype.kind in "iuf"


def read_raw(path: Path, layout: str | None) -> Raster:
    """Read bare numbers, row 0 north.

    Parameters
    ----------
    path : Path
    layout : str or None
        ``"WxH[,dtype][,endian]"``; None looks for the JSON, or takes an ``.r16``/``.r32`` of fitting size as square.

    Raises
    ------
    InputError
        If the layout makes no sense or does not fit the file's size.
    """
    size = path.stat().st_size
    notes: list[str] = []
    beside = {} if layout else read_beside(path)
    cols, rows, dtype, endian = _parse(layout) if layout else _layout_beside(beside, path)
    dtype = dtype or RAW_SUFFIXES.get(path.suffix.lower())
    if cols and rows and not dtype:
        dtype = _BY_SIZE.get(size // (cols * rows))
    if not (cols and rows) and dtype:
        side = math.isqrt(size // np.dtype(dtype).itemsize)
        if side >= 2 and side * side * np.dtype(dtype).itemsize == size:
            cols = rows = side
            notes.append(f"{size} bytes were taken as {side} x {side} numbers of type {dtype}.")
    if not (cols and rows and dtype):
        raise InputError(f"expected a width, height and type for the {size} bytes of {path.name}, found none; {_HELP}")
    kind = np.dtype(dtype)
    if cols * rows * kind.itemsize != size:
        raise InputError(
            f"expected {cols * rows * kind.itemsize} bytes for {cols} x {rows} {dtype} in {path.name}, "
            f"found {size}; {_HELP}"
        )
    if endian is None and kind.itemsize > 1:
        endian = _smoother_endian(Stored(path, kind, (rows, cols)), notes)
    return _raster(Stored(path, kind.newbyteorder(endian or "="), (rows, cols)), notes)


def _parse(layout: str) -> tuple[int, int, str | None, Endian | None]:
    size, *words = (word.strip().lower() for word in layout.split(","))
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", size)
    dtypes = [word for word in words if word in _NUMBERS]
    endians = [_ENDIANS[word] for word in words if word in _ENDIANS]
    if not match or len(dtypes) + len(endians) != len(words) or len(dtypes) > 1 or len(endians) > 1:
        raise InputError(
            f"expected --raw WxH[,dtype][,endian] with a dtype of {', '.join(_NUMBERS)} and an endian of little, big, "
            f"found {layout!r}; for example 1025x1025,uint16,little"
        )
    return int(match[1]), int(match[2]), dtypes[0] if dtypes else None, endians[0] if endians else None


def _smoother_endian(stored: Stored, notes: list[str]) -> Endian:
    """The byte order in which neighbours differ least: the wrong one turns a step of 1 into one of 256."""
    with stored.path.open("rb") as file:
        file.seek(stored.shape[0] // 2 * stored.shape[1] * stored.dtype.itemsize)
        sample = np.fromfile(file, stored.dtype, min(1 << 18, stored.shape[0] // 2 * stored.shape[1]))

    def roughness(order: Endian) -> float:
        numbers = sample.view(sample.dtype.newbyteorder(order)).astype(np.float64)
        with np.errstate(all="ignore"):
            steps = np.abs(np.diff(numbers))
            if sample.dtype.kind == "f":  # swapped floats lie anywhere between 1e-38 and 1e38
                return float(np.median(steps) / np.median(np.abs(numbers - np.median(numbers))))
            return float(steps.mean())

    name = "big" if not roughness("<") <= roughness(">") else "little"
    notes.append(f"Byte order {name}-endian: the smoother of the two readings.")
    return _ENDIANS[name]


def _raster(stored: Stored, notes: list[str]) -> Raster:
    rows, cols = stored.shape
    factor = reduction(cols, rows)
    if min(-(-rows // factor), -(-cols // factor)) < 2:
        raise InputError(
            f"expected a grid of at least 2 x 2 posts in {stored.path.name}, found {cols} x {rows}; give another"
        )
    if rows * cols * stored.dtype.itemsize // factor > MAX_DECODED_BYTES:
        raise InputError(
            f"expected at most {MAX_DECODED_BYTES >> 20} MB to be read from {stored.path.name}, found {cols} x {rows} "
            f"{stored.dtype}; crop it, or write a GeoTIFF with overviews (gdaladdo)"
        )
    if factor > 1:
        notes.append(reduction_note(cols, rows, factor))
    values = _thinned(stored, (cols, rows) if stored.transposed else (rows, cols), factor)
    if stored.transposed:
        values = values.T.copy()
    return Raster(values, factor=factor, stored=stored.dtype, notes=notes)


def _thinned(stored: Stored, shape: tuple[int, int], factor: int) -> npt.NDArray[np.float32]:
    """One number in ``factor`` along each side. Only rows that are needed are read: memory stays small."""
    rows, cols = shape
    row_bytes = cols * stored.dtype.itemsize
    at_once = max(1, (16 << 20) // row_bytes) if factor == 1 else 1
    thin = np.empty((-(-rows // factor), -(-cols // factor)), np.float32)
    buffer = np.empty((at_once, cols), stored.dtype)
    with stored.path.open("rb") as file:
        for row in range(0, rows, at_once * factor):
            file.seek(stored.offset + row * row_bytes)
            band = buffer[: rows - row]
            file.readinto(band.view(np.uint8).data)  # np.fromfile takes 20 times as long where files have gaps
            with np.errstate(over="ignore", invalid="ignore"):  # a double beyond float32 becomes infinite, a hole
                thin[row // factor : row // factor + len(band)] = band[:, ::factor]
    return thin


def read_beside(path: Path) -> dict[str, Any]:
    """What the JSON beside a file says; empty where there is none."""
    stems = [path.name, path.stem, *(path.stem[: match.start()] for match in re.finditer(r"[_.-]", path.stem))]
    for stem in (*stems[:2], *reversed(stems[2:])):
        candidate = path.with_name(stem + ".json") if stem else None
        if candidate is None or not candidate.is_file() or candidate.stat().st_size > 1 << 16:
            continue
        try:
            found = json.loads(candidate.read_text(encoding="utf-8"))
        except (ValueError, OSError, RecursionError):
            continue
        keys = {"width", "height", "dtype", "endian", "min_m", "max_m", "spacing_m", "pixel_m_approx"}
        if isinstance(found, dict) and keys & found.keys():
            return {"file": candidate.name, **{key: found[key] for key in keys & found.keys()}}
    return {}


def _layout_beside(beside: dict[str, Any], path: Path) -> tuple[int, int, str | None, Endian | None]:
    cols, rows = beside.get("width", 0), beside.get("height", 0)
    dtype, endian = beside.get("dtype"), beside.get("endian")
    if not (isinstance(cols, int) and isinstance(rows, int) and 0 <= cols < 10**9 and 0 <= rows < 10**9):
        raise InputError(f"expected a width and height in {beside['file']}, found {cols!r} x {rows!r}; {_HELP}")
    if not (dtype is None or dtype in _NUMBERS) or not (endian is None or endian in _ENDIANS):
        raise InputError(f"expected a dtype and endian in {beside['file']}, found {dtype!r}, {endian!r}; {_HELP}")
    return cols, rows, dtype, _ENDIANS[endian] if endian else None


def apply_beside(raster: Raster, beside: dict[str, Any]) -> None:
    """Set a raster's heights and spacing as the JSON beside it says."""
    low, high, kind = beside.get("min_m"), beside.get("max_m"), raster.stored
    if kind is not None and kind.kind in "iu" and _number(low) and _number(high) and low < high:
        limits = np.iinfo(kind)
        raster.scale = (high - low) / (int(limits.max) - int(limits.min))
        raster.offset = low - int(limits.min) * raster.scale
        raster.notes.append(f"{beside['file']} says that {kind} stands for {low:g} to {high:g} m.")
    spacing = beside.get("spacing_m", beside.get("pixel_m_approx"))
    pair = [length for length in (spacing if isinstance(spacing, list) else [spacing] * 2) if _number(length)]
    if len(pair) == 2 and min(pair) >= 1e-4 and max(pair) <= 1e6:
        raster.spacing_m = float(pair[0]), float(pair[1])
        raster.notes.append(f"{beside['file']} says that posts are {pair[0]:g} x {pair[1]:g} m apart.")


def _number(value: Any) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < sys.float_info.max
