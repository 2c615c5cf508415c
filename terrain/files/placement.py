"""From a file's transform and coordinate system to the world frame: spacing in metres, north at the top.

Degrees become metres at one scale for the whole grid, that of the ellipsoid at the centre latitude: posts are never
resampled. Grids that lie rotated stay on their own axes; `Georeference` remembers where those point.

**Source** radii of curvature: Snyder, *Map Projections*, USGS PP 1395 (1987), equations 4-18 and 4-20.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.heightfield import Georeference

Transform = tuple[float, float, float, float, float, float]

DEFAULT_SPACING_M = 30.0
_NARROWEST_M, _WIDEST_M = 1e-4, 1e6
_SHEAR = 0.02
"""Largest cosine between rows and columns that still counts as a right angle (about one degree)."""
_WGS84 = (6378137.0, 1 / 298.257223563)
_DEGREES = ("degree", math.pi / 180)


@dataclass(frozen=True)
class Placement:
    """How a grid lies in the world.

    Attributes
    ----------
    spacing_m : tuple of float
        ``(dx, dz)``.
    georeference : Georeference or None
        None where the file names no coordinate system.
    flip_rows, flip_cols : bool
        Whether the stored order runs the other way (south-up, or from east to west).
    """

    spacing_m: tuple[float, float]
    georeference: Georeference | None = None
    flip_rows: bool = False
    flip_cols: bool = False


def place(
    shape: tuple[int, int], map_from_pixel: Transform, crs: Any, notes: list[str], spacing_m: float | None = None
) -> Placement:
    """Place a grid.

    Parameters
    ----------
    shape : tuple of int
        ``(rows, cols)``.
    map_from_pixel : tuple of 6 float
        ``(a, b, c, d, e, f)`` at pixel corners: ``x = a col + b row + c``, ``y = d col + e row + f``.
    crs : rasterio.crs.CRS or None
    notes : list of str
        What was decided is added.
    spacing_m : float, optional
        Overrides the file's own.

    Raises
    ------
    InputError
        If the transform shears, or makes no sense.
    """
    rows, cols = shape
    a, b, c, d, e, f = map_from_pixel
    if not all(map(math.isfinite, map_from_pixel)) or a * e - b * d == 0:
        raise InputError(
            f"expected posts that span a map, found the transform {_numbers(map_from_pixel)}; "
            "correct the file's georeference (gdal_edit.py -a_ullr)"
        )
    flip_cols = a < 0 and abs(a) >= abs(d)
    if flip_cols:
        a, c, d, f = -a, c + a * cols, -d, f + d * cols
        notes.append("Columns ran from east to west and were turned round.")
    flip_rows = a * e - b * d > 0  # north is up where rows run clockwise from columns
    if flip_rows:
        b, c, e, f = -b, c + b * rows, -e, f + e * rows
        notes.append("Rows ran from south to north and were turned round.")
    map_from_post = (a, b, c + (a + b) / 2, d, e, f + (d + e) / 2)
    y = d * (cols - 1) / 2 + e * (rows - 1) / 2 + map_from_post[5]  # of the grid's centre
    degrees = _angle_unit(crs, map_from_post, shape, notes)
    if degrees:
        scale_x, scale_y = _metres_per_angle(y, degrees, crs, notes)
    else:
        scale_x = scale_y = _metres_per_unit(crs, y, notes)
    across, down = np.array([a * scale_x, d * scale_y]), np.array([b * scale_x, e * scale_y])
    dx, dz = float(np.hypot(*across)), float(np.hypot(*down))
    if not (min(dx, dz) >= _NARROWEST_M and max(dx, dz) <= _WIDEST_M):
        if spacing_m is None:
            raise InputError(
                f"expected posts between 0.1 mm and 1000 km apart, found {dx:.4g} x {dz:.4g} m; give --spacing METRES"
            )
    elif abs(float(across @ down)) > _SHEAR * dx * dz:
        raise InputError(
            f"expected columns at right angles to rows, found {math.degrees(math.acos((across @ down) / dx / dz)):.1f} "
            "degrees (a sheared grid); resample it: gdalwarp"
        )
    else:
        turn = math.degrees(math.atan2(across[1], across[0]))
        if abs(turn) > 0.01:
            notes.append(
                f"The grid is rotated: its columns point {abs(turn):.4g} degrees {'north' if turn > 0 else 'south'} of "
                "east, and so does the x axis."
            )
    georeference = Georeference(crs.to_string(), map_from_post, degrees is not None) if crs else None
    if georeference is None:
        notes.append("The file names no coordinate system: " + ("degrees assumed." if degrees else "metres assumed."))
    if spacing_m is not None:
        dx = dz = spacing_m
        notes.append(f"Spacing {spacing_m:g} m as asked, instead of the file's own.")
    return Placement((dx, dz), georeference, flip_rows, flip_cols)


def _angle_unit(crs: Any, map_from_post: Transform, shape: tuple[int, int], notes: list[str]) -> float | None:
    """Radians per map unit where the map is in angles; None where it is in lengths."""
    if crs:
        return float(_unit(crs, _DEGREES)[1]) if crs.is_geographic else None
    # ESRI grids and the like rarely name their system: steps of arc seconds within the globe are degrees.
    a, b, c, d, e, f = map_from_post
    corners = [(a * i + b * j + c, d * i + e * j + f) for i in (0, shape[1] - 1) for j in (0, shape[0] - 1)]
    on_globe = all(-181 <= x <= 361 and -91 <= y <= 91 for x, y in corners)
    return _DEGREES[1] if on_globe and max(map(abs, (a, b, d, e))) < 0.02 else None


def _metres_per_angle(y: float, radians: float, crs: Any, notes: list[str]) -> tuple[float, float]:
    """Metres per map unit east and north at the centre latitude."""
    latitude = y * radians
    if abs(latitude) > math.radians(89.9):
        raise InputError(
            f"expected a centre between 89.9 degrees south and north, found latitude {math.degrees(latitude):.4g}; "
            "project the grid: gdalwarp -t_srs"
        )
    radius, flattening = _ellipsoid(crs)
    eccentricity2 = flattening * (2 - flattening)
    w2 = 1 - eccentricity2 * math.sin(latitude) ** 2
    east = radius / math.sqrt(w2) * math.cos(latitude) * radians
    north = radius * (1 - eccentricity2) / w2**1.5 * radians
    notes.append(
        f"Degrees became metres at the centre latitude {math.degrees(latitude):.4f}: "
        f"{east / radians * _DEGREES[1]:.1f} m east, {north / radians * _DEGREES[1]:.1f} m north per degree."
    )
    return east, north


def _ellipsoid(crs: Any) -> tuple[float, float]:
    """Radius [m] and flattening: WGS 84, or another planet's own."""
    found = re.search(r'SPHEROID\["[^"]*",([0-9.eE+]+),([0-9.eE+]+)', crs.to_wkt()) if crs else None
    if found is None or abs(float(found[1]) / _WGS84[0] - 1) < 0.01 or not 1e4 < float(found[1]) < 1e9:
        return _WGS84
    return float(found[1]), 1 / float(found[2]) if float(found[2]) > 1 else 0.0


def _metres_per_unit(crs: Any, y: float, notes: list[str]) -> float:
    """Metres per map unit where the map is in lengths."""
    name, factor = _unit(crs, ("metre", 1.0))
    if not 0 < factor < 1e7:
        name, factor = "metre", 1.0
    if factor != 1.0:
        notes.append(f"Map units are {name} ({factor:.6g} m) and became metres.")
    if crs and crs.to_epsg() == 3857:
        shrink = 1 / math.cosh(min(abs(y) / _WGS84[0], 10.0))
        notes.append(f"Web Mercator stretches lengths here by {1 / shrink:.4g}: the spacing was corrected.")
        factor *= shrink
    return factor


def _unit(crs: Any, default: tuple[str, float]) -> tuple[str, float]:
    from rasterio.errors import CRSError

    try:
        name, factor = crs.units_factor if crs else default
    except CRSError:
        return default
    return name, float(factor)


def _numbers(values: Transform) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def flipped(grid: npt.NDArray[Any], placement: Placement) -> npt.NDArray[Any]:
    """The grid with row 0 north and column 0 west."""
    grid = grid[::-1] if placement.flip_rows else grid
    return grid[:, ::-1] if placement.flip_cols else grid
