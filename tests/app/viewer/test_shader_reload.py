"""Shaders that change on disk are reloaded while the window is open; broken ones are told and the old ones draw on."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from terrain.gpu.context import create_offscreen_gpu
from terrain.gpu.programs import SHADERS

TITLE = "Broken shaders"


@pytest.fixture(scope="module")
def app_gpu():
    """A GPU of its own: what other tests compiled would be compiled again with every change here."""
    gpu = create_offscreen_gpu()
    yield gpu
    gpu.release()
    gpu.ctx.release()


@pytest.fixture
def folder(session, tmp_path, monkeypatch):
    """The shaders in a folder where they can be changed."""
    folder, programs = tmp_path / "shaders", session.gpu.programs
    shutil.copytree(SHADERS, folder)
    monkeypatch.setattr(programs, "root", folder)
    programs.reload_changed()
    yield folder
    monkeypatch.undo()
    programs.reload_changed()
    assert programs.errors == []


def edit(path, old, new):
    """Change a file, and its time by more than a clock's tick."""
    text, before = path.read_text(), path.stat().st_mtime_ns
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(before + 10**9, before + 10**9))


def picture(session):
    session.touch()
    session.draw((64, 36))
    return session.picture.read()[..., :3].astype(int)


def test_a_changed_shader_changes_the_picture(session, folder):
    before = picture(session)
    edit(folder / "mesh.frag", "#ifdef LOG_DEPTH", "    out_colour.rgb = vec3(1.0, 0.0, 1.0);\n#ifdef LOG_DEPTH")
    session.reload_shaders()
    after = picture(session)
    assert session.gpu.programs.errors == []
    assert (after == [255, 0, 255]).all(axis=-1).mean() > 0.3
    assert not np.array_equal(before, after)


def test_a_changed_bake_is_baked_again(session, folder):
    before = picture(session)
    edit(
        folder / "bake_ground.frag",
        "void main() {",
        "void main() {\n    out_colour = vec4(1.0, 0.0, 0.0, 1.0); return;",
    )
    session.reload_shaders()
    for _ in range(40):
        after = picture(session)
    assert after[..., 0].mean() > before[..., 0].mean() + 20.0


def test_a_broken_shader_is_shown_with_file_and_line_until_it_is_mended(session, folder):
    before = picture(session)
    with UiHarness(session) as ui:
        edit(folder / "mesh.frag", "void main() {", "void main() { float nonsense = missing;")
        session.reload_shaders()
        for _ in range(3):
            ui.frame()
        line = (SHADERS / "mesh.frag").read_text().splitlines().index("void main() {") + 1
        assert any(f"mesh.frag:{line}" in error for error in session.gpu.programs.errors)
        assert imgui.internal.find_window_by_name(TITLE).active
        assert np.array_equal(picture(session), before)
        edit(folder / "mesh.frag", " float nonsense = missing;", "")
        session.reload_shaders()
        for _ in range(3):
            ui.frame()
        assert not imgui.internal.find_window_by_name(TITLE).active
        assert np.array_equal(picture(session), before)


def test_a_view_whose_shader_does_not_compile_says_so_and_the_others_go_on(session, folder):
    before = picture(session)
    edit(folder / "view_overdraw.frag", "void main() {", "void main() { missing;")
    session.reload_shaders()
    session.choose_view("overdraw")
    picture(session)
    assert "view_overdraw.frag:" in session.message
    session.choose_view("shaded")
    assert np.array_equal(picture(session), before)
