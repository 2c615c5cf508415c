"""Opening files while the window lives: a worker reads, and the window changes over when all is ready.

A terrain becomes a new `Session`; until that one can be drawn the old one stays, and stays for good where the file is
bad. A terrain whose file changes on disk is read again, under the same view.
"""

from __future__ import annotations

import argparse
import contextvars
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.opening.drawing import Drawing
from app.opening.files import Loaded, is_flight, read_all, read_terrain
from app.session.jobs import FAILURES, Job, Jobs, reason
from terrain.errors import InputError
from terrain.flight import read_flight
from terrain.flight.track_files import TRACK_SUFFIXES
from terrain.progress import Cancelled, listening

if TYPE_CHECKING:
    from app.session.session import Session

WATCH_S = 1.0
CLOSE_S = 5.0


class _Job:
    """One piece of work in a thread; what it tells is kept for who asks."""

    def __init__(self, work: Callable[[], Loaded]) -> None:
        self.doing, self.share = "opening", 0.0
        self.result: Loaded | None = None
        self.problem = ""
        self._work, self._is_cancelled = work, False
        # A context of its own: what is told here concerns nobody else.
        self.thread = threading.Thread(target=contextvars.Context().run, args=(self._run,), daemon=True, name="loader")
        self.thread.start()

    def cancel(self) -> None:
        self._is_cancelled = True

    def _run(self) -> None:
        try:
            with listening(self._listen):
                self.result = self._work()
        except Cancelled:
            pass
        except MemoryError:
            self.problem = "There is too little memory for this file."
        except Exception as error:  # whatever a reader raises, the window goes on
            self.problem = str(error) or type(error).__name__

    def _listen(self, doing: str, share: float) -> None:
        if self._is_cancelled:
            raise Cancelled
        self.doing, self.share = doing, share


class Loader:
    """Opens files for a window, one request at a time: the last one counts.

    Parameters
    ----------
    source : argparse.Namespace, optional
        What the present terrain was read from, as `app.opening.terrain.open_terrain` takes it.

    Attributes
    ----------
    name : str
        What is being read; empty where nothing is.
    """

    def __init__(self, source: argparse.Namespace | None = None) -> None:
        self.name = ""
        self._job: _Job | None = None
        self._told: Job | None = None
        self._jobs: Jobs | None = None
        self._watched: Path | None = None
        self._stamp: Any = None
        self._changed: Any = None
        self._next_watch_s = 0.0
        self._watch(source)

    @property
    def is_busy(self) -> bool:
        return self._job is not None

    def open(self, session: Session, paths: Sequence[Path], as_terrain: bool = False) -> None:
        """Read files: at most one terrain, an image to drape over it, flights and tracks.

        ``as_terrain`` takes a picture for heights, whatever it looks like.
        """
        flights = [path for path in paths if is_flight(path)]
        others = [path for path in paths if path not in flights]
        if not others:
            for path in flights:
                open_flight(session, path)
            return
        present = session.heightfield

        def start() -> None:
            self._start(session, others[0].name, lambda: read_all(others, present, as_terrain, flights))

        session.dialogs.unless_unsaved(f"open {others[0].name}", start)

    def reload(self, session: Session) -> None:
        """Read the present terrain's file again, and keep the view."""
        source = self._source
        if source is None or self._watched is None:
            session.say("This terrain comes from no file that could be read again.")
            return
        self._start(session, self._watched.name, lambda: Loaded(source, read_terrain(source), is_reload=True))

    def remember(self, session: Session) -> None:
        """Put the file of the present terrain first among those opened lately."""
        if self._watched is not None:
            session.preferences.remember_file(self._watched)

    def cancel(self) -> None:
        """Stop reading; the present terrain stays."""
        if self._job is not None:
            self._job.cancel()
            self._end()

    def close(self) -> None:
        """Stop reading, and wait until the worker has noticed."""
        if self._job is not None:
            job = self._job
            self.cancel()
            job.thread.join(CLOSE_S)

    def follow(self, session: Session) -> Session:
        """The session to show now: the same, or one of what has just been read. Called once per frame."""
        self._look_for_changes(session)
        job, name = self._job, self.name
        if job is None:
            return session
        if job.thread.is_alive():
            if self._told is not None:
                self._told.name, self._told.share = f"Opening {name}, {job.doing}", job.share or None
            return session
        self._end()
        loaded = job.result
        if loaded is None:
            session.say(f"{name} was not opened: {' '.join(job.problem.split())}")
            return session
        if loaded.heightfield is not None:
            try:
                session = _changed_over(session, loaded)
            except FAILURES as error:
                session.say(f"{name} cannot be shown: {reason(error)}")
                return session
            session.loader = self
            self._watch(loaded.source)
            self.remember(session)
        elif loaded.image is not None:
            session.layers.lay_image(loaded.image, loaded.image_path)
        for path in loaded.flights:
            open_flight(session, path)
        return session

    def _start(self, session: Session, name: str, work: Callable[[], Loaded]) -> None:
        self.cancel()
        self.name, self._job = name, _Job(work)
        self._jobs = session.jobs
        self._told = session.jobs.begin(f"Opening {name}", "Escape cancels, what is shown stays", self.cancel)

    def _end(self) -> None:
        if self._jobs is not None:
            self._jobs.end(self._told)
        self._job, self._told, self.name = None, None, ""

    def _watch(self, source: argparse.Namespace | None) -> None:
        self._source = source
        path = None if source is None else Path(source.terrain)
        self._watched = path if path is not None and path.is_file() else None
        self._stamp = self._changed = _stamp(self._watched)

    def _look_for_changes(self, session: Session) -> None:
        """Read the file again once it has changed and then stayed the same for a moment: it is written no longer."""
        now_s = time.perf_counter()
        if self._watched is None or now_s < self._next_watch_s or self.is_busy:
            return
        self._next_watch_s = now_s + WATCH_S
        stamp = _stamp(self._watched)
        if stamp is not None and stamp != self._stamp and stamp == self._changed:
            self._stamp = stamp
            self.reload(session)
        self._changed = stamp


def open_flight(session: Session, path: Path) -> None:
    """Show the flight of a file; of a track first ask how it is to be flown."""
    if path.suffix.lower() in TRACK_SUFFIXES:
        session.dialogs.import_track(path)
        return

    def show() -> None:
        try:
            session.flights.show(read_flight(path), path)
        except InputError as error:
            session.say(str(error))
        else:
            session.say(f"{path.name}: a flight of {session.flights.duration_s:.0f} s; P plays it.")

    session.dialogs.unless_unsaved("open another flight", show)


def _changed_over(old: Session, loaded: Loaded) -> Session:
    """A session of what was read, as the old one was set; the old one is closed when the new one is ready."""
    from app.session.session import Session

    assert loaded.heightfield is not None
    layers = old.layers.stack if loaded.is_reload else old.layers.elsewhere
    exaggeration = old.heightfield.exaggeration if loaded.is_reload else 1.0
    drawing = Drawing(old.algorithm, old.settings, old.stage.look, old.view, layers, exaggeration)
    new = Session(old.gpu, loaded.heightfield, drawing, folder=old.folder, preferences=old.preferences)
    new.take_over(old, same_place=loaded.is_reload)
    if loaded.image is not None:
        new.layers.lay_image(loaded.image, loaded.image_path)
    old.close()
    return new


def _stamp(path: Path | None) -> Any:
    try:
        status = None if path is None else path.stat()
    except OSError:
        return None  # being replaced, or gone: what is shown stays
    return None if status is None else (status.st_mtime_ns, status.st_size)
