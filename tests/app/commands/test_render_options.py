"""What `render` offers beyond plain pictures: tracks, paces, codecs, maps with world files."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pytest
from command_line import run
from PIL import Image

from app.output.whereabouts import KEYWORD

SMALL = ["--size", "64x36"]


@pytest.fixture(autouse=True)
def track(own_folder):
    (own_folder / "way.csv").write_text("t,x,y,z\n0,100,200,100\n1,120,200,120\n9,900,200,900\n")


def picture(name):
    with Image.open(name) as image:
        return np.asarray(image).astype(int), json.loads(image.text[KEYWORD])


def test_a_track_is_flown_as_high_and_as_long_as_asked():
    options = ["render", "flat:33", "--flight", "way.csv", *SMALL, "--at", 15]
    assert run(*options, "--duration", 30, "--above-ground", 77, "--out", "a.png") == 0
    _, told = picture("a.png")
    assert told["position"][1] == pytest.approx(100.0 + 77.0, abs=0.5)  # the flat scene lies 100 m high
    assert told["terrain"] == "flat"


def test_a_pace_changes_what_is_shown_at_a_time():
    options = ["render", "waves:33", "--flight", "way.csv", *SMALL, "--at", 1]
    places = {}
    for pace in ("timed", "constant", "eased"):
        assert run(*options, "--pace", pace, "--out", f"{pace}.png") == 0
        places[pace] = picture(f"{pace}.png")[1]["position"][0]
    assert places["timed"] == pytest.approx(120.0, abs=3.0)
    assert places["constant"] > places["eased"] > 120.0


def test_av1_films_hold_every_frame():
    assert run("render", "waves:33", *SMALL, "--frames", 4, "--codec", "av1", "--out", "a.mp4") == 0
    with av.open("a.mp4") as film:
        assert film.streams.video[0].codec_context.codec.canonical_name == "av1"
        assert sum(1 for _ in film.decode(video=0)) == 4


def test_a_view_straight_down_is_a_map():
    options = ["render", "waves:65", "--eye", "700,900,700", "--pitch=-90", "--size", "90x60"]
    assert run(*options, "--out", "map.png") == 0
    a, _, _, e, c, f = map(float, Path("map.pgw").read_text().split())
    assert a == pytest.approx(-e)
    assert (c + 44.5 * a, f + 29.5 * e) == pytest.approx((700.0, -700.0))
    assert picture("map.png")[0].shape == (60, 90, 3)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--flight", "gone.gpx"], "gone.gpx"),
        (["--flight", "way.csv", "--above-ground", "-3"], "-3"),
        (["--codec", "vp9", "--out", "a.mp4"], "vp9"),
        (["--pace", "slow"], "slow"),
        (["--duration", "9"], "track"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_bad_options_are_one_line_and_status_2(words, expected, capsys, tmp_path):
    out = [] if "--out" in words else ["--out", "a.png"]
    assert run("render", "flat:33", *SMALL, "--frames", 1, *words, *out) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert expected in said
    assert not list(tmp_path.glob("a.*"))


def test_a_world_file_that_is_there_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "map.pgw").write_text("mine")
    assert run("render", "flat:33", "--eye", "9,900,9", "--pitch=-90", *SMALL, "--out", "map.png") == 2
    assert "map.pgw" in capsys.readouterr().err
    assert not (tmp_path / "map.png").exists()
