"""Table 1 of the perturbed base planes: cost against the resolution of the height map, on the CPU and on the GPU.

One landscape is sampled by 256 x 256 to 4096 x 4096 cells over the paper's 50 km x 80 km and seen from the same eyes,
so that nothing changes but the resolution. The resolutions take turns, frame by frame, so that whatever else the
machine does hits all alike.

**Source**: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering", table 1.

**Deviations**: the paper gives resolutions up to 1024 x 1024 only; its terrain, view and level of detail are not known.
Its CPU version was compiled code; ours is the float64 numpy caster, which the GPU's is tested against.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrain.algorithms.perturbation import build_bounds
from terrain.algorithms.perturbation_cast import cast_rays
from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield
from terrain.measure.reproduce import Claim, Plot, Progress, Reproduction, Table
from terrain.planes import BasePlane
from terrain.renderers.perturbation import PerturbationSettings
from terrain.scene import open_scene
from terrain.stage import Stage

PAPER_MS = {256: (802.65, 67.03, 31.07), 512: (850.81, 71.05, 32.93), 1024: (856.52, 71.53, 33.15)}
CELLS = (256, 512, 1024, 2048, 4096)
EXTENT_M = (50_000.0, 80_000.0)
SIZE_PX = (1920, 1080)
REPEATS = 5  # the fastest counts: whatever else the machine does only adds
CPU_REPEATS = 3
CPU_STRIDE = 4  # the CPU casts every 4th ray of every 4th row: 130 000 rays, enough for its cost per ray to settle

GROWTH_LIMITS = ((1024, 1.10, "+7 %"), (4096, 1.60, "not measured"))  # cells, at most this times 256 x 256, paper

VARIANTS = {
    "GPU, within 1 px": PerturbationSettings(),
    "GPU, full detail": PerturbationSettings(detail=False),
    "GPU, full detail, maximum pyramid": PerturbationSettings(detail=False, bounds="heights"),
}


def reproduce(gpu: Gpu, folder: Path, progress: Progress) -> Reproduction:
    """Measure table 1."""
    heights = _landscape(max(CELLS))
    cameras = _cameras(heights)
    terrains = {cells: _sampled(heights, cells) for cells in CELLS}
    cost: dict[str, dict[int, float]] = {}
    progress(0.05, "CPU")
    rounds = [{cells: _cpu_ms(terrain, cameras[0]) for cells, terrain in terrains.items()} for _ in range(CPU_REPEATS)]
    cost["CPU"] = {cells: min(times[cells] for times in rounds) for cells in CELLS}
    stages = {cells: Stage(gpu, open_scene(terrain), "reference") for cells, terrain in terrains.items()}
    names = ("Full mesh, culled", *VARIANTS)
    for number, name in enumerate(names):
        progress(0.3 + 0.6 * number / len(names), name)
        for stage in stages.values():
            stage.set_renderer("perturbation" if name in VARIANTS else "reference", VARIANTS.get(name))
        cost[name] = _frame_ms(stages, cameras)
    progress(0.9, "steps")
    steps = {cells: _mean_steps(stage, cameras) for cells, stage in stages.items()}
    for stage in stages.values():
        stage.release()
    progress(1.0, "done")
    return Reproduction([_table(cost, steps)], [_plot(cost)], _claims(cost))


def _sampled(heights: npt.NDArray[np.float32], cells: int) -> Heightfield:
    stride = (heights.shape[0] - 1) // cells
    spacing_m = (EXTENT_M[0] / cells, EXTENT_M[1] / cells)
    return Heightfield(np.ascontiguousarray(heights[::stride, ::stride]), spacing_m)


def _landscape(cells: int) -> npt.NDArray[np.float32]:
    """Fractal mountains (cells + 1)^2, 0 to 3000 m, made from their spectrum; every coarser map samples the same."""
    rng = np.random.default_rng(2015)
    u, v = np.fft.rfftfreq(cells)[None, :], np.fft.fftfreq(cells)[:, None]
    frequency = np.hypot(u, v)
    frequency[0, 0] = 1.0
    amplitude = frequency**-2.1
    amplitude[frequency < 3.0 / cells] = 0.0  # no single mountain fills the map
    wave = amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape))
    heights = np.pad(np.fft.irfft2(wave, s=(cells, cells)), (0, 1), mode="wrap")
    heights -= heights.min()
    return np.ascontiguousarray(heights * (3000.0 / heights.max()), np.float32)


def _cameras(heights: npt.NDArray[np.float32]) -> list[Camera]:
    """Six eyes over the map, low to high; the same for every resolution."""
    cameras = []
    for number, clearance_m in enumerate((150.0, 300.0, 500.0, 800.0, 1200.0, 2000.0)):
        across, along = 0.2 + 0.12 * number, 0.75 - 0.08 * number
        ground = heights[int(along * (heights.shape[0] - 1)), int(across * (heights.shape[1] - 1))]
        position = (across * EXTENT_M[0], float(ground) + clearance_m, along * EXTENT_M[1])
        cameras.append(Camera(position, 55.0 * number, -6.0 - 3.0 * number))
    return cameras


def _frame_ms(stages: dict[int, Stage], cameras: list[Camera]) -> dict[int, float]:
    """Per resolution the mean over the cameras of the fastest whole frame."""
    fastest = {cells: np.full(len(cameras), np.inf) for cells in stages}
    for number, camera in enumerate(cameras):
        for _ in range(REPEATS):
            for cells, stage in stages.items():
                frame, target = stage.frame(camera, SIZE_PX), stage.target(SIZE_PX)
                stage.gpu.ctx.finish()
                begin = time.perf_counter()
                stage.draw(frame, target)
                stage.gpu.ctx.finish()
                fastest[cells][number] = min(fastest[cells][number], time.perf_counter() - begin)
    return {cells: 1e3 * float(times.mean()) for cells, times in fastest.items()}


def _mean_steps(stage: Stage, cameras: list[Camera]) -> float:
    """Nodes a ray visits within 1 px, mean over all pixels of all cameras."""
    stage.set_renderer("perturbation", PerturbationSettings(level_view="steps"))
    steps = []
    for camera in cameras:
        stage.render(camera, SIZE_PX, "levels")
        steps.append(stage.renderer.stats.ray_steps or 0.0)
    return float(np.mean(steps))


def _cpu_ms(terrain: Heightfield, camera: Camera) -> float:
    """Time of all rays of a frame, from a sample of them."""
    g = BasePlane(terrain).map_from_world
    bounds = build_bounds(terrain.heights_m)
    world = camera.ray_directions(*SIZE_PX)[::CPU_STRIDE, ::CPU_STRIDE].reshape(-1, 3)
    thickness = 2.0 / camera.pixels_per_radian(SIZE_PX[1])
    begin = time.perf_counter()
    direction = world @ g[:3, :3].T
    origin = np.broadcast_to((g @ np.append(camera.eye_m, 1.0))[:3], direction.shape)
    cast_rays(
        terrain.heights_m, bounds, origin, direction, t_start=1.0, thickness_per_m=thickness, cell_m=terrain.spacing_m
    )
    return 1e3 * (time.perf_counter() - begin) * SIZE_PX[0] * SIZE_PX[1] / len(world)


def _table(cost: dict[str, dict[int, float]], steps: dict[int, float]) -> Table:
    columns = (
        "Height map", "paper i7-2700K [ms]", "paper GTX 550 Ti [ms]", "paper GTX 750 Ti [ms]",
        *(f"{name} [ms]" for name in cost), "steps per ray",
    )  # fmt: skip
    rows = [
        (f"{cells}x{cells}", *PAPER_MS.get(cells, (None,) * 3), *(cost[name][cells] for name in cost), steps[cells])
        for cells in CELLS
    ]
    note = (
        f"Whole frames at {SIZE_PX[0]} x {SIZE_PX[1]}, mean of six views, fastest of {REPEATS}; the CPU's from "
        f"{SIZE_PX[0] // CPU_STRIDE} x {SIZE_PX[1] // CPU_STRIDE} rays of one view. Steps: nodes visited, within 1 px."
    )
    return Table("table1", "Table 1: frame time against the resolution of the height map", columns, rows, note)


def _plot(cost: dict[str, dict[int, float]]) -> Plot:
    series = {name: list(times.items()) for name, times in cost.items()}
    for column, device in enumerate(("i7-2700K", "GTX 550 Ti", "GTX 750 Ti")):
        series[f"paper, {device}"] = [(cells, times[column]) for cells, times in PAPER_MS.items()]
    title = "Frame time against the resolution of the height map, 1920 x 1080"
    return Plot("cost_over_resolution", title, "cells along a side", "frame time [ms]", series, log_x=True, log_y=True)


def _claims(cost: dict[str, dict[int, float]]) -> list[Claim]:
    claims = []
    for name in ("GPU, within 1 px", "GPU, full detail"):
        times = cost[name]
        for cells, limit, paper in GROWTH_LIMITS:
            growth = times[cells] / times[256]
            text = f"{name}: {cells}x{cells} costs at most {100 * (limit - 1):.0f} % more than 256x256"
            claims.append(Claim(text, paper, f"{100 * (growth - 1):+.0f} %", growth <= limit))
    ratio = min(cost["CPU"][cells] / ms for cells, ms in cost["GPU, within 1 px"].items())
    text = "The GPU path is at least ten times faster than the CPU's"
    claims.append(Claim(text, "12 to 26 times", f"{ratio:.0f} times", ratio >= 10.0))
    return claims
