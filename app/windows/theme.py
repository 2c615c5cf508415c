"""Colours and sizes of the windows: dark or light, at any scale, told apart by colour-blind eyes too."""

from __future__ import annotations

from pathlib import Path

import imgui_bundle
from imgui_bundle import imgui, implot

from app.session.preferences import Preferences

Colour = tuple[float, float, float, float]

FONT_PX = 15.0
ROUNDING_PX = 4.0
WINDOW_OPACITY = 0.96
_FONT = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "DroidSans.ttf"
# Good and bad are blue and orange (Okabe and Ito, 2008), never green and red; dark, then light theme.
_GOOD = (0.35, 0.70, 0.95, 1.0), (0.00, 0.36, 0.60, 1.0)
_BAD = (0.98, 0.55, 0.20, 1.0), (0.72, 0.30, 0.00, 1.0)
_KEY = (1.0, 0.85, 0.5, 1.0), (0.45, 0.30, 0.0, 1.0)


def load_font() -> None:
    """The font of all text, where the wheel brings it; ImGui's own otherwise."""
    if _FONT.exists():
        imgui.get_io().fonts.add_font_from_file_ttf(str(_FONT), FONT_PX)


def apply_theme(preferences: Preferences, dpi_scale: float = 1.0) -> None:
    """Give ImGui and ImPlot the colours and sizes that a person chose.

    Parameters
    ----------
    preferences : Preferences
    dpi_scale : float
        What the screen asks for; ImGui scales text by it, here the spaces follow.
    """
    style, plain = imgui.get_style(), imgui.Style()
    for name in _sizes(plain):
        setattr(style, name, getattr(plain, name))
    style.window_rounding = style.frame_rounding = style.grab_rounding = style.popup_rounding = ROUNDING_PX
    style.window_border_size = 0.0
    style.scale_all_sizes(preferences.ui_scale * dpi_scale)
    style.font_scale_main = preferences.ui_scale
    if preferences.theme == "light":
        imgui.style_colors_light()
        implot.style_colors_light()
        style.set_color_(imgui.Col_.window_bg, (0.96, 0.96, 0.97, 1.0))
        style.set_color_(imgui.Col_.text_disabled, (0.38, 0.38, 0.40, 1.0))
    else:
        imgui.style_colors_dark()
        implot.style_colors_dark()
        style.set_color_(imgui.Col_.text_disabled, (0.62, 0.62, 0.64, 1.0))
        style.set_color_(imgui.Col_.popup_bg, (0.18, 0.18, 0.18, 1.0))  # sliders show on it as on a window


def ink(opacity: float = 1.0) -> Colour:
    """The colour of text, more or less opaque."""
    colour = imgui.get_style_color_vec4(imgui.Col_.text)
    return colour.x, colour.y, colour.z, opacity


def is_light() -> bool:
    return ink()[0] < 0.5


def good() -> Colour:
    """What was kept."""
    return _GOOD[is_light()]


def bad() -> Colour:
    """What was broken."""
    return _BAD[is_light()]


def key_colour() -> Colour:
    """The name of a key."""
    return _KEY[is_light()]


def packed(colour: Colour) -> int:
    """A colour as draw lists take it."""
    return imgui.get_color_u32(imgui.ImVec4(*colour))


def _sizes(style: imgui.Style) -> list[str]:
    """The fields of a style that are lengths or shares."""
    names = [name for name in dir(style) if not name.startswith(("_", "font_", "hover_"))]
    return [name for name in names if isinstance(getattr(style, name), (float, imgui.ImVec2))]
