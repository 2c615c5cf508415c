"""Runs x flight: every algorithm and setting, timed side by side, then measured against the reference surface.

A sweep is a generator: each step draws a few frames, so that a window stays responsive and a command line can show
progress. What is finished is kept on disk after every unit (a round of timing, the accuracy of a run), and a sweep of
the same runs on the same terrain, flight and machine takes up where an interrupted one stopped. Accuracy is never
measured inside a timed pass.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from terrain.camera import Camera
from terrain.measure.accuracy import Accuracy, AccuracyMeter, drawn_by
from terrain.measure.cost import Cost, interleaved_steps, measure_overdraw, warm_up
from terrain.measure.images import flip_mean, psnr_db
from terrain.measure.results import machine_identity, make_results, settings_record, terrain_identity, write_text
from terrain.renderers import RENDERERS
from terrain.renderers.base import Renderer
from terrain.renderers.reference import ReferenceRenderer
from terrain.stage import Stage

REPEATS = 2
IMAGE_FRAMES = 2  # pictures compared by FLIP and PSNR: a second each at 720p
OVERDRAW_FRAMES = 6
STATE_FILE = "sweep-state.json"


@dataclass(frozen=True)
class Run:
    """One line of the table: an algorithm with its settings."""

    algorithm: str
    settings: Any

    @property
    def label(self) -> str:
        """``geomorph tolerance_px=1.0``"""
        return " ".join([self.algorithm, *(f"{k}={v}" for k, v in settings_record(self.settings).items())])


@dataclass(frozen=True)
class Progress:
    """How far a sweep is: share done (0..1), seconds left by the pace so far, and what it does."""

    share: float
    left_s: float
    doing: str


class Sweep:
    """Measures runs over a flight.

    Parameters
    ----------
    stage : Stage
        Whose scene is drawn; its renderer and look stay as they are.
    runs : sequence of Run
    views : sequence of (time_s, Camera)
        The frames of the flight.
    size_px : tuple of int
    flight_name : str
    folder : Path or None
        Where the state is kept; None keeps nothing.
    """

    def __init__(
        self, stage: Stage, runs: Sequence[Run], views: Sequence[tuple[float, Camera]], size_px: tuple[int, int],
        flight_name: str = "flight", folder: Path | None = None, repeats: int = REPEATS,
    ) -> None:  # fmt: skip
        self.stage, self.runs, self.views, self.size_px = stage, list(runs), list(views), size_px
        self.repeats, self._folder = repeats, folder
        self._machine = machine_identity(stage.gpu)
        self._terrain = terrain_identity(stage.scene.heightfield)
        self._flight = {"name": flight_name, "frames": len(self.views)}
        self.costs = [Cost() for _ in self.runs]
        self.accuracies: list[dict[str, Any] | None] = [None] * len(self.runs)
        self._load()

    def steps(self) -> Iterator[Progress]:
        """Do the work, about a frame of one run at a time."""
        frames = len(self.views)
        costs_left = self.repeats - len(self.costs[0].rounds)
        # In units of one drawn frame: timing draws each run once per frame, accuracy about twice.
        total = costs_left * frames * len(self.runs) + 2 * frames * sum(a is None for a in self.accuracies)
        total += len(self._overdraw_frames) * len(self.runs) * (costs_left == self.repeats)
        done, begin = 0, time.perf_counter()

        def progress(doing: str) -> Progress:
            share = done / max(total, 1)
            spent = time.perf_counter() - begin
            return Progress(share, spent * (1 - share) / share if share else float("nan"), doing)

        for number in range(self.repeats - costs_left, self.repeats):
            for drawn in self._time_round(number):
                done += drawn
                yield progress(f"timing, round {number + 1} of {self.repeats}")
        meter = AccuracyMeter(self.stage, self.size_px)
        try:
            for index, run in enumerate(self.runs):
                if self.accuracies[index] is None:
                    for _ in self._measure_run(meter, index):
                        done += 2
                        yield progress(f"accuracy of {run.label}")
        finally:
            meter.release()

    def results(self) -> dict[str, Any]:
        """What has been measured so far, as in the results file."""
        runs = []
        for run, cost, accuracy in zip(self.runs, self.costs, self.accuracies, strict=True):
            record = {"algorithm": run.algorithm, "settings": settings_record(run.settings)}
            if cost.rounds:
                record |= cost.figures()
            runs.append(record | (accuracy or {}))
        return make_results(self._machine, self._terrain, self.size_px, self._flight, runs)

    @property
    def _overdraw_frames(self) -> list[int]:
        return sorted(set(np.linspace(0, len(self.views) - 1, OVERDRAW_FRAMES).astype(int).tolist()))

    def _time_round(self, number: int) -> Iterator[int]:
        """One flight of all runs side by side. A round that is broken off leaves nothing behind.

        Yields how many of its frames each step has drawn.
        """
        renderers: list[Renderer] = []
        trial = [Cost(rounds=[{}]) for _ in self.runs]
        target = self.stage.target(self.size_px)
        try:
            for run, cost in zip(self.runs, self.costs, strict=True):
                renderers.append(self._make(run, cost))
                warm_up(self.stage, renderers[-1], self.views[0][1], self.views[0][0], target)
                yield 0
            for i, (time_s, camera) in enumerate(self.views):
                for _ in interleaved_steps(self.stage, renderers, trial, camera, time_s, target, first=i):
                    yield 1
            if number == 0:
                for i in self._overdraw_frames:
                    time_s, camera = self.views[i]
                    for renderer, cost in zip(renderers, trial, strict=True):
                        cost.overdraw.append(measure_overdraw(self.stage, renderer, camera, time_s, self.size_px))
                        yield 1
        finally:
            for renderer in renderers:
                renderer.release()
        for cost, new in zip(self.costs, trial, strict=True):
            cost.rounds += new.rounds
            cost.overdraw += new.overdraw
        self._save()

    def _measure_run(self, meter: AccuracyMeter, index: int) -> Iterator[None]:
        """Accuracy of one run over the flight."""
        run = self.runs[index]
        renderer = self._make(run, None)
        accuracy = Accuracy()
        images: list[tuple[float | None, float | None]] = []
        image_frames = set(np.linspace(0, len(self.views) - 1, IMAGE_FRAMES + 2).astype(int)[1:-1].tolist())
        meter.restart()
        try:
            for i, (time_s, camera) in enumerate(self.views):
                truth = meter.truth(camera, renderer.diagonal)
                accuracy.add(meter.measure(renderer, camera, time_s, truth))
                if i in image_frames:
                    images.append(self._compare_images(meter, renderer, camera, time_s))
                yield
        finally:
            renderer.release()
        figures = accuracy.figures()
        for name, values in zip(("flip", "psnr_db"), zip(*images, strict=True), strict=False):
            known = [v for v in values if v is not None]
            if known:
                figures[name] = float(np.mean(known))
        self.accuracies[index] = figures
        self._save()

    def _compare_images(
        self, meter: AccuracyMeter, renderer: Renderer, camera: Camera, time_s: float
    ) -> tuple[float | None, float | None]:
        pictures = []
        for who in (meter.reference(renderer.diagonal), renderer):
            with drawn_by(self.stage, who):
                pictures.append(self.stage.render(camera, self.size_px, time_s=time_s))
        return flip_mean(*pictures), psnr_db(*pictures)

    def _make(self, run: Run, cost: Cost | None) -> Renderer:
        begin = time.perf_counter()
        renderer = RENDERERS[run.algorithm](self.stage.gpu, self.stage.scene, run.settings)
        if cost is not None:
            cost.prepare_s = time.perf_counter() - begin
        return renderer

    @property
    def _key(self) -> str:
        """What must be the same for a state on disk to be of this sweep."""
        runs = [[run.algorithm, asdict(run.settings)] for run in self.runs]
        views = [[t, asdict(camera)] for t, camera in self.views]
        identity = [self._machine, self._terrain, self.size_px, runs, views, self.repeats]
        return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()

    def _save(self) -> None:
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            costs = [asdict(cost) for cost in self.costs]
            state = {"key": self._key, "costs": costs, "accuracies": self.accuracies}
            write_text(self._folder / STATE_FILE, json.dumps(state))

    def _load(self) -> None:
        if self._folder is None:
            return
        try:
            state = json.loads((self._folder / STATE_FILE).read_text(encoding="utf-8"))
            if state["key"] == self._key:
                self.costs = [
                    Cost(c["rounds"], [tuple(o) for o in c["overdraw"]], c["prepare_s"]) for c in state["costs"]
                ]
                self.accuracies = state["accuracies"]
        except (OSError, ValueError, KeyError, TypeError):
            pass  # absent, or of another make: measure from the start


def plan_runs(algorithms: Sequence[str], tolerances_px: Sequence[float]) -> list[Run]:
    """Every algorithm at every tolerance; the reference, which knows none, once and first."""
    runs = [Run(ReferenceRenderer.name, ReferenceRenderer.Settings())]
    for name in algorithms:
        if name != ReferenceRenderer.name:
            runs += [Run(name, RENDERERS[name].Settings(tolerance_px=t)) for t in tolerances_px]
    return runs
