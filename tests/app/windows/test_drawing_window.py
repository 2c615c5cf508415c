"""Every widget of the panel and every key does what it says, driven by Dear ImGui's test engine."""

from __future__ import annotations

import dataclasses

import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from app.places.framing import FRAME_PITCH_DEG
from app.viewer import gui
from app.viewer.keys import HELD, bindings
from app.windows.drawing import figures
from terrain.renderers import RENDERERS
from terrain.views import VIEWS

PANEL = "//Reliefscope"
CLEAR_OF_PANEL = (800.0, 200.0)


@pytest.fixture
def ui(session):
    with UiHarness(session) as harness:
        yield harness


def clear_focus(ctx):
    """The mouse over the scene, no widget active."""
    ctx.mouse_move_to_pos(CLEAR_OF_PANEL)


@pytest.mark.parametrize("name", RENDERERS)
def test_algorithm_is_chosen_in_the_list(ui, name):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.combo_click(f"##Algorithm/{RENDERERS[name].title}")
        assert ui.session.algorithm == name

    ui.run(steps)


def test_every_view_is_chosen_in_the_list(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        for number, (name, view) in reversed(list(enumerate(VIEWS.items(), 1))):
            ctx.combo_click(f"##View/{view.title}  (F{number})")
            assert ui.session.view == name

    ui.run(steps)


@pytest.mark.parametrize("name", RENDERERS)
def test_every_setting_of_an_algorithm_has_a_widget_that_changes_it(ui, name):
    ui.session.algorithms.choose(name)

    def steps(ctx):
        ctx.set_ref(PANEL)
        tolerance, *own = dataclasses.fields(ui.session.settings)
        change_widget(ctx, tolerance, lambda: ui.session.settings)
        if own:
            ctx.item_open("Settings of this algorithm")
        for field in own:
            change_widget(ctx, field, lambda: ui.session.settings)

    ui.run(steps)


def test_every_setting_of_the_look_has_a_widget_that_changes_it(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_open("Look")
        for field in dataclasses.fields(ui.session.stage.look):
            change_widget(ctx, field, lambda: ui.session.stage.look)

    ui.run(steps)


@pytest.mark.parametrize("name", RENDERERS)
def test_no_widget_covers_its_label(ui, name):
    ui.session.algorithms.choose(name)

    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_open("Settings of this algorithm") if len(dataclasses.fields(ui.session.settings)) > 1 else None
        ctx.item_open("Look")
        left = ctx.window_info(PANEL).window.dc.cursor_start_pos.x
        for field in (*dataclasses.fields(ui.session.settings), *dataclasses.fields(ui.session.stage.look)):
            label = field.metadata["label"]
            widget = ctx.item_info(f"##{label}").rect_full.min.x
            assert widget >= left + imgui.calc_text_size(label).x, label

    ui.run(steps)


def change_widget(ctx, field, settings):
    """Operate the widget of one field, and see the field change to what was put in."""
    label, choices, limits = (field.metadata[key] for key in ("label", "choices", "range"))
    before = getattr(settings(), field.name)
    item = f"##{label}"
    if choices is not None:
        wanted = next(choice for choice in choices if choice != before)
        unit = field.metadata["unit"]
        ctx.combo_click(f"{item}/{wanted}{f' {unit}' if unit else ''}")
    elif isinstance(before, bool):
        wanted = not before
        ctx.item_click(item)
    else:
        wanted = type(before)(limits[0] + 0.25 * (limits[1] - limits[0]))
        wanted = wanted if wanted != before else type(before)(limits[1])
        ctx.item_input_value(item, wanted)
        ctx.yield_(3)
    assert getattr(settings(), field.name) == pytest.approx(wanted), field.name


def test_typed_numbers_stay_within_the_range(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_input_value("##Tolerance", 1e6)
        assert ui.session.settings.tolerance_px == 16.0

    ui.run(steps)


def test_tolerance_goes_along_when_the_algorithm_changes(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_input_value("##Tolerance", 3.0)
        for name, kind in RENDERERS.items():
            ctx.combo_click(f"##Algorithm/{kind.title}")
            assert (ui.session.algorithm, ui.session.settings.tolerance_px) == (name, 3.0)

    ui.run(steps)


def test_exaggeration_keeps_the_height_above_ground(ui):
    before_m = ui.session.height_above_ground_m

    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_open("Look")
        ctx.item_input_value("##Exaggeration", 3.0)
        ctx.yield_(3)

    ui.run(steps)
    assert ui.session.heightfield.height_range_m[1] == pytest.approx(120.0)
    assert ui.session.height_above_ground_m == pytest.approx(before_m)


def test_dear_settings_are_applied_when_the_mouse_lets_go(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_open("Look")
        ctx.mouse_move("##Exaggeration")
        ctx.mouse_down(0)
        ctx.mouse_move_to_pos((300.0, imgui.get_io().mouse_pos.y))
        ctx.yield_(2)
        assert ui.session.heightfield.exaggeration == 1.0
        ctx.mouse_up(0)
        ctx.yield_(2)
        assert ui.session.heightfield.exaggeration > 1.0

    ui.run(steps)


def test_freeze_checkbox_freezes_and_lets_go(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_check("##Freeze")
        assert ui.session.stage.frozen is not None
        ctx.item_uncheck("##Freeze")
        assert ui.session.stage.frozen is None

    ui.run(steps)


def test_buttons_do_what_they_say(ui, tmp_path):
    def steps(ctx):
        ctx.set_ref(PANEL)
        ctx.item_click("Record")
        assert ui.session.flights.recorder is not None
        ctx.item_click("Stop")
        assert ui.session.flights.recorder is None
        assert len(list(tmp_path.glob("*.flight.json"))) == 1
        ctx.item_click("Play")
        assert ui.session.flights.is_playing
        ctx.item_click("Pause")
        assert not ui.session.flights.is_playing
        ctx.item_click("Picture")
        assert len(list(tmp_path.glob("*.png"))) == 1
        ctx.item_click("Home")
        assert ui.session.camera.pitch_deg == pytest.approx(FRAME_PITCH_DEG)
        ctx.item_click("Keys")
        assert ui.session.layout.shows_help

    ui.run(steps)


def test_every_pressed_key_acts_once(ui, tmp_path):
    seen = []
    keyed = [binding for binding in bindings() if binding.key]
    watched = tuple(binding._replace(act=lambda session, key=binding.key: seen.append(key)) for binding in keyed)

    def steps(ctx):
        clear_focus(ctx)
        for binding in watched:
            key = gui.key_named(binding.key.removeprefix(gui.CTRL))
            ctx.key_press(key | imgui.Key.mod_ctrl if binding.key.startswith(gui.CTRL) else key)
            ctx.yield_(2)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gui, "bindings", lambda: watched)
        ui.run(steps)
    assert seen == [binding.key for binding in watched]


def test_digits_choose_algorithms_and_function_keys_choose_views(ui):
    def steps(ctx):
        clear_focus(ctx)
        for digit, name in reversed(list(enumerate(RENDERERS))):
            ctx.key_press(gui.key_named(str(digit)))
            ctx.yield_()
            assert ui.session.algorithm == name
        for number, name in reversed(list(enumerate(VIEWS, 1))):
            ctx.key_press(gui.key_named(f"F{number}"))
            ctx.yield_()
            assert ui.session.view == name

    ui.run(steps)


def test_keys_freeze_record_play_save_frame_and_help(ui, tmp_path):
    session = ui.session

    def steps(ctx):
        def press(key):
            ctx.key_press(gui.key_named(key))
            ctx.yield_()

        clear_focus(ctx)
        press("F")
        assert session.stage.frozen is not None
        press("F")
        assert session.stage.frozen is None
        press("R")
        ctx.yield_(10)
        press("R")
        assert len(list(tmp_path.glob("*.flight.json"))) == 1
        press("P")
        assert session.flights.is_playing
        press("Escape")
        assert not session.flights.is_playing
        press("F12")
        press("F12")
        assert len(list(tmp_path.glob("*.png"))) == 2
        press("Home")
        assert session.camera.pitch_deg == pytest.approx(FRAME_PITCH_DEG)
        press("H")
        assert session.layout.shows_help
        press("Escape")
        assert not session.layout.shows_help
        press("T")
        assert not session.layout.is_open("drawing")
        press("T")
        assert session.layout.is_open("drawing")
        press("Q")
        assert not session.is_leaving
        ctx.key_press(imgui.Key.mod_ctrl | imgui.Key.q)
        assert session.is_leaving

    ui.run(steps)


@pytest.mark.parametrize(
    ("name", "sign", "key"), [(n, s, k) for n, (p, m, _) in HELD.items() for s, k in ((1, p), (-1, m))]
)
def test_held_keys_fly_and_shift_flies_faster(ui, name, sign, key):
    def travelled(ctx):
        before = ui.session.camera.eye_m
        ctx.key_down(gui.key_named(key))
        ctx.yield_(6)
        assert getattr(gui.read_inputs(), name) == sign
        ctx.key_up(gui.key_named(key))
        ctx.yield_(90)
        assert ui.session.motion.at_rest
        return abs(ui.session.camera.eye_m - before).max()

    def steps(ctx):
        clear_focus(ctx)
        ui.session.camera = dataclasses.replace(ui.session.camera, position_m=(1e3, 1e5, 1e3))
        plain = travelled(ctx)
        ctx.key_down(imgui.Key.mod_shift)
        assert travelled(ctx) > 2.0 * plain > 0.0
        ctx.key_up(imgui.Key.mod_shift)

    ui.run(steps)


def test_losing_the_focus_with_a_key_held_stops(ui):
    def steps(ctx):
        clear_focus(ctx)
        ctx.key_down(imgui.Key.w)
        ctx.yield_(6)
        assert not ui.session.motion.at_rest
        ui.focused = False
        ctx.yield_(2)
        assert ui.session.motion.at_rest
        ctx.key_up(imgui.Key.w)

    ui.run(steps)


def test_dragging_the_scene_looks_around_and_dragging_the_panel_does_not(ui):
    session = ui.session

    def steps(ctx):
        before = session.camera
        ctx.mouse_move_to_pos(CLEAR_OF_PANEL)
        ctx.mouse_down(0)
        ctx.mouse_move_to_pos((900.0, 260.0))
        ctx.mouse_up(0)
        ctx.yield_(2)
        assert session.camera.yaw_deg > before.yaw_deg
        assert session.camera.pitch_deg < before.pitch_deg
        before = session.camera
        ctx.mouse_move(f"{PANEL}/##Tolerance")
        ctx.mouse_down(0)
        ctx.mouse_move_to_pos(CLEAR_OF_PANEL)
        ctx.mouse_up(0)
        ctx.yield_(2)
        assert session.camera == before

    ui.run(steps)


def test_travel_to_where_a_drag_begins_does_not_turn_the_view(ui):
    before = ui.session.camera
    io = imgui.get_io()
    for x in (500.0, 900.0):
        io.add_mouse_pos_event(x, 300.0)
        io.add_mouse_button_event(0, x > 500.0)
        ui.frame()
    ui.frame()
    assert ui.session.camera == before


def test_wheel_changes_the_speed_over_the_scene_only(ui):
    def steps(ctx):
        pace = ui.session.motion.speed_factor
        ctx.mouse_move(f"{PANEL}/##Tolerance")
        ctx.mouse_wheel_y(1.0)
        ctx.yield_(2)
        assert ui.session.motion.speed_factor == pace
        clear_focus(ctx)
        ctx.mouse_wheel_y(1.0)
        ctx.yield_(2)
        assert ui.session.motion.speed_factor > pace

    ui.run(steps)


def test_typing_a_number_does_not_fly_or_choose(ui):
    session = ui.session

    def steps(ctx):
        ctx.set_ref(PANEL)
        before = session.camera, session.algorithm
        ctx.item_input("##Tolerance")
        ctx.key_chars("0")
        ctx.key_down(imgui.Key.w)
        ctx.key_press(imgui.Key._0)
        ctx.yield_(6)
        ctx.key_up(imgui.Key.w)
        ctx.key_press(imgui.Key.enter)
        assert (session.camera, session.algorithm) == before

    ui.run(steps)


def test_replay_stops_when_one_flies(ui):
    def steps(ctx):
        clear_focus(ctx)
        ctx.key_press(imgui.Key.p)
        ctx.yield_(5)
        assert ui.session.flights.time_s > 0.0
        ctx.key_down(imgui.Key.d)
        ctx.yield_(3)
        ctx.key_up(imgui.Key.d)
        assert not ui.session.flights.is_playing

    ui.run(steps)


def test_speed_section_closes_and_opens(ui):
    def steps(ctx):
        ctx.set_ref(PANEL)
        assert ctx.item_exists("figures") or ctx.item_is_opened("Speed")
        ctx.item_close("Speed")
        assert not ctx.item_is_opened("Speed")
        ctx.item_open("Speed")

    ui.run(steps)


def test_figures_show_what_was_measured_and_nothing_else(session):
    session.stats.slices, session.stats.gpu_ms = None, 1.25
    shown = dict(figures(session))
    assert shown["GPU"] == "1.25 ms"
    assert "slices" not in shown


def test_picture_has_the_resolution_of_the_framebuffer(ui):
    show_picture_at(ui, (100.0, 60.0), 2.0)
    assert ui.session.picture.size_px == (200, 120)


def test_a_window_without_area_keeps_the_last_picture(ui):
    show_picture_at(ui, (100.0, 60.0), 1.0)
    show_picture_at(ui, (0.0, 0.0), 1.0)
    assert ui.session.picture.size_px == (100, 60)


def show_picture_at(ui, display_size, scale):
    """One frame with the scene behind the panel, in a window of this size."""
    io = imgui.get_io()
    io.display_size, io.display_framebuffer_scale = display_size, (scale, scale)
    ui.frame(gui.show_picture)
