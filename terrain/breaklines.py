"""Breaklines: lines that the ground bends along or that people built over it, read from GeoJSON or CSV.

A line comes from the file in some map's coordinates and leaves as fractional posts of the terrain. GeoJSON counts as
longitude and latitude unless it names a coordinate system; a CSV says by its header what it holds: ``lon,lat`` or the
terrain's own ``x,y``, then perhaps a height ``z``, and perhaps a ``line`` that tells lines apart, as an empty row does.
Over a terrain that does not say where it lies, ``x`` and ``y`` are metres east and south of its north-west post.

A line whose points all have heights [m] is kept at them; any other lies on the surface.

**Source** the imported microstructures of J. Doellner, "Integrated multiresolution modeling of terrain geometry and
terrain texture data", section "Characteristics of hybrid terrain models"; GeoJSON is RFC 7946.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

LON_LAT = "EPSG:4326"
MOST_POINTS = 1_000_000
_HEIGHT_NAMES = ("z", "height", "height_m", "elevation", "h")
_LINE_NAMES = ("line", "id", "name")


@dataclass(frozen=True, eq=False)
class Breaklines:
    """Lines over a terrain.

    Attributes
    ----------
    lines : tuple of ndarray of float64, (n, 3)
        Column and row in fractional posts, and the height [m] of each point of a line; the heights of a line are all
        NaN where it lies on the surface. Lines may leave the grid.
    name : str
    notes : tuple of str
        What was decided while reading, one sentence each.
    """

    lines: tuple[Floats, ...]
    name: str = "breaklines"
    notes: tuple[str, ...] = ()

    def scaled(self, factor: float) -> Breaklines:
        """The same lines over the same terrain with heights times ``factor``."""
        return Breaklines(tuple(line * [1.0, 1.0, factor] for line in self.lines), self.name, self.notes)


def read_breaklines(path: str | Path, heightfield: Heightfield) -> Breaklines:
    """The lines of a GeoJSON or CSV file over ``heightfield``.

    Raises
    ------
    InputError
        If the file is neither, holds no line, or no line touches the terrain.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"Expected breaklines in {path}, which cannot be read ({error.strerror or error}).") from None
    except UnicodeDecodeError:
        raise InputError(f"Expected GeoJSON or CSV in {path.name}, found a file that is no UTF-8 text.") from None
    is_json = text.lstrip()[:1] in ("{", "[")
    lines, crs = _read_geojson(text, path.name) if is_json else _read_csv(text, path.name)
    notes = []
    if short := sum(len(line) < 2 for line in lines):
        notes.append(f"{short} of {len(lines)} lines have fewer than two points and were left out.")
    lines = [line for line in lines if len(line) >= 2]
    if not lines:
        raise InputError(f"Expected lines of two points or more in {path.name}, found none.")
    if (points := sum(map(len, lines))) > MOST_POINTS:
        raise InputError(
            f"Expected at most {MOST_POINTS:,} points in {path.name}, found {points:,}: simplify it first."
        )
    placed = [part for line in _to_posts(lines, crs, heightfield, path.name) for part in _parts(line)]
    inside = [line for line in placed if _touches(line, heightfield)]
    if not inside:
        raise InputError(f"{path.name} lies beside the terrain: none of its {len(lines)} lines touches it.")
    if len(inside) < len(placed):
        notes.append(f"{len(placed) - len(inside)} of {len(placed)} lines lie beside the terrain.")
    draped = sum(bool(np.isnan(line[:, 2]).any()) for line in inside)
    if 0 < draped < len(inside):
        notes.append(f"{draped} of {len(inside)} lines have no heights and lie on the surface.")
    return Breaklines(tuple(inside), path.name, tuple(notes))


def _read_geojson(text: str, name: str) -> tuple[list[Floats], str | None]:
    """Lines (n, 3) in map coordinates and their coordinate system."""
    try:
        record = json.loads(text)
        crs = LON_LAT
        if isinstance(record, dict) and record.get("crs") is not None:  # of 2008; RFC 7946 knows lon and lat only
            crs = str(record["crs"]["properties"]["name"])
        lines = [_points(line, name) for line in _coordinates(record)]
    except json.JSONDecodeError as error:
        reason = f"{error.msg} in line {error.lineno}"
        raise InputError(f"Expected GeoJSON in {name}, which is no JSON ({reason}).") from None
    except RecursionError:
        raise InputError(f"Expected GeoJSON in {name}, found too many levels of nesting.") from None
    except (KeyError, TypeError):
        raise InputError(f'Expected a GeoJSON "crs" with properties and a name in {name}.') from None
    return lines, crs


def _coordinates(record: Any) -> Iterator[Any]:
    """The coordinate lists of all lines and rings in a GeoJSON object."""
    if not isinstance(record, dict):
        return
    kind, inside = record.get("type"), record.get("coordinates")
    children = record.get("features" if kind == "FeatureCollection" else "geometries")
    if kind == "Feature":
        yield from _coordinates(record.get("geometry"))
    elif kind in ("FeatureCollection", "GeometryCollection") and isinstance(children, list):
        for child in children:
            yield from _coordinates(child)
    elif kind == "LineString":
        yield inside
    elif kind in ("MultiLineString", "Polygon") and isinstance(inside, list):
        yield from inside
    elif kind == "MultiPolygon" and isinstance(inside, list):
        for polygon in inside:
            yield from polygon if isinstance(polygon, list) else ()


def _points(line: Any, name: str) -> Floats:
    """Points (n, 3) of one list of coordinates; without heights for all, NaN."""
    if not isinstance(line, list):
        raise InputError(f"Expected a list of points in {name}, found {str(line)[:40]!r}.")
    for point in line:
        is_place = isinstance(point, list) and len(point) >= 2 and all(type(v) in (int, float) for v in point[:3])
        if not is_place or not np.isfinite(np.array(point[:3], np.float64)).all():
            raise InputError(f"Expected points as [x, y] or [x, y, z] in {name}, found {str(point)[:40]!r}.")
    points = np.array([(*point[:2], point[2] if len(point) > 2 else np.nan) for point in line], np.float64)
    return _with_heights_or_none(points.reshape(-1, 3))


def _with_heights_or_none(points: Floats) -> Floats:
    if np.isnan(points[:, 2]).any():
        points[:, 2] = np.nan
    return points


def _read_csv(text: str, name: str) -> tuple[list[Floats], str | None]:
    """Lines (n, 3) in map coordinates and their coordinate system: None for the terrain's own."""
    try:
        dialect: Any = csv.Sniffer().sniff(text[:4096], ",;\t ")
    except csv.Error:
        dialect = csv.excel
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), dialect)]
    except csv.Error as error:
        raise InputError(f"Expected GeoJSON or CSV in {name}, which cannot be read as CSV ({error}).") from None
    filled = [row for row in rows if any(row)]
    if not filled:
        raise InputError(f"Expected GeoJSON or CSV in {name}, found an empty file.")
    header = [cell.lower() for cell in filled[0]]
    has_header = not _is_number(header[0])
    x, y, crs = _place_columns(header, name) if has_header else (0, 1, None)
    z = next((header.index(n) for n in _HEIGHT_NAMES if n in header), None) if has_header else 2
    tell = next((header.index(n) for n in _LINE_NAMES if n in header), None) if has_header else None
    lines: list[list[tuple[float, float, float]]] = [[]]
    last = None
    for number, row in enumerate(rows, 1):
        if row is filled[0] and has_header:
            continue
        which = row[tell] if tell is not None and tell < len(row) else None
        if not any(row) or which != last:
            lines.append([])
        last = which
        if any(row):
            lines[-1].append(_csv_point(row, (x, y, z), f"{name}, line {number}"))
    found = [np.array(line, np.float64).reshape(-1, 3) for line in lines if line]
    return [_with_heights_or_none(line) for line in found], crs


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _place_columns(header: list[str], name: str) -> tuple[int, int, str | None]:
    """Which columns say where a point lies, and in what coordinates."""
    for names, crs in (
        (("lon", "lat"), LON_LAT), (("longitude", "latitude"), LON_LAT), (("lng", "lat"), LON_LAT),
        (("x", "y"), None), (("easting", "northing"), None),
    ):  # fmt: skip
        if all(n in header for n in names):
            return header.index(names[0]), header.index(names[1]), crs
    raise InputError(f"Expected a header with x,y or lon,lat in {name}, found {','.join(header)[:60]!r}.")


def _csv_point(row: list[str], columns: tuple[int, int, int | None], where: str) -> tuple[float, float, float]:
    x, y, z = columns
    try:
        height = row[z] if z is not None and z < len(row) else ""
        point = float(row[x]), float(row[y]), float(height) if height else np.nan
    except (ValueError, IndexError):
        raise InputError(f"Expected numbers x,y or x,y,z ({where}), found {','.join(row)[:60]!r}.") from None
    if not np.isfinite(point[:2]).all() or np.isinf(point[2]):
        raise InputError(f"Expected finite numbers ({where}), found {','.join(row)[:60]!r}.")
    return point


def _to_posts(lines: list[Floats], crs: str | None, heightfield: Heightfield, name: str) -> list[Floats]:
    """Lines in fractional posts; where they have no place there, NaN."""
    place = heightfield.georeference
    if place is None:
        if crs is not None:
            raise InputError(f"{name} is in {crs}, and the terrain does not say where it lies: give x,y in a CSV.")
        return [line / [heightfield.spacing_m[0], heightfield.spacing_m[1], 1.0] for line in lines]
    maps = lines if crs is None else _transformed(lines, crs, place.crs, name)
    with np.errstate(invalid="ignore"):
        return [np.column_stack([*place.to_post(line[:, 0], line[:, 1]), line[:, 2]]) for line in maps]


def _transformed(lines: list[Floats], crs: str, into: str, name: str) -> list[Floats]:
    """Lines in another coordinate system; NaN where a line leaves its domain."""
    import rasterio  # 128 ms to import
    from rasterio.crs import CRS
    from rasterio.errors import CRSError
    from rasterio.warp import transform

    def move(points: Floats) -> Floats:
        return np.column_stack([*transform(source, target, points[:, 0], points[:, 1]), points[:, 2]])

    with rasterio.Env():  # or GDAL prints what it then raises
        try:
            source, target = CRS.from_user_input(crs), CRS.from_user_input(into)
        except CRSError as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{name}: {crs} cannot be brought to the terrain's coordinates ({reason}).") from None
        if source == target:
            return lines
        try:
            return np.split(move(np.concatenate(lines)), np.cumsum([len(line) for line in lines])[:-1])
        except Exception:  # GDAL's own errors, which have no public name: a point outside the projection's domain
            moved = []
            for line in lines:
                try:
                    moved.append(move(line))
                except Exception:
                    moved.append(np.full_like(line, np.nan))
            return moved


def _parts(line: Floats) -> list[Floats]:
    """The line without points that repeat the one before, in as many parts as points without a place make of it."""
    whole = np.isfinite(line[:, :2]).all(axis=1)
    parts = np.split(line, np.flatnonzero(np.diff(whole)) + 1)
    parts = [part for part in parts if np.isfinite(part[0, :2]).all()]
    fresh = [part[np.r_[True, (np.diff(part[:, :2], axis=0) != 0).any(axis=1)]] for part in parts]
    return [part for part in fresh if len(part) >= 2]


def _touches(line: Floats, heightfield: Heightfield) -> bool:
    """Whether the bounding box of the line meets the grid."""
    low, high = line[:, :2].min(axis=0), line[:, :2].max(axis=0)
    return bool((high >= 0).all() and low[0] <= heightfield.cols - 1 and low[1] <= heightfield.rows - 1)
