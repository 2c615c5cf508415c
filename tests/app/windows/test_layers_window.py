"""The window of layers: every widget does what it says, and the lens follows the mouse."""

from __future__ import annotations

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image
from ui_harness import UiHarness

from app.viewer.legends import legend_of
from terrain.textures.layers import BLENDS, PLACES
from terrain.textures.thematic import THEMES

OVER_PICTURE = (640.0, 500.0)


@pytest.fixture
def ui(session, tmp_path):
    session.layout.show("layers")
    with UiHarness(session) as harness:
        imgui.internal.focus_window(imgui.internal.find_window_by_name("Layers"))
        harness.frame()
        yield harness


def run(ui, steps):
    def in_window(ctx):
        ctx.set_ref("//Layers")
        steps(ctx)

    ui.run(in_window)


def names(session):
    return [layer.name for layer in session.stage.drape.stack.layers]


def row(name, widget):
    """The path of a widget in the list."""
    return f"{name}/{widget}"


def test_every_theme_is_added_from_the_list(ui):
    def steps(ctx):
        for kind in THEMES.values():
            ctx.combo_click(f"##Add theme/{kind.title}")

    run(ui, steps)
    assert names(ui.session) == [kind.title for kind in THEMES.values()]
    assert ui.session.layers.selected == len(THEMES) - 1


def test_an_image_is_added_by_its_path_and_a_wrong_path_is_answered(ui, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (8, 8), (250, 0, 0)).save("red.png")

    def steps(ctx):
        ctx.item_input_value("##Image file", "missing.png")
        ctx.item_click("Add")
        assert "missing.png" in ui.session.message
        ctx.item_input_value("##Image file", "red.png")
        ctx.item_click("Add")

    run(ui, steps)
    assert names(ui.session) == ["red.png"]


def test_layers_are_hidden_moved_selected_and_taken_away_in_the_list(ui):
    session = ui.session
    for name in ("slope", "aspect", "cover"):
        session.layers.add(name)

    def steps(ctx):
        ctx.item_click(row("Slope", "##Shown"))
        assert not session.stage.drape.stack.layers[0].is_on
        ctx.item_click(row("Slope", "##Up"))
        assert names(session) == ["Aspect", "Slope", "Land cover"]
        ctx.item_click(row("Land cover", "##Down"))
        assert names(session) == ["Aspect", "Land cover", "Slope"]
        ctx.item_click(row("Aspect", "Aspect##Layer"))
        assert session.layers.selected == 0
        ctx.item_click(row("Land cover", "x"))
        assert names(session) == ["Aspect", "Slope"]

    run(ui, steps)


def test_every_property_of_the_selected_layer_has_a_widget_that_changes_it(ui):
    session = ui.session
    session.layers.add("slope")
    session.layers.toggle_lens()

    def layer():
        return session.stage.drape.stack.layers[0]

    def steps(ctx):
        for blend in reversed(BLENDS):
            ctx.combo_click(f"##Blend/{blend}")
            assert layer().blend == blend
        ctx.item_input_value("##Opacity", 0.25)
        assert layer().opacity == pytest.approx(0.25)
        for where, title in reversed(PLACES.items()):
            ctx.combo_click(f"##Place/{title}")
            assert layer().where == where
        ctx.combo_click("##Visible/Aspect")
        assert layer().visibility == "aspect"
        ctx.combo_click("##Visible/everywhere")
        assert layer().visibility is None
        ctx.combo_click("##Key frame/Land cover")
        assert [key.source for key in layer().keys] == ["slope", "cover"]

    run(ui, steps)


def test_the_time_is_chosen_with_a_slider_and_runs_by_itself(ui):
    session = ui.session
    session.layers.add("slope+aspect")

    def steps(ctx):
        ctx.item_input_value("##Time", 0.5)
        assert session.stage.drape.stack.time == pytest.approx(0.5)
        ctx.item_click("Play##animation")
        ctx.yield_(12)
        assert session.stage.drape.stack.time > 0.5
        ctx.item_click("Stop##animation")
        held = session.stage.drape.stack.time
        ctx.yield_(5)
        assert session.stage.drape.stack.time == held

    run(ui, steps)


def test_the_lens_is_switched_shaped_and_follows_the_mouse_over_the_picture(ui):
    session = ui.session

    def lens():
        return session.stage.drape.stack.lens

    def steps(ctx):
        ctx.item_click("Lens follows the mouse")
        assert lens().is_on
        assert lens().dimming > 0.0  # nothing belongs inside it: it is a highlight
        for label, name, value in (
            ("Radius", "radius_m", 60.0),
            ("Soft rim", "rim", 0.5),
            ("Darkness", "dimming", 0.3),
        ):
            ctx.item_input_value(f"##{label}", value)
            assert getattr(lens(), name) == pytest.approx(value)
        ctx.mouse_move_to_pos(OVER_PICTURE)
        ctx.yield_(3)
        near = lens().centre_m
        ctx.mouse_move_to_pos((OVER_PICTURE[0] - 60.0, OVER_PICTURE[1] - 60.0))
        ctx.yield_(3)
        assert np.hypot(*np.subtract(lens().centre_m, near)) > 1.0
        held = lens().centre_m
        ctx.item_click("Lens follows the mouse")  # the mouse is over the window now
        assert not lens().is_on
        assert lens().centre_m == held or np.isfinite(lens().centre_m).all()
        ctx.key_press(imgui.Key.o)
        assert lens().is_on

    run(ui, steps)


def test_the_legend_of_the_uppermost_theme_lies_over_the_picture(ui):
    session = ui.session
    assert "height" in legend_of(session).title
    session.layers.add("aspect")
    for _ in range(300):
        ui.frame()
        if session.layers.legend is not None:
            break
    ui.frame()
    assert legend_of(session).labels[:3] == ("N", "NE", "E")
    session.layers.edit(0, is_on=False)
    assert "height" in legend_of(session).title
