"""ImGui around the panel: context, style, the native GLFW and OpenGL backends, and what the hands do.

All input comes through ImGui, in the window as in the tests: keys typed into a text field and drags that began on the
panel never reach the camera, and ImGui lets go of every key when the window loses the focus.
"""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

from imgui_bundle import imgui, implot

from app.flying.controls import Button, Inputs
from app.session.preferences import PreferenceFile
from app.session.session import Session
from app.viewer.keys import HELD, LOOKED, bindings
from app.windows.theme import apply_theme, load_font

CTRL = "Ctrl+"
ARROWS = ("Left", "Right", "Up", "Down")
BUTTONS: tuple[Button, ...] = ("left", "right", "middle")


def create_context(preferences: PreferenceFile) -> None:
    """An ImGui context in a person's style, with the windows where they were in the last run."""
    imgui.create_context()
    implot.create_context()
    io = imgui.get_io()
    io.set_ini_filename(None)  # app.viewer.docking keeps the layout: ImGui itself would not replace the file at once
    io.config_flags |= imgui.ConfigFlags_.docking_enable | imgui.ConfigFlags_.nav_enable_keyboard
    io.config_nav_capture_keyboard = False  # the camera's keys work beside the widgets'
    io.config_dpi_scale_fonts = True
    load_font()
    apply_theme(preferences.current)
    if layout := preferences.read_layout():
        imgui.load_ini_settings_from_memory(layout)


class Gui:
    """ImGui on a GLFW window.

    Parameters
    ----------
    window : ctypes pointer
        The GLFW window, whose callbacks ImGui chains.
    preferences : PreferenceFile
    """

    def __init__(self, window: Any, preferences: PreferenceFile) -> None:
        self._preferences = preferences
        create_context(preferences)
        address = ctypes.cast(window, ctypes.c_void_p).value
        imgui.backends.glfw_init_for_opengl(address or 0, True)
        imgui.backends.opengl3_init("#version 330")

    def begin(self) -> None:
        """Begin a frame: take in what happened since the last one."""
        imgui.backends.opengl3_new_frame()
        imgui.backends.glfw_new_frame()
        imgui.new_frame()

    def end(self) -> None:
        """Draw the frame into the bound framebuffer."""
        imgui.render()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())

    def close(self) -> None:
        self._preferences.write_layout(imgui.save_ini_settings_to_memory())
        imgui.backends.opengl3_shutdown()
        imgui.backends.glfw_shutdown()
        implot.destroy_context()
        imgui.destroy_context()


def read_inputs(focused: bool = True) -> Inputs:
    """What the hands do to the camera in this frame; nothing while they use the panel."""
    io = imgui.get_io()
    inputs = Inputs(focused=focused)
    if not io.want_text_input and not io.key_ctrl:
        held = dict(HELD) if io.nav_active else HELD | LOOKED  # arrow keys first serve a window that has the focus
        pushed = {name: _down(plus) - _down(minus) for name, (plus, minus, _) in held.items()}
        inputs = replace(inputs, fast=io.key_shift, **pushed)  # type: ignore[arg-type]
    if io.want_capture_mouse or not imgui.is_mouse_pos_valid():
        return inputs
    pointer = (io.mouse_pos.x / max(io.display_size.x, 1.0), io.mouse_pos.y / max(io.display_size.y, 1.0))
    inputs = replace(inputs, pointer=pointer, wheel=io.mouse_wheel, double_clicked=imgui.is_mouse_double_clicked(0))
    stays = io.mouse_drag_max_distance_sqr[0] < io.mouse_drag_threshold**2
    if imgui.is_mouse_released(0) and not io.mouse_down_owned[0]:
        inputs = replace(inputs, clicked=bool(stays and io.mouse_clicked_last_count[0] == 1))
    for number, button in enumerate(BUTTONS):
        if imgui.is_mouse_down(number):
            # No travel in the frame of the click itself, which led to where the drag begins; no trembling while one
            # double-clicks, which would break off the flight that it begins.
            rests = imgui.is_mouse_clicked(number) or (number == 0 and io.mouse_clicked_last_count[0] == 2 and stays)
            travel = (0.0, 0.0) if rests else (io.mouse_delta.x, io.mouse_delta.y)
            return replace(inputs, button=button, look_px=travel)
    return inputs


def press_keys(session: Session) -> None:
    """Do what the keys pressed in this frame ask for."""
    io = imgui.get_io()
    if io.want_text_input:
        return
    # In a slow frame Ctrl may be let go right after the key: in the frame of its release it still counts.
    with_ctrl = io.key_ctrl or any(map(imgui.is_key_released, (imgui.Key.left_ctrl, imgui.Key.right_ctrl)))
    for binding in bindings():
        key = binding.key.removeprefix(CTRL)
        if key and imgui.is_key_pressed(key_named(key), False) and with_ctrl == binding.key.startswith(CTRL):
            binding.act(session)


def key_named(name: str) -> imgui.Key:
    """ImGui's key of a name as in the help: ``"F12"``, ``"0"``, ``"Home"``, ``"Left"``."""
    name = f"_{name}" if name.isdigit() else f"{name}_arrow" if name in ARROWS else name
    key: imgui.Key = getattr(imgui.Key, name.lower())
    return key


def show_picture(session: Session) -> None:
    """The scene behind everything, at the window's full resolution."""
    io = imgui.get_io()
    scale = io.display_framebuffer_scale
    size_px = (round(io.display_size.x * scale.x), round(io.display_size.y * scale.y))
    picture = session.draw(size_px)
    if picture is None:
        return
    width, height = io.display_size
    for part in session.comparison.parts(picture):
        image = imgui.ImTextureRef(part.target.texture.glo)
        corners = (part.left * width, 0.0), (part.right * width, height)
        imgui.get_background_draw_list().add_image(image, *corners, (part.left, 1.0), (part.right, 0.0))


def _down(key: str) -> float:
    return float(imgui.is_key_down(key_named(key)))
