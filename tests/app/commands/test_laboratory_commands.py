"""The laboratory's commands: what they write, what they say, and their exit status."""

from __future__ import annotations

import csv
import json

import pytest
from command_line import run

from app.commands import laboratory
from terrain.measure import hostile, stability
from terrain.measure.reproduce import Claim, Reproduction, Table
from terrain.measure.sweep import Sweep
from terrain.renderers import RENDERERS
from terrain.renderers.reference import ReferenceRenderer

SMALL = ["--frames", "2", "--size", "64x48", "--algorithms", "geomorph"]


@pytest.fixture
def two_cases(monkeypatch):
    """A check of two cases on one scene."""
    monkeypatch.setattr("terrain.measure.hostile.HOSTILE_SCENES", ("cliffs",))
    paths = hostile.hostile_paths
    wanted = ("straight down", "rolled")
    monkeypatch.setattr(stability, "hostile_paths", lambda terrain: {n: paths(terrain)[n] for n in wanted})
    monkeypatch.setattr(stability, "SEARCH_RANDOM", 2)
    monkeypatch.setattr(stability, "SEARCH_STEPS", 2)


def test_chart_writes_tables_charts_and_a_report(tmp_path, capsys, monkeypatch):
    words = ["chart", "waves:65", *SMALL, "--tolerances", "1,4", "--out", "out"]
    monkeypatch.setattr("sys.argv", ["reliefscope", *words])
    assert run(*words) == 0
    said = capsys.readouterr().out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names >= {
        "results.json", "results.csv", "chart.png", "chart.svg", "multiples.png", "multiples.svg", "report.html"
    }  # fmt: skip
    runs = json.loads((tmp_path / "out/results.json").read_text())["runs"]
    assert [(r["algorithm"], r["settings"]["tolerance_px"]) for r in runs] == [
        ("reference", 1.0), ("geomorph", 1.0), ("geomorph", 4.0)
    ]  # fmt: skip
    report = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "reliefscope chart waves:65" in report
    assert report.count("data:image/png") == 6  # a picture and its error for every run
    assert said.count(" ms ") == 3
    assert "report.html" in said


def test_an_interrupted_chart_keeps_what_is_done_and_goes_on(tmp_path, capsys, monkeypatch):
    words = ["chart", "waves:65", *SMALL, "--tolerances", "1", "--out", "out"]
    steps = Sweep.steps

    def broken_off(self):
        for step in steps(self):
            if step.doing.startswith("accuracy of geomorph"):
                raise KeyboardInterrupt
            yield step

    with monkeypatch.context() as patch:
        patch.setattr(Sweep, "steps", broken_off)
        assert run(*words) == 130
    assert "goes on" in capsys.readouterr().err
    kept = json.loads((tmp_path / "out/results.json").read_text())["runs"]
    assert "geometric_error_px" in kept[0]
    assert "geometric_error_px" not in kept[1]
    assert "frame_ms" in kept[1]
    assert run(*words) == 0
    whole = json.loads((tmp_path / "out/results.json").read_text())["runs"]
    assert whole[0] == kept[0]
    assert whole[1]["frame_ms"] == kept[1]["frame_ms"]  # not measured again
    assert "geometric_error_px" in whole[1]


def test_check_tells_each_case_and_passes(tmp_path, capsys, two_cases):
    assert run("check", "--algorithms", "reference,geomorph", "--out", "out") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines[:-1]] == [["ok", "reference"]] * 3 + [["ok", "geomorph"]] * 3
    assert lines[-1].startswith("6 cases: 0 failed")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["check.json"]


def test_check_fails_with_a_card_that_can_be_rendered(tmp_path, capsys, two_cases, monkeypatch):
    class Loose(RENDERERS["geomorph"]):
        def _steered_tolerance(self):
            return 20.0

    monkeypatch.setitem(RENDERERS, "geomorph", Loose)
    assert run("check", "--algorithms", "geomorph", "--out", "out") == 1
    said = capsys.readouterr().out
    assert "FAIL" in said
    cases = json.loads((tmp_path / "out/check.json").read_text())["cases"]
    failed = [case for case in cases if case["outcome"] == "FAIL"]
    assert failed
    assert all((tmp_path / "out").glob(f"*{case['case'].replace(' ', '-')}.png") for case in failed)
    command = next(line.split()[1:] for line in said.splitlines() if line.startswith("  reliefscope render"))
    assert run(*command) == 0


def test_check_takes_a_terrain_of_one_s_own(capsys, two_cases):
    assert run("check", "waves:33", "--algorithms", "reference", "--out", "out") == 0
    assert "waves / straight down" in capsys.readouterr().out


def test_reproduce_prints_and_writes_the_tables(tmp_path, capsys, monkeypatch):
    def found(gpu, folder, progress):
        progress(0.5, "half")
        table = Table("table7", "Table 7: speeds", ("posts", "ours [fps]", "paper [fps]"), [(513, 20.0, 66.25)])
        return Reproduction([table], (), [Claim("it is fast", "66 fps", "20 fps", False)])

    monkeypatch.setattr("terrain.measure.papers.geomorph.reproduce", found)
    assert run("reproduce", "geomorph", "--out", "out") == 0
    said = capsys.readouterr().out
    assert "66.25" in said
    assert "NOT HELD: it is fast" in said
    with (tmp_path / "out/table7.csv").open() as file:
        assert list(csv.reader(file))[1] == ["513", "20.0", "66.25"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["chart", "waves:33"], "--out"),
        (["chart", "waves:33", "--out", "o", "--algorithms", "geomorf"], "geomorf"),
        (["chart", "waves:33", "--out", "o", "--tolerances", "1,-2"], "-2"),
        (["chart", "waves:33", "--out", "o", "--tolerances", ""], "number"),
        (["chart", "waves:33", "--out", "o", "--frames", "0"], "0"),
        (["chart", "nowhere.tif", "--out", "o"], "nowhere"),
        (["check", "--out", "o", "--algorithms", "x"], "x"),
        (["check", "--out", "a-file/o"], "a-file"),
        (["reproduce", "reference", "--out", "o"], "reference"),
        (["reproduce"], "ALGORITHM"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_bad_input_is_one_line_and_status_2(words, expected, capsys, tmp_path):
    (tmp_path / "a-file").write_text("mine")
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert expected in said


def test_all_algorithms_are_taken_where_none_is_named():
    assert laboratory._algorithms(None) == list(RENDERERS)
    assert ReferenceRenderer.name not in laboratory._algorithms(None, leave_out=ReferenceRenderer.name)
