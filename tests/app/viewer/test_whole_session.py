"""A whole session under Xvfb, as a new user would: open, fly, record, edit, replay, export, leave, come back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from waiting import wait_for

from terrain.files.geotiff import write_geotiff
from terrain.flight import read_flight
from terrain.synthetic import make_scene

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Xvfb and xdotool are for X11")
SIZE = "800x600"
PICTURES = os.environ.get("RELIEFSCOPE_TEST_PICTURES")  # a folder to which the screen is saved after each step


class Person:
    """Sits before the window; presses keys until they have had their effect."""

    def __init__(self, environment, folder, *words):
        self.environment, self.folder, self.count = environment, folder, 0
        program = [sys.executable, "-m", "app", *words, "--size", SIZE]
        self.errors = folder / "errors.txt"
        with self.errors.open("w") as errors:
            self.viewer = subprocess.Popen(program, cwd=folder, env=environment, stderr=errors)

    def do(self, *words):
        """Words of xdotool; what it prints."""
        command = ["xdotool", *map(str, words)]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        return done.stdout.split()

    def see(self, title):
        """Wait for a window of that title, and turn to it."""
        found = wait_for(lambda: self.do("search", "--onlyvisible", "--name", title) or self.viewer.poll(), title)
        assert isinstance(found, list), self.errors.read_text()
        self.window = found[0]
        self.do("windowfocus", self.window, "mousemove", "--window", self.window, 600, 150)

    def until(self, condition, what, *words, patience_s=5.0):
        """Do something until ``condition()``; what it gives."""

        def effect():
            self.do("windowfocus", self.window)
            self.do(*words)
            end = time.monotonic() + patience_s
            while not (value := condition()) and time.monotonic() < end:
                assert self.viewer.poll() is None, self.errors.read_text()
                time.sleep(0.05)
            return value or None

        value = wait_for(effect, what)
        self.keep_picture(what)
        return value

    def leave(self):
        self.until(lambda: self.viewer.poll() is not None, "leaving", "key", "ctrl+q")
        assert self.viewer.returncode == 0, self.errors.read_text()

    def keep_picture(self, what):
        if PICTURES:
            self.count += 1
            name = f"{self.count:02d} {what}.png"
            subprocess.run(["import", "-window", "root", str(Path(PICTURES) / name)], env=self.environment, check=False)

    def picture(self):
        """The scene, as F12 saves it."""
        before = set(self.folder.glob("*.png"))
        new = self.until(lambda: set(self.folder.glob("*.png")) - before, "a picture", "key", "F12")
        with Image.open(max(new, key=lambda path: path.stat().st_mtime)) as image:
            return np.asarray(image).astype(int)


def open_windows(environment):
    try:
        path = Path(environment["RELIEFSCOPE_CONFIG"]) / "preferences.json"
        return json.loads(path.read_text())["open_windows"]
    except (OSError, ValueError, KeyError):
        return {}


def flights_in(folder):
    return sorted(folder.glob("*.flight.json"), key=lambda path: path.stat().st_mtime)


def test_a_whole_session_from_opening_to_coming_back(desktop, tmp_path):
    environment = {**desktop, "RELIEFSCOPE_CONFIG": str(tmp_path / "config")}
    write_geotiff(make_scene("waves", 65, 0), tmp_path / "dem.tif")

    def is_open(name):
        return open_windows(environment).get(name, False)

    person = Person(environment, tmp_path, "flat:33")
    try:
        person.see("flat — Reliefscope")
        person.until(lambda: is_open("open"), "the window of files", "key", "ctrl+o")
        named = lambda: person.do("search", "--onlyvisible", "--name", "dem — Reliefscope")  # noqa: E731
        person.do("key", "ctrl+a", "sleep", 0.2, "type", "--delay", 20, "dem.tif")
        person.until(named, "the terrain", "sleep", 0.2, "key", "Return")

        first = person.picture()
        person.do("key", "r", "sleep", 0.3, "keydown", "w", "sleep", 1.2, "keyup", "w", "sleep", 0.3)
        recorded = person.until(lambda: flights_in(tmp_path), "the recorded flight", "key", "r")[-1]
        assert np.abs(person.picture() - first).mean() > 0.5
        assert read_flight(recorded).duration_s > 0.5

        person.until(lambda: is_open("timeline"), "the timeline", "key", "k")
        person.do("keydown", "d", "sleep", 0.5, "keyup", "d")
        before = len(read_flight(recorded).keyframes)
        keys = ("period", "period", "Insert", "ctrl+s")
        longer = lambda: [path for path in flights_in(tmp_path) if len(read_flight(path).keyframes) > before]  # noqa: E731
        steps = [word for key in keys for word in ("sleep", 0.2, "key", key)]
        edited = person.until(longer, "an added keyframe", *steps)[-1]
        assert edited != recorded
        still = person.picture()
        person.until(lambda: np.abs(person.picture() - still).mean() > 0.5, "the replay", "key", "p", patience_s=0.5)

        person.do("key", "Escape")  # a flight that plays on would make the window slower
        film = export(person, lambda: is_open("export"))
        with av.open(str(film)) as file:
            stream = file.streams.video[0]
            assert (stream.width, stream.height, sum(1 for _ in file.decode(stream))) == (96, 54, 48)
        person.leave()

        person = Person(environment, tmp_path, "dem.tif")
        person.see("dem — Reliefscope")
        person.until(lambda: not is_open("timeline"), "the timeline kept open, and closed", "key", "k")
        person.leave()
    finally:
        person.viewer.kill()
        person.viewer.wait()


def export(person, is_open):
    """The film made by going through all of the export window's fields by Tab; slower, where keys were lost."""
    for pause_s in (0.3, 0.8, 1.5):
        person.until(is_open, "the export window", "key", "ctrl+e")
        steps: list[object] = []
        for value in (96, 54, 24, 48):
            steps += ["sleep", pause_s, "key", "Tab", "sleep", pause_s]
            steps += [word for digit in str(value) for word in ("key", digit, "sleep", 0.1)]
        for key in ("Tab", "Tab", "space"):
            steps += ["sleep", pause_s, "key", key]
        person.do(*steps)
        person.keep_picture("the export")
        end = time.monotonic() + 20.0 * pause_s
        while time.monotonic() < end:
            films = sorted(person.folder.glob("*.mp4"))
            if films:
                return films[-1]
            time.sleep(0.1)
        person.do("key", "Escape", "sleep", 0.3, "key", "Escape")
        person.until(lambda: not is_open(), "the export window closed", "key", "ctrl+e")
    raise AssertionError("no film was made")
