"""Track files -> `Track`: GPX, KML and CSV as they come, nothing placed on a terrain yet.

The files come from anywhere. XML is read as a stream, element by element; a document type, and with it every entity,
is refused, and so are files, depths and numbers of points beyond what a track needs.

**Source** GPX 1.1 (topografix.com/GPX/1/1), OGC KML 2.3 with the gx extensions for tracks and tours.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal
from xml.parsers import expat

from terrain.errors import InputError

TRACK_SUFFIXES = (".gpx", ".kml", ".csv")
MAX_BYTES, MAX_POINTS, MAX_DEPTH = 64 << 20, 500_000, 100
Axes = Literal["geographic", "map", "world"]


@dataclass
class Point:
    """One point: longitude, latitude and height; easting, northing and height; or x, y (up) and z, by the axes."""

    place: tuple[float, float, float]  # NaN where the file gives no height
    t_s: float | None = None
    angles_deg: tuple[float, float, float] | None = None  # yaw from true north, pitch, roll
    fov_deg: float | None = None


@dataclass
class Track:
    """What a file holds, before it becomes a flight."""

    name: str
    axes: Axes = "geographic"
    points: list[Point] = field(default_factory=list)
    above_ground: bool = False  # heights count from the ground


def read_track_file(path: Path) -> Track:
    """Read a track.

    Raises
    ------
    InputError
        If it is none, or more than a track may be.
    """
    suffix = path.suffix.lower()
    if suffix not in TRACK_SUFFIXES:
        raise InputError(f"Expected a track as {', '.join(TRACK_SUFFIXES)}, found {path.name}.")
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"Expected a track of at most {MAX_BYTES >> 20} MB, found {size >> 20} MB in {path.name}.")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    try:
        track = _read_csv(path, data) if suffix == ".csv" else _read_xml(path, data)
    except ValueError as error:
        raise InputError(f"{path.name} is no usable track: {' '.join(str(error).split())}.") from None
    if len(track.points) < 2:
        raise InputError(f"Expected at least 2 points in {path.name}, found {len(track.points)}.")
    return track


# XML


class _Reader:
    """Follows a document and hands every closed element to a function, with its text and attributes."""

    def __init__(self, closed: Callable[[list[str], str, dict[str, str]], None]) -> None:
        self._closed = closed
        self._open: list[str] = []
        self._text: list[str] = []
        self._attributes: list[dict[str, str]] = []
        parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = self._refuse
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.CharacterDataHandler = self._text.append
        self._parser = parser

    def read(self, data: bytes) -> None:
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            raise ValueError(f"expected XML, found {expat.ErrorString(error.code)} in line {error.lineno}") from None

    def _refuse(self, *_: object) -> None:
        raise ValueError("a document type was found, which no track needs; remove it")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self._open) >= MAX_DEPTH:
            raise ValueError(f"elements are nested more than {MAX_DEPTH} deep")
        self._open.append(name.rpartition(":")[2])
        self._attributes.append(attributes)
        self._text.clear()

    def _end(self, _: str) -> None:
        self._closed(self._open, "".join(self._text).strip(), self._attributes.pop())
        self._open.pop()
        self._text.clear()


def _read_xml(path: Path, data: bytes) -> Track:
    finder: _GpxFinder | _KmlFinder = _GpxFinder() if path.suffix.lower() == ".gpx" else _KmlFinder()
    _Reader(finder.take).read(data)
    return finder.track(path.stem)


class _GpxFinder:
    """Points of all tracks; without tracks those of routes, without routes the waypoints."""

    def __init__(self) -> None:
        self._points: dict[str, list[Point]] = {"trkpt": [], "rtept": [], "wpt": []}
        self._height_m = math.nan
        self._t_s: float | None = None
        self._name = ""

    def take(self, path: list[str], text: str, attributes: dict[str, str]) -> None:
        tag, parent = path[-1], path[-2] if len(path) > 1 else ""
        if tag in self._points:
            place = _number(attributes.get("lon"), "longitude"), _number(attributes.get("lat"), "latitude")
            _add(self._points[tag], Point((*_checked(*place), self._height_m), self._t_s))
            self._height_m, self._t_s = math.nan, None
        elif parent in self._points and tag == "ele":
            self._height_m = _number(text, "height")
        elif parent in self._points and tag == "time":
            self._t_s = _seconds(text)
        elif tag == "name" and parent in ("trk", "rte", "metadata"):
            self._name = self._name or text

    def track(self, name: str) -> Track:
        return Track(self._name or name, points=next((p for p in self._points.values() if p), []))


class _KmlFinder:
    """The first tour; without one the first ``gx:Track``; without one the longest line."""

    def __init__(self) -> None:
        self._tour: list[Point] = []
        self._tracks: list[Point] = []
        self._line: list[Point] = []
        self._modes = {"tour": "absolute", "track": "clampToGround", "line": "clampToGround"}
        self._values: dict[str, str] = {}
        self._when: list[float | None] = []
        self._where: list[tuple[float, float, float]] = []
        self._t_s, self._mode, self._name, self._tours = 0.0, "", "", 0

    def take(self, path: list[str], text: str, attributes: dict[str, str]) -> None:
        tag, parents = path[-1], path[:-1]
        if tag == "name" and not self._name:
            self._name = text
        elif "Tour" in parents and self._tours == 0:
            self._take_tour(tag, text)
        elif tag == "Tour":
            self._tours += 1
        elif tag == "altitudeMode":
            self._mode = text
        elif tag == "when":
            self._when.append(_seconds(text))
        elif tag == "coord":
            self._where.append(_triple(text.split()))
        elif tag == "Track":
            self._take_track()
        elif tag == "coordinates" and parents and parents[-1] == "LineString":
            points = [Point(_triple(word.split(","))) for word in text.split()]
            if len(points) > len(self._line):
                _limit(len(points))
                self._line = points
        elif tag == "LineString":
            self._modes["line"], self._mode = self._mode or "clampToGround", ""

    def _take_tour(self, tag: str, text: str) -> None:
        if tag != "FlyTo":
            if text:
                self._values[tag] = text
            return
        values, self._values = self._values, {}
        self._t_s += max(_number(values.get("duration", "0"), "duration"), 0.0)
        if "tilt" not in values or "range" in values:  # a LookAt: its place is not the eye's
            return
        place = _triple([values.get(key, "0") for key in ("longitude", "latitude", "altitude")])
        heading, tilt, roll = (_number(values.get(key, "0"), key) for key in ("heading", "tilt", "roll"))
        fov = _number(values["fov"], "field of view") if "fov" in values else None
        self._modes["tour"] = values.get("altitudeMode", "clampToGround")
        _add(self._tour, Point(place, self._t_s, (heading, tilt - 90.0, -roll), fov))

    def _take_track(self) -> None:
        if not self._tracks:
            when = self._when if len(self._when) == len(self._where) else [None] * len(self._where)
            _limit(len(self._where))
            self._tracks = [Point(place, t_s) for place, t_s in zip(self._where, when, strict=True)]
            self._modes["track"] = self._mode or "clampToGround"
        self._when, self._where, self._mode = [], [], ""

    def track(self, name: str) -> Track:
        found = {"tour": self._tour, "track": self._tracks, "line": self._line}
        kind = next((kind for kind, points in found.items() if points), "line")
        points, mode = found[kind], self._modes[kind]
        if "clamp" in mode.lower():  # heights mean nothing
            points = [Point((*p.place[:2], math.nan), p.t_s, p.angles_deg, p.fov_deg) for p in points]
        return Track(self._name or name, points=points, above_ground="relative" in mode.lower())


# CSV

_COLUMNS = {
    "lon": ("lon", "long", "longitude", "lng"),
    "lat": ("lat", "latitude"),
    "easting": ("easting", "east", "e"),
    "northing": ("northing", "north", "n"),
    "height": ("height", "ele", "elevation", "alt", "altitude", "h"),
    "x": ("x",), "y": ("y",), "z": ("z",),
    "t": ("t", "time", "seconds", "timestamp"),
    "yaw": ("yaw", "heading"), "pitch": ("pitch",), "roll": ("roll",), "fov": ("fov",),
}  # fmt: skip


def _read_csv(path: Path, data: bytes) -> Track:
    text = data.decode("utf-8-sig", errors="strict")
    first = text.partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    rows = csv.reader(text.splitlines(), delimiter=delimiter)
    header = [cell.strip().lower().partition("[")[0].partition("(")[0].strip() for cell in next(rows, [])]
    at = {name: header.index(word) for name, words in _COLUMNS.items() for word in words if word in header}
    axes, names = _csv_axes(at)
    track = Track(path.stem, axes)
    for number, row in enumerate(rows, 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) < len(header):
            raise ValueError(f"expected {len(header)} columns in line {number}, found {len(row)}")
        try:
            cell = {name: row[index].strip() for name, index in at.items()}
            a, b = (_number(cell[name], name) for name in names[:2])
            c = _number(cell[names[2]], "height") if len(names) > 2 and cell[names[2]] else math.nan
            place = (*_checked(a, b), c) if axes == "geographic" else (a, b, c)
            angles = tuple(_number(cell.get(name) or "0", name) for name in ("yaw", "pitch", "roll"))
            fov = _number(cell["fov"], "field of view") if cell.get("fov") else None
            point = Point(place, _seconds(cell["t"]) if cell.get("t") else None, None, fov)
            if "yaw" in at:
                point.angles_deg = (angles[0], angles[1], angles[2])
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
        _add(track.points, point)
    return track


def _csv_axes(at: dict[str, int]) -> tuple[Axes, list[str]]:
    """What the columns mean, and those of the place."""
    height = ["height"] if "height" in at else ["z"] if "z" in at else []
    if "lon" in at and "lat" in at:
        return "geographic", ["lon", "lat", *height]
    if "easting" in at and "northing" in at:
        return "map", ["easting", "northing", *height]
    if all(name in at for name in "xyz"):
        return "world", ["x", "y", "z"]
    raise ValueError(
        "expected a first line that names the columns: lon, lat and height; easting, northing and height; or x, y, z "
        "in metres of the terrain (east, up, south); and t where there are times"
    )


def _number(text: str | None, what: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"expected a number for the {what}, found {text!r:.40}")
    return value


def _checked(lon_deg: float, lat_deg: float) -> tuple[float, float]:
    if not (-180.0 <= lon_deg <= 360.0 and -90.0 <= lat_deg <= 90.0):
        raise ValueError(f"expected a longitude and a latitude in degrees, found {lon_deg:g}, {lat_deg:g}")
    return lon_deg, lat_deg


def _triple(words: list[str]) -> tuple[float, float, float]:
    """Longitude, latitude, and height where there is one."""
    if len(words) not in (2, 3):
        raise ValueError(f"expected longitude, latitude and height, found {' '.join(words)!r:.60}")
    lon, lat = _checked(_number(words[0], "longitude"), _number(words[1], "latitude"))
    return lon, lat, _number(words[2], "height") if len(words) == 3 else math.nan


def _seconds(text: str) -> float | None:
    """Seconds on any clock: a number, or ISO 8601; None where it is neither."""
    try:
        value = float(text)
        return value if math.isfinite(value) else None
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(text.strip().replace("Z", "+00:00"))
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _add(points: list[Point], point: Point) -> None:
    _limit(len(points) + 1)
    points.append(point)


def _limit(count: int) -> None:
    if count > MAX_POINTS:
        raise ValueError(f"it has more than {MAX_POINTS} points; thin it out")
