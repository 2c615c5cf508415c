"""The scene `planes`: quiet hills, a tilted brick wall, and a slab of rock that hangs over.

Three perturbed base planes in one picture: overhangs and upright walls need nothing but another place to stand
(Vyatkin, Pavlov and Romanyuk, section 2).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Heightfield
from terrain.planes import BasePlane, place_plane

EXTENT_M = 2048.0
RELIEF_M = 60.0
_BRICK_M, _COURSE_M, _JOINT_M = 2.4, 0.8, 0.12


def slabs_heights(size: int, seed: int) -> npt.NDArray[np.float32]:
    """Quiet hills for walls to stand on."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:size, 0:size] * (EXTENT_M / (size - 1) / 600.0)
    heights = np.zeros((size, size))
    for octave in range(6):
        turn, phase = rng.uniform(0, 2 * np.pi, 2)
        across = u * np.cos(turn) + v * np.sin(turn)
        along = v * np.cos(turn) - u * np.sin(turn)
        waves = 2.0**octave
        heights += 0.45**octave * np.sin(2 * np.pi * waves * across + phase) * np.cos(2 * np.pi * waves * along)
    return (0.25 * RELIEF_M * (heights + 2.0)).astype(np.float32)  # the octaves add up to less than 1.9


def planes_beside(terrain: Heightfield) -> tuple[BasePlane, ...]:
    """What stands beside the terrain of an embedded scene: the wall and the slab of `planes`, nothing elsewhere."""
    is_embedded = terrain.name == "planes" and any(note.startswith("Embedded scene") for note in terrain.notes)
    return build_slabs(terrain) if is_embedded else ()


def build_slabs(terrain: Heightfield) -> tuple[BasePlane, ...]:
    """The wall and the slab that stand in the middle of the hills of `slabs_heights`."""
    width, depth = terrain.extent_m
    x, z = 0.5 * width, 0.5 * depth
    ground = float(terrain.heights_at(x, z))
    # Tilted by 90 degrees, a plane's rows run downwards from its origin and its normal looks south before it is
    # turned; 84 leans it back.
    wall = place_plane((x + 15.0, ground + 32.0, z - 35.0), yaw_deg=112.0, tilt_deg=84.0)
    # Rolled by 180 degrees, its columns run west and its normal looks down.
    slab = place_plane((x - 22.0, ground + 36.0, z + 48.0), yaw_deg=92.0, tilt_deg=14.0, roll_deg=186.0)
    return (
        BasePlane(Heightfield(_bricks(rows=401, cols=701), (0.1, 0.1), name="wall"), wall, (0.70, 0.42, 0.32)),
        BasePlane(Heightfield(_rock(rows=241, cols=301), (0.25, 0.25), name="slab"), slab, (0.62, 0.58, 0.52)),
    )


def _bricks(rows: int, cols: int) -> npt.NDArray[np.float32]:
    """Courses of bricks, half a brick apart from one to the next, each set a little forward or back."""
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:rows, 0:cols] * 0.1
    course = (v / _COURSE_M).astype(np.int64)
    along = u + (course % 2) * 0.5 * _BRICK_M
    brick = (along / _BRICK_M).astype(np.int64)
    set_forward = rng.uniform(0.0, 0.12, (course.max() + 1, brick.max() + 1))[course, brick]
    to_joint = np.minimum(np.minimum(along % _BRICK_M, -along % _BRICK_M), np.minimum(v % _COURSE_M, -v % _COURSE_M))
    depth = np.clip(to_joint / _JOINT_M, 0.0, 1.0) * (0.15 + set_forward)
    return (depth + rng.normal(0.0, 0.004, depth.shape)).astype(np.float32)


def _rock(rows: int, cols: int) -> npt.NDArray[np.float32]:
    """Rough rock, made from its spectrum, that thins out towards its rim."""
    rng = np.random.default_rng(6)
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(cols)[None, :])
    frequency[0, 0] = 1.0
    wave = frequency**-1.6 * np.exp(2j * np.pi * rng.random(frequency.shape))
    wave[0, 0] = 0.0
    rock = np.fft.irfft2(wave, s=(rows, cols))
    v, u = np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, cols)[None, :]
    thick = np.sqrt(np.clip(1.0 - np.maximum(np.abs(u), np.abs(v)) ** 4, 0.0, 1.0))
    return (thick * (4.0 + rock / np.abs(rock).max() * 3.0)).astype(np.float32)
