"""What the window asks: whether unsaved edits are to be saved, and how a track is to be flown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from terrain.errors import InputError
from terrain.flight.tracks import DEFAULT_ABOVE_M, UNTIMED_S, read_track
from terrain.settings import setting

if TYPE_CHECKING:
    from app.session.session import Session


class Question(NamedTuple):
    """What is about to happen, in words, and the act itself."""

    doing: str
    act: Callable[[], None]


@dataclass(frozen=True)
class TrackImport:
    """How a track is to be flown. The fields made of `setting` are widgets."""

    path: Path
    at_height: bool = setting(
        False, "Above the ground", "Fly at one height above the ground, instead of at the heights in the file."
    )
    above_m: float = setting(
        DEFAULT_ABOVE_M, "Height", "Above the ground, where that is wanted.", unit="m", range=(2.0, 10_000.0)
    )
    in_time: bool = setting(True, "Choose the time", "Fly it in a time of your own, instead of as it was recorded.")
    duration_s: float = setting(UNTIMED_S, "Time", "From the first to the last point.", unit="s", range=(1.0, 3600.0))


class Dialogs:
    """The questions that are open.

    Attributes
    ----------
    question : Question or None
        Waits for `answer`.
    track : TrackImport or None
        Waits for `finish_import`.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.question: Question | None = None
        self.track: TrackImport | None = None

    def unless_unsaved(self, doing: str, act: Callable[[], None]) -> None:
        """Act at once, or where edits of the flight would be lost ask first: one question for all of them."""
        if self._session.flights.timeline.is_changed:
            self.question = Question(doing, act)
        else:
            act()

    def answer(self, choice: Literal["save", "discard", "cancel"]) -> None:
        """Save or discard the edits and act, or do nothing; where saving fails nothing is lost and nothing done."""
        question, self.question = self.question, None
        if question is None or choice == "cancel":
            return
        if choice == "save":
            if not self._session.flights.save():
                return
        else:
            self._session.flights.discard()
        question.act()

    def import_track(self, path: Path) -> None:
        """Ask how a track is to be flown."""
        self.track = TrackImport(path)

    def finish_import(self, wanted: bool = True) -> None:
        """Fly the track as chosen, or leave it."""
        order, self.track = self.track, None
        if order is not None and wanted:
            self.unless_unsaved("import a track", lambda: self._import(order))

    def _import(self, order: TrackImport) -> None:
        session = self._session
        above_m = order.above_m if order.at_height else None
        duration_s = order.duration_s if order.in_time else None
        try:
            flight = read_track(order.path, session.heightfield, above_m, duration_s)
        except InputError as error:
            session.say(str(error))
            return
        session.flights.show(flight)
        session.say(f"{order.path.name}: {len(flight.keyframes)} keyframes, {flight.duration_s:.0f} s; P plays it.")
