"""The keys: one table for the window, the menu, the help, the tests and the README (``python -m app.viewer.keys``)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from app.session.session import Session
from app.windows.table import WINDOWS
from terrain.renderers import RENDERERS
from terrain.views import VIEWS


class Binding(NamedTuple):
    """Something to do.

    Attributes
    ----------
    key : str
        ``"F"``, ``"Ctrl+Q"``; empty where only the menu does it.
    help : str
        What it does, for the help and the menu.
    act : callable
    menu : str
        The menu that it is in; empty for none.
    is_on : callable, optional
        Whether the menu ticks it.
    """

    key: str
    help: str
    act: Callable[[Session], object]
    menu: str = ""
    is_on: Callable[[Session], bool] | None = None


# Held keys: (positive, negative, what they do); see app.flying.controls.Inputs.
HELD = {
    "forward": ("W", "S", "forwards, backwards"),
    "right": ("D", "A", "right, left"),
    "up": ("E", "Q", "up, down"),
}
# The same, where no window has the keyboard.
LOOKED = {
    "turn": ("Right", "Left", "look right, left (orbit: move)"),
    "tilt": ("Up", "Down", "look up, down (orbit: move)"),
}
FAST = "Shift"
MOUSE_HELP = (
    ("drag", "look around; orbit: turn"),
    ("right drag", "orbit: move the view"),
    ("wheel", "speed; orbit: zoom to the point"),
    ("click", "pick a point of the ground"),
    ("double-click", "fly there"),
    ("Ctrl+click", "type a number into a slider"),
)
KEYBOARD_HELP = (
    ("F10", "to the menu"),
    ("Ctrl+Tab", "to another window"),
    ("Tab, arrows", "from widget to widget"),
    ("Space, Enter", "use a widget, type a number"),
)

_ACTS = (
    Binding("", "read the terrain's file again", lambda session: session.loader.reload(session), "File"),
    Binding("F12", "save the picture as PNG", Session.take_screenshot, "File"),
    Binding("Ctrl+Q", "leave", Session.leave, "File"),
    Binding("F", "freeze the selection to look at it", Session.toggle_freeze, "View",
            lambda session: session.stage.frozen is not None),
    Binding("O", "show or hide the lens under the mouse", lambda session: session.layers.toggle_lens(), "View",
            lambda session: session.layers.stack.lens.is_on),
    Binding("Home", "frame the whole terrain", Session.frame_all, "Camera"),
    Binding("C", "fly, orbit or walk: the next", lambda session: session.navigation.next_mode(), "Camera"),
    Binding("X", "let the ground stop you, or not", lambda session: session.navigation.toggle_collision(), "Camera",
            lambda session: session.navigation.collides),
    Binding("J", "fly to the picked point", lambda session: session.survey.fly_to_point(), "Camera"),
    Binding("B", "keep the view as a bookmark", lambda session: session.places.keep_view(), "Camera"),
    Binding("N", "fly to the next bookmark", lambda session: session.places.visit_next(), "Camera"),
    Binding("I", "pick the middle of the picture", lambda session: session.survey.pick_middle(), "Camera"),
    Binding("M", "measure between two points", lambda session: session.survey.toggle_measuring(), "Camera",
            lambda session: session.survey.is_measuring),
    Binding("R", "record the flight; again: save it", lambda session: session.flights.toggle_recording(),
            "Flight", lambda session: session.flights.recorder is not None),
    Binding("P", "play the flight, or pause", lambda session: session.flights.toggle_playing(), "Flight",
            lambda session: session.flights.is_playing),
    Binding("Insert", "add a keyframe at the playhead", lambda session: session.flights.add_keyframe(),
            "Flight"),
    Binding("U", "give the selected keyframe the view", lambda session: session.flights.update_keyframe(), "Flight"),
    Binding("Delete", "delete the selected keyframe", lambda session: session.flights.delete_keyframe(), "Flight"),
    Binding("Comma", "one frame back", lambda session: session.flights.step(-1), "Flight"),
    Binding("Period", "one frame forward", lambda session: session.flights.step(1), "Flight"),
    Binding("Ctrl+Z", "take an edit of the flight back", lambda session: session.flights.undo(), "Flight"),
    Binding("Ctrl+Y", "do it again", lambda session: session.flights.redo(), "Flight"),
    Binding("Ctrl+S", "save the flight", lambda session: session.flights.save(), "Flight"),
    Binding("", "save the flight as KML, for Google Earth", lambda session: session.flights.save_kml(), "Flight"),
    Binding("Ctrl+T", "hide or show all windows", lambda session: session.layout.toggle_windows(), "Windows",
            lambda session: not session.layout.shows_windows),
    Binding("", "bring all windows back to their places", lambda session: session.layout.reset(), "Windows"),
    Binding("H", "show or hide this help", lambda session: session.layout.toggle_help(), "Help",
            lambda session: session.layout.shows_help),
    Binding("Escape", "close, pause or stop what is on", Session.escape, "Help"),
)  # fmt: skip


def bindings() -> tuple[Binding, ...]:
    """All that acts once: digits for algorithms, function keys for views, the acts, and the windows."""
    algorithms = [
        Binding(str(digit), kind.title, partial(_choose_algorithm, name=name), "Algorithm", partial(_draws, name=name))
        for digit, (name, kind) in enumerate(RENDERERS.items())
        if digit <= 9
    ]
    views = [
        Binding(f"F{number}", view_help.title, partial(_choose_view, view=view), "View", partial(_shows, view=view))
        for number, (view, view_help) in enumerate(VIEWS.items(), 1)
        if number <= 9
    ]
    windows = [
        Binding(window.key, f"show or hide the {window.about}", partial(_toggle_window, name=window.name))
        for window in WINDOWS
        if window.key
    ]
    return (*algorithms, *views, *_ACTS, *windows)


def _choose_algorithm(session: Session, name: str) -> None:
    session.algorithms.choose(name)


def _choose_view(session: Session, view: str) -> None:
    session.choose_view(view)


def _toggle_window(session: Session, name: str) -> None:
    session.layout.toggle(name)


def _draws(session: Session, name: str) -> bool:
    return session.algorithm == name


def _shows(session: Session, view: str) -> bool:
    return bool(session.view == view)


def help_rows() -> list[tuple[str, str]]:
    """All keys and what they do, and what the mouse does."""
    acts = [(binding.key, binding.help) for binding in bindings() if binding.key]
    return [*_hand_rows(), *acts, *KEYBOARD_HELP]


def keys_table() -> str:
    """The same as a table of Markdown, two keys a row; algorithms and views take one row each."""
    others = [(b.key, b.help) for b in bindings() if b.key and b.menu != "Algorithm" and b.key not in _view_keys()]
    algorithms, views = ([b.key for b in bindings() if b.menu == "Algorithm"], _view_keys())
    rows = [
        *_hand_rows(),
        (f"{algorithms[0]} ... {algorithms[-1]}", "choose the algorithm"),
        (f"{views[0]} ... {views[-1]}", f"choose the view: {', '.join(view.title.lower() for view in VIEWS.values())}"),
        *others,
        *KEYBOARD_HELP,
    ]
    half = -(-len(rows) // 2)
    pairs = zip(rows[:half], [*rows[half:], ("", "")], strict=False)
    lines = [f"| {a} | {told_a} | {b} | {told_b} |" for (a, told_a), (b, told_b) in pairs]
    return "\n".join(["| key | | key | |", "|---|---|---|---|", *lines])


def _hand_rows() -> list[tuple[str, str]]:
    """What is held, and what the mouse does."""
    held = [(f"{plus} {minus}", told) for plus, minus, told in (HELD | LOOKED).values()]
    return [*held, (FAST, "four times as fast"), *MOUSE_HELP]


def _view_keys() -> list[str]:
    return [f"F{number}" for number in range(1, len(VIEWS) + 1)]


if __name__ == "__main__":
    print(keys_table())
