"""What the hands do, and free flight: pure functions. `app.flying.cameras` holds the other ways to move.

A held key asks for a velocity; the velocity follows it with a short exponential response, integrated exactly, so that
the path does not depend on the frame rate. The speed is proportional to the height above the ground: one crosses a
continent and lands on a boulder with the same keys.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera

RESPONSE_PER_S = 12.0  # the velocity covers 63 % of a change in 1/12 s: smooth, yet it does not drift
LONGEST_STEP_S = 1.0 / 120.0  # the speed follows the height above ground in steps no longer than this
LONGEST_FRAME_S = 0.25  # after a stall one goes on from where one was, instead of jumping
FASTER = 4.0
PITCH_LIMIT_DEG = 89.0
LOOK_DEG_PER_PX = 0.2  # at a field of view of 60 degrees
LOOK_DEG_PER_S = 60.0  # the same, for keys and sticks
WHEEL_FACTOR = 1.25
SPEED_FACTORS = (0.02, 50.0)

Floats = npt.NDArray[np.float64]
Button = Literal["left", "right", "middle"]
Clearance = Callable[[float, float, float], float]
"""``clearance(x, y, z)``: height of a position above the ground in metres; finite everywhere."""


@dataclass(frozen=True)
class Inputs:
    """What the hands do during one frame.

    Attributes
    ----------
    forward, right, up : float
        -1 to 1 each: which of two opposite keys is held, or how far a stick is pushed.
    fast : bool
    look_px : tuple of float
        Mouse travel with a button held on the scene: right and down are positive.
    wheel : float
        Notches, away from the user positive.
    focused : bool
        False where the window has lost the keyboard: all motion stops at once.
    turn, tilt : float
        -1 to 1 each: looking right and up with keys or a stick.
    button : {"left", "right", "middle"} or None
        The button held on the scene.
    pointer : tuple of 2 float, or None
        Where the mouse points to, as shares of the picture from its left and top; None beside the scene.
    clicked, double_clicked : bool
        Whether the left button was let go where it was pressed, and pressed a second time there.
    """

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    fast: bool = False
    look_px: tuple[float, float] = (0.0, 0.0)
    wheel: float = 0.0
    focused: bool = True
    turn: float = 0.0
    tilt: float = 0.0
    button: Button | None = None
    pointer: tuple[float, float] | None = None
    clicked: bool = False
    double_clicked: bool = False

    @property
    def pushes(self) -> bool:
        """Whether a key is held or a stick pushed."""
        return any((self.forward, self.right, self.up, self.turn, self.tilt))

    @property
    def moves(self) -> bool:
        """Whether anything here asks for motion (the wheel alone does not)."""
        return self.focused and (self.pushes or any(self.look_px) or self.double_clicked)


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
    if not any(look_px):
        return camera
    return turned(camera, LOOK_DEG_PER_PX * look_px[0], -LOOK_DEG_PER_PX * look_px[1])


def turned(camera: Camera, right_deg: float, up_deg: float) -> Camera:
    """The camera turned on the spot, by angles that count at a field of view of 60 degrees."""
    scale = camera.fov_deg / 60.0
    pitch = min(max(camera.pitch_deg + scale * up_deg, -PITCH_LIMIT_DEG), PITCH_LIMIT_DEG)
    return replace(camera, yaw_deg=(camera.yaw_deg + scale * right_deg) % 360.0, pitch_deg=pitch)


def steered(camera: Camera, inputs: Inputs, dt_s: float) -> Camera:
    """The camera turned on the spot by keys and sticks."""
    return turned(camera, LOOK_DEG_PER_S * inputs.turn * dt_s, LOOK_DEG_PER_S * inputs.tilt * dt_s)


def paced(motion: Motion, wheel: float) -> Motion:
    """The motion at the pace that the wheel asks for."""
    factor = motion.speed_factor * WHEEL_FACTOR ** min(max(wheel, -100.0), 100.0)
    return replace(motion, speed_factor=min(max(factor, SPEED_FACTORS[0]), SPEED_FACTORS[1]))


def respond(velocity: Floats, goal: Floats, dt_s: float) -> tuple[Floats, Floats]:
    """How far one comes with a velocity that approaches its goal exponentially (exact), and its new value."""
    decay = math.exp(-RESPONSE_PER_S * dt_s)
    travel = goal * dt_s + (velocity - goal) * (1.0 - decay) / RESPONSE_PER_S
    velocity = goal + (velocity - goal) * decay
    return travel, velocity if goal.any() or np.linalg.norm(velocity) >= 1e-3 else np.zeros(3)


def move(
    camera: Camera,
    motion: Motion,
    inputs: Inputs,
    dt_s: float,
    clearance: Clearance,
    least_m: float,
    collides: bool = True,
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
    collides : bool
        Whether the ground stops the eye; without, one may dive below it.

    Returns
    -------
    camera, motion
    """
    motion = paced(motion, inputs.wheel)
    if not inputs.focused:
        return camera, replace(motion, velocity=(0.0, 0.0, 0.0))
    camera = look(camera, inputs.look_px)
    dt_s = min(max(dt_s, 0.0), LONGEST_FRAME_S)
    if dt_s == 0.0 or not (inputs.pushes or any(motion.velocity)):
        return camera, motion

    position, velocity, goal = camera.eye_m, np.array(motion.velocity), _goal(camera, inputs)
    steps = math.ceil(dt_s / LONGEST_STEP_S)
    for _ in range(steps):
        if inputs.turn or inputs.tilt:
            camera = steered(camera, inputs, dt_s / steps)
            goal = _goal(camera, inputs)
        travel, velocity = respond(velocity, goal, dt_s / steps)
        position = position + speed_m_s(clearance(*position), least_m, motion.speed_factor) * travel
        if collides:
            position[1] += max(least_m - clearance(*position), 0.0)
    return replace(camera, position_m=triple(position)), replace(motion, velocity=triple(velocity))


def _goal(camera: Camera, inputs: Inputs) -> Floats:
    """The velocity (3,) the held keys ask for: along the sight line, sideways level, up along the vertical."""
    yaw = math.radians(camera.yaw_deg)
    right = np.array([math.cos(yaw), 0.0, math.sin(yaw)])
    wish = inputs.forward * camera.forward + inputs.right * right + inputs.up * np.array([0.0, 1.0, 0.0])
    return as_velocity(wish, math.hypot(inputs.forward, inputs.right, inputs.up), inputs.fast)


def as_velocity(wish: Floats, push: float, fast: bool) -> Floats:
    """The velocity (3,) along ``wish``: one speed for all keys, less where a stick is pushed less."""
    length = float(np.linalg.norm(wish))
    if length < 1e-9:
        return np.zeros(3)
    return wish / length * min(push, 1.0) * (FASTER if fast else 1.0)


def triple(vector: Floats) -> tuple[float, float, float]:
    """A vector (3,) as plain numbers."""
    return float(vector[0]), float(vector[1]), float(vector[2])
