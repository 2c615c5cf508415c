"""The painter's tables on this machine: frame rates over quadtree depth, of orders, paths and shuffled indices.

Source: S. Alonso-Ferreira, R. Joan-Arinyo, *Back-to-front ordering of triangles in digital terrain models over regular
grids*: tables 1 to 4, figures 16, 18 and 20.

Deviations: the paper's terrain, path and window are unknown. Here a fractal surface stands for its mountains, and the
eye flies over it at 1280 x 720 pixels. The paper's paths are ours with an index buffer; beside them stands the order
computed from the vertex number. Frustum culling alone, no level of detail, as in the paper.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from terrain.algorithms.painter import foot_at
from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield
from terrain.measure.cost import time_frame, warm_up
from terrain.measure.papers.mountains import benchmark_terrain
from terrain.measure.papers.painter_tables import (
    MODES,
    RANDOMNESS,
    Rates,
    depth_plots,
    depth_table,
    depth_write_claim,
    randomness_claim,
    randomness_plots,
    randomness_table,
    speed_claims,
)
from terrain.measure.reproduce import Claim, Plot, Progress, Reproduction, Table
from terrain.renderers.painter import PainterRenderer, PainterSettings
from terrain.scene import open_scene
from terrain.stage import Stage


@dataclass(frozen=True)
class Plan:
    """How much is measured: posts along one side, quadtree depths, frames per figure, window, eyes compared."""

    sizes: Sequence[int] = (512, 1024, 2048)
    depths: Sequence[int] = tuple(range(9))
    frames: int = 4
    window_px: tuple[int, int] = (1280, 720)
    eyes: int = 400


@dataclass(frozen=True)
class Variant:
    """One column of measurements: a mode on a path."""

    label: str
    mode: str
    path: str


VARIANTS = (
    *(Variant(mode, mode, "indexed") for mode in MODES),
    Variant("z-buffer, by number", "z-buffer", "procedural"),
    Variant("correct, by number", "correct", "procedural"),
    Variant("correct, by cells", "correct", "cells"),
)


def reproduce(gpu: Gpu, folder: Path, progress: Progress) -> Reproduction:
    """Measure tables 1 to 4 and what the paper concludes from them; ``folder`` is left alone."""
    return measure(gpu, Plan(), progress)


def measure(gpu: Gpu, plan: Plan, progress: Progress) -> Reproduction:
    """As `reproduce`, by a plan."""
    tables: list[Table] = []
    plots: list[Plot] = []
    rates: dict[int, tuple[Rates, Rates]] = {}
    shuffled: dict[int, list[float]] = {}
    depth_writes: dict[int, float] = {}
    fragments: dict[int, dict[str, float]] = {}
    work = sum(n * n for n in plan.sizes) * 1.2
    done = 0.0
    for number, posts in enumerate(plan.sizes, 1):
        stage = Stage(gpu, open_scene(benchmark_terrain(posts)), "painter", PainterSettings(levels=False))
        depths = [d for d in plan.depths if d < 8 or posts < 2048]  # as in table 3
        rates[posts] = ({v.label: [] for v in VARIANTS}, {v.label: [] for v in VARIANTS})
        for depth in depths:
            progress(done / work, f"{posts} x {posts} posts, depth {depth}")
            for eye, found in enumerate(_rates_at_depth(stage, plan, depth)):
                for label, rate in found.items():
                    rates[posts][eye][label].append(rate)
            done += posts * posts / len(depths)
        progress(done / work, f"{posts} x {posts} posts, shuffled indices")
        shuffled[posts] = _rates_when_shuffled(stage, plan)
        depth_writes[posts] = _cost_of_depth_writes(stage, plan)
        fragments[posts] = _shaded_fragments(stage, plan)
        stage.release()
        tables.append(depth_table(number, posts, depths, rates[posts]))
        plots += depth_plots(posts, depths, rates[posts])
    tables.append(randomness_table(shuffled))
    plots += randomness_plots(shuffled)
    progress(done / work, f"pictures from {plan.eyes} eyes")
    claims = [
        *speed_claims(plan.depths, rates, fragments),
        randomness_claim(shuffled),
        depth_write_claim(depth_writes),
        _picture_claim(gpu, plan.eyes),
    ]
    progress(1.0, "done")
    return Reproduction(tables, plots, claims)


def _camera(terrain: Heightfield, along: float) -> Camera:
    """The eye after a share of its flight: around the middle, looking across it."""
    width, depth = terrain.extent_m
    angle = 2.0 * np.pi * (0.06 + along)
    x, z = width * (0.5 - 0.22 * np.sin(angle)), depth * (0.5 + 0.22 * np.cos(angle))
    y = float(terrain.heights_at(x, z)) + 0.02 * width
    return Camera((float(x), y, float(z)), float(np.degrees(angle)) + 20.0, -12.0, 0.0, 60.0)


def _rates_at_depth(stage: Stage, plan: Plan, depth: int) -> tuple[dict[str, float], dict[str, float]]:
    """Frames per second of every variant, for a static and a moving eye; variants take turns, frame by frame."""
    terrain, target = stage.scene.heightfield, stage.target(plan.window_px)
    settings = PainterSettings(depth=depth, levels=False, horizon=False)
    renderer: Any = PainterRenderer(stage.gpu, stage.scene, settings)
    found = []
    # One turn around the terrain: the fixed order suits some directions and not others.
    static = [_camera(terrain, i / plan.frames) for i in range(plan.frames)]
    moving = [_camera(terrain, (i + 0.5) / plan.frames) for i in range(plan.frames)]
    for cameras, repeats in ((static, 2), (moving, 1)):
        samples: dict[str, list[float]] = {v.label: [] for v in VARIANTS}
        for camera in cameras:
            for turn in range(repeats):
                for variant in VARIANTS:
                    renderer.settings = replace(settings, mode=variant.mode, path=variant.path)
                    if turn == 0 and camera is cameras[0]:
                        warm_up(stage, renderer, _camera(terrain, 0.9), 0.0, target, 1)
                    frame_ms = time_frame(stage, renderer, camera, 0.0, target)["frame_ms"]
                    if turn == repeats - 1:  # a static eye has seen this before: its orders are in place
                        samples[variant.label].append(frame_ms)
        # The median: one frame disturbed by something else must not decide.
        found.append({label: 1e3 / float(np.median(values)) for label, values in samples.items()})
    renderer.release()
    return found[0], found[1]


def _rates_when_shuffled(stage: Stage, plan: Plan) -> list[float]:
    """Frames per second of one index list for the whole terrain, seen from far away, z-buffer on (6.1)."""
    terrain, target = stage.scene.heightfield, stage.target(plan.window_px)
    width, depth = terrain.extent_m
    camera = Camera((0.5 * width, 0.9 * width, 1.7 * depth), 0.0, -35.0, 0.0, 60.0)
    settings = PainterSettings(mode="z-buffer", path="shuffled", depth=0, levels=False, horizon=False)
    renderer: Any = PainterRenderer(stage.gpu, stage.scene, settings)
    rates = []
    for percent in RANDOMNESS:
        renderer.settings = replace(settings, randomness=float(percent))
        warm_up(stage, renderer, camera, 0.0, target)
        times = [time_frame(stage, renderer, camera, 0.0, target)["frame_ms"] for _ in range(plan.frames)]
        rates.append(1e3 / float(np.median(times)))
    renderer.release()
    return rates


def _cost_of_depth_writes(stage: Stage, plan: Plan) -> float:
    """Time of the surface alone with depth written (test: always), over the time without any depth."""
    target = stage.target(plan.window_px)
    settings = PainterSettings(depth=max(plan.depths) // 2, levels=False, horizon=False)
    stage.set_renderer("painter", settings)
    renderer: Any = stage.renderer
    spent = {True: 0.0, False: 0.0}
    for i in range(-1, 2 * plan.frames):  # the first frame is not counted
        frame = stage.frame(_camera(stage.scene.heightfield, i / plan.frames), plan.window_px)
        for writes in spent:
            renderer.writes_depth = writes
            stage.gpu.ctx.finish()
            begin = time.perf_counter()
            stage.draw_output(frame, target)
            stage.gpu.ctx.finish()
            spent[writes] += (time.perf_counter() - begin) * (i >= 0)
    renderer.writes_depth = True
    return spent[True] / spent[False]


def _shaded_fragments(stage: Stage, plan: Plan) -> dict[str, float]:
    """Fragments shaded per pixel of the window, by mode: what a depth test rejects is not shaded."""
    target = stage.target(plan.window_px)
    query = stage.gpu.ctx.query(samples=True)
    counts = dict.fromkeys(MODES, 0)
    for i in range(plan.frames):
        frame = stage.frame(_camera(stage.scene.heightfield, (i + 0.5) / plan.frames), plan.window_px)
        for mode in MODES:
            stage.set_renderer("painter", PainterSettings(depth=4, levels=False, horizon=False, mode=mode))
            with query:
                stage.draw_output(frame, target)
            counts[mode] += query.samples
    pixels = plan.frames * plan.window_px[0] * plan.window_px[1]
    return {mode: count / pixels for mode, count in counts.items()}


def _picture_claim(gpu: Gpu, eyes: int) -> Claim:
    pixels, differing = compare_modes(gpu, eyes)
    return Claim(
        f"the picture is the depth buffer's, {eyes} eyes", "correct",
        f"{differing} of {pixels} pixels differ by more than one grey level", differing <= 1e-4 * pixels,
    )  # fmt: skip


def compare_modes(gpu: Gpu, eyes: int, seed: int = 7, size_px: tuple[int, int] = (96, 64)) -> tuple[int, int]:
    """Pixels drawn in correct mode over rough terrain, and how many differ from z-buffer mode by over a grey level.

    Eyes are inside and around the grid, over posts, edges and bisectors; all paths, with and without levels.
    """
    random = np.random.default_rng(seed)
    row, col = np.indices((97, 130))
    heights = 90 * np.abs(np.sin(row / 7.0) * np.cos(col / 9.0)) + random.normal(0, 6, row.shape)
    heights[32:48, 32:65] += 80.0  # cliffs
    terrain = Heightfield(heights.astype(np.float32), (10.0, 14.0), name="rough")
    stage = Stage(gpu, open_scene(terrain), "painter", PainterSettings(depth=4))
    (dx, dz), (width, depth) = terrain.spacing_m, terrain.extent_m
    differing = 0
    for eye in range(eyes):
        u, v = random.uniform(-0.3, 1.3, 2) * (terrain.cols, terrain.rows)
        if eye % 4 == 1:  # over a post
            u, v = round(u), round(v)
        elif eye % 4 == 2:  # over an edge
            u = round(u)
        elif eye % 4 == 3:  # over a diagonal
            v = foot_at(u, v).sum - u
        x, z = float(u * dx), float(v * dz)
        ground = float(terrain.heights_at(np.clip(x, 0, width), np.clip(z, 0, depth)))
        y = ground + float(random.choice([2.0, 20.0, 100.0, 600.0]))
        camera = Camera((x, y, z), float(random.uniform(0, 360)), float(random.uniform(-60, 15)), 0.0, 60.0)
        chosen = PainterSettings(
            path=("procedural", "cells", "indexed")[eye % 3], levels=eye % 2 == 0, tolerance_px=2.0, depth=4
        )
        pictures = []
        for mode in ("correct", "z-buffer"):
            stage.set_renderer("painter", replace(chosen, mode=mode))
            pictures.append(stage.render(camera, size_px).astype(np.int16))
        differing += int((np.abs(pictures[0] - pictures[1]).max(-1) > 1).sum())
    stage.release()
    return eyes * size_px[0] * size_px[1], differing
