"""Where a picture was taken: the words in its PNG file, and the world file of a view straight down."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from app.places.framing import ground_m
from terrain.camera import Camera
from terrain.flight.path import origin_of
from terrain.heightfield import Heightfield

KEYWORD = "Reliefscope"
STRAIGHT_DOWN_DEG = 0.01


def picture_notes(camera: Camera, heightfield: Heightfield, **drawn_with: object) -> Mapping[str, str]:
    """The camera of a picture and what it shows, as text for its file: one JSON object, keys as in flight files."""
    place = heightfield.georeference
    record = {
        "position": [float(p) for p in camera.position_m],
        "yaw": camera.yaw_deg, "pitch": camera.pitch_deg, "roll": camera.roll_deg, "fov": camera.fov_deg,
        "terrain": heightfield.name, "exaggeration": heightfield.exaggeration,
        "crs": None if place is None else place.crs, "origin": origin_of(heightfield), **drawn_with,
    }  # fmt: skip
    return {"Software": "Reliefscope", KEYWORD: json.dumps(record, default=str)}


def is_straight_down(camera: Camera) -> bool:
    return camera.pitch_deg <= -90.0 + STRAIGHT_DOWN_DEG


def straightened(camera: Camera) -> Camera:
    """The camera looking straight down from where it is."""
    return Camera(camera.position_m, camera.yaw_deg, -90.0, 0.0, camera.fov_deg)


def world_file(camera: Camera, heightfield: Heightfield, size_px: tuple[int, int]) -> str:
    """The six lines of a world file for a view straight down.

    A perspective picture has one scale at one height only: that of the ground below the eye. Without a georeference
    map coordinates are metres east and north of the terrain's north-west post.
    """
    width, height = size_px
    x, y, z = camera.position_m
    down_m = max(y - ground_m(heightfield, x, z), 1e-6)
    pixel_m = down_m / camera.pixels_per_radian(height)
    right, up, _ = camera.view_from_eye()  # world axes: x east, z south
    corner = np.array([x, z]) + pixel_m * (-(width - 1) / 2.0 * right[[0, 2]] + (height - 1) / 2.0 * up[[0, 2]])
    steps = pixel_m * right[[0, 2]], -pixel_m * up[[0, 2]]
    dx, dz = heightfield.spacing_m
    place = heightfield.georeference
    a, b, c, d, e, f = place.map_from_post if place is not None else (dx, 0.0, 0.0, 0.0, -dz, 0.0)
    matrix = np.array([[a / dx, b / dz], [d / dx, e / dz]])
    across, down, first = matrix @ steps[0], matrix @ steps[1], matrix @ corner + [c, f]
    values = (across[0], across[1], down[0], down[1], first[0], first[1])
    return "".join(f"{0.0 if math.isclose(v, 0.0, abs_tol=1e-15) else v:.12g}\n" for v in values)


def world_file_path(picture: Path) -> Path:
    """``map.png`` -> ``map.pgw``."""
    return picture.with_suffix(".pgw")
