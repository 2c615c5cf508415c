"""One flight from end to end: the real program under Xvfb, real keys, a real mouse."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image
from waiting import wait_for

from app.session.preferences import PreferenceFile
from app.viewer.window import Window, WindowError, explain_no_window

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Xvfb and xdotool are for X11")


def test_a_person_flies_looks_switches_records_and_leaves(desktop, tmp_path):
    def xdo(*words):
        return subprocess.run(["xdotool", *map(str, words)], env=desktop, capture_output=True, text=True, check=False)

    def press(key):
        xdo("key", "--clearmodifiers", key)

    def press_until(key, condition, what):
        """Press a key until it has had its effect: without a window manager the window may not have the focus."""

        def effect():
            xdo("windowfocus", window)
            press(key)
            end = time.monotonic() + 3.0
            while not (value := condition()) and time.monotonic() < end:
                time.sleep(0.05)
            return value or None

        return wait_for(effect, what)

    def picture():
        """The picture saved with F12."""
        before = set(tmp_path.glob("*.png"))
        new = press_until("F12", lambda: set(tmp_path.glob("*.png")) - before, "a picture")
        with Image.open(max(new, key=lambda path: path.stat().st_mtime)) as image:
            return np.asarray(image).astype(int)

    def changed(before, what, key=None):
        """The first picture unlike ``before``; ``key``, where given, is pressed before each."""

        def differs():
            if key is not None:
                press(key)
            after = picture()
            return after if after.shape != before.shape or np.abs(after - before).mean() > 0.5 else None

        return wait_for(differs, what)

    program = [sys.executable, "-m", "app", "waves:65", "--size", "640x480"]
    viewer = subprocess.Popen(program, cwd=tmp_path, env=desktop, stderr=subprocess.PIPE, text=True)
    try:
        search = ("search", "--onlyvisible", "--name", "waves — Reliefscope")
        found = wait_for(lambda: xdo(*search).stdout.split() or viewer.poll(), "the window")
        assert isinstance(found, list), viewer.stderr.read()
        window = found[0]
        xdo("windowfocus", window)
        xdo("mousemove", "--window", window, 500, 300)
        first = picture()
        assert first.shape == (480, 640, 3)
        assert first.std() > 5.0

        press("r")
        xdo("keydown", "w", "sleep", 0.7, "keyup", "w")
        flown = changed(first, "the key W to fly")
        xdo("mousedown", 1, "sleep", 0.3, "mousemove_relative", "--sync", 90, 0, "sleep", 0.3, "mouseup", 1)
        turned = changed(flown, "the mouse to turn the view")
        press_until("r", lambda: list(tmp_path.glob("*.flight.json")), "the recorded flight")

        wires = changed(turned, "the wireframe view", "F2")
        shaded = changed(wires, "the shaded view", "F1")
        press("0")
        assert picture().shape == shaded.shape

        xdo("windowsize", "--sync", window, 1, 1)
        xdo("windowsize", "--sync", window, 800, 600)
        wait_for(lambda: picture().shape == (600, 800, 3), "a picture of the new size")
        xdo("windowminimize", window)
        xdo("windowmap", "--sync", window)
        xdo("windowfocus", "--sync", window)  # no window manager does it here
        assert viewer.poll() is None
        press_until("ctrl+q", lambda: viewer.poll() is not None, "the window to close")
        assert viewer.returncode == 0, viewer.stderr.read()
        assert "Laboratory" in PreferenceFile(tmp_path / "config").read_layout(), "the layout is kept"
    finally:
        viewer.kill()
        viewer.communicate()


def test_without_a_display_there_is_no_window_and_a_reason(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(WindowError, match="no display"):
        Window((64, 36))


def test_a_display_that_does_not_answer_is_no_display(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":1999")
    with pytest.raises(WindowError, match="no display"):
        Window((64, 36))


def test_a_missing_library_is_named_with_its_package(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":1999")
    monkeypatch.setitem(sys.modules, "app.viewer.gui", None)
    with pytest.raises(WindowError):
        Window((64, 36))
    assert "libx11-6" in explain_no_window("libX11.so.6: cannot open shared object file: No such file or directory")


def test_reasons_are_told_without_the_librarys_decoration():
    told = explain_no_window("(65543) b'GLX: Failed to create context: GLXBadFBConfig'")
    assert "OpenGL 3.3" in told
    assert "(GLX: Failed to create context: GLXBadFBConfig)" in told
