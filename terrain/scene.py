"""A scene: one height field and its pyramid. Pure data; the GPU's copies are made by those who draw it."""

from __future__ import annotations

from dataclasses import dataclass

from terrain.heightfield import Heightfield
from terrain.pyramid import Pyramid, load_pyramid


@dataclass(frozen=True, eq=False)
class Scene:
    """What every renderer draws: the terrain and the bounds made from it."""

    heightfield: Heightfield
    pyramid: Pyramid

    def exaggerated(self, factor: float) -> Scene:
        """The same scene with true heights times ``factor``; the pyramid is scaled, not rebuilt."""
        scale = factor / self.heightfield.exaggeration
        return Scene(self.heightfield.exaggerated(factor), self.pyramid.scaled(scale))


def open_scene(heightfield: Heightfield) -> Scene:
    """The scene of a height field; its pyramid comes from the cache where it was built before."""
    return Scene(heightfield, load_pyramid(heightfield))
