"""Shared by all tests: the real terrains, where they are present, and a GL context that fails on any GL error."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("any machine", deadline=None)  # a loaded one proves nothing wrong
settings.load_profile("any machine")

DEMS = Path(os.environ.get("RELIEFSCOPE_DEMS", Path(__file__).resolve().parents[2] / "shared" / "dems"))


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_run(tmp_path_factory):
    """No test finds what an earlier run, or the person who runs it, has in the cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RELIEFSCOPE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """A cache that is empty at first; its folder."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("RELIEFSCOPE_CACHE", str(folder))
    return folder


@pytest.fixture(scope="session")
def dem():
    """``dem("N37W120.hgt")``: the path of a real terrain; the test is skipped where it is absent."""

    def find(name: str) -> Path:
        path = DEMS / name
        if not path.exists():
            pytest.skip(f"real terrain {name} is not here (set RELIEFSCOPE_DEMS to the folder that holds it)")
        return path

    return find


@pytest.fixture(scope="session")
def _session_gpu():
    from terrain.errors import InputError
    from terrain.gpu.context import create_offscreen_gpu

    try:
        gpu = create_offscreen_gpu()
    except InputError as error:
        pytest.skip(f"no off-screen OpenGL here: {error}")
    yield gpu
    gpu.release()
    gpu.ctx.release()


@pytest.fixture
def gpu(_session_gpu):
    """One off-screen GPU for the whole run; a GL error before or after a test fails it."""
    with _session_gpu.ctx:  # commands under test make contexts of their own, which then are current
        assert _session_gpu.ctx.error == "GL_NO_ERROR"
        _session_gpu.prepare_state()
        yield _session_gpu
        assert _session_gpu.ctx.error == "GL_NO_ERROR"
