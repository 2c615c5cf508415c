"""Shader programs: includes, errors that name file and line, reload while running."""

from __future__ import annotations

import os

import pytest

from terrain.gpu.programs import Programs, ShaderError, explain, flatten

VERTEX = '#version 330 core\n#include "lib/a.glsl"\nvoid main() { gl_Position = place(); }\n'
INCLUDED = "// a comment\nvec4 place() { return vec4(SIZE); }\n"
FRAGMENT = "#version 330 core\nout vec4 colour;\nvoid main() { colour = vec4(1.0); }\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "one.vert").write_text(VERTEX)
    (tmp_path / "one.frag").write_text(FRAGMENT)
    (tmp_path / "lib" / "a.glsl").write_text(INCLUDED)
    return tmp_path


@pytest.fixture
def programs(gpu, folder):
    made = Programs(gpu.ctx, {"SIZE": "1.0"}, folder)
    yield made
    made.release()


def touch(path, text):
    path.write_text(text)
    later = path.stat().st_mtime_ns + 10**9
    os.utime(path, ns=(later, later))


def test_lines_of_a_flattened_shader_know_where_they_came_from(folder):
    text, where, files = flatten(folder, "one.vert", {"SIZE": 2})
    lines = text.splitlines()
    assert lines[1] == "#define SIZE 2"
    assert where[lines.index("vec4 place() { return vec4(SIZE); }")] == ("lib/a.glsl", 2)
    assert where[lines.index("void main() { gl_Position = place(); }")] == ("one.vert", 3)
    assert files == ["one.vert", "lib/a.glsl"]


def test_a_file_included_twice_is_there_once(folder):
    (folder / "lib" / "b.glsl").write_text('#include "lib/a.glsl"\n')
    (folder / "one.vert").write_text(VERTEX.replace("void", '#include "lib/b.glsl"\nvoid'))
    assert flatten(folder, "one.vert", {})[0].count("vec4 place()") == 1


def test_a_circular_include_is_refused(folder):
    (folder / "lib" / "a.glsl").write_text('#include "lib/b.glsl"\n')
    (folder / "lib" / "b.glsl").write_text('#include "lib/a.glsl"\n')
    with pytest.raises(ShaderError, match=r"circular include: one\.vert -> lib/a\.glsl -> lib/b\.glsl -> lib/a\.glsl"):
        flatten(folder, "one.vert", {})


def test_an_unknown_file_is_named_with_who_asked_for_it(folder):
    (folder / "lib" / "a.glsl").unlink()
    with pytest.raises(ShaderError, match=r"one\.vert -> lib/a\.glsl: cannot be read"):
        flatten(folder, "one.vert", {})


def test_an_error_names_the_included_file_and_its_line(programs, folder):
    (folder / "lib" / "a.glsl").write_text("// a comment\n\nvec4 place() { return nonsense; }\n")
    with pytest.raises(ShaderError, match=r"lib/a\.glsl:3"):
        programs.get("one", "one", {})


def test_an_error_in_the_fragment_stage_names_that_file(programs, folder):
    (folder / "one.frag").write_text(FRAGMENT.replace("vec4(1.0)", "nonsense"))
    with pytest.raises(ShaderError, match=r"one\.frag:3"):
        programs.get("one", "one", {})


@pytest.mark.parametrize("line", ["0:2(5): error: x", "0(2) : error C1: x", "ERROR: 0:2: x"])
def test_line_numbers_of_all_drivers_are_understood(line):
    assert explain(line, [("a.vert", 1), ("b.glsl", 7)]).startswith("b.glsl:7")


def test_variants_are_kept_apart_and_compiled_once(programs):
    plain, other = programs.get("one", "one", {}), programs.get("one", "one", {"SIZE": "3.0"})
    assert plain is not other
    assert programs.get("one", "one", {}) is plain


def test_shading_switches_reach_only_shaded_variants(programs):
    flat = programs.get("one", "one", {"OUTPUT_FLAT": 1})
    shaded = programs.get("one", "one", {"OUTPUT_SHADED": 1})
    programs.shading_defines = {"FOG": 1}
    assert programs.get("one", "one", {"OUTPUT_FLAT": 1}) is flat
    assert programs.get("one", "one", {"OUTPUT_SHADED": 1}) is not shaded


def test_a_changed_file_is_compiled_again(programs, folder):
    before = programs.get("one", "one", {})
    assert programs.reload_changed() == []
    assert programs.get("one", "one", {}) is before
    touch(folder / "lib" / "a.glsl", INCLUDED.replace("vec4(SIZE)", "vec4(0.5)"))
    assert programs.reload_changed() == []
    assert programs.get("one", "one", {}) is not before
    assert programs.generation == 1


def test_a_broken_change_keeps_the_old_program_and_says_where(programs, folder):
    before = programs.get("one", "one", {})
    touch(folder / "lib" / "a.glsl", "vec4 place() { return nonsense; }\n")
    (message,) = programs.reload_changed()
    assert "lib/a.glsl:1" in message
    assert programs.get("one", "one", {}) is before
    assert programs.reload_changed() == []  # said once
    assert programs.errors == [message]  # and known until it is mended
    touch(folder / "lib" / "a.glsl", INCLUDED)
    assert programs.reload_changed() == []
    assert programs.errors == []
    assert programs.get("one", "one", {}) is not before
