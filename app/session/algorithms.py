"""Which algorithm draws, and the settings that each of them keeps while others draw."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from app.opening.drawing import Drawing, without_waiting
from app.session.jobs import FAILURES, reason
from terrain.renderers import RENDERERS

if TYPE_CHECKING:
    from app.session.session import Session

LARGE_POSTS = 3_000_000  # from here on preparing an algorithm may take seconds


class Algorithms:
    """Switches between algorithms; what cannot be drawn with is told, and the present one stays.

    Parameters
    ----------
    session : Session
    drawing : Drawing
        What draws at first.

    Attributes
    ----------
    tuned : dict
        Settings that make algorithms equal, while they hold.
    """

    def __init__(self, session: Session, drawing: Drawing) -> None:
        self._session = session
        self._kept = {name: without_waiting(kind.Settings()) for name, kind in RENDERERS.items()}
        self._kept[drawing.algorithm] = drawing.settings
        self.tuned: dict[str, Any] = {}

    def choose(self, name: str) -> None:
        """Switch; the tolerance goes along, other settings are remembered for each algorithm."""
        session = self._session
        if session.heightfield.heights_m.size < LARGE_POSTS:
            self._switch(name)
        elif name != session.algorithm:
            session.jobs.announce(f"Preparing {RENDERERS[name].title}", lambda: self._switch(name))

    def _switch(self, name: str) -> None:
        if name != self._session.algorithm and self.use(name, self.tuned.get(name) or self.settings_for(name)):
            self._session.say(f"{RENDERERS[name].title}. {RENDERERS[name].source}")

    def settings_for(self, name: str) -> Any:
        """What an algorithm would draw with now: its own settings, at the current tolerance."""
        current = self._session.settings
        own = current if name == self._session.algorithm else self._kept[name]
        return replace(own, tolerance_px=current.tolerance_px)

    def use(self, name: str, settings: Any) -> bool:
        """Draw with an algorithm and all its settings; whether that could be done."""
        self._kept[self._session.algorithm] = self._session.settings
        return self._set(name, settings)

    def change_settings(self, settings: Any) -> None:
        """Give the current algorithm other settings; another tolerance ends what tuning made equal."""
        if settings.tolerance_px != self._session.settings.tolerance_px:
            self.tuned = {}
        self._set(self._session.algorithm, settings)

    def _set(self, name: str, settings: Any) -> bool:
        """Whether it could be made; otherwise the old one stays, and the reason is shown."""
        try:
            self._session.stage.set_renderer(name, settings)
        except FAILURES as error:
            self.refuse(name, error)
            return False
        self._session.touch()
        return True

    def refuse(self, name: str, error: Exception) -> None:
        """Say why an algorithm does not draw."""
        self._session.say(f"{RENDERERS[name].title} cannot be used here: {reason(error)}.")
