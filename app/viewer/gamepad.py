"""A gamepad as hands: what GLFW says about its sticks and buttons, as inputs and acts. Pure but for the reading.

Sticks rest nowhere exactly: below the dead zone they count as still, above it they begin at nothing. The square of the
way beyond gives fine control near the middle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from app.flying.controls import Inputs
from app.session.session import Session

DEAD_ZONE = 0.15
TRIGGER_DEAD_ZONE = 0.05

# GLFW's order of a gamepad's buttons and axes.
A, B, X, Y, LEFT_BUMPER, RIGHT_BUMPER, BACK, START = range(8)
UP, DOWN = 11, 13  # of the cross
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_TRIGGER, RIGHT_TRIGGER = range(6)


class Pad(NamedTuple):
    """The state of a gamepad: buttons held, and axes from -1 to 1 (sticks down and right, triggers pressed: 1)."""

    buttons: tuple[bool, ...] = (False,) * 15
    axes: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, -1.0, -1.0)


class PadAct(NamedTuple):
    """A button, its name, what it does in words, and the act."""

    button: int
    name: str
    help: str
    act: Callable[[Session], None]


STICKS_HELP: tuple[tuple[str, str], ...] = (
    ("left, right stick", "fly, orbit or walk; look around"),
    ("triggers", "up, down"),
    ("right bumper", "four times as fast"),
    ("cross", "faster, slower"),
)
ACTS: tuple[PadAct, ...] = (
    PadAct(A, "A", "fly to the picked point", lambda session: session.survey.fly_to_point()),
    PadAct(B, "B", "pick the middle of the picture", lambda session: session.survey.pick_middle()),
    PadAct(X, "X", "let the ground stop you, or not", lambda session: session.navigation.toggle_collision()),
    PadAct(Y, "Y", "fly, orbit or walk: the next", lambda session: session.navigation.next_mode()),
    PadAct(LEFT_BUMPER, "left bumper", "fly to the next bookmark", lambda session: session.places.visit_next()),
    PadAct(BACK, "back", "show or hide the help", lambda session: session.layout.toggle_help()),
    PadAct(START, "start", "frame the whole terrain", Session.frame_all),
)


class Gamepad:
    """The gamepad of a window, if there is one.

    Parameters
    ----------
    glfw : module
        GLFW, or what answers as it does.

    Attributes
    ----------
    pad : Pad or None
        What was read last.
    """

    def __init__(self, glfw: Any) -> None:
        self._glfw = glfw
        self.pad: Pad | None = None

    def take(self, session: Session, inputs: Inputs) -> Inputs:
        """Do what the buttons ask for, and add the sticks to the inputs of one frame."""
        before, self.pad = self.pad, read_pad(self._glfw)
        session.navigation.has_gamepad = self.pad is not None
        if self.pad is None or not inputs.focused:
            return inputs
        for act in ACTS:
            if is_pressed(self.pad, before, act.button):
                act.act(session)
        return with_pad(inputs, self.pad, before)


def read_pad(glfw: Any) -> Pad | None:
    """The first gamepad that GLFW knows how to read; None where there is none."""
    for number in range(glfw.JOYSTICK_1, glfw.JOYSTICK_LAST + 1):
        if glfw.joystick_is_gamepad(number) and (state := glfw.get_gamepad_state(number)) is not None:
            return Pad(tuple(bool(button) for button in state.buttons), tuple(float(axis) for axis in state.axes))
    return None


def with_pad(inputs: Inputs, pad: Pad, before: Pad | None = None) -> Inputs:
    """Inputs with those of a gamepad added; the state before tells what has just been pressed."""
    right, down = stick(pad.axes[LEFT_X], pad.axes[LEFT_Y])
    turn, dip = stick(pad.axes[RIGHT_X], pad.axes[RIGHT_Y])
    up = trigger(pad.axes[RIGHT_TRIGGER]) - trigger(pad.axes[LEFT_TRIGGER])
    notches = is_pressed(pad, before, UP) - is_pressed(pad, before, DOWN)
    return replace(
        inputs,
        forward=_both(inputs.forward, -down), right=_both(inputs.right, right), up=_both(inputs.up, up),
        turn=_both(inputs.turn, turn), tilt=_both(inputs.tilt, -dip),
        fast=inputs.fast or pad.buttons[RIGHT_BUMPER], wheel=inputs.wheel + notches,
    )  # fmt: skip


def stick(x: float, y: float) -> tuple[float, float]:
    """A stick's push in each direction, its length from 0 to 1, without what lies in the dead zone."""
    length = math.hypot(x, y)
    if not math.isfinite(length) or length <= DEAD_ZONE:
        return 0.0, 0.0
    push = min((length - DEAD_ZONE) / (1.0 - DEAD_ZONE), 1.0) ** 2
    return x / length * push, y / length * push


def trigger(value: float) -> float:
    """A trigger's push from 0 to 1, from GLFW's -1 to 1."""
    share = 0.5 * (value + 1.0) if math.isfinite(value) else 0.0
    return min(max((share - TRIGGER_DEAD_ZONE) / (1.0 - TRIGGER_DEAD_ZONE), 0.0), 1.0)


def is_pressed(pad: Pad, before: Pad | None, button: int) -> bool:
    """Whether a button went down since the state before."""
    return pad.buttons[button] and not (before or Pad()).buttons[button]


def _both(one: float, other: float) -> float:
    return min(max(one + other, -1.0), 1.0)


def pad_help() -> list[tuple[str, str]]:
    """All that a gamepad does, for the help."""
    return [*STICKS_HELP, *((f"pad {act.name}", act.help) for act in ACTS)]
