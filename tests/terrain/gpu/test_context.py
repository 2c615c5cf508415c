"""What a person reads where OpenGL is missing or too old."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from terrain.errors import InputError
from terrain.gpu.context import Gpu, explain_missing_gl


def test_an_old_driver_is_refused_in_one_line():
    old = SimpleNamespace(version_code=210, info={"GL_RENDERER": "Old Card"})
    with pytest.raises(InputError, match=r"needs OpenGL 3\.3; this driver offers 2\.1 \(Old Card\)") as caught:
        Gpu(old)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("libEGL.so.1 not loaded", "libegl1"),
        ("libGL.so.1 not loaded", "libgl1"),
        ("libX11.so.6: cannot open shared object file", "libx11-6"),
        ("eglInitialize failed (0x3001)", "Mesa"),
        ("requested device index 0, but found 0 devices", "driver"),
        ("Requested OpenGL version 330, got version 310", "3.3"),
        ("something nobody has seen", "something nobody has seen"),
    ],
)
def test_every_missing_piece_gets_one_line_that_names_it(message, expected):
    line = explain_missing_gl(message)
    assert expected in line
    assert "\n" not in line
    assert line.endswith(".")


def test_depth_is_stored_as_floats(gpu):
    from terrain.gpu.targets import create_target

    target = create_target(gpu, (8, 8))
    target.framebuffer.use()
    target.framebuffer.clear(depth=1e-7)
    depth = target.read_depth()
    target.release()
    assert depth == pytest.approx(1e-7, rel=1e-6)
