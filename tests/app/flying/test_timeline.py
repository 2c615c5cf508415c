"""Editing a flight keeps its times in order, loses nothing, and can be undone."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from app.flying.timeline import Timeline
from terrain.camera import Camera
from terrain.flight import Flight, Keyframe


def camera(x):
    return Camera((float(x), 0.0, 0.0))


def timeline_of(*times):
    return Timeline(Flight(tuple(Keyframe(float(t), camera(i)) for i, t in enumerate(times))))


class Editing(RuleBasedStateMachine):
    """Any edits in any order."""

    def __init__(self):
        super().__init__()
        self.timeline = timeline_of(0, 1, 2)
        self.history, self.number = [self.timeline.flight], 10

    def pick(self, index):
        return index % len(self.timeline.flight.keyframes)

    def edited(self):
        self.history.append(self.timeline.flight)

    @rule(t=st.floats(0, 100))
    def add(self, t):
        self.number += 1
        index = self.timeline.add(t, camera(self.number))
        assert self.timeline.flight.keyframes[index].camera == camera(self.number)
        self.edited()

    @rule(index=st.integers(0, 50), t=st.floats(-5, 100))
    def move(self, index, t):
        index = self.pick(index)
        before = self.timeline.flight.keyframes
        after = self.timeline.move(index, t)
        now = self.timeline.flight.keyframes
        assert now[after].camera == before[index].camera
        assert now[after].t_s == max(t, 0.0)
        assert sorted(key.camera.position_m for key in now) == sorted(key.camera.position_m for key in before)
        self.edited()

    @rule(index=st.integers(0, 50))
    def delete(self, index):
        before = self.timeline.flight.keyframes
        if self.timeline.delete(self.pick(index)):
            assert len(self.timeline.flight.keyframes) == len(before) - 1
            self.edited()
        else:
            assert len(before) == 1

    @rule(index=st.integers(0, 50))
    def update(self, index):
        self.number += 1
        self.timeline.update(self.pick(index), camera(self.number))
        self.edited()

    @rule(duration=st.floats(0.1, 500))
    def stretch(self, duration):
        if self.timeline.flight.duration_s > 0.0:
            self.timeline.stretch(duration)
            assert self.timeline.flight.duration_s == duration
            self.edited()

    @rule()
    def undo(self):
        self.timeline.undo()
        if len(self.history) > 1:
            self.history.pop()
        assert self.timeline.flight is self.history[-1]

    @invariant()
    def times_are_in_order(self):
        times = self.timeline.times_s
        assert times == sorted(times)
        assert self.timeline.selected is None or 0 <= self.timeline.selected < len(times)


TestEditing = Editing.TestCase
TestEditing.settings = settings(max_examples=25, stateful_step_count=20)


def test_undo_leads_back_to_the_beginning_and_redo_to_the_end():
    timeline = timeline_of(0, 1)
    first = timeline.flight
    timeline.add(0.5, camera(7))
    timeline.move(1, 3.0)
    last = timeline.flight
    for _ in range(5):
        timeline.undo()
    assert timeline.flight is first
    assert not timeline.can_undo
    for _ in range(5):
        timeline.redo()
    assert timeline.flight is last
    assert not timeline.can_redo


def test_a_new_edit_forgets_what_was_undone():
    timeline = timeline_of(0, 1)
    timeline.add(2.0, camera(7))
    timeline.undo()
    timeline.delete(0)
    assert not timeline.can_redo


@given(st.lists(st.floats(0, 9), min_size=1, max_size=20))
def test_a_drag_is_one_step_of_undo_and_depends_only_on_where_it_ends(times):
    dragged, moved = timeline_of(0, 1, 2, 5), timeline_of(0, 1, 2, 5)
    start = dragged.flight
    for t in times:
        dragged.move(1, t, dragging=True)
    dragged.drop()
    moved.move(1, times[-1])
    assert dragged.flight == moved.flight
    dragged.undo()
    assert dragged.flight is start


def test_a_keyframe_added_where_one_is_gives_that_one_the_view():
    timeline = timeline_of(0, 1)
    assert timeline.add(1.0001, camera(7)) == 1
    assert timeline.times_s == [0.0, 1.0]
    assert timeline.flight.keyframes[1].camera == camera(7)


def test_changed_is_what_differs_from_what_was_saved():
    timeline = timeline_of(0, 1)
    assert not timeline.is_changed
    timeline.add(0.5, camera(7))
    assert timeline.is_changed
    timeline.undo()
    assert not timeline.is_changed
    timeline.redo()
    timeline.mark_saved(timeline.flight)
    assert not timeline.is_changed


def test_another_flight_can_be_taken_back():
    timeline = timeline_of(0, 1)
    first = timeline.flight
    timeline.restart(Flight((Keyframe(0.0, camera(3)),)))
    timeline.undo()
    assert timeline.flight is first


def test_times_beyond_a_day_and_before_the_start_are_held_back():
    timeline = timeline_of(0, 1)
    timeline.move(0, 1e9)
    assert timeline.flight.duration_s == pytest.approx(86400.0)
    timeline.stretch(-1.0)
    assert timeline.flight.duration_s == pytest.approx(86400.0)
