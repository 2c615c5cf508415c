"""The timeline: play, pause, scrub, step; keyframes to drag, add, delete and give another view.

Everything it shows and does lives in `app.session.flights`; here are only widgets.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from imgui_bundle import imgui

from app.flying.timeline import LONGEST_S
from app.session.flights import Flights
from app.session.session import Session
from app.windows.theme import good, ink, key_colour, packed
from app.windows.widgets import button
from terrain.flight import PACES, Pace

FIELD_EM, DIAMOND_EM = 6.0, 0.45
LANE_EM = (2.6, 6.0)  # at least and at most
FPS_RANGE = (1, 240)
_STEPS_S = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1800, 3600, 7200)  # between marks of the ruler
_MARK_EM = 4.5  # between marks at least

_grabbed: list[int] = []  # the keyframe being dragged


def draw_timeline(session: Session) -> None:
    """The contents of the window."""
    _draw_transport(session.flights)
    _draw_lane(session)
    _draw_editing(session)


def _draw_transport(flights: Flights) -> None:
    """Where playback is, and how it goes on."""
    em = imgui.get_font_size()
    _row(
        ("|<##first", "To the beginning.", lambda: flights.seek(0.0)),
        ("<##back", "One frame back (,).", lambda: flights.step(-1)),
        ("Pause##play" if flights.is_playing else "Play##play", "Play on, or pause (P).", flights.toggle_playing),
        (">##forward", "One frame forward (.).", lambda: flights.step(1)),
        (">|##last", "To the end.", lambda: flights.seek(flights.duration_s)),
    )
    flights.loops = imgui.checkbox("Loop", flights.loops)[1]
    imgui.set_item_tooltip("Begin again at the end.")
    imgui.same_line()
    names: list[Pace] = list(PACES)
    imgui.set_next_item_width(FIELD_EM * em)
    chosen = imgui.combo("##Pace", names.index(flights.pace), [*names], len(names))[1]
    imgui.set_item_tooltip("\n".join(f"{name}: {told}" for name, told in PACES.items()))
    if names[chosen] != flights.pace:
        flights.choose_pace(names[chosen])
    imgui.same_line()
    imgui.set_next_item_width(0.8 * FIELD_EM * em)
    flags = imgui.SliderFlags_.always_clamp
    flights.fps = imgui.drag_int("##Fps", flights.fps, 0.2, *FPS_RANGE, "%d fps", flags)[1]
    imgui.set_item_tooltip("Frames per second of single steps. Drag, or Ctrl+click and type.")
    imgui.same_line()
    frame = round(flights.time_s * flights.fps)
    imgui.text(f"{flights.time_s:.2f} of {flights.duration_s:.2f} s, frame {frame}")


def _draw_lane(session: Session) -> None:
    """A ruler, the keyframes on it, and the playhead; a click goes there, a keyframe can be dragged."""
    flights, em = session.flights, imgui.get_font_size()
    room = imgui.get_content_region_avail()
    width, below = max(room.x, 1.0), 2.0 * imgui.get_frame_height_with_spacing()
    height = min(max(room.y - below, LANE_EM[0] * em), LANE_EM[1] * em)
    draw, (left, top) = imgui.get_window_draw_list(), imgui.get_cursor_screen_pos()
    margin, radius = em, DIAMOND_EM * em
    span_s = max(flights.duration_s, 1e-3)

    def at(time_s: float) -> float:
        return left + margin + time_s / span_s * (width - 2 * margin)

    def time_at(x: float) -> float:
        return (x - left - margin) / max(width - 2 * margin, 1.0) * span_s

    imgui.invisible_button("##Lane", (width, height))
    keys_x = left + margin + flights.key_times_s() / span_s * (width - 2 * margin)
    middle = top + 0.5 * (height + em)
    _handle_mouse(flights, keys_x, radius, time_at)

    draw.add_rect_filled((left, top), (left + width, top + height), packed(ink(0.06)), 3.0)
    step_s = next((s for s in _STEPS_S if s / span_s * width >= _MARK_EM * em), _STEPS_S[-1])
    for mark_s in np.arange(0.0, span_s + 1e-9, step_s).tolist():
        draw.add_line((at(mark_s), top + em), (at(mark_s), top + height), packed(ink(0.18)))
        if at(mark_s) + _MARK_EM / 2 * em < left + width:
            draw.add_text((at(mark_s) + 3.0, top), packed(ink(0.6)), f"{mark_s:g} s")
    selected = flights.timeline.selected
    for i in _apart(keys_x):
        colour = key_colour() if i == selected else good()
        _add_diamond(draw, float(keys_x[i]), middle, radius * (1.3 if i == selected else 1.0), packed(colour))
    if selected is not None:
        _add_diamond(draw, float(keys_x[selected]), middle, 1.3 * radius, packed(key_colour()))
    draw.add_line((at(flights.time_s), top), (at(flights.time_s), top + height), packed(ink()), 1.5)


def _handle_mouse(flights: Flights, keys_x: np.ndarray, radius: float, time_at: Callable[[float], float]) -> None:
    """Select, drag, scrub."""
    x = imgui.get_io().mouse_pos.x
    near = int(np.argmin(np.abs(keys_x - x)))
    is_near = abs(float(keys_x[near]) - x) <= 1.5 * radius
    if imgui.is_item_hovered() and not imgui.is_item_active():
        told = "click: go there, drag: another time" if flights.pace == "timed" else "click: go there"
        key = f"Keyframe {near + 1}, {flights.timeline.times_s[near]:.2f} s; {told}"
        imgui.set_tooltip(key if is_near else f"{min(max(time_at(x), 0.0), flights.duration_s):.2f} s; click: go there")
    if imgui.is_item_activated():
        _grabbed[:] = [near] if is_near else []
        if is_near:
            flights.select_keyframe(near)
    if imgui.is_item_active():
        if not _grabbed:
            flights.seek(time_at(x))
        elif flights.pace == "timed" and imgui.is_mouse_dragging(0, 3.0):
            flights.move_keyframe(_grabbed[0], time_at(x), dragging=True)
    if imgui.is_item_deactivated():
        flights.timeline.drop()
        _grabbed.clear()


def _draw_editing(session: Session) -> None:
    """What can be done to the flight and to the selected keyframe."""
    flights, em = session.flights, imgui.get_font_size()
    timeline = flights.timeline
    _row(
        ("New", "Begin a new flight at the present view; Undo brings this one back.", flights.start_anew),
        ("Add", "Make the view a keyframe at the playhead; at the end, after the last one (Insert).",
         flights.add_keyframe),
    )  # fmt: skip
    _row(
        ("Update", "Give the selected keyframe the present view (U).", flights.update_keyframe),
        ("Delete", "Take the selected keyframe away (Delete).", flights.delete_keyframe),
        is_off=timeline.selected is None,
    )
    _row(("Undo", "Take the last edit back (Ctrl+Z).", flights.undo), is_off=not timeline.can_undo)
    _row(("Redo", "Do it again (Ctrl+Y).", flights.redo), is_off=not timeline.can_redo)
    save = "Save*##save" if timeline.is_changed else "Save##save"
    _row(
        (save, "Save the flight under a new name (Ctrl+S); * means that it has unsaved changes.", flights.save),
        ("KML", "Save the flight as a tour for Google Earth.", flights.save_kml),
    )
    imgui.new_line()
    flags = imgui.InputTextFlags_.enter_returns_true
    imgui.set_next_item_width(FIELD_EM * em)
    changed, duration_s = imgui.input_float("##Duration", flights.duration_s, 0.0, 0.0, "lasts %.2f s", flags)
    imgui.set_item_tooltip("How long the flight lasts; another number stretches all of it. Enter confirms.")
    if changed:
        flights.stretch(min(duration_s, LONGEST_S))
    if timeline.selected is not None:
        imgui.same_line()
        imgui.text(f"keyframe {timeline.selected + 1} of {len(timeline.flight.keyframes)}")
        imgui.same_line()
        imgui.set_next_item_width(FIELD_EM * em)
        now_s = timeline.times_s[timeline.selected]
        changed, time_s = imgui.input_float("##Time", now_s, 0.0, 0.0, "at %.2f s", flags)
        imgui.set_item_tooltip("When the selected keyframe is reached. Enter confirms.")
        if changed:
            flights.move_keyframe(timeline.selected, time_s)


def _row(*buttons: tuple[str, str, Callable[[], object]], is_off: bool = False) -> None:
    """Buttons beside each other, and beside what follows."""
    imgui.begin_disabled(is_off)
    for title, told, act in buttons:
        button(title, told, act)
        imgui.same_line()
    imgui.end_disabled()


def _apart(keys_x: np.ndarray) -> list[int]:
    """Of the keyframes those that do not fall on the same pixel as the one before."""
    return np.unique(np.round(keys_x), return_index=True)[1].tolist()


def _add_diamond(draw: imgui.ImDrawList, x: float, y: float, radius: float, colour: int) -> None:
    draw.add_quad_filled((x - radius, y), (x, y - radius), (x + radius, y), (x, y + radius), colour)
