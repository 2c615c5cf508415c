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
from typing import TYPE_CHECKING, Any

from app.output.capture import CODECS, open_sink
from app.output.rendering import draw_slowly, flight_times, save_slowly
from app.output.whereabouts import is_straight_down, straightened, world_file_path
from app.session.jobs import FAILURES, Job, reason
from terrain.flight import numbered_path
from terrain.settings import setting

if TYPE_CHECKING:
    from app.session.session import Session

SLICE_S, STILL_SLICE_S = 0.03, 0.2  # of every frame of the window: while one flies, and while nothing moves
WINDOW_TILE_PX = 1024  # so that no tile keeps the window waiting
KINDS = {
    "film": "the flight as MP4",
    "frames": "the flight as PNG files in a folder",
    "picture": "the present view as one PNG, of any size",
}
LARGEST_PX = 16384
Steps = Generator[float, None, None]


@dataclass(frozen=True)
class Order:
    """What to export. The fields are widgets of the export window."""

    kind: str = setting(
        "film", "What", "Film: the flight as MP4; frames: as PNG files in a folder; picture: the present view as PNG.",
        choices=tuple(KINDS),
    )  # fmt: skip
    width_px: int = setting(1920, "Width", "Of the picture; large ones are drawn in tiles.", unit="px",
                            range=(16, LARGEST_PX))  # fmt: skip
    height_px: int = setting(1080, "Height", "Of the picture.", unit="px", range=(16, LARGEST_PX))
    fps: int = setting(30, "Frame rate", "Frames per second of the film.", unit="fps", range=(1, 240))
    frames: int = setting(0, "Frames", "This many, spread over the flight; 0: as many as its seconds ask for.",
                          range=(0, 20_000))  # fmt: skip
    codec: str = setting("h264", "Codec", "H.264 plays everywhere; AV1 is half the size.", choices=tuple(CODECS))
    straight_down: bool = setting(
        False, "Straight down", "Look straight down from here, and write a world file that GIS programs read."
    )


class Exporter:
    """One export at a time.

    Attributes
    ----------
    order : Order
        The next one.
    job : Job or None
        What is being exported, for the status line.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.order = Order()
        self.job: Job | None = None
        self._task: Steps | None = None
        self._path = Path()
        self._begin_s = 0.0

    @property
    def is_busy(self) -> bool:
        return self._task is not None

    @property
    def left_s(self) -> float | None:
        """How long it will take, at the pace so far; None before anything is known."""
        share = 0.0 if self.job is None else self.job.share or 0.0
        return (time.perf_counter() - self._begin_s) * (1.0 - share) / share if share >= 0.01 else None

    def start(self) -> None:
        """Begin what is ordered, under a new name in the session's folder."""
        self.cancel()
        session, order = self._session, self.order
        suffix = {"film": ".mp4", "frames": "-frames", "picture": ".png"}[order.kind]
        path = numbered_path(session.folder / f"{session.heightfield.name}{suffix}")
        work = self._picture if order.kind == "picture" else self._film
        self._task, self._path, self._begin_s = work(order, path), path, time.perf_counter()
        self.job = session.jobs.begin(f"Exporting {path.name}", "Escape cancels, what is done is kept", self.cancel)

    def work(self) -> None:
        """Draw for a slice of time."""
        if self._task is None or self.job is None:
            return
        session, begin_s = self._session, time.perf_counter()
        slice_s = STILL_SLICE_S if session.is_still else SLICE_S
        try:
            self.job.share = next(self._task)
            while time.perf_counter() - begin_s < slice_s:
                self.job.share = next(self._task)
            left_s = self.left_s
            if left_s is not None:
                self.job.name = f"Exporting {self._path.name}, {left_s:.0f} s left,"
        except StopIteration:
            self._end()
        except (*FAILURES, OSError) as error:
            self._end()
            session.say(f"The export stopped: {reason(error)}")

    def cancel(self) -> None:
        """Stop; a film or frames keep what is done."""
        if self._task is not None:
            self.close()
            kept = f"{self._path} holds what was done" if self._path.exists() else "nothing was written"
            self._session.say(f"Export cancelled: {kept}.")

    def close(self) -> None:
        if self._task is not None:
            self._task.close()
            self._end()

    def _end(self) -> None:
        self._task = None
        self._session.jobs.end(self.job)
        self.job = None

    def _film(self, order: Order, path: Path) -> Steps:
        session = self._session
        flights = session.flights
        times_s = flight_times(flights.duration_s, order.frames or None, order.fps)
        cameras = [flights.camera_at(t) for t in times_s]
        view, size_px = session.view, (order.width_px, order.height_px)
        animates = session.layers.is_playing  # as in the window: from the first key frame to the last
        with ExitStack() as stack:
            stage = stack.enter_context(session.twin_stage())
            sink = stack.enter_context(open_sink(path, size_px, order.fps, codec=order.codec))
            for number, (camera, time_s) in enumerate(zip(cameras, times_s, strict=True)):
                if animates:
                    stage.animate_layers(number / max(len(times_s) - 1, 1))
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
        size_px = order.width_px, order.height_px
        with session.twin_stage() as stage:
            yield from save_slowly(stage, camera, size_px, session.view, session.clock_s, path, tile_px=WINDOW_TILE_PX)
        beside = f", and {world_file_path(path).name} beside it" if is_straight_down(camera) else ""
        session.say(f"Exported {path}, {size_px[0]} x {size_px[1]}{beside}.")
