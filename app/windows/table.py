"""The table of windows. A new one is a module that draws its contents, and one line here.

It then can be docked, closed and opened by the menu and its key, and comes back in the next run where it was left.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from app.session.session import Session
from app.windows.drawing import draw_drawing
from app.windows.export import draw_export
from app.windows.laboratory import draw_laboratory
from app.windows.layers import draw_layers
from app.windows.open import draw_open
from app.windows.places import draw_places
from app.windows.preferences import draw_preferences
from app.windows.survey import draw_survey
from app.windows.timeline import draw_timeline

Side = Literal["left", "right", "bottom", "float"]


class Window(NamedTuple):
    """A window that can be docked.

    Attributes
    ----------
    name : str
        What the preferences call it.
    title : str
    about : str
        What it is, in the help: "show or hide the ...".
    key : str
        Opens and closes it; empty for none.
    draw : callable
        Draws the contents.
    side : str
        Where it is docked at first.
    is_open : bool
        Whether it is open at first.
    """

    name: str
    title: str
    about: str
    key: str
    draw: Callable[[Session], None]
    side: Side
    is_open: bool


WINDOWS = (
    Window("drawing", "Reliefscope", "panel", "T", draw_drawing, "left", True),
    Window("laboratory", "Laboratory", "laboratory", "L", draw_laboratory, "right", False),
    Window("places", "Places", "cameras and places", "G", draw_places, "right", False),
    Window("survey", "Survey", "point and profile", "V", draw_survey, "right", False),
    Window("layers", "Layers", "layers over the ground", "Y", draw_layers, "right", False),
    Window("timeline", "Timeline", "timeline of the flight", "K", draw_timeline, "bottom", False),
    Window("open", "Open", "files to open", "Ctrl+O", draw_open, "float", False),
    Window("export", "Export", "export of films and pictures", "Ctrl+E", draw_export, "float", False),
    Window("preferences", "Preferences", "preferences", "Ctrl+P", draw_preferences, "float", False),
)
