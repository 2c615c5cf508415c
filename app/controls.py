"""Input to camera motion: pure functions, no window, no ImGui.

A held key asks for a velocity; the velocity follows it with a short exponential response, integrated exactly, so that
the path does not depend on the frame rate. The speed is proportional to the height above the ground: one crosses a
continent and lands on a boulder with the same keys.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera

RESPONSE_PER_S = 12.0  # the velocity covers 63 % of a change in 1/12 s: smooth, yet it does not drift
LONGEST_STEP_S = 1.0 / 120.0  # the speed follows the height above ground in steps no longer than this
LONGEST_FRAME_S = 0.25  # after a stall one goes on from where one was, instead of jumping
FASTER = 4.0
PITCH_LIMIT_DEG = 89.0
LOOK_DEG_PER_PX = 0.2  # at a field of view of 60 degrees
WHEEL_FACTOR = 1.25
SPEED_FACTORS = (0.02, 50.0)

Floats = npt.NDArray[np.float64]
Clearance = Callable[[float, float, float], float]
"""``clearance(x, y, z)``: height of a position above the ground in metres; finite everywhere."""


@dataclass(frozen=True)
class Inputs:
    """What the hands do during one frame.

    Attributes
    ----------
    forward, right, up : float
        -1, 0 or 1 each: which of two opposite keys is held.
    fast : bool
    look_px : tuple of float
        Mouse travel with the button held: right and down are positive.
    wheel : float
        Notches, away from the user positive.
    focused : bool
        False where the window has lost the keyboard: all motion stops at once.
    """

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    fast: bool = False
    look_px: tuple[float, float] = (0.0, 0.0)
    wheel: float = 0.0
    focused: bool = True

    @property
    def moves(self) -> bool:
        """Whether anything here asks for motion (the wheel alone does not)."""
        return self.focused and (any((self.forward, self.right, self.up)) or self.look_px != (0.0, 0.0))


@dataclass(frozen=True)
class Motion:
    """What outlives a frame: the velocity in units of the current speed, and the pace chosen with the wheel [1/s]."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    speed_factor: float = 0.6

    @property
    def at_rest(self) -> bool:
        return self.velocity == (0.0, 0.0, 0.0)


def speed_m_s(clearance_m: float, least_m: float, factor: float) -> float:
    """Speed at a height above ground: ``factor`` times it, never less than for ``least_m``."""
    return factor * max(abs(clearance_m), least_m)


def look(camera: Camera, look_px: tuple[float, float]) -> Camera:
    """The camera turned by mouse travel: right turns right, down looks down; slower when zoomed in."""
    scale = LOOK_DEG_PER_PX * camera.fov_deg / 60.0
    yaw = (camera.yaw_deg + scale * look_px[0]) % 360.0
    pitch = min(max(camera.pitch_deg - scale * look_px[1], -PITCH_LIMIT_DEG), PITCH_LIMIT_DEG)
    return replace(camera, yaw_deg=yaw, pitch_deg=pitch)


def move(
    camera: Camera, motion: Motion, inputs: Inputs, dt_s: float, clearance: Clearance, least_m: float
) -> tuple[Camera, Motion]:
    """One frame of flight.

    Parameters
    ----------
    camera, motion, inputs
        The state, and what the hands do.
    dt_s : float
        Time since the last frame; nothing moves at 0, and a stall counts as `LONGEST_FRAME_S`.
    clearance : callable
        Height of a position above the ground [m].
    least_m : float
        The eye stays this far above the ground, and flies no slower than at this height.

    Returns
    -------
    camera, motion
    """
    notches = min(max(inputs.wheel, -100.0), 100.0)
    factor = min(max(motion.speed_factor * WHEEL_FACTOR**notches, SPEED_FACTORS[0]), SPEED_FACTORS[1])
    if not inputs.focused:
        return camera, Motion((0.0, 0.0, 0.0), factor)
    if inputs.look_px != (0.0, 0.0):
        camera = look(camera, inputs.look_px)
    goal = _goal(camera, inputs)
    velocity = np.array(motion.velocity)
    dt_s = min(max(dt_s, 0.0), LONGEST_FRAME_S)
    if dt_s == 0.0 or not (velocity.any() or goal.any()):
        return camera, Motion(motion.velocity, factor)

    steps = math.ceil(dt_s / LONGEST_STEP_S)
    step_s = dt_s / steps
    decay = math.exp(-RESPONSE_PER_S * step_s)
    position = camera.eye_m
    for _ in range(steps):
        speed = speed_m_s(clearance(*position), least_m, factor)
        # The exact integral of a velocity that approaches its goal exponentially.
        position = position + speed * (goal * step_s + (velocity - goal) * (1.0 - decay) / RESPONSE_PER_S)
        velocity = goal + (velocity - goal) * decay
        position[1] += max(least_m - clearance(*position), 0.0)
    if not goal.any() and np.linalg.norm(velocity) < 1e-3:
        velocity = np.zeros(3)
    return replace(camera, position_m=_triple(position)), Motion(_triple(velocity), factor)


def _goal(camera: Camera, inputs: Inputs) -> Floats:
    """The velocity (3,) the held keys ask for: along the sight line, sideways level, up along the vertical."""
    yaw = math.radians(camera.yaw_deg)
    right = np.array([math.cos(yaw), 0.0, math.sin(yaw)])
    wish = inputs.forward * camera.forward + inputs.right * right + inputs.up * np.array([0.0, 1.0, 0.0])
    length = float(np.linalg.norm(wish))
    if length < 1e-9:
        return np.zeros(3)
    return wish / length * (FASTER if inputs.fast else 1.0)


def _triple(vector: Floats) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
