"""A pace changes when a moment of the flight is shown, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.flight import PACES, Flight, Keyframe, flight_time, played_times
from terrain.flight.pace import eased


def flight_of(*keys):
    return Flight(tuple(Keyframe(t, Camera(position, yaw)) for t, position, yaw in keys))


HASTY = flight_of((0, (0, 0, 0), 0), (8, (100, 0, 0), 0), (10, (1000, 0, 0), 0))


@given(st.sampled_from(list(PACES)), st.floats(0, 10), st.floats(0, 10))
def test_time_never_runs_back_and_begins_and_ends_with_the_flight(pace, a, b):
    low, high = sorted((a, b))
    assert flight_time(HASTY, pace, low) <= flight_time(HASTY, pace, high) + 1e-12
    assert (flight_time(HASTY, pace, 0.0), flight_time(HASTY, pace, 10.0)) == pytest.approx((0.0, 10.0))


@given(st.sampled_from(list(PACES)), st.floats(0, 10))
def test_the_moment_shown_at_a_time_is_shown_at_that_time(pace, played_s):
    assert played_times(HASTY, pace, flight_time(HASTY, pace, played_s)) == pytest.approx(played_s, abs=1e-6)


def test_constant_pace_covers_equal_ways_in_equal_times():
    x = [HASTY.camera_at(flight_time(HASTY, "constant", t)).position_m[0] for t in np.linspace(0, 10, 11)]
    assert np.diff(x) == pytest.approx(100.0, rel=0.01)


def test_eased_pace_starts_and_ends_softly_and_is_even_between():
    x = np.array([HASTY.camera_at(flight_time(HASTY, "eased", t)).position_m[0] for t in np.linspace(0, 10, 101)])
    speed = np.diff(x) / 0.1
    assert speed[0] < 10.0 > speed[-1]
    assert speed[25:75] == pytest.approx(np.full(50, 125.0), rel=0.02)
    assert (np.diff(speed[:20]) > 0).all()


@given(st.floats(0, 1))
def test_easing_is_symmetric(share):
    assert eased(share) + eased(1.0 - share) == pytest.approx(1.0)


def test_a_turn_on_the_spot_takes_its_time_and_a_cut_takes_none():
    turning = flight_of((0, (0, 0, 0), 0), (1, (100, 0, 0), 0), (1.5, (100, 0, 0), 90), (2, (200, 0, 0), 90))
    times = [flight_time(turning, "constant", t) for t in np.linspace(0, 2, 401)]
    assert np.mean([1.0 < t < 1.5 for t in times]) > 0.1
    cut = flight_of((0, (0, 0, 0), 0), (1, (100, 0, 0), 0), (1, (9000, 0, 0), 180), (2, (9100, 0, 0), 180))
    x = [cut.camera_at(flight_time(cut, "constant", t)).position_m[0] for t in (0.5, 0.99, 1.01, 1.5)]
    assert x == pytest.approx([50, 99, 9001, 9050], abs=0.5)


@pytest.mark.parametrize("pace", PACES)
def test_a_flight_that_stands_still_or_has_one_keyframe_is_shown_all_the_same(pace):
    still = flight_of((0, (5, 5, 5), 0), (4, (5, 5, 5), 0))
    assert 0.0 <= flight_time(still, pace, 2.0) <= 4.0
    assert flight_of((0, (5, 5, 5), 0)).camera_at(flight_time(flight_of((0, (5, 5, 5), 0)), pace, 1.0)).yaw_deg == 0.0
