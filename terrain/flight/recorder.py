"""From what was flown to a flight: the fewest keyframes found whose splines stay within a tolerance of every sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.flight.path import Flight, Keyframe, make_flight
from terrain.heightfield import Heightfield


class FlightRecorder:
    """Takes samples while one flies and makes a flight of them.

    Parameters
    ----------
    heightfield : Heightfield
        Where it is flown.
    tolerance_m : float, optional
        Largest distance of the flight from a sample; without it 0.5 % of the post spacing.
    tolerance_deg : float
        Largest turn from a sample's orientation, and largest difference of fields of view.
    """

    def __init__(self, heightfield: Heightfield, tolerance_m: float | None = None, tolerance_deg: float = 0.1) -> None:
        self.heightfield = heightfield
        self.tolerance_m = 0.005 * min(heightfield.spacing_m) if tolerance_m is None else tolerance_m
        self.tolerance_deg = tolerance_deg
        self._samples: list[Keyframe] = []

    def add(self, t_s: float, camera: Camera) -> None:
        """Take a sample on any clock that does not run backwards; of two at the same time the later one counts."""
        if self._samples and t_s <= self._samples[-1].t_s:
            self._samples[-1] = Keyframe(self._samples[-1].t_s, camera)
        else:
            self._samples.append(Keyframe(t_s, camera))

    def finish(self, name: str = "recorded") -> Flight:
        """The flight, from time 0.

        Raises
        ------
        ValueError
            If there is no sample.
        """
        if not self._samples:
            raise ValueError("expected at least one sample before the end of a recording, found none")
        flown = make_flight(rebased(self._samples), name, self.heightfield)
        return reduce_flight(flown, self.tolerance_m, self.tolerance_deg)


def rebased(samples: Sequence[Keyframe]) -> tuple[Keyframe, ...]:
    """The same samples, the first at time 0."""
    return tuple(Keyframe(sample.t_s - samples[0].t_s, sample.camera) for sample in samples)


def reduce_flight(flown: Flight, tolerance_m: float, tolerance_deg: float) -> Flight:
    """The flight with the fewest of its keyframes found that stays within the tolerances of all of them."""
    keys = flown.keyframes
    times = np.array([key.t_s for key in keys])
    kept = np.zeros(times.size, np.bool_)
    kept[[0, -1]] = True
    while True:
        flight = replace(flown, keyframes=tuple(keys[i] for i in np.flatnonzero(kept)))
        distance_m, angle_deg, fov_deg = flight.differences(flown, times)
        excess = np.maximum(distance_m / tolerance_m, np.maximum(angle_deg, fov_deg) / tolerance_deg)
        worst = _worst_between(kept, np.where(kept, 0.0, excess))
        if not worst.size:
            return flight
        kept[worst] = True


def _worst_between(kept: npt.NDArray[np.bool_], excess: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """For each stretch between kept samples the index of the one with the largest excess, where that is above 1."""
    stretch = np.cumsum(kept)
    order = np.lexsort((excess, stretch))
    last = order[np.r_[np.diff(stretch[order]) > 0, True]]
    return last[excess[last] > 1.0]
