"""The report of a sweep: one self-contained HTML page with charts, table, thumbnails and how to repeat it."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.camera import Camera
from terrain.measure.accuracy import AccuracyMeter, drawn_by
from terrain.measure.chart import is_promise_kept, style, title
from terrain.measure.results import write_text
from terrain.measure.sweep import Run
from terrain.renderers import RENDERERS
from terrain.stage import Stage

THUMBNAIL_PX = (480, 270)

_COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("frame p50 [ms]", "frame_ms.p50", ".1f"), ("p95", "frame_ms.p95", ".1f"), ("p99", "frame_ms.p99", ".1f"),
    ("select [ms]", "select_ms.p50", ".2f"), ("GPU [ms]", "gpu_ms.p50", ".2f"),
    ("triangles", "triangles", ",.0f"), ("slices", "slices", ",.0f"), ("ray steps", "ray_steps", ",.1f"),
    ("draws", "draw_calls", ".0f"), ("overdraw", "overdraw.mean", ".2f"), ("uploaded [kB]", "uploaded_bytes", "kB"),
    ("error mean [px]", "geometric_error_px.mean", ".3f"), ("p99", "geometric_error_px.p99", ".3f"),
    ("p99.9", "geometric_error_px.p999", ".3f"), ("max", "geometric_error_px.max", ".2f"),
    ("holes [px]", "holes_px", ".0f"), ("silhouette max [px]", "silhouette_px.max", ".0f"), ("FLIP", "flip", ".4f"),
    ("PSNR [dB]", "psnr_db", ".1f"), ("popping p99 [px]", "popping_px.p99", ".2f"), ("prepare [s]", "prepare_s", ".2f"),
)  # fmt: skip

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:1180px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin-bottom:.1em}h2{font-size:1.1em;margin-top:2em}
table{border-collapse:collapse;font-size:12px;width:100%}
th,td{border-bottom:1px solid #ddd;padding:.25em .5em;text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}.wide{overflow-x:auto}.broken{color:#d55e00;font-weight:600}
figure{display:inline-block;margin:.4em}figcaption{font-size:12px}img,svg{max-width:100%;height:auto}
code{background:#f3f3f3;padding:.15em .4em;border-radius:3px}p.small{font-size:12px;color:#666}
"""


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """A run's picture and its error heat map, (height, width, 3) uint8 each."""

    label: str
    picture: npt.NDArray[np.uint8]
    error: npt.NDArray[np.uint8]


def draw_thumbnails(stage: Stage, runs: Sequence[Run], camera: Camera) -> list[Thumbnail]:
    """One view by every run, with the error it makes there."""
    meter = AccuracyMeter(stage, THUMBNAIL_PX)
    thumbnails = []
    for run in runs:
        renderer = RENDERERS[run.algorithm](stage.gpu, stage.scene, run.settings)
        with drawn_by(stage, renderer):
            picture = stage.render(camera, THUMBNAIL_PX)
        thumbnails.append(Thumbnail(run.label, picture, meter.render_error(renderer, camera)))
        renderer.release()
    meter.release()
    return thumbnails


def write_report(
    folder: Path, results: Mapping[str, Any], charts: Sequence[Path], thumbnails: Sequence[Thumbnail], command: str
) -> Path:
    """Write ``report.html``; ``charts`` are SVG files that are taken in."""
    machine, scene, flight = results["machine"], results["terrain"], results["flight"]
    width, height = results["viewport"]
    drawings = "\n".join(_inline_svg(chart) for chart in charts)
    gallery = "\n".join(
        f"<figure><img alt='' src='{_png(t.picture)}'> <img alt='' src='{_png(t.error)}'>"
        f"<figcaption>{html.escape(t.label)}: picture, and error against the reference (white none, full colour at the "
        f"tolerance, darker beyond; red above, blue below)</figcaption></figure>"
        for t in thumbnails
    )
    low, high = scene["height_m"]
    page = f"""<!doctype html><html lang="en"><head><meta charset="utf-8">
<title>Reliefscope: {html.escape(scene["name"])}</title><style>{_STYLE}</style></head><body>
<h1>Speed against measured accuracy</h1>
<p>{html.escape(scene["name"])}: {scene["rows"]} × {scene["cols"]} posts, {scene["spacing_m"][0]:g} × \
{scene["spacing_m"][1]:g} m apart, heights {low:,.0f} to {high:,.0f} m.
{flight["frames"]} frames of “{html.escape(flight["name"])}” at {width} × {height} pixels.</p>
{drawings}
<h2>Measured</h2><div class="wide">{_table(results["runs"])}</div>
<p class="small">Error: distance of the drawn surface to the reference surface, projected to the screen, over all
covered pixels of all frames. A promise is kept where 99.9 % of the pixels err by no more than the tolerance. What was
not measured is left blank.</p>
<h2>Seen</h2>{gallery}
<h2>Repeat it</h2><p><code>{html.escape(command)}</code></p>
<p class="small">{html.escape(machine["renderer"])}; OpenGL {html.escape(machine["gl"])}; \
{html.escape(machine["cpu"])}, {machine["cores"]} cores; Python {machine["python"]}; Reliefscope \
{machine["reliefscope"]}. Terrain sha256 {scene["sha256"][:16]}…</p></body></html>
"""
    path = folder / "report.html"
    write_text(path, page)
    return path


def _table(runs: Sequence[Mapping[str, Any]]) -> str:
    used = [column for column in _COLUMNS if any(_lookup(run, column[1]) is not None for run in runs)]
    head = "".join(f"<th>{html.escape(name)}</th>" for name, _, _ in used)
    rows = []
    for run in runs:
        colour, _ = style(run["algorithm"])
        settings = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in run["settings"].items())
        label = (
            f"<span style='color:{colour}'>●</span> {html.escape(title(run['algorithm']))} · {html.escape(settings)}"
        )
        cells = "".join(f"<td>{_format(_lookup(run, key), form)}</td>" for _, key, form in used)
        promise = "<td></td>"
        if "geometric_error_px" in run:
            promise = "<td>kept</td>" if is_promise_kept(run) else "<td class='broken'>broken</td>"
        rows.append(f"<tr><td>{label}</td>{cells}{promise}</tr>")
    return f"<table><tr><th>run</th>{head}<th>promise</th></tr>{''.join(rows)}</table>"


def _lookup(run: Mapping[str, Any], key: str) -> float | None:
    value: Any = run
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def _format(value: float | None, form: str) -> str:
    if value is None:
        return ""
    return f"{value / 1e3:,.1f}" if form == "kB" else format(value, form)


def _inline_svg(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return text[text.index("<svg") :]


def _png(picture: npt.NDArray[np.uint8]) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
