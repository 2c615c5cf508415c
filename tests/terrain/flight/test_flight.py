"""Flights: splines through keyframes, the file, the recorder, and tours that never touch the ground."""

from __future__ import annotations

import json
import math
import threading
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import (
    Flight,
    FlightRecorder,
    Keyframe,
    demo_flight,
    numbered_path,
    orbit_flight,
    read_flight,
    write_flight,
)
from terrain.heightfield import Georeference, Heightfield
from terrain.synthetic import SCENES, make_scene

coordinates = st.floats(-1e6, 1e6)
cameras = st.builds(
    Camera,
    st.tuples(coordinates, coordinates, coordinates),
    st.floats(-720, 720),
    st.sampled_from([-90.0, 0.0, 90.0]) | st.floats(-90, 90),
    st.floats(-180, 180),
    st.floats(1, 179),
)
steps_s = st.sampled_from([0.0, 1e-9, 0.5]) | st.floats(0.01, 100)


@st.composite
def flights(draw, shortest_step_s=0.0, most=6):
    shots = draw(st.lists(cameras, min_size=1, max_size=most))
    if draw(st.booleans()):
        shots.append(shots[draw(st.integers(0, len(shots) - 1))])  # the same place again
    t, keys = draw(st.sampled_from([0.0, 3.0])), []
    for camera in shots:
        keys.append(Keyframe(t, camera))
        t += max(draw(steps_s), shortest_step_s)
    return Flight(tuple(keys))


def angle_deg(a, b):
    """Angle of the turn between two cameras."""
    turn = a.view_from_eye() @ b.view_from_eye().T
    return math.degrees(2 * math.asin(min(np.linalg.norm(turn - np.eye(3)) / math.sqrt(8), 1.0)))


def straight(*positions, step_s=1.0, **angles):
    return Flight(tuple(Keyframe(i * step_s, Camera(p, **angles)) for i, p in enumerate(positions)))


# Splines


@given(flights(shortest_step_s=0.01))
def test_a_flight_passes_through_its_keyframes(flight):
    for key in flight.keyframes:
        camera = flight.camera_at(key.t_s)
        assert camera.position_m == pytest.approx(key.camera.position_m, rel=1e-12, abs=1e-9)
        assert angle_deg(camera, key.camera) < 1e-5
        assert camera.fov_deg == pytest.approx(key.camera.fov_deg)


@given(flights(), st.lists(st.floats(-1e300, 1e300) | st.floats(-1, 500), min_size=1, max_size=20))
def test_a_flight_is_a_camera_at_every_time(flight, times):
    sampled = flight.positions_at(times)
    for t, position in zip(times, sampled, strict=True):
        camera = flight.camera_at(t)  # Camera refuses what is not finite
        assert camera.position_m == tuple(position)  # many times at once or one by one: the same bits


@given(flights(), st.integers(0, 24))
def test_24_and_60_pictures_a_second_show_the_same_at_the_same_time(flight, twelfth):
    slow = [flight.camera_at(frame / 24) for frame in range(2 * twelfth + 1)]
    fast = [flight.camera_at(frame / 60) for frame in reversed(range(5 * twelfth + 1))]  # whatever came before
    assert slow[-1] == fast[0]


@given(flights())
def test_a_flight_holds_still_before_its_start_and_after_its_end(flight):
    start, end = flight.keyframes[0].t_s, flight.duration_s
    assert flight.camera_at(start - 10.0) == flight.camera_at(start)
    assert flight.camera_at(end + 1e6) == flight.camera_at(end)
    assert flight.camera_at(end).position_m == pytest.approx(flight.keyframes[-1].camera.position_m)


@given(cameras, cameras, st.floats(0, 1))
def test_orientation_turns_the_shortest_way(first, second, share):
    between = Flight((Keyframe(0.0, first), Keyframe(1.0, second))).camera_at(share)
    whole = angle_deg(first, second)
    assert angle_deg(first, between) == pytest.approx(share * whole, abs=1e-4)
    assert angle_deg(between, second) == pytest.approx((1 - share) * whole, abs=1e-4)


def test_yaw_goes_over_north_the_short_way():
    keys = (Keyframe(0.0, Camera((0, 0, 0), 350.0)), Keyframe(1.0, Camera((0, 0, 0), 20.0)))
    assert Flight(keys).camera_at(0.5).yaw_deg == pytest.approx(5.0)


@pytest.mark.parametrize("pitch", [90.0, -90.0])
@pytest.mark.parametrize("yaw", [0.0, 45.0, 170.0, -120.0])
def test_straight_up_and_down_are_orientations_like_others(pitch, yaw):
    pole, level = Camera((0, 0, 0), yaw, pitch, 0.0), Camera((0, 0, 0), yaw, 0.0, 0.0)
    flight = Flight((Keyframe(0.0, level), Keyframe(1.0, pole)))
    assert angle_deg(flight.camera_at(1.0), pole) < 1e-5
    half = flight.camera_at(0.5)
    assert half.pitch_deg == pytest.approx(pitch / 2)
    assert half.yaw_deg == pytest.approx(yaw)
    assert half.roll_deg == pytest.approx(0.0, abs=1e-9)


def barry_goldman(points, share):
    """Centripetal Catmull-Rom by repeated interpolation: another way to the same curve."""
    p = np.asarray(points, np.float64)
    k = np.r_[0.0, np.cumsum(np.sqrt(np.linalg.norm(np.diff(p, axis=0), axis=1)))]
    t = k[1] + share * (k[2] - k[1])

    def mix(a, b, ta, tb):
        return ((tb - t) * a + (t - ta) * b) / (tb - ta)

    a = [mix(p[i], p[i + 1], k[i], k[i + 1]) for i in range(3)]
    b = [mix(a[i], a[i + 1], k[i], k[i + 2]) for i in range(2)]
    return mix(b[0], b[1], k[1], k[2])


@given(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=4, max_size=4), st.floats(0, 1))
def test_position_follows_the_centripetal_catmull_rom_curve(points, share):
    knots = np.sqrt(np.linalg.norm(np.diff(points, axis=0), axis=1))
    assume(knots.min() > 1.0)
    # Times in step with the knots: then the share of the time is the share of the knot interval.
    times = np.r_[0.0, np.cumsum(knots)]
    flight = Flight(tuple(Keyframe(float(t), Camera(p)) for t, p in zip(times, points, strict=True)))
    camera = flight.camera_at(float(times[1] + share * knots[1]))
    assert camera.position_m == pytest.approx(tuple(barry_goldman(points, share)), rel=1e-6, abs=1e-3)


def test_even_keyframes_on_a_line_are_flown_at_even_speed():
    flight = straight((0, 0, 0), (10, 5, 0), (20, 10, 0), (30, 15, 0), yaw_deg=90.0)
    times = np.linspace(0, 3, 31)
    np.testing.assert_allclose(flight.positions_at(times)[:, 0], 10 * times, atol=1e-9)


def test_speed_has_no_jump_at_a_keyframe():
    flight = straight((0, 0, 0), (10, 0, 0), (200, 30, 50), (210, 30, 80), (900, 100, 100), step_s=2.0)
    for key in flight.keyframes[1:-1]:
        before, at, after = flight.positions_at(key.t_s + np.array([-1e-5, 0.0, 1e-5]))
        np.testing.assert_allclose((at - before) / 1e-5, (after - at) / 1e-5, rtol=2e-3, atol=2e-2)


def test_a_repeated_keyframe_is_a_rest():
    flight = straight((0, 0, 0), (100, 0, 0), (100, 0, 0), (200, 50, 0))
    np.testing.assert_allclose(flight.positions_at(np.linspace(1, 2, 11)), [(100, 0, 0)] * 11)


def test_nothing_is_blended_across_a_cut():
    left, right = Camera((0, 0, 0), 0.0, fov_deg=30.0), Camera((1000, 0, 0), 180.0, fov_deg=90.0)
    flight = Flight((Keyframe(0, left), Keyframe(1, left), Keyframe(1, right), Keyframe(2, right)))
    for t in (0.0, 0.5, 0.999999):
        assert flight.camera_at(t).position_m == left.position_m
        assert flight.camera_at(t).fov_deg == 30.0
    for t in (1.0, 1.3, 2.0):
        assert flight.camera_at(t).position_m == right.position_m


def test_a_cut_leaves_the_curve_before_it_alone():
    points = [(0, 0, 0), (10, 0, 5), (30, 0, 0)]
    alone = straight(*points)
    cut = Flight((*alone.keyframes, Keyframe(2.0, Camera((9e5, 0, 0))), Keyframe(3.0, Camera((9e5, 1, 0)))))
    times = np.linspace(0, 1.999, 50)
    np.testing.assert_array_equal(alone.positions_at(times), cut.positions_at(times))


@pytest.mark.parametrize(
    "keys",
    [
        (),
        (Keyframe(2.0, Camera((0, 0, 0))), Keyframe(1.0, Camera((0, 0, 0)))),
        (Keyframe(-1.0, Camera((0, 0, 0))),),
        (Keyframe(math.nan, Camera((0, 0, 0))),),
        (Keyframe(math.inf, Camera((0, 0, 0))),),
        (Keyframe(0.0, Camera((0, 1e200, 0))),),
    ],
)
def test_what_is_no_flight_is_refused(keys):
    with pytest.raises(ValueError, match="expected"):
        Flight(keys)


# The file


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@given(flights(), texts, texts, st.none() | texts, st.none() | st.tuples(coordinates, coordinates))
@settings(max_examples=40)
def test_a_flight_file_gives_back_the_flight(tmp_path_factory, flight, name, terrain, crs, origin):
    flight = Flight(flight.keyframes, name or "flight", terrain, crs, origin)
    path = tmp_path_factory.mktemp("flights") / "a.flight.json"
    write_flight(flight, path)
    assert read_flight(path) == flight
    assert [p.name for p in path.parent.iterdir()] == ["a.flight.json"]


def record(**changes):
    key = {"t": 0.0, "position": [1.0, 2.0, 3.0], "yaw": 10.0, "pitch": -10.0, "roll": 0.0, "fov": 60.0}
    return {"format": "reliefscope-flight", "version": 1, "name": "n", "terrain": "t", "crs": None,
            "origin": [0.0, 0.0], "keyframes": [key]} | changes  # fmt: skip


def key_with(**changes):
    return record(keyframes=[record()["keyframes"][0] | changes])


def test_the_file_holds_what_its_description_says(tmp_path):
    flight = Flight((Keyframe(0.0, Camera((1, 2, 3), 10.0, -10.0, 5.0, 50.0)),), "n", "t", "EPSG:32611", (4.0, 5.0))
    write_flight(flight, tmp_path / "a.flight.json")
    assert json.loads((tmp_path / "a.flight.json").read_text()) == record(crs="EPSG:32611", origin=[4.0, 5.0]) | {
        "keyframes": [{"t": 0.0, "position": [1, 2, 3], "yaw": 10.0, "pitch": -10.0, "roll": 5.0, "fov": 50.0}]
    }


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("", "JSON"),
        ("[1, 2", "JSON"),
        (b"\xff\xfe\x00", "JSON"),
        ("[" * 100_000, "JSON"),
        ([], "format"),
        ({"format": "gpx"}, "gpx"),
        (record(version=2), "update"),
        (record(version="1"), "version"),
        (record(version=True), "version"),
        (record(keyframes=[]), "keyframe"),
        (record(keyframes={}), "list"),
        (record(keyframes=[3]), "keyframe 1"),
        (record(name=3), "name"),
        (record(origin=[1.0]), "origin"),
        (record(keyframes=[{"t": 0.0}]), "position"),
        (key_with(t=math.nan), "t of keyframe 1"),
        (key_with(t=-1.0), "order"),
        (key_with(position=[0.0, math.inf, 0.0]), "position"),
        (key_with(position=[0.0, 0.0]), "position"),
        (key_with(position=[0.0, 1e30, 0.0]), "position"),
        (key_with(yaw="north"), "yaw"),
        (key_with(yaw=True), "yaw"),
        (key_with(yaw=10**400), "yaw"),
        (key_with(fov=0.0), "field of view"),
        (key_with(fov=180.0), "field of view"),
        (record(keyframes=[key_with(t=2.0)["keyframes"][0], record()["keyframes"][0]]), "order"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_clear_line(tmp_path, content, names):
    path = tmp_path / "a.flight.json"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError) as error:
        read_flight(path)
    assert names in str(error.value)
    assert "\n" not in str(error.value)
    assert "a.flight.json" in str(error.value)


def test_angles_may_be_left_out_of_a_file(tmp_path):
    path = tmp_path / "a.flight.json"
    path.write_text(json.dumps(record(keyframes=[{"t": 0, "position": [1, 2, 3]}])))
    assert read_flight(path).camera_at(0.0) == Camera((1.0, 2.0, 3.0))


def test_a_missing_file_is_named():
    with pytest.raises(InputError, match="nowhere"):
        read_flight("nowhere.flight.json")


def test_a_flight_is_never_overwritten_unasked(tmp_path):
    path = tmp_path / "a.flight.json"
    first, second = straight((0, 0, 0)), straight((1, 1, 1))
    write_flight(first, path)
    with pytest.raises(InputError, match="exists"):
        write_flight(second, path)
    assert read_flight(path) == first
    write_flight(second, path, overwrite=True)
    assert read_flight(path) == second


def test_of_many_writers_of_one_name_one_wins(tmp_path):
    path, won = tmp_path / "a.flight.json", []

    def write(number):
        try:
            write_flight(straight((number, 0, 0)), path)
        except InputError:
            return
        won.append(number)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(won) == 1
    assert read_flight(path).camera_at(0.0).position_m[0] == won[0]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_flight(straight((0, 0, 0)), tmp_path / "none" / "a.flight.json")


def test_numbers_go_on_from_the_highest(tmp_path):
    path = tmp_path / "my alps.flight.json"
    assert numbered_path(path).name == "my alps-1.flight.json"
    (tmp_path / "my alps-2.flight.json").touch()
    (tmp_path / "my alps-9.png").touch()
    assert numbered_path(path).name == "my alps-3.flight.json"
    assert numbered_path(tmp_path / "my alps.png").name == "my alps-10.png"
    assert numbered_path(tmp_path / "tour").name == "tour-1"
    assert numbered_path(tmp_path / "none" / "a.png").name == "a-1.png"


# The recorder


FLAT = Heightfield(np.zeros((9, 9), np.float32), (10.0, 10.0), name="flat")


@given(
    st.lists(
        st.tuples(st.floats(0.001, 1.0), st.floats(-50, 50), st.floats(-50, 50), st.floats(-30, 30)),
        min_size=1,
        max_size=40,
    )
)
@settings(max_examples=40)
def test_a_recording_stays_within_its_tolerance_at_every_sample(moves):
    recorder, samples = FlightRecorder(FLAT, tolerance_m=0.5, tolerance_deg=0.2), []
    t, x, z, yaw = 100.0, 0.0, 0.0, 0.0
    for dt, dx, dz, turn in moves:
        t, x, z, yaw = t + dt, x + dx, z + dz, yaw + turn
        samples.append((t, Camera((x, 20.0, z), yaw, -5.0)))
        recorder.add(*samples[-1])
    flight = recorder.finish("mine")
    assert flight.name == "mine"
    assert flight.terrain == "flat"
    assert flight.keyframes[0].t_s == 0.0
    for t, camera in samples:
        replayed = flight.camera_at(t - samples[0][0])
        assert np.linalg.norm(replayed.eye_m - camera.eye_m) <= 0.5 + 1e-6
        assert angle_deg(replayed, camera) <= 0.2 + 1e-4


def test_a_steady_recording_needs_few_keyframes():
    recorder = FlightRecorder(FLAT)
    for frame in range(600):
        recorder.add(frame / 60, Camera((2.0 * frame, 30.0 + frame, 0.0), 90.0))
    assert len(recorder.finish().keyframes) <= 3


def test_a_smooth_recording_is_thinned_a_lot():
    recorder, samples = FlightRecorder(FLAT), []
    for frame in range(1200):
        t = frame / 60
        samples.append(Camera((300 * math.sin(t / 4), 60 + 20 * math.sin(t / 2), 300 * math.cos(t / 4)), 14 * t))
        recorder.add(t, samples[-1])
    flight = recorder.finish()
    assert len(flight.keyframes) < 240
    away_m = [math.dist(flight.camera_at(frame / 60).eye_m, eye.eye_m) for frame, eye in enumerate(samples)]
    assert 0.01 < max(away_m) <= 0.05 + 1e-9  # half a percent of the post spacing, and made use of


def test_of_samples_at_the_same_time_the_later_counts():
    recorder = FlightRecorder(FLAT)
    for x in (0.0, 1.0, 2.0):
        recorder.add(5.0, Camera((x, 0.0, 0.0)))
    recorder.add(4.0, Camera((9.0, 0.0, 0.0)))
    flight = recorder.finish()
    assert flight.duration_s == 0.0
    assert flight.camera_at(0.0).position_m == (9.0, 0.0, 0.0)


def test_an_empty_recording_is_refused():
    with pytest.raises(ValueError, match="sample"):
        FlightRecorder(FLAT).finish()


# Another terrain


def placed(easting, northing, crs="EPSG:32632", rows=9):
    return Heightfield(
        np.zeros((rows, 9), np.float32), (10.0, 10.0), name="there",
        georeference=Georeference(crs, (10.0, 0.0, easting, 0.0, -10.0, northing)),
    )  # fmt: skip


def test_a_flight_opened_on_another_terrain_stays_over_the_same_place():
    flight = Flight((Keyframe(0.0, Camera((40.0, 7.0, 20.0), 33.0)),), "f", "here", "EPSG:32632", (5000.0, 9000.0))
    moved = flight.relocated(placed(4970.0, 9100.0))
    assert moved.camera_at(0.0).position_m == pytest.approx((70.0, 7.0, 120.0))
    assert moved.camera_at(0.0).yaw_deg == pytest.approx(33.0)
    assert (moved.origin, moved.terrain) == ((4970.0, 9100.0), "there")
    assert moved.relocated(placed(5000.0, 9000.0)).camera_at(0.0).position_m == pytest.approx((40.0, 7.0, 20.0))


def test_a_flight_stays_where_it_is_without_a_common_coordinate_system():
    flight = Flight((Keyframe(0.0, Camera((40.0, 7.0, 20.0))),), "f", "here", "EPSG:32632", (5000.0, 9000.0))
    assert flight.relocated(placed(4970.0, 9100.0, "EPSG:32633")) is flight
    assert flight.relocated(FLAT) is flight
    assert flight.relocated(placed(5000.0, 9000.0)) is flight
    assert Flight(flight.keyframes).relocated(placed(0.0, 0.0)) == Flight(flight.keyframes)


# Tours


def clearance_m(flight, heightfield):
    times = np.linspace(0.0, flight.duration_s, 20_001)
    position = flight.positions_at(times)
    ground = heightfield.heights_at(position[:, 0], position[:, 2])
    assert np.isfinite(ground).all()  # it stays over the terrain
    return position[:, 1] - ground


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("size", [2, 17, 257])
def test_the_tour_of_every_scene_stays_above_ground(name, size):
    heightfield = make_scene(name, size)
    flight = demo_flight(heightfield)
    clearance = clearance_m(flight, heightfield)
    eye_m = max(min(1.8, heightfield.spacing_m[0]), 0.02 * heightfield.spacing_m[0])
    assert clearance.min() > 0.5 * eye_m
    assert flight.duration_s == 20.0


def rough(rows, cols, low, high, spacing_m, seed=0):
    heights = np.random.default_rng(seed).uniform(low, high, (rows, cols)).astype(np.float32)
    return Heightfield(heights, (spacing_m, 1.3 * spacing_m), name="rough")


@pytest.mark.parametrize(
    "heightfield",
    [
        rough(2, 2, 0, 30, 10.0),
        rough(2, 900, 0, 30, 10.0),
        rough(900, 3, 0, 30, 10.0),
        rough(65, 65, -1e6, 1e6, 1000.0),
        rough(65, 65, 0, 0.02, 0.001),
        rough(65, 65, 0, 9000, 10_000.0),
        rough(65, 65, 1e7, 1e7 + 40, 10.0),
        rough(130, 129, 0, 500, 1.0),
        Heightfield(np.zeros((40, 30), np.float32), (5.0, 5.0)),
    ],
    ids=["2x2", "strip", "column", "huge", "tiny", "coarse", "far up", "spikes", "flat"],
)
def test_the_tour_of_odd_terrains_stays_above_ground(heightfield):
    clearance = clearance_m(demo_flight(heightfield), heightfield)
    assert clearance.min() > 0.0
    assert clearance.max() > clearance.min()


@given(st.integers(0, 2**32), st.integers(2, 40), st.integers(2, 40), st.floats(0, 300))
@settings(max_examples=15)
def test_the_tour_of_any_rough_terrain_stays_above_ground(seed, rows, cols, relief):
    heightfield = rough(rows, cols, 0, relief, 10.0, seed)
    assert clearance_m(demo_flight(heightfield), heightfield).min() > 0.0


def test_the_tour_shows_a_wide_view_a_low_pass_and_a_climb():
    heightfield = make_scene("alps", 513)
    flight = demo_flight(heightfield)
    clearance = clearance_m(flight, heightfield)
    assert clearance[0] > 500.0
    assert (clearance < 0.004 * max(heightfield.extent_m)).mean() > 0.05  # a second near the ground and more
    lowest = int(clearance.argmin())
    assert clearance[lowest:].max() > 500.0
    assert -30.0 < flight.camera_at(0.0).pitch_deg < 0.0
    # The first view goes across the terrain, not out over its near rim.
    ahead = flight.camera_at(0.0).eye_m + 0.4 * heightfield.extent_m[0] * flight.camera_at(0.0).forward
    assert math.isfinite(float(heightfield.heights_at(ahead[0], ahead[2])))


def test_the_tour_turns_smoothly():
    flight = demo_flight(make_scene("alps", 513))
    views = [flight.camera_at(t) for t in np.arange(0.0, 20.0, 1 / 30)]
    turns = [angle_deg(a, b) for a, b in pairwise(views)]
    assert max(turns) < 60.0 / 30  # below 60 degrees a second


def test_the_tour_avoids_holes():
    heights = np.random.default_rng(1).uniform(0, 20, (129, 129)).astype(np.float32)
    holes = np.zeros(heights.shape, np.bool_)
    holes[:, :60] = True
    holes[:20] = True
    heightfield = Heightfield(heights, (10.0, 10.0), holes)
    position = demo_flight(heightfield).positions_at(np.linspace(0, 20, 500))
    col, row = np.rint(position[:, 0] / 10).astype(int), np.rint(position[:, 2] / 10).astype(int)
    assert holes[row, col].mean() < 0.1


def test_the_tour_is_the_same_each_time():
    heightfield = make_scene("waves", 65)
    assert demo_flight(heightfield) == demo_flight(heightfield)


@pytest.mark.parametrize("name", ["alps", "flat", "needle"])
def test_the_orbit_looks_at_the_middle_from_above(name):
    heightfield = make_scene(name, 65)
    flight = orbit_flight(heightfield, 30.0)
    width, depth = heightfield.extent_m
    middle = np.array([width / 2, np.mean(heightfield.height_range_m), depth / 2])
    assert flight.duration_s == 30.0
    for t in np.linspace(0.0, 30.0, 40):
        camera = flight.camera_at(t)
        to_middle = (middle - camera.eye_m) / np.linalg.norm(middle - camera.eye_m)
        assert math.degrees(math.acos(min(float(to_middle @ camera.forward), 1.0))) < 1.5
        assert camera.eye_m[1] > heightfield.height_range_m[1]
    assert flight.camera_at(0.0).eye_m == pytest.approx(flight.camera_at(30.0).eye_m, abs=1e-3)
