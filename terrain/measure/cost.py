"""What a frame costs: time of selection, submission, GPU and the whole frame; counts of what was drawn.

Runs are interleaved, frame by frame A B C A B C ..., so that drift of the machine hits all alike. A frame ends when the
GPU has finished it. On software rasterisers timer queries measure nothing, so GPU time is left out there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from terrain.camera import Camera
from terrain.gpu.targets import Target
from terrain.measure.accuracy import drawn_by
from terrain.renderers.base import Renderer
from terrain.stage import Stage

_TIMES = ("frame_ms", "select_ms", "submit_ms", "gpu_ms")
_COUNTS = ("triangles", "draw_calls", "slices", "ray_steps", "uploaded_bytes", "resident_bytes")


@dataclass
class Cost:
    """Samples of one run: times and counts of every frame, per repeat; overdraw of every frame measured."""

    rounds: list[dict[str, list[float]]] = field(default_factory=list)
    overdraw: list[tuple[float, float]] = field(default_factory=list)
    prepare_s: float = 0.0

    def add(self, values: Mapping[str, float | None]) -> None:
        """Add one frame to the last round; what was not measured is left out."""
        for name, value in values.items():
            if value is not None:
                self.rounds[-1].setdefault(name, []).append(float(value))

    def figures(self) -> dict[str, Any]:
        """The cost part of one run of the results file; what was not measured is absent."""
        pooled = {name: [v for r in self.rounds for v in r.get(name, [])] for name in (*_TIMES, *_COUNTS)}
        figures: dict[str, Any] = {}
        if pooled["frame_ms"]:
            p50, p95, p99 = np.percentile(pooled["frame_ms"], (50, 95, 99)).tolist()
            medians = [float(np.median(r["frame_ms"])) for r in self.rounds if r.get("frame_ms")]
            figures["frame_ms"] = {"p50": p50, "p95": p95, "p99": p99, "spread": [min(medians), max(medians)]}
        for name in _TIMES[1:]:
            if pooled[name]:
                p50, p95 = np.percentile(pooled[name], (50, 95)).tolist()
                figures[name] = {"p50": p50, "p95": p95}
        for name in _COUNTS:
            if pooled[name]:
                median = float(np.median(pooled[name]))
                figures[name] = median if name == "ray_steps" else round(median)
        if self.overdraw:
            mean, maximum = np.array(self.overdraw).T
            figures["overdraw"] = {"mean": float(np.median(mean)), "max": float(maximum.max())}
        figures["prepare_s"] = self.prepare_s
        return figures


def time_frame(stage: Stage, renderer: Renderer, camera: Camera, time_s: float, target: Target) -> dict[str, Any]:
    """Draw one frame and wait for it: times [ms] and the renderer's counts."""
    frame = stage.frame(camera, target.size_px, time_s)
    stage.gpu.ctx.finish()
    with drawn_by(stage, renderer):
        begin = time.perf_counter()
        stats = stage.draw(frame, target)
        stage.gpu.ctx.finish()
        frame_ms = (time.perf_counter() - begin) * 1e3
    stats.frame_ms = frame_ms
    return {name: getattr(stats, name) for name in (*_TIMES, *_COUNTS)}


def measure_overdraw(
    stage: Stage, renderer: Renderer, camera: Camera, time_s: float, size_px: tuple[int, int]
) -> tuple[float, float]:
    """Mean and largest number of times a covered pixel is drawn in one frame; never inside a timed one."""
    with drawn_by(stage, renderer):
        return stage.overdraw(camera, size_px, time_s)


def time_interleaved(
    stage: Stage, renderers: Sequence[Renderer], costs: Sequence[Cost], camera: Camera, time_s: float, target: Target,
    first: int,
) -> None:  # fmt: skip
    """Time one frame of every run, beginning with number ``first``: nobody always follows the same neighbour."""
    for _ in interleaved_steps(stage, renderers, costs, camera, time_s, target, first):
        pass


def interleaved_steps(
    stage: Stage, renderers: Sequence[Renderer], costs: Sequence[Cost], camera: Camera, time_s: float, target: Target,
    first: int,
) -> Iterator[None]:  # fmt: skip
    """`time_interleaved`, a step for each run."""
    order = [(first + k) % len(renderers) for k in range(len(renderers))]
    for k in order:
        costs[k].add(time_frame(stage, renderers[k], camera, time_s, target))
        yield


def warm_up(stage: Stage, renderer: Renderer, camera: Camera, time_s: float, target: Target, frames: int = 2) -> None:
    """Draw without counting: compiles programs, fills caches of the driver."""
    for _ in range(frames):
        time_frame(stage, renderer, camera, time_s, target)
