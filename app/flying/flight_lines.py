"""The flight in the scene: the way flown, and at its keyframes the pyramids that the camera sees."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from terrain.flight import Flight
from terrain.frame import Frame
from terrain.stage import Stage
from terrain.views import frustum_segments

WAY_COLOUR = (1.0, 0.86, 0.35, 0.95)
KEY_COLOUR = (0.35, 0.70, 0.95, 0.75)
SELECTED_COLOUR = (1.0, 0.55, 0.15, 1.0)
WAY_PX, KEY_PX, SELECTED_PX = 2.0, 1.2, 2.2
POINTS_PER_SEGMENT, MOST_POINTS = 24, 4000
MOST_PYRAMIDS = 24
# How deep a pyramid is drawn: as a share of the terrain's diagonal, and of the way between two of them, at most.
PYRAMID_SHARE, GAP_SHARE = 0.02, 0.6

Floats = npt.NDArray[np.float64]


class FlightLines:
    """What is drawn of a flight; found once for each flight."""

    def __init__(self) -> None:
        self._flight: Flight | None = None
        self._way_m: Floats = np.zeros((0, 2, 3))
        self._length_m = 0.0

    def draw(self, stage: Stage, frame: Frame, flight: Flight, selected: int | None) -> None:
        """Draw over the picture just drawn into the bound target."""
        if flight is not self._flight:
            self._flight, self._way_m = flight, way_segments(flight)
            self._length_m = float(np.linalg.norm(self._way_m[:, 1] - self._way_m[:, 0], axis=1).sum())
        keys = np.unique(np.linspace(0, len(flight.keyframes) - 1, MOST_PYRAMIDS).round().astype(int))
        depth_m = PYRAMID_SHARE * math.hypot(*stage.scene.heightfield.extent_m)
        if self._length_m > 0.0:
            depth_m = min(depth_m, GAP_SHARE * self._length_m / len(keys))
        stage.lines.draw(frame, self._way_m, WAY_COLOUR, WAY_PX)
        pyramids = [_pyramid(flight, i, frame, depth_m) for i in keys.tolist() if i != selected]
        stage.lines.draw(frame, np.concatenate([np.zeros((0, 2, 3)), *pyramids]), KEY_COLOUR, KEY_PX)
        if selected is not None:
            stage.lines.draw(frame, _pyramid(flight, selected, frame, depth_m), SELECTED_COLOUR, SELECTED_PX)


def way_segments(flight: Flight) -> Floats:
    """The way flown as segments (n, 2, 3) [m]; none across a cut."""
    keys = np.array([key.t_s for key in flight.keyframes])
    count = len(keys) - 1
    if count < 1:
        return np.zeros((0, 2, 3))
    points = max(2, min(POINTS_PER_SEGMENT, MOST_POINTS // count))
    times = np.linspace(keys[:-1], keys[1:], points + 1).T
    times[:, -1] = np.nextafter(times[:, -1], 0.0)  # before a cut, not after it
    position = flight.positions_at(times.ravel()).reshape(count, points + 1, 3)[np.diff(keys) > 0.0]
    return np.stack([position[:, :-1], position[:, 1:]], axis=2).reshape(-1, 2, 3)


def _pyramid(flight: Flight, index: int, frame: Frame, depth_m: float) -> Floats:
    """What the camera of a keyframe sees, ``depth_m`` deep; nothing where the eye is in it."""
    camera = flight.keyframes[index].camera
    if np.linalg.norm(camera.eye_m - frame.eye_m) < 0.5 * depth_m:
        return np.zeros((0, 2, 3))
    rays, _, far = np.split(frustum_segments(camera, frame.aspect, depth_m), 3)
    return np.concatenate([rays, far])
