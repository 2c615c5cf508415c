"""The keys: one table for the window, the help overlay and the tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from app.session import Session
from terrain.renderers import RENDERERS
from terrain.views import VIEWS


class Binding(NamedTuple):
    """A key, what it does in words, and the act."""

    key: str
    help: str
    act: Callable[[Session], object]


# Held keys: (positive, negative, what they do); see app.controls.Inputs.
HELD = {
    "forward": ("W", "S", "fly forwards, backwards"),
    "right": ("D", "A", "fly right, left"),
    "up": ("E", "Q", "fly up, down"),
}
FAST = "Shift"
MOUSE_HELP = (
    ("drag", "look around"),
    ("wheel", "fly faster, slower"),
    ("Ctrl+click", "type a number into a slider"),
)

_ACTS = (
    Binding("F", "freeze the selection, fly on and look at it", Session.toggle_freeze),
    Binding("R", "record the flight you fly; again: save it", lambda session: session.flights.toggle_recording()),
    Binding("P", "play the flight, or pause", lambda session: session.flights.toggle_playing()),
    Binding("K", "show or hide the timeline of keyframes", Session.toggle_timeline),
    Binding("Insert", "make the view a keyframe at the playhead", lambda session: session.flights.add_keyframe()),
    Binding("U", "give the selected keyframe the view", lambda session: session.flights.update_keyframe()),
    Binding("Delete", "delete the selected keyframe", lambda session: session.flights.delete_keyframe()),
    Binding("Comma", "one frame back", lambda session: session.flights.step(-1)),
    Binding("Period", "one frame forward", lambda session: session.flights.step(1)),
    Binding("Ctrl+Z", "take an edit of the flight back", lambda session: session.flights.undo()),
    Binding("Ctrl+Y", "do it again", lambda session: session.flights.redo()),
    Binding("Ctrl+S", "save the flight", lambda session: session.flights.save()),
    Binding("Home", "frame the whole terrain", Session.frame_all),
    Binding("F12", "save the picture as PNG", Session.take_screenshot),
    Binding("T", "show or hide the panel", Session.toggle_panel),
    Binding("L", "show or hide the laboratory", Session.toggle_laboratory),
    Binding("H", "show or hide this help", Session.toggle_help),
    Binding("Escape", "close the help, pause the flight", Session.escape),
    Binding("Ctrl+Q", "leave", Session.leave),
)


def bindings() -> tuple[Binding, ...]:
    """All keys that act once when pressed: digits for algorithms, function keys for views, and the acts."""
    algorithms = [
        Binding(str(digit), kind.title, partial(_choose_algorithm, name=name))
        for digit, (name, kind) in enumerate(RENDERERS.items())
        if digit <= 9
    ]
    views = [
        Binding(f"F{number}", view_help.title, partial(_choose_view, view=view))
        for number, (view, view_help) in enumerate(VIEWS.items(), 1)
        if number <= 11
    ]
    return (*algorithms, *views, *_ACTS)


def _choose_algorithm(session: Session, name: str) -> None:
    session.choose_algorithm(name)


def _choose_view(session: Session, view: str) -> None:
    session.choose_view(view)
