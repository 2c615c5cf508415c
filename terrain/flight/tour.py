"""Flights made for any terrain: a tour through its valleys, and an orbit around it.

The tour begins with a view across the terrain towards its highest mountain, goes down into the valley that leads there,
follows it low above the ground, and climbs out turning round. Valleys are found as cheapest ways over a coarse grid
on which height costs. The eye's height is checked along the spline against the surface and raised where it is too low.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.flight.path import Flight, Keyframe, make_flight
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

TOUR_S = 20.0
_KEY_S = 0.25
_LATTICE = 160  # cells along the longer side of the coarse grid
_INSET = 0.05  # share of each side the eye keeps away from the rim
_SAMPLES_PER_CELL = 8
_RAISING_ROUNDS = 24
_LOW_PASS = 0.0015  # of the terrain's longer side: as low as a bird flies, where a person would only see a meadow

# The tour over its time, each value reached softly: height above the ground (1: the outlook's), and how much the
# camera looks elsewhere than along the way (first towards the summit, from the middle on across the terrain).
_SHARE = (0.00, 0.10, 0.42, 0.47, 0.64, 0.70, 0.94, 1.00)
_HEIGHT = (1.00, 0.90, 0.03, 0.00, 0.00, 0.03, 0.70, 0.75)
_ASIDE = (1.00, 1.00, 0.10, 0.00, 0.00, 0.05, 0.95, 1.00)


def demo_flight(heightfield: Heightfield) -> Flight:
    """The terrain's own tour: 20 s, never below ground.

    Parameters
    ----------
    heightfield : Heightfield
        Of any size, shape and relief.
    """
    times = np.arange(0.0, TOUR_S + 0.5 * _KEY_S, _KEY_S)
    height_share, aside = _eased(times / TOUR_S, _HEIGHT), _eased(times / TOUR_S, _ASIDE)
    low, high = heightfield.height_range_m
    size_m, eye_m = max(heightfield.extent_m), _lowest_flight_m(heightfield)
    relief_m = high - low
    outlook_m = max(min(0.3 * relief_m, 0.1 * size_m), min(0.5 * relief_m, 0.035 * size_m), 0.022 * size_m, 2.0 * eye_m)
    way, summit = _valley_way(heightfield)
    speed = 0.25 + height_share**0.75  # as fast as suits the height above ground
    passed = np.r_[0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]))]
    length_m = min(0.75 * _length_m(way), 0.4 * size_m)
    x, z = _at_distance(way, passed / passed[-1] * length_m).T
    ground = heightfield.ground_at(x, z)
    # High up the eye does not follow every hump: it keeps above what lies a second before and behind.
    around = np.lib.stride_tricks.sliding_window_view(np.pad(ground, 4, mode="edge"), 9)
    envelope = _smoothed(around.max(axis=1), 3.0)
    position = np.column_stack([x, np.zeros_like(x), z])
    smoothness = np.minimum(4.0 * height_share, 1.0)
    position[:, 1] = ground + smoothness * np.maximum(envelope - ground, 0.0) + eye_m + outlook_m * height_share
    keys = _looking(position, times, height_share, aside, summit, way[0])
    return _above_ground(make_flight(keys, f"{heightfield.name} tour", heightfield), heightfield, 0.8 * eye_m)


def orbit_flight(heightfield: Heightfield, duration_s: float = 30.0) -> Flight:
    """Once around the terrain, clockwise from the south, looking at its middle from above all of it."""
    width, depth = heightfield.extent_m
    low, high = heightfield.height_range_m
    middle = np.array([width / 2.0, (low + high) / 2.0, depth / 2.0])
    radius_m = 0.62 * math.hypot(width, depth)
    keys = []
    for step in range(25):
        around = math.radians(180.0 + 15.0 * step)
        eye = np.array([math.sin(around), 0.45, -math.cos(around)]) * radius_m + middle
        eye[1] += (high - low) / 2.0
        keys.append(Keyframe(duration_s * step / 24.0, _looking_at(eye, middle)))
    return make_flight(keys, f"{heightfield.name} orbit", heightfield)


def _lowest_flight_m(heightfield: Heightfield) -> float:
    """Height above the ground at the lowest: a person's on a small terrain, a bird's on a large one."""
    spacing_m = min(heightfield.spacing_m)
    return max(min(1.8, spacing_m), 0.02 * spacing_m, _LOW_PASS * max(heightfield.extent_m))


def _eased(share: Floats, values: tuple[float, ...]) -> Floats:
    """Values of a curve through ``values`` at `_SHARE`, level at each."""
    at = np.asarray(_SHARE)
    i = np.clip(np.searchsorted(at, share, side="right") - 1, 0, at.size - 2)
    u = np.clip((share - at[i]) / (at[i + 1] - at[i]), 0.0, 1.0)
    value = np.asarray(values)
    return np.asarray(value[i] + (value[i + 1] - value[i]) * u * u * (3.0 - 2.0 * u))


def _valley_way(heightfield: Heightfield) -> tuple[Floats, Floats]:
    """The best valley towards the highest place: a polyline (n, 2) of x and z [m], and that place as x, y, z [m]."""
    from scipy.sparse import csgraph  # 70 ms to import

    heights, x, z = _lattice(heightfield)
    holes = np.zeros(heights.shape, np.bool_)
    if heightfield.holes is not None:
        row, col = np.rint(z / heightfield.spacing_m[1]), np.rint(x / heightfield.spacing_m[0])
        holes = heightfield.holes[np.ix_(row.astype(np.int64), col.astype(np.int64))]
    size_m, relief = max(heightfield.extent_m), max(float(np.ptp(heights)), 1e-6)
    # What stands out most from its surroundings is worth flying to, rather than the highest point of a plateau.
    standing_out = heights - _lowest_around(heights, _LATTICE // 12) + 0.25 * heights
    top = int(np.argmax(np.where(holes, -np.inf, standing_out)))
    rim = np.minimum.outer(*(np.minimum(at, at[::-1]) / (at[0] + at[-1]) for at in (z, x)))  # 1/2 in the middle
    cost = 0.03 + ((heights - heights.min()) / relief) ** 2 + 20.0 * holes + np.maximum(1.0 - rim / 0.2, 0.0) ** 2
    costs, before = csgraph.dijkstra(_graph(cost, x, z), indices=top, return_predecessors=True)
    cols = heights.shape[1]
    distance = np.hypot(x[None, :] - x[top % cols], z[:, None] - z[top // cols]).ravel()
    start_m = min(0.28 * size_m, max(2.6 * relief, 0.1 * size_m))  # near enough to look up to it
    is_far = (distance > start_m) & (distance < 1.6 * start_m) & (~holes.ravel() | holes.all())
    if not is_far.any():
        is_far = distance == distance.max()
    node = int(np.argmin(np.where(is_far, costs / np.maximum(distance, 1e-9), np.inf)))
    nodes = [node]
    while nodes[-1] != top:
        nodes.append(int(before[nodes[-1]]))
    line = np.column_stack([x[np.array(nodes) % cols], z[np.array(nodes) // cols]])
    smooth = _at_distance(line, np.linspace(0.0, _length_m(line), 400))
    summit = np.array([x[top % cols], heights.flat[top], z[top // cols]])
    return np.column_stack([_smoothed(smooth[:, axis], 6.0) for axis in (0, 1)]), summit


def _lattice(heightfield: Heightfield) -> tuple[Floats, Floats, Floats]:
    """Highest post in each cell of a coarse grid inside the rim, (rows, cols), and the cells' x and z [m]."""
    heights, shares = heightfield.heights_m, []
    for axis, side_m in enumerate(reversed(heightfield.extent_m)):
        count = max(round(_LATTICE * side_m / max(heightfield.extent_m)), 2)
        edges = np.linspace(_INSET, 1.0 - _INSET, count + 1)
        posts = heights.shape[axis] - 1
        first, last = np.floor(edges[:-1] * posts).astype(np.int64), math.ceil(edges[-1] * posts)
        heights = np.maximum.reduceat(np.take(heights, range(last + 1), axis), first, axis=axis)
        shares.append((edges[:-1] + edges[1:]) / 2.0)
    width, depth = heightfield.extent_m
    return heights.astype(np.float64), shares[1] * width, shares[0] * depth


def _lowest_around(heights: Floats, reach: int) -> Floats:
    """The lowest cell in a square of ``2 reach + 1`` cells."""
    for axis in (0, 1):
        padded = np.pad(heights, [(reach, reach) if axis == a else (0, 0) for a in (0, 1)], mode="edge")
        heights = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis).min(axis=-1)
    return heights


def _graph(cost: Floats, x: Floats, z: Floats) -> Any:
    """Edges between the eight neighbours of a lattice: length times mean cost, as a sparse matrix."""
    from scipy import sparse

    index = np.arange(cost.size).reshape(cost.shape)
    every, lower, upper = slice(None), slice(None, -1), slice(1, None)
    rows, cols, weights = [], [], []
    for (ar, ac), (br, bc) in (
        ((every, lower), (every, upper)),
        ((lower, every), (upper, every)),
        ((lower, lower), (upper, upper)),
        ((lower, upper), (upper, lower)),
    ):
        length = np.hypot(x[None, ac] - x[None, bc], z[ar, None] - z[br, None])
        weights.append((length * (cost[ar, ac] + cost[br, bc]) / 2.0).ravel())
        rows.append(index[ar, ac].ravel())
        cols.append(index[br, bc].ravel())
    a, b, w = np.concatenate(rows), np.concatenate(cols), np.concatenate(weights)
    return sparse.csr_matrix((np.r_[w, w], (np.r_[a, b], np.r_[b, a])), shape=(cost.size, cost.size))


def _length_m(line: Floats) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _at_distance(line: Floats, distance_m: Floats) -> Floats:
    """Points (n, 2) of a polyline at distances from its beginning."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    return np.column_stack([np.interp(distance_m, along, line[:, axis]) for axis in (0, 1)])


def _looking(
    position: Floats, times: Floats, height_share: Floats, aside: Floats, summit: Floats, start: Floats
) -> list[Keyframe]:
    """Keyframes whose cameras look along the way and aside, and bank in curves."""
    forward = np.gradient(position[:, [0, 2]], axis=0)
    along = _smoothed(np.unwrap(np.arctan2(forward[:, 0], -forward[:, 1])), 3.0)
    to_summit = np.arctan2(summit[0] - position[:, 0], position[:, 2] - summit[2])
    back = np.arctan2(start[0] - position[:, 0], position[:, 2] - start[1])
    is_end = times > times[-1] / 2.0
    turn = _wrapped(np.where(is_end, back, to_summit) - along)
    turn[is_end] = np.copysign(np.minimum(np.abs(turn[is_end]), math.radians(110.0)), turn[-1])
    yaw = _smoothed(along + aside * turn, 2.0)
    pitch_deg = 2.0 - 13.0 * np.minimum(3.0 * height_share, 1.0)
    pitch_deg = _smoothed(pitch_deg, 2.0)
    roll_deg = np.clip(0.3 * np.degrees(np.gradient(yaw, times)), -10.0, 10.0)
    roll_deg = _smoothed(roll_deg, 2.0)
    return [
        Keyframe(float(t), Camera((float(x), float(y), float(z)), math.degrees(a), float(p), float(r)))
        for t, (x, y, z), a, p, r in zip(times, position, yaw, pitch_deg, roll_deg, strict=True)
    ]


def _looking_at(eye: Floats, target: Floats) -> Camera:
    x, y, z = target - eye
    yaw, pitch = math.atan2(x, -z), math.atan2(y, math.hypot(x, z))
    return Camera((float(eye[0]), float(eye[1]), float(eye[2])), math.degrees(yaw), math.degrees(pitch))


def _smoothed(values: Floats, sigma: float) -> Floats:
    """A sequence blurred by a Gaussian of ``sigma`` entries."""
    reach = math.ceil(4.0 * sigma)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), weights / weights.sum(), mode="valid")


def _wrapped(angle_rad: Floats) -> Floats:
    return np.asarray((angle_rad + math.pi) % (2.0 * math.pi) - math.pi)


def _above_ground(flight: Flight, heightfield: Heightfield, clearance_m: float) -> Flight:
    """The flight with keyframes raised until the whole spline keeps above ground."""
    for _ in range(_RAISING_ROUNDS):
        times, segment = _sample_times(flight, min(heightfield.spacing_m))
        position = flight.positions_at(times)
        lack_m = _ground_bound_m(heightfield, position[:, 0], position[:, 2]) + clearance_m - position[:, 1]
        if lack_m.max() <= 0.0:
            return flight
        raise_m = np.zeros(len(flight.keyframes))
        np.maximum.at(raise_m, segment, lack_m)
        np.maximum.at(raise_m, segment + 1, lack_m)
        flight = _raised(flight, raise_m)
    return _raised(flight, np.full(len(flight.keyframes), lack_m.max()))  # moves the curve without bending it


def _raised(flight: Flight, raise_m: Floats) -> Flight:
    keys = []
    for key, rise in zip(flight.keyframes, raise_m, strict=True):
        x, y, z = key.camera.position_m
        keys.append(replace(key, camera=replace(key.camera, position_m=(x, y + float(rise), z))))
    return replace(flight, keyframes=tuple(keys))


def _sample_times(flight: Flight, spacing_m: float) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Times at least every eighth of a cell along the flight, and the segment each lies in."""
    times = np.array([key.t_s for key in flight.keyframes])
    chords_m = np.linalg.norm(np.diff([key.camera.position_m for key in flight.keyframes], axis=0)[:, [0, 2]], axis=1)
    counts = np.maximum(np.ceil(_SAMPLES_PER_CELL * chords_m / spacing_m), 4).astype(np.int64)
    segment = np.repeat(np.arange(counts.size), counts)
    nth = np.arange(segment.size) - np.repeat(np.cumsum(counts) - counts, counts)
    return times[segment] + np.diff(times)[segment] * nth / counts[segment], segment


def _ground_bound_m(heightfield: Heightfield, x_m: Floats, z_m: Floats) -> Floats:
    """The surface at a sample, plus what it can rise from there half way to the next one: no peak slips between."""
    (dx, dz), heights = heightfield.spacing_m, heightfield.heights_m
    col = np.clip(x_m / dx, 0, heightfield.cols - 1.000001).astype(np.int64)
    row = np.clip(z_m / dz, 0, heightfield.rows - 1.000001).astype(np.int64)
    corners = np.stack([heights[row + r, col + c] for r in (0, 1) for c in (0, 1)]).astype(np.float64)
    top, bottom = corners.max(axis=0), corners.min(axis=0)
    surface, rise = heightfield.ground_at(x_m, z_m), (top - bottom) * math.sqrt(2.0) / _SAMPLES_PER_CELL
    return np.minimum(np.where(np.isnan(surface), top, surface + rise), top)
