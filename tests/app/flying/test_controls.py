"""Camera motion does what the hands ask for, at any frame rate."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.flying.controls import FASTER, PITCH_LIMIT_DEG, SPEED_FACTORS, Inputs, Motion, look, move
from terrain.camera import Camera

LEAST_M = 2.0
START = Camera((0.0, 500.0, 0.0), yaw_deg=30.0, pitch_deg=-10.0)

sign = st.sampled_from([-1.0, 0.0, 1.0])
finite = st.floats(-1e4, 1e4)
inputs = st.builds(
    Inputs, forward=sign, right=sign, up=sign, fast=st.booleans(), look_px=st.tuples(finite, finite), wheel=finite
)


def above_sea(x, y, z):
    return y


def above_waves(x, y, z):
    return y - 100.0 * math.sin(x / 300.0) * math.cos(z / 300.0)


def at_constant_height(x, y, z):
    return 100.0


def fly(inputs, seconds, fps, clearance=above_sea, camera=START, motion=Motion()):  # noqa: B008 frozen
    for _ in range(round(seconds * fps)):
        camera, motion = move(camera, motion, inputs, 1.0 / fps, clearance, LEAST_M)
    return camera, motion


@pytest.mark.parametrize("clearance", [above_sea, above_waves])
@given(forward=sign, right=sign, up=sign, fast=st.booleans())
def test_flight_does_not_depend_on_the_frame_rate(clearance, forward, right, up, fast):
    held = Inputs(forward, right, up, fast)
    slow, _ = fly(held, 1.0, 24, clearance)
    quick, _ = fly(held, 1.0, 144, clearance)
    travelled = np.linalg.norm(quick.eye_m - START.eye_m)
    assert np.linalg.norm(slow.eye_m - quick.eye_m) <= 0.01 * travelled


@given(forward=sign, right=sign, up=sign, fast=st.booleans())
def test_at_constant_speed_the_path_is_exact_at_any_frame_rate(forward, right, up, fast):
    held = Inputs(forward, right, up, fast)
    slow, _ = fly(held, 1.0, 24, at_constant_height)
    quick, _ = fly(held, 1.0, 144, at_constant_height)
    assert slow.position_m == pytest.approx(quick.position_m, rel=1e-9, abs=1e-9)


@given(inputs=inputs, velocity=st.tuples(finite, finite, finite))
def test_nothing_moves_in_no_time(inputs, velocity):
    camera, motion = move(START, Motion(velocity), replace(inputs, look_px=(0.0, 0.0)), 0.0, above_sea, LEAST_M)
    assert camera == START
    assert motion.velocity == velocity


@given(st.lists(st.tuples(inputs, st.floats(0.0, 10.0)), max_size=20))
def test_camera_is_always_finite_and_above_the_ground(frames):
    camera, motion = START, Motion()
    for held, dt_s in frames:
        camera, motion = move(camera, motion, held, dt_s, above_waves, LEAST_M)
        assert np.isfinite([*camera.position_m, camera.yaw_deg, camera.pitch_deg, *motion.velocity]).all()
        assert abs(camera.pitch_deg) <= PITCH_LIMIT_DEG
        assert SPEED_FACTORS[0] <= motion.speed_factor <= SPEED_FACTORS[1]
        assert above_waves(*camera.position_m) >= LEAST_M - 1e-6 * abs(camera.position_m[1])


@given(inputs=inputs)
def test_lost_focus_stops_all_motion_at_once(inputs):
    _, motion = fly(Inputs(forward=1.0, fast=True), 0.5, 60)
    camera, motion = move(START, motion, replace(inputs, focused=False), 1 / 60, above_sea, LEAST_M)
    assert camera == START
    assert motion.at_rest


def test_released_keys_come_to_rest_within_a_second():
    _, motion = fly(Inputs(forward=1.0), 0.5, 60)
    assert not motion.at_rest
    _, motion = fly(Inputs(), 1.0, 60, motion=motion)
    assert motion.at_rest


@pytest.mark.parametrize(
    ("held", "direction"),
    [
        (Inputs(forward=1.0), START.forward),
        (Inputs(forward=-1.0), -START.forward),
        (Inputs(right=1.0), np.array([math.cos(math.radians(30)), 0.0, math.sin(math.radians(30))])),
        (Inputs(up=1.0), np.array([0.0, 1.0, 0.0])),
        (Inputs(up=-1.0), np.array([0.0, -1.0, 0.0])),
    ],
)
def test_each_key_moves_in_its_own_direction(held, direction):
    camera, _ = fly(held, 0.2, 60)
    travelled = camera.eye_m - START.eye_m
    assert travelled / np.linalg.norm(travelled) == pytest.approx(direction)


def test_shift_is_faster_and_opposite_keys_cancel():
    once = fly(Inputs(right=1.0), 1.0, 60, at_constant_height)[0].eye_m - START.eye_m
    fast = fly(Inputs(right=1.0, fast=True), 1.0, 60, at_constant_height)[0].eye_m - START.eye_m
    assert fast == pytest.approx(FASTER * once)
    assert fly(Inputs(), 1.0, 60)[0] == START


def test_speed_adapts_to_height_above_ground():
    high = fly(Inputs(right=1.0), 0.5, 60)[0].eye_m - START.eye_m
    low_start = replace(START, position_m=(0.0, 50.0, 0.0))
    low = fly(Inputs(right=1.0), 0.5, 60, camera=low_start)[0].eye_m - low_start.eye_m
    assert high == pytest.approx(10.0 * low)


def test_wheel_changes_the_pace_both_ways():
    faster = move(START, Motion(), Inputs(wheel=1.0), 1 / 60, above_sea, LEAST_M)[1]
    assert faster.speed_factor > Motion().speed_factor
    back = move(START, faster, Inputs(wheel=-1.0), 1 / 60, above_sea, LEAST_M)[1]
    assert back.speed_factor == pytest.approx(Motion().speed_factor)


def test_mouse_turns_the_way_it_moves():
    assert look(START, (10.0, 0.0)).yaw_deg > START.yaw_deg
    assert look(START, (0.0, 10.0)).pitch_deg < START.pitch_deg
    zoomed = replace(START, fov_deg=6.0)
    assert look(zoomed, (10.0, 0.0)).yaw_deg - 30.0 == pytest.approx(0.1 * (look(START, (10.0, 0.0)).yaw_deg - 30.0))
