"""The embedded scenes: deterministic, seeded, any size.

A scene has a fixed extent, so that every size shows the same landscape at another resolution (what comparisons of
resolutions need): the posts lie ``extent / (size - 1)`` apart. Each module is imported when its scene is first made,
because scipy takes longer to import than a terrain file takes to open.
"""

from __future__ import annotations

from importlib import import_module
from typing import NamedTuple

from terrain.errors import InputError
from terrain.heightfield import Heightfield

MAX_POSTS = 32769


class SyntheticScene(NamedTuple):
    """One line about a landscape, and its maker: a module with ``EXTENT_M`` and ``<stem>_heights(size, seed)``."""

    about: str
    module: str
    stem: str


SCENES: dict[str, SyntheticScene] = {
    "alps": SyntheticScene("Eroded mountains up to 4000 m, valleys and lakes; 30 km across.", "alps", "alps"),
    "city": SyntheticScene("Streets, roofs and vertical walls on a river; 1 km across.", "city", "city"),
    "plain": SyntheticScene("Fields and a meandering river, 30 m of relief; 4 km across.", "plain", "plain"),
    "snake": SyntheticScene("A scaly snake on winding ridges, detail at every size; 2 km across.", "snake", "snake"),
    "planes": SyntheticScene("Quiet hills; the ray caster adds a wall and a slab.", "slabs", "slabs"),
    "flat": SyntheticScene("A level plane.", "analytic", "flat"),
    "ramp": SyntheticScene("An inclined plane.", "analytic", "ramp"),
    "cone": SyntheticScene("A cone on a plane.", "analytic", "cone"),
    "step": SyntheticScene("A cliff one cell wide.", "analytic", "step"),
    "needle": SyntheticScene("One high post in a plane.", "analytic", "needle"),
    "waves": SyntheticScene("Smooth waves.", "analytic", "waves"),
}


def make_scene(name: str, size: int = 1025, seed: int = 0) -> Heightfield:
    """An embedded scene.

    Parameters
    ----------
    name : str
        One of `SCENES`.
    size : int
        Posts along each side, 2 to `MAX_POSTS`.
    seed : int
        Another seed, another landscape, 0 or more; the analytic scenes have but one.

    Returns
    -------
    Heightfield
        ``size`` x ``size`` posts over the scene's extent.

    Raises
    ------
    InputError
        If there is no such scene, or the size or seed is out of range.
    """
    scene = SCENES.get(name)
    if scene is None:
        raise InputError(f"Expected a scene of {', '.join(SCENES)}, found {name!r}.")
    if not 2 <= size <= MAX_POSTS:
        raise InputError(f"Expected 2 to {MAX_POSTS} posts along each side, found {size}.")
    if seed < 0:
        raise InputError(f"Expected a seed of 0 or more, found {seed}.")
    module = import_module(f"terrain.synthetic.{scene.module}")
    spacing_m = module.EXTENT_M / (size - 1)
    heights = getattr(module, f"{scene.stem}_heights")(size, seed)
    note = f"Embedded scene, seed {seed}: {scene.about}"
    return Heightfield(heights, (spacing_m, spacing_m), name=name, notes=(note,))
