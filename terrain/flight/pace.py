"""At what pace a flight is played: as its keyframes are timed, at constant speed, or starting and ending softly.

A pace maps the time of playback to a time of the flight; the way and the duration stay the same. It is a pure function,
so that preview, film and picture show the same at equal times, whatever the frame rate.

Speed counts turns as well as metres (`Flight.way`): a camera that only turns is not skipped.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from terrain.flight.path import Flight

Pace = Literal["timed", "constant", "eased"]
PACES: dict[Pace, str] = {
    "timed": "As the keyframes are timed.",
    "constant": "At the same speed all the way.",
    "eased": "At the same speed, with a soft start and a soft end.",
}
_EASE = 0.2  # share of the time in which the speed rises, and in which it falls
_TOP = 1.0 / (1.0 - _EASE)  # the speed between, so that all of the way is covered


def flight_time(flight: Flight, pace: Pace, played_s: float) -> float:
    """The time of the flight shown ``played_s`` seconds into its playback [s]."""
    duration_s = flight.duration_s
    if pace == "timed" or duration_s <= 0.0:
        return played_s
    share = min(max(played_s / duration_s, 0.0), 1.0)
    if pace == "eased":
        share = eased(share)
    times, way = flight.way
    if way[-1] <= 0.0:  # nothing moves
        return share * duration_s
    return float(np.interp(share * way[-1], way, times))


def played_times(flight: Flight, pace: Pace, times_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The inverse of `flight_time`: when moments of the flight are shown [s]."""
    times, duration_s = np.asarray(times_s, np.float64), flight.duration_s
    if pace == "timed" or duration_s <= 0.0:
        return times
    at, way = flight.way
    share = np.interp(times, at, way) / way[-1] if way[-1] > 0.0 else times / duration_s
    if pace == "eased":
        share = _uneased(share)
    return np.asarray(share * duration_s)


def eased(share: float) -> float:
    """Share of the way at a share of the time: the speed rises and falls linearly over `_EASE` of the time."""
    if share < _EASE:
        return 0.5 * _TOP / _EASE * share * share
    if share > 1.0 - _EASE:
        return 1.0 - eased(1.0 - share)
    return _TOP * (share - 0.5 * _EASE)


def _uneased(share: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The inverse of `eased`."""
    nearer = np.clip(np.minimum(share, 1.0 - share), 0.0, 1.0)  # the second half is the first turned round
    time = np.where(nearer < 0.5 * _TOP * _EASE, np.sqrt(2.0 * _EASE / _TOP * nearer), nearer / _TOP + 0.5 * _EASE)
    return np.where(share > 0.5, 1.0 - time, time)
