"""What stands on the blocks of ``city``: one function per way of building, heights by place within the block.

Roofs are minima of planes over the distance to eaves and gables, as a carpenter would cut them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_STOREY_M = 3.2


class Block(NamedTuple):
    """Places within blocks, one entry per place.

    Attributes
    ----------
    u_m, v_m : ndarray
        From the block's low corner.
    width_m, depth_m : ndarray
        The block's sides along u and v.
    key : ndarray of int64
        A number per block, for chances.
    """

    u_m: Floats
    v_m: Floats
    width_m: Floats
    depth_m: Floats
    key: Ints


class Part(NamedTuple):
    """Heights above the ground, and the place within the block whose ground a building stands on (NaN: its own)."""

    height_m: Floats
    anchor_u_m: Floats
    anchor_v_m: Floats


def chance(salt: int, *numbers: npt.ArrayLike) -> Floats:
    """A number in 0..1 for each tuple of whole numbers: the same tuple, the same number (splitmix64)."""
    mixed = np.asarray(salt, np.uint64)
    with np.errstate(over="ignore"):
        for number in numbers:
            mixed = (mixed ^ np.asarray(number, np.int64).astype(np.uint64)) + np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            mixed = mixed ^ (mixed >> np.uint64(31))
    return np.asarray(mixed >> np.uint64(11), np.float64) * 2.0**-53


def trees(u: Floats, v: Floats, cell_m: float, share: float, salt: int) -> Floats:
    """Round crowns, at most one in each square cell, on a ``share`` of the cells."""
    i, j = np.floor(u / cell_m).astype(np.int64), np.floor(v / cell_m).astype(np.int64)
    radius = cell_m * (0.22 + 0.2 * chance(salt, i, j, 1))
    room = cell_m - 2.0 * radius
    du = u - i * cell_m - radius - room * chance(salt, i, j, 2)
    dv = v - j * cell_m - radius - room * chance(salt, i, j, 3)
    crown = np.sqrt(np.maximum(1.0 - (du**2 + dv**2) / radius**2, 0.0))
    tall = 5.0 + 9.0 * chance(salt, i, j, 4)
    return np.where((chance(salt, i, j, 5) < share) & (crown > 0.0), tall * (0.45 + 0.55 * crown), 0.0)


def old_town(block: Block) -> Part:
    """Houses wall to wall around courtyards, three to six storeys, under roofs of many kinds."""
    u, v, w, d = block.u_m, block.v_m, block.width_m, block.depth_m
    edges = np.stack([v, w - u, d - v, u])
    side = np.argmin(edges, axis=0)
    into = np.take_along_axis(edges, side[None], 0)[0]  # from the street wall inwards
    is_across = side % 2 == 0
    along, length = np.where(is_across, u, v), np.where(is_across, w, d)
    count = np.maximum(np.rint(length / 15.0), 1.0)
    lot = np.minimum(np.floor(along / length * count), count - 1.0).astype(np.int64)
    lot_m = length / count
    t = along - lot * lot_m
    deep = 11.0 + 4.0 * chance(10, block.key)
    eaves = _STOREY_M * np.floor(3.0 + 3.6 * chance(11, block.key, side, lot))
    kind = chance(12, block.key, side, lot)
    span, gable = np.minimum(into, deep - into), np.minimum(t, lot_m - t)
    roof = np.select(
        [kind < 0.5, kind < 0.62, kind < 0.76, kind < 0.9],
        [
            0.85 * span,  # ridge along the street
            1.1 * gable,  # gable to the street
            np.where(np.minimum(span, gable) < 0.5, 0.9, 0.0),  # flat, behind a parapet
            np.minimum(2.4 * span, 3.4) + 0.35 * np.maximum(span - 1.4, 0.0),  # mansard
        ],
        0.4 * into,  # towards the courtyard wall
    )
    is_house = (into < deep) & (chance(13, block.key, side, lot) < 0.95)
    yard = np.where(into > deep + 5.0, trees(u + 7.0, v + 3.0, 8.0, 0.35, 14), 0.0)
    shed = (into > deep + 4.0) & (into < deep + 11.0) & (chance(15, block.key) < 0.4) & (side == 1)
    height = np.where(is_house, eaves + roof, np.where(shed, 4.0 + 0.15 * (into - deep), yard))
    middle = lot_m * (lot + 0.5)
    inwards = deep / 2.0
    anchor_u = np.select([is_across, side == 1], [middle, w - inwards], inwards)
    anchor_v = np.select([~is_across, side == 0], [middle, inwards], d - inwards)
    return _part(height, is_house | shed, anchor_u, anchor_v)


def suburb(block: Block) -> Part:
    """Detached houses under gabled, hipped and pyramid roofs, in gardens with trees."""
    i, j, u, v, w, d = _parcels(block, 21.0, 26.0)
    key = (block.key, i, j)
    half_u = w * (0.24 + 0.08 * chance(20, *key))
    half_v = d * (0.2 + 0.08 * chance(21, *key))
    x, z = u - w * (0.44 + 0.12 * chance(22, *key)), v - d * (0.44 + 0.12 * chance(23, *key))
    to_u, to_v = half_u - np.abs(x), half_v - np.abs(z)
    kind = chance(24, *key)
    roof = np.select(
        [kind < 0.35, kind < 0.6, kind < 0.85],
        [0.9 * np.minimum(to_v, half_v), 0.9 * to_u, 0.75 * np.minimum(to_u, to_v)],
        np.where(np.minimum(to_u, to_v) < 0.4, 0.6, 0.0),
    )
    eaves = _STOREY_M * np.floor(1.0 + 1.8 * chance(25, *key)) + 0.4
    is_house = (to_u > 0.0) & (to_v > 0.0) & (chance(26, *key) < 0.93)
    garage = (np.abs(u - 3.0) < 2.0) & (np.abs(v - d + 5.0) < 3.0) & (chance(27, *key) < 0.5)
    garden = trees(u + i * w, v + j * d, 7.5, 0.3, 28) * 0.8
    hedge = np.where((np.minimum(u, w - u) < 0.5) & (chance(29, *key) < 0.6), 1.6, 0.0)
    height = np.where(is_house, eaves + roof, np.where(garage, 2.6, np.maximum(garden, hedge)))
    return _part(height, is_house | garage, block.u_m - x, block.v_m - z)


def towers(block: Block) -> Part:
    """Towers, slabs and low halls with flat roofs and what stands on them, on open squares."""
    i, j, u, v, w, d = _parcels(block, 46.0, 46.0)
    key = (block.key, i, j)
    kind = chance(30, *key)
    x, z = u - w / 2.0, v - d / 2.0
    half_u = np.select([kind < 0.3, kind < 0.6, kind < 0.75], [10.5, 7.0, 17.0], 16.0)
    half_v = np.select([kind < 0.3, kind < 0.6, kind < 0.75], [10.5, 19.0, 7.0], 16.0)
    tall = chance(31, *key)
    storeys = np.select([kind < 0.3, kind < 0.75], [10.0 + 22.0 * tall**2, 5.0 + 5.0 * tall], 1.0 + 2.0 * tall)
    to_u, to_v = half_u - np.abs(x), half_v - np.abs(z)
    edge = np.minimum(to_u, to_v)
    is_set_back = (kind < 0.18) & (edge < 3.0)
    roof = np.where(edge < 0.6, 1.0, 0.0) + np.where((np.abs(x + 2.0) < 3.2) & (np.abs(z - 1.0) < 2.6), 3.6, 0.0)
    top = _STOREY_M * np.floor(storeys * np.where(is_set_back, 0.7, 1.0)) + roof
    mast = np.where((kind < 0.08) & (np.hypot(x, z) < 1.2), 18.0, 0.0)
    is_built = (edge > 0.0) & (kind < 0.88)
    square = trees(u + i * w, v + j * d, 9.0, 0.25, 32)
    return _part(np.where(is_built, top + mast, square), is_built, block.u_m - x, block.v_m - z)


def industry(block: Block) -> Part:
    """Halls under saw-tooth, barrel and flat roofs, tanks and chimneys."""
    i, j, u, v, w, d = _parcels(block, 74.0, 48.0)
    key = (block.key, i, j)
    kind, tall = chance(40, *key), 7.0 + 6.0 * chance(41, *key)
    x, z = u - w / 2.0, v - d / 2.0
    half_u, half_v = w / 2.0 - 5.0, d / 2.0 - 5.0
    edge = np.minimum(half_u - np.abs(x), half_v - np.abs(z))
    bay = np.mod(x + half_u, 9.0)
    arc = np.mod(z + half_v, half_v)
    lights = np.where((np.mod(x, 12.0) < 2.0) & (np.abs(z) < half_v - 4.0), 1.5, 0.0)
    roof = np.select(
        [kind < 0.4, kind < 0.6],
        [0.45 * bay, 0.9 * np.sqrt(np.maximum(arc * (half_v - arc), 0.0))],
        lights,
    )
    hall = np.where(edge > 0.0, tall + roof, 0.0)
    tank_u, tank_v = np.mod(x, 20.0) - 10.0, np.mod(z, 20.0) - 10.0
    from_axis = np.hypot(tank_u, tank_v)
    tanks = np.where((from_axis < 8.0) & (edge > 0.0), 10.0 + 0.12 * (8.0 - from_axis), 0.0)
    chimney = np.hypot(x - half_u + 4.0, z - half_v + 4.0) < 2.2
    height = np.where(kind > 0.86, tanks, hall)
    height = np.where(chimney & (kind < 0.25), 45.0 + 25.0 * chance(42, *key), height)
    return _part(height, height > 0.0, block.u_m - x, block.v_m - z)


def park(block: Block) -> Part:
    """Lawns, groves and a pavilion here and there."""
    u, v, w, d = block.u_m, block.v_m, block.width_m, block.depth_m
    x, z = u - w / 2.0, v - d / 2.0
    grove = 0.5 + 0.5 * np.sin(u / 17.0 + block.key % 7) * np.sin(v / 23.0 + block.key % 5)
    path = np.abs(np.hypot(x, z) - 0.3 * np.minimum(w, d)) < 2.0
    height = np.where(path, 0.0, trees(u, v, 9.0, 0.85, 50) * (grove > 0.4))
    pavilion = (np.hypot(x, z) < 7.0) & (chance(51, block.key) < 0.35)
    dome = 5.0 + np.sqrt(np.maximum(49.0 - x**2 - z**2, 0.0)) * 0.6
    return _part(np.where(pavilion, dome, height), pavilion, w / 2.0 + 0.0 * u, d / 2.0 + 0.0 * v)


def cathedral(x: Floats, z: Floats) -> Floats:
    """A church by place around its crossing, nave towards negative x; 0 where it does not stand."""
    aisle_x, aisle_z = 30.0 - np.abs(x + 4.0), 13.0 - np.abs(z)
    nave_x, nave_z = 33.0 - np.abs(x + 4.0), 7.0 - np.abs(z)
    arm_x, arm_z = 7.0 - np.abs(x - 8.0), 22.0 - np.abs(z)
    tower_x, tower_z = 6.0 - np.abs(x + 40.0), 6.0 - np.abs(z)
    tower = np.minimum(tower_x, tower_z)
    from_apse = np.hypot(x - 29.0, z)
    flying = np.hypot(x - 8.0, z)  # the little spire over the crossing
    parts = [
        np.where((aisle_x > 0.0) & (aisle_z > 0.0), 11.0 + 0.5 * aisle_z, 0.0),
        np.where((nave_x > 0.0) & (nave_z > 0.0), 21.0 + 1.3 * nave_z, 0.0),
        np.where((arm_x > 0.0) & (arm_z > 0.0), 21.0 + 1.3 * arm_x, 0.0),
        np.where((from_apse < 7.0) & (x > 29.0), 18.0 + 1.3 * (7.0 - from_apse), 0.0),
        np.where(tower > 0.0, np.where(tower < 1.0, 47.0, 45.0 + 6.0 * (tower - 1.0)), 0.0),
        np.where(flying < 2.0, 34.0 + 6.0 * (2.0 - flying), 0.0),
    ]
    return np.asarray(np.max(parts, axis=0))


def _parcels(block: Block, width_m: float, depth_m: float) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats]:
    """Numbers of parcels of about the wanted size, the place within the parcel, and its sides."""
    across = np.maximum(np.rint(block.width_m / width_m), 1.0)
    down = np.maximum(np.rint(block.depth_m / depth_m), 1.0)
    w, d = block.width_m / across, block.depth_m / down
    i, j = np.floor(block.u_m / w).astype(np.int64), np.floor(block.v_m / d).astype(np.int64)
    return i, j, block.u_m - i * w, block.v_m - j * d, w, d


def _part(height: Floats, is_level: npt.NDArray[np.bool_], anchor_u: Floats, anchor_v: Floats) -> Part:
    return Part(height, np.where(is_level, anchor_u, np.nan), np.where(is_level, anchor_v, np.nan))
