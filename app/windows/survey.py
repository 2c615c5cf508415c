"""The window of what was picked and measured: the point's figures, and the profile drawn with ImPlot.

What its widgets do lives in `app.session.survey`.
"""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from app.places.coordinates import Coordinates, latlon, metres, wind
from app.places.picking import Profile
from app.session.session import Session
from app.session.survey import Point
from app.windows.theme import ink
from app.windows.widgets import button, figures_table

NAME_EM, PLOT_EM = 7.0, 11.0
GROUND_COLOUR = (1.0, 0.55, 0.1, 1.0)


def draw_survey(session: Session) -> None:
    """The contents of the window."""
    survey = session.survey
    point = survey.point
    if point is None:
        _draw_note("Click the ground to pick a point (I: the middle of the picture).")
    else:
        figures_table("point", point_rows(point, survey.coordinates), NAME_EM)
        button("Copy", "Copy the point to the clipboard, as text.", lambda: _copy(point, survey.coordinates))
        imgui.same_line()
        button("Fly there", "Fly to the picked point (J).", survey.fly_to_point)
        imgui.same_line()
        button("Forget", "Forget the picked point.", lambda: survey.pick_at(None))
    imgui.separator_text("Profile")
    changed, _ = imgui.checkbox("Measure", survey.is_measuring)
    imgui.set_item_tooltip("Drag from one point to another instead of turning the view (M).")
    if changed:
        survey.toggle_measuring()
    profile = survey.profile
    if profile is None:
        told = "Drag over the ground, or mark both ends with I." if survey.is_measuring else "No line is measured yet."
        _draw_note(told)
        return
    imgui.same_line()
    button("Save CSV", "Save the profile as a table under a new name.", lambda: survey.save_profile(session.folder))
    imgui.same_line()
    button("Clear", "Take the line away.", survey.forget_line)
    _draw_profile(session, profile)
    figures_table("line", line_rows(profile), NAME_EM)


def point_rows(point: Point, coordinates: Coordinates) -> list[tuple[str, str]]:
    """A picked point, as (name, value with unit); what is not known is left out."""
    place, relief = point
    x, z = place.local_m
    rows = [("local", f"{x:,.1f} m E  {z:,.1f} m S")]
    if place.map_xy is not None:
        form, unit = (".6f", "°") if coordinates.is_geographic else (",.1f", f" {coordinates.map_unit}".rstrip())
        x, y = place.map_xy
        rows.append(("map", f"x {x:{form}}{unit}  y {y:{form}}{unit}"))
    if place.latlon_deg is not None:
        rows.append(("lat, lon", latlon(place.latlon_deg)))
    rows += [
        ("height", f"{relief.height_m:,.1f} m"),
        ("slope", f"{relief.slope_deg:.1f}°"),
        ("faces", wind(relief.aspect_deg)),
    ]
    return rows


def line_rows(profile: Profile) -> list[tuple[str, str]]:
    """A measured line, as (name, value with unit)."""
    up, down = profile.climb_m
    first, last = profile.height_m[0], profile.height_m[-1]
    rows = [("distance", metres(profile.length_m)), ("on the ground", metres(profile.surface_m))]
    if np.isfinite([first, last]).all():
        rows.append(("difference", f"{last - first:+,.1f} m"))
    return [*rows, ("up, down", f"{up:,.1f} m, {down:,.1f} m")]


def _draw_profile(session: Session, profile: Profile) -> None:
    """Height over distance; the place below the mouse is shown on the ground."""
    survey, em = session.survey, imgui.get_font_size()
    unit, scale = ("km", 1e-3) if profile.length_m >= 10_000.0 else ("m", 1.0)
    low, high = (float(end(profile.height_m)) for end in (np.fmin.reduce, np.fmax.reduce))
    if np.isnan(low):
        _draw_note("There is no ground between the points.")
        return
    flags = implot.Flags_.no_title | implot.Flags_.no_legend | implot.Flags_.no_menus | implot.Flags_.no_mouse_text
    if not implot.begin_plot("##Profile", (-1.0, PLOT_EM * em), flags):
        return
    implot.setup_axes(f"distance [{unit}]", "height [m]")
    room = max(0.08 * (high - low), 0.5)
    implot.setup_axes_limits(0.0, scale * profile.length_m, low - room, high + room, imgui.Cond_.always)
    distance = scale * profile.distance_m
    spec = implot.Spec(line_color=GROUND_COLOUR, line_weight=2.0, fill_color=GROUND_COLOUR, fill_alpha=0.3)
    implot.plot_shaded("##Ground", distance, profile.height_m, low - room, spec)
    implot.plot_line("##Line", distance, profile.height_m, spec)
    hovered = None
    if implot.is_plot_hovered():
        hovered = min(max(implot.get_plot_mouse_pos().x / scale, 0.0), profile.length_m)
        there_m = float(np.interp(hovered, profile.distance_m, profile.height_m))
        told = "no data" if np.isnan(there_m) else f"{there_m:,.1f} m high"
        imgui.set_tooltip(f"{metres(hovered)} along, {told}")
    survey.hover(hovered)
    if survey.hover_m is not None:
        spec = implot.Spec(line_color=ink(0.6))
        implot.plot_inf_lines("##Hovered", np.array([scale * survey.hover_m]), spec)
    implot.end_plot()


def _draw_note(text: str) -> None:
    imgui.push_text_wrap_pos(0.0)
    imgui.text_disabled(text)
    imgui.pop_text_wrap_pos()


def _copy(point: Point, coordinates: Coordinates) -> None:
    imgui.set_clipboard_text("\n".join(f"{name}: {value}" for name, value in point_rows(point, coordinates)))
