"""Table 1 of the perturbed base planes, in small: every cell measured, and claims judged by what was measured."""

from __future__ import annotations

import numpy as np
import pytest

from terrain.measure.papers import perturbation as table1


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(table1, "CELLS", (32, 64))
    monkeypatch.setattr(table1, "GROWTH_LIMITS", ())
    monkeypatch.setattr(table1, "SIZE_PX", (96, 54))
    monkeypatch.setattr(table1, "REPEATS", 1)


def test_every_resolution_is_measured_in_every_way(gpu, small, tmp_path):
    shares = []
    found = table1.reproduce(gpu, tmp_path, lambda share, doing: shares.append(share))
    (table,) = found.tables
    assert [row[0] for row in table.rows] == ["32x32", "64x64"]
    for row in table.rows:
        assert row[1:4] == (None, None, None)  # the paper has no such map
        assert all(value > 0 for value in row[4:])
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert {name for name in found.plots[0].series if "paper" in name} == {
        "paper, i7-2700K", "paper, GTX 550 Ti", "paper, GTX 750 Ti"
    }  # fmt: skip
    assert len(found.claims) == 1


def test_claims_hold_where_the_times_say_so():
    def claims(growth_1024, growth_4096, cpu):
        gpu = {256: 10.0, 1024: 10.0 * growth_1024, 4096: 10.0 * growth_4096}
        cost = {"GPU, within 1 px": gpu, "GPU, full detail": gpu, "CPU": dict.fromkeys(gpu, cpu)}
        return [claim.held for claim in table1._claims(cost)]

    assert claims(1.05, 1.5, 1000.0) == [True] * 5
    assert claims(1.2, 1.5, 1000.0) == [False, True, False, True, True]
    assert claims(1.0, 1.7, 100.0) == [True, False, True, False, False]


def test_coarser_maps_sample_the_same_landscape():
    heights = table1._landscape(64)
    assert heights.shape == (65, 65)
    assert heights.min() == 0
    assert heights.max() == pytest.approx(3000, rel=1e-4)
    coarse = table1._sampled(heights, 16)
    assert np.array_equal(coarse.heights_m, heights[::4, ::4])
    assert coarse.extent_m == pytest.approx(table1.EXTENT_M)
    assert len({camera.position_m for camera in table1._cameras(heights)}) == 6
