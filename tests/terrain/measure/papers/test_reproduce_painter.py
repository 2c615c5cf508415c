"""The painter's reproduction measures every table of the paper, names what it claims, and sees a wrong picture."""

from __future__ import annotations

from terrain.measure.papers import painter
from terrain.measure.papers.mountains import benchmark_terrain
from terrain.measure.papers.painter import Plan, compare_modes, measure
from terrain.measure.papers.painter_tables import PAPER, PAPER_RANDOMNESS, RANDOMNESS
from terrain.measure.reproduce import format_table, write_reproduction
from terrain.renderers.painter import PainterRenderer


def test_every_table_figure_and_claim_is_there(gpu, tmp_path, monkeypatch):
    monkeypatch.setitem(PAPER, 65, PAPER[512])
    shares = []
    plan = Plan(sizes=(33, 65), depths=(0, 4), frames=1, window_px=(64, 40), eyes=6)
    found = measure(gpu, plan, lambda share, _: shares.append(share))
    assert [t.name for t in found.tables] == ["table1", "table2", "table4"]
    assert [p.name for p in found.plots] == [
        "figure16_33", "figure20_33", "figure16_65", "figure20_65", "figure18a", "figure18b"
    ]  # fmt: skip
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    text = format_table(found.tables[1])
    assert "744" in text  # the paper's correct order, static eye, depth 0
    assert "correct, by number" in text
    assert all(value > 0 for table in found.tables for row in table.rows for value in row if isinstance(value, float))
    assert next(c for c in found.claims if c.text.startswith("the picture")).held
    paths = write_reproduction(tmp_path, "painter", {}, found)
    assert {"reproduction.json", "table4.csv", "figure18b.png"} <= {p.name for p in paths}


def test_the_papers_tables_are_whole():
    for posts, eyes in PAPER.items():
        assert {len(values) for eye in eyes for values in eye.values()} == {9 if posts < 2048 else 8}
    assert {len(values) for values in PAPER_RANDOMNESS.values()} == {len(RANDOMNESS)}


def test_comparing_modes_sees_a_wrong_order(gpu, monkeypatch):
    pixels, differing = compare_modes(gpu, 12)
    assert pixels == 12 * 96 * 64
    assert differing <= 1e-4 * pixels
    monkeypatch.setattr(PainterRenderer, "_foot_of", lambda self, frame: painter.foot_at(0.0, 0.0))
    assert compare_modes(gpu, 12)[1] > 100


def test_the_benchmark_is_the_same_at_every_run_and_mountainous():
    first, second = benchmark_terrain(64), benchmark_terrain(64)
    assert first.sha256 == second.sha256
    low, high = first.height_range_m
    assert 0.1 < (high - low) / first.extent_m[0] < 0.3
