"""The panel, the help and the status line, drawn with ImGui.

Settings become widgets by the metadata of their fields, those of a renderer and those of the look alike: a new
algorithm needs no line here.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import Field, replace
from typing import Any

import numpy as np
from imgui_bundle import imgui, imgui_ctx

from app.keys import FAST, HELD, MOUSE_HELP, bindings
from app.session import Session
from app.workbench import draw_laboratory, laboratory_width
from terrain.renderers import RENDERERS
from terrain.views import VIEWS

WIDTH_EM, FIGURE_EM, HELP_EM = 23.0, 8.6, 45.0
MARGIN_EM = 0.6
EXAGGERATION_RANGE = (0.1, 10.0)
STEADY_MS = 1000.0 / 60.0
_KEY_COLOUR = (1.0, 0.85, 0.5, 1.0)

_FIXED = (
    imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_saved_settings
)  # fmt: skip
_OVERLAY = _FIXED | imgui.WindowFlags_.no_title_bar | imgui.WindowFlags_.always_auto_resize


class Panel:
    """Draws everything that lies over the picture. Holds only what a slider shows while it is being dragged."""

    def __init__(self) -> None:
        self._dragged: dict[str, Any] = {}
        self._label_width = 0.0

    def draw(self, session: Session) -> None:
        """The panel, the status line and the help of one frame."""
        if session.shows_panel:
            self._draw_panel(session)
        _draw_status(session)
        if session.shows_help:
            _draw_help(session)
        else:
            draw_laboratory(session)  # there is no room for both

    def _draw_panel(self, session: Session) -> None:
        em, size = imgui.get_font_size(), imgui.get_io().display_size
        margin = MARGIN_EM * em
        imgui.set_next_window_pos((margin, margin))
        imgui.set_next_window_size_constraints((WIDTH_EM * em, 0.0), (WIDTH_EM * em, max(size.y - 2 * margin, 1.0)))
        imgui.set_next_window_bg_alpha(0.88)
        flags = _FIXED | imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_title_bar
        shown = (*dataclasses.fields(session.settings), *dataclasses.fields(session.stage.look))
        labels = ["Exaggeration", *(field.metadata["label"] for field in shown)]
        self._label_width = max(imgui.calc_text_size(label).x for label in labels) + 1.2 * em
        with imgui_ctx.begin("Reliefscope", None, flags):
            self._draw_algorithm(session)
            self._draw_view(session)
            self._draw_statistics(session)
            if imgui.collapsing_header("Look"):
                self._draw_look(session)

    def _draw_algorithm(self, session: Session) -> None:
        names = list(RENDERERS)
        chosen = self._combo("Algorithm", names.index(session.algorithm), [kind.title for kind in RENDERERS.values()],
                        RENDERERS[session.algorithm].source)  # fmt: skip
        if names[chosen] != session.algorithm:
            session.choose_algorithm(names[chosen])
        first, *own = dataclasses.fields(session.settings)
        changed = self._edit(session.settings, [first])
        if own and imgui.collapsing_header("Settings of this algorithm"):
            changed = self._edit(changed, own)
        if changed != session.settings:
            session.change_settings(changed)

    def _draw_view(self, session: Session) -> None:
        names = list(VIEWS)
        titles = [f"{view.title}  (F{number})" for number, view in enumerate(VIEWS.values(), 1)]
        chosen = self._combo("View", names.index(session.view), titles, VIEWS[session.view].help)
        if names[chosen] != session.view:
            session.choose_view(names[chosen])
        self._label("Freeze", "Keep what is drawn as it was chosen from here, and fly on to look at it (F).")
        if imgui.checkbox("##Freeze", session.stage.frozen is not None)[0]:
            session.toggle_freeze()
        for title, act, help_text in (
            (
                "Stop" if session.flights.recorder else "Record",
                session.flights.toggle_recording,
                "Record the flight you fly (R).",
            ),
            ("Pause" if session.flights.is_playing else "Play", session.flights.toggle_playing, "Play the flight (P)."),
            ("Picture", session.take_screenshot, "Save the picture as PNG (F12)."),
            ("Home", session.frame_all, "Look at the whole terrain (Home)."),
            ("Lab", session.toggle_laboratory, "The laboratory: measure, compare, tune (L)."),
            ("Keys", session.toggle_help, "All keys (H)."),
        ):
            if imgui.button(title):
                act()
            imgui.set_item_tooltip(help_text)
            imgui.same_line()
        imgui.new_line()

    def _draw_look(self, session: Session) -> None:
        exaggeration = self._slider(
            "exaggeration", session.heightfield.exaggeration, "Exaggeration",
            "Factor to the heights; the eye keeps its height above the ground.", EXAGGERATION_RANGE, "%.2f x", True,
        )  # fmt: skip
        if exaggeration != session.heightfield.exaggeration:
            session.exaggerate(exaggeration)
        look = self._edit(session.stage.look, dataclasses.fields(session.stage.look))
        if look != session.stage.look:
            session.change_look(look)

    def _draw_statistics(self, session: Session) -> None:
        if not imgui.collapsing_header("Speed", imgui.TreeNodeFlags_.default_open):
            return
        times = np.array(session.frame_ms, np.float32)
        if times.size:
            recent = float(np.median(times[-30:]))
            top = max(1.25 * float(np.percentile(times, 98)), STEADY_MS)
            imgui.plot_lines(
                "##Frame times", times, 0, f"{recent:.1f} ms", 0.0, top, (-1.0, 3.0 * imgui.get_font_size())
            )
            imgui.set_item_tooltip("Time to choose and draw each picture; the graph begins at 0 ms.")
        with imgui_ctx.begin_table("figures", 2):
            imgui.table_setup_column("name", imgui.TableColumnFlags_.width_fixed, FIGURE_EM * imgui.get_font_size())
            imgui.table_setup_column("value", imgui.TableColumnFlags_.width_stretch)
            for name, value in figures(session):
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_disabled(name)
                imgui.table_next_column()
                imgui.text(value)

    def _edit(self, settings: Any, shown: Any) -> Any:
        """Widgets for some fields of a settings dataclass; the dataclass with what was changed."""
        for field in shown:
            value = self._widget(field, getattr(settings, field.name))
            if value != getattr(settings, field.name):
                settings = replace(settings, **{field.name: value})
        return settings

    def _widget(self, field: Field[Any], value: Any) -> Any:
        about = field.metadata
        label, text, unit = about["label"], about["help"], about["unit"]
        if about["choices"] is not None:
            choices = list(about["choices"])
            suffix = f" {unit}" if unit else ""
            return choices[self._combo(label, choices.index(value), [f"{choice}{suffix}" for choice in choices], text)]
        if isinstance(value, bool):
            self._label(label, text)
            return imgui.checkbox(f"##{label}", value)[1]
        shown_unit = f" {unit}".replace(" deg", "°") if unit else ""
        number = "%d" if isinstance(value, int) else "%.2f"
        return self._slider(field.name, value, label, text, about["range"], number + shown_unit, about["rebuild"])

    def _label(self, label: str, text: str) -> None:
        """A label with its tooltip, left of the widget that follows."""
        imgui.align_text_to_frame_padding()
        imgui.text(label)
        imgui.set_item_tooltip(text)
        imgui.same_line(self._label_width)

    def _combo(self, label: str, current: int, items: list[str], text: str) -> int:
        self._label(label, text)
        imgui.set_next_item_width(-1.0)
        chosen = imgui.combo(f"##{label}", current, items, len(items))[1]
        imgui.set_item_tooltip(text)
        return chosen

    def _slider(
        self, name: str, value: Any, label: str, text: str, limits: tuple[float, float], number: str, on_release: bool
    ) -> Any:
        """A slider; with ``on_release`` the new value counts only when the mouse lets go (it is dear to apply)."""
        self._label(label, text)
        flags = imgui.SliderFlags_.always_clamp
        if limits[0] > 0 and limits[1] / limits[0] >= 20:
            flags |= imgui.SliderFlags_.logarithmic
        imgui.set_next_item_width(-1.0)
        shown = self._dragged.get(name, value)
        if isinstance(value, int):
            _, shown = imgui.slider_int(f"##{label}", shown, int(limits[0]), int(limits[1]), number, flags)
        else:
            _, shown = imgui.slider_float(f"##{label}", shown, limits[0], limits[1], number, flags)
            shown = value if math.isclose(shown, value, rel_tol=1e-6) else shown
        imgui.set_item_tooltip(text)
        if on_release and imgui.is_item_active():
            self._dragged[name] = shown
            return value
        self._dragged.pop(name, None)
        return shown


def figures(session: Session) -> list[tuple[str, str]]:
    """The statistics, as (name, value with unit); what was not measured is left out."""
    stats, (x, y, z) = session.stats, session.camera.position_m
    rows: list[tuple[str, str | None]] = [
        ("triangles", f"{stats.triangles:,}"),
        ("draw calls", f"{stats.draw_calls:,}"),
        ("slices", None if stats.slices is None else f"{stats.slices:,}"),
        ("ray steps", None if stats.ray_steps is None else f"{stats.ray_steps:,.1f} per pixel"),
        ("selection", _milliseconds(stats.select_ms)),
        ("submission", _milliseconds(stats.submit_ms)),
        ("GPU", _milliseconds(stats.gpu_ms)),
        ("uploaded", _bytes(stats.uploaded_bytes)),
        ("on the GPU", _bytes(stats.resident_bytes)),
        *((name, f"{value:,.4g}" if value < 1e6 else f"{value:,.0f}") for name, value in stats.extra.items()),
        ("eye", f"{x:,.0f} E  {z:,.0f} S  {y:,.0f} m"),
        ("above ground", f"{session.height_above_ground_m:,.1f} m"),
        ("speed", f"{session.speed_m_s:,.1f} m/s"),
    ]
    return [(name, value) for name, value in rows if value is not None]


def _milliseconds(value: float | None) -> str | None:
    return None if value is None else f"{value:.2f} ms"


def _bytes(value: int) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if value >= size:
            return f"{value / size:,.1f} {unit}"
    return f"{value} bytes"


def _draw_status(session: Session) -> None:
    """One line at the bottom: what happens, and how to stop it."""
    lines = []
    if session.flights.recorder is not None:
        lines.append("Recording: R stops and saves.")
    if session.flights.is_playing:
        lines.append(f"Playing {session.flights.time_s:.1f} of {session.flights.duration_s:.1f} s.")
    if session.stage.frozen is not None:
        lines.append("Selection frozen: fly on and look at it, F lets it go.")
    if session.message:
        lines.append(session.message)
    if not lines:
        return
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    left = _free_left(session) + MARGIN_EM * em
    right = size.x - laboratory_width(session) - MARGIN_EM * em
    imgui.set_next_window_pos((left, size.y - MARGIN_EM * em), 0, (0.0, 1.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (max(right - left, 1.0), size.y))
    imgui.set_next_window_bg_alpha(0.75)
    flags = _OVERLAY | imgui.WindowFlags_.no_inputs | imgui.WindowFlags_.no_focus_on_appearing
    with imgui_ctx.begin("Status", None, flags):
        imgui.push_text_wrap_pos(max(right - left - em, 1.0))
        imgui.text_unformatted("  ".join(lines))
        imgui.pop_text_wrap_pos()


def _draw_help(session: Session) -> None:
    """All keys, in the middle of what the panel leaves free."""
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    left = _free_left(session)
    left = left if size.x - left > HELP_EM * em else 0.0
    imgui.set_next_window_pos(((left + size.x) / 2, size.y / 2), 0, (0.5, 0.5))
    imgui.set_next_window_bg_alpha(0.94)
    held = [(f"{plus} {minus}", text) for plus, minus, text in HELD.values()]
    rows = [*held, (FAST, "fly four times as fast"), *MOUSE_HELP, *((b.key, b.help) for b in bindings())]
    half = math.ceil(len(rows) / 2)
    imgui.push_style_var(imgui.StyleVar_.window_padding, (1.2 * em, em))
    with imgui_ctx.begin("Help", None, _OVERLAY), imgui_ctx.begin_table("keys", 4, imgui.TableFlags_.sizing_fixed_fit):
        for one, other in zip(rows[:half], [*rows[half:], ("", "")], strict=False):
            imgui.table_next_row()
            for key, text in (one, other):
                imgui.table_next_column()
                imgui.text_colored(_KEY_COLOUR, f"{key}  ")
                imgui.table_next_column()
                imgui.text_unformatted(f"{text}      ")
    imgui.pop_style_var()


def _free_left(session: Session) -> float:
    """Where the part of the window begins that the panel does not cover."""
    return ((WIDTH_EM + MARGIN_EM) if session.shows_panel else 0.0) * imgui.get_font_size()
