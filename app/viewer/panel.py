"""Everything that lies over the picture: menu, windows, the status line, the help. One call draws it all."""

from __future__ import annotations

import math
from collections.abc import Sequence

from imgui_bundle import imgui, imgui_ctx

from app.session.preferences import Preferences
from app.session.session import Session
from app.viewer.docking import draw_windows, keep_layout, rescale_layout
from app.viewer.gamepad import pad_help
from app.viewer.keys import help_rows
from app.viewer.menu import draw_menu
from app.viewer.overlay import draw_overlay
from app.windows.dialogs import draw_questions
from app.windows.laboratory import draw_divider
from app.windows.theme import apply_theme, bad, key_colour
from terrain.renderers import RENDERERS

_OVERLAY = (
    imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_docking | imgui.WindowFlags_.always_auto_resize
)  # fmt: skip


class Panel:
    """Draws what lies over the picture. Holds only which theme and scale are applied."""

    def __init__(self) -> None:
        self._applied: tuple[str, float, float] | None = None

    def draw(self, session: Session) -> None:
        """All of one frame."""
        lines = status_lines(session)
        if session.layout.shows_windows:
            draw_menu(session)
        if session.layout.shows_windows or lines:
            _draw_status(session, lines)
        if session.comparison.mode == "split":
            draw_divider(session)
        if session.layout.shows_windows:
            draw_windows(session)
            draw_overlay(session)
        if session.gpu.programs.errors:
            _draw_shader_errors(session.gpu.programs.errors)
        draw_questions(session)
        if session.layout.shows_help:
            _draw_help(session)
        if session.preferences.problem:
            session.say(session.preferences.problem)
            session.preferences.problem = ""
        keep_layout(session.preferences)
        self._apply_theme(session.preferences.current)

    def _apply_theme(self, preferences: Preferences) -> None:
        """Take over another theme or scale for the next frame; docked windows grow with their text."""
        wanted = preferences.theme, preferences.ui_scale, imgui.get_main_viewport().dpi_scale or 1.0
        if wanted != self._applied:
            apply_theme(preferences, wanted[2])
            if self._applied is not None:
                rescale_layout(wanted[1] * wanted[2] / (self._applied[1] * self._applied[2]))
            self._applied = wanted


def status_lines(session: Session) -> list[str]:
    """What happens now, and how to stop it."""
    lines = [str(job) for job in session.jobs]
    if session.flights.recorder is not None:
        lines.append("Recording: R stops and saves.")
    if session.flights.is_playing:
        lines.append(f"Playing {session.flights.time_s:.1f} of {session.flights.duration_s:.1f} s: P pauses.")
    if unfinished := session.stage.unfinished:
        lines.append(f"{', '.join(unfinished).capitalize()} while you fly.")
    if session.stage.frozen is not None:
        lines.append("Selection frozen: fly on and look at it, F lets it go.")
    if session.message:
        lines.append(session.message)
    return lines


def idle_line(session: Session) -> str:
    """What the status line says while nothing happens."""
    above = f"{session.height_above_ground_m:,.0f} m above the ground"
    return f"{session.heightfield.name}, {RENDERERS[session.algorithm].title}, {above}. H lists all keys."


def _draw_status(session: Session, lines: Sequence[str]) -> None:
    """A bar below everything: what happens, and a button that stops it. Wraps where it must; covers nothing."""
    em, width = imgui.get_font_size(), imgui.get_io().display_size.x
    stoppable = any(job.stop is not None for job in session.jobs)
    text = "  ".join(lines) or idle_line(session)
    room = max(width - (6.0 if stoppable else 1.5) * em, 1.0)
    height = imgui.calc_text_size(text, False, room).y + 2.0 * imgui.get_style().frame_padding.y
    imgui.push_style_var(imgui.StyleVar_.window_padding, (0.6 * em, imgui.get_style().frame_padding.y))
    imgui.push_style_var(imgui.StyleVar_.window_min_size, (1.0, 1.0))
    flags = imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_nav_focus
    if imgui.internal.begin_viewport_side_bar("Status", imgui.get_main_viewport(), imgui.Dir.down, height, flags):
        if stoppable:
            if imgui.small_button("Stop"):
                session.jobs.stop_newest()
            imgui.set_item_tooltip("Stop what began last (Escape); what is done stays.")
            imgui.same_line()
        imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + room)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
    imgui.end()
    imgui.pop_style_var(2)


def _draw_shader_errors(errors: Sequence[str]) -> None:
    """What the driver says about shaders that were changed while developing, with file and line."""
    size = imgui.get_io().display_size
    imgui.set_next_window_pos((size.x / 2, size.y / 2), imgui.Cond_.appearing, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0.0, 0.0), (0.9 * size.x, 0.8 * size.y))
    flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_saved_settings
    flags |= imgui.WindowFlags_.no_docking | imgui.WindowFlags_.no_focus_on_appearing
    with imgui_ctx.begin("Broken shaders", None, flags):
        imgui.push_text_wrap_pos(0.85 * size.x)
        imgui.text_disabled("The old ones draw until these are mended.")
        for error in errors:
            imgui.text_colored(bad(), error)
        imgui.pop_text_wrap_pos()


def _draw_help(session: Session) -> None:
    """All keys at once, in the middle of the window."""
    em, size = imgui.get_font_size(), imgui.get_io().display_size
    rows = [*help_rows(), *(pad_help() if session.navigation.has_gamepad else [])]
    imgui.set_next_window_pos((size.x / 2, size.y / 2), 0, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0.0, 0.0), size)
    imgui.set_next_window_bg_alpha(1.0)
    imgui.set_next_window_focus()  # above all windows
    imgui.push_style_var(imgui.StyleVar_.window_padding, (round(em), round(0.8 * em)))
    flags = _OVERLAY & ~imgui.WindowFlags_.no_scrollbar
    with imgui_ctx.begin("Help", None, flags):
        work, safe = imgui.get_main_viewport().work_size, imgui.get_style().display_safe_area_padding
        columns, share = _fit_help(rows, (work.x - 2.0 * safe.x - 3.0 * em, work.y - 2.0 * safe.y - 2.0 * em))
        imgui.push_font(None, share * imgui.get_style().font_size_base)
        _draw_columns(rows, columns)
        imgui.pop_font()
    imgui.pop_style_var()


def _fit_help(rows: Sequence[tuple[str, str]], room: tuple[float, float]) -> tuple[int, float]:
    """In how many columns, and at which share of the usual size, all rows fit into a room [px]."""
    em = imgui.get_font_size()
    wide = max(imgui.calc_text_size(key + told).x for key, told in rows) + 6.0 * em
    padding = 2.0 * imgui.get_style().cell_padding.y  # does not shrink with the text
    for share in (1.0, 0.9, 0.8, 0.7, 0.6):
        columns = max(1, int(room[0] / (share * wide)))
        if -(-len(rows) // columns) * (math.ceil(share * em) + padding) <= room[1]:
            break
    return columns, share


def _draw_columns(rows: Sequence[tuple[str, str]], columns: int) -> None:
    """Rows of (key, meaning), read down one column and then the next."""
    em, tall = imgui.get_font_size(), -(-len(rows) // columns)
    with imgui_ctx.begin_table("keys", 2 * columns, imgui.TableFlags_.sizing_fixed_fit):
        for row in range(tall):
            imgui.table_next_row()
            for key, told in rows[row::tall]:
                imgui.table_next_column()
                imgui.text_colored(key_colour(), key)
                imgui.same_line(0.0, em)
                imgui.dummy((0.0, 0.0))
                imgui.table_next_column()
                imgui.text_unformatted(told)
                imgui.same_line(0.0, 1.5 * em)
                imgui.dummy((0.0, 0.0))
