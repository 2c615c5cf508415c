"""Figure 6 of the integrated multiresolution model: frame times by shading, with and without level of detail.

A reference grid of 640 x 320 cells with about 130 000 triangles of fine structures in it (roads of two edges, whose
cells are refined), a grey topographic texture of 2500 x 5000 texels and a thematic one of 3200 x 6400 in colour; drawn
with light from the vertices, with the topographic texture, and with both textures. All take turns, frame by frame.

**Source**: J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Experimental results" and figure 6.

**Deviations**: the paper's data, its flight and the numbers of its figure are not known: only what its text says of
them. The terrain is a part of the embedded alps. A further row has the topographic texture as this program bakes it,
one texel per post, without page tables. Haze is off, so that all pay for the same. Without level of detail everything
is drawn, nothing culled, as a display list would.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrain.breaklines import Breaklines
from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield, surface_heights
from terrain.measure.cost import time_frame, warm_up
from terrain.measure.reproduce import Cell, Claim, Plot, Progress, Reproduction, Table
from terrain.renderers.multiresolution import MultiresolutionRenderer, MultiresolutionSettings
from terrain.scene import open_scene
from terrain.stage import Stage
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.look import LookSettings, sun_direction

Pixels = npt.NDArray[np.uint8]

GOURAUD, BAKED, ONE, TWO = "Gouraud", "topographic, baked", "topographic", "topographic + thematic"
WITHOUT, WITH = "without level of detail", "with level of detail"
ROAD_WIDTH, ROADS_PER_BAND = 0.12, 10  # posts
INTERACTIVE_MS = 100.0
LOADING_S = 60.0  # for all tiles of a view, at most

Times = dict[tuple[str, str], npt.NDArray[np.float64]]  # by shading and detail: ms of every frame


@dataclass(frozen=True)
class Plan:
    """How much is measured: cells of the grid (rows, cols), triangles of fine structures, texels of the two textures
    (height, width), frames, window, rounds."""

    cells: tuple[int, int] = (640, 320)
    fine_triangles: int = 130_000
    topographic: tuple[int, int] = (5000, 2500)
    thematic: tuple[int, int] = (6400, 3200)
    frames: int = 12
    window_px: tuple[int, int] = (640, 480)
    rounds: int = 3


def reproduce(gpu: Gpu, folder: Path, progress: Progress) -> Reproduction:
    """Measure figure 6; ``folder`` is left alone."""
    from terrain.flight import demo_flight
    from terrain.synthetic import make_scene

    plan = Plan()
    progress(0.0, "terrain")
    alps = make_scene("alps", 1025)
    rows, cols = (n + 1 for n in plan.cells)
    part = np.ascontiguousarray(alps.heights_m[:rows, -cols:])
    terrain = Heightfield(part, alps.spacing_m, name="alps, a part")
    flight = demo_flight(terrain)
    cameras = [flight.camera_at(t) for t in np.linspace(0.0, flight.duration_s, plan.frames).tolist()]
    return measure(gpu, terrain, cameras, plan, progress)


def measure(gpu: Gpu, terrain: Heightfield, cameras: Sequence[Camera], plan: Plan, progress: Progress) -> Reproduction:
    """As `reproduce`, over a terrain of the plan's size, from these cameras."""
    progress(0.05, "fine structures")
    scene = open_scene(terrain, breaklines=build_roads(terrain, plan.fine_triangles))
    look = LookSettings(fog=False)
    progress(0.1, "topographic texture")
    topographic = ArraySource("topographic", shade_relief(terrain, plan.topographic), whole_extent(terrain))
    progress(0.2, "thematic texture")
    thematic = ArraySource("thematic", colour_zones(terrain, plan.thematic), whole_extent(terrain))
    images = {GOURAUD: [], BAKED: [], ONE: [topographic], TWO: [topographic, thematic]}
    stages = {name: Stage(gpu, scene, "reference", look=look) for name in images}
    times: Times = {}
    try:
        for name, stage in stages.items():
            stage.set_images(images[name])
        times, triangles, cells = _measure_stages(stages, cameras, plan, progress)
    finally:
        for stage in stages.values():
            stage.release()
    progress(1.0, "done")
    return Reproduction([_table(times, triangles), _data_table(terrain, plan, cells)], [_plot(times)], _claims(times))


def _measure_stages(
    stages: dict[str, Stage], cameras: Sequence[Camera], plan: Plan, progress: Progress
) -> tuple[Times, dict[str, float], tuple[int, int]]:
    """Times of all frames, the fastest round each; mean triangles; refined cells and fine structures' triangles."""
    settings = MultiresolutionSettings(tolerance_px=1.0)
    renderers = {
        (name, detail): MultiresolutionRenderer(
            stage.gpu, stage.scene, replace(settings, gouraud=name == GOURAUD, detail=detail == WITH)
        )
        for name, stage in stages.items()
        for detail in (WITHOUT, WITH)
    }
    times = {key: np.full(len(cameras), np.inf) for key in renderers}
    triangles: dict[str, list[float]] = {WITHOUT: [], WITH: []}
    try:
        for number, camera in enumerate(cameras):
            progress(0.3 + 0.7 * number / len(cameras), f"frame {number + 1} of {len(cameras)}")
            for stage in stages.values():
                _load(stage, camera, plan.window_px)
            for (name, _), renderer in renderers.items():
                target = stages[name].target(plan.window_px)
                warm_up(stages[name], renderer, camera, 0.0, target, frames=1)
            for turn in range(plan.rounds * len(renderers)):
                key = list(renderers)[(turn + number) % len(renderers)]
                stage, renderer = stages[key[0]], renderers[key]
                taken = time_frame(stage, renderer, camera, 0.0, stage.target(plan.window_px))
                times[key][number] = min(times[key][number], taken["frame_ms"])
            for detail in (WITHOUT, WITH):
                triangles[detail].append(renderers[BAKED, detail].stats.triangles)
        cells = renderers[BAKED, WITHOUT].fine_structures
    finally:
        for renderer in renderers.values():
            renderer.release()
    return times, {detail: float(np.mean(counts)) for detail, counts in triangles.items()}, cells


def _load(stage: Stage, camera: Camera, window_px: tuple[int, int]) -> None:
    """Wait until all tiles of a view are there: loading is not what is measured."""
    end = time.perf_counter() + LOADING_S
    while not stage.load_tiles(stage.frame(camera, window_px)) and time.perf_counter() < end:
        pass


def build_roads(terrain: Heightfield, triangles: int) -> Breaklines:
    """Winding roads of two edges from north to south, side by side in a few bands, for what is built lies together.
    Each cell on the way is refined from two triangles to six."""
    wanted = triangles / 4.0  # cells
    rows, cols = terrain.rows - 1, terrain.cols - 1
    roads = max(1, round(wanted / (1.04 * rows)))  # bends cross more cells than straights
    bands = -(-roads // ROADS_PER_BAND)
    along = np.linspace(0.0, rows, max(rows // 4, 2) + 1)
    lines = []
    for road in range(roads):
        band, place = divmod(road, ROADS_PER_BAND)
        middle = cols * (band + 0.3) / bands + 0.1 * cols / bands * np.sin(along / rows * 12.0 + band) + 1.1 * place
        bed = surface_heights(terrain.heights_m, np.clip(middle, 0.0, cols), along)
        for side in (-0.5, 0.5):
            lines.append(np.column_stack([middle + side * ROAD_WIDTH + 0.01, along, bed]))
    return Breaklines(tuple(lines), "roads")


def shade_relief(terrain: Heightfield, size: tuple[int, int]) -> Pixels:
    """A grey topographic texture: the surface in the light of the default sun."""
    height = _sampled(terrain, size)
    step = [extent / n for extent, n in zip(terrain.extent_m[::-1], size, strict=True)]
    south, east = np.gradient(height, *step)
    x, y, z = sun_direction(LookSettings())
    facing = (y - x * east - z * south) / np.sqrt(1.0 + east**2 + south**2)
    grey = np.uint8(255) * np.clip(0.25 + 0.75 * facing, 0.0, 1.0)
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def colour_zones(terrain: Heightfield, size: tuple[int, int]) -> Pixels:
    """A thematic texture: zones of height, parted by thin lines, half transparent."""
    low, high = terrain.height_range_m
    zone = (_sampled(terrain, size) - low) / max(high - low, 1e-6) * 12.0
    colours = np.array([[58, 105, 170], [92, 150, 92], [190, 180, 96], [196, 130, 82], [160, 90, 90], [225, 225, 230]])
    pixels = np.empty((*size, 4), np.uint8)
    pixels[..., :3] = colours[np.clip(zone / 2.0, 0, 5).astype(np.intp)]
    pixels[np.abs(zone - np.round(zone)) < 0.02, :3] = 40
    pixels[..., 3] = 140
    return pixels


def _sampled(terrain: Heightfield, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Heights of a smooth surface through the posts at texels of a texture."""
    from scipy.ndimage import zoom

    factors = [n / m for n, m in zip(size, terrain.heights_m.shape, strict=True)]
    return np.asarray(zoom(terrain.heights_m, factors, order=2, grid_mode=True, mode="nearest"), np.float32)


def _table(times: Times, triangles: dict[str, float]) -> Table:
    rows: list[list[Cell]] = []
    for name in (GOURAUD, BAKED, ONE, TWO):
        slow, fast = float(np.mean(times[name, WITHOUT])), float(np.mean(times[name, WITH]))
        rows.append([name, slow, fast, slow / fast, triangles[WITHOUT], triangles[WITH]])
    columns = (
        "shading", f"{WITHOUT} [ms]", f"{WITH} [ms]", "gain", f"triangles {WITHOUT}", f"triangles {WITH}",
    )  # fmt: skip
    note = (
        "Means over the flight, the fastest of several rounds of each frame. The paper's are in a picture only. "
        "Its text: more than 5 s without level of detail on a 350 MHz Pentium II with a Riva TNT."
    )
    return Table("figure6", "Figure 6: frame time by shading, with and without level of detail", columns, rows, note)


def _data_table(terrain: Heightfield, plan: Plan, cells: tuple[int, int]) -> Table:
    grid = plan.cells[0] * plan.cells[1]
    rows: list[list[Cell]] = [
        ["reference grid [cells]", f"{plan.cells[0]} x {plan.cells[1]}", "640 x 320"],
        ["refined cells [%]", 100.0 * cells[0] / grid, "about 15"],
        ["triangles that fine structures add", cells[1] - 2 * cells[0], "about 130 000"],
        ["triangles in all", 2 * (grid - cells[0]) + cells[1], "about 500 000"],
        ["topographic texture, grey", " x ".join(map(str, plan.topographic[::-1])), "2500 x 5000"],
        ["thematic texture, RGB", " x ".join(map(str, plan.thematic[::-1])), "3200 x 6400"],
        ["window [px]", " x ".join(map(str, plan.window_px)), "640 x 480"],
    ]
    return Table("data", f"What was drawn: {terrain.name}", ("", "ours", "paper"), rows)


def _plot(times: Times) -> Plot:
    series = {
        f"{name}, {detail}": [(float(frame), ms) for frame, ms in enumerate(times[name, detail].tolist(), 1)]
        for detail in (WITHOUT, WITH)
        for name in (GOURAUD, BAKED, ONE, TWO)
    }
    return Plot("figure6", "Figure 6: frame time along the flight", "frame", "frame time [ms]", series, log_y=True)


def _claims(times: Times) -> list[Claim]:
    mean = {key: float(np.mean(ms)) for key, ms in times.items()}
    fastest = min(mean[name, WITH] for name in (GOURAUD, ONE, TWO))
    slowest = max(mean[name, WITH] for name in (GOURAUD, ONE, TWO))
    gains = [mean[name, WITHOUT] / mean[name, WITH] for name in (GOURAUD, ONE, TWO)]
    claims = [
        Claim(
            "Level of detail makes the data set interactive", "more than 5 s become a fraction of a second",
            f"{fastest:.0f} to {slowest:.0f} ms, {min(gains):.1f} to {max(gains):.1f} times faster",
            slowest <= INTERACTIVE_MS and min(gains) > 1.0,
        ),
    ]  # fmt: skip
    for detail in (WITHOUT, WITH):
        gouraud, one = mean[GOURAUD, detail], mean[ONE, detail]
        share = 100.0 * float((times[TWO, detail] < times[GOURAUD, detail]).mean())
        claims += [
            Claim(
                f"Gouraud shading is slower than a topographic texture, {detail}", "Gouraud is the slowest method",
                f"{gouraud:.1f} ms against {one:.1f} ms, {mean[BAKED, detail]:.1f} ms baked", gouraud > one,
            ),
            Claim(
                f"Two textures are almost always faster than Gouraud shading, {detail}", "almost always",
                f"in {share:.0f} % of the frames: {mean[TWO, detail]:.1f} ms against {gouraud:.1f} ms", share > 90.0,
            ),
        ]  # fmt: skip
    return claims
