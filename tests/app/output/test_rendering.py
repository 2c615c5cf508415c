"""Pictures of a flight are spread over it as asked, and every sink gets each of them once, in order."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.output.rendering import draw_pictures, flight_times, write_pictures


@given(duration_s=st.floats(0.0, 60.0), fps=st.integers(1, 120))
def test_without_a_number_pictures_follow_each_other_at_the_film_rate(duration_s, fps):
    times_s = flight_times(duration_s, None, fps)
    assert times_s[0] == 0.0
    assert np.allclose(np.diff(times_s), 1.0 / fps)
    assert times_s[-1] <= duration_s + 1e-3 < times_s[-1] + 1.0 / fps + 2e-3


@given(duration_s=st.floats(0.0, 600.0), frames=st.integers(2, 500))
def test_a_number_of_pictures_covers_the_flight_from_end_to_end(duration_s, frames):
    times_s = flight_times(duration_s, frames, 30)
    assert (len(times_s), times_s[0], times_s[-1]) == (frames, 0.0, duration_s)


def test_one_picture_is_the_first_moment():
    assert flight_times(9.0, 1, 30) == [0.0]


def test_every_sink_gets_every_picture_in_order(session):
    class Sink(list):
        add = list.append

    sinks = [Sink(), Sink()]
    times_s = [0.0, 1.0, 2.0]
    cameras = [session.flights.camera_at(time_s) for time_s in times_s]
    write_pictures(draw_pictures(session.stage, cameras, times_s, (32, 18), "shaded"), 3, sinks, "Testing")
    assert [picture.shape for picture in sinks[0]] == [(18, 32, 3)] * 3
    assert all(np.array_equal(a, b) for a, b in zip(*sinks, strict=True))
    assert not np.array_equal(sinks[0][0], sinks[0][2])
