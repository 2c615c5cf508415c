"""The sky behind the terrain: a coarse grid whose corners hold its colours (``shaders/sky.vert``)."""

from __future__ import annotations

import moderngl

from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry

SKY_COLS, SKY_ROWS = 40, 36  # cells of about 2.5 degrees: narrower than the glow around the sun


class Sky:
    """Draws the sky into the bound target, at the far end of depth."""

    def __init__(self, gpu: Gpu) -> None:
        self._grid = Geometry(gpu, "sky", "sky", defines={"SKY_COLS": f"{SKY_COLS}.0", "SKY_ROWS": f"{SKY_ROWS}.0"})

    def draw(self) -> None:
        """One strip of triangles per row of the grid; depth test and function are the caller's."""
        self._grid.render("shaded", moderngl.TRIANGLE_STRIP, vertices=2 * (SKY_COLS + 1), instances=SKY_ROWS)

    def release(self) -> None:
        self._grid.release()
