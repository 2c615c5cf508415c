"""Orbit holds on to its point, walking keeps its feet on the ground, and passages end where they should."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from app.flying.cameras import (
    FREE_SHARE,
    Passage,
    approach,
    free_above,
    lifted,
    orbit,
    orbit_with_keys,
    pan,
    plan_passage,
    pointer_at,
    sight_line,
    walk,
    zoom,
)  # fmt: skip
from app.flying.controls import PITCH_LIMIT_DEG, Inputs, Motion, move
from terrain.camera import Camera

few = settings(max_examples=12)  # where a second is flown in frames
some = settings(max_examples=30)
ASPECT = 16 / 9
LEAST_M = 2.0
EXTENT_M = (4000.0, 3000.0)
share = st.floats(0.02, 0.98)
push = st.floats(-1.0, 1.0)
pixels = st.tuples(st.floats(-400.0, 400.0), st.floats(-400.0, 400.0))


def waves(x, z):
    return 120.0 * math.sin(x / 300.0) * math.cos(z / 200.0)


def above_waves(x, y, z):
    return y - waves(x, z)


def anywhere(camera):
    return True


@st.composite
def cameras(draw, least_m=LEAST_M):
    """A camera over the waves, high or low, looking anywhere."""
    x, z = draw(st.floats(0.0, EXTENT_M[0])), draw(st.floats(0.0, EXTENT_M[1]))
    height = draw(st.floats(least_m, 3000.0))
    yaw, pitch, fov = draw(st.floats(0.0, 360.0)), draw(st.floats(-85.0, 30.0)), draw(st.floats(10.0, 100.0))
    return Camera((x, waves(x, z) + height, z), yaw, pitch, 0.0, fov)


@st.composite
def views(draw):
    """A camera, a place in its picture, and a point of the scene there."""
    camera, pointer = draw(cameras()), draw(st.tuples(share, share))
    point = camera.eye_m + draw(st.floats(10.0, 1e4)) * sight_line(camera, pointer, ASPECT)
    return camera, pointer, point


def assert_same_place(pointer, camera, point, tolerance=1e-6):
    assert pointer_at(camera, point, ASPECT) == pytest.approx(pointer, abs=tolerance)


@some
@given(views())
def test_a_point_on_a_sight_line_lies_where_the_line_was_drawn(view):
    camera, pointer, point = view
    assert_same_place(pointer, camera, point)


def test_a_point_behind_the_eye_is_nowhere_in_the_picture():
    assert pointer_at(Camera((0.0, 0.0, 0.0)), np.array([0.0, 0.0, 5.0]), ASPECT) is None


# Orbit


@some
@given(views(), pixels)
def test_orbiting_keeps_the_point_where_it_is_in_the_picture(view, look_px):
    camera, pointer, point = view
    after = orbit(camera, point, look_px, anywhere)
    assert_same_place(pointer, after, point)
    assert np.linalg.norm(after.eye_m - point) == pytest.approx(np.linalg.norm(camera.eye_m - point))


@some
@given(views(), st.lists(pixels, min_size=2, max_size=6))
def test_orbiting_depends_on_the_whole_drag_only(view, drags):
    camera, _, point = view
    camera = replace(camera, pitch_deg=0.0, fov_deg=60.0)
    assume(all(abs(sum(d[1] for d in drags[:n])) * 0.2 < PITCH_LIMIT_DEG for n in range(len(drags) + 1)))
    after = camera
    for drag in drags:
        after = orbit(after, point, drag, anywhere)
    at_once = orbit(camera, point, tuple(np.sum(drags, axis=0)), anywhere)
    assert after.position_m == pytest.approx(at_once.position_m, rel=1e-6, abs=1e-5)


@some
@given(views(), st.tuples(share, share))
def test_panning_brings_the_point_below_the_mouse(view, pointer):
    camera, _, point = view
    assume(sight_line(camera, pointer, ASPECT)[1] < -0.06)
    after = pan(camera, point, pointer, ASPECT, anywhere)
    assert_same_place(pointer, after, point, 1e-5)
    reach = point - camera.eye_m
    if reach[1] < -0.05 * np.linalg.norm(reach):
        assert after.position_m[1] == pytest.approx(camera.position_m[1])


@some
@given(views(), st.tuples(share, share))
def test_panning_never_runs_away_towards_the_horizon(view, pointer):
    camera, _, point = view
    after = pan(camera, point, pointer, ASPECT, anywhere)
    distance = np.linalg.norm(point - camera.eye_m)
    assert np.linalg.norm(after.eye_m - camera.eye_m) < 60.0 * distance


def test_what_is_grasped_cannot_be_pulled_beyond_the_horizon():
    camera, point = Camera((0.0, 100.0, 0.0), pitch_deg=-10.0), np.array([0.0, 0.0, -300.0])
    ends = [pan(camera, point, (0.5, v), ASPECT, anywhere).position_m for v in (0.36, 0.3, 0.0)]
    for x, y, z in ends:
        assert x == pytest.approx(0.0, abs=1e-6)
        assert y == pytest.approx(100.0)
        assert 0.0 < z < 2000.0  # drawn up, the ground goes away from the eye


@some
@given(views(), st.floats(-3.0, 3.0))
def test_zooming_keeps_the_point_below_the_mouse(view, nearer):
    camera, pointer, point = view
    after = zoom(camera, point, nearer, LEAST_M, anywhere)
    assert_same_place(pointer, after, point)
    before_m, after_m = (float(np.linalg.norm(c.eye_m - point)) for c in (camera, after))
    assert after_m == pytest.approx(max(before_m * math.exp(-nearer), min(before_m, LEAST_M)))


@some
@given(views(), pixels, st.floats(-3.0, 3.0), st.tuples(share, share))
def test_orbiting_never_enters_the_ground(view, look_px, nearer, pointer):
    camera, _, point = view
    is_free = free_above(above_waves, LEAST_M)
    for after in (
        orbit(camera, point, look_px, is_free),
        pan(camera, point, pointer, ASPECT, is_free),
        zoom(camera, point, nearer, LEAST_M, is_free),
        orbit_with_keys(camera, Motion((1.0, -1.0, 1.0)), Inputs(right=1.0), 0.2, point, LEAST_M, is_free)[0],
    ):
        assert above_waves(*after.position_m) >= FREE_SHARE * LEAST_M


@some
@given(views(), pixels)
def test_a_turn_that_the_ground_blocks_still_keeps_the_point(view, look_px):
    camera, pointer, point = view
    after = orbit(camera, point, look_px, free_above(above_waves, LEAST_M))
    assert_same_place(pointer, after, point)


@few
@given(views(), push, push, push)
def test_orbiting_with_keys_does_not_depend_on_the_frame_rate(view, right, up, forward):
    camera, _, point = view
    camera = replace(camera, pitch_deg=-30.0)
    held = Inputs(forward=forward, right=right, up=up)
    ends = []
    for fps in (24, 144):
        after, motion, pivot = camera, Motion(), point
        for _ in range(fps):
            after, motion, pivot = orbit_with_keys(after, motion, held, 1 / fps, pivot, 1e-3, anywhere)
        ends.append(after)
    assert ends[0].position_m == pytest.approx(ends[1].position_m, rel=1e-6, abs=1e-5)
    assert pivot == pytest.approx(point)


@few
@given(views(), push, push)
def test_sliding_with_keys_takes_the_point_along_at_any_frame_rate(view, turn, tilt):
    camera, _, point = view
    _, _, at_once = orbit_with_keys(camera, Motion(), Inputs(turn=turn, tilt=tilt), 0.24, point, LEAST_M, anywhere)
    after, pivot = camera, point
    for _ in range(24):
        after, _, pivot = orbit_with_keys(after, Motion(), Inputs(turn=turn, tilt=tilt), 0.01, pivot, LEAST_M, anywhere)
    assert pivot == pytest.approx(at_once)
    assert after.eye_m - camera.eye_m == pytest.approx(pivot - point, abs=1e-6)


def test_keys_orbit_the_way_they_say():
    camera, point = Camera((0.0, 100.0, 100.0), pitch_deg=-45.0), np.zeros(3)

    def after(**held):
        return orbit_with_keys(camera, Motion(), Inputs(**held), 0.2, point, 1.0, anywhere)[0].eye_m - camera.eye_m

    assert after(right=1.0)[0] > 0.0
    assert after(up=1.0)[1] > 0.0
    assert after(forward=1.0)[2] < 0.0 < after(forward=-1.0)[2]
    assert after(turn=1.0)[0] > 0.0
    assert after(tilt=1.0)[2] < 0.0


def test_the_near_side_of_the_scene_goes_along_with_the_mouse():
    camera, point = Camera((0.0, 100.0, 100.0), pitch_deg=-45.0), np.zeros(3)
    near = np.array([0.0, 0.0, 20.0])
    right = orbit(camera, point, (30.0, 0.0), anywhere)
    down = orbit(camera, point, (0.0, 30.0), anywhere)
    assert pointer_at(right, near, ASPECT)[0] > pointer_at(camera, near, ASPECT)[0]
    assert pointer_at(down, near, ASPECT)[1] > pointer_at(camera, near, ASPECT)[1]


# Walk


@few
@given(cameras(), push, push, st.booleans(), st.floats(0.0, 0.4))
def test_walkers_keep_their_eyes_above_the_ground_and_their_feet_on_the_terrain(camera, forward, right, fast, dt_s):
    held = Inputs(forward=forward, right=right, fast=fast)
    motion = Motion((1.0, 0.0, -1.0), 50.0)
    for _ in range(4):
        camera, motion = walk(camera, motion, held, dt_s, waves, 1.7, EXTENT_M)
        x, y, z = camera.position_m
        assert y == pytest.approx(waves(x, z) + 1.7)
        assert 0.0 <= x <= EXTENT_M[0]
        assert 0.0 <= z <= EXTENT_M[1]


@few
@given(push, push)
def test_walking_does_not_depend_on_the_frame_rate(forward, right):
    start = Camera((2000.0, 0.0, 1500.0), yaw_deg=40.0, pitch_deg=-50.0)
    ends = []
    for fps in (24, 144):
        camera, motion = start, Motion()
        for _ in range(fps):
            camera, motion = walk(camera, motion, Inputs(forward=forward, right=right), 1 / fps, waves, 1.7, EXTENT_M)
        ends.append(camera.position_m)
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


def test_walkers_walk_level_however_steeply_they_look():
    start = Camera((2000.0, 0.0, 1500.0), pitch_deg=-80.0)
    camera, _ = walk(start, Motion((1.0, 0.0, 0.0)), Inputs(forward=1.0), 0.25, waves, 1.7, EXTENT_M)
    assert camera.position_m[2] < start.position_m[2] - 0.2


def test_walkers_who_lose_the_keyboard_stand_still():
    start = Camera((2000.0, 1.7 + waves(2000.0, 1500.0), 1500.0))
    camera, motion = walk(start, Motion((1.0, 0.0, 0.0)), Inputs(forward=1.0, focused=False), 0.1, waves, 1.7, EXTENT_M)
    assert camera == start
    assert motion.at_rest


# Collision


@given(cameras(0.0), push, push, push, st.floats(0.0, 0.3))
def test_free_flight_goes_below_the_ground_only_where_it_may(camera, forward, right, up, dt_s):
    held = Inputs(forward=forward, right=right, up=up, fast=True)
    stopped, _ = move(camera, Motion(), held, dt_s, above_waves, LEAST_M)
    if stopped.position_m != camera.position_m:
        assert above_waves(*stopped.position_m) >= LEAST_M - 1e-6


def test_without_collision_one_dives_below_the_ground():
    camera, motion = Camera((10.0, waves(10.0, 10.0) + 5.0, 10.0), pitch_deg=-85.0), Motion()
    for _ in range(120):
        camera, motion = move(camera, motion, Inputs(forward=1.0, fast=True), 1 / 30, above_waves, LEAST_M, False)
    assert above_waves(*camera.position_m) < -10.0
    back = lifted(camera, above_waves, LEAST_M)
    assert above_waves(*back.position_m) == pytest.approx(LEAST_M)


# Turning with keys


@few
@given(push, push)
def test_turning_with_keys_does_not_depend_on_the_frame_rate(turn, tilt):
    held, ends = Inputs(turn=turn, tilt=tilt), []
    for fps in (24, 144):
        camera, motion = Camera((0.0, 500.0, 0.0), yaw_deg=30.0), Motion()
        for _ in range(fps):
            camera, motion = move(camera, motion, held, 1 / fps, above_waves, LEAST_M)
        ends.append((camera.yaw_deg, camera.pitch_deg))
    assert ends[0] == pytest.approx(ends[1])


def test_a_stick_pushed_half_way_flies_half_as_fast():
    def travelled(forward):
        camera, _ = move(
            Camera((0.0, 900.0, 0.0)), Motion((0.0, 0.0, -forward)), Inputs(forward=forward), 0.01, lambda *_: 100.0,
            LEAST_M,
        )  # fmt: skip
        return -camera.position_m[2]

    assert travelled(0.5) == pytest.approx(0.5 * travelled(1.0))


# Passages


@given(cameras(), cameras())
def test_passages_begin_and_end_where_they_should(start, goal):
    passage = plan_passage(start, goal, above_waves, LEAST_M)
    assert passage.camera_at(0.0).position_m == pytest.approx(start.position_m)
    assert passage.camera_at(passage.duration_s) == goal
    before = passage.camera_at(passage.duration_s * (1.0 - 1e-7))
    assert before.position_m == pytest.approx(goal.position_m, rel=1e-3, abs=1.0)


@some
@given(cameras(), cameras())
def test_passages_clear_the_ground(start, goal):
    passage = plan_passage(start, goal, above_waves, LEAST_M)
    for time_s in np.linspace(0.0, passage.duration_s, 40):
        camera = passage.camera_at(time_s)
        assert above_waves(*camera.position_m) > -0.1 * passage.rise_m - 1e-6


def test_passages_are_soft_at_both_ends_and_turn_the_short_way():
    passage = Passage(Camera((0.0, 0.0, 0.0), yaw_deg=350.0), Camera((100.0, 0.0, 0.0), yaw_deg=20.0))
    early, late = passage.camera_at(0.05 * passage.duration_s), passage.camera_at(0.95 * passage.duration_s)
    assert early.position_m[0] < 1.0
    assert late.position_m[0] > 99.0
    assert passage.camera_at(0.5 * passage.duration_s).yaw_deg == pytest.approx(5.0)


@some
@given(views())
def test_an_approach_looks_at_the_point_from_nearer_and_from_above(view):
    camera, _, point = view
    point = np.array([point[0], waves(point[0], point[2]), point[2]])
    goal = approach(camera, point, above_waves, LEAST_M)
    assert above_waves(*goal.position_m) >= LEAST_M - 1e-6
    assert goal.pitch_deg <= -20.0
    distance = float(np.linalg.norm(goal.eye_m - point))
    assert distance <= max(0.25 * float(np.linalg.norm(camera.eye_m - point)), 8 * LEAST_M) + 1e-6 or distance < 400.0
    if above_waves(*goal.position_m) > LEAST_M + 1e-6:
        assert_same_place((0.5, 0.5), goal, point)
