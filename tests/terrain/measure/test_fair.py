"""Fair switching judged: searches with known answers, and pictures whose delivered error is then the wanted one."""

from __future__ import annotations

import numpy as np
import pytest
from generators import finish
from hypothesis import given
from hypothesis import strategies as st

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.fair import (
    REACHED,
    Tuned,
    best_for_error,
    best_for_time,
    delivered_error,
    equal_error,
    equal_time,
    search_tolerance,
    settings_of,
)  # fmt: skip
from terrain.renderers import RENDERERS
from terrain.scene import open_scene
from terrain.stage import Stage

SIZE_PX = (240, 160)
LIMITS = (0.25, 16.0)
VIEWS = [(0.0, Camera((300.0, 260.0, 2900.0), 25.0, -14.0)), (0.5, Camera((600.0, 300.0, 2700.0), 5.0, -20.0))]


@pytest.fixture
def stage(gpu):
    z, x = np.mgrid[:130, :150] * 0.11
    heights = (60 * np.sin(x) * np.cos(0.7 * z) + 25 * np.sin(2.3 * x + z)).astype(np.float32)
    stage = Stage(gpu, open_scene(Heightfield(heights, (20.0, 25.0))), "reference")
    yield stage
    stage.release()


def find(figure, wanted, falls=False):
    """What the search finds for a known law, and how often it measured."""
    search, tried = search_tolerance(wanted, LIMITS, falls), []
    tolerance = next(search)
    try:
        while True:
            tried.append(tolerance)
            tolerance = search.send(figure(tolerance))
    except StopIteration as found:
        return found.value, tried


@given(st.floats(0.3, 14.0), st.floats(0.3, 3.0), st.floats(0.5, 2.0))
def test_a_rising_law_is_solved_within_the_range(tolerance, factor, power):
    law = lambda t: factor * t**power  # noqa: E731
    (found, figure), tried = find(law, law(tolerance))
    assert figure == pytest.approx(law(tolerance), rel=0.05)
    assert figure == law(found)
    assert all(LIMITS[0] <= t <= LIMITS[1] for t in tried)


@given(st.floats(0.3, 14.0))
def test_a_falling_law_is_solved_too(tolerance):
    (found, _), _ = find(lambda t: 40.0 / t, 40.0 / tolerance, falls=True)
    assert found == pytest.approx(tolerance, rel=0.05)


def test_a_law_out_of_reach_gives_the_nearest_end():
    (found, figure), _ = find(lambda t: 0.1 * t, 50.0)
    assert found == pytest.approx(LIMITS[1], rel=0.05)
    assert figure < 2.0


def test_who_delivers_what_is_asked_is_measured_once():
    _, tried = find(lambda t: t, 3.0)
    assert tried == [3.0]


def test_equal_error_makes_algorithms_deliver_the_same(stage):
    names = [name for name in ("geomorph", "multiresolution") if name in RENDERERS]
    wanted_px = 1.5
    steps = list(equal_error(stage, {n: RENDERERS[n].Settings() for n in names}, VIEWS, SIZE_PX, wanted_px))
    tuned = [step for step in steps if isinstance(step, Tuned)]
    assert [t.algorithm for t in tuned] == names
    assert steps.count(None) >= 2 * len(names)
    for result in tuned:
        assert result.is_reached
        assert result.figure == pytest.approx(wanted_px, rel=REACHED)
        renderer = RENDERERS[result.algorithm](stage.gpu, stage.scene, result.settings)
        assert finish(delivered_error(stage, renderer, VIEWS, SIZE_PX)) == pytest.approx(result.figure, rel=0.02)
        renderer.release()


def test_equal_time_turns_the_tolerance_until_frames_take_as_long(stage, monkeypatch):
    def frame_of_known_cost(stage, renderer, camera, time_s, target):
        return {"frame_ms": 24.0 / renderer.settings.tolerance_px}

    monkeypatch.setattr("terrain.measure.fair.time_frame", frame_of_known_cost)
    tuned = [s for s in equal_time(stage, {"geomorph": RENDERERS["geomorph"].Settings()}, VIEWS, SIZE_PX, 8.0) if s]
    assert tuned[0].settings.tolerance_px == pytest.approx(3.0, rel=0.05)
    assert tuned[0].is_reached


def test_the_reference_cannot_be_made_worse_and_says_so(stage):
    tuned = [s for s in equal_error(stage, {"reference": RENDERERS["reference"].Settings()}, VIEWS, SIZE_PX, 2.0) if s]
    assert not tuned[0].is_reached
    assert tuned[0].figure < 0.05


def run(algorithm, tolerance, ms, error):
    return {
        "algorithm": algorithm, "settings": {"tolerance_px": tolerance},
        "frame_ms": {"p50": ms}, "geometric_error_px": {"p999": error},
    }  # fmt: skip


RUNS = [
    run("geomorph", 1.0, 20.0, 0.8),
    run("geomorph", 4.0, 8.0, 3.0),
    run("multiresolution", 1.0, 15.0, 0.9),
    run("multiresolution", 4.0, 9.0, 2.5),
    {"algorithm": "painter", "settings": {"tolerance_px": 1.0}, "frame_ms": {"p50": 1.0}},
]


def test_the_best_run_for_an_error_is_the_fastest_that_keeps_it():
    assert best_for_error(RUNS, 1.0) is RUNS[2]
    assert best_for_error(RUNS, 0.85) is RUNS[0]
    assert best_for_error(RUNS, 5.0) is RUNS[1]
    assert best_for_error(RUNS, 0.1) is None


def test_the_best_run_for_a_time_is_the_most_accurate_that_keeps_it():
    assert best_for_time(RUNS, 30.0) is RUNS[0]
    assert best_for_time(RUNS, 10.0) is RUNS[3]
    assert best_for_time(RUNS, 5.0) is None


@given(st.lists(st.tuples(st.floats(1, 99), st.floats(0.1, 9)), max_size=8), st.floats(0.1, 9))
def test_no_other_run_within_the_error_is_faster(points, error_px):
    runs = [run("geomorph", 1.0, ms, error) for ms, error in points]
    best = best_for_error(runs, error_px)
    within = [ms for ms, error in points if error <= error_px]
    assert (best["frame_ms"]["p50"] if best else None) == min(within, default=None)


def test_settings_of_a_run_are_those_it_was_measured_with():
    assert settings_of(RUNS[1]) == RENDERERS["geomorph"].Settings(tolerance_px=4.0)
