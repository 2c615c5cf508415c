"""What is not saved yet, kept on disk once a second, so that no crash takes it away.

A recording is a journal, ``recording-*.jsonl``: one line of JSON that says where it is flown, then a line for every
sample. An edited flight is kept whole, ``edited-*.flight.json``. Both are deleted once the flight is saved; what a
program that died has left is found by the next one. The files of a program that lives are locked.
"""

from __future__ import annotations

import contextlib
import json
import uuid
from pathlib import Path
from typing import IO

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import Flight, FlightRecorder, Keyframe, make_flight, read_flight, write_flight
from terrain.flight.recorder import rebased, reduce_flight

FLUSH_S = 1.0
FORMAT = "reliefscope-recording"


class Journal:
    """A recording being written.

    Parameters
    ----------
    folder : Path or None
        None keeps nothing; nor does a folder that cannot be written.
    recorder : FlightRecorder
        Says where it is flown, and how closely the flight is to follow the samples.
    """

    def __init__(self, folder: Path | None, recorder: FlightRecorder) -> None:
        self._file: IO[str] | None = None
        self._path = Path()
        self._written_s = -FLUSH_S
        if folder is not None:
            blank = make_flight([Keyframe(0.0, Camera((0.0, 0.0, 0.0)))], "", recorder.heightfield)
            head = {
                "format": FORMAT, "version": 1, "terrain": blank.terrain, "crs": blank.crs, "origin": blank.origin,
                "tolerance_m": recorder.tolerance_m, "tolerance_deg": recorder.tolerance_deg,
            }  # fmt: skip
            self._file, self._path = _create(folder, "recording", ".jsonl")
            self._write(json.dumps(head) + "\n")

    def add(self, t_s: float, camera: Camera) -> None:
        """Note a sample; once a second all of them go to disk."""
        angles = camera.yaw_deg, camera.pitch_deg, camera.roll_deg, camera.fov_deg
        self._write(json.dumps([t_s, *map(float, camera.position_m), *angles]) + "\n")
        if t_s - self._written_s >= FLUSH_S:
            self._written_s = t_s
            self._write("", flush=True)

    def _write(self, text: str, flush: bool = False) -> None:
        if self._file is None:
            return
        try:
            self._file.write(text)
            if flush:
                self._file.flush()
        except OSError:  # a full disk: the recording itself goes on
            self._close()

    def _close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def leave(self) -> None:
        """The recording could not be saved: the next program will find it."""
        self._close()

    def discard(self) -> None:
        """The recording is saved: the journal is no longer needed."""
        if self._file is not None:
            self._close()
            self._path.unlink(missing_ok=True)


class EditedFlight:
    """The flight being edited, as it is."""

    def __init__(self, folder: Path | None) -> None:
        self._folder, self._path = folder, Path()
        self._kept: Flight | None = None
        self._lock: IO[str] | None = None

    def keep(self, flight: Flight) -> None:
        """Write the flight, if it is not the one written last."""
        if self._folder is None or flight is self._kept:
            return
        if self._lock is None:
            self._lock, self._path = _create(self._folder, "edited", ".lock")
        if self._lock is not None:
            with contextlib.suppress(InputError):
                write_flight(flight, self._path.with_suffix(".flight.json"), overwrite=True)
            self._kept = flight

    def discard(self) -> None:
        """The flight is saved, or not wanted."""
        if self._lock is not None:
            self._lock.close()
            for suffix in (".flight.json", ".lock"):
                self._path.with_suffix(suffix).unlink(missing_ok=True)
        self._lock, self._kept = None, None


def find_left(folder: Path | None) -> list[tuple[Path, Flight]]:
    """What died programs have left: its file, and the flight made of it. Files that hold nothing are deleted."""
    if folder is None or not folder.is_dir():
        return []
    found = []
    for path in sorted([*folder.glob("recording-*.jsonl"), *folder.glob("edited-*.lock")]):
        if is_in_use(path):
            continue
        flight = _read_journal(path) if path.suffix == ".jsonl" else _read_edited(path)
        if flight is None:
            forget(path)
        else:
            found.append((path, flight))
    return found


def forget(path: Path) -> None:
    """Delete what `find_left` found, once it is saved."""
    for name in (path, path.with_suffix(".flight.json")):
        with contextlib.suppress(OSError):
            name.unlink(missing_ok=True)


def is_in_use(path: Path) -> bool:
    """Whether a living program holds the file."""
    try:
        import fcntl
    except ImportError:  # Windows: an open file cannot be renamed
        try:
            path.rename(path)
        except OSError:
            return True
        return False
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def _create(folder: Path, stem: str, suffix: str) -> tuple[IO[str] | None, Path]:
    """A new file of one's own, locked as long as this program lives."""
    path = folder / f"{stem}-{uuid.uuid4().hex}{suffix}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = path.open("x", encoding="utf-8")
    except OSError:
        return None, path
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file, path


def _read_journal(path: Path) -> Flight | None:
    """The flight of a journal, up to its last whole line."""
    try:
        head, *lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        about = json.loads(head)
        if about.get("format") != FORMAT:
            return None
        samples = _samples(lines)
        if len(samples) < 2:
            return None
        origin = about["origin"] and (float(about["origin"][0]), float(about["origin"][1]))
        flown = Flight(rebased(samples), "recovered", str(about["terrain"]), about["crs"], origin)
        return reduce_flight(flown, float(about["tolerance_m"]), float(about["tolerance_deg"]))
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError):
        return None


def _samples(lines: list[str]) -> list[Keyframe]:
    samples: list[Keyframe] = []
    for line in lines:
        try:
            t, x, y, z, yaw, pitch, roll, fov = json.loads(line)
            sample = Keyframe(float(t), Camera((x, y, z), yaw, pitch, roll, fov))
        except (ValueError, TypeError):
            break  # cut off in the middle of a line
        if samples and sample.t_s <= samples[-1].t_s:
            samples[-1] = Keyframe(samples[-1].t_s, sample.camera)
        else:
            samples.append(sample)
    return samples


def _read_edited(path: Path) -> Flight | None:
    try:
        return read_flight(path.with_suffix(".flight.json"))
    except InputError:
        return None
