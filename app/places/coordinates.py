"""Places in words and numbers: local metres, map coordinates, latitude and longitude.

Local metres count east and south from the north-west post. Map coordinates are those of the file's coordinate system,
in its own unit. Latitude and longitude are on WGS 84, and only known where the coordinate system says how to get there.
"""

from __future__ import annotations

import math
import re
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]
System = Literal["local", "map", "latlon"]
SYSTEMS: dict[System, str] = {
    "local": "local: metres east, south",
    "map": "map: x, y",
    "latlon": "latitude, longitude",
}
EXAMPLES: dict[System, str] = {
    "local": "1200, 3400", "map": "481200, 4205300", "latlon": "46.5763, 7.9905 or 46°34'35\"N 7°59'26\"E",
}  # fmt: skip
WGS84 = "EPSG:4326"
_WINDS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_ANGLE = re.compile(
    r"\s*(?P<sign>[-+]?)\s*(?P<degrees>\d+(?:\.\d*)?|\.\d+)\s*°?\s*(?:(?P<minutes>\d+(?:\.\d*)?)\s*['′]\s*)?"
    r"(?:(?P<seconds>\d+(?:\.\d*)?)\s*(?:\"|″|'')\s*)?(?P<wind>[NSEW]?)\s*[,;]?\s*",
    re.IGNORECASE,
)


class Place(NamedTuple):
    """A place of the terrain in all systems that are known."""

    local_m: tuple[float, float]
    map_xy: tuple[float, float] | None
    latlon_deg: tuple[float, float] | None


class Coordinates:
    """From and to the coordinates of one terrain.

    Parameters
    ----------
    heightfield : Heightfield
    """

    def __init__(self, heightfield: Heightfield) -> None:
        self._terrain = heightfield

    def place(self, x_m: float, z_m: float) -> Place:
        """A world place in all systems."""
        map_xy = self.to_map(x_m, z_m)
        latlon_deg = None if map_xy is None else self.to_latlon(*map_xy)
        return Place((x_m, z_m), _pair(map_xy), _pair(latlon_deg))

    def to_map(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> tuple[Floats, Floats] | None:
        """Map coordinates of world places of any shape; None where the terrain has none."""
        place, (dx, dz) = self._terrain.georeference, self._terrain.spacing_m
        if place is None:
            return None
        return place.to_map(np.asarray(x_m, np.float64) / dx, np.asarray(z_m, np.float64) / dz)

    def to_latlon(self, map_x: npt.ArrayLike, map_y: npt.ArrayLike) -> tuple[Floats, Floats] | None:
        """Latitudes and longitudes [degrees] of map coordinates; None where they are not known."""
        found = self._transform(np.asarray(map_x, np.float64), np.asarray(map_y, np.float64), inverse=False)
        return None if found is None else (found[1], found[0])

    @property
    def known(self) -> list[System]:
        """The systems a place can be given in."""
        systems: list[System] = ["local"]
        if self._terrain.georeference is not None:
            systems.append("map")
            if self._knows_latlon:
                systems.append("latlon")
        return systems

    @property
    def is_geographic(self) -> bool:
        """Whether map coordinates are degrees."""
        place = self._terrain.georeference
        return place is not None and place.geographic

    @cached_property
    def map_unit(self) -> str:
        """The unit of map coordinates, as an abbreviation."""
        place = self._terrain.georeference
        if place is None or place.geographic:
            return "" if place is None else "°"
        from rasterio.crs import CRS  # 128 ms to import
        from rasterio.errors import CRSError

        try:
            name = CRS.from_user_input(place.crs).linear_units
        except CRSError:
            return ""
        return {"metre": "m", "meter": "m", "foot": "ft", "US survey foot": "ft", "unknown": ""}.get(name, name)

    def read(self, text: str, system: System) -> tuple[float, float]:
        """The world place (x, z) that a text names.

        Raises
        ------
        InputError
            If it is no pair of numbers of that system, or lies beside the terrain.
        """
        if system == "latlon":
            x, z = self._from_latlon(*read_latlon(text))
        else:
            first, second = read_pair(text)
            x, z = (first, second) if system == "local" else self._from_map(first, second)
        width, depth = self._terrain.extent_m
        if not (-1e-6 * width <= x <= (1 + 1e-6) * width and -1e-6 * depth <= z <= (1 + 1e-6) * depth):
            raise InputError(f"{text.strip()} lies beside the terrain: {self._reach(system)}.")
        return min(max(x, 0.0), width), min(max(z, 0.0), depth)

    def _reach(self, system: System) -> str:
        """From where to where the terrain reaches, in a system."""
        width, depth = self._terrain.extent_m
        if system == "local":
            return f"expected 0 to {width:,.0f} m east and 0 to {depth:,.0f} m south"
        corners = [self.place(x, z) for x in (0.0, width) for z in (0.0, depth)]
        pairs = [corner.map_xy if system == "map" else corner.latlon_deg for corner in corners]
        (a0, a1), (b0, b1) = ((min(values), max(values)) for values in zip(*filter(None, pairs), strict=True))
        if system == "map":
            unit = self.map_unit
            return f"expected x from {a0:.6g} to {a1:.6g} {unit} and y from {b0:.6g} to {b1:.6g} {unit}"
        return f"expected latitudes from {a0:.4f} to {a1:.4f} and longitudes from {b0:.4f} to {b1:.4f} degrees"

    # Between world, map and the globe

    def _from_map(self, map_x: float, map_y: float) -> tuple[float, float]:
        place, (dx, dz) = self._terrain.georeference, self._terrain.spacing_m
        if place is None:
            raise InputError("This terrain does not say where it lies on the map: give local metres.")
        col, row = place.to_post(map_x, map_y)
        return float(col) * dx, float(row) * dz

    def _from_latlon(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        found = self._transform(np.array(longitude_deg), np.array(latitude_deg), inverse=True)
        if found is None:
            raise InputError("This terrain's coordinate system knows no latitudes: give map coordinates or metres.")
        return self._from_map(float(found[0]), float(found[1]))

    def _transform(self, x: Floats, y: Floats, inverse: bool) -> tuple[Floats, Floats] | None:
        """From map coordinates to longitudes and latitudes, or back; None where there is no way."""
        place = self._terrain.georeference
        if place is None:
            return None
        if place.crs == WGS84:
            return x, y
        from rasterio.warp import transform  # 128 ms to import

        ends = (WGS84, place.crs) if inverse else (place.crs, WGS84)
        try:
            to_x, to_y = (np.reshape(to, x.shape) for to in transform(*ends, x.ravel(), y.ravel()))
        except Exception:  # PROJ's own kinds of error: there is no way
            return None
        return (to_x, to_y) if np.isfinite(to_x).all() and np.isfinite(to_y).all() else None

    @cached_property
    def _knows_latlon(self) -> bool:
        width, depth = self._terrain.extent_m
        return self.place(width / 2, depth / 2).latlon_deg is not None


def read_pair(text: str) -> tuple[float, float]:
    """Two numbers, separated by a comma, a semicolon or space.

    Raises
    ------
    InputError
        If there are not two, or one is not finite.
    """
    words = [word for word in re.split(r"[,;\s]+", text.strip()) if word]
    try:
        first, second = map(float, words)
    except ValueError:
        raise InputError(f"Expected two numbers, such as {EXAMPLES['local']}, found {text.strip()!r}.") from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise InputError(f"Expected two finite numbers, found {text.strip()!r}.")
    return first, second


def read_latlon(text: str) -> tuple[float, float]:
    """Latitude and longitude [degrees]: as decimal numbers or degrees, minutes and seconds, with or without N S E W.

    Raises
    ------
    InputError
        If it is no such pair.
    """
    refusal = InputError(f"Expected latitude and longitude, such as {EXAMPLES['latlon']}, found {text.strip()!r}.")
    first = _ANGLE.match(text)
    second = _ANGLE.fullmatch(text, first.end()) if first else None
    if first is None or second is None:
        raise refusal
    winds = first["wind"].upper(), second["wind"].upper()
    values = [_degrees(angle) for angle in (first, second)]
    if winds[0] in ("E", "W"):
        winds, values = winds[::-1], values[::-1]
    if winds[0] not in ("", "N", "S") or winds[1] not in ("", "E", "W"):
        raise refusal
    latitude, longitude = values
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 360.0):
        raise refusal
    return latitude, longitude


def _pair(values: tuple[Floats, Floats] | None) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def _degrees(angle: re.Match[str]) -> float:
    value = float(angle["degrees"]) + float(angle["minutes"] or 0.0) / 60.0 + float(angle["seconds"] or 0.0) / 3600.0
    return -value if (angle["sign"] == "-") != (angle["wind"].upper() in ("S", "W")) else value


# In words


def metres(value: float) -> str:
    """A length for people: four figures or so, in metres or kilometres."""
    if abs(value) >= 10_000.0:
        return f"{value / 1000.0:,.2f} km"
    return f"{value:,.0f} m" if abs(value) >= 1000.0 else f"{value:,.1f} m"


def wind(aspect_deg: float | None) -> str:
    """A direction: ``"NW (312°)"``; ``"flat"`` where there is none."""
    if aspect_deg is None:
        return "flat"
    return f"{_WINDS[round(aspect_deg / 45.0) % 8]} ({aspect_deg:.0f}°)"


def latlon(latlon_deg: tuple[float, float]) -> str:
    """Latitude and longitude, to a metre."""
    (latitude, longitude) = latlon_deg
    north, east = "N" if latitude >= 0.0 else "S", "E" if longitude >= 0.0 else "W"
    return f"{abs(latitude):.5f}° {north}  {abs(longitude):.5f}° {east}"
