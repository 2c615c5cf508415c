"""Files are opened beside the running window: what is ready is shown, what is bad is told, the old terrain stays."""

from __future__ import annotations

import argparse
import os
import time
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from app.flying.controls import Inputs
from app.session.loader import Loader
from app.viewer.window import Window
from terrain import progress
from terrain.files.geotiff import write_geotiff
from terrain.flight import read_flight, write_flight
from terrain.synthetic import make_scene


@pytest.fixture
def opened(session):
    """Follows the loader until it rests; the session that is shown then. Closes those that came later."""
    shown = [session]

    def follow(patience_s=20.0):
        end = time.monotonic() + patience_s
        while shown[-1].loader.is_busy:
            assert time.monotonic() < end
            following = shown[-1].loader.follow(shown[-1])
            if following is not shown[-1]:
                shown.append(following)
            time.sleep(0.002)
        return shown[-1]

    yield follow
    for later in shown[1:]:
        later.close()


@pytest.fixture
def waves(tmp_path):
    path = tmp_path / "waves.tif"
    write_geotiff(make_scene("waves", 33, 0), path)
    return path


def test_another_terrain_is_shown_as_the_old_one_was(session, opened, waves):
    session.algorithms.choose("painter")
    session.choose_view("levels")
    session.flights.pace, session.flights.loops = "eased", True
    session.loader.open(session, [waves])
    assert len(session.jobs) == 1
    new = opened()
    assert new is not session
    assert (new.heightfield.name, new.algorithm, new.view) == ("waves", "painter", "levels")
    assert (new.flights.pace, new.flights.loops, new.heightfield.exaggeration) == ("eased", True, 1.0)
    assert new.flights.flight.terrain == "waves"
    assert not new.jobs
    assert new.draw((48, 27)).read()[..., :3].std() > 1.0


@pytest.mark.parametrize(
    ("name", "data"), [("bad.tif", b"no raster"), ("empty.hgt", b""), ("gone.tif", None), ("cut.npy", b"\x93NUMPY\x01")]
)
def test_a_bad_file_is_told_and_the_old_terrain_stays(session, opened, tmp_path, name, data):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    camera = session.camera
    session.loader.open(session, [tmp_path / name])
    assert opened() is session
    assert name in session.message
    assert "\n" not in session.message
    assert session.camera == camera
    assert session.draw((48, 27)) is not None


def test_a_terrain_that_cannot_be_shown_leaves_the_old_one(session, opened, waves, monkeypatch):
    def refuse(*args, **options):
        raise MemoryError

    session.loader.open(session, [waves])
    monkeypatch.setattr("app.session.session.open_stage", refuse)
    assert opened() is session
    assert "cannot be shown" in session.message


def test_reading_tells_how_far_it_is_and_can_be_cancelled(session, opened, tmp_path, monkeypatch):
    monkeypatch.setattr("terrain.files.raster.STRIP_POSTS", 1)
    path = tmp_path / "large.tif"
    write_geotiff(make_scene("flat", 600, 0), path)
    told, ended = [], []

    def listen(doing, share):
        told.append((doing, share))

    with progress.listening(listen):
        from terrain.files.sources import read_heightfield

        read_heightfield(path)
    shares = [share for doing, share in told if doing == "reading"]
    assert len(shares) > 2
    assert shares == sorted(shares)
    assert shares[-1] == 1.0

    tell = progress.tell

    def slow(doing, share=0.0):
        time.sleep(0.01)
        try:
            tell(doing, share)
        except progress.Cancelled:
            ended.append(doing)
            raise

    monkeypatch.setattr("terrain.files.raster.tell", slow)
    session.loader.open(session, [path])
    job = session.loader._job
    while job.doing != "reading":
        time.sleep(0.001)
    session.loader.cancel()
    job.thread.join(10.0)
    assert not job.thread.is_alive()
    assert ended == ["reading"]
    assert not session.jobs
    assert opened() is session


def test_the_last_request_counts(session, opened, waves, tmp_path):
    other = tmp_path / "ramp.tif"
    write_geotiff(make_scene("ramp", 33, 0), other)
    session.loader.open(session, [waves])
    session.loader.open(session, [other])
    assert len(session.jobs) == 1
    assert opened().heightfield.name == "ramp"


def test_a_file_changed_on_disk_is_read_again_under_the_same_view(session, opened, waves):
    session.loader.open(session, [waves])
    new = opened()
    before, loader = new.camera, new.loader
    new.advance(Inputs(forward=1.0), 0.3)
    flown = new.camera
    assert flown != before
    new.flights.add_keyframe()
    write_geotiff(make_scene("ramp", 33, 0), waves)
    os.utime(waves, ns=(1, 1))
    for _ in range(3):  # seen, seen unchanged, read
        loader._next_watch_s = 0.0
        assert loader.follow(new) is new
    again = opened()
    assert again is not new
    assert again.camera == flown
    assert again.flights.timeline.is_changed
    assert not np.array_equal(again.heightfield.heights_m, new.heightfield.heights_m)
    assert "read again" in again.message


def test_a_file_that_is_broken_on_disk_or_gone_leaves_what_is_shown(session, opened, waves):
    session.loader.open(session, [waves])
    new = opened()
    waves.write_bytes(b"half")
    for _ in range(3):
        new.loader._next_watch_s = 0.0
        new.loader.follow(new)
    assert opened() is new
    waves.unlink()
    new.loader._next_watch_s = 0.0
    assert new.loader.follow(new) is new
    assert not new.loader.is_busy


def test_a_scene_has_no_file_to_be_read_again(session):
    session.loader = Loader(argparse.Namespace(terrain="waves:33"))
    session.loader.reload(session)
    assert "no file" in session.message


def test_a_picture_is_laid_on_the_terrain_and_stays_there_when_it_is_read_again(session, opened, waves, tmp_path):
    photo = tmp_path / "photo.png"
    Image.fromarray(np.random.default_rng(1).integers(0, 256, (16, 16, 3), np.uint8)).save(photo)
    session.loader.open(session, [photo])
    assert opened() is session
    assert session.stage.drape.trees.count == 1, session.message
    session.loader.open(session, [photo, waves])
    new = opened()
    assert (new.heightfield.name, new.stage.drape.trees.count) == ("waves", 1)
    new.loader.reload(new)
    assert opened().stage.drape.trees.count == 1


def test_a_picture_can_be_taken_for_heights(session, opened, tmp_path):
    grey = tmp_path / "grey.jpg"
    Image.fromarray(np.arange(64 * 64, dtype=np.uint16).reshape(64, 64).astype(np.uint8)).save(grey)
    session.loader.open(session, [grey], as_terrain=True)
    assert opened().heightfield.name == "grey"


def test_two_terrains_at_once_are_refused(session, opened, waves, tmp_path):
    other = tmp_path / "other.tif"
    other.write_bytes(waves.read_bytes())
    session.loader.open(session, [waves, other])
    assert opened() is session
    assert "one terrain" in session.message


def test_a_flight_is_shown_and_a_track_is_asked_about(session, opened, tmp_path):
    path = tmp_path / "tour.flight.json"
    write_flight(session.flights.flight, path)
    session.loader.open(session, [path])
    assert session.flights.path == path
    assert not session.flights.timeline.is_changed
    assert session.flights.flight == read_flight(path)
    (tmp_path / "a.csv").write_text("t,x,y,z\n0,50,40,50\n9,250,40,250\n")
    session.loader.open(session, [tmp_path / "a.csv"])
    assert session.dialogs.track.path.name == "a.csv"
    session.dialogs.finish_import()
    assert session.flights.duration_s == pytest.approx(60.0)
    (tmp_path / "bad.flight.json").write_text("{}")
    session.flights.discard()
    session.loader.open(session, [tmp_path / "bad.flight.json"])
    assert "bad.flight.json" in session.message
    assert session.flights.duration_s == pytest.approx(60.0)


def test_unsaved_changes_are_asked_about_once(session, opened, waves, tmp_path):
    session.flights.add_keyframe()
    session.loader.open(session, [waves])
    assert not session.loader.is_busy
    assert "waves.tif" in session.dialogs.question.doing
    session.dialogs.answer("cancel")
    assert not session.loader.is_busy
    session.leave()
    assert not session.is_leaving
    session.dialogs.answer("save")
    assert session.is_leaving
    assert len(list(tmp_path.glob("*.flight.json"))) == 1
    session.loader.open(session, [waves])
    assert session.dialogs.question is None
    opened()


def test_leaving_with_changes_that_cannot_be_saved_stays(session, tmp_path):
    session.flights.add_keyframe()
    session.folder = tmp_path / "gone"
    session.leave()
    session.dialogs.answer("save")
    assert not session.is_leaving
    assert "gone" in session.message
    session.leave()
    session.dialogs.answer("discard")
    assert session.is_leaving


def test_what_is_dropped_is_opened_and_closing_the_window_asks(session, opened, waves):
    window = Window.__new__(Window)
    window._dropped, window._session = [], session
    window._window = SimpleNamespace(is_closing=False, title="")
    window._take_drop(None, [str(waves)])
    assert window._take_orders(session) is session
    assert session.loader.is_busy
    assert window._dropped == []
    new = opened()
    new.flights.add_keyframe()
    window._window.is_closing = True
    window._take_orders(new)
    assert not window._window.is_closing
    assert new.dialogs.question is not None
    assert not new.is_leaving
    new.dialogs.answer("discard")
    assert new.is_leaving


def test_files_opened_lately_are_remembered(session, opened, waves):
    session.loader.open(session, [waves])
    assert opened().preferences.current.recent_files == (str(waves),)
    session.loader = Loader(argparse.Namespace(terrain=str(waves)))
    session.loader.remember(session)
    assert session.preferences.current.recent_files == (str(waves),)
