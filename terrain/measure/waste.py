"""The waste meter: what a picture cost against what it needed.

Triangles are counted where their corners fall: each triangle is drawn once more as three points a pixel large, which
gives the number of triangles at every pixel, whoever drew them. Where there is more than one to a pixel on average,
they are smaller than pixels, and most of them are never seen.

What the picture needed is counted by a greedy approximation: points of the visible surface, taken from the reference's
position picture, are inserted into a triangulation, the worst of every triangle in each round, until the surface
between them is as near to the truth as what was drawn.

**Source** M. Garland, P. Heckbert, *Fast polygonal approximation of terrains and height fields*, CMU-CS-95-181 (1995),
with their "parallel" insertion of many points a round.

**Deviations** The importance of a point is its error on the screen from this one view, K |delta| n_y / l; points come
from the picture, not from the grid, so that what is hidden costs nothing. It is an estimate, and no lower bound: it
ignores that a hidden crest may need triangles, and it knows only every `STRIDE_PX`-th pixel.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.measure.accuracy import AccuracyMeter, Pool, drawn_by, geometric_error_px
from terrain.renderers.base import Renderer
from terrain.stage import Stage

Floats = npt.NDArray[np.float64]

STRIDE_PX = 4  # of the points that the greedy approximation knows, each way
WINDOW_PX = 5  # corners are averaged over so many pixels each way: a triangle of a pixel has them in several
BATCH_SHARE = 0.5  # of the triangles that are too coarse, the worst are mended first
NUDGE_M = 1e-3  # to ask how much a metre of height counts on the screen
ROUNDS = 60
LEAST_ERROR_PX = 0.25  # a picture needs no more: nobody sees less


@dataclass(frozen=True)
class Waste:
    """What one picture cost and needed.

    Attributes
    ----------
    triangles : int
        Drawn.
    covered_px : int
        Pixels that show terrain.
    small_share : float or None
        Share of the drawn triangles that lie where they are smaller than a pixel on average; None where there are none.
    overdraw_mean, overdraw_max : float
        How many times a covered pixel was drawn.
    ray_steps : float or None
        Per pixel; None where no rays are cast.
    slices : int or None
    error_px : float
        What 99.9 % of the pixels err by at most.
    needed : int
        Triangles of a greedy approximation of the visible surface with that error, or `LEAST_ERROR_PX` if it is less.
    """

    triangles: int
    covered_px: int
    small_share: float | None
    overdraw_mean: float
    overdraw_max: float
    ray_steps: float | None
    slices: int | None
    error_px: float
    needed: int


def measure_waste(
    stage: Stage, renderer: Renderer, meter: AccuracyMeter, camera: Camera, time_s: float = 0.0
) -> Generator[None, None, Waste]:
    """Measure one view in small steps.

    Parameters
    ----------
    stage : Stage
    renderer : Renderer
        Who draws.
    meter : AccuracyMeter
        Of the same stage; its size is the picture's.
    camera : Camera
    time_s : float
    """
    size_px = meter.size_px
    with drawn_by(stage, renderer):
        errors = stage.errors(camera, size_px, time_s)
        stats = renderer.stats
        triangles, slices, ray_steps = stats.triangles, stats.slices, stats.ray_steps
        covered = errors[..., 3] > 0.5
        pool = Pool()
        pool.add(errors[..., 0][covered])
        yield
        overdraw = stage.overdraw(camera, size_px, time_s)
        share = small_share(stage.corners(camera, size_px, time_s))
    yield
    points_m, weight = visible_points(stage, meter, renderer, camera)
    error_px = pool.percentile(99.9)
    needed = yield from greedy_triangles(points_m, weight, max(error_px, LEAST_ERROR_PX))
    return Waste(triangles, int(covered.sum()), share, *overdraw, ray_steps, slices, error_px, needed)


def small_share(corners: npt.NDArray[np.float32]) -> float | None:
    """Share of triangles that lie where there is more than one to a pixel.

    Parameters
    ----------
    corners : ndarray, (height, width)
        Corners of triangles in each pixel.

    Returns
    -------
    float or None
        None for a picture without a corner.
    """
    total = float(corners.sum(dtype=np.float64))
    if not total:
        return None
    from scipy import ndimage  # 160 ms to import, and the window starts with this module

    density = ndimage.uniform_filter(corners.astype(np.float64) / 3.0, WINDOW_PX, mode="nearest")
    return float(corners[density > 1.0].sum(dtype=np.float64)) / total


def visible_points(stage: Stage, meter: AccuracyMeter, renderer: Renderer, camera: Camera) -> tuple[Floats, Floats]:
    """Points (n, 3) of the reference surface that one sees, and how many pixels a metre of height is at each (n,)."""
    reference = meter.reference(renderer.diagonal)
    with drawn_by(stage, reference):
        world = stage.positions(camera, meter.size_px)[STRIDE_PX // 2 :: STRIDE_PX, STRIDE_PX // 2 :: STRIDE_PX]
    world = world[np.isfinite(world[..., 0])]
    terrain, height_px = stage.scene.heightfield, meter.size_px[1]
    nudged = world + np.array([0.0, NUDGE_M, 0.0])
    on, above = (geometric_error_px(w, camera, height_px, terrain, renderer.diagonal) for w in (world, nudged))
    weight = (above - on) / NUDGE_M
    known = np.isfinite(weight)
    return world[known], weight[known]


def greedy_triangles(points_m: Floats, weight: Floats, error_px: float) -> Generator[None, None, int]:
    """How many triangles approximate points to within an error on the screen, by greedy insertion.

    Parameters
    ----------
    points_m : ndarray, (n, 3)
        Points of a height field, in any order.
    weight : ndarray, (n,)
        Pixels to a metre of height at each.
    error_px : float
        99.9 % of the points may err by this much.

    Yields
    ------
    None
        After each round of insertions.

    Returns
    -------
    int
        Triangles that hold at least one point.
    """
    from scipy.spatial import Delaunay

    if not len(points_m):
        return 0
    lower, upper = points_m[:, [0, 2]].min(axis=0), points_m[:, [0, 2]].max(axis=0)
    scale = max(float((upper - lower).max()), 1e-9)
    plan = (points_m[:, [0, 2]] - lower) / scale  # about the unit square: what Qhull is precise for
    height = points_m[:, 1] - points_m[:, 1].mean()
    basis = np.column_stack([np.ones(len(plan)), plan])
    plane = np.linalg.lstsq(basis * weight[:, None], height * weight, rcond=None)[0]
    corners = np.array([[-0.1, -0.1], [1.1, -0.1], [1.1, 1.1], [-0.1, 1.1]])
    heights = np.concatenate([np.column_stack([np.ones(4), corners]) @ plane, height])
    everything = np.concatenate([corners, plan])
    chosen = np.arange(4)
    for _ in range(ROUNDS):
        mesh = Delaunay(everything[chosen])
        home = mesh.find_simplex(plan)
        error = np.abs(_interpolate(mesh, home, plan, heights[chosen]) - height) * weight
        home_count = len(np.unique(home[home >= 0]))
        allowed = len(plan) // 1000  # the one in a thousand that may err by more
        beyond = np.flatnonzero(error > error_px)
        if len(beyond) <= allowed:
            break
        yield
        # The worst point of every triangle that is too coarse, the worst of those first.
        order = beyond[np.lexsort((-error[beyond], home[beyond]))]
        first = order[np.r_[True, np.diff(home[order]) != 0]]
        first = first[np.argsort(-error[first])][: max(1, int(np.ceil(BATCH_SHARE * len(first))))]
        fresh = np.setdiff1d(first + 4, chosen)
        if not len(fresh):
            break
        chosen = np.concatenate([chosen, fresh])
    return home_count


def _interpolate(mesh: Any, home: npt.NDArray[np.int32], plan: Floats, height: Floats) -> Floats:
    """Heights (n,) of the triangulated surface at points in known triangles."""
    transform = mesh.transform[home]
    first = np.einsum("nij,nj->ni", transform[:, :2], plan - transform[:, 2])
    share = np.column_stack([first, 1.0 - first.sum(axis=1)])
    return np.asarray((share * height[mesh.simplices[home]]).sum(axis=1))
