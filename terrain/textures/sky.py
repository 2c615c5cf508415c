"""The sky behind the terrain: a coarse grid whose corners hold its colours (``shaders/sky.vert``), and the sun."""

from __future__ import annotations

import moderngl

from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry

SKY_COLS, SKY_ROWS = 24, 30  # cells of about 4 by 2 degrees: narrower than the glow around the sun


class Sky:
    """Draws the sky into the bound target, at the far end of depth."""

    def __init__(self, gpu: Gpu) -> None:
        self._ctx = gpu.ctx
        self._grid = Geometry(gpu, "sky", "sky", defines={"SKY_COLS": f"{SKY_COLS}.0", "SKY_ROWS": f"{SKY_ROWS}.0"})
        self._sun = Geometry(gpu, "sun", "sun")

    def draw(self) -> None:
        """One strip of triangles per row of the grid, then the sun; depth test and function are the caller's."""
        self._grid.render("shaded", moderngl.TRIANGLE_STRIP, vertices=2 * (SKY_COLS + 1), instances=SKY_ROWS)
        self._ctx.enable(moderngl.BLEND)
        self._ctx.blend_func = moderngl.ONE, moderngl.ONE
        self._sun.render("shaded", moderngl.TRIANGLE_STRIP, vertices=4)
        self._ctx.disable(moderngl.BLEND)

    def release(self) -> None:
        self._grid.release()
        self._sun.release()
