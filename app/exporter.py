"""Films, frames and large pictures from the window: drawn off screen, in slices between the window's own frames.

An export has a stage of its own, with the settings of the moment it was asked for: what is changed in the window
meanwhile changes nothing in it. It draws with settings that depend on no earlier frame (`Settings.unhurried`): each
frame in full detail, the same at any frame rate, the same as ``reliefscope render`` draws. What a cancelled film or a
cancelled series of frames holds by then is kept.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from app.capture import open_png, open_sink
from app.place import is_straight_down, picture_notes, straightened, world_file, world_file_path
from app.rendering import draw_bands, draw_slowly, flight_times
from terrain.errors import InputError
from terrain.flight import numbered_path
from terrain.flight.file import write_text

if TYPE_CHECKING:
    from app.session import Session

SLICE_S, STILL_SLICE_S = 0.03, 0.2  # of every frame of the window: while one flies, and while nothing moves
WINDOW_TILE_PX = 1024  # so that no tile keeps the window waiting
Kind = Literal["film", "frames", "picture"]
KINDS: dict[Kind, str] = {
    "film": "The flight as MP4.",
    "frames": "The flight as a folder of PNG files.",
    "picture": "The present view as one large PNG.",
}
SIDES_PX, FPS, FRAMES = (16, 16384), (1, 240), (0, 100_000)
Steps = Generator[float, None, None]


@dataclass
class Order:
    """What to export; filled in by the export window.

    ``frames`` 0 makes as many as the flight's duration asks for. ``straight_down`` is for pictures: a map, with a world
    file beside it.
    """

    kind: Kind = "film"
    width_px: int = 1920
    height_px: int = 1080
    fps: int = 30
    frames: int = 0
    codec: str = "h264"
    straight_down: bool = False


class Exporter:
    """One export at a time.

    Attributes
    ----------
    order : Order
        The next one.
    doing : str
        What is being exported; empty where nothing is.
    share : float
        How much of it is done.
    shows_window : bool
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.order = Order()
        self.doing, self.share = "", 0.0
        self.shows_window = False
        self._task: Steps | None = None
        self._begin_s = 0.0

    @property
    def is_busy(self) -> bool:
        return self._task is not None

    @property
    def left_s(self) -> float | None:
        """How long it will take, at the pace so far; None before anything is known."""
        if self.share < 0.01:
            return None
        return (time.perf_counter() - self._begin_s) * (1.0 - self.share) / self.share

    def start(self) -> None:
        """Begin what is ordered, under a new name in the session's folder."""
        self.cancel()
        session, order = self._session, self.order
        suffix = {"film": ".mp4", "frames": "-frames", "picture": ".png"}[order.kind]
        path = numbered_path(session.folder / f"{session.heightfield.name}{suffix}")
        work = self._picture if order.kind == "picture" else self._film
        self._task, self.doing, self.share = work(order, path), path.name, 0.0
        self._begin_s = time.perf_counter()

    def work(self) -> None:
        """Draw for a slice of time."""
        if self._task is None:
            return
        session, begin_s = self._session, time.perf_counter()
        slice_s = STILL_SLICE_S if session.is_still else SLICE_S
        try:
            self.share = next(self._task)
            while time.perf_counter() - begin_s < slice_s:
                self.share = next(self._task)
        except StopIteration:
            self._task, self.doing = None, ""
        except (InputError, MemoryError, RuntimeError, ValueError, OSError) as error:
            self._task, self.doing = None, ""
            session.say(f"The export stopped: {error or type(error).__name__}.".replace("..", "."))

    def cancel(self) -> None:
        """Stop; a film or frames keep what is done."""
        if self._task is not None:
            self._session.say(f"Export cancelled; what was done of {self.doing} is kept, unless it is one picture.")
            self.close()

    def close(self) -> None:
        if self._task is not None:
            self._task.close()
            self._task, self.doing = None, ""

    def _film(self, order: Order, path: Path) -> Steps:
        session = self._session
        flights = session.flights
        times_s = flight_times(flights.duration_s, order.frames or None, order.fps)
        cameras = [flights.camera_at(t) for t in times_s]
        view, size_px = session.view, (order.width_px, order.height_px)
        with ExitStack() as stack:
            stage = stack.enter_context(session.twin_stage())
            sink = stack.enter_context(open_sink(path, size_px, order.fps, codec=order.codec))
            for number, (camera, time_s) in enumerate(zip(cameras, times_s, strict=True)):
                picture = yield from self._drawn(stage, camera, size_px, view, time_s, number / len(times_s))
                sink.add(picture)
                yield (number + 1) / len(times_s)
        session.say(f"Exported {path}: {len(times_s)} frames of {size_px[0]} x {size_px[1]}.")

    def _drawn(
        self, stage: Any, camera: Any, size_px: tuple[int, int], view: Any, time_s: float, share: float
    ) -> Generator[float, None, Any]:
        """A picture drawn in tiles, telling the share of the film that is done."""
        steps = draw_slowly(stage, camera, size_px, view, time_s, WINDOW_TILE_PX)
        while True:
            try:
                next(steps)
            except StopIteration as done:
                return done.value
            yield share

    def _picture(self, order: Order, path: Path) -> Steps:
        session = self._session
        camera = straightened(session.camera) if order.straight_down else session.camera
        size_px, terrain = (order.width_px, order.height_px), session.heightfield
        notes = picture_notes(camera, terrain, algorithm=session.algorithm, tolerance_px=session.settings.tolerance_px)
        rows = 0
        with session.twin_stage() as stage, open_png(path, size_px, notes) as png:
            for band in draw_bands(stage, camera, size_px, session.view, session.clock_s, WINDOW_TILE_PX):
                if band is not None:
                    png.add(band)
                    rows += len(band)
                yield rows / size_px[1]
        told = f"Exported {path}, {size_px[0]} x {size_px[1]}"
        if is_straight_down(camera):
            write_text(world_file_path(path), world_file(camera, terrain, size_px))
            told += f", and {world_file_path(path).name} beside it"
        session.say(f"{told}.")
