"""The flight of a session: recorded, edited, played, saved.

Playback is a pure function of its time (`camera_at`): the window, films and pictures show the same at equal times.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from app.flying.autosave import EditedFlight, Journal, find_left, forget
from app.flying.controls import Inputs
from app.flying.timeline import Timeline
from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import (
    Flight,
    FlightRecorder,
    Keyframe,
    Pace,
    flight_time,
    make_flight,
    numbered_path,
    played_times,
    write_flight,
)  # fmt: skip
from terrain.flight.tracks import write_kml

if TYPE_CHECKING:
    from app.session.session import Session

Floats = npt.NDArray[np.float64]

APPENDED_S = 3.0  # a keyframe added at the end comes this long after the last
EDITED_KEPT_S = 1.0
SUFFIX = ".flight.json"
UNSAVED = "unsaved"  # the folder of what is not saved yet, beside the preferences


class Flights:
    """What a session flies, and how it is played.

    Attributes
    ----------
    timeline : Timeline
        The flight, and its editing.
    recorder : FlightRecorder or None
        While what one flies is recorded.
    time_s : float
        Where playback is: the playhead.
    is_playing, loops : bool
    pace : {"timed", "constant", "eased"}
    fps : int
        Of single steps, and of films.
    path : Path or None
        The file of the flight, where there is one.
    """

    def __init__(self, session: Session, flight: Flight, folder: Path | None = None) -> None:
        self._session, self._recordings = session, None if folder is None else folder / UNSAVED
        self.timeline = Timeline(flight)
        self.recorder: FlightRecorder | None = None
        self.time_s = 0.0
        self.is_playing = self.loops = False
        self.pace: Pace = "timed"
        self.fps = 30
        self.path: Path | None = None
        self._journal: Journal | None = None
        self._edited = EditedFlight(self._recordings)
        self._kept_s = 0.0
        self._key_times: tuple[Flight, Pace, Floats] | None = None

    @property
    def flight(self) -> Flight:
        return self.timeline.flight

    @property
    def duration_s(self) -> float:
        return self.flight.duration_s

    def camera_at(self, played_s: float) -> Camera:
        """What is shown ``played_s`` seconds into the playback."""
        return self.flight.camera_at(flight_time(self.flight, self.pace, played_s))

    # One frame

    def advance(self, inputs: Inputs, dt_s: float) -> None:
        """Let ``dt_s`` seconds pass: play on, and keep what is edited."""
        session = self._session
        if self.is_playing:
            self.time_s += dt_s
            if inputs.moves:
                self.pause("Paused: you are flying; P plays on.")
            elif self.time_s >= self.duration_s and self.loops and self.duration_s > 0.0:
                self._show(self.time_s % self.duration_s)
            elif self.time_s >= self.duration_s:
                self._show(self.duration_s)
                self.pause("The flight is over.")
            else:
                self._show(self.time_s)
        if self.timeline.is_changed and session.clock_s - self._kept_s >= EDITED_KEPT_S:
            self._kept_s = session.clock_s
            self._edited.keep(self.flight)

    def record(self) -> None:
        """Take the session's camera as a sample, while one records."""
        if self.recorder is not None and self._journal is not None:
            self.recorder.add(self._session.clock_s, self._session.camera)
            self._journal.add(self._session.clock_s, self._session.camera)

    def _show(self, played_s: float) -> None:
        self.time_s = played_s
        self._session.look_from(self.camera_at(played_s))

    # Playing

    def toggle_playing(self) -> None:
        """Play on from the playhead, or pause; at the end play from the beginning."""
        if self.is_playing:
            self.pause("Paused; P plays on.")
            return
        self.save_recording()
        if self.time_s >= self.duration_s:
            self.time_s = 0.0
        self.is_playing = True
        self._session.say(f"Playing {self.flight.name} ({self.duration_s:.0f} s); P or any movement pauses.")

    def pause(self, reason: str = "") -> None:
        """Stay where the playhead is."""
        self.is_playing = False
        if reason:
            self._session.say(reason)

    def seek(self, played_s: float) -> None:
        """Go to a moment; playback goes on from there."""
        self._show(min(max(played_s, 0.0), self.duration_s))

    def step(self, frames: int) -> None:
        """Pause, and go to the next or an earlier frame, exactly as a film would show it."""
        self.pause()
        at = round(self.time_s * self.fps) + frames
        self.seek(at / self.fps)

    def choose_pace(self, pace: Pace) -> None:
        """Play at another pace; the view stays at the same moment of the flight."""
        now_s = flight_time(self.flight, self.pace, self.time_s)
        self.pace = pace
        self.time_s = float(played_times(self.flight, pace, now_s))

    # Recording

    def toggle_recording(self) -> None:
        """Begin to record what is flown, or stop and save it under a new name."""
        if self.recorder is not None:
            self.save_recording()
            return
        self.recorder = FlightRecorder(self._session.heightfield)
        self._journal = Journal(self._recordings, self.recorder)
        self.record()
        self._session.say("Recording the flight; R stops and saves it.")

    def save_recording(self) -> None:
        """End the recording, if there is one, and save it under a new name."""
        if self.recorder is None or self._journal is None:
            return
        journal, recorder = self._journal, self.recorder
        self.recorder = self._journal = None
        self.pause()
        path = self._new_path(recorder.heightfield.name)
        self.timeline.restart(recorder.finish(_name_of(path)))
        self.time_s, self.path = 0.0, None
        if self._save_to(path):
            journal.discard()
            self._session.say(f"Saved the flight as {path}; P plays it.")
        else:
            journal.leave()

    def recover(self) -> None:
        """Save what programs that died have left, each under a new name."""
        for left, flight in find_left(self._recordings):
            path = self._new_path(f"{flight.terrain or 'flight'}-recovered")
            try:
                write_flight(replace(flight, name=_name_of(path)), path)
            except InputError as error:
                self._session.say(f"An unsaved flight was found, but {error}")
                return
            forget(left)
            self._session.say(f"An unsaved flight of {flight.duration_s:.0f} s was found and saved as {path}.")

    # Editing

    def start_anew(self) -> None:
        """A flight of one keyframe, the present view; undo brings the other one back."""
        session = self._session
        name = f"{session.heightfield.name} flight"
        self.timeline.restart(make_flight([Keyframe(0.0, session.camera)], name, session.heightfield))
        self.time_s, self.path, self.timeline.selected = 0.0, None, 0
        self._edit_said("A new flight begins here. Fly on and press Insert for the next keyframe.")

    def add_keyframe(self) -> None:
        """The present view becomes a keyframe at the playhead; at the end, some seconds after the last one."""
        at_end = self.time_s >= self.duration_s
        t_s = self.duration_s + APPENDED_S if at_end else flight_time(self.flight, self.pace, self.time_s)
        index = self.timeline.add(t_s, self._session.camera)
        self.time_s = self._played(index)
        self._edit_said(f"Keyframe {index + 1} at {t_s:.2f} s.")

    def delete_keyframe(self) -> None:
        """Take the selected keyframe away."""
        index = self.timeline.selected
        if index is None:
            self._session.say("Select a keyframe first: click it in the timeline.")
        elif self.timeline.delete(index):
            self._edit_said(f"Keyframe {index + 1} deleted; Ctrl+Z brings it back.")
        else:
            self._session.say("A flight keeps at least one keyframe.")

    def update_keyframe(self) -> None:
        """Give the selected keyframe the present view."""
        index = self.timeline.selected
        if index is None:
            self._session.say("Select a keyframe first: click it in the timeline.")
            return
        self.timeline.update(index, self._session.camera)
        self._edit_said(f"Keyframe {index + 1} has the present view; Ctrl+Z takes it back.")

    def move_keyframe(self, index: int, t_s: float, dragging: bool = False) -> None:
        """Give a keyframe another time."""
        self.timeline.move(index, t_s, dragging)
        self._edit_said("")

    def stretch(self, duration_s: float) -> None:
        """Let the flight last another time."""
        self.timeline.stretch(duration_s)
        self._edit_said("")

    def select_keyframe(self, index: int) -> None:
        """Select a keyframe, and go there."""
        self.timeline.selected = index
        self.pause()
        self.seek(self._played(index))

    def undo(self) -> None:
        self.timeline.undo()
        self._edit_said("")

    def redo(self) -> None:
        self.timeline.redo()
        self._edit_said("")

    def key_times_s(self) -> Floats:
        """When the keyframes are shown (n,) [s]."""
        key = self.flight, self.pace
        if self._key_times is None or self._key_times[0] is not key[0] or self._key_times[1] != key[1]:
            self._key_times = *key, played_times(self.flight, self.pace, self.timeline.times_s)
        return self._key_times[2]

    def _played(self, index: int) -> float:
        return float(self.key_times_s()[index])

    def _edit_said(self, text: str) -> None:
        self.pause(text)
        self.time_s = min(self.time_s, self.duration_s)
        self._session.touch()

    def take_over(self, old: Flights, same_place: bool) -> None:
        """Play as another session's flights did; with ``same_place`` also their flight."""
        self.pace, self.loops, self.fps = old.pace, old.loops, old.fps
        if same_place:
            old.save_recording()
            self.timeline, self.path, self.time_s, self.is_playing = old.timeline, old.path, old.time_s, old.is_playing
            self._edited, old._edited = old._edited, self._edited

    # Files

    def show(self, flight: Flight, path: Path | None = None) -> None:
        """Another flight, from a file or from elsewhere; undo brings the old one back."""
        self.pause()
        self.timeline.restart(flight.relocated(self._session.heightfield))
        self.path = path
        if path is not None:
            self.timeline.mark_saved(self.flight)
            self._edited.discard()
        self.seek(0.0)

    def save(self) -> bool:
        """Save the flight under a new name: the next number of the file it came from, or of the terrain."""
        name = self._session.heightfield.name if self.path is None else re.sub(r"-\d+$", "", _name_of(self.path))
        path = self._new_path(name)
        done = self._save_to(path)
        if done:
            self._session.say(f"Saved the flight as {path}.")
        return done

    def save_kml(self) -> None:
        """Save the flight as a tour for Google Earth, under a new name."""
        session = self._session
        path = numbered_path(session.folder / f"{session.heightfield.name}.kml")
        try:
            write_kml(self.flight, session.heightfield, path)
        except InputError as error:
            session.say(str(error))
        else:
            session.say(f"Saved the flight as {path}.")

    def discard(self) -> None:
        """The edits are not wanted."""
        self.timeline.mark_saved(self.flight)
        self._edited.discard()

    def close(self) -> None:
        """Save an unfinished recording; edits that were not saved stay where the next program finds them."""
        self.save_recording()

    def _save_to(self, path: Path) -> bool:
        flight = replace(self.flight, name=_name_of(path))
        try:
            write_flight(flight, path)
        except InputError as error:
            self._session.say(str(error))
            return False
        self.timeline.mark_saved(flight)
        self._edited.discard()
        self.path = path
        return True

    def _new_path(self, name: str) -> Path:
        return numbered_path(self._session.folder / f"{name}{SUFFIX}")


def _name_of(path: Path) -> str:
    return path.name.removesuffix(SUFFIX)
