"""Figure 5 of adaptive slicing on this machine: frame rates, triangles and slices over the window's size.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001, section 6.

Deviations: the paper's Yukon terrain and flight are unknown. Here a fractal surface stands for them, and the eye flies
over it in a circle. Beside the default stand coarser fans of triangles, where the tolerance allows them, and the
paper's own rule of counts, costs and hard test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield
from terrain.measure.cost import time_frame, warm_up
from terrain.measure.papers.mountains import benchmark_terrain
from terrain.measure.reproduce import Cell, Claim, Plot, Progress, Reproduction, Table
from terrain.renderers.reference import ReferenceRenderer
from terrain.renderers.slicing import SlicingRenderer, SlicingSettings, rank_correlation
from terrain.scene import open_scene
from terrain.stage import Stage

# Figure 5: window, frames per second on average and at least, triangles, slices; and what brute force took.
PAPER: dict[tuple[int, int], tuple[float, float, int, int]] = {
    (400, 300): (35.3, 28.8, 68_736, 11_941),
    (512, 384): (28.5, 21.5, 93_952, 14_832),
    (640, 480): (22.2, 18.1, 151_296, 13_445),
    (800, 600): (18.0, 14.2, 209_152, 13_296),
    (1024, 768): (15.1, 11.0, 257_536, 10_042),
}
PAPER_BRUTE_FORCE_FPS = (8.9, 3.1)  # on average, at least
WAYS = {  # and what tables and plots call them
    "secant": "ours",
    "coarse": "coarser fans",
    "paper": "paper's rule",
    "brute force": "brute force",
}


@dataclass(frozen=True)
class Plan:
    """How much is measured: posts along one side, windows, frames of the flight, turns of each."""

    sizes: Sequence[int] = (1025, 2049)
    windows_px: Sequence[tuple[int, int]] = tuple(PAPER)
    frames: int = 8
    turns: int = 2


@dataclass
class Found:
    """What one way of drawing took along the flight, frame by frame."""

    frame_ms: list[float] = field(default_factory=list)
    triangles: list[int] = field(default_factory=list)
    slices: list[int] = field(default_factory=list)
    estimated_ms: list[float] = field(default_factory=list)

    @property
    def average_fps(self) -> float:
        return 1e3 / float(np.mean(self.frame_ms))

    @property
    def least_fps(self) -> float:
        return 1e3 / max(self.frame_ms)


Flights = dict[tuple[int, tuple[int, int]], dict[str, Found]]
"""By posts along one side and window: what every way took."""


def reproduce(gpu: Gpu, folder: Path, progress: Progress) -> Reproduction:
    """Measure figure 5 and what the paper concludes from it; ``folder`` is left alone."""
    return measure(gpu, Plan(), progress)


def measure(gpu: Gpu, plan: Plan, progress: Progress) -> Reproduction:
    """As `reproduce`, by a plan."""
    flights: Flights = {}
    errors_px: list[float] = []
    steps, done = len(plan.sizes) * len(plan.windows_px), 0
    for posts in plan.sizes:
        stage = Stage(gpu, open_scene(benchmark_terrain(posts)), "reference")
        renderers: dict[str, Any] = {
            "secant": SlicingRenderer(gpu, stage.scene, SlicingSettings()),
            "coarse": SlicingRenderer(gpu, stage.scene, SlicingSettings(coarse=True)),
            "paper": SlicingRenderer(gpu, stage.scene, SlicingSettings(rule="paper")),
            "brute force": ReferenceRenderer(gpu, stage.scene, ReferenceRenderer.Settings()),
        }
        for window in plan.windows_px:
            progress(done / steps, f"{posts} x {posts} posts, {window[0]} x {window[1]} pixels")
            flights[posts, window] = _fly(stage, renderers, window, plan)
            done += 1
        errors_px.append(_largest_error_px(stage, renderers["secant"], plan))
        for renderer in renderers.values():
            renderer.release()
        stage.release()
    progress(1.0, "done")
    return Reproduction(
        [_table(posts, plan, flights) for posts in plan.sizes],
        [_plot(posts, plan, flights) for posts in plan.sizes],
        _claims(plan, flights, max(errors_px)),
    )


def flight_camera(terrain: Heightfield, along: float) -> Camera:
    """The eye after a share of its flight: a circle over the terrain, low, looking ahead and inwards."""
    width, depth = terrain.extent_m
    angle = 2.0 * np.pi * along
    x, z = width * (0.5 - 0.3 * np.sin(angle)), depth * (0.5 + 0.3 * np.cos(angle))
    y = float(terrain.heights_at(x, z)) + 0.015 * width
    return Camera((float(x), y, float(z)), float(np.degrees(angle)) + 40.0, -8.0, 0.0, 60.0)


def _fly(stage: Stage, renderers: dict[str, Any], window: tuple[int, int], plan: Plan) -> dict[str, Found]:
    """One flight with every renderer, taking turns frame by frame; the better of a few turns counts."""
    terrain, target = stage.scene.heightfield, stage.target(window)
    found = {way: Found() for way in renderers}
    for renderer in renderers.values():
        warm_up(stage, renderer, flight_camera(terrain, 0.9), 0.0, target, 1)
    for number in range(plan.frames):
        camera = flight_camera(terrain, number / plan.frames)
        times: dict[str, list[float]] = {way: [] for way in renderers}
        for _ in range(plan.turns):
            for way, renderer in renderers.items():
                times[way].append(time_frame(stage, renderer, camera, 0.0, target)["frame_ms"])
        for way, renderer in renderers.items():
            found[way].frame_ms.append(min(times[way]))
            found[way].triangles.append(renderer.stats.triangles)
            found[way].slices.append(renderer.stats.slices or 0)
            found[way].estimated_ms.append(renderer.stats.extra.get("estimated ms", 0.0))
    return found


def _largest_error_px(stage: Stage, renderer: Any, plan: Plan) -> float:
    """The largest 99.9th percentile of the vertical error of any frame, in the first window."""
    terrain, window = stage.scene.heightfield, plan.windows_px[0]
    own, stage.renderer = stage.renderer, renderer
    largest = 0.0
    for number in range(plan.frames):
        camera = flight_camera(terrain, number / plan.frames)
        world = stage.positions(camera, window).reshape(-1, 3)
        world = world[~np.isnan(world[:, 0])]
        off_m = np.abs(world[:, 1] - terrain.heights_at(world[:, 0], world[:, 2]))
        distance_m = np.linalg.norm(world - camera.eye_m, axis=1)
        errors = np.nan_to_num(off_m) * camera.pixels_per_radian(window[1]) / distance_m
        largest = max(largest, float(np.percentile(errors, 99.9)) if len(errors) else 0.0)
    stage.renderer = own
    return largest


def _table(posts: int, plan: Plan, flights: Flights) -> Table:
    rows: list[list[Cell]] = []
    for window in plan.windows_px:
        found = flights[posts, window]
        brute_fps = found["brute force"].average_fps
        paper: tuple[Cell, ...] = PAPER.get(window, (None, None, None, None)) if posts == 1025 else (None,) * 4
        rows.append([f"{window[0]}x{window[1]}", *paper])
        for way in [*WAYS][:-1]:
            one = found[way]
            rows[-1] += [
                one.average_fps, one.least_fps, round(float(np.mean(one.triangles))),
                round(float(np.mean(one.slices))), one.average_fps / brute_fps,
            ]  # fmt: skip
        rows[-1] += [brute_fps, found["brute force"].least_fps]
        rows[-1].append(round(float(np.mean(found["brute force"].triangles))))
    columns = ["window", *(f"paper {name}" for name in ("fps", "least fps", "triangles", "slices"))]
    for title in [*WAYS.values()][:-1]:
        columns += [f"{title} {name}" for name in ("fps", "least fps", "triangles", "slices", "speed-up")]
    columns += ["brute force fps", "least fps", "triangles"]
    note = "The paper: 8.9 frames per second by brute force on average, 3.1 at least." if posts == 1025 else ""
    return Table(f"figure5_{posts}", f"Figure 5: {posts} x {posts} posts", tuple(columns), rows, note)


def _plot(posts: int, plan: Plan, flights: Flights) -> Plot:
    pixels = {window: window[0] * window[1] / 1e6 for window in plan.windows_px}
    series: dict[str, list[tuple[float, float]]] = {
        title: [(pixels[window], flights[posts, window][way].average_fps) for window in plan.windows_px]
        for way, title in WAYS.items()
    }
    if posts == 1025:
        series["paper, 2001"] = [(w[0] * w[1] / 1e6, PAPER[w][0]) for w in PAPER]
        series["paper, 2001, brute force"] = [(w[0] * w[1] / 1e6, PAPER_BRUTE_FORCE_FPS[0]) for w in PAPER]
    title = f"Adaptive slicing, {posts} x {posts} posts"
    return Plot(f"figure5_{posts}", title, "window [million pixels]", "frames per second", series)


def _claims(plan: Plan, flights: Flights, error_px: float) -> list[Claim]:
    def speed_ups(posts: int) -> list[float]:
        of_size = [flights[posts, window] for window in plan.windows_px]
        return [f["secant"].average_fps / f["brute force"].average_fps for f in of_size]

    small, large = plan.sizes[0], plan.sizes[-1]
    slow, fast = min(speed_ups(small)), max(speed_ups(small))
    triangles = [float(np.mean(flights[small, window]["secant"].triangles)) for window in plan.windows_px]
    kept = float(
        np.mean([
            flights[large, w]["secant"].average_fps / flights[small, w]["secant"].average_fps for w in plan.windows_px
        ])
    )  # fmt: skip
    gain = float(np.mean(speed_ups(large)) / np.mean(speed_ups(small)))
    samples = [
        (estimate, ms)
        for found in flights.values()
        for estimate, ms in zip(found["secant"].estimated_ms, found["secant"].frame_ms, strict=True)
    ]
    ranks = rank_correlation(np.array(samples)) if len(samples) > 2 else 0.0
    return [
        Claim(
            f"slicing is faster than brute force with quadtree culling, {small} x {small} posts", "1.7 to 5 times",
            f"{slow:.1f} to {fast:.1f} times", slow >= 1.0,
        ),
        Claim(
            "larger windows show more triangles", "68,736 to 257,536",
            f"{triangles[0]:,.0f} to {triangles[-1]:,.0f}", triangles[-1] > triangles[0],
        ),
        Claim(
            f"the frame rate hardly depends on the grid: {large} against {small} posts", "only slightly lower",
            f"{kept:.0%} of it", kept >= 0.7,
        ),
        Claim(
            f"the speed-up is larger at {large} x {large} posts", "3 to 4 times larger", f"{gain:.1f} times larger",
            gain > 1.0,
        ),
        Claim("the error is below a pixel", "sub-pixel", f"99.9 % below {error_px:.2f} px", error_px <= 1.0),
        Claim(
            "costs are estimated well enough to choose by", "not measured", f"rank correlation {ranks:.2f}",
            ranks > 0.5,
        ),
    ]  # fmt: skip
