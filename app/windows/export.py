"""The export window: what, how large, how fast; then how far it is, and how to stop it."""

from __future__ import annotations

from dataclasses import fields

from imgui_bundle import imgui

from app.session.export import KINDS, Order
from app.session.session import Session
from app.windows.widgets import Form, button

_PICTURE_ONLY, _FLIGHT_ONLY = ("straight_down",), ("fps", "frames")


def draw_export(session: Session) -> None:
    """The contents of the window."""
    exporter = session.exporter
    order = exporter.order
    left_out = _FLIGHT_ONLY if order.kind == "picture" else _PICTURE_ONLY
    shown = [f for f in fields(Order) if f.name not in left_out and (f.name != "codec" or order.kind == "film")]
    form = Form(field.metadata["label"] for field in fields(Order))
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()  # Tab goes on from the first widget ...
        imgui.set_nav_cursor_visible(True)  # ... which is seen to be the one
    imgui.begin_disabled(exporter.is_busy)
    exporter.order = form.edit(order, shown)
    imgui.text_disabled(f"{KINDS[order.kind][:1].upper()}{KINDS[order.kind][1:]}, {_amount(session, order)}.")
    imgui.end_disabled()
    job, left_s = exporter.job, exporter.left_s
    if job is None:
        button("Export", "Draw it off screen, under a new name in the current folder.", exporter.start)
        return
    button("Cancel", "Stop; of a film and of frames what is done is kept.", exporter.cancel)
    imgui.same_line()
    told = "" if left_s is None else f"{left_s:.0f} s left"
    imgui.progress_bar(job.share or 0.0, (-1.0, 0.0), told)


def _amount(session: Session, order: Order) -> str:
    if order.kind == "picture":
        return f"{order.width_px * order.height_px / 1e6:.1f} megapixels"
    duration_s = session.flights.duration_s
    count = order.frames or int(duration_s * order.fps + 1e-6) + 1
    return f"{count} frames, {count / order.fps:.1f} s"
