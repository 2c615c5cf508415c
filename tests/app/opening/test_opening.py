"""Embedded scenes and tours come back from the cache as they were made."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from app.opening.flight import open_tour
from app.opening.terrain import open_terrain
from terrain import synthetic
from terrain.flight import demo_flight


@pytest.mark.parametrize("scene", ["waves:65", "waves:65:3"])
def test_cached_scene_is_the_scene(scene, own_cache, monkeypatch):
    args = argparse.Namespace(terrain=scene, encoding=None, raw=None, spacing=None, height_scale=1.0)
    made = open_terrain(args)
    with monkeypatch.context() as patch:
        patch.setattr(synthetic, "make_scene", None)
        found = open_terrain(args)
    assert np.array_equal(found.heights_m, made.heights_m)
    assert (found.spacing_m, found.name, found.notes) == (made.spacing_m, made.name, made.notes)


def test_a_file_is_opened_with_the_options_given(tmp_path):
    np.save(tmp_path / "waves.npy", np.arange(12.0).reshape(3, 4))
    args = argparse.Namespace(
        terrain=str(tmp_path / "waves.npy"), encoding=None, raw=None, spacing=5.0, height_scale=1.0
    )
    opened = open_terrain(args)
    assert (opened.rows, opened.cols, opened.spacing_m) == (3, 4, (5.0, 5.0))


def test_a_tour_found_before_is_the_same_from_the_cache(hills, own_cache, monkeypatch):
    found = open_tour(hills)
    assert found == demo_flight(hills)
    monkeypatch.setattr("app.opening.flight.demo_flight", None)
    assert open_tour(hills) == found
