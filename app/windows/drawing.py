"""The window on the left: algorithm, view, look, and what drawing costs."""

from __future__ import annotations

import dataclasses

import numpy as np
from imgui_bundle import imgui

from app.session.session import Session
from app.windows.widgets import Form, button, figures_table
from terrain.renderers import RENDERERS
from terrain.views import VIEWS

FIGURE_EM = 8.6
EXAGGERATION_RANGE = (0.1, 10.0)
STEADY_MS = 1000.0 / 60.0


def draw_drawing(session: Session) -> None:
    """The contents of the window."""
    shown = (*dataclasses.fields(session.settings), *dataclasses.fields(session.stage.look))
    form = Form(["Exaggeration", *(field.metadata["label"] for field in shown)])
    _draw_algorithm(session, form)
    _draw_view(session, form)
    _draw_statistics(session)
    if imgui.collapsing_header("Look"):
        _draw_look(session, form)


def _draw_algorithm(session: Session, form: Form) -> None:
    names = list(RENDERERS)
    titles = [kind.title for kind in RENDERERS.values()]
    chosen = form.combo("Algorithm", names.index(session.algorithm), titles, RENDERERS[session.algorithm].source)
    if names[chosen] != session.algorithm:
        session.algorithms.choose(names[chosen])
    first, *own = dataclasses.fields(session.settings)
    changed = form.edit(session.settings, [first])
    if own and imgui.collapsing_header("Settings of this algorithm"):
        changed = form.edit(changed, own)
    if changed != session.settings:
        session.algorithms.change_settings(changed)


def _draw_view(session: Session, form: Form) -> None:
    names = list(VIEWS)
    titles = [f"{view.title}  (F{number})" for number, view in enumerate(VIEWS.values(), 1)]
    chosen = form.combo("View", names.index(session.view), titles, VIEWS[session.view].help)
    if names[chosen] != session.view:
        session.choose_view(names[chosen])
    is_frozen = session.stage.frozen is not None
    told = "Keep what is drawn as it was chosen from here, and fly on to look at it (F)."
    if form.checkbox("Freeze", is_frozen, told) != is_frozen:
        session.toggle_freeze()
    flights = session.flights
    for title, act, told in (
        ("Stop" if flights.recorder else "Record", flights.toggle_recording, "Record the flight you fly (R)."),
        ("Pause" if flights.is_playing else "Play", flights.toggle_playing, "Play the flight (P)."),
        ("Picture", session.take_screenshot, "Save the picture as PNG (F12)."),
        ("Home", session.frame_all, "Look at the whole terrain (Home)."),
        ("Lab", lambda: session.layout.toggle("laboratory"), "The laboratory: measure, compare, tune (L)."),
        ("Keys", session.layout.toggle_help, "All keys (H)."),
    ):
        button(title, told, act)
        imgui.same_line()
    imgui.new_line()


def _draw_look(session: Session, form: Form) -> None:
    told = "Factor to the heights; the eye keeps its height above the ground."
    before = session.heightfield.exaggeration
    exaggeration = form.slider("Exaggeration", before, told, EXAGGERATION_RANGE, "%.2f x", on_release=True)
    if exaggeration != before:
        session.exaggerate(exaggeration)
    look = form.edit(session.stage.look, dataclasses.fields(session.stage.look))
    if look != session.stage.look:
        session.change_look(look)


def _draw_statistics(session: Session) -> None:
    if not imgui.collapsing_header("Speed", imgui.TreeNodeFlags_.default_open):
        return
    times = np.array(session.frame_ms, np.float32)
    if times.size:
        recent = float(np.median(times[-30:]))
        top = max(1.25 * float(np.percentile(times, 98)), STEADY_MS)
        size = -1.0, 3.0 * imgui.get_font_size()
        imgui.plot_lines("##Frame times", times, 0, f"{recent:.1f} ms", 0.0, top, size)
        imgui.set_item_tooltip("Time to choose and draw each picture; the graph begins at 0 ms.")
    figures_table("figures", figures(session), FIGURE_EM)


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
        ("speed", f"{session.navigation.speed_m_s:,.1f} m/s"),
    ]
    return [(name, value) for name, value in rows if value is not None]


def _milliseconds(value: float | None) -> str | None:
    return None if value is None else f"{value:.2f} ms"


def _bytes(value: int) -> str:
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if value >= size:
            return f"{value / size:,.1f} {unit}"
    return f"{value} bytes"
