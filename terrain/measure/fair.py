"""Fair switching: settings at which algorithms deliver the same error, or cost the same, or suit a wish best.

What an algorithm calls a tolerance is its own affair: one delivers half of what it is allowed, another a little more.
*Equal error* turns each algorithm's tolerance until 99.9 % of the pixels of a few frames err by no more than the wanted
error and no less; *equal time* does the same for the median frame time; *best for me* looks an answer up among runs
that were measured before.

Tuning is a generator of small steps, one drawn frame each, so that a window stays responsive.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from terrain.camera import Camera
from terrain.measure.accuracy import Pool, drawn_by
from terrain.measure.cost import time_frame, warm_up
from terrain.renderers import RENDERERS
from terrain.renderers.base import Renderer
from terrain.stage import Stage

TRIES = 9  # of a range of 1 : 64 the eighth halving leaves 1.6 %
CLOSE = 0.03  # relative: as near as is worth another try
REACHED = 0.1  # relative: further away the algorithm cannot deliver what was wanted
LEAST_FIGURE = 1e-6

View = tuple[float, Camera]
Steps = Generator[None, None, float]


@dataclass(frozen=True)
class Tuned:
    """What tuning one algorithm came to.

    Attributes
    ----------
    algorithm : str
    settings : Settings
        Its own, with the tolerance found.
    figure : float
        What it delivers there: error [px] or frame time [ms].
    is_reached : bool
        Whether that is what was wanted; if not, no tolerance within the algorithm's range delivers it.
    """

    algorithm: str
    settings: Any
    figure: float
    is_reached: bool


def search_tolerance(
    wanted: float, limits: tuple[float, float], falls: bool = False, tries: int = TRIES
) -> Generator[float, float, tuple[float, float]]:
    """Bisection in the logarithm of the tolerance: yields the tolerance to try, is sent the figure measured there.

    Parameters
    ----------
    wanted : float
        The figure to find, above 0.
    limits : tuple of float
        Least and largest tolerance [px].
    falls : bool
        Whether the figure falls with the tolerance (time) instead of rising (error).
    tries : int
        Largest number of measurements.

    Returns
    -------
    tuple of float
        The tolerance whose figure came nearest to ``wanted`` in proportion, and that figure.
    """
    low, high = limits
    best: tuple[float, float] | None = None
    for number in range(tries):
        # Most algorithms deliver about what they are allowed: an error is looked for around itself first.
        is_first = number == 0 and not falls and low < wanted < high
        tolerance = wanted if is_first else math.sqrt(low * high)
        figure = yield tolerance
        if best is None or _distance(figure, wanted) < _distance(best[1], wanted):
            best = tolerance, figure
        if _distance(figure, wanted) < CLOSE:
            break
        if (figure > wanted) != falls:
            high = tolerance
        else:
            low = tolerance
    assert best is not None
    return best


def equal_error(
    stage: Stage, settings: Mapping[str, Any], views: Sequence[View], size_px: tuple[int, int], wanted_px: float
) -> Iterator[Tuned | None]:
    """Tune every algorithm until 99.9 % of the pixels of ``views`` err by ``wanted_px`` at most.

    Parameters
    ----------
    stage : Stage
    settings : mapping
        The settings of each algorithm to tune; all but the tolerance stay.
    views : sequence of (time_s, Camera)
    size_px : tuple of int
    wanted_px : float

    Yields
    ------
    Tuned or None
        None after each drawn frame, and an algorithm's result when it is found.
    """
    for name, own in settings.items():
        yield from _tune(stage, name, own, lambda renderer: delivered_error(stage, renderer, views, size_px), wanted_px)


def equal_time(
    stage: Stage, settings: Mapping[str, Any], views: Sequence[View], size_px: tuple[int, int], wanted_ms: float
) -> Iterator[Tuned | None]:
    """Tune every algorithm until its median frame takes ``wanted_ms``; see `equal_error`."""
    for name, own in settings.items():
        tune = _tune(
            stage, name, own, lambda renderer: median_frame(stage, renderer, views, size_px), wanted_ms, falls=True
        )
        yield from tune


def delivered_error(stage: Stage, renderer: Renderer, views: Sequence[View], size_px: tuple[int, int]) -> Steps:
    """The 99.9th percentile of the error [px] over all pixels of the views; a step for each."""
    pool = Pool()
    for time_s, camera in views:
        with drawn_by(stage, renderer):
            errors = stage.errors(camera, size_px, time_s)
        pool.add(errors[..., 0][errors[..., 3] > 0.5])
        yield
    return pool.percentile(99.9)


def median_frame(stage: Stage, renderer: Renderer, views: Sequence[View], size_px: tuple[int, int]) -> Steps:
    """The median time of a frame [ms], each view drawn twice after one to warm up; a step for each view."""
    times = []
    for time_s, camera in views:
        target = stage.target(size_px)
        warm_up(stage, renderer, camera, time_s, target, frames=1)
        times += [time_frame(stage, renderer, camera, time_s, target)["frame_ms"] for _ in range(2)]
        yield
    return float(np.median(times))


def best_for_error(runs: Sequence[Mapping[str, Any]], error_px: float) -> Mapping[str, Any] | None:
    """The fastest run of a results file that keeps 99.9 % of the pixels within ``error_px``; None where none does."""
    fit = [run for run in runs if is_measured(run) and run["geometric_error_px"]["p999"] <= error_px]
    return min(fit, key=lambda run: (run["frame_ms"]["p50"], run["geometric_error_px"]["p999"]), default=None)


def best_for_time(runs: Sequence[Mapping[str, Any]], frame_ms: float) -> Mapping[str, Any] | None:
    """The most accurate run of a results file whose median frame takes no longer than ``frame_ms``; None if none."""
    fit = [run for run in runs if is_measured(run) and run["frame_ms"]["p50"] <= frame_ms]
    return min(fit, key=lambda run: (run["geometric_error_px"]["p999"], run["frame_ms"]["p50"]), default=None)


def is_measured(run: Mapping[str, Any]) -> bool:
    """Whether both time and error of a run are known."""
    return "frame_ms" in run and "geometric_error_px" in run


def settings_of(run: Mapping[str, Any]) -> Any:
    """The settings of a run of a results file, ready for its renderer."""
    return RENDERERS[run["algorithm"]].Settings(**run["settings"])


def _tune(
    stage: Stage, name: str, settings: Any, measure: Any, wanted: float, falls: bool = False
) -> Iterator[Tuned | None]:
    """Measure at the tolerances that the search asks for; yields as `equal_error`."""
    field = next(f for f in fields(settings) if f.name == "tolerance_px")
    search = search_tolerance(wanted, field.metadata["range"], falls)
    tolerance, figure = next(search), math.nan
    renderer = RENDERERS[name](stage.gpu, stage.scene, replace(settings, tolerance_px=tolerance))
    try:
        yield None
        while True:
            renderer.settings = replace(settings, tolerance_px=tolerance)
            figure = yield from measure(renderer)
            try:
                tolerance = search.send(figure)
            except StopIteration as found:
                tolerance, figure = found.value
                break
    finally:
        renderer.release()
    yield Tuned(name, replace(settings, tolerance_px=tolerance), figure, _distance(figure, wanted) < REACHED)


def _distance(figure: float, wanted: float) -> float:
    """How far apart two figures are in proportion: 0.1 for 10 %."""
    return abs(math.log(max(figure, LEAST_FIGURE) / wanted))
