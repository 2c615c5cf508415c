"""The reproduction of adaptive slicing measures figure 5 and says what holds of it."""

from __future__ import annotations

import pytest

from terrain.measure.papers.mountains import benchmark_terrain
from terrain.measure.papers.slicing import PAPER, Plan, flight_camera, measure
from terrain.measure.reproduce import format_table, write_reproduction


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RELIEFSCOPE_CACHE", str(tmp_path / "cache"))


def test_figure_5_and_every_claim_is_there(gpu, tmp_path):
    shares = []
    plan = Plan(sizes=(65, 129), windows_px=((40, 30), (64, 48)), frames=3, turns=1)
    found = measure(gpu, plan, lambda share, _: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert [t.name for t in found.tables] == ["figure5_65", "figure5_129"]
    assert [len(t.rows) for t in found.tables] == [2, 2]
    assert all(row[5] > 0 and row[6] <= row[5] for table in found.tables for row in table.rows)
    assert "speed-up" in format_table(found.tables[0])
    assert len(found.claims) == 6
    assert next(c for c in found.claims if "below a pixel" in c.text).held
    paths = write_reproduction(tmp_path, "slicing", {}, found)
    assert {"reproduction.json", "figure5_65.csv", "figure5_129.png"} <= {p.name for p in paths}


def test_the_papers_figure_is_whole():
    assert list(PAPER) == [(400, 300), (512, 384), (640, 480), (800, 600), (1024, 768)]
    rates = [row[0] for row in PAPER.values()]
    assert rates == sorted(rates, reverse=True)


def test_the_flight_stays_over_the_terrain():
    terrain = benchmark_terrain(65)
    for number in range(12):
        x, y, z = flight_camera(terrain, number / 12).position_m
        assert y > terrain.heights_at(x, z)
