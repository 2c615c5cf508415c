"""Widgets for settings: the metadata of a dataclass's fields says what each looks like, and explains it in a tooltip.

A new setting of an algorithm, of the look or of the preferences needs no line here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import Field, replace
from typing import Any

from imgui_bundle import imgui, imgui_ctx

_dragged: dict[str, Any] = {}  # what sliders show whose value counts only when the mouse lets go


class Form:
    """Rows of a label and a widget, all widgets below each other.

    Parameters
    ----------
    labels : iterable of str
        All labels of the form: the widest says where the widgets begin.
    """

    def __init__(self, labels: Iterable[str]) -> None:
        widest = max((imgui.calc_text_size(label).x for label in labels), default=0.0)
        self._indent = widest + 1.2 * imgui.get_font_size()

    def edit(self, settings: Any, shown: Iterable[Field[Any]]) -> Any:
        """Widgets for some fields of a settings dataclass; the dataclass with what was changed."""
        for field in shown:
            value = self._widget(field, getattr(settings, field.name))
            if value != getattr(settings, field.name):
                settings = replace(settings, **{field.name: value})
        return settings

    def label(self, label: str, told: str) -> None:
        """A label with its tooltip, left of the widget that follows."""
        imgui.align_text_to_frame_padding()
        imgui.text(label)
        imgui.set_item_tooltip(told)
        imgui.same_line(self._indent)

    def checkbox(self, label: str, value: bool, told: str) -> bool:
        self.label(label, told)
        value = imgui.checkbox(f"##{label}", value)[1]
        imgui.set_item_tooltip(told)
        return value

    def combo(self, label: str, current: int, items: Sequence[str], told: str) -> int:
        """The number of the chosen item."""
        self.label(label, told)
        imgui.set_next_item_width(-1.0)
        chosen = imgui.combo(f"##{label}", current, list(items), len(items))[1]
        imgui.set_item_tooltip(told)
        return chosen

    def slider(
        self, label: str, value: Any, told: str, limits: tuple[float, float], number: str, on_release: bool = False
    ) -> Any:
        """A slider; with ``on_release`` the new value counts only when the mouse lets go (it is dear to apply)."""
        self.label(label, told)
        flags = imgui.SliderFlags_.always_clamp
        if limits[0] > 0 and limits[1] / limits[0] >= 20:
            flags |= imgui.SliderFlags_.logarithmic
        imgui.set_next_item_width(-1.0)
        shown = _dragged.get(label, value)
        if isinstance(value, int):
            _, shown = imgui.slider_int(f"##{label}", shown, int(limits[0]), int(limits[1]), number, flags)
        else:
            _, shown = imgui.slider_float(f"##{label}", shown, limits[0], limits[1], number, flags)
            shown = value if math.isclose(shown, value, rel_tol=1e-6) else shown
        imgui.set_item_tooltip(f"{told.removesuffix('.')} (Ctrl+click: type a number).")
        if on_release and imgui.is_item_active():
            _dragged[label] = shown
            return value
        _dragged.pop(label, None)
        return shown

    def _widget(self, field: Field[Any], value: Any) -> Any:
        about = field.metadata
        label, told, unit = about["label"], about["help"], about["unit"]
        if about["choices"] is not None:
            choices = list(about["choices"])
            suffix = f" {unit}" if unit else ""
            return choices[self.combo(label, choices.index(value), [f"{choice}{suffix}" for choice in choices], told)]
        if isinstance(value, bool):
            return self.checkbox(label, value, told)
        shown_unit = f" {unit}".replace(" deg", "°") if unit else ""
        number = "%d" if isinstance(value, int) else "%.2f"
        return self.slider(label, value, told, about["range"], number + shown_unit, about["rebuild"])


def button(title: str, told: str, act: Callable[[], Any]) -> None:
    """A button with its tooltip, also where it is disabled."""
    if imgui.button(title):
        act()
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        imgui.set_tooltip(told)


def text_field(label: str, text: str, told: str, hint: str = "", flags: int = 0) -> tuple[bool, str]:
    """A field to type into: whether Enter was pressed, and the text; its tooltip hides nothing while one types."""
    entered, text = imgui.input_text_with_hint(label, hint, text, flags | imgui.InputTextFlags_.enter_returns_true)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip) and not imgui.is_item_active():
        imgui.set_tooltip(told)
    return entered, text


def figures_table(label: str, rows: Iterable[tuple[str, str]], name_em: float) -> None:
    """Names, ``name_em`` wide, and their values."""
    with imgui_ctx.begin_table(label, 2) as table:
        if not table:
            return
        imgui.table_setup_column("name", imgui.TableColumnFlags_.width_fixed, name_em * imgui.get_font_size())
        imgui.table_setup_column("value", imgui.TableColumnFlags_.width_stretch)
        for name, value in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_disabled(name)
            imgui.table_next_column()
            imgui.text_unformatted(value)
