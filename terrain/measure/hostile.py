"""Scenes and cameras where terrain methods fail: the cases of `terrain.measure.stability`.

Every scene is made from its name alone, so that a failure can be repeated anywhere. Grids are small: what breaks a
method is the shape, not the size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.heightfield import Georeference, Heightfield, fill_holes

Grid = npt.NDArray[np.float32]
CameraPath = tuple[Camera, ...]
"""Cameras of consecutive frames; a single one is a still."""

POSTS = 129
FRAME_S = 1 / 30
LEAST_CLEARANCE_M = 0.002  # of cameras found by chance: nearer, the near plane cuts the ground


def _hills(rows: int, cols: int, relief_m: float = 200.0, seed: int = 1) -> Grid:
    """Rolling hills with small ones on top, between 0 and about ``relief_m``; the same at every size."""
    rng = np.random.default_rng(seed)
    z, x = np.meshgrid(np.arange(rows) / 128, np.arange(cols) / 128, indexing="ij")
    heights = np.zeros((rows, cols))
    for octave in range(6):
        waves = 2.0 ** (octave + 0.6)
        turn, *phase = rng.uniform(0, 2 * np.pi, 3)
        u, v = x * math.cos(turn) + z * math.sin(turn), z * math.cos(turn) - x * math.sin(turn)
        heights += 0.55**octave * np.sin(waves * np.pi * u + phase[0]) * np.sin(waves * np.pi * v + phase[1])
    return (relief_m * (0.5 + 0.3 * heights)).astype(np.float32)


def _needles() -> Heightfield:
    rng = np.random.default_rng(2)
    heights = np.zeros((POSTS, POSTS), np.float32)
    posts = rng.integers(0, POSTS, (200, 2))
    heights[posts[:, 0], posts[:, 1]] = rng.uniform(100, 800, 200)
    return Heightfield(heights, (10.0, 10.0))


def _cliffs() -> Heightfield:
    hills = _hills(POSTS, POSTS, 400.0, seed=3)
    terraces = np.floor(hills / 100) * 250 + hills / 20
    return Heightfield(terraces.astype(np.float32), (10.0, 10.0))


def _ridges() -> Heightfield:
    row, col = np.mgrid[:POSTS, :POSTS]
    on_ridge = (col % 19 == 7) | (row % 23 == 11) | ((row + col) % 47 == 5)
    return Heightfield(np.where(on_ridge, 150, 0).astype(np.float32), (10.0, 10.0))


def _checkerboard() -> Heightfield:
    row, col = np.mgrid[:POSTS, :POSTS]
    return Heightfield(np.where((row + col) % 2, 1, -1).astype(np.float32), (10.0, 10.0))


def _offset() -> Heightfield:
    heights = _hills(POSTS, POSTS) + np.float32(1e7)  # posts on whole metres: all float32 can hold up there
    return Heightfield(heights, (10.0, 10.0), georeference=Georeference("EPSG:32633", (10, 0, 1e7, 0, -10, 1e7)))


def _million_high() -> Heightfield:
    hills = _hills(POSTS, POSTS)
    heights = (hills - hills.min()) * (2e6 / np.ptp(hills)) - 1e6
    return Heightfield(heights.astype(np.float32), (1000.0, 1000.0))


def _ring() -> Heightfield:
    row, col = np.mgrid[:POSTS, :POSTS] - (POSTS - 1) / 2
    holes = np.abs(np.hypot(row, col) - 40) > 9
    return Heightfield(fill_holes(_hills(POSTS, POSTS), holes), (10.0, 10.0), holes)


_SCENES: dict[str, Callable[[], Heightfield]] = {
    "needles": _needles,
    "cliffs": _cliffs,
    "ridges": _ridges,
    "flat": lambda: Heightfield(np.zeros((POSTS, POSTS), np.float32), (10.0, 10.0)),
    "checkerboard": _checkerboard,
    "2x2": lambda: Heightfield(np.array([[0, 30], [10, 5]], np.float32), (10.0, 10.0)),
    "2x5000": lambda: Heightfield(_hills(2, 5000), (10.0, 10.0)),
    "128x128": lambda: Heightfield(_hills(128, 128), (10.0, 10.0)),
    "129x129": lambda: Heightfield(_hills(129, 129), (10.0, 10.0)),
    "101x77": lambda: Heightfield(_hills(101, 77), (10.0, 14.0)),
    "million-high": _million_high,
    "offset-1e7": _offset,
    "1mm": lambda: Heightfield(_hills(POSTS, POSTS, 0.02), (0.001, 0.001)),
    "10km": lambda: Heightfield(_hills(33, 1025, 2e5), (1e4, 1e4)),
    "ring": _ring,
}
HOSTILE_SCENES: tuple[str, ...] = tuple(_SCENES)


def hostile_scene(name: str) -> Heightfield:
    """One of `HOSTILE_SCENES`."""
    return replace(_SCENES[name](), name=name)


def hostile_paths(terrain: Heightfield) -> dict[str, CameraPath]:
    """Hostile cameras for a terrain, by name: stills, and flights a frame (1/30 s) apart."""
    return {name: (camera,) for name, camera in _stills(terrain).items()} | _flights(terrain)


def _stills(terrain: Heightfield) -> dict[str, Camera]:
    (width, depth), (dx, dz) = terrain.extent_m, terrain.spacing_m
    low, high = terrain.height_range_m
    size, relief = math.hypot(width, depth), high - low
    step = min(dx, dz, 0.1 * size)
    middle_row, middle_col = (terrain.rows - 1) // 2, (terrain.cols - 1) // 2

    def above(row: float, col: float, clearance_m: float, *angles_deg: float) -> Camera:
        x, z = col * dx, row * dz
        ground = float(terrain.heights_at(x, z))
        return Camera((x, (low if math.isnan(ground) else ground) + clearance_m, z), *angles_deg)

    row, col = middle_row + 0.37, min(middle_col + 0.21, terrain.cols - 1.5)
    outlook = high + 0.1 * relief + 2 * step
    centre = (width / 2, (low + high) / 2, depth / 2)
    away_fov = float(np.clip(math.degrees(1.2 * (size + relief) / 5e5), 0.2, 60.0))
    return {
        "straight down": Camera((width * 0.52, high + 0.3 * size, depth * 0.47), 0.0, -90.0),
        "straight down, low": above(row, col, 3 * step, 0.0, -90.0),
        "straight up": above(row, col, 2 * step, 0.0, 90.0),
        "along north": above(0.93 * (terrain.rows - 1), col, 2 * step, 0.0, 0.0),
        "along east": above(row, 0.06 * (terrain.cols - 1), 2 * step, 90.0, 0.0),
        "along south": above(0.04 * (terrain.rows - 1), col, 2 * step, 180.0, 0.0),
        "along west": above(row, 0.95 * (terrain.cols - 1), 2 * step, 270.0, 0.0),
        "exactly 45 degrees": _backwards(Camera((0.6 * width, low, 0.4 * depth), 45.0, -45.0), 1.5 * (relief + step)),
        "fov 3": _looking_at((-0.3 * width, outlook, depth * 1.2), centre, 3.0),
        "fov 120": above(row, col, 4 * step, 200.0, -10.0, 0.0, 120.0),
        "rolled": above(row, col, 6 * step, 75.0, -20.0, 37.0),
        "upside down": above(row, col, 6 * step, 285.0, -15.0, 180.0),
        "on a post": above(middle_row, middle_col, step, 30.0, -15.0),
        "on an edge": above(middle_row, col, step, 90.0, -12.0),
        "on the bisector": above(middle_row + 0.25, middle_col + 0.75, step, 45.0, -12.0),
        # Heights of a million metres are kept to 6 cm: nearer than that is nowhere.
        "1 cm above ground": above(row, col, max(0.01, 1e-6 * max(abs(low), abs(high))), 330.0, 0.0),
        "below ground": above(row, col, -3 * step, 120.0, 5.0),
        "outside": _backwards(Camera(centre, 30.0, -20.0), 0.8 * (size + relief)),
        "outside, level": Camera((-0.4 * width, (low + high) / 2 + 0.01 * step, depth * 0.6), 80.0, 0.0),
        "500 km away": _backwards(Camera(centre, 110.0, -3.0, 0.0, away_fov), 5e5),
    }


def _flights(terrain: Heightfield) -> dict[str, CameraPath]:
    width, depth = terrain.extent_m
    low, high = terrain.height_range_m
    relief, size = high - low, math.hypot(width, depth)
    step = min(*terrain.spacing_m, 0.1 * size)
    rng = np.random.default_rng(4)
    teleports = tuple(random_camera(terrain, rng) for _ in range(6))

    def over(share: float, clearance_m: float) -> Camera:
        """Above the diagonal from south-west to north-east, looking at ground ahead."""
        ahead = ((share + 0.25) * width, low + 0.3 * relief, (0.65 - 0.8 * share) * depth)
        return _looking_at((share * width, high + clearance_m, (0.9 - 0.8 * share) * depth), ahead)

    # Steps of a hundredth of the distance, there and back again: whatever level has its threshold there changes.
    start = over(0.1, 0.3 * relief + 8 * step)
    swing = [0, 1, 2, 3, 2, 1, 0, 1, 0, 1, 0]
    to_and_fro = tuple(_backwards(start, -0.003 * (size + relief) * k) for k in swing)
    return {
        "teleports": teleports,
        "to and fro": to_and_fro,
        "standing still": (over(0.4, 0.1 * relief + 3 * step),) * 4,
        "fast flight": tuple(over(share, 3 * step) for share in np.linspace(0.02, 0.72, 8).tolist()),
    }


def random_camera(terrain: Heightfield, rng: np.random.Generator) -> Camera:
    """Anywhere over or beside a terrain, near the ground more often than not, looking anywhere but mostly ahead."""
    (width, depth), (low, high) = terrain.extent_m, terrain.height_range_m
    x, z = rng.uniform(-0.1, 1.1) * width, rng.uniform(-0.1, 1.1) * depth
    ground = float(terrain.heights_at(x, z))
    nearest, farthest = _least_clearance_m(terrain), math.hypot(width, depth, high - low)
    clearance = nearest * (farthest / nearest) ** rng.uniform(0, 1)
    y = (high if math.isnan(ground) else ground) + clearance
    yaw, pitch = rng.uniform(0, 360), float(np.clip(rng.normal(-15, 25), -90, 90))
    return Camera((x, y, z), yaw, pitch, rng.normal(0, 10), float(rng.choice([30.0, 60.0, 90.0])))


def nearby_camera(terrain: Heightfield, camera: Camera, reach: float, rng: np.random.Generator) -> Camera:
    """A camera a little elsewhere: ``reach`` 1 may go as far as its clearance and turn by 60 degrees."""
    ground = float(terrain.heights_at(camera.position_m[0], camera.position_m[2]))
    low, _ = terrain.height_range_m
    above = camera.position_m[1] - (low if math.isnan(ground) else ground)
    steps = rng.normal(0, 1, 3) * reach * max(abs(above), min(terrain.spacing_m))
    x, y, z = camera.eye_m + steps
    ground = float(terrain.heights_at(x, z))
    if not math.isnan(ground):
        y = max(y, ground + _least_clearance_m(terrain))
    return Camera(
        (float(x), float(y), float(z)),
        camera.yaw_deg + rng.normal(0, 60) * reach,
        float(np.clip(camera.pitch_deg + rng.normal(0, 30) * reach, -90, 90)),
        camera.roll_deg + rng.normal(0, 20) * reach,
        camera.fov_deg,
    )


def _least_clearance_m(terrain: Heightfield) -> float:
    return max(0.02 * min(terrain.spacing_m), LEAST_CLEARANCE_M)


def _looking_at(
    position_m: tuple[float, float, float], target_m: tuple[float, float, float], fov_deg: float = 60.0
) -> Camera:
    east, up, south = (t - p for t, p in zip(target_m, position_m, strict=True))
    yaw, pitch = math.atan2(east, -south), math.atan2(up, math.hypot(east, south))
    return Camera(position_m, math.degrees(yaw), math.degrees(pitch), 0.0, fov_deg)


def _backwards(camera: Camera, distance_m: float) -> Camera:
    """The camera moved back along its sight line."""
    x, y, z = (camera.eye_m - distance_m * camera.forward).tolist()
    return replace(camera, position_m=(x, y, z))
