"""Layers on the command line, and what a session does with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from app.__main__ import main
from app.opening.layers import parse_layer, read_layers
from terrain.errors import InputError
from terrain.textures.layers import Key


@pytest.mark.parametrize(
    ("text", "source", "blend", "opacity", "where"),
    [
        ("slope", "slope", "mix", 1.0, "everywhere"),
        ("slope:add", "slope", "add", 1.0, "everywhere"),
        ("maps/a b.png:modulate:0.25", "maps/a b.png", "modulate", 0.25, "everywhere"),
        ("C:\\maps\\a.png:mix:.5:inside", "C:\\maps\\a.png", "mix", 0.5, "inside"),
        ("cover:mix:outside", "cover", "mix", 1.0, "outside"),
    ],
)
def test_a_layer_is_read_from_text(text, source, blend, opacity, where):
    layer = parse_layer(text)
    assert layer.keys == (Key(source, 0.0),)
    assert (layer.blend, layer.opacity, layer.where) == (blend, opacity, where)


def test_key_frames_have_times_of_their_own_or_count_from_zero():
    assert parse_layer("a.png+b.png+c.png:mix:0.5").keys == (Key("a.png", 0), Key("b.png", 1), Key("c.png", 2))
    assert parse_layer("a.png@1990+b.png@2020.5").keys == (Key("a.png", 1990.0), Key("b.png", 2020.5))


@pytest.mark.parametrize(
    "text", ["slope:multiply", "slope:mix:2", "", ":mix", "a.png@3+b.png@1", "slope:mix:1:nowhere"]
)
def test_what_cannot_be_understood_is_refused_in_one_line(text):
    with pytest.raises(InputError) as refused:
        parse_layer(text)
    assert "\n" not in str(refused.value)


def test_images_lie_below_layers_and_a_lens_without_content_is_a_highlight(tmp_path):
    stack = read_layers(["slope"], [tmp_path / "a.png"], (1.0, 2.0, 3.0), None)
    assert [layer.name for layer in stack.layers] == ["a.png", "Slope"]
    assert stack.lens.is_on
    assert stack.lens.dimming > 0.0
    assert read_layers(["slope:mix:1:inside"], [], (1.0, 2.0, 3.0), None).lens.dimming == 0.0
    for wrong in ((["slope"], [], None, 1.0), (["slope+aspect"], [], None, 1.5), ([], [], (0.0, 0.0, -1.0), None)):
        with pytest.raises(InputError):
            read_layers(*wrong)


def picture(tmp_path, name, *options):
    out = tmp_path / name
    command = ["render", "ramp:33", "--at", "3", "--size", "64x36", "--algorithm", "reference", "--set", "fog=off"]
    assert main([*command, *options, "--out", str(out)]) in (None, 0)
    with Image.open(out) as image:
        return np.asarray(image).astype(int)


def test_rendered_layers_show_and_half_of_two_key_frames_is_their_mean(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (8, 8), (210, 20, 20)).save("a.png")
    Image.new("RGB", (8, 8), (20, 20, 190)).save("b.png")
    one, other, between = (
        picture(tmp_path, f"{number}.png", *options)
        for number, options in enumerate(
            (("--layer", "a.png"), ("--texture", "b.png"), ("--layer", "a.png+b.png", "--layer-time", "0.5"))
        )
    )
    assert np.abs(one - other).max() > 100
    assert np.abs(0.5 * (one + other) - between).max() <= 2


def test_in_a_series_of_pictures_time_runs_from_the_first_key_frame_to_the_last(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (8, 8), (255, 0, 0)).save("red.png")
    Image.new("RGB", (8, 8), (0, 0, 255)).save("blue.png")
    command = ["render", "ramp:33", "--frames", "3", "--size", "48x27", "--set", "fog=off", "--out", "frames"]
    assert main([*command, "--algorithm", "reference", "--layer", "red.png@5+blue.png@9:mix:1"]) in (None, 0)
    shares = []
    for path in sorted((tmp_path / "frames").glob("*.png")):
        with Image.open(path) as image:
            ground = np.asarray(image)[-6:].reshape(-1, 3).astype(float)  # at the foot of the picture
        ground = ground[ground[:, 1] < 20]  # layers hold no green, the sky does
        shares.append((ground[:, 2] / (ground[:, 0] + ground[:, 2])).mean())
    assert np.allclose(shares, [0.0, 0.5, 1.0], atol=0.05)


def test_a_layer_that_is_nowhere_is_answered_in_one_line_with_status_2(tmp_path, capsys):
    status = main(["render", "ramp:33", "--at", "0", "--layer", "nothing.png", "--out", str(tmp_path / "x.png")])
    assert status == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "x.png").exists()


def test_a_session_adds_moves_and_removes_layers_and_keeps_them_when_one_fails(session):
    layers = session.layers
    assert layers.add("slope:modulate:0.5")
    assert layers.add("aspect")
    assert not layers.add("nothing.png")
    assert "nothing.png" in session.message
    assert [layer.name for layer in layers.stack.layers] == ["Slope", "Aspect"]
    layers.move(0, 1)
    assert [layer.name for layer in layers.stack.layers] == ["Aspect", "Slope"]
    assert layers.selected == 1
    session.exaggerate(2.0)
    assert session.stage.drape.stack == layers.stack
    layers.remove(0)
    layers.remove(0)
    assert session.stage.drape.stack.layers == ()
    assert session.stage.drape.trees.count == 0


def test_the_lens_follows_the_point_under_the_mouse(session):
    layers = session.layers
    before = layers.stack.lens
    layers.advance((0.5, 0.7), 0.1)
    assert layers.stack.lens == before  # there is none to follow
    layers.toggle_lens()
    layers.advance((0.5, 0.7), 0.1)
    world = session.stage.positions(session.camera, (64, 36))[round(0.7 * 36), 32]
    assert np.hypot(*(np.array(session.stage.drape.stack.lens.centre_m) - world[[0, 2]])) < 15.0
    held = layers.stack.lens.centre_m
    layers.advance((0.5, 0.01), 0.1)  # the sky
    assert layers.stack.lens.centre_m == held


def test_the_animation_plays_from_end_to_end_and_over_again(session):
    layers = session.layers
    layers.add("slope+aspect+cover")
    assert layers.stack.time_range == (0.0, 2.0)
    layers.is_playing = True
    times = []
    for _ in range(13):
        layers.advance(None, 1.0)
        times.append(layers.stack.time)
    assert np.allclose(np.diff(times[:9]), 0.2)
    assert 0.0 <= times[-1] < 1.0
    layers.is_playing = False
    layers.set_time(0.5)
    layers.advance(None, 1.0)
    assert session.stage.drape.stack.time == 0.5


def test_a_session_settles_when_its_layers_are_loaded_and_its_light_is_baked(session):
    session.layers.add("slope")
    session.change_look(replace(session.stage.look, sun_azimuth_deg=100.0))
    for _ in range(500):
        session.clock_s += 0.05
        session.draw((64, 36))
        if session.is_still:
            break
    assert session.is_still
    assert not session.stage.is_loading


def test_another_terrain_keeps_the_layers_that_are_made_from_the_terrain_itself(session, tmp_path):
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "a.png")
    layers = session.layers
    for text in ("cover+winter", str(tmp_path / "a.png"), "slope"):
        assert layers.add(text)
    assert layers.edit(2, visibility=str(tmp_path / "a.png"))
    layers.set_time(0.25)
    kept = layers.elsewhere
    assert [layer.name for layer in kept.layers] == ["Land cover"]
    assert kept.time == 0.25
