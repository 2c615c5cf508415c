"""One GL context and what is known about it.

The depth convention is the same everywhere: larger is nearer, cleared to 0, tested with ``>``. With ``glClipControl``
(OpenGL 4.5) and a float buffer this is reversed z, which resolves every distance to one part in 16 million at no cost;
without it (macOS) fragments write a logarithmic depth of the same sense, which costs early rejection.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import moderngl

from terrain.errors import InputError
from terrain.frame import Output
from terrain.gpu.programs import Programs

GL_TEXTURE_2D, GL_FLOAT = 0x0DE1, 0x1406
GL_DEPTH_COMPONENT, GL_DEPTH_COMPONENT32F = 0x1902, 0x8CAC
GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE, GL_ZERO_TO_ONE = 0x8CA1, 0x935E, 0x935F
GL_CLIP_DISTANCE0 = 0x3000
GL_FRONT_AND_BACK, GL_POINT, GL_FILL = 0x0408, 0x1B00, 0x1B02

SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swiftshader", "swrast", "software")


class Gpu:
    """A GL context with its programs.

    Parameters
    ----------
    ctx : moderngl.Context
    clip_control : bool or None
        Whether to use reversed z; None asks the driver.

    Raises
    ------
    InputError
        If the context is older than OpenGL 3.3.
    """

    def __init__(self, ctx: moderngl.Context, clip_control: bool | None = None) -> None:
        if ctx.version_code < 330:
            raise InputError(
                f"Reliefscope needs OpenGL 3.3; this driver offers {ctx.version_code // 100}."
                f"{ctx.version_code // 10 % 10} ({ctx.info['GL_RENDERER']}). Install a newer graphics driver."
            )
        ctx.gc_mode = "auto"
        self.ctx = ctx
        self.name: str = ctx.info["GL_RENDERER"]
        self.version: str = ctx.info["GL_VERSION"]
        self.is_software = any(word in self.name.lower() for word in SOFTWARE_RENDERERS)
        self._clip_control = self.function("glClipControl", None, ctypes.c_uint, ctypes.c_uint)
        self.reversed_z = self._clip_control is not None if clip_control is None else clip_control
        self.programs = Programs(ctx, {} if self.reversed_z else {"LOG_DEPTH": 1})
        self._default_framebuffer = ctx.detect_framebuffer(0)
        self.prepare_state()

    def function(self, name: str, result: Any, *arguments: Any) -> Callable[..., Any] | None:
        """A GL entry point that moderngl does not expose, or None where the driver lacks it."""
        raw = self.ctx.mglo._context
        load = raw.load_opengl_function if hasattr(raw, "load_opengl_function") else raw.load
        address = load(name)
        return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None

    def prepare_state(self) -> None:
        """Set the state every draw starts from; called at the start of each frame, since ImGui may have changed it."""
        if self.reversed_z and self._clip_control is not None:
            self._clip_control(GL_LOWER_LEFT, GL_ZERO_TO_ONE)
        self.ctx.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.ctx.depth_func = ">"
        self.ctx.cull_face = "back"
        self.ctx.front_face = "ccw"
        self.ctx.wireframe = False

    def release_state(self) -> None:
        """Give the context back as other libraries expect it."""
        if self.reversed_z and self._clip_control is not None:
            self._clip_control(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE)
        self.ctx.enable_only(moderngl.NOTHING)
        self.ctx.depth_func = "<"

    @contextmanager
    def corners_only(self) -> Iterator[None]:
        """Draw triangles as three points each, a pixel large."""
        set_mode = self.function("glPolygonMode", None, ctypes.c_uint, ctypes.c_uint)
        assert set_mode is not None  # in OpenGL 1.1
        set_mode(GL_FRONT_AND_BACK, GL_POINT)
        yield
        set_mode(GL_FRONT_AND_BACK, GL_FILL)

    def program(
        self, vertex: str, fragment: str, output: Output = "shaded", defines: dict[str, Any] | None = None
    ) -> moderngl.Program:
        """The program of two shader files (names below ``shaders/``), writing what ``output`` asks for."""
        return self.programs.get(vertex, fragment, {f"OUTPUT_{output.upper()}": 1, **(defines or {})})

    def depth_texture(self, size_px: tuple[int, int]) -> moderngl.Texture:
        """A 32-bit float depth texture; moderngl alone offers 24-bit integers."""
        texture = self.ctx.depth_texture(size_px)
        allocate = self.function(
            "glTexImage2D", None, ctypes.c_uint, *[ctypes.c_int] * 5, ctypes.c_uint, ctypes.c_uint, ctypes.c_void_p
        )
        bind = self.function("glBindTexture", None, ctypes.c_uint, ctypes.c_uint)
        assert allocate is not None  # both are in OpenGL 1.1
        assert bind is not None
        bind(GL_TEXTURE_2D, texture.glo)
        allocate(GL_TEXTURE_2D, 0, GL_DEPTH_COMPONENT32F, *size_px, 0, GL_DEPTH_COMPONENT, GL_FLOAT, None)
        return texture

    def release_framebuffer(self, framebuffer: moderngl.Framebuffer) -> None:
        """Release a framebuffer. A bound one is unbound first: moderngl would bind it again, and GL complain."""
        if self.ctx.fbo is framebuffer:
            self._default_framebuffer.use()
        framebuffer.release()

    def release(self) -> None:
        """Release the programs and give the state back; the context itself belongs to who made it."""
        self.programs.release()
        self.release_state()


def create_offscreen_gpu() -> Gpu:
    """A GPU without a window: EGL on Linux, the platform's own elsewhere.

    Raises
    ------
    InputError
        If there is no usable driver; the line names the package or the cause.
    """
    return Gpu(create_offscreen_context())


def create_offscreen_context() -> moderngl.Context:
    """A standalone context of OpenGL 3.3 or newer; see `create_offscreen_gpu`."""
    import sys

    try:
        if sys.platform.startswith("linux"):
            options: dict[str, Any] = {"backend": "egl"}
            return moderngl.create_context(standalone=True, require=330, **options)
        return moderngl.create_context(standalone=True, require=330)
    except Exception as error:
        raise InputError(explain_missing_gl(str(error))) from None


def explain_missing_gl(message: str) -> str:
    """One line for a context that could not be made: what is missing, and the package that brings it."""
    packages = "on Debian or Ubuntu: apt-get install libegl1 libgl1 libx11-6"
    lowered = message.lower()
    if "libegl" in lowered:
        return f"Found no libEGL, which off-screen rendering needs. Install it ({packages})."
    if "libgl" in lowered:
        return f"Found no libGL, which rendering needs. Install it ({packages})."
    if "libx11" in lowered:
        return f"Found no libX11, which the window library needs. Install it ({packages})."
    if "eglinitialize" in lowered or "device" in lowered:
        return f"Found no working OpenGL driver ({message}). Install the graphics driver or Mesa ({packages})."
    too_old = ("version", "require", "0x3009", "badfbconfig")  # EGL_BAD_MATCH, GLXBadFBConfig: no such version
    if any(word in lowered for word in too_old):
        return f"Reliefscope needs OpenGL 3.3 or newer, which this driver does not offer ({message})."
    return f"Found no usable OpenGL ({message}). Install a graphics driver, or Mesa ({packages})."
