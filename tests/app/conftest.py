"""A GPU without a window, a small terrain, and a session on them."""

from __future__ import annotations

import numpy as np
import pytest

from app.opening.drawing import DEFAULT_ALGORITHM, Drawing
from app.session.session import Session
from terrain.camera import Camera
from terrain.flight import demo_flight
from terrain.gpu.context import create_offscreen_gpu
from terrain.heightfield import Heightfield
from terrain.renderers import RENDERERS
from terrain.textures.layers import LayerStack
from terrain.textures.look import LookSettings


@pytest.fixture(autouse=True)
def own_preferences(tmp_path, monkeypatch):
    """No test reads or writes the preferences of the person who runs it."""
    monkeypatch.setenv("RELIEFSCOPE_CONFIG", str(tmp_path / "config"))


@pytest.fixture(scope="session")
def app_gpu():
    gpu = create_offscreen_gpu()
    yield gpu
    gpu.release()
    gpu.ctx.release()


@pytest.fixture(scope="session")
def hills():
    """Rolling hills, 33 x 33 posts, 10 m apart, 0 to 40 m high."""
    x = np.linspace(0.0, 4.0 * np.pi, 33)
    heights = 20.0 + 10.0 * (np.sin(x)[:, None] + np.cos(x)[None, :])
    return Heightfield(np.ascontiguousarray(heights, np.float32), (10.0, 10.0), name="hills")


@pytest.fixture(scope="session")
def hills_flight(hills):
    """The demo flight over the hills, found once."""
    return demo_flight(hills)


@pytest.fixture
def session(app_gpu, hills, hills_flight, tmp_path):
    settings = RENDERERS[DEFAULT_ALGORITHM].Settings()
    drawing = Drawing(DEFAULT_ALGORITHM, settings, LookSettings(), "shaded", LayerStack(), 1.0)
    with app_gpu.ctx:  # commands under test make contexts of their own, which then are current
        session = Session(app_gpu, hills, drawing, hills_flight, folder=tmp_path)
        session.camera = Camera((52.0, 22.0, 282.0), yaw_deg=25.0, pitch_deg=-11.0)  # across the hills
        session.draw((64, 36))
        yield session
        session.close()
        assert app_gpu.ctx.error == "GL_NO_ERROR"
