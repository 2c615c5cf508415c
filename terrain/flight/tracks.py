"""Tracks of other programs as flights, and flights as tours for Google Earth.

A track says where one was, rarely where one looked: the camera looks along the way, smoothed, a little downwards. It
never goes below the ground. What a track says about height may be replaced by a height above the ground.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight.file import write_text
from terrain.flight.path import Flight, Keyframe, make_flight
from terrain.flight.recorder import reduce_flight
from terrain.flight.track_files import Track, read_track_file
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

UNTIMED_S = 60.0  # how long a track without times is flown
DEFAULT_ABOVE_M = 100.0  # where neither the file nor the user says how high
LEAST_ABOVE_M = 2.0
LOOK_DOWN_DEG, STEEPEST_DEG = 8.0, 35.0
AHEAD_SHARE = 0.01  # of the way: how far ahead and behind its direction is taken
KML_STEP_S = 0.5


def read_track(
    path: Path, heightfield: Heightfield, above_ground_m: float | None = None, duration_s: float | None = None
) -> Flight:
    """A flight along the track of a GPX, KML or CSV file.

    Parameters
    ----------
    path : Path
    heightfield : Heightfield
        The terrain to be flown over.
    above_ground_m : float, optional
        Fly this high above the ground, instead of at the heights in the file.
    duration_s : float, optional
        How long the flight lasts, instead of as long as the file says.

    Raises
    ------
    InputError
        If the file is no track, or does not lie on this terrain.
    """
    track = read_track_file(path)
    x, y, z = _placed(track, heightfield, path)
    times = _times(track, np.column_stack([x, z]), duration_s)
    keep = np.r_[True, np.diff(np.maximum.accumulate(times)) > 0.0]  # clocks that stand still or run back
    x, y, z, times = x[keep], y[keep], z[keep], times[keep] - times[0]
    if len(x) < 2:
        raise InputError(f"Expected times that go on in {path.name}, found one moment only.")
    ground = heightfield.heights_at(x, z)
    ground = np.where(np.isnan(ground), heightfield.height_range_m[0], ground)
    if above_ground_m is None and track.above_ground:
        y = y + ground
    missing = np.isnan(y) if above_ground_m is None else np.ones(y.shape, np.bool_)
    y = np.where(missing, ground + (DEFAULT_ABOVE_M if above_ground_m is None else above_ground_m), y)
    y = np.maximum(y, ground + LEAST_ABOVE_M)
    points = [point for point, kept in zip(track.points, keep.tolist(), strict=True) if kept]
    angles, has_views = _angles(track, points, heightfield, np.column_stack([x, y, z]))
    keys = [
        Keyframe(float(t), Camera((float(a), float(b), float(c)), float(v[0]), float(v[1]), float(v[2]), fov))
        for t, a, b, c, v, fov in zip(times, x, y, z, angles, (p.fov_deg or 60.0 for p in points), strict=True)
    ]
    flight = make_flight(keys, track.name or path.stem, heightfield)
    return flight if has_views else reduce_flight(flight, 0.1 * min(heightfield.spacing_m), 1.0)


def write_kml(flight: Flight, heightfield: Heightfield, path: Path, overwrite: bool = False) -> None:
    """Write the flight as a tour and a line, for Google Earth.

    Raises
    ------
    InputError
        If the terrain has no place on the Earth, or the file cannot be written.
    """
    keys = [key.t_s for key in flight.keyframes]
    # Rounded as they are written, or the steps would drift apart from their sum.
    times = np.unique(np.round(np.r_[0.0, keys, np.arange(0.0, flight.duration_s, KML_STEP_S)], 6))
    cameras = [flight.camera_at(t) for t in times.tolist()]
    eyes = np.array([camera.position_m for camera in cameras])
    lon, lat = to_geographic(eyes[:, 0], eyes[:, 2], heightfield)
    north = _true_north_deg(eyes[:, 0], eyes[:, 2], heightfield)
    height = eyes[:, 1] / heightfield.exaggeration
    stops, line = [], []
    steps_s = np.diff(times, prepend=0.0)
    for camera, step_s, *(a, b, h, turn) in zip(cameras, steps_s, lon, lat, height, north, strict=True):
        line.append(f"{a:.9f},{b:.9f},{h:.3f}")
        stops.append(
            f"<gx:FlyTo><gx:duration>{step_s:.6f}</gx:duration><gx:flyToMode>smooth</gx:flyToMode><Camera>"
            f"<longitude>{a:.9f}</longitude><latitude>{b:.9f}</latitude><altitude>{h:.3f}</altitude>"
            f"<heading>{(camera.yaw_deg + turn) % 360.0:.4f}</heading><tilt>{camera.pitch_deg + 90.0:.4f}</tilt>"
            f"<roll>{-camera.roll_deg:.4f}</roll><altitudeMode>absolute</altitudeMode>"
            f"<gx:fov>{camera.fov_deg:.4f}</gx:fov></Camera></gx:FlyTo>"
        )
    name = escape(flight.name)
    write_text(path, _KML.format(name=name, stops="\n".join(stops), line=" ".join(line)), overwrite)


_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document><name>{name}</name>
<gx:Tour><name>{name}</name><gx:Playlist>
{stops}
</gx:Playlist></gx:Tour>
<Placemark><name>{name}</name><LineString><altitudeMode>absolute</altitudeMode>
<coordinates>{line}</coordinates></LineString></Placemark>
</Document></kml>
"""


def to_geographic(x_m: Floats, z_m: Floats, heightfield: Heightfield) -> tuple[Floats, Floats]:
    """Longitudes and latitudes [deg] of places on the terrain; raises `InputError` where it has no place on Earth."""
    from rasterio.warp import transform

    place = _place_of(heightfield)
    map_x, map_y = place.to_map(x_m / heightfield.spacing_m[0], z_m / heightfield.spacing_m[1])
    try:
        lon, lat, *_ = transform(place.crs, "EPSG:4326", map_x.tolist(), map_y.tolist())
    except Exception as error:  # PROJ's own kinds of error
        raise InputError(f"{heightfield.name}: its coordinate system has no longitudes ({error}).") from None
    return np.array(lon), np.array(lat)


def _placed(track: Track, heightfield: Heightfield, path: Path) -> tuple[Floats, Floats, Floats]:
    """World positions of the points; heights are still the file's."""
    a, b, c = np.array([point.place for point in track.points], np.float64).T
    dx, dz = heightfield.spacing_m
    if track.axes == "world":
        x, y, z = a, b, c
        if np.isnan(z).any():
            raise InputError(f"Expected a z in every line of {path.name}, found lines without.")
    else:
        place = _place_of(heightfield)
        if track.axes == "geographic":
            from rasterio.warp import transform

            try:
                map_x, map_y, *_ = transform("EPSG:4326", place.crs, a.tolist(), b.tolist())
            except Exception as error:  # PROJ's own kinds of error
                raise InputError(f"{path.name} cannot be brought onto {heightfield.name} ({error}).") from None
            a, b = np.array(map_x), np.array(map_y)
        col, row = place.to_post(a, b)
        x, y, z = col * dx, c * heightfield.exaggeration, row * dz
    width, depth = heightfield.extent_m
    inside = (x >= -dx) & (x <= width + dx) & (z >= -dz) & (z <= depth + dz)
    if not inside.any():
        raise InputError(f"{path.name} lies beside {heightfield.name}: no point of it is on this terrain.")
    return x, y, z


def _place_of(heightfield: Heightfield) -> Any:
    if heightfield.georeference is None:
        raise InputError(
            f"{heightfield.name} does not say where on the Earth it lies: tracks need a terrain with a coordinate "
            "system, or a CSV file with x, y, z in metres."
        )
    return heightfield.georeference


def _times(track: Track, ground_plan: Floats, duration_s: float | None) -> Floats:
    """Seconds from the first point: the file's own, or at constant speed."""
    stamps = [point.t_s for point in track.points]
    if all(t is not None for t in stamps) and stamps[-1] != stamps[0]:
        times = np.array(stamps, np.float64) - float(stamps[0] or 0.0)
    else:
        way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(ground_plan, axis=0), axis=1))]
        times = way / max(way[-1], 1e-9) * UNTIMED_S
    end_s = float(times.max())
    return times if duration_s is None or end_s <= 0.0 else times * (duration_s / end_s)


def _angles(track: Track, points: list[Any], heightfield: Heightfield, eyes: Floats) -> tuple[Floats, bool]:
    """Yaw, pitch and roll (n, 3) [deg]; and whether they are the file's own."""
    if all(point.angles_deg is not None for point in points):
        angles = np.array([point.angles_deg for point in points], np.float64)
        if track.axes == "geographic":
            angles[:, 0] -= _true_north_deg(eyes[:, 0], eyes[:, 2], heightfield)
        return angles, True
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(eyes[:, [0, 2]], axis=0), axis=1))]
    reach = max(AHEAD_SHARE * way[-1], 3.0 * min(heightfield.spacing_m))
    ends = [np.clip(way + side * reach, 0.0, way[-1]) for side in (-1.0, 1.0)]
    behind, ahead = (np.column_stack([np.interp(end, way, eyes[:, axis]) for axis in range(3)]) for end in ends)
    along = ahead - behind
    yaw = np.degrees(np.arctan2(along[:, 0], -along[:, 2]))
    slope = np.degrees(np.arctan2(along[:, 1], np.hypot(along[:, 0], along[:, 2])))
    pitch = np.clip(slope - LOOK_DOWN_DEG, -STEEPEST_DEG, STEEPEST_DEG)
    return np.column_stack([yaw, pitch, np.zeros_like(yaw)]), False


def _true_north_deg(x_m: Floats, z_m: Floats, heightfield: Heightfield) -> Floats:
    """What to add to a yaw on the grid to get a heading from true north [deg]."""
    step_m = min(heightfield.spacing_m)
    lon, lat = to_geographic(x_m, z_m, heightfield)
    to_lon, to_lat = to_geographic(x_m, z_m - step_m, heightfield)
    east = (to_lon - lon) * np.cos(np.radians(lat))
    return np.asarray(np.degrees(np.arctan2(east, to_lat - lat)))
