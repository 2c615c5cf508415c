"""Ways to move other than free flight: orbit, walk, and the eased passage to another view. Pure functions.

Orbiting holds on to a point of the ground. Turned about and zoomed at, it keeps its direction in the view; pulled, it
stays below the mouse. Where the ground is in the way a step is shortened, never bent, so that this holds there too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from app.flying.controls import (
    FASTER,
    LONGEST_FRAME_S,
    Clearance,
    Inputs,
    Motion,
    as_velocity,
    look,
    paced,
    respond,
    steered,
    triple,
    turned,
)
from terrain.camera import Camera

Mode = Literal["fly", "orbit", "walk"]
EYE_HEIGHT_M = 1.7
WALK_REACH_M = 5.0  # one walks as fast as one flies this high: 3 m/s at first, more and less with the wheel
ORBIT_DEG_PER_S = 45.0
NEARER_PER_S = 1.0  # with keys the distance changes by a factor e in a second
SLIDE_PER_S = 0.5  # with keys the view moves aside by this share of the distance
NEARER_PER_NOTCH = math.log(1.25)
ZOOM_RESPONSE_PER_S = 15.0
LEVEL_SINE = 0.05  # a sight line within 3 degrees of the horizon grasps no point of a level plane
FREE_SHARE = 0.999  # of the least clearance: what rounding may take
PASSAGE_S = 1.8
APPROACH_SHARE = 0.25  # of the distance is left after an approach
APPROACH_PITCHES_DEG = (-20.0, -35.0, -50.0, -65.0, -80.0)

Floats = npt.NDArray[np.float64]
Ground = Callable[[float, float], float]
"""``ground(x, z)``: height of the surface [m], finite everywhere."""
IsFree = Callable[[Camera], bool]
"""Whether the eye may be where a camera has it."""


def sight_line(camera: Camera, pointer: tuple[float, float], aspect: float) -> Floats:
    """Unit vector (3,) from the eye through a place in the picture, given as shares from its left and top."""
    tangent = math.tan(math.radians(camera.fov_deg) / 2.0)
    view = np.array([(2.0 * pointer[0] - 1.0) * tangent * aspect, (1.0 - 2.0 * pointer[1]) * tangent, -1.0])
    return (view / np.linalg.norm(view)) @ camera.view_from_eye()


def pointer_at(camera: Camera, point_m: Floats, aspect: float) -> tuple[float, float] | None:
    """Where in the picture a point lies, as shares from its left and top; None behind the eye."""
    x, y, z = camera.view_from_eye() @ (point_m - camera.eye_m)
    if z >= 0.0:
        return None
    scale = -0.5 / (z * math.tan(math.radians(camera.fov_deg) / 2.0))
    return float(0.5 + x * scale / aspect), float(0.5 - y * scale)


def free_above(clearance: Clearance, least_m: float) -> IsFree:
    """What tells whether a camera is at least this far above the ground."""
    return lambda camera: clearance(*camera.position_m) >= FREE_SHARE * least_m


def lifted(camera: Camera, clearance: Clearance, least_m: float) -> Camera:
    """The camera raised to ``least_m`` above the ground where it is lower."""
    missing = least_m - clearance(*camera.position_m)
    return camera if missing <= 0.0 else _at(camera, camera.eye_m + np.array([0.0, missing, 0.0]))


# Orbit


def orbit(camera: Camera, pivot_m: Floats, look_px: tuple[float, float], is_free: IsFree) -> Camera:
    """The camera turned about a point by mouse travel: the near side of the scene goes along with the mouse."""
    return _about(camera, pivot_m, lambda x, y: look(camera, (x * look_px[0], y * look_px[1])), is_free)


def _about(camera: Camera, pivot_m: Floats, turn: Callable[[float, float], Camera], is_free: IsFree) -> Camera:
    """The camera turned about a point; ``turn(x, y)`` turns it on the spot by shares of what is wanted each way.

    Where the ground blocks the turn, the way that is still free is taken, as far as it is.
    """
    to_pivot = camera.view_from_eye() @ (pivot_m - camera.eye_m)

    def step(x: float, y: float) -> Camera:
        goal = turn(x, y)
        return _at(goal, pivot_m - goal.view_from_eye().T @ to_pivot)

    if is_free(goal := step(1.0, 1.0)):
        return goal
    ways = (_as_far_as(lambda share: step(share, 0.0), is_free), _as_far_as(lambda share: step(0.0, share), is_free))
    return max(ways, key=lambda way: float(np.linalg.norm(way.eye_m - camera.eye_m)))


def pan(camera: Camera, grasped_m: Floats, pointer: tuple[float, float], aspect: float, is_free: IsFree) -> Camera:
    """The camera moved until a grasped point lies below the mouse.

    The eye keeps its height, and the mouse cannot pull the point beyond the horizon; where the point lies too level for
    that, the eye moves in the plane of the picture instead.
    """
    line, reach = sight_line(camera, pointer, aspect), grasped_m - camera.eye_m
    if reach[1] < -LEVEL_SINE * np.linalg.norm(reach):
        line[1] = min(line[1], -LEVEL_SINE)
        length = reach[1] / line[1]
    else:
        length = (reach @ camera.forward) / (line @ camera.forward)
    return _moved(camera, grasped_m - length * line - camera.eye_m, is_free)


def zoom(camera: Camera, point_m: Floats, nearer: float, least_m: float, is_free: IsFree) -> Camera:
    """The camera with its distance to a point divided by ``exp(nearer)``, but no nearer than ``least_m``."""
    reach = camera.eye_m - point_m
    distance = float(np.linalg.norm(reach))
    factor = math.exp(min(max(-nearer, -50.0), 50.0))
    if factor < 1.0:
        factor = max(factor, min(least_m / max(distance, 1e-12), 1.0))
    return _moved(camera, (factor - 1.0) * reach, is_free)


def orbit_with_keys(
    camera: Camera, motion: Motion, inputs: Inputs, dt_s: float, pivot_m: Floats, least_m: float, is_free: IsFree
) -> tuple[Camera, Motion, Floats]:
    """One frame of orbiting with keys or sticks: about a point, to and from it, and aside together with it.

    Returns
    -------
    camera, motion
    pivot_m : ndarray of float64, (3,)
        Where the point is now.
    """
    dt_s = min(max(dt_s, 0.0), LONGEST_FRAME_S)
    goal = np.array([inputs.right, inputs.up, inputs.forward]) * (FASTER if inputs.fast else 1.0)
    (right, up, forward), velocity = respond(np.array(motion.velocity), goal, dt_s)
    if right or up:
        right_deg, up_deg = -ORBIT_DEG_PER_S * right, -ORBIT_DEG_PER_S * up
        camera = _about(camera, pivot_m, lambda x, y: turned(camera, x * right_deg, y * up_deg), is_free)
    if forward:
        camera = zoom(camera, pivot_m, NEARER_PER_S * forward, least_m, is_free)
    if inputs.turn or inputs.tilt:
        across, along = _level_axes(camera)
        distance = float(np.linalg.norm(pivot_m - camera.eye_m))
        shift = SLIDE_PER_S * distance * dt_s * (inputs.turn * across + inputs.tilt * along)
        before, camera = camera.eye_m, _moved(camera, shift, is_free)
        pivot_m = pivot_m + camera.eye_m - before
    return camera, replace(motion, velocity=triple(velocity)), pivot_m


# Walk


def walk(
    camera: Camera, motion: Motion, inputs: Inputs, dt_s: float, ground: Ground, eye_m: float,
    extent_m: tuple[float, float],
) -> tuple[Camera, Motion]:  # fmt: skip
    """One frame of walking: level steps along the heading, ``eye_m`` above the ground, never off the terrain."""
    motion = paced(motion, inputs.wheel)
    velocity = np.array(motion.velocity)
    if inputs.focused:
        dt_s = min(max(dt_s, 0.0), LONGEST_FRAME_S)
        camera = steered(look(camera, inputs.look_px), inputs, dt_s)
        across, along = _level_axes(camera)
        wish = inputs.forward * along + inputs.right * across
        goal = as_velocity(wish, math.hypot(inputs.forward, inputs.right), inputs.fast)
        travel, velocity = respond(velocity, goal, dt_s)
    else:
        travel = velocity = np.zeros(3)
    x, _, z = camera.eye_m + WALK_REACH_M * motion.speed_factor * travel
    x, z = min(max(x, 0.0), extent_m[0]), min(max(z, 0.0), extent_m[1])
    return _at(camera, np.array([x, ground(x, z) + eye_m, z])), replace(motion, velocity=triple(velocity))


def _level_axes(camera: Camera) -> tuple[Floats, Floats]:
    """Level unit vectors (3,) to the right and ahead."""
    yaw = math.radians(camera.yaw_deg)
    return np.array([math.cos(yaw), 0.0, math.sin(yaw)]), np.array([math.sin(yaw), 0.0, -math.cos(yaw)])


# To another view


@dataclass(frozen=True)
class Passage:
    """The way from one view to another, a function of time: soft at both ends, in an arc over what lies between."""

    start: Camera
    goal: Camera
    rise_m: float = 0.0
    duration_s: float = PASSAGE_S

    def camera_at(self, time_s: float) -> Camera:
        """The camera ``time_s`` after the start; the goal itself from the end on."""
        if time_s >= self.duration_s:
            return self.goal
        u = max(time_s, 0.0) / self.duration_s
        share = u**3 * (u * (6.0 * u - 15.0) + 10.0)
        start, goal = self.start, self.goal
        turn = (goal.yaw_deg - start.yaw_deg + 180.0) % 360.0 - 180.0

        def between(a: float, b: float) -> float:
            return a + (b - a) * share

        return Camera(
            triple(_on_arc(start.eye_m, goal.eye_m, share, self.rise_m)),
            (start.yaw_deg + turn * share) % 360.0,
            between(start.pitch_deg, goal.pitch_deg),
            between(start.roll_deg, goal.roll_deg),
            between(start.fov_deg, goal.fov_deg),
        )


def plan_passage(start: Camera, goal: Camera, clearance: Clearance, least_m: float) -> Passage:
    """The passage whose arc is as flat as the ground between the two views allows."""
    rise_m = 0.0
    for share in np.arange(1, 64) / 64.0:
        missing = least_m - clearance(*_on_arc(start.eye_m, goal.eye_m, share, 0.0))
        rise_m = max(rise_m, missing / _arc(share))
    return Passage(start, goal, rise_m)


def _on_arc(start_m: Floats, goal_m: Floats, share: float, rise_m: float) -> Floats:
    return start_m + (goal_m - start_m) * share + np.array([0.0, rise_m * _arc(share), 0.0])


def _arc(share: float) -> float:
    """A half circle: steep at both ends, where the ground may be near."""
    return math.sqrt(max(4.0 * share * (1.0 - share), 0.0))


def approach(camera: Camera, point_m: Floats, clearance: Clearance, least_m: float) -> Camera:
    """A view of a point from a quarter of the distance, from the same side, and from as far above as is free."""
    reach = point_m - camera.eye_m
    level = math.hypot(reach[0], reach[2])
    yaw = math.degrees(math.atan2(reach[0], -reach[2])) % 360.0 if level > 1e-9 else camera.yaw_deg
    distance = max(APPROACH_SHARE * float(np.linalg.norm(reach)), 8.0 * least_m)
    steepest = math.degrees(math.atan2(reach[1], level))
    for pitch in (max(steepest, APPROACH_PITCHES_DEG[-1]), *APPROACH_PITCHES_DEG):
        goal = replace(camera, yaw_deg=yaw, pitch_deg=min(pitch, APPROACH_PITCHES_DEG[0]), roll_deg=0.0)
        goal = _at(goal, point_m - distance * goal.forward)
        if clearance(*goal.position_m) >= least_m:
            return goal
    return lifted(goal, clearance, least_m)


def _moved(camera: Camera, shift_m: Floats, is_free: IsFree) -> Camera:
    """The camera after as much of a shift as is free."""
    return _as_far_as(lambda share: _at(camera, camera.eye_m + share * shift_m), is_free)


def _as_far_as(step: Callable[[float], Camera], is_free: IsFree) -> Camera:
    """``step(1)`` where that is free, else ``step`` of a share near the first that is not; ``step(0)`` is free."""
    if is_free(goal := step(1.0)):
        return goal
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_free(step(middle)) else (low, middle)
    return step(low)


def _at(camera: Camera, position_m: Floats) -> Camera:
    return replace(camera, position_m=triple(position_m))
