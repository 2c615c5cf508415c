"""Films, frames and pictures from the window are what the window shows, whole, and the same at any frame rate."""

from __future__ import annotations

import dataclasses
import json

import av
import numpy as np
import pytest
from PIL import Image

from app.flying.controls import Inputs
from app.output.png import PngWriter
from app.output.rendering import draw_bands
from app.output.whereabouts import KEYWORD, straightened, world_file
from app.session.export import Order
from terrain.camera import Camera
from terrain.flight import Flight, Keyframe
from terrain.heightfield import Georeference

SIZE = (64, 36)


@pytest.fixture
def film(session):
    """A flight of half a second across the hills, and what exports it."""
    here = session.camera
    there = dataclasses.replace(here, position_m=(120.0, 45.0, 200.0), yaw_deg=70.0)
    session.flights.show(Flight((Keyframe(0.0, here), Keyframe(0.5, there)), "short", "hills"))

    def export(**order):
        session.exporter.order = Order(**{"width_px": SIZE[0], "height_px": SIZE[1], "fps": 24, **order})
        session.exporter.start()
        while session.exporter.is_busy:
            session.exporter.work()
        return session.message

    return export


def frames_in(folder):
    return [np.asarray(Image.open(path)) for path in sorted(folder.glob("frame_*.png"))]


def test_replay_at_24_and_60_fps_gives_identical_pictures_at_equal_times(session, film, tmp_path):
    film(kind="frames", fps=24)
    film(kind="frames", fps=60)
    slow, fast = (frames_in(tmp_path / f"hills-frames-{number}") for number in (1, 2))
    assert (len(slow), len(fast)) == (13, 31)
    for i in range(0, 13, 2):  # i / 24 s is 5 i / 2 sixtieths
        assert np.array_equal(slow[i], fast[5 * i // 2]), i
    assert not np.array_equal(slow[0], slow[-1])


@pytest.mark.parametrize("pace", ["timed", "eased"])
def test_the_window_plays_what_is_exported(session, film, tmp_path, pace):
    session.flights.choose_pace(pace)
    film(kind="frames", fps=24)
    exported = frames_in(tmp_path / "hills-frames-1")
    for fps in (24, 60):
        session.flights.seek(0.0)
        session.flights.toggle_playing()
        for _ in range(fps // 4):
            session.advance(Inputs(), 1.0 / fps)
        assert session.flights.time_s == pytest.approx(0.25)
        shown = session.draw(SIZE).read()[..., :3]
        session.flights.pause()
        assert np.array_equal(shown, exported[6]), fps


def test_animated_and_budgeted_settings_are_exported_in_full_detail(session, film, tmp_path):
    plain = dataclasses.replace(session.settings)
    film(kind="frames")
    session.algorithms.change_settings(
        dataclasses.replace(plain, driver="time", budget="triangles", budget_triangles=1000)
    )
    session.draw(SIZE)
    film(kind="frames")
    one, other = (frames_in(tmp_path / f"hills-frames-{number}") for number in (1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_a_film_holds_every_frame_in_its_codec(session, film, tmp_path, codec):
    assert "13 frames" in film(kind="film", codec=codec)
    with av.open(str(tmp_path / "hills-1.mp4")) as file:
        stream = file.streams.video[0]
        assert stream.codec_context.codec.canonical_name == codec
        assert (stream.average_rate, sum(1 for _ in file.decode(stream))) == (24, 13)


def test_a_missing_encoder_is_told_in_one_line(session, film, tmp_path, monkeypatch):
    monkeypatch.setattr("av.codec.codecs_available", {"libx264"})
    assert "libsvtav1" in film(kind="film", codec="av1")
    assert list(tmp_path.glob("*.mp4")) == []


def test_what_a_cancelled_export_has_done_is_kept(session, film, tmp_path):
    for kind in ("film", "frames", "picture"):
        session.exporter.order = Order(kind=kind, width_px=64, height_px=36, fps=240)
        session.exporter.start()
        task = session.exporter._task
        for _ in range(6 if kind != "picture" else 0):
            next(task)
        assert len(session.jobs) == 1
        session.jobs.stop_newest()
        assert not session.exporter.is_busy
        assert not session.jobs
    with av.open(str(tmp_path / "hills-1.mp4")) as file:
        assert 1 <= sum(1 for _ in file.decode(video=0)) <= 6
    assert 1 <= len(frames_in(tmp_path / "hills-frames-1")) <= 6
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hills-1.mp4", "hills-frames-1"]
    assert "nothing was written" in session.message


def test_the_window_may_be_changed_while_it_exports(session, film, tmp_path):
    film(kind="frames")
    session.exporter.start()
    for number in range(40):
        session.exporter.work()
        if number == 1:
            session.algorithms.choose("reference")
            session.exaggerate(3.0)
            session.flights.start_anew()
        session.draw((48, 27))
    one, other = (frames_in(tmp_path / f"hills-frames-{number}") for number in (1, 2))
    assert len(one) == len(other) == 13
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_an_export_that_fails_is_told_and_leaves_nothing(session, film, tmp_path, monkeypatch):
    def fail(*args, **options):
        raise MemoryError("too large")
        yield

    monkeypatch.setattr("app.output.rendering.draw_bands", fail)
    assert "too large" in film(kind="picture")
    assert list(tmp_path.iterdir()) == []


def test_a_large_picture_is_made_of_tiles_and_says_where_it_was_taken(session, film, tmp_path, monkeypatch):
    monkeypatch.setattr("app.session.export.WINDOW_TILE_PX", 40)
    film(kind="picture", width_px=100, height_px=60)
    with Image.open(tmp_path / "hills-1.png") as image:
        picture, told = np.asarray(image).astype(int), json.loads(image.text[KEYWORD])
    assert told["position"] == list(session.camera.position_m)
    assert (told["yaw"], told["terrain"], told["algorithm"]) == (session.camera.yaw_deg, "hills", session.algorithm)
    with session.twin_stage() as stage:
        whole = stage.render(session.camera, (100, 60)).astype(int)
    assert picture.shape == whole.shape
    assert np.percentile(np.abs(picture - whole).max(axis=-1), 99) <= 3
    assert not list(tmp_path.glob("*.pgw"))


def test_a_view_straight_down_has_a_world_file_that_puts_it_on_the_map(session, film, tmp_path):
    session.look_from(Camera((100.0, 200.0, 150.0), yaw_deg=30.0, pitch_deg=-20.0))
    film(kind="picture", width_px=65, height_px=37, straight_down=True)
    a, d, b, e, c, f = map(float, (tmp_path / "hills-1.pgw").read_text().split())
    centre = a * 32 + b * 18 + c, d * 32 + e * 18 + f
    assert centre == pytest.approx((100.0, -150.0))  # east and north of the north-west post
    assert np.hypot(a, d) == pytest.approx(np.hypot(b, e))
    assert np.degrees(np.arctan2(-d, a)) == pytest.approx(30.0)  # the picture's rows run along the yaw
    positions = session.stage.positions(straightened(session.camera), (65, 37))
    ground = float(session.heightfield.heights_at(100.0, 150.0))
    near = np.abs(positions[..., 1] - ground) < 0.5
    row, col = np.nonzero(near)
    off = np.hypot(a * col + b * row + c - positions[near][:, 0], d * col + e * row + f + positions[near][:, 2])
    assert len(off) > 20
    assert off.max() < 0.01 * 200.0


def test_a_world_file_uses_the_terrains_own_coordinates(hills):
    place = Georeference("EPSG:32632", (10.0, 0.0, 600_000.0, 0.0, -10.0, 5_200_000.0))
    terrain = dataclasses.replace(hills, georeference=place)
    lines = world_file(Camera((100.0, 200.0, 150.0), 0.0, -90.0), terrain, (3, 3))
    a, d, b, e, c, f = map(float, lines.split())
    assert (d, b) == (0.0, 0.0)
    assert a == pytest.approx(-e)
    assert (a + c, e + f) == pytest.approx((600_100.0, 5_199_850.0))


def test_png_rows_are_counted(tmp_path):
    with (tmp_path / "a.png").open("wb") as file:
        writer = PngWriter(file, (2, 3), {"Title": "ß"})
        writer.add(np.zeros((2, 2, 3), np.uint8))
        with pytest.raises(ValueError, match="1 more row"):
            writer.finish()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (300, 2)])
def test_png_of_any_size_holds_its_pixels_and_its_words(tmp_path, size):
    picture = np.random.default_rng(3).integers(0, 256, (size[1], size[0], 3), np.uint8)
    with (tmp_path / "a.png").open("wb") as file:
        writer = PngWriter(file, size, {"Title": "Großglockner"})
        for row in picture:
            writer.add(row[None])
        writer.finish()
    with Image.open(tmp_path / "a.png") as image:
        assert np.array_equal(np.asarray(image), picture)
        assert image.text["Title"] == "Großglockner"


def test_bands_come_from_the_top_and_fill_the_picture(session):
    bands = [b for b in draw_bands(session.stage, session.camera, (50, 31), "shaded", tile_px=16) if b is not None]
    assert [band.shape[1:] for band in bands] == [(50, 3)] * len(bands)
    assert sum(len(band) for band in bands) == 31
