"""Figure 6 of the multiresolution model, in small: every way measured, and claims judged by what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.algorithms.refined_cells import refine_cells
from terrain.algorithms.rtin import padded_shape
from terrain.camera import Camera
from terrain.heightfield import Heightfield
from terrain.measure.papers import multiresolution as figure6
from terrain.measure.papers.multiresolution import BAKED, GOURAUD, ONE, TWO, WITH, WITHOUT, Plan


def hills(rows: int, cols: int) -> Heightfield:
    row, col = np.indices((rows, cols))
    return Heightfield((20 * np.sin(row / 5.0) * np.cos(col / 7.0)).astype(np.float32), (10.0, 10.0), name="hills")


def test_every_shading_is_measured_with_and_without_detail(gpu):
    plan = Plan((64, 32), 1300, (500, 250), (640, 320), frames=2, window_px=(96, 72), rounds=1)
    cameras = [Camera((160.0, 60.0, 600.0), 0.0, -15.0), Camera((100.0, 90.0, 500.0), 30.0, -20.0)]
    shares = []
    found = figure6.measure(gpu, hills(65, 33), cameras, plan, lambda share, doing: shares.append(share))
    times, data = found.tables
    assert [row[0] for row in times.rows] == [GOURAUD, BAKED, ONE, TWO]
    for row in times.rows:
        assert all(value > 0 for value in row[1:])
        assert row[4] > row[5]  # triangles without and with level of detail
    figures = {row[0]: row[1] for row in data.rows}
    assert 800 < figures["triangles that fine structures add"] < 1800
    assert figures["triangles in all"] == 2 * 64 * 32 + figures["triangles that fine structures add"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(found.claims) == 5
    assert all(len(points) == 2 for points in found.plots[0].series.values())


def test_claims_hold_where_the_times_say_so():
    def claims(gouraud, one, two, gain):
        slow = {GOURAUD: gouraud, BAKED: one, ONE: one, TWO: two}
        times = {(name, WITHOUT): np.full(4, ms * gain) for name, ms in slow.items()}
        times |= {(name, WITH): np.full(4, ms) for name, ms in slow.items()}
        return [claim.held for claim in figure6._claims(times)]

    assert claims(30.0, 10.0, 20.0, 10.0) == [True] * 5
    assert claims(10.0, 20.0, 30.0, 10.0) == [True, False, False, False, False]
    assert claims(300.0, 20.0, 30.0, 10.0)[0] is False
    assert claims(30.0, 10.0, 20.0, 0.9)[0] is False


def test_roads_refine_as_many_cells_as_the_paper_says():
    terrain = hills(161, 81)  # a sixteenth of the paper's
    roads = figure6.build_roads(terrain, 130_000 // 16)
    refined = refine_cells(terrain, roads, padded_shape(161, 81, 6), 6)
    cells, triangles = refined.counts
    added = triangles - 2 * cells
    assert added == pytest.approx(130_000 / 16, rel=0.2)
    assert 0.1 < cells / (160 * 80) < 0.25


def test_textures_show_the_relief_and_its_zones():
    terrain = hills(65, 33)
    relief = figure6.shade_relief(terrain, (128, 64))
    assert relief.shape == (128, 64, 3)
    assert relief.std() > 10
    zones = figure6.colour_zones(terrain, (128, 64))
    assert zones.shape == (128, 64, 4)
    assert len(np.unique(zones[..., :3].reshape(-1, 3), axis=0)) >= 5
