"""Places in the window: going to a coordinate, and views kept as bookmarks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.places.bookmarks import Bookmark, Bookmarks
from app.places.coordinates import Coordinates, System
from app.places.framing import ground_m
from terrain.errors import InputError
from terrain.heightfield import Heightfield

if TYPE_CHECKING:
    from app.session.session import Session


class Places:
    """Where one can go.

    Parameters
    ----------
    session : Session
    heightfield : Heightfield
        With true heights: bookmarks are kept by the terrain's content.
    folder : Path or None
        Where bookmarks are kept; None keeps them only as long as the session lasts.

    Attributes
    ----------
    system : {"local", "map", "latlon"}
        What kind of coordinate is being typed.
    typed : str
        The coordinate as it stands in the window.
    problem : str
        Why the coordinate typed last is none; empty where it is one.
    """

    def __init__(self, session: Session, heightfield: Heightfield, folder: Path | None) -> None:
        self._session = session
        self.coordinates = Coordinates(heightfield)
        self.bookmarks = Bookmarks(heightfield, folder)
        self.system: System = "local"
        self.typed = self.problem = ""
        self._last = -1

    def go_to(self, text: str) -> bool:
        """Fly to a coordinate as typed; whether it is one."""
        try:
            x, z = self.coordinates.read(text, self.system)
        except InputError as error:
            self.problem = str(error)
            return False
        self.problem = ""
        session = self._session
        session.navigation.fly_to_point(np.array([x, ground_m(session.heightfield, x, z), z]))
        session.survey.pick_at((x, z))
        return True

    def keep_view(self) -> None:
        """Make the view a bookmark."""
        session = self._session
        name = self.bookmarks.free_name()
        self.bookmarks.add(Bookmark.of(name, session.camera, session.heightfield))
        self._last = len(self.bookmarks.all) - 1
        session.say(self.bookmarks.problem or f"Kept as bookmark {name}.")

    def visit(self, name: str) -> None:
        """Fly to a bookmark."""
        for number, bookmark in enumerate(self.bookmarks.all):
            if bookmark.name == name:
                self._last = number
                self._session.navigation.fly_to(bookmark.view(self._session.heightfield))
                self._session.say(f"{bookmark.name}.")

    def visit_next(self) -> None:
        """Fly to the bookmark after the one visited last, round and round."""
        kept = self.bookmarks.all
        if not kept:
            self._session.say("There are no bookmarks yet: B keeps the view as one.")
            return
        self.visit(kept[(self._last + 1) % len(kept)].name)
