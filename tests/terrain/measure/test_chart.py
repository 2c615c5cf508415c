"""Charts: the front, the marks of broken promises, what is drawn from a results file, and the files written."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from terrain.measure.chart import (
    draw_chart,
    draw_multiples,
    is_promise_kept,
    pareto_front,
    style,
    write_chart,
)
from terrain.measure.report import write_report
from terrain.renderers import RENDERERS

POINTS = st.lists(st.tuples(st.floats(0.1, 1e3), st.floats(1e-3, 1e3)), max_size=30)


def run(algorithm: str, tolerance: float, ms: float, error: float) -> dict:
    return {
        "algorithm": algorithm,
        "settings": {"tolerance_px": tolerance},
        "frame_ms": {"p50": ms, "p95": 1.2 * ms, "p99": 1.5 * ms, "spread": [0.9 * ms, 1.1 * ms]},
        "triangles": 100_000 / tolerance,
        "overdraw": {"mean": 1.3, "max": 5.0},
        "geometric_error_px": {"mean": 0.2 * error, "p99": 0.8 * error, "p999": error, "max": 1.4 * error},
        "popping_px": {"p99": 0.1 * error, "max": error},
        "holes_px": 0,
        "silhouette_px": {"mean": 0.1, "max": 1.0, "differing": 3},
    }


def results(runs: list[dict]) -> dict:
    return {
        "machine": {
            "renderer": "softpipe", "gl": "4.5", "cpu": "a <fast> one", "cores": 2, "python": "3", "reliefscope": "0",
        },
        "terrain": {
            "name": "a & b", "sha256": "0" * 64, "rows": 65, "cols": 65, "spacing_m": [1, 1], "height_m": [0, 10],
        },
        "viewport": [64, 48],
        "flight": {"name": "tour", "frames": 4},
        "runs": runs,
    }  # fmt: skip


RUNS = [
    run("reference", 1.0, 60.0, 0.001),
    *(run("geomorph", t, 20 / t, 0.8 * t) for t in (0.5, 1.0, 2.0)),
    *(run("painter", t, 40 / t, 1.5 * t) for t in (0.5, 1.0, 2.0)),
]


@given(POINTS)
def test_nothing_beats_a_point_on_the_front_and_something_beats_every_other(points) -> None:
    front = pareto_front(points)
    assert front == sorted(front)
    for cost, error in front:
        assert not any((c <= cost and e < error) or (c < cost and e <= error) for c, e in points)
    for cost, error in points:
        assert any(c <= cost and e <= error for c, e in front)


def test_a_promise_is_kept_up_to_the_tolerance() -> None:
    assert is_promise_kept(run("geomorph", 2.0, 1.0, 2.0))
    assert not is_promise_kept(run("geomorph", 2.0, 1.0, 2.001))


def test_every_renderer_has_a_look_of_its_own() -> None:
    assert len({style(name) for name in RENDERERS}) == len(RENDERERS)


def test_hollow_points_are_those_that_broke_their_promise() -> None:
    axes = draw_chart(results(RUNS)).axes[0]
    hollow = {float(line.get_ydata()[0]) for line in axes.lines if line.get_markerfacecolor() == "white"}
    broken = {r["geometric_error_px"]["p999"] for r in RUNS if not is_promise_kept(r)}
    assert hollow == broken
    assert len(broken) == 3
    assert {text.get_text() for text in axes.texts} >= {"0.5", "1", "2"}
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_multiples_leave_out_what_was_not_measured() -> None:
    runs = [{k: v for k, v in r.items() if k != "overdraw"} for r in RUNS]
    titles = {axes.get_title(): len(axes.lines) for axes in draw_multiples(results(runs)).axes}
    assert titles["triangles"] == 3  # two algorithms and the reference
    assert titles["overdraw, mean"] == 0


@pytest.mark.filterwarnings("error")
def test_charts_are_written_and_the_report_is_one_self_contained_file(tmp_path: Path) -> None:
    paths = write_chart(results(RUNS), tmp_path)
    assert [path.name for path in paths] == ["chart.png", "chart.svg", "multiples.png", "multiples.svg"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in paths)
    with Image.open(paths[0]) as image:
        assert len(image.convert("RGB").getcolors(1 << 20)) > 20
    report = write_report(tmp_path, results(RUNS), [paths[1], paths[3]], [], "reliefscope chart 'a & b'")
    text = report.read_text(encoding="utf-8")
    assert text.count("<svg") == 2
    assert "a &amp; b" in text
    assert "a &lt;fast&gt; one" in text
    assert text.count("class='broken'") == 3
    assert not any(word in text for word in ("src='http", 'src="http', "<script", "<link"))


@pytest.mark.parametrize("runs", [RUNS[:1], RUNS[:2], RUNS[1:2]])
def test_charts_of_few_runs_can_be_drawn(tmp_path: Path, runs) -> None:
    assert len(write_chart(results(runs), tmp_path)) == 4
