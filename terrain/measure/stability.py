"""The stability check: every renderer on hostile scenes from hostile cameras, judged against the reference.

For each case: no GL error, no exception, no number that is none, no hole, nothing drawn that the reference hides, the
geometric error within the promise (p99.9 <= tolerance, maximum <= 1.25 tolerance), popping within what that promise
allows, the same picture twice, no frame far slower than the others. Then a seeded search climbs towards the camera with
the largest error.

What a renderer cannot do it declares in a class attribute ``limits``: a mapping from case patterns
(``"needles/along *"``) to a reason. Such a case is reported as a limit together with what was found, never left out.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.targets import create_target
from terrain.measure.accuracy import AccuracyMeter, Pool, Truth, count_holes, drawn_by
from terrain.measure.cost import time_frame
from terrain.measure.hidden import count_misplaced, has_edges, passes_below, shown_distances
from terrain.measure.hostile import FRAME_S, CameraPath, hostile_paths, nearby_camera, random_camera
from terrain.renderers import RENDERERS
from terrain.renderers.base import Renderer
from terrain.scene import Scene
from terrain.stage import Stage

Floats = npt.NDArray[np.float32]

SIZE_PX = (160, 120)
MAXIMUM_SHARE = 1.25  # single pixels may err by this times the tolerance
STILL_POPPING_PX = 0.01  # what rounding may change while the eye rests
SLOW_FACTOR, SLOW_MS = 10.0, 1000 / 60  # a frame is slow by comparison, and only where one can see it
TIMING_TRIES = 3
SEARCH_RANDOM, SEARCH_STEPS = 20, 30
_BREAKDOWNS = (ArithmeticError, LookupError, RuntimeWarning, TypeError, ValueError, moderngl.Error)


@dataclass(frozen=True)
class Verdict:
    """What one case came to.

    Attributes
    ----------
    algorithm, scene, case : str
    figures : mapping
        ``p999_px``, ``max_px``, ``popping_px``, ``holes_px``, ``misplaced_px``, ``frame_ms`` (median); what was not
        measured is absent.
    complaints : tuple of str
        What was found wrong, worst frame named; empty where all is well.
    limit : str or None
        Why the renderer says it cannot do better here.
    path : tuple of Camera
        The cameras of the case, a frame apart.
    worst : int
        The frame to look at.
    """

    algorithm: str
    scene: str
    case: str
    figures: Mapping[str, float]
    complaints: tuple[str, ...]
    limit: str | None
    path: CameraPath
    worst: int

    @property
    def outcome(self) -> str:
        """``ok``, ``limit`` (a documented one) or ``FAIL``."""
        return "ok" if not self.complaints else "FAIL" if self.limit is None else "limit"

    @property
    def line(self) -> str:
        """The case in one line."""
        told = "  ".join(f"{name} {self.figures[key]:{form}}" for name, key, form in _TOLD if key in self.figures)
        wrong = "; ".join(self.complaints) + (f" (limit: {self.limit})" if self.complaints and self.limit else "")
        return f"{self.outcome:5}  {self.algorithm}  {self.scene} / {self.case}: {told}" + (f"  {wrong}" * bool(wrong))


_TOLD = (
    ("p99.9", "p999_px", ".2f"), ("max", "max_px", ".2f"), ("popping", "popping_px", ".2f"),
    ("frame [ms]", "frame_ms", ".1f"),
)  # fmt: skip


@dataclass
class _Findings:
    """What the frames of one case showed so far."""

    error: Pool = field(default_factory=Pool)
    popping: Pool = field(default_factory=Pool)
    holes_px: int = 0
    misplaced_px: int = 0
    frame_ms: list[float] = field(default_factory=list)
    complaints: dict[str, str] = field(default_factory=dict)
    worst: int = 0
    score: float = -1.0

    def complain(self, kind: str, text: str, frame: int) -> None:
        """Keep the first complaint of a kind, and its frame where it is the first at all."""
        if not self.complaints:
            self.worst = frame
        self.complaints.setdefault(kind, f"{text} in frame {frame}")


class Checker:
    """Checks one algorithm on one scene.

    Parameters
    ----------
    gpu : Gpu
    scene : Scene
    algorithm : str
        A key of `terrain.renderers.RENDERERS`.
    settings : Settings or None
        None takes the algorithm's defaults.
    """

    def __init__(self, gpu: Gpu, scene: Scene, algorithm: str, settings: Any = None) -> None:
        self.algorithm = algorithm
        kind = RENDERERS[algorithm]
        self.settings = kind.Settings() if settings is None else settings
        self.tolerance_px: float = self.settings.tolerance_px
        self._limits: Mapping[str, str] = getattr(kind, "limits", {})
        self.stage = Stage(gpu, scene, "reference")
        self._meter = AccuracyMeter(self.stage, SIZE_PX)
        self._positions = create_target(gpu, SIZE_PX, "position")
        self._picture = create_target(gpu, SIZE_PX)

    def verdicts(self, seed: int = 0) -> Iterator[Verdict]:
        """Every hostile camera in turn, then the worst camera a search finds."""
        for case, path in hostile_paths(self.stage.scene.heightfield).items():
            yield self.check(case, path)
        yield self.check("worst found", (self.find_worst(seed),))

    def check(self, case: str, path: CameraPath) -> Verdict:
        """Judge one case."""
        found = _Findings()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                self._fly(path, found)
                self._time_again(path, found)
        except _BREAKDOWNS as error:
            found.complain("exception", f"raised {type(error).__name__}: {error}", found.worst)
        self._judge(path, found)
        figures: dict[str, float] = {"holes_px": found.holes_px, "misplaced_px": found.misplaced_px}
        if found.error.count:
            figures |= {"p999_px": found.error.percentile(99.9), "max_px": found.error.maximum}
        if found.popping.count:
            figures["popping_px"] = found.popping.maximum
        if found.frame_ms:
            figures["frame_ms"] = float(np.median(found.frame_ms))
        scene = self.stage.scene.heightfield.name
        reasons = [reason for p, reason in self._limits.items() if fnmatchcase(f"{scene}/{case}", p)]
        complaints = tuple(found.complaints.values())
        return Verdict(
            self.algorithm, scene, case, figures, complaints, reasons[0] if reasons else None, path, found.worst
        )

    def find_worst(self, seed: int = 0) -> Camera:
        """The camera with the largest error that random flights and hill climbing find."""
        rng = np.random.default_rng(seed)
        terrain = self.stage.scene.heightfield
        renderer = self._make()
        best, best_score = random_camera(terrain, rng), -1.0
        try:
            for step in range(SEARCH_RANDOM + SEARCH_STEPS):
                if step < SEARCH_RANDOM:
                    camera = random_camera(terrain, rng)
                else:  # the reach shrinks from a half to a hundredth
                    reach = 0.5 * 0.02 ** ((step - SEARCH_RANDOM) / SEARCH_STEPS)
                    camera = nearby_camera(terrain, best, reach, rng)
                score = self._score(renderer, camera)
                if score == math.inf:
                    return camera
                if score > best_score:
                    best, best_score = camera, score
        finally:
            renderer.release()
        return best

    def picture(self, verdict: Verdict) -> npt.NDArray[np.uint8] | None:
        """The worst frame (height, 3 width, 3) uint8: reference, test and error heat map; None if it breaks down."""
        renderer = self._make()
        reference = self._meter.reference(renderer.diagonal)
        camera, time_s = verdict.path[verdict.worst], verdict.worst * FRAME_S
        try:
            for i, earlier in enumerate(verdict.path[: verdict.worst]):  # what is drawn may depend on the frames before
                self._draw_picture(renderer, earlier, i * FRAME_S)
            parts = [self._draw_picture(who, camera, time_s) for who in (reference, renderer)]
            return np.concatenate([*parts, self._meter.render_error(renderer, camera)], axis=1)
        except _BREAKDOWNS:
            return None
        finally:
            renderer.release()

    def release(self) -> None:
        """Release everything made on the GPU."""
        for part in (self._meter, self._positions, self._picture, self.stage):
            part.release()

    def _make(self) -> Renderer:
        return RENDERERS[self.algorithm](self.stage.gpu, self.stage.scene, self.settings)

    def _fly(self, path: CameraPath, found: _Findings) -> None:
        """Draw and measure every frame of a case with a new renderer."""
        renderer = self._make()
        self._meter.restart()
        try:
            for i, camera in enumerate(path):
                self._look(renderer, camera, i, found)
        finally:
            renderer.release()

    def _look(self, renderer: Renderer, camera: Camera, number: int, found: _Findings) -> None:
        """One frame: time it, draw it twice, measure it."""
        time_s = number * FRAME_S
        pictures = []
        for repeat in range(2):
            cost = time_frame(self.stage, renderer, camera, time_s, self._picture)
            pictures.append(self._picture.read())
            if repeat == 0:
                found.frame_ms.append(cost["frame_ms"])
        if not np.array_equal(pictures[0], pictures[1]):
            found.complain("twice", f"{_differing(pictures[0], pictures[1])} pixels differ when drawn twice", number)
        score, kinds = self._measure(renderer, camera, time_s, found)
        for kind, text in kinds.items():
            found.complain(kind, text, number)
        error = self.stage.gpu.ctx.error
        if error != "GL_NO_ERROR":
            found.complain("gl", error, number)
        if not found.complaints and score > found.score:
            found.worst, found.score = number, score

    def _measure(
        self, renderer: Renderer, camera: Camera, time_s: float, found: _Findings
    ) -> tuple[float, dict[str, str]]:
        """Compare one frame with the truth; returns how bad it is (1: at the limit) and what is plainly wrong."""
        frame = self.stage.frame(camera, SIZE_PX, time_s)
        truth = self._draw_positions(self._meter.reference(renderer.diagonal), frame)
        drawn = self._draw_positions(renderer, frame)
        measured = self._meter.measure(renderer, camera, time_s, Truth(truth[..., 3] > 0.5))
        bad: dict[str, str] = {}
        if not np.isfinite(drawn).all():
            bad["finite"] = f"{int((~np.isfinite(drawn)).any(axis=-1).sum())} pixels are no number"
        terrain, largest_px = self.stage.scene.heightfield, MAXIMUM_SHARE * self.tolerance_px
        judged = ~passes_below(camera, SIZE_PX, terrain, renderer.diagonal, largest_px)
        shown_m, truth_m = (shown_distances(positions, judged) for positions in (drawn, truth))
        reach_px = math.ceil(largest_px) + 1
        misplaced = count_misplaced(shown_m, truth_m, reach_px, largest_px / frame.pixels_per_radian + 1e-3)
        # Where data are missing, a crest lowered by no more than promised may uncover sky.
        solid = ~has_edges(truth_m, reach_px) if terrain.holes is not None else np.isfinite(truth_m)
        holes = count_holes(np.isfinite(shown_m), solid, self.tolerance_px)
        if holes:
            bad["holes"] = f"{holes} pixels of holes"
        if misplaced:
            bad["misplaced"] = f"{misplaced} pixels show what the reference hides"
        error_px = np.nan_to_num(measured.error_px[measured.covered & judged], nan=math.inf)
        found.error.add(error_px)
        if measured.popping_px is not None:
            found.popping.add(measured.popping_px)
        found.holes_px += holes
        found.misplaced_px += misplaced
        return float(np.abs(error_px).max(initial=0.0)) / largest_px + holes + misplaced, bad

    def _score(self, renderer: Renderer, camera: Camera) -> float:
        """How bad one camera is: 1 at the limit; infinite where nothing could be drawn."""
        self._meter.restart()
        try:
            return self._measure(renderer, camera, 0.0, _Findings())[0]
        except _BREAKDOWNS:
            return math.inf

    def _judge(self, path: CameraPath, found: _Findings) -> None:
        """Add the complaints about a case as a whole."""
        largest_px = MAXIMUM_SHARE * self.tolerance_px
        if found.error.count:
            p999, maximum = found.error.percentile(99.9), found.error.maximum
            # Pooled percentiles resolve 1 %; of fewer pixels than that the one in a thousand is the maximum.
            if found.error.count >= 1000 and p999 > self.tolerance_px * 1.02:
                found.complaints["p999"] = f"p99.9 {p999:.2f} px exceeds {self.tolerance_px:g} px"
            if maximum > largest_px:
                found.complaints["max"] = f"error {maximum:.2f} px exceeds {largest_px:g} px"
        if found.popping.count:
            bound = STILL_POPPING_PX if len(set(path)) == 1 else 2 * largest_px
            if found.popping.maximum > bound:
                found.complaints["popping"] = f"popping {found.popping.maximum:.2f} px exceeds {bound:g} px"
        slow = _slow_frames(found.frame_ms)
        if slow:
            number = max(slow, key=lambda i: found.frame_ms[i])
            median = float(np.median(found.frame_ms))
            found.complain("slow", f"{found.frame_ms[number]:.0f} ms against a median of {median:.1f} ms", number)

    def _time_again(self, path: CameraPath, found: _Findings) -> None:
        """Fly once more where a frame was slow, and keep the shortest times: another program may have interfered."""
        for _ in range(TIMING_TRIES - 1):
            if not _slow_frames(found.frame_ms):
                return
            renderer = self._make()
            try:
                for i, camera in enumerate(path):
                    cost = time_frame(self.stage, renderer, camera, i * FRAME_S, self._picture)
                    found.frame_ms[i] = min(found.frame_ms[i], cost["frame_ms"])
            finally:
                renderer.release()

    def _draw_positions(self, renderer: Renderer, frame: Frame) -> Floats:
        """Positions relative to the eye (height, width, 4), row 0 at the top; w below 0.5 where there is sky."""
        with drawn_by(self.stage, renderer):
            self.stage.draw_output(replace(frame, output="position"), self._positions)
        return self._positions.read()

    def _draw_picture(self, renderer: Renderer, camera: Camera, time_s: float) -> npt.NDArray[np.uint8]:
        with drawn_by(self.stage, renderer):
            return self.stage.render(camera, SIZE_PX, time_s=time_s)


def check(
    gpu: Gpu, scenes: Sequence[Scene], algorithms: Sequence[str], seed: int = 0
) -> Iterator[tuple[Verdict, Checker]]:
    """Every case of every algorithm on every scene, with the checker that can draw it again until the next one."""
    for algorithm in algorithms:
        for scene in scenes:
            checker = Checker(gpu, scene, algorithm)
            try:
                for verdict in checker.verdicts(seed):
                    yield verdict, checker
            finally:
                checker.release()


def _slow_frames(frame_ms: Sequence[float]) -> list[int]:
    """Frames that took far longer than the median; the first makes what the others use, and does not count."""
    if len(frame_ms) < 4:
        return []
    median = float(np.median(frame_ms[1:]))
    return [i for i, ms in enumerate(frame_ms) if i and ms > SLOW_FACTOR * median and ms > SLOW_MS]


def _differing(a: npt.NDArray[np.uint8], b: npt.NDArray[np.uint8]) -> int:
    return int((a != b).any(axis=-1).sum())
