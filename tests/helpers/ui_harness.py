"""The panel under Dear ImGui's test engine, on a loop of its own: no window, no ImGui drawing.

The engine runs each test in a thread of its own that takes turns with the frame loop, at ``ImGui::EndFrame``. Called
through the bindings, that function keeps Python's lock and both sides wait for ever; called through ctypes it does not.
"""

from __future__ import annotations

import ctypes

import pytest
from imgui_bundle import _imgui_bundle as native
from imgui_bundle import imgui, implot

from app.viewer import gui
from app.viewer.panel import Panel

engine = imgui.test_engine
SIZE = (1280.0, 720.0)
FRAME_S = 1.0 / 60.0
SETTLING_FRAMES, LONGEST_TEST_FRAMES = 3, 3000

_end_frame = getattr(ctypes.CDLL(native.__file__), "_ZN5ImGui8EndFrameEv", None)


class UiHarness:
    """Runs the window's frame for a session, with the test engine's mouse and keyboard.

    As a context manager it begins with all windows in their places.
    """

    def __init__(self, session):
        if _end_frame is None:  # as in the Windows wheels
            pytest.skip("imgui-bundle's wheel does not export ImGui::EndFrame here")
        self.session, self.panel, self.focused = session, Panel(), True
        gui.create_context(session.preferences)
        io = imgui.get_io()
        io.display_size, io.delta_time = SIZE, FRAME_S
        io.backend_flags |= imgui.BackendFlags_.renderer_has_textures
        self._engine = engine.create_context()
        options = engine.get_io(self._engine)
        options.config_run_speed, options.config_no_throttle = engine.TestRunSpeed.fast, True
        options.config_log_to_tty = False
        engine.start(self._engine, imgui.get_current_context())

    def frame(self, draw=lambda session: session.draw((64, 36))):
        """One frame, as in ``app.viewer.window``; ``draw`` brings the picture up to date."""
        imgui.new_frame()
        try:
            gui.press_keys(self.session)
            self.session.advance(gui.read_inputs(self.focused), FRAME_S)
            draw(self.session)
            self.panel.draw(self.session)
        finally:
            _end_frame()
            imgui.render()
            _accept_textures()
            engine.post_swap(self._engine)

    def run(self, steps):
        """Run ``steps(ctx)``, which acts through the test engine's context and asserts as any test does."""
        errors = []

        def guarded(ctx):
            try:
                steps(ctx)
            except BaseException as error:  # must not cross the engine's C++ frames
                errors.append(error)

        test = engine.register_test(self._engine, "ui", steps.__name__)
        test.test_func = guarded
        engine.queue_test(self._engine, test)
        for _ in range(LONGEST_TEST_FRAMES):
            self.frame()
            if engine.is_test_queue_empty(self._engine):
                break
        else:
            engine.abort_current_test(self._engine)
            raise TimeoutError(f"{steps.__name__} took more than {LONGEST_TEST_FRAMES} frames")
        if errors:
            raise errors[0]
        assert test.output.status == engine.TestStatus.success, test.output.log.get_text()

    def __enter__(self):
        for _ in range(SETTLING_FRAMES):
            self.frame()
        return self

    def __exit__(self, *_):
        engine.stop(self._engine)
        implot.destroy_context()
        imgui.destroy_context()
        engine.destroy_context(self._engine)


def _accept_textures():
    """Say to ImGui that its font textures are on a GPU."""
    for texture in imgui.get_platform_io().textures:
        if texture.status in (imgui.ImTextureStatus.want_create, imgui.ImTextureStatus.want_updates):
            texture.set_tex_id(texture.unique_id + 1)
            texture.set_status(imgui.ImTextureStatus.ok)
        elif texture.status == imgui.ImTextureStatus.want_destroy:
            texture.set_tex_id(0)
            texture.set_status(imgui.ImTextureStatus.destroyed)
