"""The command line does what it says, and answers bad input in one line with exit status 2."""

from __future__ import annotations

import json
import subprocess
import sys

import av
import numpy as np
import pytest
from command_line import run
from PIL import Image

from app.commands.arguments import join_negative_values

SMALL = ["--size", "64x36"]


def test_make_and_info_agree(capsys):
    assert run("make", "cone", "--size", 33, "--out", "cone.tif") == 0
    assert run("info", "cone.tif", "--json") == 0
    told = capsys.readouterr().out
    facts = json.loads(told[told.index("{") :])
    assert (facts["rows"], facts["cols"], facts["units"], facts["nodata_share"]) == (33, 33, "m", 0.0)
    assert run("info", "cone:33") == 0
    assert "33 x 33" in capsys.readouterr().out


def test_render_writes_one_picture(tmp_path, capsys):
    assert run("render", "waves:33", "--at", 1, *SMALL, "--out", "a.png") == 0
    with Image.open("a.png") as image:
        assert image.size == (64, 36)
        assert len(image.getcolors(10000)) > 10
    assert "a.png" in capsys.readouterr().out


def test_the_error_view_of_the_reference_is_white():
    eye = ["--eye", "764,96,828", "--yaw=-39", "--pitch=-11"]
    options = ["render", "waves:33", *eye, *SMALL, "--view", "error"]
    assert run(*options, "--algorithm", "reference", "--out", "none.png") == 0
    assert run(*options, "--algorithm", "geomorph", "--tolerance", 16, "--out", "some.png") == 0
    with Image.open("none.png") as none, Image.open("some.png") as some:
        without, with_error = np.asarray(none).astype(int), np.asarray(some).astype(int)
    ground = without.min(axis=-1) > 200
    assert ground.mean() > 0.2
    assert set(map(tuple, without[~ground])) <= {(23, 26, 31)}
    assert np.abs(with_error - without)[ground].max() > 10


def test_render_writes_frames_and_films():
    assert run("render", "waves:33", "--frames", 3, *SMALL, "--out", "frames") == 0
    assert run("render", "waves:33", "--frames", 3, *SMALL, "--out", "a.mp4") == 0
    with av.open("a.mp4") as film:
        assert sum(1 for _ in film.decode(video=0)) == 3


def test_positions_lie_on_the_surface_and_end_at_the_sky():
    eye = ["--eye", "-40,160,-40", "--yaw", "135", "--pitch", "-20"]
    assert run("render", "flat:33", *eye, *SMALL, "--positions", "p.npy", "--algorithm", "reference") == 0
    positions = np.load("p.npy")
    assert (positions.shape, positions.dtype) == ((36, 64, 3), np.float64)
    assert np.isnan(positions[0]).all()
    ground = positions[np.isfinite(positions[..., 0])]
    assert len(ground) > 100
    assert np.ptp(ground[:, 1]) < 1e-3
    assert np.nanmedian(positions[30, :, 2]) < np.nanmedian(positions[20, :, 2])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["info", "nowhere.tif"], "nowhere.tif"),
        (["info", "alpz"], "alps"),
        (["info", "alps:x"], "alps:x"),
        (["make", "atlantis", "--out", "a.tif"], "atlantis"),
        (["render", "flat:33", "--out", "a.png", "--algorithm", "magic"], "magic"),
        (["render", "flat:33", "--out", "a.png", "--view", "xray"], "xray"),
        (["render", "flat:33", "--out", "a.png", "--size", "0x9"], "0x9"),
        (["render", "flat:33", "--out", "a.png", "--eye", "1,2"], "1,2"),
        (["render", "flat:33", "--out", "a.png", "--tolerance", "999"], "999"),
        (["render", "flat:33", "--out", "a.png", "--set", "sun=3"], "sun"),
        (["render", "flat:33", "--out", "no/a.png", "--at", "0"], "no"),
        (["render", "flat:33"], "--out"),
        (["render", "flat:33", "--out", "a.png", "--frames", "2"], "--frames"),
        (["render", "flat:33", "--out", "a.png", "--yaw", "2"], "--eye"),
        (["render", "flat:33", "--out", "a", "--at", "1", "--frames", "2"], "--at"),
        (["render", "flat:33", "--positions", "p.npy"], "--at"),
        (["render", "flat:33", "--out", "a.png", "--flight", "nowhere.flight.json"], "nowhere"),
        (["render", "flat:33", "--out", "a.png", "--texture", "nowhere.jpg", "--at", "0"], "nowhere"),
        (["--no-such-option"], "--no-such-option"),
        (["render"], "TERRAIN"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_bad_input_is_one_line_and_status_2(words, expected, capsys, tmp_path):
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert expected in said
    assert not list(tmp_path.iterdir())


def test_what_exists_is_not_overwritten(capsys, tmp_path):
    (tmp_path / "a.png").write_text("mine")
    assert run("render", "flat:33", "--at", 0, *SMALL, "--out", "a.png") == 2
    assert "overwrite" in capsys.readouterr().err
    assert (tmp_path / "a.png").read_text() == "mine"
    assert run("render", "flat:33", "--at", 0, *SMALL, "--out", "a.png", "--overwrite") == 0


def test_view_without_a_display_says_so_and_films_the_flight(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("app.commands.view.TOUR_FRAMES", 3)
    for number in (1, 2):
        assert run("waves:33", *SMALL) == 0
        said = capsys.readouterr().out
        assert "no display" in said
        folders = list(tmp_path.iterdir())
        assert len(folders) == number
        assert any(str(folder.name) in said for folder in folders)
    assert all(len(list(folder.glob("frame_*.png"))) == 3 for folder in folders)
    assert all((folder / "flight.mp4").stat().st_size > 500 for folder in folders)


def test_settings_reach_the_picture():
    options = ["render", "waves:33", "--at", 0, *SMALL]
    assert run(*options, "--out", "a.png", "--set", "sun_azimuth_deg=90", "--set", "palette=plaster") == 0
    assert run(*options, "--out", "b.png", "--set", "sun_azimuth_deg=270", "--set", "palette=plaster") == 0
    with Image.open("a.png") as a, Image.open("b.png") as b:
        assert not np.array_equal(np.asarray(a), np.asarray(b))


def test_help_lists_every_setting(capsys):
    assert run("render", "--help") == 0
    told = capsys.readouterr().out
    assert all(name in told for name in ("tolerance_px", "sun_azimuth_deg", "--positions"))
    assert run("--help") == 0
    told = capsys.readouterr().out
    assert all(name in told for name in ("view", "render", "info", "make"))


def test_keyboard_interrupt_is_one_line(capsys, monkeypatch):
    def interrupted(args):
        raise KeyboardInterrupt

    monkeypatch.setattr("app.commands.terrain.open_terrain", interrupted)
    assert run("info", "alps") == 130
    assert capsys.readouterr().err.count("\n") == 1


def test_negative_numbers_are_values_not_options():
    assert join_negative_values(["--eye", "-1,2,3", "--pitch", "-5", "--json", "x"]) == [
        "--eye=-1,2,3", "--pitch=-5", "--json", "x"
    ]  # fmt: skip


def test_help_imports_neither_window_nor_gl():
    heavy = ("moderngl", "glfw", "imgui_bundle", "rasterio", "av", "PIL")
    code = f"import sys, app.__main__ as m; m._parser('view'); print([n for n in {heavy} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
