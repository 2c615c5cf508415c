"""Lines in the world, of a width in pixels: frustums, flight paths, measuring lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry

Floats = npt.NDArray[np.float64]
BYTES_PER_SEGMENT = 24


@contextmanager
def blending(gpu: Gpu) -> Iterator[None]:
    """Blend over the picture, without culling and without writing depth; the usual state afterwards."""
    ctx = gpu.ctx
    ctx.enable(moderngl.BLEND)
    ctx.disable(moderngl.CULL_FACE)
    ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
    ctx.fbo.depth_mask = False
    try:
        yield
    finally:
        ctx.fbo.depth_mask = True
        gpu.prepare_state()


class Lines:
    """Draws segments over a picture whose frame block is bound (`terrain.stage.Stage` does that)."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._buffer = gpu.ctx.buffer(reserve=BYTES_PER_SEGMENT * 1024, dynamic=True)
        content = [(self._buffer, "3f 3f /i", "in_from_m", "in_to_m")]
        self._geometry = Geometry(gpu, "view_lines", "view_lines", content)

    def draw(
        self, frame: Frame, segments_m: Floats, colour: tuple[float, float, float, float], width_px: float = 1.5,
        hidden_opacity: float = 0.25,
    ) -> None:  # fmt: skip
        """Draw segments with the depth test of the bound target; depth is not written.

        Parameters
        ----------
        frame : Frame
        segments_m : ndarray of float64, (n, 2, 3)
            World positions.
        colour : tuple of 4 float
            sRGB and opacity.
        width_px : float
        hidden_opacity : float
            Factor on the opacity where the ground hides a line; 0 leaves hidden parts out.
        """
        count = len(segments_m)
        if not count:
            return
        data = np.ascontiguousarray(segments_m - frame.eye_m, np.float32)
        if data.nbytes > self._buffer.size:
            self._buffer.orphan(2 * data.nbytes)
        self._buffer.write(data)
        program = self._geometry.program("flat")
        program["u_line_width_px"] = width_px
        with blending(self._gpu):
            program["u_line_colour"] = colour
            self._geometry.render("flat", moderngl.TRIANGLE_STRIP, 4, instances=count)
            if hidden_opacity > 0.0:
                self._gpu.ctx.depth_func = "<="
                program["u_line_colour"] = (*colour[:3], colour[3] * hidden_opacity)
                self._geometry.render("flat", moderngl.TRIANGLE_STRIP, 4, instances=count)

    def release(self) -> None:
        self._geometry.release()
        self._buffer.release()
