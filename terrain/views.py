"""The views of a stage: the shaded picture and the debug views, built once for all renderers.

Each debug view asks the renderer for another output of its fragments (``shaders/lib/output.glsl``) or draws lines over
the shaded picture; none knows an algorithm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame, Output
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.lines import Lines, blending
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import Target
from terrain.heightfield import Diagonal
from terrain.renderers.base import Boxes

Floats = npt.NDArray[np.float64]
View = Literal["shaded", "wireframe", "boxes", "overdraw", "levels", "normals", "error"]


class ViewHelp(NamedTuple):
    """What to call a view, and one sentence about it."""

    title: str
    help: str


VIEWS: dict[View, ViewHelp] = {
    "shaded": ViewHelp("Shaded", "The picture itself."),
    "wireframe": ViewHelp("Wireframe", "The edges of all triangles drawn, over the picture."),
    "boxes": ViewHelp("Boxes", "The bounding boxes that were chosen, coloured by level of detail."),
    "overdraw": ViewHelp("Overdraw", "How many times each pixel was drawn."),
    "levels": ViewHelp("Levels", "One colour per level of detail."),
    "normals": ViewHelp("Normals", "The direction of the drawn surface, as a colour."),
    "error": ViewHelp(
        "Error", "Measured error: white none, orange above, blue below; full at the tolerance, then dark."
    ),
}

FLOATS_PER_BOX = 7
WIRE_LEVELS = 3  # of mipmaps, for the density of lines
BOX_LINE_PX = 1.4
HIDDEN_OPACITY = 0.18  # of box edges that the ground hides
FRUSTUM_COLOUR = (1.0, 0.35, 0.1, 0.95)


class Overlays:
    """What the debug views draw over a picture or instead of one. Draws into the bound target."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self.lines = Lines(gpu)
        self._heat = Geometry(gpu, "fullscreen", "view_overdraw")
        self._wires = Geometry(gpu, "fullscreen", "view_wires")
        self._marked: moderngl.Texture | None = None  # a picture with its lines marked
        self._error_pass = Geometry(gpu, "fullscreen", "measure_error")
        self._error_heat = Geometry(gpu, "fullscreen", "view_error")
        self._box_buffer = gpu.ctx.buffer(reserve=4 * FLOATS_PER_BOX * 1024, dynamic=True)
        content = [(self._box_buffer, "3f 3f 1f /i", "in_lower_m", "in_upper_m", "in_level")]
        self._boxes = Geometry(gpu, "view_boxes", "view_boxes", content)

    def draw_boxes(self, frame: Frame, boxes: Boxes) -> None:
        """Edges of bounding boxes, coloured by level; faint where the ground hides them."""
        count = len(boxes.level)
        if not count:
            return
        data = np.empty((count, FLOATS_PER_BOX), np.float32)
        data[:, 0:3] = boxes.lower_m - frame.eye_m
        data[:, 3:6] = boxes.upper_m - frame.eye_m
        data[:, 6] = boxes.level
        if data.nbytes > self._box_buffer.size:
            self._box_buffer.orphan(2 * data.nbytes)
        self._box_buffer.write(data)
        program = self._boxes.program("flat")
        program["u_line_width_px"] = BOX_LINE_PX
        with blending(self._gpu):
            for depth_func, opacity in (("<=", HIDDEN_OPACITY), (">", 1.0)):
                self._gpu.ctx.depth_func = depth_func
                program["u_opacity"] = opacity
                self._boxes.render("flat", moderngl.TRIANGLES, 72, instances=count)

    def draw_wires(self, target: Target, draw_lines: Callable[[], None]) -> None:
        """Lines over a picture, fainter where they are dense.

        ``draw_lines`` marks them in the target's alpha; colours and depth stay as they are meanwhile.
        """
        ctx, framebuffer = self._gpu.ctx, target.framebuffer
        framebuffer.use()
        framebuffer.color_mask = False, False, False, True
        framebuffer.depth_mask = False
        framebuffer.clear()
        ctx.wireframe = True
        ctx.polygon_offset = 1.0, 1.0
        try:
            draw_lines()
        finally:
            ctx.polygon_offset = 0.0, 0.0
            ctx.wireframe = False
            framebuffer.depth_mask = True
            framebuffer.color_mask = True, True, True, True
        if self._marked is None or self._marked.size != target.size_px:
            if self._marked is not None:
                self._marked.release()
            self._marked = ctx.texture(target.size_px, 4)
            self._marked.repeat_x = self._marked.repeat_y = False
        ctx.copy_framebuffer(self._marked, framebuffer)
        self._marked.build_mipmaps(0, WIRE_LEVELS)
        self._marked.filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.NEAREST
        framebuffer.use()
        self._marked.use(UNITS["u_source"])
        ctx.disable(moderngl.DEPTH_TEST)
        self._wires.render("flat", vertices=3)
        self._gpu.prepare_state()

    def draw_overdraw(self, counts: Target, legend: bool = True) -> None:
        """The counts as colours, with or without a legend in the picture."""
        self._heat.program("flat")["u_legend"] = legend
        self._draw_from(counts, "u_source", self._heat, "flat")

    def measure_error(self, positions: Target, diagonal: Diagonal) -> None:
        """The error [px], vertical error [m], distance [m] and cover of every point of a position target.

        Against the reference surface of a diagonal rule, for the frame that the frame block holds.
        """
        self._error_pass.program("position")["u_uniform_diagonals"] = int(diagonal == "uniform")
        self._draw_from(positions, "u_extra0", self._error_pass, "position")

    def draw_error(self, errors: Target, tolerance_px: float) -> None:
        """What `measure_error` found, as colours."""
        self._error_heat.program("flat")["u_tolerance_px"] = tolerance_px
        self._draw_from(errors, "u_extra1", self._error_heat, "flat")

    def _draw_from(self, source: Target, sampler: str, content: Geometry, output: Output) -> None:
        """Fill the bound target from another one, pixel by pixel."""
        source.texture.use(UNITS[sampler])
        self._gpu.ctx.disable(moderngl.DEPTH_TEST)
        content.render(output, vertices=3)
        self._gpu.ctx.enable(moderngl.DEPTH_TEST)

    def draw_frustum(self, frame: Frame, frozen: Frame, far_m: float) -> None:
        """The pyramid that another frame sees, ``far_m`` deep."""
        self.lines.draw(frame, frustum_segments(frozen.camera, frozen.aspect, far_m), FRUSTUM_COLOUR, 2.0, 0.4)

    def release(self) -> None:
        parts = self._heat, self._wires, self._error_pass, self._error_heat, self._boxes, self._box_buffer, self.lines
        for part in parts:
            part.release()
        if self._marked is not None:
            self._marked.release()


def frustum_segments(camera: Camera, aspect: float, far_m: float) -> Floats:
    """Edges (n, 2, 3) of what a camera sees: four rays from the eye, a frame at the end and one at a quarter."""
    tangent = np.tan(np.radians(camera.fov_deg) / 2.0)
    corner = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]) * [tangent * aspect, tangent, 1.0]
    ray = corner @ camera.view_from_eye()  # (4, 3), view depth 1
    eye = np.broadcast_to(camera.eye_m, (4, 3))
    rings = [camera.eye_m + ray * far_m * share for share in (0.25, 1.0)]
    edges = [np.stack([eye, rings[-1]], axis=1)]
    edges += [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    return np.concatenate(edges)


def overdraw_figures(counts: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Mean and maximum number of times a covered pixel was drawn; zeros where nothing was."""
    covered = counts[counts > 0.5]
    return (float(covered.mean(dtype=np.float64)), float(covered.max())) if covered.size else (0.0, 0.0)
