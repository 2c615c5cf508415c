"""The embedded scenes: deterministic, seeded, any size.

A scene has a fixed extent, so that every size shows the same landscape at another resolution (what comparisons of
resolutions need): the posts lie ``extent / (size - 1)`` apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.synthetic import analytic
from terrain.synthetic.alps import EXTENT_M as ALPS_EXTENT_M
from terrain.synthetic.alps import alps_heights
from terrain.synthetic.noise import Grid
from terrain.synthetic.slabs import EXTENT_M as SLABS_EXTENT_M
from terrain.synthetic.slabs import slabs_heights


class SyntheticScene(NamedTuple):
    """A landscape: heights from ``(size, seed)``, its extent, and one line about it."""

    heights: Callable[[int, int], Grid]
    extent_m: float
    about: str


def _analytic(heights: Callable[[int, int], Grid]) -> SyntheticScene:
    return SyntheticScene(heights, analytic.EXTENT_M, (heights.__doc__ or "").splitlines()[0])


SCENES: dict[str, SyntheticScene] = {
    "alps": SyntheticScene(alps_heights, ALPS_EXTENT_M, "Ridged mountains, eroded valleys, lakes: 30.7 km, to 4000 m."),
    "planes": SyntheticScene(slabs_heights, SLABS_EXTENT_M, "Quiet hills; the ray caster adds a wall and a slab."),
    "flat": _analytic(analytic.flat_heights),
    "ramp": _analytic(analytic.ramp_heights),
    "cone": _analytic(analytic.cone_heights),
    "step": _analytic(analytic.step_heights),
    "needle": _analytic(analytic.needle_heights),
    "waves": _analytic(analytic.waves_heights),
}


def make_scene(name: str, size: int = 1025, seed: int = 0) -> Heightfield:
    """An embedded scene.

    Parameters
    ----------
    name : str
        One of `SCENES`.
    size : int
        Posts along each side, 2 or more.
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
    if size < 2:
        raise InputError(f"Expected a scene of 2 x 2 posts at least, found size {size}.")
    if seed < 0:
        raise InputError(f"Expected a seed of 0 or more, found {seed}.")
    spacing_m = scene.extent_m / (size - 1)
    note = f"Embedded scene, seed {seed}: {scene.about}"
    return Heightfield(scene.heights(size, seed), (spacing_m, spacing_m), name=name, notes=(note,))
