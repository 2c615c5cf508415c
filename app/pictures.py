"""The pictures of the README: the window, every algorithm beside its debug view, and the chart.

``python -m app.pictures`` makes them anew, off screen, within some minutes. Every file stays below 200 kB.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from imgui_bundle import imgui, implot
from PIL import Image

from app.commands.table import COMMANDS
from app.flying.controls import Inputs
from app.opening.drawing import read_drawing
from app.opening.terrain import open_terrain
from app.output.capture import Picture, replacing
from app.places.framing import frame_terrain
from app.session.session import Session
from app.viewer import gui
from app.viewer.panel import Panel
from terrain.camera import Camera
from terrain.gpu.context import Gpu, create_offscreen_gpu
from terrain.heightfield import Heightfield
from terrain.measure.chart import draw_chart
from terrain.views import View

FOLDER = Path("assets/pictures")
LARGEST_BYTES = 200_000
QUALITIES = (92, 88, 84, 80, 75, 70, 60, 50)
WINDOW_PX, HALVES_PX, CHART_DPI = (1280, 720), (960, 400), 90
FRAME_S = 1.0 / 30.0
AT_S = 2.0  # of the demo flight: what the window shows
NEARER = 0.42  # where the algorithms are seen from: on the way from where the whole terrain is seen to its middle
MEASURED_PX, CHART_FRAMES = (640, 360), 4
DEBUG_VIEWS: dict[str, View] = {
    "slicing": "overdraw", "painter": "levels", "perturbation": "wireframe", "multiresolution": "levels",
    "geomorph": "levels",
}  # fmt: skip


class OffscreenWindow:
    """The window's contents, drawn into a framebuffer: ImGui without a window library.

    Parameters
    ----------
    session : Session
    size_px : tuple of int
    """

    def __init__(self, session: Session, size_px: tuple[int, int]) -> None:
        self.session, self._panel = session, Panel()
        gui.create_context(session.preferences)
        imgui.backends.opengl3_init("#version 330")
        imgui.get_io().display_size, imgui.get_io().delta_time = imgui.ImVec2(*size_px), FRAME_S
        ctx = session.gpu.ctx
        self._texture = ctx.texture(size_px, 4)
        self._framebuffer = ctx.framebuffer([self._texture])

    def frame(self) -> None:
        """One frame, as in `app.viewer.window`."""
        session = self.session
        imgui.backends.opengl3_new_frame()
        imgui.new_frame()
        session.advance(Inputs(), FRAME_S)
        gui.show_picture(session)
        self._panel.draw(session)
        session.gpu.release_state()
        self._framebuffer.use()
        self._framebuffer.clear()
        imgui.render()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())

    def read(self) -> Picture:
        """What the frame drew last."""
        width, height = self._texture.size
        rows = np.frombuffer(self._texture.read(), np.uint8).reshape(height, width, 4)
        return np.ascontiguousarray(rows[::-1, :, :3])

    def __enter__(self) -> OffscreenWindow:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: TracebackType | None) -> None:
        imgui.backends.opengl3_shutdown()
        implot.destroy_context()
        imgui.destroy_context()
        self.session.gpu.release_framebuffer(self._framebuffer)
        self._texture.release()


def draw_halves(session: Session, algorithm: str, size_px: tuple[int, int]) -> Picture:
    """An algorithm's picture on the left, and what its debug view shows of it on the right."""
    session.algorithms.choose(algorithm)
    stage, camera = session.stage, _closer(session.heightfield, size_px[0] / size_px[1])
    stage.draws_legends = False
    shaded, debug = (stage.render(camera, size_px, view) for view in ("shaded", DEBUG_VIEWS[algorithm]))
    middle = size_px[0] // 2
    picture = np.concatenate([shaded[:, :middle], debug[:, middle:]], axis=1)
    picture[:, middle - 1 : middle + 1] = 255
    return picture


def _closer(heightfield: Heightfield, aspect: float) -> Camera:
    """A camera from which the terrain fills the picture."""
    camera = frame_terrain(heightfield, aspect)
    width, depth = heightfield.extent_m
    middle = np.array([width / 2, sum(heightfield.height_range_m) / 2, depth / 2])
    x, y, z = (camera.eye_m + NEARER * (middle - camera.eye_m)).tolist()
    return replace(camera, position_m=(x, y, z))


def measure(session: Session) -> dict[str, Any]:
    """The runs that the laboratory measures, at a small size."""
    lab = session.laboratory
    session.draw(MEASURED_PX)
    lab.frames = CHART_FRAMES
    lab.measure_runs()
    while lab.is_busy:
        lab.work()
    assert lab.results is not None
    return lab.results


def draw_window(session: Session, size_px: tuple[int, int]) -> Picture:
    """The window with the laboratory open."""
    session.layout.show("laboratory")
    session.look_from(session.flights.camera_at(AT_S))
    session.say("")
    with OffscreenWindow(session, size_px) as window:
        for _ in range(8):
            window.frame()
        return window.read()


def save_small(picture: Picture, path: Path) -> None:
    """Write a JPEG, as good as it can be below `LARGEST_BYTES`."""
    for quality in QUALITIES:
        packed = io.BytesIO()
        Image.fromarray(picture).save(packed, "JPEG", quality=quality, subsampling=0)
        if packed.tell() <= LARGEST_BYTES:
            break
    with replacing(path, overwrite=True) as temporary:
        temporary.write_bytes(packed.getvalue())


def save_chart(results: dict[str, Any], path: Path) -> None:
    """Draw the chart of results as PNG; its few colours make it small."""
    packed = io.BytesIO()
    draw_chart(results).savefig(packed, dpi=CHART_DPI, format="png")
    with Image.open(packed) as image, replacing(path, overwrite=True) as temporary:
        image.convert("RGB").quantize(128).save(temporary, "PNG", optimize=True)


def open_session(gpu: Gpu, terrain: str) -> Session:
    """A session on a terrain, as ``reliefscope TERRAIN`` opens it."""
    parser = argparse.ArgumentParser()
    COMMANDS["view"].add_options(parser)
    args = parser.parse_args([terrain])
    return Session(gpu, open_terrain(args), read_drawing(args))


def main(argv: Sequence[str] | None = None) -> int:
    """Make all pictures."""
    parser = argparse.ArgumentParser(prog="python -m app.pictures", description=main.__doc__)
    parser.add_argument("--out", metavar="DIR", type=Path, default=FOLDER, help="where to (assets/pictures)")
    parser.add_argument("--terrain", metavar="NAME", default="alps:1025", help="of what (alps:1025)")
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    session = open_session(create_offscreen_gpu(), args.terrain)
    try:
        save_chart(measure(session), args.out / "chart.png")
        save_small(draw_window(session, WINDOW_PX), args.out / "window.jpg")
        for algorithm in DEBUG_VIEWS:
            save_small(draw_halves(session, algorithm, HALVES_PX), args.out / f"{algorithm}.jpg")
    finally:
        session.close()
    for path in sorted(args.out.iterdir()):
        print(f"{path}  {path.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
