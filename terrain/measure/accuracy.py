"""How far a drawn picture is from the truth.

**Source**: the project's definitions, the same for all algorithms. For every covered pixel the vertical distance of the
drawn point to the reference surface at its (x, z), times the surface normal's y (the first-order distance to the
surface), projected: K |delta| / l. The reference surface is the one whose diagonal rule the renderer declares, so that
none is charged for another's choice.

The GPU evaluates it from the position target (`shaders/measure_error.frag`); `geometric_error_px` is its float64 twin.
Figures of many frames are pooled in histograms with a resolution of 1 %: percentiles are those of all pixels of all
frames, maxima and means are exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.gpu.targets import Target, create_target
from terrain.heightfield import Diagonal, Heightfield
from terrain.renderers.base import Renderer
from terrain.renderers.reference import ReferenceRenderer
from terrain.stage import Stage

Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

BINS_PER_OCTAVE = 64
SMALLEST_PX, OCTAVES = 2.0**-20, 40


class Pool:
    """Figures of many pixels: count, mean and maximum exactly, percentiles to 1 %."""

    def __init__(self) -> None:
        self.count, self.total, self.maximum = 0, 0.0, 0.0
        self._bins = np.zeros(OCTAVES * BINS_PER_OCTAVE, np.int64)

    def add(self, values: npt.NDArray[Any]) -> None:
        """Add non-negative values of any shape."""
        values = np.abs(np.asarray(values, np.float32)).ravel()
        if not values.size:
            return
        self.count += values.size
        self.total += float(values.sum(dtype=np.float64))
        self.maximum = max(self.maximum, float(values.max()))
        at = np.log2(np.maximum(values, np.float32(SMALLEST_PX))) - np.float32(np.log2(SMALLEST_PX))
        index = np.minimum((at * BINS_PER_OCTAVE).astype(np.int32), len(self._bins) - 1)
        self._bins += np.bincount(index, minlength=len(self._bins))

    @property
    def mean(self) -> float:
        return self.total / self.count if self.count else 0.0

    def percentile(self, share: float) -> float:
        """The value below which ``share`` per cent of all pixels lie: the upper end of its bin, at most the maximum."""
        if not self.count:
            return 0.0
        wanted = np.ceil(self.count * share / 100.0)
        index = int(np.searchsorted(np.cumsum(self._bins), wanted))
        return min(SMALLEST_PX * 2.0 ** ((index + 1) / BINS_PER_OCTAVE), self.maximum)

    def summary(self, *shares: float) -> dict[str, float]:
        """``{"mean": …, "p99": …, "p999": …, "max": …}`` for the wanted percentiles."""
        names = {share: "p" + f"{share:g}".replace(".", "") for share in shares}
        return {"mean": self.mean, **{names[s]: self.percentile(s) for s in shares}, "max": self.maximum}


@dataclass(frozen=True, eq=False)
class Truth:
    """What the reference shows in one frame: which pixels are covered (height, width), row 0 at the top."""

    covered: Bools


@dataclass
class FrameAccuracy:
    """Accuracy of one picture; arrays (height, width), row 0 at the top.

    ``error_px`` is signed, positive above the reference surface, and 0 where ``covered`` is False. ``popping_px`` holds
    the change at points visible in the frame before too (n,), or None for a first frame.
    """

    error_px: npt.NDArray[np.float32]
    vertical_error_m: npt.NDArray[np.float32]
    covered: Bools
    holes_px: int
    silhouette_shift_px: npt.NDArray[np.float32]
    differing_px: int
    popping_px: npt.NDArray[np.float32] | None


@dataclass
class Accuracy:
    """Pooled accuracy of a flight; `figures` gives it as in the results file."""

    error: Pool = field(default_factory=Pool)
    vertical_error_m: float = 0.0
    holes_px: int = 0
    silhouette: Pool = field(default_factory=Pool)
    differing_px: int = 0
    popping: Pool = field(default_factory=Pool)

    def add(self, frame: FrameAccuracy) -> None:
        self.error.add(frame.error_px[frame.covered])
        if frame.covered.any():
            self.vertical_error_m = max(self.vertical_error_m, float(np.abs(frame.vertical_error_m).max()))
        self.holes_px += frame.holes_px
        self.silhouette.add(frame.silhouette_shift_px)
        self.differing_px += frame.differing_px
        if frame.popping_px is not None:
            self.popping.add(frame.popping_px)

    def figures(self) -> dict[str, Any]:
        """The accuracy part of one run of the results file; what was not measured is absent."""
        figures: dict[str, Any] = {
            "geometric_error_px": self.error.summary(99.0, 99.9),
            "vertical_error_m": {"max": self.vertical_error_m},
            "holes_px": self.holes_px,
            "silhouette_px": {
                "mean": self.silhouette.mean, "max": self.silhouette.maximum, "differing": self.differing_px,
            },
        }  # fmt: skip
        if self.popping.count:
            figures["popping_px"] = {"p99": self.popping.percentile(99.0), "max": self.popping.maximum}
        return figures


class AccuracyMeter:
    """Measures pictures of a stage against the reference surface.

    Parameters
    ----------
    stage : Stage
        Whose scene is drawn. The stage's own renderer is left as it is.
    size_px : tuple of int
        ``(width, height)`` of the measured pictures.
    """

    def __init__(self, stage: Stage, size_px: tuple[int, int]) -> None:
        self.stage, self.size_px = stage, size_px
        gpu = stage.gpu
        self._positions = [create_target(gpu, size_px, "position") for _ in range(2)]
        self._errors = [create_target(gpu, size_px, "error") for _ in range(2)]
        self._changes = create_target(gpu, size_px, "position")
        self._popping_pass = Geometry(gpu, "fullscreen", "measure_popping")
        self._references: dict[Diagonal, ReferenceRenderer] = {}
        self._previous: Frame | None = None

    def truth(self, camera: Camera, diagonal: Diagonal) -> Truth:
        """What the reference of a diagonal rule shows from ``camera``."""
        target = self._draw_positions(self.reference(diagonal), self.stage.frame(camera, self.size_px))
        return Truth(target.read()[..., 3] > 0.5)

    def measure(self, renderer: Renderer, camera: Camera, time_s: float, truth: Truth) -> FrameAccuracy:
        """Draw one frame and compare it with the truth; consecutive calls since `restart` are consecutive frames."""
        frame = self.stage.frame(camera, self.size_px, time_s)
        self._positions.reverse()  # the last frame's stay at hand for popping
        self._errors.reverse()
        self._draw_positions(renderer, frame, self._positions[0])
        self.stage.measure_error(self._positions[0], self._errors[0], renderer.diagonal)
        data = self._errors[0].read()
        covered = data[..., 3] > 0.5
        popping = self._measure_popping(frame) if self._previous is not None else None
        self._previous = frame
        return FrameAccuracy(
            data[..., 0],
            data[..., 1],
            covered,
            count_holes(covered, truth.covered, renderer.settings.tolerance_px),
            silhouette_shift(covered, truth.covered),
            int((covered != truth.covered).sum()),
            popping,
        )

    def restart(self) -> None:
        """Forget the frame before: the next one pops from nothing."""
        self._previous = None

    def render_error(self, renderer: Renderer, camera: Camera) -> npt.NDArray[np.uint8]:
        """The error heat map of one view, (height, width, 3) uint8, row 0 at the top."""
        with drawn_by(self.stage, renderer):
            return self.stage.render(camera, self.size_px, "error")

    def release(self) -> None:
        """Release targets, passes and references."""
        for reference in self._references.values():
            reference.release()
        for target in (*self._positions, *self._errors, self._changes):
            target.release()
        self._popping_pass.release()

    def reference(self, diagonal: Diagonal) -> ReferenceRenderer:
        """The reference renderer of a diagonal rule, made at first use."""
        if diagonal not in self._references:
            settings = ReferenceRenderer.Settings()
            self._references[diagonal] = ReferenceRenderer(self.stage.gpu, self.stage.scene, settings, diagonal)
        return self._references[diagonal]

    def _draw_positions(self, renderer: Renderer, frame: Frame, target: Target | None = None) -> Target:
        target = self._changes if target is None else target
        with drawn_by(self.stage, renderer):
            self.stage.draw_output(replace(frame, output="position"), target)
        return target

    def _measure_popping(self, frame: Frame) -> npt.NDArray[np.float32]:
        previous = self._previous
        assert previous is not None
        with self._pass(self._changes):
            program = self._popping_pass.program("position")
            program["u_previous_clip_from_eye"] = tuple(previous.clip_from_eye.T.ravel())
            program["u_eye_shift_m"] = tuple(frame.eye_m - previous.eye_m)
            pairs = zip(self._positions, self._errors, strict=True)
            for unit, target in enumerate(target for pair in pairs for target in pair):
                target.texture.use(UNITS[f"u_extra{unit}"])
            self._popping_pass.render("position", vertices=3)
        data = self._changes.read()
        changes: npt.NDArray[np.float32] = data[..., 0][data[..., 3] > 0.5]
        return changes

    @contextmanager
    def _pass(self, target: Target) -> Iterator[None]:
        """A pass over all pixels of ``target``, reading the stage's textures as the last frame left them."""
        ctx = self.stage.gpu.ctx
        target.framebuffer.use()
        ctx.disable(moderngl.DEPTH_TEST)
        yield
        ctx.enable(moderngl.DEPTH_TEST)


@contextmanager
def drawn_by(stage: Stage, renderer: Renderer) -> Iterator[None]:
    """Let the stage draw with another renderer for a while."""
    own, stage.renderer = stage.renderer, renderer
    try:
        yield
    finally:
        stage.renderer = own


def count_holes(covered: Bools, truth: Bools, tolerance_px: float = 0.0) -> int:
    """Pixels that show sky although the reference shows terrain there and all around.

    Two kinds count: a gap that terrain encloses counts where the reference covers all eight neighbours too; a gap open
    to the sky, or to the picture's edge, past which there may be sky, counts where the reference covers everything
    within the promised error, since a method may lower the silhouette by as much.

    Parameters
    ----------
    covered, truth : ndarray of bool, (height, width)
        What the picture and the reference show.
    tolerance_px : float
        The promise; a quarter is added, and at least one pixel is granted.
    """
    missing = truth & ~covered
    if not (missing & _inner(truth, 1)).any():
        return 0
    from scipy import ndimage  # 160 ms to import, and the window starts with this module

    regions, _ = ndimage.label(~covered, np.ones((3, 3)))
    is_open = np.zeros(regions.max() + 1, np.bool_)
    is_open[np.unique(regions[~truth])] = True
    for edge in (regions[0], regions[-1], regions[:, 0], regions[:, -1]):
        is_open[np.unique(edge)] = True
    enclosed = missing & ~is_open[regions] & _inner(truth, 1)
    slits = missing & is_open[regions] & _inner(truth, max(1, math.ceil(1.25 * tolerance_px)))
    return int((enclosed | slits).sum())


def _inner(mask: Bools, reach_px: int) -> Bools:
    """Pixels all of whose neighbours within ``reach_px`` are set; past the picture's edge nothing is."""
    from scipy import ndimage

    size = 2 * reach_px + 1
    return np.asarray(ndimage.minimum_filter(mask.astype(np.uint8), size, mode="constant", cval=0), np.bool_)


def silhouette_shift(covered: Bools, truth: Bools) -> npt.NDArray[np.float32]:
    """Vertical shift [px] of the horizon per column, for columns where both show sky above terrain."""
    rows = [np.argmax(mask, axis=0) for mask in (covered, truth)]
    has = covered.any(axis=0) & truth.any(axis=0) & ~truth[0]
    shift: npt.NDArray[np.float32] = np.abs(rows[0] - rows[1])[has].astype(np.float32)
    return shift


def geometric_error_px(
    world_m: Floats, camera: Camera, viewport_height_px: int, terrain: Heightfield, diagonal: Diagonal = "alternating"
) -> Floats:
    """Signed geometric error of world positions, in float64: the oracle of the GPU's figures.

    Parameters
    ----------
    world_m : ndarray of float64, (..., 3)
        Drawn points; NaN where there is sky.
    camera : Camera
    viewport_height_px : int
    terrain : Heightfield
    diagonal : {"alternating", "uniform"}

    Returns
    -------
    ndarray of float64, (...)
        K * delta * n_y / l in pixels, positive above the surface; NaN where there is sky or no terrain.
    """
    x, y, z = np.moveaxis(np.asarray(world_m, np.float64), -1, 0)
    dx, dz = terrain.spacing_m
    delta = y - terrain.heights_at(x, z, diagonal)
    c = np.clip(np.nan_to_num(np.floor(x / dx)), 0, terrain.cols - 2).astype(np.int64)
    r = np.clip(np.nan_to_num(np.floor(z / dz)), 0, terrain.rows - 2).astype(np.int64)
    u, v = x / dx - c, z / dz - r
    h = terrain.heights_m
    nw, ne, sw, se = (h[r + i, c + j].astype(np.float64) for i in (0, 1) for j in (0, 1))
    nw_se = ((r + c) % 2 == 0) if diagonal == "alternating" else np.zeros(r.shape, np.bool_)
    north = np.where(nw_se, u >= v, u + v <= 1)
    east_rise = np.where(north, ne - nw, se - sw)
    south_rise = np.where(nw_se == north, se - ne, sw - nw)
    normal_y = 1.0 / np.sqrt(1.0 + (east_rise / dx) ** 2 + (south_rise / dz) ** 2)
    distance = np.linalg.norm(world_m - camera.eye_m, axis=-1)
    return camera.pixels_per_radian(viewport_height_px) * delta * normal_y / distance
