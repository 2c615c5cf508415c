"""What the laboratory in the window does: measures while one flies, sweeps, tunes, meters, in slices between frames.

One task at a time: a generator whose steps draw a frame or so each; `work` runs as many as fit into its time. What a
cancelled task has finished is kept.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from app.session.jobs import FAILURES, Job, reason
from terrain.camera import Camera
from terrain.flight import numbered_path
from terrain.measure.accuracy import AccuracyMeter, Pool
from terrain.measure.fair import Tuned, best_for_error, best_for_time, equal_error, equal_time, is_measured, settings_of
from terrain.measure.results import write_results
from terrain.measure.strip import StripFrame, measure_strip
from terrain.measure.sweep import Sweep, plan_runs
from terrain.measure.waste import Waste, measure_waste
from terrain.renderers import RENDERERS

if TYPE_CHECKING:
    from app.session.session import Session

BUDGET_S, STILL_BUDGET_S = 0.015, 0.1  # of every frame, for a task: while one flies, and while nothing moves
TOLERANCES_PX = (1.0, 4.0, 2.0, 0.5, 8.0)  # in an order that shows the shape of the curve early
FRAMES_RANGE = (4, 60)
FAIR_FRAMES = 3
STRIP_FRAMES, STRIP_STEP_S = 300, 1.0 / 30.0
TRAIL_POINTS = 60
LIVE_SHARE, LIVE_PAUSE_S = 0.15, 0.25  # measuring while one flies takes no more than this share of the time


Steps = Generator[float, None, None]
"""The steps of a task, each giving the share that is done."""


class Delivered(NamedTuple):
    """What the picture on the screen is worth: measured, against what was promised."""

    algorithm: str
    tolerance_px: float
    p999_px: float
    max_px: float
    frame_ms: float

    @property
    def is_kept(self) -> bool:
        return self.p999_px <= self.tolerance_px


class Laboratory:
    """The laboratory's state.

    Attributes
    ----------
    delivered : Delivered or None
        Of the picture shown last.
    trail : deque of (frame_ms, p999_px)
        Where the current state came from.
    results : dict or None
        All runs measured so far, as in the results file.
    waste : Waste or None
    strip : list of StripFrame
    doing : str
        The task in words; empty where there is none.
    share : float
        How much of it is done.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.wanted_px, self.wanted_ms = 1.0, 1000.0 / 60.0
        self.frames = 12
        self.chosen = dict.fromkeys((name for name in RENDERERS if name != "reference"), True)
        self.delivered: Delivered | None = None
        self.trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_POINTS)
        self.results: dict[str, Any] | None = None
        self.waste: Waste | None = None
        self.strip: list[StripFrame] = []
        self.strip_tolerance_px = 1.0
        self.doing, self.share = "", 0.0
        self._task: Steps | None = None
        self._job: Job | None = None
        self._measured_key: Any = None
        self._pause_until_s = 0.0

    @property
    def runs(self) -> list[dict[str, Any]]:
        """The runs measured so far whose time and error are both known."""
        return [] if self.results is None else [run for run in self.results["runs"] if is_measured(run)]

    @property
    def is_busy(self) -> bool:
        return self._task is not None

    @property
    def wants_work(self) -> bool:
        """Whether `work` would have something to do, now or soon."""
        return self.is_busy or (self._session.layout.is_open("laboratory") and self._measured_key != self._key)

    def work(self) -> None:
        """Run steps of the task until its time is over; without a task measure the picture now and then."""
        stage, begin_s = self._session.stage, time.perf_counter()
        if self._task is None:
            if self.wants_work and begin_s >= self._pause_until_s:
                self._measure_now()
            return
        frozen, stage.frozen = stage.frozen, None  # others must choose for the views they are measured on
        try:
            self.share = next(self._task)
            budget_s = STILL_BUDGET_S if self._session.is_still else BUDGET_S
            while time.perf_counter() - begin_s < budget_s:
                self.share = next(self._task)
        except StopIteration:
            self._end()
        except FAILURES as error:
            self._end()
            self._session.say(f"The measurement stopped: {reason(error)}.")
        finally:
            stage.frozen = frozen
            if self._job is not None:
                self._job.share = self.share

    def cancel(self) -> None:
        """Stop the task; what it has finished stays."""
        if self._task is not None:
            self._session.say("Cancelled; what was measured until then is kept.")
        self.close()

    def close(self) -> None:
        """Stop the task and release what it made on the GPU."""
        if self._task is not None:
            self._task.close()
            self._end()

    # Tasks

    def measure_runs(self) -> None:
        """Sweep the chosen algorithms and five tolerances over the flight."""
        self._start("measuring", self._sweep())

    def tune_error(self) -> None:
        """Give every chosen algorithm the tolerance at which it delivers the wanted error."""
        self._start("equal error", self._tune(equal_error, self.wanted_px, "px"))

    def tune_time(self) -> None:
        """Give every chosen algorithm the tolerance at which its frames take the wanted time."""
        self._start("equal time", self._tune(equal_time, self.wanted_ms, "ms"))

    def meter_waste(self) -> None:
        """Count what this view costs against what it needs."""
        self._start("metering waste", self._meter())

    def check_flight(self) -> None:
        """Look for holes, pops and slow frames along the flight."""
        self._start("checking the flight", self._fly())

    def choose_best(self, *, by_time: bool) -> None:
        """Switch to the best run measured for the wanted time or error."""
        best = best_for_time(self.runs, self.wanted_ms) if by_time else best_for_error(self.runs, self.wanted_px)
        wish = f"{self.wanted_ms:.1f} ms" if by_time else f"{self.wanted_px:.2f} px"
        if not self.runs:
            self._session.say("Nothing is measured yet: press Measure first.")
        elif best is None:
            self._session.say(f"No run measured so far keeps {wish}; allow more, or measure more.")
        else:
            self.choose_run(best)
            ms, px = run_point(best)
            title = RENDERERS[best["algorithm"]].title
            self._session.say(f"Best for {wish}: {title}, {ms:.1f} ms at {px:.2f} px.")

    def choose_run(self, run: Mapping[str, Any]) -> None:
        """Draw with the algorithm and settings of a run."""
        self._session.algorithms.use(run["algorithm"], settings_of(run))

    def save(self, folder: Path) -> None:
        """Write the results measured so far into a new folder."""
        if self.results is None:
            return
        try:
            paths = write_results(numbered_path(folder / f"{self._session.heightfield.name}-results"), self.results)
        except OSError as error:
            self._session.say(f"{folder} cannot be written: {error.strerror or error}.")
        else:
            self._session.say(f"Saved {paths[0]} and {paths[1].name}.")

    # What the tasks do

    def _start(self, doing: str, task: Steps) -> None:
        self.close()
        self._task, self.doing, self.share = task, doing, 0.0
        self._job = self._session.jobs.begin(
            doing.capitalize(), "Escape cancels and keeps what is measured", self.cancel
        )

    def _end(self) -> None:
        self._session.jobs.end(self._job)
        self._task, self.doing, self._job = None, "", None

    def _sweep(self) -> Steps:
        """One short sweep for each tolerance: points appear as they are found, and a cancelled rest costs none."""
        session, chosen = self._session, self._chosen_names()
        for number, tolerance_px in enumerate(TOLERANCES_PX):
            runs = plan_runs(chosen, [tolerance_px])[0 if number == 0 else 1 :]  # the reference once
            views = self._flight_views(self.frames)
            sweep = Sweep(session.stage, runs, views, self._size_px, session.flights.flight.name, repeats=1)
            try:
                for progress in sweep.steps():
                    yield (number + progress.share) / len(TOLERANCES_PX)
            finally:
                self._add_results(sweep.results())

    def _tune(self, method: Any, wanted: float, unit: str) -> Steps:
        session = self._session
        own = {name: session.algorithms.settings_for(name) for name in self._chosen_names()}
        views = [(0.0, session.camera), *self._flight_views(FAIR_FRAMES)]
        session.algorithms.tuned, told = {}, []
        for found in method(session.stage, own, views, self._size_px, wanted):
            if isinstance(found, Tuned):
                session.algorithms.tuned[found.algorithm] = found.settings
                reach = "" if found.is_reached else f" (delivers {found.figure:.2g} {unit})"
                told.append(f"{found.algorithm} {found.settings.tolerance_px:.2f} px{reach}")
            yield len(told) / len(own)
        if session.algorithm in session.algorithms.tuned:
            session.algorithms.use(session.algorithm, session.algorithms.tuned[session.algorithm])
        session.say(f"{wanted:.3g} {unit} each, by tolerances: {', '.join(told)}.")

    def _meter(self) -> Steps:
        session, done = self._session, 0
        meter = AccuracyMeter(session.stage, self._size_px)
        try:
            steps = measure_waste(session.stage, session.stage.renderer, meter, session.camera)
            while True:
                try:
                    next(steps)
                except StopIteration as found:
                    self.waste = found.value
                    return
                done += 1
                yield done / (done + 8)  # nobody knows how many rounds are left
        finally:
            meter.release()

    def _fly(self) -> Steps:
        session = self._session
        duration_s = session.flights.duration_s
        count = min(max(int(duration_s / STRIP_STEP_S), 1) + 1, STRIP_FRAMES)
        self.strip, self.strip_tolerance_px = [], session.settings.tolerance_px
        renderer = RENDERERS[session.algorithm](session.gpu, session.stage.scene, session.settings)
        try:
            for frame in measure_strip(session.stage, renderer, self._flight_views(count)):
                self.strip.append(frame)
                yield len(self.strip) / count
        finally:
            renderer.release()

    def _measure_now(self) -> None:
        """Measure the picture on the screen, and rest long enough that the window does not feel it."""
        session, begin_s = self._session, time.perf_counter()
        key = self._key
        errors = session.stage.errors(session.camera, self._size_px, session.clock_s)
        pool = Pool()
        pool.add(errors[..., 0][errors[..., 3] > 0.5])
        spent_s = time.perf_counter() - begin_s
        self._pause_until_s = begin_s + max(spent_s / LIVE_SHARE, LIVE_PAUSE_S)
        self._measured_key = key
        if pool.count:
            recent_ms = float(np.median(list(session.frame_ms)[-5:])) if session.frame_ms else 0.0
            frame_ms = max(recent_ms, session.stats.gpu_ms or 0.0)
            tolerance_px, p999_px = session.settings.tolerance_px, pool.percentile(99.9)
            self.delivered = Delivered(session.algorithm, tolerance_px, p999_px, pool.maximum, frame_ms)
            self.trail.append((frame_ms, p999_px))

    def _add_results(self, new: dict[str, Any]) -> None:
        """Take in the finished runs of a sweep; a run measured again takes the place of the earlier one."""
        runs = [run for run in new["runs"] if is_measured(run)]
        if self.results is not None:
            again = [(run["algorithm"], run["settings"]) for run in runs]
            runs = [r for r in self.results["runs"] if (r["algorithm"], r["settings"]) not in again] + runs
        if runs:
            self.results = {**new, "runs": runs}

    def _chosen_names(self) -> list[str]:
        names = [name for name, is_on in self.chosen.items() if is_on]
        return names or [name for name in [self._session.algorithm] if name != "reference"] or list(self.chosen)[:1]

    def _flight_views(self, count: int) -> list[tuple[float, Camera]]:
        """Evenly spread frames of the flight."""
        flight = self._session.flights
        return [(t, flight.camera_at(t)) for t in np.linspace(0.0, flight.duration_s, count).tolist()]

    @property
    def _size_px(self) -> tuple[int, int]:
        picture = self._session.picture
        assert picture is not None  # work is done after a picture was drawn
        return picture.size_px

    @property
    def _key(self) -> Any:
        """What must stay the same for a measurement of the picture to hold."""
        session = self._session
        frozen = session.stage.frozen
        return session.camera, session.algorithm, session.settings, self._size_px, frozen and frozen.camera


def run_point(run: Mapping[str, Any]) -> tuple[float, float]:
    """Where a run lies in the chart: median frame time [ms] and 99.9th percentile of the error [px]."""
    return run["frame_ms"]["p50"], run["geometric_error_px"]["p999"]
