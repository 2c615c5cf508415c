"""``city``: 1024 m of streets, blocks and roofs on gentle ground, with vertical walls; as a surface model shows it.

Every height is a function of its place alone: the district (the nearest of a few centres, each with its own grid of
streets), the block, the lot within the block, and the roof over the lot. Random choices are hashes of the numbers of
district, block and lot. Walls are as steep as the grid is fine: nothing is smoothed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from terrain.synthetic import buildings
from terrain.synthetic.buildings import Block, Floats, Part
from terrain.synthetic.noise import Grid

EXTENT_M = 1024.0
_POSTS_AT_ONCE = 1 << 18  # bounds the memory
_BOULEVARD_M, _RIVER_M, _QUAY_M = 10.0, 22.0, 34.0  # half widths
_WATER_M = 50.0
_SQUARE_M = (62.0, 34.0)  # half sides of the cathedral's square


class District(NamedTuple):
    """A part of the city with one direction of streets and one way of building."""

    x_m: float
    z_m: float
    angle_rad: float
    build: Callable[[Block], Part]
    lines_u_m: Floats  # middles of the streets along the district's own axes
    lines_v_m: Floats
    street_m: float  # half width


def city_heights(size: int, seed: int) -> Grid:
    """Heights (size, size) in metres; another size samples the same city at other posts."""
    districts = _districts(seed)
    at = np.linspace(0.0, EXTENT_M, size)
    heights = np.empty((size, size), np.float32)
    rows = max(_POSTS_AT_ONCE // size, 1)
    for first in range(0, size, rows):
        z, x = np.meshgrid(at[first : first + rows], at, indexing="ij")
        heights[first : first + rows] = _surface_m(x.ravel(), z.ravel(), districts, seed).reshape(x.shape)
    return heights


def _surface_m(x: Floats, z: Floats, districts: list[District], seed: int) -> Floats:
    """Height of the surface model at each place."""
    centres = np.array([(d.x_m, d.z_m) for d in districts])
    squares = (x[:, None] - centres[:, 0]) ** 2 + (z[:, None] - centres[:, 1]) ** 2
    nearest = np.argmin(squares, axis=1)
    ground, river = _ground_m(x, z, seed), _from_river_m(x, z, seed)
    heights = ground.copy()
    for number, district in enumerate(districts):
        here = np.flatnonzero((nearest == number) & (river > _QUAY_M))
        apart = np.hypot(*(centres - centres[number]).T)
        apart[number] = np.inf
        margin = ((squares[here] - squares[here, number][:, None]) / (2.0 * apart)).copy()
        margin[:, number] = np.inf
        to_border = margin.min(axis=1)
        inside = here[to_border > _BOULEVARD_M]
        heights[inside] = _built_m(x[inside], z[inside], ground[inside], district, number, seed)
        avenue = here[(to_border > 3.5) & (to_border < 8.5)]
        heights[avenue] += buildings.trees(x[avenue], z[avenue], 10.0, 0.8, seed)
    dx, dz = x - districts[0].x_m, z - districts[0].z_m
    u, v = _turned(dx, dz, -districts[0].angle_rad)
    is_square = (np.abs(u) < _SQUARE_M[0]) & (np.abs(v) < _SQUARE_M[1]) & (river > _QUAY_M)
    church = buildings.cathedral(u, v)
    level = _ground_m(np.array([districts[0].x_m]), np.array([districts[0].z_m]), seed)[0]
    heights = np.where(is_square, np.where(church > 0.0, level + church, ground), heights)
    is_bridge = np.abs(np.mod(z + 0.1 * x, 256.0) - 128.0) < 8.0
    quay = heights + np.where(
        (river < _QUAY_M) & (river > _QUAY_M - 8.0), buildings.trees(x, z, 9.0, 0.6, seed + 1), 0.0
    )
    return np.where(river > _RIVER_M, np.where(is_bridge, heights, quay), np.where(is_bridge, ground + 0.6, _WATER_M))


def _built_m(x: Floats, z: Floats, ground: Floats, district: District, number: int, seed: int) -> Floats:
    """Height at places within a district: its buildings, yards and streets."""
    u, v = _turned(x - district.x_m, z - district.z_m, -district.angle_rad)
    i = np.searchsorted(district.lines_u_m, u) - 1
    j = np.searchsorted(district.lines_v_m, v) - 1
    low_u, low_v = district.lines_u_m[i] + district.street_m, district.lines_v_m[j] + district.street_m
    width = district.lines_u_m[i + 1] - district.street_m - low_u
    depth = district.lines_v_m[j + 1] - district.street_m - low_v
    in_u, in_v = u - low_u, v - low_v
    is_street = (in_u < 0.0) | (in_u > width) | (in_v < 0.0) | (in_v > depth)
    key = ((seed * 31 + number) * 1009 + i) * 1009 + j
    part = district.build(Block(np.clip(in_u, 0.0, width), np.clip(in_v, 0.0, depth), width, depth, key))
    anchor_x, anchor_z = _turned(part.anchor_u_m + low_u, part.anchor_v_m + low_v, district.angle_rad)
    level = _ground_m(anchor_x + district.x_m, anchor_z + district.z_m, seed)
    level = np.where(np.isnan(level), ground, level)
    return np.where(is_street, ground, level + part.height_m)


def _districts(seed: int) -> list[District]:
    """The old town near the middle, and seven others around it."""
    rng = np.random.default_rng((seed, 20))
    styles = [buildings.towers, buildings.suburb, buildings.industry, buildings.suburb, buildings.old_town,
              buildings.park, buildings.old_town]  # fmt: skip
    rng.shuffle(styles)
    districts = [_district(rng, 400.0, 480.0, buildings.old_town)]
    for number, style in enumerate(styles):
        around = 2.0 * math.pi * (number + 0.5 * rng.random()) / len(styles)
        out = rng.uniform(330.0, 460.0)
        districts.append(_district(rng, 512.0 + out * math.cos(around), 512.0 + out * math.sin(around), style))
    return districts


def _district(rng: np.random.Generator, x_m: float, z_m: float, build: Callable[[Block], Part]) -> District:
    sides: dict[Callable[[Block], Part], float] = {
        buildings.towers: 110.0,
        buildings.industry: 120.0,
        buildings.park: 150.0,
        buildings.suburb: 84.0,
    }
    side_m = sides.get(build, 66.0)
    lines = []
    for stretch in (1.0, 1.35):
        steps = side_m * stretch * rng.uniform(0.75, 1.3, 80)
        lines.append(np.cumsum(steps) - 0.5 * steps.sum())
    angle = rng.uniform(0.0, 0.5 * math.pi)
    return District(x_m, z_m, float(angle), build, lines[0], lines[1], 4.5 if build is buildings.suburb else 6.5)


def _turned(u: Floats, v: Floats, angle_rad: float) -> tuple[Floats, Floats]:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * u - s * v, s * u + c * v


def _ground_m(x: Floats, z: Floats, seed: int) -> Floats:
    """Gentle ground: a slope and a few long waves, 10 to 15 m from low to high."""
    a, b, c = 2.0 * math.pi * np.random.default_rng((seed, 21)).random(3)
    waves = 3.0 * np.sin(x / 170.0 + a) * np.cos(z / 210.0 + b) + 1.2 * np.sin((x + 2.0 * z) / 150.0 + c)
    return np.asarray(61.0 + 0.006 * x - 0.004 * z + waves)


def _from_river_m(x: Floats, z: Floats, seed: int) -> Floats:
    """About the distance from the middle of the river, which bends through the city from north to south."""
    a, b = 2.0 * math.pi * np.random.default_rng((seed, 22)).random(2)
    middle = 620.0 + 70.0 * np.sin(z / 190.0 + a) + 22.0 * np.sin(z / 70.0 + b)
    bend = 70.0 / 190.0 * np.cos(z / 190.0 + a) + 22.0 / 70.0 * np.cos(z / 70.0 + b)
    return np.asarray(np.abs(x - middle) / np.hypot(1.0, bend))
