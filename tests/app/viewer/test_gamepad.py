"""A gamepad without hardware: sticks, dead zones, triggers and buttons as GLFW tells them."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.flying.controls import Inputs
from app.places.framing import FRAME_PITCH_DEG
from app.viewer.gamepad import ACTS, DEAD_ZONE, DOWN, RIGHT_BUMPER, UP, Gamepad, Pad, pad_help, stick, trigger, with_pad

AXES = ("LEFT_X", "LEFT_Y", "RIGHT_X", "RIGHT_Y", "LEFT_TRIGGER", "RIGHT_TRIGGER")  # in GLFW's order
axis = st.floats(-1.0, 1.0)
REST = Pad()


def pad_with(*pressed, **axes):
    values = list(REST.axes)
    for name, value in axes.items():
        values[AXES.index(name)] = value
    return Pad(tuple(number in pressed for number in range(15)), tuple(values))


class FakeGlfw:
    """GLFW with one gamepad, or none, in the second of its places."""

    JOYSTICK_1, JOYSTICK_LAST = 0, 15

    def __init__(self, pad=None):
        self.pad = pad

    def joystick_is_gamepad(self, number):
        return number == 1 and self.pad is not None

    def get_gamepad_state(self, number):
        return SimpleNamespace(buttons=[int(b) for b in self.pad.buttons], axes=list(self.pad.axes))


@given(axis, axis)
def test_sticks_keep_their_direction_and_rest_in_the_dead_zone(x, y):
    right, down = stick(x, y)
    length = math.hypot(x, y)
    assert math.hypot(right, down) <= 1.0 + 1e-12
    if length <= DEAD_ZONE:
        assert (right, down) == (0.0, 0.0)
    else:
        assert right * y == pytest.approx(down * x, abs=1e-9)
        assert right * x + down * y >= 0.0


def test_sticks_begin_at_nothing_and_end_at_everything():
    assert math.hypot(*stick(DEAD_ZONE + 1e-6, 0.0)) < 1e-9
    assert stick(0.0, -1.0) == (0.0, -1.0)
    assert stick(math.nan, 0.3) == (0.0, 0.0)


@given(axis)
def test_triggers_go_from_nothing_to_everything(value):
    assert 0.0 <= trigger(value) <= 1.0
    assert trigger(-1.0) == 0.0 == trigger(-0.95)
    assert trigger(1.0) == 1.0


@pytest.mark.parametrize(
    ("pad", "name", "value"),
    [
        (pad_with(LEFT_Y=-1.0), "forward", 1.0),
        (pad_with(LEFT_X=1.0), "right", 1.0),
        (pad_with(RIGHT_TRIGGER=1.0), "up", 1.0),
        (pad_with(LEFT_TRIGGER=1.0), "up", -1.0),
        (pad_with(RIGHT_X=1.0), "turn", 1.0),
        (pad_with(RIGHT_Y=1.0), "tilt", -1.0),
        (pad_with(RIGHT_BUMPER), "fast", True),
        (pad_with(UP), "wheel", 1.0),
        (pad_with(DOWN), "wheel", -1.0),
    ],
)
def test_each_control_does_one_thing(pad, name, value):
    inputs = with_pad(Inputs(), pad, REST)
    assert inputs == replace(Inputs(), **{name: value})


def test_keys_and_sticks_add_up_but_not_beyond_everything():
    assert with_pad(Inputs(forward=1.0), pad_with(LEFT_Y=-1.0)).forward == 1.0
    assert with_pad(Inputs(forward=-1.0), pad_with(LEFT_Y=-1.0)).forward == 0.0


def test_a_held_button_acts_once(session):
    glfw = FakeGlfw(REST)
    gamepad = Gamepad(glfw)
    gamepad.take(session, Inputs())
    for act in ACTS:
        seen = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("app.viewer.gamepad.ACTS", (act._replace(act=seen.append),))
            for pressed in ((act.button,), (act.button,), (), (act.button,)):
                glfw.pad = pad_with(*pressed)
                gamepad.take(session, Inputs())
            glfw.pad = REST
            gamepad.take(session, Inputs())
        assert seen == [session, session]


def test_buttons_do_what_the_help_says(session):
    glfw = FakeGlfw(REST)
    gamepad = Gamepad(glfw)

    def press(name):
        for pad in (pad_with(*(act.button for act in ACTS if act.name == name)), REST):
            glfw.pad = pad
            gamepad.take(session, Inputs())

    press("Y")
    assert session.navigation.mode == "orbit"
    press("X")
    assert not session.navigation.collides
    press("B")
    assert session.survey.spot_m is not None
    press("A")
    assert session.navigation.passage is not None
    press("back")
    assert session.layout.shows_help
    press("start")
    assert session.camera.pitch_deg == pytest.approx(FRAME_PITCH_DEG)
    press("left bumper")
    assert "bookmarks" in session.message
    assert {help_text for _, help_text in pad_help()} >= {act.help for act in ACTS}


def test_nothing_happens_without_a_gamepad_or_without_the_keyboard(session):
    inputs = Inputs(forward=1.0)
    assert Gamepad(FakeGlfw()).take(session, inputs) is inputs
    assert not session.navigation.has_gamepad
    unfocused = Inputs(focused=False)
    assert Gamepad(FakeGlfw(pad_with(0, LEFT_Y=-1.0))).take(session, unfocused) is unfocused
    assert session.navigation.has_gamepad


def test_an_unplugged_gamepad_is_gone(session):
    glfw = FakeGlfw(pad_with(LEFT_Y=-1.0))
    gamepad = Gamepad(glfw)
    assert gamepad.take(session, Inputs()).forward == 1.0
    glfw.pad = None
    assert gamepad.take(session, Inputs()).forward == 0.0
