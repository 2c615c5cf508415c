"""Speed against accuracy in one picture, from a results file: cost across, measured error up, a line per algorithm.

Log-log; points are labelled by tolerance, bars span the medians of the repeats, a hollow point broke its promise
(p99.9 above the tolerance), the grey line is the Pareto front over all algorithms, the dashed one the reference's cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain.renderers import RENDERERS

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# Colours that stay apart for colour-blind eyes (Okabe and Ito, 2008), in the order of the renderers' table.
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = "sovD^P*"
INK, FAINT = "#222222", "#999999"
SMALLEST_ERROR_PX = 1e-3  # what is measured as less is drawn there: rounding, not error

Point = tuple[float, float]


def write_chart(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write ``chart`` and ``multiples`` of a results dictionary as PNG and SVG; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for stem, draw in (("chart", draw_chart), ("multiples", draw_multiples)):
        figure = draw(results)
        for suffix in ("png", "svg"):
            path = folder / f"{stem}.{suffix}"
            temporary = path.with_suffix(f".part.{suffix}")
            figure.savefig(temporary, dpi=150)
            temporary.replace(path)
            paths.append(path)
    return paths


def draw_chart(results: Mapping[str, Any]) -> Figure:
    """The chart: median frame time [ms] against the 99.9th percentile of the geometric error [px]."""
    figure = _figure((9.0, 6.0))
    axes = figure.add_subplot()
    runs = [run for run in results["runs"] if "frame_ms" in run and "geometric_error_px" in run]
    front = pareto_front([_point(run) for run in runs if run["algorithm"] != "reference"])
    if len(front) > 1:
        axes.plot(*zip(*front, strict=True), color=FAINT, linewidth=5, alpha=0.35, zorder=1, label="Pareto front")
    for name, group in _by_algorithm(runs).items():
        if name == "reference":
            ms = group[0]["frame_ms"]["p50"]
            axes.axvline(ms, color=INK, linestyle="--", linewidth=1)
            axes.text(ms, 0.99, "reference ", transform=axes.get_xaxis_transform(), ha="right", va="top", color=INK)
            continue
        colour, marker = style(name)
        points = [_point(run) for run in group]
        spread = [run["frame_ms"].get("spread", [run["frame_ms"]["p50"]] * 2) for run in group]
        bars = [
            [max(p[0] - s[0], 0) for p, s in zip(points, spread, strict=True)],
            [max(s[1] - p[0], 0) for p, s in zip(points, spread, strict=True)],
        ]
        x, y = zip(*points, strict=True)
        axes.errorbar(x, y, xerr=bars, color=colour, linewidth=1.6, elinewidth=1, capsize=2, zorder=2)
        for run, point in zip(group, points, strict=True):
            face = colour if is_promise_kept(run) else "white"
            axes.plot(*point, marker=marker, color=colour, markerfacecolor=face, markersize=8, zorder=3)
            axes.annotate(
                f"{run['settings'].get('tolerance_px', 0):g}", point, textcoords="offset points", xytext=(6, 5),
                fontsize=8, color=colour,
            )  # fmt: skip
        axes.plot([], [], color=colour, marker=marker, label=title(name))
    axes.set_xscale("log")
    axes.set_yscale("log")
    _plain_ticks(axes.xaxis)
    _plain_ticks(axes.yaxis)
    axes.set_xlabel("frame time, median [ms]")
    axes.set_ylabel("geometric error, 99.9 % of pixels below [px]")
    axes.set_title(_caption(results), fontsize=10, loc="left")
    axes.grid(True, which="both", color="#e8e8e8", linewidth=0.6, zorder=0)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=True, title="labels: tolerance [px]; hollow: promise broken", title_fontsize=8)
    figure.text(0.995, 0.005, _machine(results), ha="right", va="bottom", fontsize=6.5, color=FAINT)
    return figure


def draw_multiples(results: Mapping[str, Any]) -> Figure:
    """Triangles, overdraw, popping and frame time against the tolerance, small multiples."""
    panels: list[tuple[str, Callable[[Mapping[str, Any]], float | None], bool]] = [
        ("triangles", lambda run: run.get("triangles"), True),
        ("overdraw, mean", lambda run: run.get("overdraw", {}).get("mean"), False),
        ("popping, 99 % below [px]", lambda run: run.get("popping_px", {}).get("p99"), True),
        ("frame time, median [ms]", lambda run: run.get("frame_ms", {}).get("p50"), True),
    ]
    figure = _figure((11.0, 3.2))
    groups = {n: g for n, g in _by_algorithm(results["runs"]).items() if n != "reference"}
    reference = next((run for run in results["runs"] if run["algorithm"] == "reference"), None)
    for number, (label, read, is_log) in enumerate(panels, 1):
        axes = figure.add_subplot(1, len(panels), number)
        for name, group in groups.items():
            pairs = [(run["settings"].get("tolerance_px"), read(run)) for run in group]
            known = [(t, v) for t, v in pairs if t is not None and v is not None and (v > 0 or not is_log)]
            if known:
                colour, marker = style(name)
                axes.plot(*zip(*known, strict=True), color=colour, marker=marker, markersize=4, label=title(name))
        level = read(reference) if reference else None
        if level is not None and (level > 0 or not is_log) and "popping" not in label:
            axes.axhline(level, color=INK, linestyle="--", linewidth=1, label="Reference")
        axes.set_xscale("log", base=2)
        if is_log:
            axes.set_yscale("log")
            _plain_ticks(axes.yaxis)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_title(label, fontsize=9)
        axes.set_xlabel("tolerance [px]", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(True, color="#e8e8e8", linewidth=0.6)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    return figure


def pareto_front(points: Sequence[Point]) -> list[Point]:
    """Points (cost, error) that no other point beats in both, by rising cost."""
    front: list[Point] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def is_promise_kept(run: Mapping[str, Any]) -> bool:
    """Whether 99.9 % of the pixels err by no more than the declared tolerance."""
    tolerance = run["settings"].get("tolerance_px")
    return tolerance is None or run["geometric_error_px"]["p999"] <= tolerance


def style(algorithm: str) -> tuple[str, str]:
    """Colour and marker of an algorithm, the same in every picture."""
    index = list(RENDERERS).index(algorithm) if algorithm in RENDERERS else len(RENDERERS)
    return COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)]


def title(algorithm: str) -> str:
    """What to call an algorithm in pictures and tables."""
    return RENDERERS[algorithm].title if algorithm in RENDERERS else algorithm


def _figure(size: tuple[float, float]) -> Figure:
    from matplotlib.figure import Figure  # 170 ms, and only charts need it

    return Figure(figsize=size, layout="constrained")


def _point(run: Mapping[str, Any]) -> Point:
    return run["frame_ms"]["p50"], max(run["geometric_error_px"]["p999"], SMALLEST_ERROR_PX)


def _by_algorithm(runs: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for run in runs:
        groups.setdefault(run["algorithm"], []).append(run)
    for group in groups.values():
        group.sort(key=lambda run: run["settings"].get("tolerance_px", 0.0))
    return groups


def _plain_ticks(axis: Axis) -> None:
    """Numbers instead of powers on a logarithmic axis, as many as fit."""
    from matplotlib.ticker import LogLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 500 * low else (1.0,)))
    axis.set_major_formatter(lambda value, _: f"{value:,.0f}" if value >= 10 else f"{value:g}")
    axis.set_minor_formatter(lambda value, _: "")


def _caption(results: Mapping[str, Any]) -> str:
    scene, (width, height), flight = results["terrain"], results["viewport"], results["flight"]
    relief = math.ceil(scene["height_m"][1] - scene["height_m"][0])
    return (
        f"{scene['name']}: {scene['rows']} x {scene['cols']} posts, {relief:,} m of relief; "
        f"{flight['frames']} frames of “{flight['name']}” at {width} x {height}"
    )


def _machine(results: Mapping[str, Any]) -> str:
    machine = results["machine"]
    return f"{machine['renderer']}, {machine['cpu']} ({machine['cores']} cores), Reliefscope {machine['reliefscope']}"
