"""The stability strip: holes, pops and slow frames along a flight, for the bar under its timeline.

The same figures as in the check of hostile scenes, of a small picture and with its limits: any hole counts, a change of
the error between two frames counts where it exceeds what the promise allows, a frame counts as slow against the median
of the flight and only where one can see it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from terrain.camera import Camera
from terrain.gpu.targets import create_target
from terrain.measure.accuracy import AccuracyMeter
from terrain.measure.cost import time_frame
from terrain.renderers.base import Renderer
from terrain.stage import Stage

SIZE_PX = (320, 180)
POP_SHARE = 2.5  # an error may go from one end of the promise's 1.25 tolerances to the other, and no further
SLOW_FACTOR, SLOW_MS = 3.0, 1000 / 60


@dataclass(frozen=True)
class StripFrame:
    """One frame of the strip.

    Attributes
    ----------
    time_s : float
        Since the start of the flight.
    holes_px : int
    popping_px : float
        Largest change since the frame before; 0 in the first.
    frame_ms : float
    """

    time_s: float
    holes_px: int
    popping_px: float
    frame_ms: float


@dataclass(frozen=True)
class Marks:
    """Which frames of a strip are wrong, by number."""

    holes: tuple[int, ...]
    pops: tuple[int, ...]
    slow: tuple[int, ...]


def measure_strip(stage: Stage, renderer: Renderer, views: Sequence[tuple[float, Camera]]) -> Iterator[StripFrame]:
    """Fly along ``views``, (time_s, Camera) each, and measure every frame; a step for each."""
    meter = AccuracyMeter(stage, SIZE_PX)
    target = create_target(stage.gpu, SIZE_PX)
    try:
        for time_s, camera in views:
            frame_ms = time_frame(stage, renderer, camera, time_s, target)["frame_ms"]
            found = meter.measure(renderer, camera, time_s, meter.truth(camera, renderer.diagonal))
            popping = 0.0 if found.popping_px is None else float(np.abs(found.popping_px).max(initial=0.0))
            yield StripFrame(time_s, found.holes_px, popping, frame_ms)
    finally:
        target.release()
        meter.release()


def find_marks(frames: Sequence[StripFrame], tolerance_px: float) -> Marks:
    """The frames with holes, with a change of error beyond the promise, and those far slower than the median.

    The first frame makes what the others use: its time does not count.
    """
    if not frames:
        return Marks((), (), ())
    limit_ms = slow_limit_ms(frames)
    return Marks(
        tuple(i for i, frame in enumerate(frames) if frame.holes_px),
        tuple(i for i, frame in enumerate(frames) if frame.popping_px > POP_SHARE * tolerance_px),
        tuple(i for i, frame in enumerate(frames) if i and frame.frame_ms > limit_ms),
    )


def slow_limit_ms(frames: Sequence[StripFrame]) -> float:
    """Longest time of a frame [ms] that does not count as slow."""
    return max(SLOW_FACTOR * float(np.median([frame.frame_ms for frame in frames])), SLOW_MS)
