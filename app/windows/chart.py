"""The laboratory's chart, drawn with ImPlot: measured runs, their Pareto front, and the current state as a moving dot.

A hollow point broke its promise, as in the charts on paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from imgui_bundle import imgui, implot

from app.session.laboratory import run_point
from app.session.session import Session
from app.windows.theme import Colour, ink, is_light
from terrain.measure.chart import is_promise_kept, pareto_front, style
from terrain.renderers import RENDERERS

CHART_EM = 14.5
CLICK_PX = 12.0  # how near to a point of the chart a click must be
SMALLEST_PX = 0.01  # less is drawn there: nobody sees it
GREY: Colour = (0.6, 0.6, 0.6, 1.0)


def draw_chart(session: Session) -> None:
    """Cost across, error up, both logarithmic; the current state moves as a dot with its trail."""
    lab, em = session.laboratory, imgui.get_font_size()
    runs = [run for run in lab.runs if lab.chosen.get(run["algorithm"], True)]
    points = [_shown(*run_point(run)) for run in runs]
    flags = implot.Flags_.no_title | implot.Flags_.no_legend | implot.Flags_.no_menus | implot.Flags_.no_mouse_text
    if not implot.begin_plot("##Chart", (-1.0, CHART_EM * em), flags):
        return
    implot.setup_axes("frame time [ms]", "error, 99.9 % below [px]")
    for axis in (implot.ImAxis_.x1, implot.ImAxis_.y1):
        implot.setup_axis_scale(axis, implot.Scale_.log10)
    (x0, x1), (y0, y1) = _limits([*points, *(_shown(*p) for p in lab.trail)])
    implot.setup_axes_limits(x0, x1, y0, y1, imgui.Cond_.always)
    for axis, low, high in ((implot.ImAxis_.x1, x0, x1), (implot.ImAxis_.y1, y0, y1)):
        ticks = _ticks(low, high)
        implot.setup_axis_ticks(axis, ticks, [f"{tick:g}" for tick in ticks], False)
    front = pareto_front([p for run, p in zip(runs, points, strict=True) if run["algorithm"] != "reference"])
    _plot("##Front", front, implot.Spec(line_color=(*GREY[:3], 0.5), line_weight=5.0))
    paper = imgui.get_style_color_vec4(imgui.Col_.window_bg)
    for name in RENDERERS:
        own = [(run, p) for run, p in zip(runs, points, strict=True) if run["algorithm"] == name]
        own.sort(key=lambda pair: pair[0]["settings"].get("tolerance_px", 0.0))
        colour = colour_of(name)
        _plot(f"##{name} line", [p for _, p in own], implot.Spec(line_color=colour, line_weight=1.5))
        for kept in (True, False):
            fill = colour if kept else (paper.x, paper.y, paper.z, 1.0)
            spec = implot.Spec(
                marker=implot.Marker_.circle, marker_size=4.5, marker_line_color=colour, marker_fill_color=fill
            )
            _plot(f"##{name} {kept}", [p for run, p in own if is_promise_kept(run) == kept], spec, implot.plot_scatter)
    trail = [_shown(*point) for point in lab.trail]
    _plot("##Trail", trail, implot.Spec(line_color=ink(0.45)))
    now = implot.Spec(marker=implot.Marker_.diamond, marker_size=6.0, marker_line_color=ink(), marker_fill_color=ink())
    _plot("##Now", trail[-1:], now, implot.plot_scatter)
    if implot.is_plot_hovered() and runs:
        _point_at_mouse(session, runs, points)
    implot.end_plot()


def _point_at_mouse(session: Session, runs: Sequence[Any], points: Sequence[tuple[float, float]]) -> None:
    """Name the point of the chart below the mouse; a click draws with it."""
    mouse = imgui.get_io().mouse_pos
    places = [implot.plot_to_pixels(implot.Point(*point)) for point in points]
    distance = [math.hypot(place.x - mouse.x, place.y - mouse.y) for place in places]
    nearest = int(np.argmin(distance))
    if distance[nearest] > CLICK_PX:
        return
    run, (ms, px) = runs[nearest], run_point(runs[nearest])
    title = RENDERERS[run["algorithm"]].title
    imgui.set_tooltip(
        f"{title}, tolerance {run['settings']['tolerance_px']:g} px\n{ms:.1f} ms, {px:.3g} px; click: use"
    )
    if imgui.is_mouse_clicked(0):
        session.laboratory.choose_run(run)


def colour_of(algorithm: str) -> Colour:
    """The algorithm's colour of the charts, light enough for dark windows and dark enough for light ones.

    The reference's black becomes grey.
    """
    if algorithm == "reference":
        return GREY
    text = style(algorithm)[0].lstrip("#")
    base, share = (0.0, 0.8) if is_light() else (0.3, 0.7)
    red, green, blue = (base + share * int(text[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return red, green, blue, 1.0


def _shown(ms: float, px: float) -> tuple[float, float]:
    """A point as the chart shows it: no logarithm of nothing."""
    return max(ms, 1e-2), max(px, SMALLEST_PX)


def _limits(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges (low, high) of both axes that hold all points with room to spare."""
    low = np.array(points or [(5.0, 0.25)]).min(axis=0)
    high = np.array(points or [(100.0, 8.0)]).max(axis=0)
    middle, reach = np.sqrt(low * high), np.maximum(np.sqrt(high / low) * 1.4, 3.0)
    (x0, y0), (x1, y1) = middle / reach, middle * reach
    return (float(x0), float(x1)), (float(y0), float(y1))


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers on a logarithmic axis: 1, 2, 5, 10 ..., or powers of ten where those are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)
    return [tick for decade in decades for step in steps if low <= (tick := step * 10.0**decade) <= high]


def _plot(
    label: str, points: Sequence[tuple[float, float]], spec: implot.Spec, plot: Callable[..., None] = implot.plot_line
) -> None:
    if points:
        x, y = np.array(points, np.float64).T
        plot(label, np.ascontiguousarray(x), np.ascontiguousarray(y), spec)
