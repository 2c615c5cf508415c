"""A scene: one height field, its pyramid, and base planes beside it. Pure data; the GPU's copies are made by those who
draw it."""

from __future__ import annotations

from dataclasses import dataclass

from terrain.breaklines import Breaklines
from terrain.heightfield import Heightfield
from terrain.planes import BasePlane
from terrain.pyramid import Pyramid, load_pyramid


@dataclass(frozen=True, eq=False)
class Scene:
    """What every renderer draws: the terrain and the bounds made from it.

    ``planes`` stand beside the terrain; only the ray caster of perturbed base planes draws them. ``breaklines`` refine
    its cells; only the multiresolution patches have them.
    """

    heightfield: Heightfield
    pyramid: Pyramid
    planes: tuple[BasePlane, ...] = ()
    breaklines: Breaklines | None = None

    def exaggerated(self, factor: float) -> Scene:
        """The same scene with true heights times ``factor``; the pyramid is scaled, not rebuilt."""
        scale = factor / self.heightfield.exaggeration
        lines = None if self.breaklines is None else self.breaklines.scaled(scale)
        return Scene(self.heightfield.exaggerated(factor), self.pyramid.scaled(scale), self.planes, lines)


def open_scene(
    heightfield: Heightfield, planes: tuple[BasePlane, ...] = (), breaklines: Breaklines | None = None
) -> Scene:
    """The scene of a height field; its pyramid comes from the cache where it was built before."""
    return Scene(heightfield, load_pyramid(heightfield), planes, breaklines)
