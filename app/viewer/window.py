"""The window and its loop: GLFW through moderngl-window.

What cannot be had is said in one line: a display, a library, a driver, OpenGL 3.3.
"""

from __future__ import annotations

import os
import re
import sys
import time
import warnings
from pathlib import Path
from types import TracebackType
from typing import Any, cast

from app.opening.drawing import Drawing
from app.session.preferences import PreferenceFile, config_folder
from app.viewer.pacing import Pacer
from terrain.errors import InputError
from terrain.gpu.context import Gpu, explain_missing_gl
from terrain.heightfield import Heightfield

DEFAULT_SIZE_PX = (1280, 720)  # where the screen has room for it
AWAKE_S, AWAKE_WAIT_S, ASLEEP_WAIT_S = 1.5, 0.05, 1.0
LOOK_AT_SHADERS_S = 0.4


class WindowError(InputError):
    """There can be no window here; the line says why."""


class Window:
    """A window with an OpenGL 3.3 context.

    Parameters
    ----------
    size_px : tuple of int, optional
        ``(width, height)`` in screen coordinates.

    Raises
    ------
    WindowError
        If there is no display, or a library or driver is missing.
    """

    def __init__(self, size_px: tuple[int, int] | None = None) -> None:
        if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise WindowError("There is no display for a window (neither DISPLAY nor WAYLAND_DISPLAY is set).")
        try:
            # ImGui first: it brings the GLFW that both then share.
            from app.viewer import gamepad, gui, panel  # isort: skip
            import glfw
            from moderngl_window.context.glfw.window import Window as GlfwWindow
        except (ImportError, OSError) as error:
            raise WindowError(explain_no_window(str(error))) from None
        self._glfw, self._gui_module, self._panel = glfw, gui, panel.Panel()
        self._gamepad = gamepad.Gamepad(glfw)
        with warnings.catch_warnings(record=True) as heard:  # GLFW's reasons arrive as warnings
            warnings.simplefilter("always")
            try:
                size = size_px or DEFAULT_SIZE_PX
                self._window: Any = GlfwWindow(title="Reliefscope", size=size, gl_version=(3, 3), visible=False)
            except Exception as error:
                reasons = "; ".join(str(warning.message) for warning in heard) or str(error)
                raise WindowError(explain_no_window(reasons)) from None
        if size_px is None:
            _, _, width_px, height_px = glfw.get_monitor_workarea(glfw.get_primary_monitor())
            self._window.size = min(DEFAULT_SIZE_PX[0], width_px), min(DEFAULT_SIZE_PX[1], height_px)
        self._window.exit_key = self._window.fullscreen_key = None
        self.gpu = Gpu(self._window.ctx)
        self._preferences = PreferenceFile(config_folder())
        self._gui = gui.Gui(self._window._window, self._preferences)
        self._awake_until_s = 0.0
        self._pacer = Pacer()
        self._has_vsync: bool | None = None  # GLFW's own choice until the first frame
        self._dropped: list[Path] = []
        self._session: Any = None

    def __enter__(self) -> Window:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._gui.close()
        self._window.destroy()

    def run(
        self, heightfield: Heightfield, drawing: Drawing, flight: Any = None, source: Any = None,
        watches_shaders: bool = False,
    ) -> None:  # fmt: skip
        """Show a terrain until the window is closed.

        Parameters
        ----------
        heightfield, drawing
        flight : Flight, optional
        source : argparse.Namespace, optional
            What the terrain was read from: it is read again when it changes on disk.
        watches_shaders : bool
            Reload shaders that change on disk.
        """
        from app.session.loader import Loader
        from app.session.session import Session

        session = Session(self.gpu, heightfield, drawing, flight, preferences=self._preferences)
        session.loader = Loader(source)
        session.loader.remember(session)
        self._glfw.set_drop_callback(self._window._window, cast(Any, self._take_drop))
        self._show(session)
        self._window.visible = True  # not before there is something to see
        try:
            self._loop(session, watches_shaders)
        finally:
            self._session.loader.close()
            self._session.close()

    def _take_drop(self, _: Any, paths: list[str]) -> None:
        """Files were dropped on the window: they are opened in the next frame."""
        self._dropped += [Path(path) for path in paths]

    def _show(self, session: Any) -> None:
        """From now on this session is in the window."""
        self._session = session
        self._window.title = f"{session.heightfield.name} — Reliefscope"

    def _take_orders(self, session: Any) -> Any:
        """Open what was dropped, change over to what was read, ask before closing; the session to show."""
        if self._dropped:
            session.loader.open(session, tuple(self._dropped))
            self._dropped.clear()
        if self._window.is_closing:
            self._window.is_closing = False
            session.leave()
        following = session.loader.follow(session)
        if following is not session:
            self._show(following)
        return following

    def _loop(self, session: Any, watches_shaders: bool) -> None:
        glfw, gui, handle, screen = self._glfw, self._gui_module, self._window._window, self.gpu.ctx.screen
        last_s, was_focused = time.perf_counter(), False
        looked_s = last_s
        while not session.is_leaving:
            self._take_events(session)
            self._keep_pace(session)
            session = self._take_orders(session)
            now_s = time.perf_counter()
            focused = bool(glfw.get_window_attrib(handle, glfw.FOCUSED))
            lost_focus, was_focused = was_focused and not focused, focused

            self._gui.begin()
            gui.press_keys(session)
            inputs = gui.read_inputs(focused=not lost_focus)
            session.advance(self._gamepad.take(session, inputs) if focused else inputs, now_s - last_s)
            last_s = now_s
            if watches_shaders and now_s - looked_s > LOOK_AT_SHADERS_S:
                session.reload_shaders()
                looked_s = now_s
            if not self._is_hidden:
                gui.show_picture(session)
            else:
                session.exporter.work()
            self._panel.draw(session)
            self.gpu.release_state()
            screen.use()
            screen.clear(viewport=(0, 0, *glfw.get_framebuffer_size(handle)))
            self._gui.end()
            glfw.swap_buffers(handle)

    def _take_events(self, session: Any) -> None:
        """Take in what happened; sleep while nothing changes, lightly for a while after an event (tooltips)."""
        if not (session.is_asleep or (self._is_hidden and not session.exporter.is_busy)):
            self._glfw.poll_events()
            return
        begin_s = time.perf_counter()
        is_awake = begin_s < self._awake_until_s or self._gamepad.pad is not None  # which wakes nobody by itself
        wait_s = AWAKE_WAIT_S if is_awake and not self._is_hidden else ASLEEP_WAIT_S
        self._glfw.wait_events_timeout(wait_s)
        end_s = time.perf_counter()
        if end_s - begin_s < 0.9 * wait_s:
            self._awake_until_s = end_s + AWAKE_S

    def _keep_pace(self, session: Any) -> None:
        """No more pictures than the person wants, and no faster than the screen where that is wanted."""
        chosen = session.preferences.current
        if chosen.vsync != self._has_vsync:
            self._has_vsync = chosen.vsync
            self._glfw.swap_interval(int(chosen.vsync))
        self._pacer.wait(chosen.frame_limit_fps)

    @property
    def _is_hidden(self) -> bool:
        """Whether the window is minimised or has no area."""
        glfw, handle = self._glfw, self._window._window
        return bool(glfw.get_window_attrib(handle, glfw.ICONIFIED)) or 0 in glfw.get_framebuffer_size(handle)


def explain_no_window(reasons: str) -> str:
    """One line for a window that could not be opened: no display, or what `explain_missing_gl` says."""
    reasons = re.sub(r"\(\d+\) |\bb['\"]|['\"]", "", reasons)  # GLFW's error numbers, Python's quotes
    lowered = reasons.lower()
    if "display" in lowered or "wayland" in lowered or "failed to initialize glfw" in lowered:
        return f"There is no display for a window ({reasons})."
    return explain_missing_gl(reasons)
