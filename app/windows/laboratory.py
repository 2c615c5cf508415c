"""The laboratory panel, drawn with ImGui: promise, chart, fair switching, A beside B, waste, the flight.

Everything it shows and does lives in `app.session.laboratory` and `app.session.comparison`; here are only widgets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from imgui_bundle import imgui, imgui_ctx

from app.session.comparison import DIVIDER_RANGE, MODES
from app.session.laboratory import FRAMES_RANGE
from app.session.session import Session
from app.windows.chart import colour_of, draw_chart
from app.windows.theme import bad, good, ink, packed
from app.windows.widgets import Form, button, figures_table
from terrain.measure.strip import POP_SHARE, find_marks, slow_limit_ms
from terrain.renderers import RENDERERS

LABEL_EM, WASTE_EM = 7.0, 11.0
WANTED_PX, WANTED_MS = (0.25, 16.0), (1.0, 200.0)
_WHITE, _SHADE = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.6)  # over the picture, in both themes
_FIXED = (
    imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_title_bar | imgui.WindowFlags_.no_docking
)  # fmt: skip


def draw_laboratory(session: Session) -> None:
    """The contents of the window."""
    _draw_promise(session)
    draw_chart(session)
    _draw_measuring(session)
    for title, draw, is_open in _SECTIONS:
        if imgui.collapsing_header(title, imgui.TreeNodeFlags_.default_open if is_open else 0):
            draw(session)


def _draw_promise(session: Session) -> None:
    """A gauge: the largest error behind the delivered one, and the promise as a line across."""
    found = session.laboratory.delivered
    em = imgui.get_font_size()
    width, height = imgui.get_content_region_avail().x, 0.8 * em
    imgui.text("Promise")
    imgui.same_line(LABEL_EM * em)
    if found is None:
        imgui.text_disabled("not measured yet")
        imgui.dummy((width, height))
        return
    colour = good() if found.is_kept else bad()
    verdict = "kept" if found.is_kept else "broken"
    imgui.text_colored(colour, f"{found.tolerance_px:.2f} px, {verdict}")
    draw, (x, y) = imgui.get_window_draw_list(), imgui.get_cursor_screen_pos()
    scale = width / max(2.0 * found.tolerance_px, 1.05 * found.max_px)
    shade = (*colour[:3], 0.35)
    for value, fill in ((2e9, ink(0.08)), (found.max_px, shade), (found.p999_px, colour)):
        draw.add_rect_filled((x, y), (x + min(value * scale, width), y + height), packed(fill))
    at = x + found.tolerance_px * scale
    draw.add_line((at, y - 0.15 * em), (at, y + height + 0.15 * em), packed(ink()), 2.0)
    imgui.dummy((width, height))
    imgui.set_item_tooltip("Full colour: 99.9 % of the pixels err by less; faint: the worst; line: the tolerance.")
    imgui.text_disabled(f"99.9 % below {found.p999_px:.3f} px, worst {found.max_px:.3f} px, {found.frame_ms:.1f} ms")


def _draw_measuring(session: Session) -> None:
    """Which algorithms, how many frames; Measure, or how far it is and Cancel."""
    lab, em = session.laboratory, imgui.get_font_size()
    half = imgui.get_content_region_avail().x / 2
    for number, name in enumerate(lab.chosen):
        if number % 2:
            imgui.same_line(half)
        imgui.push_style_color(imgui.Col_.check_mark, colour_of(name))
        imgui.push_style_color(imgui.Col_.text, colour_of(name))
        lab.chosen[name] = imgui.checkbox(f"{_short(name)}##{name}", lab.chosen[name])[1]
        imgui.pop_style_color(2)
        imgui.set_item_tooltip(f"{RENDERERS[name].title}: in the chart, and in what is measured and made equal.")
    if lab.is_busy:
        if imgui.button("Cancel"):
            lab.cancel()
        imgui.same_line()
        imgui.progress_bar(lab.share, (-1.0, 0.0), f"{lab.doing}, {100 * lab.share:.0f} %")
        return
    button("Measure", "Draw the flight with every chosen algorithm at five tolerances.", lab.measure_runs)
    imgui.same_line()
    imgui.begin_disabled(lab.results is None)
    button("Save", "Save all that was measured as results.json and results.csv.", lambda: lab.save(session.folder))
    imgui.end_disabled()
    imgui.same_line()
    imgui.set_next_item_width(-1.0)
    lab.frames = imgui.slider_int("##Frames", lab.frames, *FRAMES_RANGE, "%d frames of the flight")[1]
    imgui.set_item_tooltip("How many frames of the flight are measured; more take longer and say more.")
    imgui.dummy((0.0, 0.1 * em))


def _draw_fair(session: Session) -> None:
    """What is wanted, and who is to deliver it."""
    lab, em = session.laboratory, imgui.get_font_size()
    rows: tuple[tuple[str, str, tuple[float, float], str, Callable[[], None], bool], ...] = (
        ("error", "wanted_px", WANTED_PX, "%.2f px", lab.tune_error, False),
        ("time", "wanted_ms", WANTED_MS, "%.1f ms", lab.tune_time, True),
    )
    imgui.begin_disabled(lab.is_busy)
    for what, attribute, limits, form, tune, by_time in rows:
        imgui.set_next_item_width(LABEL_EM * em)
        flags = imgui.SliderFlags_.logarithmic | imgui.SliderFlags_.always_clamp
        value = imgui.slider_float(f"##Wanted {what}", getattr(lab, attribute), *limits, form, flags)[1]
        setattr(lab, attribute, value)
        imgui.set_item_tooltip(f"The {what} that Equal {what} and Best for me go for.")
        imgui.same_line()
        told = f"Turn every chosen algorithm's tolerance until all have this {what}; then switch with the digit keys."
        button(f"Equal {what}", told, tune)
        imgui.same_line(17.0 * em)
        told = f"Switch to the best algorithm and setting measured for this {what}."
        button(f"Best for me##{what}", told, lambda by_time=by_time: lab.choose_best(by_time=by_time))  # type: ignore[misc]
    imgui.end_disabled()
    if session.algorithms.tuned:
        imgui.push_text_wrap_pos(0.0)
        told = ", ".join(f"{_short(n)} {s.tolerance_px:.2f}" for n, s in session.algorithms.tuned.items())
        imgui.text_disabled(f"tolerances [px]: {told}")
        imgui.pop_text_wrap_pos()


def _draw_comparison(session: Session) -> None:
    """A is what is chosen in the panel on the left; B is chosen here."""
    other, form = session.comparison, Form(["Tolerance B"])
    modes = list(MODES)
    told = "Show B in one half of the picture, or how the two pictures differ."
    chosen = form.combo("A and B", modes.index(other.mode), list(MODES.values()), told)
    if modes[chosen] != other.mode:
        session.compare(modes[chosen])
    names = list(RENDERERS)
    titles = [kind.title for kind in RENDERERS.values()]
    chosen = form.combo("B is", names.index(other.algorithm), titles, RENDERERS[other.algorithm].source)
    if names[chosen] != other.algorithm:
        session.choose_other(names[chosen])
    told = "Allowed geometric error of B on the screen."
    tolerance_px = form.slider("Tolerance B", other.settings.tolerance_px, told, WANTED_PX, "%.2f px")
    if tolerance_px != other.settings.tolerance_px:
        session.choose_other(other.algorithm, replace(other.settings, tolerance_px=tolerance_px))
    keep = "Keep what is shown now, with all its settings, as B."
    button("Keep A as B", keep, lambda: session.choose_other(session.algorithm, session.settings))
    imgui.same_line()
    button("Swap", "A becomes B and B becomes A.", session.swap_sides)


def _draw_waste(session: Session) -> None:
    """What the view cost against what it needs."""
    lab = session.laboratory
    imgui.begin_disabled(lab.is_busy)
    button("Meter this view", "Count what this view cost against what it needs (takes seconds).", lab.meter_waste)
    imgui.end_disabled()
    figures_table("waste", waste_figures(session), WASTE_EM)


def waste_figures(session: Session) -> list[tuple[str, str]]:
    """The waste meter, as (name, value); what was not measured is left out."""
    waste = session.laboratory.waste
    if waste is None:
        return []
    spent = waste.triangles / max(waste.needed, 1)
    share = None if waste.small_share is None else f"{100 * waste.small_share:.0f} %"
    rows: list[tuple[str, str | None]] = [
        ("triangles drawn", f"{waste.triangles:,}"),
        ("needed for its error", f"about {waste.needed:,} (1 : {spent:.1f})"),
        ("smaller than a pixel", share),
        ("per covered pixel", f"{waste.triangles / max(waste.covered_px, 1):.2f}"),
        ("overdraw", f"{waste.overdraw_mean:.2f}, at most {waste.overdraw_max:.0f}"),
        ("ray steps per pixel", None if waste.ray_steps is None else f"{waste.ray_steps:.1f}"),
        ("slices", None if waste.slices is None else f"{waste.slices:,}"),
    ]
    return [(name, value) for name, value in rows if value is not None]


def _draw_flight(session: Session) -> None:
    """The flight's timeline, and below it where it is not stable; a click goes there."""
    lab, em = session.laboratory, imgui.get_font_size()
    duration_s = max(session.flights.duration_s, 1e-3)
    imgui.set_next_item_width(-1.0)
    changed, time_s = imgui.slider_float("##Timeline", session.flights.time_s, 0.0, duration_s, "%.1f s")
    if changed:
        session.flights.seek(time_s)
    imgui.set_item_tooltip("Where the flight is; drag to go there.")
    width, height = imgui.get_content_region_avail().x, 3.9 * em
    draw, (x, y) = imgui.get_window_draw_list(), imgui.get_cursor_screen_pos()
    if imgui.invisible_button("##Strip", (width, height)):
        session.flights.seek((imgui.get_io().mouse_pos.x - x) / width * duration_s)
    if imgui.is_item_hovered():
        _tell_strip(session, (imgui.get_io().mouse_pos.x - x) / width * duration_s)
    frames, tolerance_px = lab.strip, lab.strip_tolerance_px
    marks = find_marks(frames, tolerance_px)
    limit_ms = slow_limit_ms(frames) if frames else 1.0
    lanes = (
        ("holes", [float(frame.holes_px) for frame in frames], 1.0, marks.holes),
        ("pops", [frame.popping_px for frame in frames], POP_SHARE * tolerance_px, marks.pops),
        ("slow", [frame.frame_ms for frame in frames], limit_ms, marks.slow),
    )
    lane_height = height / len(lanes)
    for number, (name, values, limit, wrong) in enumerate(lanes):
        top = y + number * lane_height
        bottom = top + lane_height - 2.0
        draw.add_rect_filled((x, top), (x + width, bottom), packed(ink(0.07)))
        step = max(width / max(len(frames), 1), 1.0) if not lab.is_busy else max(width * 0.003, 1.0)
        for i, value in enumerate(values):
            at = x + frames[i].time_s / duration_s * (width - step)
            tall = min(value / limit, 1.0) * (bottom - top)
            colour = bad() if i in wrong else (*good()[:3], 0.55)
            draw.add_rect_filled(
                (at, bottom - (bottom - top if i in wrong else tall)), (at + step, bottom), packed(colour)
            )
        draw.add_text((x + 0.3 * em, top + 0.05 * em), packed(ink(0.75)), f"{name} {len(wrong) or ''}")
    at = x + session.flights.time_s / duration_s * width
    draw.add_line((at, y), (at, y + height), packed(ink()), 1.5)
    imgui.begin_disabled(lab.is_busy)
    button("Check the flight", "Look for holes, pops and slow frames along the flight.", lab.check_flight)
    imgui.end_disabled()


def _tell_strip(session: Session, time_s: float) -> None:
    frames = session.laboratory.strip
    if frames:
        frame = min(frames, key=lambda frame: abs(frame.time_s - time_s))
        told = f"{frame.holes_px} px of holes, popping {frame.popping_px:.2f} px, {frame.frame_ms:.1f} ms"
        imgui.set_tooltip(f"{frame.time_s:.1f} s: {told}; click: go there")


def draw_divider(session: Session) -> None:
    """The line between A and B: it can be dragged. Names stand on both sides of it, at the bottom."""
    other, em, size = session.comparison, imgui.get_font_size(), imgui.get_io().display_size
    at, grip = other.divider * size.x, 0.8 * em
    imgui.set_next_window_pos((at - grip / 2, 0.0))
    imgui.set_next_window_size((grip, size.y))
    imgui.push_style_var(imgui.StyleVar_.window_padding, (0.0, 0.0))
    imgui.push_style_var(imgui.StyleVar_.window_min_size, (1.0, 1.0))
    flags = _FIXED | imgui.WindowFlags_.no_background | imgui.WindowFlags_.no_bring_to_front_on_focus
    with imgui_ctx.begin("Divider", None, flags):
        imgui.invisible_button("##Divider", (grip, size.y))
        if imgui.is_item_hovered() or imgui.is_item_active():
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        if imgui.is_item_active():
            other.divider = min(max(imgui.get_io().mouse_pos.x / size.x, DIVIDER_RANGE[0]), DIVIDER_RANGE[1])
    imgui.pop_style_var(2)
    draw = imgui.get_background_draw_list()
    draw.add_line((at, 0.0), (at, size.y), packed(_WHITE), 2.0)
    sides = f"A  {_drawn_by(session.algorithm, session.settings)}", f"B  {_drawn_by(other.algorithm, other.settings)}"
    top = imgui.get_main_viewport().work_pos.y + 0.4 * em
    for text, is_left in zip(sides, (True, False), strict=True):
        extent = imgui.calc_text_size(text)
        x = at - extent.x - em if is_left else at + em
        draw.add_rect_filled((x - 4.0, top - 2.0), (x + extent.x + 4.0, top + extent.y + 2.0), packed(_SHADE), 3.0)
        draw.add_text((x, top), packed(_WHITE), text)


_SECTIONS: tuple[tuple[str, Callable[[Session], None], bool], ...] = (
    ("Fair switching", _draw_fair, True),
    ("Flight", _draw_flight, True),
    ("A beside B", _draw_comparison, False),
    ("Waste", _draw_waste, False),
)


def _drawn_by(algorithm: str, settings: Any) -> str:
    return _short(algorithm) + ("" if algorithm == "reference" else f" {settings.tolerance_px:.3g} px")


def _short(algorithm: str) -> str:
    return algorithm.capitalize()
