"""Keyframes and the camera between them: a pure function of time, the same at every frame rate.

**Source** Position: Catmull-Rom splines with centripetal knots (Yuksel, Schaefer and Keyser, *On the parameterization
of Catmull-Rom curves*, 2009): no cusp and no loop within a segment. Orientation: spherical interpolation of quaternions
(Shoemake, *Animating rotation with quaternion curves*, SIGGRAPH 1985), the shortest way.

**Deviations** How far along its curve the camera is follows time by a monotone cubic (Fritsch and Carlson, 1980), so
that speed has no jump at a keyframe and a repeated keyframe is a soft stop; the same for the angle turned and the field
of view. Two keyframes at the same time are a cut: nothing is blended across it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

_CUT_S = 1e-6  # keyframes closer in time than this are a cut
_FAR_M = 1e12  # beyond this, float64 squares and sums are no longer worth trusting
_WAY_SAMPLES = 64  # in every segment
_TURN_SHARE = 0.5  # of the flight's mean speed: how much way a turn of one radian a second counts


@dataclass(frozen=True)
class Keyframe:
    """A camera at a time in seconds."""

    t_s: float
    camera: Camera


@dataclass(frozen=True)
class Flight:
    """Keyframes in order of time.

    Attributes
    ----------
    keyframes : tuple of Keyframe
        One or more, times not decreasing; two at the same time are a cut.
    name : str
    terrain : str
        Name of the terrain it was made on.
    crs : str or None
        Coordinate system of ``origin``.
    origin : tuple of 2 float, or None
        Map coordinates (easting, northing) of that terrain's north-west post.

    Raises
    ------
    ValueError
        If there is no keyframe, a time is not finite, negative or earlier than the one before, or a position is
        absurdly far.
    """

    keyframes: tuple[Keyframe, ...]
    name: str = "flight"
    terrain: str = ""
    crs: str | None = None
    origin: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.keyframes:
            raise ValueError("expected at least one keyframe, found none")
        before = 0.0
        for number, key in enumerate(self.keyframes, 1):
            if not math.isfinite(key.t_s):
                raise ValueError(f"expected a finite time for keyframe {number}, found {key.t_s}")
            if key.t_s < before:
                raise ValueError(
                    f"expected times in order from 0 s, found {key.t_s} s after {before} s (keyframe {number})"
                )
            if max(map(abs, key.camera.position_m)) > _FAR_M:
                raise ValueError(f"expected positions within {_FAR_M:g} m, found {key.camera.position_m}")
            before = key.t_s

    @property
    def duration_s(self) -> float:
        """From the start of playback, time 0, to the last keyframe."""
        return self.keyframes[-1].t_s

    def camera_at(self, t_s: float) -> Camera:
        """The camera at a time; the first before the start, the last after the end.

        Raises
        ------
        ValueError
            If ``t_s`` is not finite.
        """
        if not math.isfinite(t_s):
            raise ValueError(f"expected a finite time, found {t_s}")
        position, quaternion, fov = (values[0] for values in self._track.sample(np.array([t_s])))
        yaw, pitch, roll = _angles_deg(quaternion)
        return Camera((float(position[0]), float(position[1]), float(position[2])), yaw, pitch, roll, float(fov))

    def positions_at(self, times_s: npt.ArrayLike) -> Floats:
        """Eye positions (n, 3) at many times."""
        return self._track.sample(np.asarray(times_s, np.float64))[0]

    def differences(self, other: Flight, times_s: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        """How far two flights are apart at the same times.

        Returns
        -------
        distance_m, angle_deg, fov_deg : ndarray of float64, (n,)
            Distance of the eyes, angle of the turn from one orientation to the other, difference of the fields of view.
        """
        times = np.asarray(times_s, np.float64)
        (here, quaternion, fov), (there, other_quaternion, other_fov) = (
            self._track.sample(times),
            other._track.sample(times),
        )
        angle = np.degrees(_turns_rad(quaternion, other_quaternion))
        return np.linalg.norm(here - there, axis=1), angle, np.abs(fov - other_fov)

    def relocated(self, heightfield: Heightfield) -> Flight:
        """The same flight over the same place of another terrain.

        Where both know their place in the same coordinate system, positions move by the distance between the two
        north-west posts; else the flight stays as it is.
        """
        place = heightfield.georeference
        if place is None or self.origin is None or self.crs != place.crs or self.origin == origin_of(heightfield):
            return self
        col, row = place.to_post(*self.origin)
        shift = (float(col) * heightfield.spacing_m[0], 0.0, float(row) * heightfield.spacing_m[1])
        keys = tuple(replace(key, camera=_moved(key.camera, shift)) for key in self.keyframes)
        return replace(self, keyframes=keys, terrain=heightfield.name, origin=origin_of(heightfield))

    @cached_property
    def way(self) -> tuple[Floats, Floats]:
        """Times (n,) from 0 to the end [s], and the way covered until each: metres, and turns counted as metres."""
        keys = np.r_[0.0, self._track.t]
        times = np.linspace(keys[:-1], keys[1:], _WAY_SAMPLES + 1).T  # (segments, samples)
        times[:, -1] = np.nextafter(times[:, -1], 0.0)  # before a cut, not after it
        position, quaternion, _ = self._track.sample(times.ravel())
        shape = (*times.shape, -1)
        step_m = np.linalg.norm(np.diff(position.reshape(shape), axis=1), axis=2)
        quaternion = quaternion.reshape(shape)
        turn_rad = _turns_rad(quaternion[:, :-1], quaternion[:, 1:])
        is_cut = np.diff(keys) < _CUT_S
        step_m[is_cut] = turn_rad[is_cut] = 0.0
        mean_m_s = step_m.sum() / max(self.duration_s, _CUT_S)
        weight_m = _TURN_SHARE * mean_m_s if mean_m_s > 0.0 else 1.0
        way = np.r_[0.0, np.cumsum((step_m + weight_m * turn_rad).ravel())]
        return np.r_[times[:, :-1].ravel(), keys[-1]], way

    @cached_property
    def _track(self) -> _Track:
        return _Track(self.keyframes)


def make_flight(keyframes: Sequence[Keyframe], name: str, heightfield: Heightfield) -> Flight:
    """A flight that knows the terrain it was made on."""
    place = heightfield.georeference
    crs = None if place is None else place.crs
    return Flight(tuple(keyframes), name, heightfield.name, crs, origin_of(heightfield))


def origin_of(heightfield: Heightfield) -> tuple[float, float] | None:
    """Map coordinates of the north-west post."""
    if heightfield.georeference is None:
        return None
    x, y = heightfield.georeference.to_map(0.0, 0.0)
    return float(x), float(y)


class _Track:
    """The keyframes' numbers as arrays, with the slopes of their curves."""

    def __init__(self, keys: tuple[Keyframe, ...]) -> None:
        cameras = [key.camera for key in keys]
        self.t = np.array([key.t_s for key in keys])
        self.position = np.array([camera.position_m for camera in cameras], np.float64)
        self.quaternion = _quaternions(np.array([(c.yaw_deg, c.pitch_deg, c.roll_deg) for c in cameras], np.float64))
        self.fov = np.array([camera.fov_deg for camera in cameras], np.float64)
        step = np.diff(self.t)
        self.is_cut = step < _CUT_S
        knot = np.sqrt(np.linalg.norm(np.diff(self.position, axis=0), axis=1))  # centripetal: the root of the chord
        self.leaving, self.arriving = _tangents(self.position, knot, self.is_cut)
        turn = _turns_rad(self.quaternion[:-1], self.quaternion[1:])
        self.curves = {
            name: (amount, _rates(step, amount, self.is_cut))
            for name, amount in (("knot", knot), ("turn", turn), ("fov", np.diff(self.fov)))
        }

    def sample(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions (n, 3), quaternions (n, 4) and fields of view (n,); times outside are those of the ends."""
        last = self.t.size - 1
        if last == 0:
            n = times_s.size
            return np.tile(self.position, (n, 1)), np.tile(self.quaternion, (n, 1)), np.tile(self.fov, n)
        times = np.clip(times_s, self.t[0], self.t[-1])
        i = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, last - 1)
        step = self.t[i + 1] - self.t[i]
        u = np.where(self.is_cut[i], times >= self.t[i + 1], (times - self.t[i]) / np.maximum(step, _CUT_S))
        p = self._share("knot", i, u, step)[:, None]
        position = (
            (1 + 2 * p) * (1 - p) ** 2 * self.position[i]
            + p**2 * (3 - 2 * p) * self.position[i + 1]
            + p * (1 - p) ** 2 * self.leaving[i]
            - p**2 * (1 - p) * self.arriving[i]
        )
        quaternion = _slerp(self.quaternion[i], self.quaternion[i + 1], self._share("turn", i, u, step))
        fov = self.fov[i] + (self.fov[i + 1] - self.fov[i]) * self._share("fov", i, u, step)
        return position, quaternion, fov

    def _share(self, curve: str, i: npt.NDArray[np.int64], u: Floats, step: Floats) -> Floats:
        """Share of segment ``i`` of a curve passed at the share ``u`` of its time: monotone from 0 to 1."""
        amount, rate = self.curves[curve]
        moves = amount[i] != 0.0
        scale = step / np.where(moves, amount[i], 1.0)
        first, second = np.where(moves, rate[i] * scale, 1.0), np.where(moves, rate[i + 1] * scale, 1.0)
        share = u**2 * (3 - 2 * u) + u * (1 - u) ** 2 * first - u**2 * (1 - u) * second
        return np.asarray(np.clip(share, 0.0, 1.0))


def _tangents(position: Floats, knot: Floats, is_cut: npt.NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Derivatives (n - 1, 3) of each segment's curve at its two ends, by its own knot interval scaled to 1.

    The neighbour of a segment is the next segment that moves, on the same side of any cut; where there is none, the
    curve ends as if its chord went on straight.
    """
    chords = np.diff(position, axis=0)
    leaving, arriving = chords.copy(), chords.copy()
    moving = np.flatnonzero((knot > 0.0) & ~is_cut)
    shot = np.cumsum(is_cut)[moving]
    i, j = moving[:-1][shot[:-1] == shot[1:]], moving[1:][shot[:-1] == shot[1:]]
    a, b = knot[i][:, None], knot[j][:, None]
    # Non-uniform Catmull-Rom: the velocity of each chord weighed by the other chord's knot interval.
    velocity = (chords[i] / a * b + chords[j] / b * a) / (a + b)
    arriving[i], leaving[j] = velocity * a, velocity * b
    return leaving, arriving


def _rates(step: Floats, amount: Floats, is_cut: npt.NDArray[np.bool_]) -> Floats:
    """Slopes (n,) at the keyframes of the monotone cubic through running sums of ``amount`` (Fritsch and Carlson)."""
    rate = np.zeros(step.size + 1)
    step = np.where(is_cut, 1.0, step)
    slope = np.where(is_cut, 0.0, amount / step)
    if not slope.size:
        return rate
    a, b, left, right = step[:-1], step[1:], slope[:-1], slope[1:]
    same = left * right > 0.0
    weigh_left, weigh_right = a + 2 * b, 2 * a + b
    with np.errstate(over="ignore"):  # one over next to nothing: a mean of 0
        both = weigh_left / np.where(same, left, 1.0) + weigh_right / np.where(same, right, 1.0)
    mean = (weigh_left + weigh_right) / both
    rate[1:-1] = np.where(same, mean, 0.0)
    rate[0], rate[-1] = slope[0], slope[-1]
    # Beside a cut there is no neighbour: the curve ends straight, as at the ends of the flight.
    after, before = np.flatnonzero(is_cut[:-1]) + 1, np.flatnonzero(is_cut[1:])
    rate[after], rate[before + 1] = slope[after], slope[before]
    return rate


def _quaternions(angles_deg: Floats) -> Floats:
    """Rotations (n, 4), (w, x, y, z), from view to world axes: roll about -z, then pitch about x, then yaw about -y."""
    half = np.radians(angles_deg.T) / 2.0
    (cy, cp, cr), (sy, sp, sr) = np.cos(half), np.sin(half)
    w, x, y, z = cy * cp, cy * sp, -sy * cp, sy * sp  # yaw (cy, 0, -sy, 0) times pitch (cp, sp, 0, 0)
    return np.stack([w * cr + z * sr, x * cr - y * sr, y * cr + x * sr, z * cr - w * sr], axis=1)


def _along(a: Floats, b: Floats) -> Floats:
    """``b`` or its antipode (the same rotation), whichever is nearer to ``a``."""
    return np.where(np.sum(a * b, axis=-1, keepdims=True) < 0.0, -b, b)


def _turns_rad(a: Floats, b: Floats) -> Floats:
    """Angles (n,) of the turns between rotations, 0 to pi."""
    half_chord = np.linalg.norm(_along(a, b) - a, axis=-1) / 2.0
    return np.asarray(4.0 * np.arcsin(np.minimum(half_chord, 1.0)))


def _slerp(a: Floats, b: Floats, u: Floats) -> Floats:
    """Quaternions (n, 4) at the share ``u`` of the shortest turn from ``a`` to ``b``."""
    b = _along(a, b)
    angle = _turns_rad(a, b) / 2.0
    sine = np.sin(angle)
    turns = sine > 1e-9  # below, the arc is its chord
    safe = np.where(turns, sine, 1.0)
    weigh_a = np.where(turns, np.sin((1.0 - u) * angle) / safe, 1.0 - u)
    weigh_b = np.where(turns, np.sin(u * angle) / safe, u)
    mixed = weigh_a[:, None] * a + weigh_b[:, None] * b
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


def _angles_deg(q: Floats) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a rotation; looking straight up or down, all of the turn is yaw."""
    w, x, y, z = (float(v) for v in q)
    right = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    up_y = 1 - 2 * (x * x + z * z)
    forward = (-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y)))
    level = math.hypot(forward[0], forward[2])
    pitch = math.degrees(math.atan2(forward[1], level))
    if level < 1e-9:
        return math.degrees(math.atan2(right[2], right[0])), pitch, 0.0
    return (
        math.degrees(math.atan2(forward[0], -forward[2])),
        pitch,
        math.degrees(math.atan2(-right[1], up_y)),
    )


def _moved(camera: Camera, shift_m: tuple[float, float, float]) -> Camera:
    x, y, z = (p + s for p, s in zip(camera.position_m, shift_m, strict=True))
    return replace(camera, position_m=(x, y, z))
