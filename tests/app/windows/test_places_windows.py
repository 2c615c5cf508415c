"""Mouse, keys and widgets of cameras, places and survey, driven by Dear ImGui's test engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from app.flying.cameras import PASSAGE_S, pointer_at
from app.flying.controls import Inputs
from app.session.navigation import MODES
from app.session.preferences import PreferenceFile
from app.viewer import gui
from app.viewer.keys import LOOKED
from app.windows.survey import point_rows
from terrain.heightfield import Georeference

PLACES, SURVEY = "//Places", "//Survey"
ASPECT = 64 / 36
HERE, THERE = (560.0, 520.0), (760.0, 560.0)  # on the ground, between the docked windows


@pytest.fixture
def ui(session, tmp_path):
    session.preferences = PreferenceFile(tmp_path / "config")
    session.camera = replace(session.camera, pitch_deg=-25.0)
    with UiHarness(session) as harness:
        yield harness


def spot_at(session, pixel):
    point = session.navigation.point_under((pixel[0] / 1280.0, pixel[1] / 720.0))
    return float(point[0]), float(point[2])


def open_window(ui, name):
    ui.session.layout.show(name)
    for _ in range(3):
        ui.frame()


def drag(ctx, start, end, button=0):
    ctx.mouse_move_to_pos(start)
    ctx.mouse_down(button)
    ctx.yield_()
    ctx.mouse_move_to_pos(end)
    ctx.yield_()
    ctx.mouse_up(button)
    ctx.yield_(2)


# The scene


def test_a_click_picks_and_a_drag_does_not(ui):
    session = ui.session

    def steps(ctx):
        drag(ctx, HERE, THERE)
        assert session.survey.spot_m is None
        expected = spot_at(session, HERE)
        ctx.mouse_move_to_pos(HERE)
        ctx.mouse_click(0)
        ctx.yield_(2)
        assert session.survey.spot_m == pytest.approx(expected, abs=1e-3)
        assert session.layout.is_open("survey")
        ctx.mouse_move("//Reliefscope/##Tolerance")
        ctx.mouse_click(0)
        ctx.yield_(2)
        assert session.survey.spot_m == pytest.approx(expected, abs=1e-3)

    ui.run(steps)


def test_a_double_click_flies_there_and_picks_once(ui):
    session = ui.session

    def steps(ctx):
        x, z = spot_at(session, HERE)
        ctx.mouse_move_to_pos(HERE)
        ctx.mouse_double_click(0)
        ctx.yield_(2)
        assert session.navigation.passage is not None
        assert session.survey.spot_m == pytest.approx((x, z), abs=1e-3)
        session.advance(Inputs(), PASSAGE_S)
        point = np.array([x, float(session.heightfield.heights_at(x, z)), z])
        assert pointer_at(session.camera, point, ASPECT) == pytest.approx((0.5, 0.5), abs=1e-3)

    ui.run(steps)


def test_a_trembling_hand_does_not_break_off_the_flight_of_a_double_click(ui):
    io = imgui.get_io()
    io.add_mouse_pos_event(*HERE)
    for is_down, travel in ((True, 0.0), (False, 0.0), (True, 0.0), (True, 2.0), (True, -1.0), (False, 1.0)):
        io.add_mouse_pos_event(HERE[0] + travel, HERE[1])
        io.add_mouse_button_event(0, is_down)
        ui.frame()
    assert ui.session.navigation.passage is not None
    assert ui.session.survey.spot_m is not None
    for travel in (0.0, 4.0):
        io.add_mouse_pos_event(HERE[0] + travel, HERE[1])
        io.add_mouse_button_event(0, True)
        ui.frame()
    assert ui.session.navigation.passage is None


def test_orbiting_drags_turn_and_move_what_is_below_the_mouse(ui):
    session = ui.session
    session.navigation.choose_mode("orbit")

    def steps(ctx):
        x, z = spot_at(session, HERE)
        point = np.array([x, float(session.heightfield.heights_at(x, z)), z])
        before = session.camera
        drag(ctx, HERE, THERE)
        assert session.camera.yaw_deg > before.yaw_deg
        assert pointer_at(session.camera, point, ASPECT) == pytest.approx((HERE[0] / 1280, HERE[1] / 720), abs=1e-3)
        x, z = spot_at(session, HERE)
        point = np.array([x, float(session.heightfield.heights_at(x, z)), z])
        yaw = session.camera.yaw_deg
        drag(ctx, HERE, THERE, 1)
        assert session.camera.yaw_deg == yaw
        assert pointer_at(session.camera, point, ASPECT) == pytest.approx((THERE[0] / 1280, THERE[1] / 720), abs=1e-3)
        distance = np.linalg.norm(session.camera.eye_m - point)
        pace = session.motion.speed_factor
        ctx.mouse_wheel_y(1.0)
        session.advance(Inputs(), 1.0)
        assert np.linalg.norm(session.camera.eye_m - point) == pytest.approx(distance / 1.25, rel=1e-2)
        assert session.motion.speed_factor == pace

    ui.run(steps)


def test_arrow_keys_look_around_unless_a_window_has_the_keyboard(ui):
    session = ui.session
    arrows = [(name, sign, key) for name, (plus, minus, _) in LOOKED.items() for sign, key in ((1, plus), (-1, minus))]

    def steps(ctx):
        def turned_by(key):
            before = session.camera
            ctx.key_down(gui.key_named(key))
            ctx.yield_(6)
            ctx.key_up(gui.key_named(key))
            ctx.yield_(2)
            after = session.camera
            return {"turn": after.yaw_deg - before.yaw_deg, "tilt": after.pitch_deg - before.pitch_deg}

        ctx.mouse_move_to_pos(HERE)
        ctx.mouse_click(0)  # the scene has the keyboard
        ctx.yield_(2)
        for name, sign, key in arrows:
            assert sign * turned_by(key)[name] > 0.5
        ctx.item_click("//Reliefscope/##Freeze")
        ctx.item_click("//Reliefscope/##Freeze")
        for _, _, key in arrows:
            assert turned_by(key) == {"turn": 0.0, "tilt": 0.0}

    ui.run(steps)


def test_measuring_drags_a_line_instead_of_turning_the_view(ui):
    session = ui.session

    def steps(ctx):
        ctx.mouse_move_to_pos(HERE)
        ctx.key_press(imgui.Key.m)
        ctx.yield_(2)
        before, expected = session.camera, [spot_at(session, HERE), spot_at(session, THERE)]
        drag(ctx, HERE, THERE)
        assert session.camera == before
        assert np.array(session.survey.ends_m) == pytest.approx(np.array(expected), abs=1e-3)
        assert session.survey.profile is not None
        ctx.key_press(imgui.Key.m)
        ctx.yield_(2)
        drag(ctx, HERE, THERE)
        assert session.camera != before

    ui.run(steps)


def test_every_key_of_cameras_and_places_does_what_it_says(ui):
    session = ui.session
    navigation, survey, places = session.navigation, session.survey, session.places

    def steps(ctx):
        def press(key):
            ctx.key_press(gui.key_named(key))
            ctx.yield_(2)

        ctx.mouse_move_to_pos(HERE)
        press("I")
        assert survey.spot_m == pytest.approx(spot_at(session, (640.0, 360.0)))
        press("J")
        assert navigation.passage is not None
        press("B")
        assert [b.name for b in places.bookmarks.all] == ["View 1"]
        session.advance(Inputs(), PASSAGE_S)
        press("N")
        assert navigation.passage is not None
        press("C")
        assert navigation.mode == "orbit"
        press("X")
        assert not navigation.collides
        press("M")
        assert survey.is_measuring
        press("Escape")
        assert not survey.is_measuring
        for key, name in (("V", "survey"), ("G", "places")):
            before = session.layout.is_open(name)
            press(key)
            assert session.layout.is_open(name) != before

    ui.run(steps)


# The window of places


def test_cameras_are_chosen_in_the_window(ui):
    open_window(ui, "places")

    def steps(ctx):
        ctx.set_ref(PLACES)
        for mode in ("walk", "orbit", "fly"):
            ctx.item_click(mode.capitalize())
            assert ui.session.navigation.mode == mode
        assert set(MODES) == {"fly", "orbit", "walk"}
        ctx.item_uncheck("Stop at the ground")
        assert not ui.session.navigation.collides
        ctx.item_check("Stop at the ground")
        assert ui.session.navigation.collides

    ui.run(steps)


def test_coordinates_are_typed_and_gone_to(ui):
    session = ui.session
    open_window(ui, "places")

    def steps(ctx):
        ctx.set_ref(PLACES)
        ctx.item_input_value("##Coordinate", "99999, 1")
        ctx.item_click("Go")
        assert "beside the terrain" in session.places.problem
        assert session.navigation.passage is None
        ctx.item_input("##Coordinate")
        ctx.key_chars_replace("100, 200")
        ctx.key_press(imgui.Key.enter)
        ctx.yield_(2)
        assert session.places.problem == ""
        assert session.survey.spot_m == (100.0, 200.0)
        assert session.navigation.passage is not None

    ui.run(steps)


def test_a_coordinate_is_gone_to_with_the_keyboard_alone(ui):
    session = ui.session
    session.layout.show("laboratory")

    def steps(ctx):
        ctx.yield_(3)
        ctx.mouse_move_to_pos(HERE)
        ctx.key_press(imgui.Key.g)
        ctx.yield_(4)
        ctx.key_chars("30, 40")
        ctx.key_press(imgui.Key.enter)
        ctx.yield_(2)
        assert session.survey.spot_m == (30.0, 40.0)
        assert session.navigation.passage is not None
        assert not imgui.internal.find_window_by_name("Places").hidden

    ui.run(steps)


def test_a_click_shows_the_survey_before_what_shares_its_place(ui):
    session = ui.session

    def steps(ctx):
        for name in ("survey", "places"):
            session.layout.show(name)
            ctx.yield_(3)
        assert imgui.internal.find_window_by_name("Survey").hidden
        ctx.mouse_move_to_pos(HERE)
        ctx.mouse_click(0)
        ctx.yield_(3)
        assert not imgui.internal.find_window_by_name("Survey").hidden

    ui.run(steps)


def test_the_system_of_coordinates_is_chosen_where_the_terrain_knows_several(ui):
    session = ui.session
    terrain = replace(session.heightfield, georeference=Georeference("EPSG:32611", (10.0, 0, 26e4, 0, -10.0, 419e4)))
    session.places.coordinates._terrain = terrain
    open_window(ui, "places")

    def steps(ctx):
        ctx.set_ref(PLACES)
        ctx.combo_click("##System/map: x, y")
        assert session.places.system == "map"
        ctx.item_input_value("##Coordinate", "260100, 4189900")
        ctx.item_click("Go")
        assert session.survey.spot_m == pytest.approx((100.0, 100.0))
        ctx.combo_click("##System/latitude, longitude")
        assert session.places.system == "latlon"

    ui.run(steps)


def test_bookmarks_are_kept_named_visited_and_deleted_in_the_window(ui):
    session = ui.session
    open_window(ui, "places")

    def steps(ctx):
        ctx.set_ref(PLACES)
        for _ in range(2):
            ctx.item_click("Keep this view")
        ctx.yield_(2)
        ctx.item_input("View 1/##Name")
        ctx.key_chars_replace("the pass")
        ctx.key_press(imgui.Key.enter)
        ctx.yield_(3)
        assert [b.name for b in session.places.bookmarks.all] == ["the pass", "View 2"]
        ctx.item_click("the pass/Go")
        assert session.navigation.passage is not None
        ctx.item_click("View 2/Delete")
        ctx.yield_(2)
        assert [b.name for b in session.places.bookmarks.all] == ["the pass"]

    ui.run(steps)


# The window of the survey


def test_the_picked_point_is_copied_flown_to_and_forgotten(ui):
    session = ui.session
    session.survey.pick_at((160.0, 200.0))
    open_window(ui, "survey")

    def steps(ctx):
        ctx.set_ref(SURVEY)
        ctx.item_click("Copy")
        told = imgui.get_clipboard_text()
        for name, value in point_rows(session.survey.point, session.survey.coordinates):
            assert f"{name}: {value}" in told
        ctx.item_click("Fly there")
        assert session.navigation.passage is not None
        ctx.item_click("Forget")
        assert session.survey.spot_m is None

    ui.run(steps)


def test_the_profile_is_drawn_saved_pointed_at_and_cleared(ui, tmp_path):
    survey = ui.session.survey
    open_window(ui, "survey")

    def steps(ctx):
        ctx.set_ref(SURVEY)
        ctx.item_check("Measure")
        assert survey.is_measuring
        drag(ctx, HERE, THERE)
        ctx.item_uncheck("Measure")
        assert not survey.is_measuring
        plot = ctx.item_info("##Profile").rect_full
        ctx.mouse_move_to_pos((plot.min.x + 0.6 * plot.get_width(), plot.min.y + 0.4 * plot.get_height()))
        ctx.yield_(2)
        assert 0.0 < survey.hover_m < survey.profile.length_m
        ctx.mouse_move_to_pos(HERE)
        ctx.yield_(2)
        assert survey.hover_m is None
        ctx.item_click("Save CSV")
        assert [p.name for p in tmp_path.glob("*.csv")] == ["hills-profile-1.csv"]
        ctx.item_click("Clear")
        assert survey.profile is None

    ui.run(steps)


def test_nothing_is_cut_off_in_the_windows(ui):
    survey = ui.session.survey
    survey.pick_at((160.0, 200.0))
    survey.ends_m = [(10.0, 10.0), (300.0, 220.0)]
    survey._measure()
    ui.session.places.keep_view()
    for name, title in (("survey", "Survey"), ("places", "Places")):
        open_window(ui, name)
        window = imgui.internal.find_window_by_name(title)
        assert window.active
        assert not window.hidden
        assert window.content_size.x <= window.size.x
        assert window.scroll_max.y == 0.0
