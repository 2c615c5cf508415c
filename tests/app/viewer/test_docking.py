"""Windows, menu, help and layout: opened, docked, kept between runs, reached by the keyboard, and nothing cut off."""

from __future__ import annotations

import dataclasses

import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from app.session.preferences import PreferenceFile, Preferences
from app.viewer import gui
from app.viewer.docking import free_rectangle
from app.viewer.keys import bindings, help_rows
from app.viewer.menu import MENUS
from app.viewer.panel import status_lines
from app.windows.table import WINDOWS
from app.windows.theme import apply_theme

CLEAR_OF_WINDOWS = (640.0, 360.0)


@pytest.fixture
def ui(session, tmp_path):
    session.preferences = PreferenceFile(tmp_path / "config")
    with UiHarness(session) as harness:
        yield harness


def shown(title):
    """ImGui's window of a title, or None where it is not on the screen."""
    window = imgui.internal.find_window_by_name(title)
    return window if window is not None and window.active else None


def test_the_panel_is_docked_on_the_left_and_the_laboratory_on_the_right(ui):
    ui.session.layout.show("laboratory")
    for _ in range(3):
        ui.frame()
    panel, laboratory, free = shown("Reliefscope"), shown("Laboratory"), free_rectangle(ui.session)
    assert panel.dock_id
    assert laboratory.dock_id
    assert panel.pos.x == 0.0
    assert laboratory.pos.x + laboratory.size.x == 1280.0
    assert panel.pos.x + panel.size.x <= free.left
    assert free.right <= laboratory.pos.x
    assert free.width > 400.0
    assert free.top > 10.0  # the menu bar


@pytest.mark.parametrize("last", ["key", "ctrl"])
def test_ctrl_counts_however_soon_it_is_let_go(ui, last):
    """Within one slow frame people press a key and let go of it and of Ctrl."""
    io, ctrl = imgui.get_io(), (imgui.Key.mod_ctrl, imgui.Key.left_ctrl)
    is_lens_on = ui.session.layers.stack.lens.is_on
    for key in ctrl:
        io.add_key_event(key, True)
    ui.frame()
    io.add_key_event(imgui.Key.o, True)
    for key in (*ctrl, imgui.Key.o) if last == "key" else (imgui.Key.o, *ctrl):
        io.add_key_event(key, False)
    for _ in range(4):
        ui.frame()
    assert ui.session.layout.is_open("open")  # by Ctrl+O
    assert ui.session.layers.stack.lens.is_on == is_lens_on  # not by O


@pytest.mark.parametrize("window", WINDOWS, ids=lambda window: window.name)
def test_every_window_is_opened_by_the_menu_and_closed_by_its_cross(ui, window):
    session = ui.session

    def steps(ctx):
        ctx.set_ref("##MainMenuBar")
        for _ in range(2):
            before = session.layout.is_open(window.name)
            ctx.menu_click(f"Windows/{window.title}")
            ctx.yield_(2)
            assert session.layout.is_open(window.name) != before
            assert (shown(window.title) is not None) != before
        session.layout.show(window.name)
        ctx.yield_(3)
        ctx.window_close(f"//{window.title}")
        ctx.yield_(2)
        assert not session.layout.is_open(window.name)

    ui.run(steps)
    assert PreferenceFile(session.preferences.folder).current.open_windows[window.name] is False


def test_every_act_is_in_a_menu_that_does_it(ui):
    session = ui.session
    acts = [binding for binding in bindings() if binding.menu]
    assert {binding.menu for binding in acts} | {"Windows"} == set(MENUS)
    seen = []
    watched = tuple(b._replace(act=lambda session, help=b.help: seen.append(help)) for b in acts)

    def steps(ctx):
        ctx.set_ref("##MainMenuBar")
        for binding in watched:
            ctx.menu_click(f"{binding.menu}/{binding.help[:1].upper()}{binding.help[1:]}")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.viewer.menu.bindings", lambda: watched)
        ui.run(steps)
    assert seen == [binding.help for binding in acts]
    assert {window.key for window in WINDOWS if window.key} <= {binding.key for binding in bindings()}
    assert session.layout.shows_windows


def test_keys_are_each_used_once():
    keys = [binding.key for binding in bindings() if binding.key]
    assert len(keys) == len(set(keys))


def test_all_windows_are_hidden_and_come_back(ui):
    session = ui.session

    def steps(ctx):
        ctx.mouse_move_to_pos(CLEAR_OF_WINDOWS)
        ctx.key_press(imgui.Key.mod_ctrl | imgui.Key.t)
        ctx.yield_(2)
        assert shown("Reliefscope") is None
        assert shown("##MainMenuBar") is None
        assert free_rectangle(session).width == 1280.0
        ctx.key_press(imgui.Key.mod_ctrl | imgui.Key.t)
        ctx.yield_(2)
        assert shown("Reliefscope") is not None

    ui.run(steps)


def test_the_help_lists_every_key_and_fits_into_the_window(ui):
    rows = help_rows()
    assert {binding.key for binding in bindings() if binding.key} <= {key for key, _ in rows}

    def steps(ctx):
        for scale in (1.0, 1.5):
            ui.session.preferences.change(ui_scale=scale)
            ui.session.layout.shows_help = True
            ctx.yield_(5)
            window = shown("Help")
            assert window.pos.x >= 0.0
            assert window.pos.x + window.size.x <= 1280.0
            assert window.pos.y + window.size.y <= 720.0
            assert window.scroll_max.x == 0.0
            assert window.scroll_max.y < 1.0, "all keys are seen at once"
            ctx.key_press(imgui.Key.escape)
            ctx.yield_(2)
            assert not ui.session.layout.shows_help

    ui.run(steps)


def test_the_layout_is_kept_and_a_damaged_one_is_replaced_by_the_first(session, tmp_path):
    folder = tmp_path / "config"
    session.preferences = PreferenceFile(folder)

    def run(steps):
        with UiHarness(session) as harness:
            harness.run(steps)
            session.preferences.write_layout(imgui.save_ini_settings_to_memory())

    def move(ctx):
        session.layout.show("laboratory")
        ctx.yield_(2)
        ctx.undock_window("//Reliefscope")
        ctx.window_resize("//Reliefscope", (420.0, 300.0))
        ctx.window_move("//Reliefscope", (500.0, 200.0))
        ctx.yield_(2)

    def is_moved(ctx):
        window = shown("Reliefscope")
        assert (window.pos.x, window.pos.y) == (500.0, 200.0)
        assert (window.size.x, window.size.y) == (420.0, 300.0)
        assert not window.dock_id
        assert shown("Laboratory").dock_id

    def is_first(ctx):
        assert shown("Reliefscope").pos.x == 0.0
        assert shown("Reliefscope").dock_id

    def brings_back(ctx):
        ctx.set_ref("##MainMenuBar")
        ctx.menu_click("Windows/Bring all windows back to their places")
        ctx.yield_(3)
        is_first(ctx)

    run(move)
    run(is_moved)
    run(brings_back)
    run(move)
    layout = folder / "layout.ini"
    layout.write_bytes(layout.read_bytes()[:-5])
    run(is_first)


def test_the_layout_is_kept_while_the_program_runs(ui):
    def steps(ctx):
        ctx.undock_window("//Reliefscope")
        ctx.window_move("//Reliefscope", (450.0, 150.0))
        for _ in range(400):  # ImGui waits 5 s after a change
            if "450,150" in ui.session.preferences.read_layout():
                return
            ctx.yield_()
        raise AssertionError("the layout is not written")

    ui.run(steps)


def test_theme_and_scale_are_chosen_and_kept(ui):
    session = ui.session
    session.layout.show("preferences")

    def steps(ctx):
        ctx.yield_(2)
        ctx.set_ref("//Preferences")
        dark, em, width = imgui.get_style_color_vec4(imgui.Col_.window_bg).x, imgui.get_font_size(), panel_width()
        ctx.combo_click("##Theme/light")
        ctx.yield_(2)
        assert imgui.get_style_color_vec4(imgui.Col_.window_bg).x > dark + 0.5
        ctx.item_input_value("##Scale", 1.5)
        ctx.yield_(3)
        assert imgui.get_font_size() == pytest.approx(1.5 * em, abs=1.0)
        assert panel_width() == pytest.approx(1.5 * width, rel=0.02)
        ctx.item_input_value("##Scale", 1.0)
        ctx.yield_(3)
        assert panel_width() == pytest.approx(width, rel=0.02)

    def panel_width():
        return shown("Reliefscope").size.x

    ui.run(steps)
    assert PreferenceFile(session.preferences.folder).current.theme == "light"


def test_spaces_grow_with_the_scale_and_the_screen_and_shrink_again(ui):
    def padding(scale, dpi_scale):
        apply_theme(Preferences(ui_scale=scale), dpi_scale)
        style = imgui.get_style()
        return style.frame_padding.x, style.scrollbar_size, style.font_scale_main

    once = padding(1.0, 1.0)
    assert padding(1.5, 2.0) == pytest.approx((3.0 * once[0], 3.0 * once[1], 1.5), abs=1.0)
    assert padding(1.0, 1.0) == once


def test_every_preference_has_a_widget_that_changes_it(ui):
    session = ui.session
    session.layout.show("preferences")

    def steps(ctx):
        ctx.yield_(2)
        ctx.set_ref("//Preferences")
        ctx.item_uncheck("##Vertical sync")
        ctx.item_uncheck("##Scale and north")
        ctx.item_uncheck("##Legend")
        ctx.item_input_value("##Frame limit", 30)
        ctx.combo_click("##Theme/light")
        ctx.item_input_value("##Scale", 1.25)
        ctx.yield_(3)

    ui.run(steps)
    found, plain = session.preferences.current, Preferences()
    widgets = [field.name for field in dataclasses.fields(found) if "label" in field.metadata]
    assert all(getattr(found, name) != getattr(plain, name) for name in widgets)
    assert found.frame_limit_fps == 30


def test_everything_is_reached_by_the_keyboard(ui):
    """From the menu with the arrows; from widget to widget with Tab."""
    session = ui.session

    def press(ctx, *keys):
        for key in keys:
            ctx.key_press(key)
            ctx.yield_(2)

    def steps(ctx):
        key = imgui.Key
        ctx.mouse_move_to_pos(CLEAR_OF_WINDOWS)
        ctx.mouse_click(0)
        press(ctx, key.f10, key.right_arrow, key.down_arrow, key.down_arrow)  # Algorithm, its second entry
        press(ctx, key.enter)
        ctx.yield_(2)
        assert session.algorithm == "slicing"
        ctx.window_focus("//Reliefscope")
        ctx.nav_move_to("//Reliefscope/##Freeze")
        press(ctx, key.space)
        assert session.stage.frozen is not None

    ui.run(steps)


def test_flying_goes_on_beside_the_widgets(ui):
    """Keys that fly are heard wherever the focus is, but in a text field."""

    def steps(ctx):
        ctx.nav_move_to("//Reliefscope/##Freeze")
        ctx.key_down(imgui.Key.w)
        ctx.yield_(4)
        assert gui.read_inputs().forward == 1.0
        ctx.key_up(imgui.Key.w)

    ui.run(steps)


def test_the_status_line_tells_what_runs_and_escape_stops_it(ui):
    session, stopped = ui.session, []
    job = session.jobs.begin("Reading alps.tif", "Escape cancels", lambda: stopped.append(True))
    job.share = 0.25
    assert status_lines(session)[0] == "Reading alps.tif 25 %: Escape cancels."
    assert not session.is_asleep

    def steps(ctx):
        ctx.mouse_move_to_pos(CLEAR_OF_WINDOWS)
        ctx.key_press(imgui.Key.escape)
        ctx.yield_(2)
        assert stopped == [True]
        ctx.item_click("//Status/Stop")
        assert stopped == [True, True]

    ui.run(steps)
    session.jobs.end(job)
    assert len(session.jobs) == 0
    session.flights.toggle_playing()
    assert any("P pauses" in line for line in status_lines(session))


def test_the_status_line_says_what_the_window_waits_for_before_it_waits(session, monkeypatch):
    monkeypatch.setattr("app.session.algorithms.LARGE_POSTS", 1)
    session.algorithms.choose("slicing")
    session.draw((64, 36))
    assert session.algorithm != "slicing"
    assert status_lines(session)[0] == "Preparing Adaptive slicing: the window waits for it."
    assert not session.is_asleep
    session.draw((64, 36))
    assert session.algorithm == "slicing"
    assert len(session.jobs) == 0
    session.algorithms.choose("slicing")
    assert len(session.jobs) == 0


def test_the_status_line_tells_what_is_made_ready_meanwhile(session, monkeypatch):
    assert not any("while you fly" in line for line in status_lines(session))
    monkeypatch.setattr(type(session.stage._ground), "is_done", False)
    monkeypatch.setattr(type(session.stage.drape.trees), "is_loading", True)
    assert "Reading images, baking light while you fly." in status_lines(session)
    assert not session.is_still


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_no_window_covers_the_status_line_or_the_other(ui, scale):
    session = ui.session
    session.preferences.change(ui_scale=scale)
    session.layout.show("laboratory")
    session.say("a long line " * 40)

    def steps(ctx):
        ctx.yield_(4)
        rectangles = [shown(name).rect() for name in ("Reliefscope", "Laboratory", "Status", "##MainMenuBar")]
        for number, one in enumerate(rectangles):
            assert 0.0 <= one.min.x < one.max.x <= 1280.0
            assert 0.0 <= one.min.y < one.max.y <= 720.0
            for other in rectangles[:number]:
                assert not one.overlaps(other)
        for name in ("Reliefscope", "Laboratory"):
            assert shown(name).scroll_max.x == 0.0

    ui.run(steps)
