"""The README's pictures are made off screen, stay small, and show what they say."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from app.pictures import DEBUG_VIEWS, LARGEST_BYTES, OffscreenWindow, draw_halves, save_chart, save_small
from terrain.renderers import RENDERERS


def test_the_window_is_drawn_without_a_window(session):
    session.layout.show("laboratory")
    with OffscreenWindow(session, (640, 360)) as window:
        for _ in range(3):
            window.frame()
        picture = window.read()
    assert picture.shape == (360, 640, 3)
    assert picture[:15, 300:].mean() < 60.0, "the menu bar lies at the top"
    assert picture[100:, :100].mean() < 90.0, "the panel lies on the left"
    assert picture[100:300, 370:].std() > 3.0, "the terrain is seen beside it"


@pytest.mark.parametrize("algorithm", ["geomorph", "perturbation"])
def test_each_algorithm_is_shown_beside_its_debug_view(session, algorithm):
    picture = draw_halves(session, algorithm, (64, 36)).astype(int)
    assert session.algorithm == algorithm
    left, right = picture[:, :31], picture[:, 33:]
    assert (picture[:, 31:33] == 255).all()
    assert abs(left.mean(axis=(0, 1)) - right.mean(axis=(0, 1))).max() > 3.0


def test_every_algorithm_has_a_picture():
    assert {*DEBUG_VIEWS, "reference"} == set(RENDERERS)


def test_a_picture_that_is_too_large_is_packed_harder(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8)
    smooth = np.full((300, 400, 3), 128, np.uint8)
    save_small(noise, tmp_path / "noise.jpg")
    save_small(smooth, tmp_path / "smooth.jpg")
    assert (tmp_path / "smooth.jpg").stat().st_size < (tmp_path / "noise.jpg").stat().st_size <= LARGEST_BYTES
    with Image.open(tmp_path / "noise.jpg") as image:
        assert image.size == (400, 300)


def test_the_chart_is_a_small_picture(tmp_path):
    error = {"mean": 0.1, "p99": 0.2, "p999": 0.3, "max": 0.4}
    runs = [
        {"algorithm": name, "settings": {"tolerance_px": 1.0}, "frame_ms": {"p50": 5.0 + i, "p95": 6.0, "p99": 7.0},
         "geometric_error_px": error}
        for i, name in enumerate(RENDERERS)
    ]  # fmt: skip
    machine = {"renderer": "none", "gl": "3.3", "cpu": "none", "cores": 2, "python": "3", "reliefscope": "0"}
    terrain = {"name": "hills", "sha256": "", "rows": 33, "cols": 33, "spacing_m": [10, 10], "height_m": [0, 40]}
    results = {
        "machine": machine, "terrain": terrain, "viewport": [64, 36], "flight": {"name": "tour", "frames": 4},
        "runs": runs,
    }  # fmt: skip
    save_chart(results, tmp_path / "chart.png")
    with Image.open(tmp_path / "chart.png") as image:
        assert image.width > 400
    assert (tmp_path / "chart.png").stat().st_size <= LARGEST_BYTES
