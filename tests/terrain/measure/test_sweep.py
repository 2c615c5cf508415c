"""Sweeps: repeatable, resumable, and what is done survives being broken off."""

from __future__ import annotations

import json

import numpy as np
import pytest

from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.results import flatten_run, read_results, write_results
from terrain.measure.sweep import STATE_FILE, Sweep, plan_runs
from terrain.pyramid import build_pyramid
from terrain.scene import Scene
from terrain.stage import Stage

SIZE = (96, 64)
VIEWS = [(i / 24, Camera((100.0 + 40 * i, 160.0, 900.0 - 60 * i), 30.0, -20.0)) for i in range(3)]
ACCURACY = ("geometric_error_px", "vertical_error_m", "holes_px", "silhouette_px", "flip", "psnr_db", "popping_px")


@pytest.fixture
def stage(gpu):
    z, x = np.mgrid[:65, :81] * 0.17
    heights = (60 * np.sin(x) * np.cos(0.7 * z) + 20 * np.sin(2.3 * x + z)).astype(np.float32)
    field = Heightfield(heights, (15.0, 15.0), name="hills")
    stage = Stage(gpu, Scene(field, build_pyramid(heights)), "reference")
    yield stage
    stage.release()


def make(stage: Stage, folder=None, tolerances=(1.0, 4.0)) -> Sweep:
    return Sweep(stage, plan_runs(["geomorph"], tolerances), VIEWS, SIZE, "short", folder)


def accuracy(results: dict) -> list[dict]:
    return [{name: run.get(name) for name in ACCURACY} for run in results["runs"]]


def test_the_reference_is_planned_once_and_first() -> None:
    runs = plan_runs(["geomorph", "reference", "painter"], [1.0, 2.0])
    assert [run.algorithm for run in runs] == ["reference", "geomorph", "geomorph", "painter", "painter"]
    assert runs[2].settings.tolerance_px == 2.0
    assert "tolerance_px=2.0" in runs[2].label


def test_two_sweeps_measure_the_same_accuracy_and_every_figure(stage) -> None:
    found = []
    for _ in range(2):
        sweep = make(stage)
        shares = [step.share for step in sweep.steps()]
        assert shares == sorted(shares)
        assert shares[-1] == pytest.approx(1.0)
        found.append(sweep.results())
    assert accuracy(found[0]) == accuracy(found[1])
    reference, fine, coarse = found[0]["runs"]
    assert reference["geometric_error_px"]["max"] < 0.02
    assert fine["geometric_error_px"]["p999"] <= 1.0
    assert fine["geometric_error_px"]["p999"] < coarse["geometric_error_px"]["p999"] <= 4.0
    assert fine["triangles"] > coarse["triangles"]
    for run in found[0]["runs"]:
        assert 0 < run["frame_ms"]["p50"] <= run["frame_ms"]["p95"] <= run["frame_ms"]["p99"]
        low, high = run["frame_ms"]["spread"]
        assert 0 < low <= high
        assert run["overdraw"]["mean"] >= 1.0
        assert run["holes_px"] == 0


def test_a_sweep_goes_on_where_it_was_broken_off(stage, tmp_path) -> None:
    first = make(stage, tmp_path)
    steps = first.steps()
    for step in steps:
        if step.doing.startswith("accuracy of geomorph"):
            break
    steps.close()
    kept = first.results()["runs"]
    assert all("frame_ms" in run for run in kept)  # both rounds of timing
    assert "geometric_error_px" in kept[0]
    assert "geometric_error_px" not in kept[1]  # not finished: left out, not guessed

    second = make(stage, tmp_path)
    assert second.results()["runs"] == kept
    doing = {step.doing for step in second.steps()}
    assert not any("timing" in text or "reference" in text for text in doing)
    whole = second.results()
    assert accuracy(whole) == accuracy(_finished(make(stage)))
    assert not list(make(stage, tmp_path).steps())  # nothing is left to do


def test_the_state_of_another_sweep_is_not_taken_up(stage, tmp_path) -> None:
    _finished(make(stage, tmp_path))
    other = make(stage, tmp_path, tolerances=(1.0, 2.0))
    assert all("frame_ms" not in run for run in other.results()["runs"])


@pytest.mark.parametrize("text", ["", "{", "[]", '{"key": 1}'])
def test_a_damaged_state_is_measured_anew(stage, tmp_path, text) -> None:
    (tmp_path / STATE_FILE).write_text(text)
    assert all(a is None for a in make(stage, tmp_path).accuracies)


def test_the_stage_is_left_as_it_was(stage) -> None:
    own = stage.renderer
    _finished(make(stage, tolerances=(2.0,)))
    assert stage.renderer is own


def test_results_are_read_as_they_were_written(stage, tmp_path) -> None:
    results = _finished(make(stage, tolerances=(2.0,)))
    json_path, csv_path = write_results(tmp_path, results)
    assert read_results(json_path) == json.loads(json.dumps(results))
    header, *rows = csv_path.read_text().splitlines()
    assert len(rows) == len(results["runs"])
    assert {"algorithm", "settings.tolerance_px", "frame_ms.p50", "geometric_error_px.p999"} <= set(header.split(","))
    assert flatten_run({"a": {"b": [1, 2]}, "c": 3}) == {"a.b.0": 1, "a.b.1": 2, "c": 3}


def _finished(sweep: Sweep) -> dict:
    for _ in sweep.steps():
        pass
    return sweep.results()
