"""What is not saved survives the death of the program, and is found by the next one."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
from types import SimpleNamespace

import numpy as np
import pytest

from app.flying.autosave import EditedFlight, Journal, find_left, forget
from app.session.flights import UNSAVED, Flights
from terrain.camera import Camera
from terrain.flight import Flight, FlightRecorder, Keyframe, demo_flight, read_flight
from terrain.heightfield import Heightfield

PLAIN = Heightfield(np.zeros((9, 9), np.float32), (10.0, 10.0), name="plain")


def session_in(folder):
    """What flights need of a session, and nothing else."""
    said = []
    return SimpleNamespace(
        heightfield=PLAIN, folder=folder, clock_s=0.0, camera=Camera((0.0, 5.0, 0.0)), said=said, say=said.append,
        look_from=lambda camera: None, touch=lambda: None,
    )  # fmt: skip


CHILD = textwrap.dedent(
    """
    import os, signal
    from dataclasses import replace
    from pathlib import Path
    from types import SimpleNamespace
    import numpy as np
    from app.session.flights import Flights
    from terrain.camera import Camera
    from terrain.flight import Flight, Keyframe, file
    from terrain.heightfield import Heightfield

    def die(*_, **__):
        os.kill(os.getpid(), signal.SIGKILL)

    folder, moment = Path({folder!r}), {moment!r}
    plain = Heightfield(np.zeros((9, 9), np.float32), (10.0, 10.0), name="plain")
    session = SimpleNamespace(
        heightfield=plain, folder=folder, clock_s=0.0, camera=Camera((0.0, 5.0, 0.0)), say=print
    )
    flights = Flights(session, Flight((Keyframe(0.0, session.camera),)), folder / "preferences")
    flights.toggle_recording()
    for frame in range({frames}):
        session.clock_s += 1 / 60
        session.camera = replace(session.camera, position_m=(2.0 * session.clock_s, 5.0, 0.0))
        flights.record()
    link = os.link
    if moment == "recording":
        die()
    elif moment == "before the name":
        os.link = die
    else:
        os.link = lambda *names: (link(*names), die())
    flights.toggle_recording()
    """
)
FRAMES = 330  # five seconds and a half


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
@pytest.mark.parametrize("moment", ["recording", "before the name", "after the name"])
def test_a_killed_program_loses_at_most_the_last_second(tmp_path, moment):
    code = CHILD.format(folder=str(tmp_path), frames=FRAMES, moment=moment)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    session = session_in(tmp_path)
    Flights(session, demo_flight(PLAIN), tmp_path / "preferences").recover()
    assert "was found" in session.said[-1]
    found = read_flight(tmp_path / "plain-recovered-1.flight.json")
    assert FRAMES / 60 - 1.0 - 1e-6 <= found.duration_s <= FRAMES / 60
    assert found.terrain == "plain"
    for t in np.linspace(0.0, found.duration_s, 7):
        assert found.camera_at(t).position_m[0] == pytest.approx(2.0 * t, abs=0.1)
    for path in tmp_path.glob("*.flight.json"):
        read_flight(path)  # whole, whatever its name
    again = session_in(tmp_path)
    Flights(again, demo_flight(PLAIN), tmp_path / "preferences").recover()
    assert not again.said


def recorded(folder, seconds=2.0):
    recorder = FlightRecorder(PLAIN)
    journal = Journal(folder, recorder)
    for t in np.arange(0.0, seconds, 0.1):
        journal.add(float(t), Camera((t, 0.0, 0.0)))
    return journal


def test_the_files_of_a_living_program_are_left_alone(tmp_path):
    journal = recorded(tmp_path)
    assert find_left(tmp_path) == []
    journal.discard()
    assert list(tmp_path.iterdir()) == []


def abandoned(folder, seconds=2.0):
    """A journal whose program is no more."""
    journal = recorded(folder, seconds)
    journal._close()
    return next(folder.glob("recording-*.jsonl"))


def test_a_line_cut_off_ends_the_recording_there(tmp_path):
    path = abandoned(tmp_path)
    whole = path.read_bytes()
    for length in range(len(whole), len(whole) - 200, -13):
        path.write_bytes(whole[:length])
        ((found, flight),) = find_left(tmp_path)
        assert found == path
        assert 1.0 < flight.duration_s < 2.0


@pytest.mark.parametrize(
    "text", ["", "{}", "[]\n", "nonsense", '{"format": "reliefscope-recording"}\n[1]\n', "\x00\xff"]
)
def test_what_holds_nothing_is_deleted(tmp_path, text):
    path = tmp_path / "recording-a.jsonl"
    path.write_text(text)
    assert find_left(tmp_path) == []
    assert not path.exists()


def test_what_was_found_stays_until_it_is_forgotten(tmp_path):
    path = abandoned(tmp_path)
    assert len(find_left(tmp_path)) == len(find_left(tmp_path)) == 1
    forget(path)
    assert find_left(tmp_path) == []


def test_a_folder_that_cannot_be_written_keeps_nothing_and_breaks_nothing(tmp_path):
    (tmp_path / "file").write_text("in the way")
    journal = recorded(tmp_path / "file")
    journal.discard()
    edited = EditedFlight(tmp_path / "file")
    edited.keep(demo_flight(PLAIN))
    edited.discard()
    assert find_left(None) == find_left(tmp_path / "none") == []


def test_an_edited_flight_is_kept_once_a_second_and_dropped_when_saved(tmp_path):
    from app.flying.controls import Inputs

    session = session_in(tmp_path)
    folder = tmp_path / "preferences"
    flights = Flights(
        session, Flight((Keyframe(0.0, session.camera), Keyframe(4.0, session.camera)), "f", "plain"), folder
    )
    flights.timeline.move(1, 9.0)
    session.clock_s = 1.5
    flights.advance(Inputs(), 0.0)
    (kept,) = (folder / UNSAVED).glob("edited-*.flight.json")
    assert json.loads(kept.read_text())["keyframes"][-1]["t"] == 9.0
    flights.timeline.move(1, 11.0)
    flights.advance(Inputs(), 0.0)
    assert json.loads(kept.read_text())["keyframes"][-1]["t"] == 9.0
    session.clock_s = 2.6
    flights.advance(Inputs(), 0.0)
    assert json.loads(kept.read_text())["keyframes"][-1]["t"] == 11.0
    assert flights.save()
    assert list((folder / UNSAVED).iterdir()) == []


def test_saving_again_takes_the_next_number_and_overwrites_nothing(tmp_path):
    session = session_in(tmp_path)
    flights = Flights(session, demo_flight(PLAIN))
    for number in (1, 2, 3):
        flights.timeline.move(1, 0.3 + 0.01 * number)
        assert flights.timeline.is_changed
        assert flights.save()
        assert not flights.timeline.is_changed
        assert flights.path == tmp_path / f"plain-{number}.flight.json"
    assert len({path.read_text() for path in tmp_path.glob("*.flight.json")}) == 3


def test_what_cannot_be_saved_stays_unsaved_and_in_the_journal(tmp_path):
    session = session_in(tmp_path / "gone")
    flights = Flights(session, demo_flight(PLAIN), tmp_path)
    flights.toggle_recording()
    session.clock_s += 2.0
    flights.record()
    flights.toggle_recording()
    assert "gone" in session.said[-1]
    assert flights.timeline.is_changed
    assert list((tmp_path / UNSAVED).glob("recording-*.jsonl"))
