"""Picking and measuring in a session: with the mouse, without it, over gaps, and on disk."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from app.flying.controls import Inputs
from app.places.coordinates import Coordinates
from app.places.picking import profile_between
from app.session.survey import Point, Survey, relief_at, write_profile
from app.windows.survey import line_rows, point_rows
from terrain.errors import InputError
from terrain.heightfield import Georeference, Heightfield

ONE, OTHER, SKY = (0.3, 0.8), (0.7, 0.75), (0.5, 0.01)
UTM = Georeference("EPSG:32611", (10.0, 0.0, 260000.0, 0.0, -10.0, 4190000.0))


def drag(session, start, end, steps=4):
    for share in np.linspace(0.0, 1.0, steps):
        pointer = tuple(np.array(start) + share * (np.array(end) - start))
        session.advance(Inputs(button="left", pointer=pointer, look_px=(5.0, 2.0) if share else (0.0, 0.0)), 1 / 60)
    session.advance(Inputs(pointer=end, clicked=start == end), 1 / 60)


def click(session, pointer):
    session.advance(Inputs(button="left", pointer=pointer), 1 / 60)
    session.advance(Inputs(pointer=pointer, clicked=True), 1 / 60)


def spot_under(session, pointer):
    point = session.navigation.point_under(pointer)
    return float(point[0]), float(point[2])


def test_a_click_picks_what_is_below_it_and_shows_it(session):
    before = session.camera
    click(session, ONE)
    survey = session.survey
    assert survey.spot_m == spot_under(session, ONE)
    assert session.layout.is_open("survey")
    assert session.camera == before
    height = float(session.heightfield.heights_at(*survey.spot_m))
    assert survey.point.relief.height_m == pytest.approx(height)
    click(session, SKY)
    assert survey.spot_m is None
    assert survey.point is None


def test_the_height_of_an_exaggerated_terrain_is_the_true_one(session):
    click(session, ONE)
    true_m = session.survey.point.relief.height_m
    session.exaggerate(4.0)
    assert session.survey.point.relief.height_m == pytest.approx(true_m, rel=1e-5)


def test_dragging_measures_only_with_the_tool(session):
    drag(session, ONE, OTHER)
    assert session.survey.ends_m == []
    session.survey.toggle_measuring()
    before = session.camera
    expected = [spot_under(session, ONE), spot_under(session, OTHER)]
    drag(session, ONE, OTHER)
    assert session.camera == before
    assert session.survey.ends_m == expected
    assert session.survey.profile.length_m == pytest.approx(np.hypot(*np.subtract(*expected)))
    session.advance(Inputs(button="right", pointer=ONE, look_px=(9.0, 0.0)), 1 / 60)
    assert session.camera.yaw_deg != before.yaw_deg
    session.survey.toggle_measuring()
    assert session.survey.profile is not None


def test_two_clicks_measure_too_and_a_third_begins_anew(session):
    session.survey.toggle_measuring()
    click(session, ONE)
    assert session.survey.ends_m == [spot_under(session, ONE)]
    assert session.survey.profile is None
    click(session, OTHER)
    assert session.survey.ends_m == [spot_under(session, ONE), spot_under(session, OTHER)]
    click(session, ONE)
    assert session.survey.ends_m == [spot_under(session, ONE)]


def test_a_click_that_trembles_marks_one_end(session):
    session.survey.toggle_measuring()
    drag(session, ONE, (ONE[0] + 0.002, ONE[1] - 0.002))
    assert session.survey.ends_m == [spot_under(session, ONE)]


def test_a_double_click_with_the_tool_flies_and_measures_nothing(session):
    session.survey.toggle_measuring()
    click(session, ONE)
    session.advance(Inputs(button="left", pointer=ONE, double_clicked=True), 1 / 60)
    session.advance(Inputs(button="left", pointer=ONE), 1 / 60)
    session.advance(Inputs(pointer=ONE), 1 / 60)
    assert session.survey.ends_m == []
    assert session.navigation.passage is not None


def test_no_line_is_drawn_across_a_gap(session):
    survey = session.survey
    survey.toggle_measuring()
    drag(session, ONE, OTHER)
    frame = session.stage.frame(session.camera, (64, 36))
    whole = survey._line_segments(frame, survey.profile)
    survey.profile.height_m[survey.profile.height_m.size // 2] = np.nan
    broken = survey._line_segments(frame, survey.profile)
    assert np.isfinite(broken).all()
    assert len(broken) == len(whole) - 2


def test_without_a_mouse_the_middle_is_picked_and_measured(session):
    survey = session.survey
    session.camera = replace(session.camera, pitch_deg=-30.0)
    survey.pick_middle()
    assert survey.spot_m == spot_under(session, (0.5, 0.5))
    survey.toggle_measuring()
    survey.pick_middle()
    session.camera = replace(session.camera, yaw_deg=60.0)
    survey.pick_middle()
    assert survey.profile.length_m > 1.0
    session.camera = replace(session.camera, pitch_deg=60.0)
    survey.pick_middle()
    assert "no ground" in session.message
    survey.toggle_measuring()
    survey.pick_middle()
    assert "no ground" in session.message


def test_a_drag_off_the_ground_keeps_the_last_end_on_it(session):
    session.survey.toggle_measuring()
    drag(session, ONE, OTHER)
    ends = session.survey.ends_m
    drag(session, ONE, SKY, 2)
    assert session.survey.ends_m[0] == ends[0]
    assert all(np.isfinite(end).all() for end in session.survey.ends_m)


def test_escape_takes_away_tool_line_and_point_in_turn(session):
    survey = session.survey
    click(session, ONE)
    survey.toggle_measuring()
    drag(session, ONE, OTHER)
    seen = []
    for _ in range(4):
        session.escape()
        seen.append((survey.is_measuring, bool(survey.ends_m), survey.spot_m is not None))
    assert seen == [(False, True, True), (False, False, True), (False, False, False), (False, False, False)]


def test_a_picked_point_is_flown_to(session):
    click(session, ONE)
    session.survey.fly_to_point()
    session.advance(Inputs(), 5.0)
    assert session.survey.spot_m == pytest.approx(spot_under(session, (0.5, 0.5)), abs=0.01)


def test_marks_are_drawn_into_the_picture(session):
    plain = session.draw((64, 36)).read().astype(int)
    session.survey.toggle_measuring()
    drag(session, ONE, OTHER)
    session.survey.hover(0.5 * session.survey.profile.length_m)
    click_spot = spot_under(session, (0.5, 0.9))
    session.survey.pick_at(click_spot)
    marked = session.draw((64, 36)).read().astype(int)
    changed = np.abs(marked - plain)[..., :3].sum(axis=2) > 60
    assert 10 < changed.sum() < 500
    _, cols = np.nonzero(changed)
    assert cols.min() >= 0.2 * 64
    assert cols.max() <= 0.8 * 64
    session.survey.forget_line()
    session.survey.pick_at(None)
    assert np.abs(session.draw((64, 36)).read().astype(int) - plain).max() <= 2


def test_a_terrain_read_again_keeps_what_was_asked_of_it(session):
    click(session, ONE)
    session.survey.toggle_measuring()
    drag(session, ONE, OTHER)
    survey = Survey(session)
    survey.take_over(session.survey)
    assert (survey.spot_m, survey.ends_m) == (session.survey.spot_m, session.survey.ends_m)
    assert survey.profile.length_m == session.survey.profile.length_m


# Figures


def test_figures_have_units_and_leave_out_what_is_not_known(hills):
    georeferenced = replace(hills, georeference=UTM)
    for terrain, names in ((hills, {"local"}), (georeferenced, {"local", "map", "lat, lon"})):
        coordinates = Coordinates(terrain)
        rows = dict(point_rows(Point(coordinates.place(100.0, 50.0), relief_at(terrain, 100.0, 50.0)), coordinates))
        assert set(rows) == names | {"height", "slope", "faces"}
        assert rows["local"] == "100.0 m E  50.0 m S"
    assert rows["map"] == "x 260,100.0 m  y 4,189,950.0 m"
    assert rows["lat, lon"].endswith("° W")
    assert rows["height"].endswith(" m")
    assert rows["slope"].endswith("°")


def test_lines_have_lengths_and_climbs(hills):
    rows = dict(line_rows(profile_between(hills, np.array([0.0, 0.0]), np.array([300.0, 0.0]))))
    assert rows["distance"] == "300.0 m"
    assert set(rows) == {"distance", "on the ground", "difference", "up, down"}
    assert rows["difference"][0] in "+-"


# On disk


def test_profiles_are_saved_as_tables_that_say_what_their_columns_are(hills, tmp_path):
    terrain = replace(hills, georeference=UTM)
    profile = profile_between(terrain, np.array([20.0, 40.0]), np.array([250.0, 90.0]))
    write_profile(profile, Coordinates(terrain), tmp_path / "p.csv")
    with (tmp_path / "p.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == profile.distance_m.size
    assert list(rows[0]) == [
        "distance_m", "height_m", "east_m", "south_m", "map_x", "map_y", "latitude_deg", "longitude_deg",
    ]  # fmt: skip
    heights = [float(row["height_m"]) for row in rows]
    expected = terrain.heights_at([float(r["east_m"]) for r in rows], [float(r["south_m"]) for r in rows])
    assert heights == pytest.approx(expected, abs=5e-3)
    assert float(rows[-1]["distance_m"]) == pytest.approx(np.hypot(230.0, 50.0), abs=1e-3)
    assert float(rows[0]["map_x"]) == pytest.approx(260020.0)
    assert float(rows[0]["map_y"]) == pytest.approx(4189960.0)
    with pytest.raises(InputError, match="exists already"):
        write_profile(profile, Coordinates(terrain), tmp_path / "p.csv")


def test_gaps_are_empty_cells(tmp_path):
    heights = np.full((9, 9), 5.0, np.float32)
    holes = np.zeros((9, 9), np.bool_)
    holes[:, 4] = True
    terrain = Heightfield(heights, (10.0, 10.0), holes)
    write_profile(profile_between(terrain, np.array([5.0, 20.0]), np.array([75.0, 25.0])), Coordinates(terrain),
                  tmp_path / "p.csv")  # fmt: skip
    with (tmp_path / "p.csv").open(newline="") as file:
        cells = [row["height_m"] for row in csv.DictReader(file)]
    assert "" in cells
    assert cells[0] == cells[-1] == "5.000"
    assert set(cells) == {"", "5.000"}


def test_saved_profiles_are_numbered_and_a_full_disk_is_said(session, tmp_path):
    session.survey.save_profile(tmp_path)
    assert not list(tmp_path.glob("*.csv"))
    session.survey.toggle_measuring()
    drag(session, ONE, OTHER)
    session.survey.save_profile(tmp_path)
    session.survey.save_profile(tmp_path)
    assert sorted(p.name for p in tmp_path.glob("*.csv")) == ["hills-profile-1.csv", "hills-profile-2.csv"]
    session.survey.save_profile(tmp_path / "gone")
    assert "gone" in session.message
