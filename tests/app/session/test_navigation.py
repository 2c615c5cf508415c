"""Ways to move in a session: what the mouse holds stays below it, the ground stops the eye, passages can be broken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.flying.cameras import EYE_HEIGHT_M, PASSAGE_S, pointer_at
from app.flying.controls import Inputs
from app.opening.drawing import Drawing
from app.places.bookmarks import Bookmark
from app.places.framing import ground_m, least_clearance_m
from app.session.places import Places
from app.session.preferences import PreferenceFile
from app.session.session import Session
from terrain.camera import Camera
from terrain.renderers import RENDERERS
from terrain.textures.layers import LayerStack
from terrain.textures.look import LookSettings

ASPECT = 64 / 36
GROUND = (0.45, 0.8)  # a place in the picture with ground below it
NOTHING = Inputs()


def advance(session, inputs=NOTHING, seconds=1 / 60, fps=60):
    for _ in range(max(1, round(seconds * fps))):
        session.advance(inputs, 1 / fps)


def height_m(session):
    return session.height_above_ground_m


def test_the_point_under_the_mouse_is_what_the_picture_shows_there(session):
    session.draw((64, 36))
    positions = session.stage.positions(session.camera, (64, 36))
    for row, col in ((30, 20), (25, 50), (34, 5)):
        pointer = (col + 0.5) / 64, (row + 0.5) / 36
        found = session.navigation.point_under(pointer)
        assert found == pytest.approx(positions[row, col], abs=0.3)
    assert session.navigation.point_under((0.5, 0.01)) is None


def test_orbit_holds_the_point_under_the_mouse(session):
    session.navigation.choose_mode("orbit")
    point = session.navigation.point_under(GROUND)
    advance(session, Inputs(button="left", pointer=GROUND))
    for travel in ((8.0, -3.0), (-4.0, 6.0)):
        advance(session, Inputs(button="left", pointer=GROUND, look_px=travel))
        assert pointer_at(session.camera, point, ASPECT) == pytest.approx(GROUND, abs=1e-6)
    advance(session)
    before = session.camera
    advance(session, Inputs(button="right", pointer=GROUND))
    point = session.navigation.point_under(GROUND)
    advance(session, Inputs(button="right", pointer=(0.5, 0.75)))
    assert pointer_at(session.camera, point, ASPECT) == pytest.approx((0.5, 0.75), abs=1e-6)
    assert session.camera.yaw_deg == before.yaw_deg
    advance(session)
    point = session.navigation.point_under(GROUND)
    distance = np.linalg.norm(point - session.camera.eye_m)
    advance(session, Inputs(wheel=2.0, pointer=GROUND))
    advance(session, seconds=2.0)
    assert pointer_at(session.camera, point, ASPECT) == pytest.approx(GROUND, abs=1e-6)
    assert np.linalg.norm(point - session.camera.eye_m) == pytest.approx(distance / 1.25**2, rel=1e-3)
    assert not session.navigation.is_moving


@pytest.mark.parametrize("fps", [15, 144])
def test_a_zoom_comes_equally_near_at_any_frame_rate(session, fps):
    session.navigation.choose_mode("orbit")
    point = session.navigation.point_under(GROUND)
    distance = np.linalg.norm(point - session.camera.eye_m)
    session.advance(Inputs(wheel=1.0, pointer=GROUND), 1 / fps)
    advance(session, seconds=2.0, fps=fps)
    assert np.linalg.norm(point - session.camera.eye_m) == pytest.approx(distance / 1.25, rel=1e-4)


def test_a_zoom_under_way_is_equally_near_at_any_frame_rate(session):
    session.navigation.choose_mode("orbit")
    start, eyes = session.camera, []
    for fps in (20, 100):
        session.camera = start
        session.navigation.rest()
        session.advance(Inputs(wheel=1.0, pointer=GROUND), 1 / fps)
        advance(session, seconds=0.1 - 1 / fps, fps=fps)
        eyes.append(session.camera.eye_m)
        assert session.navigation.is_moving
    assert np.linalg.norm(eyes[0] - eyes[1]) < 1e-3 * np.linalg.norm(eyes[0] - start.eye_m)


def test_orbiting_over_the_sky_turns_about_a_point_as_far_as_the_terrain(session):
    session.navigation.choose_mode("orbit")
    before = session.camera
    advance(session, Inputs(button="left", pointer=(0.5, 0.01)))
    advance(session, Inputs(button="left", pointer=(0.5, 0.01), look_px=(20.0, 0.0)))
    assert session.camera.position_m != before.position_m


def test_orbiting_with_keys_turns_about_the_middle_of_the_picture(session):
    session.navigation.choose_mode("orbit")
    session.camera = replace(session.camera, pitch_deg=-30.0)
    point = session.navigation.point_under()
    advance(session, Inputs(right=1.0), 0.3)
    assert pointer_at(session.camera, point, ASPECT) == pytest.approx((0.5, 0.5), abs=1e-6)
    advance(session, seconds=1.5)
    assert session.motion.at_rest


def test_losing_the_keyboard_stops_an_orbit(session):
    session.navigation.choose_mode("orbit")
    advance(session, Inputs(wheel=3.0, pointer=GROUND))
    advance(session, replace(NOTHING, focused=False))
    before = session.camera
    advance(session, seconds=0.5)
    assert session.camera == before


def test_walking_begins_on_the_ground_and_follows_it(session):
    session.navigation.choose_mode("walk")
    advance(session, seconds=PASSAGE_S + 0.1)
    assert height_m(session) == pytest.approx(EYE_HEIGHT_M)
    start = session.camera.eye_m
    for _ in range(60):
        advance(session, Inputs(forward=1.0, fast=True))
        assert height_m(session) == pytest.approx(EYE_HEIGHT_M)
    assert np.linalg.norm(session.camera.eye_m - start) > 5.0
    session.exaggerate(3.0)
    advance(session)
    assert height_m(session) == pytest.approx(3.0 * EYE_HEIGHT_M)


def test_walking_from_beside_the_terrain_begins_at_its_rim(session):
    session.camera = Camera((-500.0, 300.0, 100.0), pitch_deg=-20.0)
    session.navigation.choose_mode("walk")
    advance(session, seconds=PASSAGE_S + 0.1)
    assert session.camera.position_m[0] == 0.0
    assert height_m(session) == pytest.approx(EYE_HEIGHT_M)


@pytest.mark.parametrize("leave", [lambda s: s.frame_all(), lambda s: s.flights.toggle_playing()])
def test_walking_ends_when_something_else_takes_the_camera(session, leave):
    session.navigation.choose_mode("walk")
    leave(session)
    advance(session)
    assert session.navigation.mode == "fly"
    assert session.navigation.passage is None
    assert height_m(session) > 2.0 * EYE_HEIGHT_M


def test_the_ground_stops_the_eye_until_it_may_pass(session):
    down, navigation = Inputs(up=-1.0, fast=True), session.navigation
    least = least_clearance_m(session.heightfield)
    advance(session, down, 3.0)
    assert height_m(session) == pytest.approx(least)
    navigation.toggle_collision()
    advance(session, down, 1.0)
    assert height_m(session) < 0.0
    navigation.choose_mode("orbit")
    navigation.choose_mode("fly")
    assert height_m(session) < 0.0
    navigation.toggle_collision()
    assert height_m(session) == pytest.approx(least)


def test_modes_go_round(session):
    seen = []
    for _ in range(3):
        session.navigation.next_mode()
        seen.append(session.navigation.mode)
    assert seen == ["orbit", "walk", "fly"]


def test_a_double_click_flies_to_the_point_softly(session):
    point = session.navigation.point_under(GROUND)
    before = session.camera
    advance(session, Inputs(double_clicked=True, pointer=GROUND))
    assert np.linalg.norm(session.camera.eye_m - before.eye_m) < 0.1
    assert not session.is_still
    advance(session, seconds=PASSAGE_S + 0.1)
    assert not session.navigation.is_moving
    middle = pointer_at(session.camera, point, ASPECT)
    assert middle == pytest.approx((0.5, 0.5), abs=1e-6) or height_m(session) < 5.0
    assert np.linalg.norm(session.camera.eye_m - point) < np.linalg.norm(before.eye_m - point)


@pytest.mark.parametrize("fps", [24, 144])
def test_passages_are_where_they_are_at_any_frame_rate(session, fps):
    goal = Camera((200.0, 120.0, 40.0), 200.0, -40.0)
    start = session.camera
    session.navigation.fly_to(goal)
    expected = session.navigation.passage.camera_at(0.5)
    advance(session, seconds=0.5, fps=fps)
    assert session.camera.position_m == pytest.approx(expected.position_m)
    assert session.camera.position_m != start.position_m


@pytest.mark.parametrize("hand", [Inputs(forward=1.0), Inputs(look_px=(3.0, 0.0)), Inputs(wheel=1.0), Inputs(turn=0.5)])
def test_any_motion_breaks_a_passage(session, hand):
    session.navigation.fly_to(Camera((200.0, 120.0, 40.0), 200.0, -40.0))
    advance(session, seconds=0.6)
    before = session.camera
    advance(session, hand)
    assert session.navigation.passage is None
    assert np.linalg.norm(session.camera.eye_m - before.eye_m) < 5.0


def test_a_double_click_into_the_sky_says_so_and_stays(session):
    before = session.camera
    advance(session, Inputs(double_clicked=True, pointer=(0.5, 0.01)))
    assert "no ground" in session.message
    assert session.camera == before


def test_a_double_click_while_walking_goes_to_the_point(session):
    session.navigation.choose_mode("walk")
    advance(session, seconds=PASSAGE_S + 0.1)
    session.camera = replace(session.camera, pitch_deg=-25.0)
    point = session.navigation.point_under()
    advance(session, Inputs(double_clicked=True, pointer=(0.5, 0.5)))
    advance(session, seconds=PASSAGE_S + 0.1)
    assert session.camera.eye_m == pytest.approx(point + np.array([0.0, EYE_HEIGHT_M, 0.0]))


def test_a_passage_ends_a_replay(session):
    session.flights.toggle_playing()
    advance(session, seconds=0.2)
    session.navigation.fly_to(Camera((200.0, 120.0, 40.0)))
    assert not session.flights.is_playing


# Places


def test_damaged_bookmarks_are_said_when_the_terrain_is_opened(app_gpu, session, tmp_path):
    Places(session, session.heightfield, tmp_path).bookmarks.add(Bookmark.of("a", session.camera, session.heightfield))
    (path,) = tmp_path.rglob("*.json")
    path.write_text("{")
    drawing = Drawing("reference", RENDERERS["reference"].Settings(), LookSettings(), "shaded", LayerStack(), 1.0)
    again = Session(app_gpu, session.heightfield, drawing, folder=tmp_path, preferences=PreferenceFile(tmp_path))
    try:
        assert "could not be understood" in again.message
    finally:
        again.close()


def test_typed_coordinates_are_flown_to_and_picked(session):
    places = session.places
    assert places.go_to("160, 240")
    advance(session, seconds=PASSAGE_S + 0.1)
    point = np.array([160.0, ground_m(session.heightfield, 160.0, 240.0), 240.0])
    assert pointer_at(session.camera, point, ASPECT) == pytest.approx((0.5, 0.5), abs=1e-6)
    assert session.survey.spot_m == (160.0, 240.0)


def test_what_is_no_coordinate_is_said_and_nothing_moves(session):
    before = session.camera
    assert not session.places.go_to("9999, 0")
    assert "320 m east" in session.places.problem
    assert session.navigation.passage is None
    assert session.camera == before
    assert session.places.go_to("10, 10")
    assert session.places.problem == ""


def test_bookmarks_are_visited_round_and_round(session):
    session.places.visit_next()
    assert "no bookmarks" in session.message
    views = [session.camera, replace(session.camera, yaw_deg=200.0), replace(session.camera, pitch_deg=-50.0)]
    for view in views:
        session.camera = view
        session.places.keep_view()
    for view in (*views, views[0]):
        session.places.visit_next()
        advance(session, seconds=PASSAGE_S + 0.1)
        assert session.camera.yaw_deg == pytest.approx(view.yaw_deg)
        assert session.camera.pitch_deg == pytest.approx(view.pitch_deg)
