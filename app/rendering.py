"""Off screen: a camera or a flight drawn into pictures, frames, films and arrays of positions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from app.capture import Picture, Sink
from terrain.camera import Camera


def flight_times(duration_s: float, frames: int | None, fps: int) -> list[float]:
    """Times of the pictures of a flight [s].

    ``frames`` pictures from its first to its last moment; without a number, one every ``1 / fps``, so that a film plays
    at the speed of the flight.
    """
    if frames is None:
        return [i / fps for i in range(max(1, int(duration_s * fps + 1e-6) + 1))]
    return [0.0] if frames == 1 else np.linspace(0.0, duration_s, frames).tolist()


def draw_pictures(
    stage: Any, cameras: Iterable[Camera], times_s: Iterable[float], size_px: tuple[int, int], view: Any
) -> Iterator[Picture]:
    """The picture (height, width, 3) of each camera in turn."""
    for camera, time_s in zip(cameras, times_s, strict=True):
        yield stage.render(camera, size_px, view, time_s)


def write_pictures(pictures: Iterable[Picture], count: int, sinks: Sequence[Sink], label: str) -> None:
    """Give each picture to every sink, with a progress bar on stderr where there is more than one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    silent = count < 2 or not console.is_terminal
    with Progress(*columns, console=console, disable=silent, transient=True) as progress:
        task = progress.add_task(label, total=count)
        for picture in pictures:
            for sink in sinks:
                sink.add(picture)
            progress.advance(task)
