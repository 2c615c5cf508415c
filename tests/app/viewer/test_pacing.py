"""The frame limiter keeps the pace it was given, on a clock that the test turns."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from app.session.preferences import PreferenceFile
from app.viewer.pacing import Pacer
from app.viewer.window import Window


class Clock:
    def __init__(self):
        self.now_s = 5.0

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now_s += seconds


@pytest.mark.parametrize(("limit_fps", "work_s", "expected_fps"), [(60, 0.001, 60), (60, 0.05, 20), (24, 0.01, 24)])
def test_frames_come_at_the_limit_or_as_fast_as_they_can(limit_fps, work_s, expected_fps):
    clock = Clock()
    pacer = Pacer(lambda: clock.now_s, clock.sleep)
    begin_s = clock.now_s
    for _ in range(240):
        pacer.wait(limit_fps)
        clock.now_s += work_s
    assert 240 / (clock.now_s - begin_s) == pytest.approx(expected_fps, rel=0.01)


def test_without_a_limit_nothing_waits():
    clock = Clock()
    pacer = Pacer(lambda: clock.now_s, clock.sleep)
    pacer.wait(0)
    pacer.wait(0)
    assert clock.now_s == 5.0


def test_after_a_long_frame_the_pace_goes_on_instead_of_catching_up():
    clock = Clock()
    pacer = Pacer(lambda: clock.now_s, clock.sleep)
    pacer.wait(50)
    clock.now_s += 3.0
    pacer.wait(50)
    before_s = clock.now_s
    pacer.wait(50)
    pacer.wait(50)
    assert clock.now_s - before_s >= 0.019


def test_the_window_keeps_the_pace_and_the_sync_that_were_chosen():
    said = []
    window = SimpleNamespace(
        _has_vsync=None,
        _glfw=SimpleNamespace(swap_interval=lambda frames: said.append(("sync", frames))),
        _pacer=SimpleNamespace(wait=lambda limit_fps: said.append(("limit", limit_fps))),
    )
    preferences = PreferenceFile()
    session = SimpleNamespace(preferences=preferences)
    Window._keep_pace(window, session)
    Window._keep_pace(window, session)
    preferences.change(vsync=False, frame_limit_fps=30)
    Window._keep_pace(window, session)
    assert said == [("sync", 1), ("limit", 60), ("limit", 60), ("sync", 0), ("limit", 30)]


@pytest.mark.parametrize(("asleep", "expected"), [(True, "wait"), (False, "poll")])
def test_the_window_sleeps_while_nothing_changes(asleep, expected):
    done = []
    window = SimpleNamespace(
        _is_hidden=False,
        _awake_until_s=0.0,
        _gamepad=SimpleNamespace(pad=None),
        _glfw=SimpleNamespace(
            poll_events=lambda: done.append("poll"), wait_events_timeout=lambda seconds: done.append("wait")
        ),
    )
    Window._take_events(window, SimpleNamespace(is_asleep=asleep, exporter=SimpleNamespace(is_busy=False)))
    assert done == [expected]
    assert (window._awake_until_s > 0.0) == asleep, "after an event it sleeps lightly for a while"
