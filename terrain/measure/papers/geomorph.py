"""Table 7 and table 2 of the geomorphing tiles: frames per second by terrain and tile size, with and without morphing.

**Source**: B. D. Larsen and N. J. Christensen, *Real-time terrain rendering using smooth hardware optimized level of
detail*, 2003, section 3: one mesh in three resolutions (the small one is rough, the large one smooth), flown along a
predefined path; section 2.1 for the triangles of each level.

**Deviations**: the paper's terrain, path, window and threshold are unknown. Here the embedded alps are flown along
their demo flight at 1280 x 720 pixels with one pixel of error allowed. Tiles of 9 x 9 and 65 x 65 posts are added. As
in the paper every tile is drawn by itself and all in the frustum are drawn; a last column shows what joined tiles and
horizon culling make of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from terrain.camera import Camera
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield
from terrain.measure.cost import Cost, time_frame, warm_up
from terrain.measure.reproduce import Cell, Claim, Plot, Progress, Reproduction, Table
from terrain.renderers.geomorph import GeomorphRenderer, GeomorphSettings
from terrain.renderers.tile_mesh import build_tile_indices
from terrain.scene import open_scene
from terrain.stage import Stage

# Table 7: (posts along the terrain, posts along a tile) -> frames per second with and without morphing.
PAPER_FPS = {
    (513, 17): (66.25, 67.07),
    (513, 33): (39.49, 38.17),
    (1025, 17): (28.31, 28.51),
    (1025, 33): (39.71, 38.12),
    (2049, 17): (8.65, 7.66),
    (2049, 33): (18.59, 18.05),
}
PAPER_REDUCTION = (0.0, 75.0, 93.75, 98.44, 99.61)  # table 2: per cent, by level

_AS_PAPER = GeomorphSettings(join=False, horizon=False)
_VARIANTS = ("with morph", "no morph", "joined, horizon")


@dataclass(frozen=True)
class Plan:
    """How much is measured: posts along the terrain and along a tile, frames of the flight, window."""

    sizes: Sequence[int] = (513, 1025, 2049)
    tiles: Sequence[int] = (9, 17, 33, 65)
    frames: int = 24
    window_px: tuple[int, int] = (1280, 720)


@dataclass(frozen=True)
class _Row:
    """One line of table 7: frames per second of the variants, triangles with morph."""

    size: int
    tile: int
    fps: tuple[float, ...]
    triangles: int


def reproduce(gpu: Gpu, folder: Path, progress: Progress) -> Reproduction:
    """Measure tables 2 and 7; ``folder`` is left alone."""
    from terrain.flight import demo_flight
    from terrain.synthetic import make_scene

    plan = Plan()
    terrain = make_scene("alps", max(plan.sizes))
    flight = demo_flight(terrain)
    times_s = np.linspace(0.0, flight.duration_s, plan.frames).tolist()
    return measure(gpu, terrain, [flight.camera_at(t) for t in times_s], plan, progress)


def measure(
    gpu: Gpu, terrain: Heightfield, cameras: Sequence[Camera], plan: Plan, progress: Progress
) -> Reproduction:  # fmt: skip
    """As `reproduce`, over a terrain of the largest size, from these cameras."""
    rows: list[_Row] = []
    for number, size in enumerate(plan.sizes):
        progress(number / len(plan.sizes), f"{size} x {size} posts")
        rows += _measure_size(gpu, coarsened(terrain, size), cameras, plan)
    progress(1.0, "done")
    return Reproduction([_speed_table(rows), _level_table()], _plots(rows), _claims(rows))


def coarsened(terrain: Heightfield, posts: int) -> Heightfield:
    """The same square terrain with fewer posts along each side.

    Raises
    ------
    ValueError
        If the posts do not fall on posts of ``terrain``.
    """
    step, rest = divmod(terrain.rows - 1, posts - 1)
    if rest or terrain.rows != terrain.cols:
        raise ValueError(f"expected a square terrain whose cells {posts - 1} divides, found {terrain.rows - 1}")
    (dx, dz), heights = terrain.spacing_m, np.ascontiguousarray(terrain.heights_m[::step, ::step])
    return replace(terrain, heights_m=heights, spacing_m=(dx * step, dz * step), holes=None)


def _measure_size(gpu: Gpu, terrain: Heightfield, cameras: Sequence[Camera], plan: Plan) -> list[_Row]:
    """Frames per second of every tile size; all take turns, frame by frame."""
    stage = Stage(gpu, open_scene(terrain), "reference")
    target = stage.target(plan.window_px)
    settings = [
        variant
        for tile in plan.tiles
        for variant in (
            replace(_AS_PAPER, tile_cells=tile - 1),
            replace(_AS_PAPER, tile_cells=tile - 1, driver="off"),
            GeomorphSettings(tile_cells=tile - 1),
        )
    ]
    renderers = [GeomorphRenderer(gpu, stage.scene, chosen) for chosen in settings]
    costs = [Cost(rounds=[{}]) for _ in renderers]
    for renderer in renderers:
        warm_up(stage, renderer, cameras[0], 0.0, target)
    for i, camera in enumerate(cameras):
        for k in range(len(renderers)):
            turn = (i + k) % len(renderers)  # nobody always follows the same neighbour
            costs[turn].add(time_frame(stage, renderers[turn], camera, i / 30, target))
    for renderer in renderers:
        renderer.release()
    stage.release()
    fps = [1e3 / float(np.median(cost.rounds[0]["frame_ms"])) for cost in costs]
    triangles = [round(float(np.median(cost.rounds[0]["triangles"]))) for cost in costs]
    width = len(_VARIANTS)
    return [
        _Row(terrain.rows, tile, tuple(fps[width * k : width * (k + 1)]), triangles[width * k])
        for k, tile in enumerate(plan.tiles)
    ]


def _speed_table(rows: Sequence[_Row]) -> Table:
    cells: list[list[Cell]] = []
    for row in rows:
        paper = PAPER_FPS.get((row.size, row.tile), (None, None))
        cost = 100 * (row.fps[1] / row.fps[0] - 1)
        names = f"{row.size} x {row.size}", f"{row.tile} x {row.tile}"
        cells.append([*names, row.fps[0], row.fps[1], cost, row.triangles, row.fps[2], *paper])
    columns = (
        "terrain", "tile", "with morph [fps]", "no morph [fps]", "morphing costs [%]", "triangles",
        "joined, horizon [fps]", "paper, with [fps]", "paper, no [fps]",
    )  # fmt: skip
    return Table(
        "table7", "Table 7: frames per second by terrain and tile size", columns, cells,
        "Medians over the flight. Paper: Pentium III 800 MHz, GeForce 3.",
    )  # fmt: skip


def _level_table() -> Table:
    cells = 16
    full = len(build_tile_indices(cells)) // 3
    rows = []
    for level, paper in enumerate(PAPER_REDUCTION):
        triangles = len(build_tile_indices(cells >> level)) // 3
        rows.append((level, triangles, 100 * (1 - triangles / full), paper))
    columns = ("level", "triangles of a 17 x 17 tile", "reduction [%]", "paper [%]")
    return Table("table2", "Table 2: fewer triangles with every level", columns, rows)


def _plots(rows: Sequence[_Row]) -> list[Plot]:
    sizes = list(dict.fromkeys(row.size for row in rows))
    plots = []
    for size in sizes:
        series = {
            name: [(float(row.tile), row.fps[k]) for row in rows if row.size == size]
            for k, name in enumerate(_VARIANTS)
        }
        paper = [(float(tile), fps[0]) for (posts, tile), fps in PAPER_FPS.items() if posts == size]
        if paper:
            series["with morph (paper)"] = paper
        plots.append(
            Plot(f"table7_{size}", f"Table 7, {size} x {size} posts", "posts along a tile", "frames per second",
                 series, log_x=True)
        )  # fmt: skip
    return plots


def _claims(rows: Sequence[_Row]) -> list[Claim]:
    costs = [100 * (row.fps[1] / row.fps[0] - 1) for row in rows]
    best = {
        size: max((row for row in rows if row.size == size), key=lambda row: row.fps[0]).tile
        for size in dict.fromkeys(row.size for row in rows)
    }
    first, *_, last = best.items()
    reduction = 100 * (1 - len(build_tile_indices(8)) / len(build_tile_indices(16)))
    return [
        Claim(
            "Morphing costs nothing that can be measured", "-11 to +3 % of the frame rate",
            f"{np.median(costs):+.1f} % in the median, {min(costs):+.1f} to {max(costs):+.1f} %",
            abs(float(np.median(costs))) <= 3.0,
        ),
        Claim(
            "Small tiles are best where the mesh is rough, large ones where it is smooth",
            "17 x 17 at 513 x 513, 33 x 33 from 1025 x 1025",
            ", ".join(f"{tile} x {tile} at {size} x {size}" for size, tile in best.items()),
            first[1] < last[1],
        ),
        Claim("Every level has 75 % fewer triangles", "75 %", f"{reduction:.4g} %", abs(reduction - 75.0) < 0.01),
    ]  # fmt: skip
