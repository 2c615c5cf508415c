"""What keys and widgets can do to a session, where no widget is needed to see it."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np
import pytest

from app.flying.controls import Inputs
from app.places.framing import clearance_above, least_clearance_m
from app.session.session import SETTLE_S
from terrain.algorithms.multiresolution import load_tree
from terrain.camera import Camera
from terrain.renderers import RENDERERS, multiresolution
from terrain.textures.array_source import ArraySource, whole_extent

FORWARD, NOTHING = Inputs(forward=1.0), Inputs()


def let_settle(session):
    session.advance(NOTHING, SETTLE_S / 2)
    session.advance(NOTHING, SETTLE_S)


def test_nothing_is_drawn_again_while_nothing_changes(session):
    let_settle(session)
    drawn = len(session.frame_ms)
    assert session.is_still
    session.draw((64, 36))
    assert len(session.frame_ms) == drawn
    session.advance(FORWARD, 0.05)
    assert not session.is_still
    session.draw((64, 36))
    assert len(session.frame_ms) == drawn + 1


def test_a_new_size_draws_again_and_no_area_draws_nothing(session):
    let_settle(session)
    assert session.draw((0, 36)) is None
    picture = session.draw((48, 30))
    assert picture.size_px == (48, 30)
    assert picture.read()[..., :3].std() > 1.0


def test_replay_goes_along_the_flight_at_any_frame_rate(session):
    session.flights.toggle_playing()
    for _ in range(7):
        session.advance(NOTHING, 0.1)
    coarse = session.camera
    session.flights.seek(0.0)
    for _ in range(70):
        session.advance(NOTHING, 0.01)
    assert session.camera.position_m == pytest.approx(coarse.position_m)


def test_replay_ends_at_the_end(session):
    session.flights.toggle_playing()
    session.advance(NOTHING, session.flights.duration_s + 1.0)
    assert not session.flights.is_playing
    assert session.camera == session.flights.camera_at(session.flights.duration_s)


def test_recorded_flight_replays_what_was_flown(session, tmp_path):
    start = session.camera
    session.flights.toggle_recording()
    for _ in range(60):
        session.advance(FORWARD, 1 / 60)
    end = session.camera
    session.flights.toggle_recording()
    assert len(list(tmp_path.glob("*.flight.json"))) == 1
    length = np.linalg.norm(end.eye_m - start.eye_m)
    assert session.flights.camera_at(0.0).eye_m == pytest.approx(start.eye_m, abs=0.01 * length)
    assert session.flights.camera_at(session.flights.duration_s).eye_m == pytest.approx(end.eye_m, abs=0.01 * length)


def test_closing_saves_an_unfinished_recording(session, tmp_path):
    session.flights.toggle_recording()
    session.advance(FORWARD, 0.1)
    session.flights.save_recording()
    assert len(list(tmp_path.glob("*.flight.json"))) == 1


def test_what_cannot_be_saved_is_said_and_nothing_breaks(session, tmp_path):
    session.folder = tmp_path / "gone"
    session.take_screenshot()
    assert "gone" in session.message


def test_frozen_selection_draws_the_same_triangles_from_elsewhere(session):
    session.draw((64, 36))
    session.toggle_freeze()
    session.draw((64, 36))
    chosen = session.stats.triangles
    session.camera = dataclasses.replace(session.camera, yaw_deg=session.camera.yaw_deg + 180.0)
    session.touch()
    session.draw((64, 36))
    assert session.stats.triangles == chosen
    session.toggle_freeze()
    session.draw((64, 36))
    assert session.stage.frozen is None


def test_settings_of_each_algorithm_are_remembered(session):
    first = session.algorithm
    changed = dataclasses.replace(session.settings, tolerance_px=2.5)
    session.algorithms.change_settings(changed)
    session.algorithms.choose("reference")
    assert session.settings.tolerance_px == 2.5
    session.algorithms.choose(first)
    assert session.settings == changed


def test_the_eye_never_enters_the_ground(session):
    x, z = 100.0, 120.0
    session.camera = Camera((x, float(session.heightfield.heights_at(x, z)) + 5.0, z), pitch_deg=-60.0)
    for _ in range(300):
        session.advance(FORWARD, 1 / 30)
        clearance = clearance_above(session.heightfield)(*session.camera.position_m)
        assert clearance >= 0.999 * least_clearance_m(session.heightfield)


def test_the_picture_is_drawn_again_until_its_images_are_there(session):
    class Slow(ArraySource):
        gate = threading.Event()

        def read_tile(self, level, row, col):
            self.gate.wait(10.0)
            return super().read_tile(level, row, col)

    source = Slow("red", np.full((300, 300, 3), (200, 0, 0), np.uint8), whole_extent(session.heightfield))
    let_settle(session)
    before = session.picture.read()[..., :3].copy()
    session.stage.set_images([source])
    session.touch()
    for _ in range(3):
        session.draw((64, 36))
        let_settle(session)
    assert not session.is_still  # long after the change
    assert np.array_equal(session.picture.read()[..., :3], before)  # and the window never waited
    source.gate.set()
    until_s = time.monotonic() + 10.0
    while not session.is_still and time.monotonic() < until_s:
        session.draw((64, 36))
        session.advance(NOTHING, SETTLE_S)
    assert session.is_still
    assert session.picture.read()[30, 32, 0] > 2 * session.picture.read()[30, 32, 1]


def test_a_preview_is_shown_while_a_tree_is_built(session, monkeypatch):
    asked, go_on = threading.Event(), threading.Event()

    def load(*arguments):
        asked.set()
        go_on.wait(10.0)
        return load_tree(*arguments)

    monkeypatch.setattr(multiresolution, "load_tree", load)
    session.algorithms.choose("multiresolution")
    session.draw((64, 36))
    assert asked.wait(10.0)
    assert session.settings.preview
    assert session.stage.unfinished == ["building the approximation tree"]
    assert not session.is_still
    go_on.set()
    session.stage.renderer.finish()
    session.draw((64, 36))
    assert not session.stage.unfinished


@pytest.mark.parametrize(
    ("error", "why"),
    [(MemoryError(), "too little memory"), (RuntimeError(), "RuntimeError"), (ValueError("odd"), "odd")],
)
def test_an_algorithm_that_cannot_be_used_says_why_and_the_present_one_stays(session, monkeypatch, error, why):
    def refuse(*_):
        raise error

    before = session.algorithm
    monkeypatch.setattr(session.stage, "set_renderer", refuse)
    session.algorithms.choose("reference")
    assert session.message == f"{RENDERERS['reference'].title} cannot be used here: {why}."
    assert session.algorithm == before
