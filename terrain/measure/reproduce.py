"""The frame of every reproduction: a paper's tables measured on this machine, the paper's numbers beside ours.

Each algorithm keeps its own in ``terrain/measure/papers/<name>.py``: one function
``reproduce(gpu, folder, progress)`` that measures and returns a `Reproduction`. It is found by its name; what it
returns is written as JSON, CSV and pictures, and printed as text.
"""

from __future__ import annotations

import csv
import importlib
import importlib.util
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from terrain.errors import InputError
from terrain.gpu.context import Gpu
from terrain.measure.results import machine_identity, write_text
from terrain.renderers import RENDERERS

FORMAT, VERSION = "reliefscope-reproduction", 1

Cell = str | float | int | bool | None
Progress = Callable[[float, str], None]
"""Called with the share done (0..1) and what is being done."""


@dataclass(frozen=True)
class Table:
    """One table: ``columns`` name the cells of every row, units included; None is what was not measured."""

    name: str  # stem of its file: "table7"
    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"expected {len(self.columns)} cells in each row of {self.name}, found {len(row)}")


@dataclass(frozen=True)
class Plot:
    """One picture: points (x, y) of every series, ours and the paper's."""

    name: str
    title: str
    x_label: str
    y_label: str
    series: Mapping[str, Sequence[tuple[float, float]]]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Claim:
    """What the paper says, what was found here, and whether it held."""

    text: str
    paper: str
    ours: str
    held: bool


@dataclass(frozen=True)
class Reproduction:
    """What one ``reproduce`` function found."""

    tables: Sequence[Table]
    plots: Sequence[Plot] = ()
    claims: Sequence[Claim] = ()


def reproducible() -> list[str]:
    """Algorithms that have a reproduction."""
    return [name for name in RENDERERS if importlib.util.find_spec(_module(name)) is not None]


def reproduce(algorithm: str, gpu: Gpu, folder: Path, progress: Progress) -> tuple[Reproduction, list[Path]]:
    """Measure a paper's tables and write them.

    Returns
    -------
    Reproduction, list of Path
        What was found, and the files it was written to.

    Raises
    ------
    InputError
        If the algorithm has no reproduction, or the folder cannot be written.
    """
    if algorithm not in reproducible():
        raise InputError(f"Expected an algorithm of {', '.join(reproducible())}, found {algorithm!r}.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"Expected a folder to write to, found that {folder} cannot be made ({error}).") from None
    found: Reproduction = importlib.import_module(_module(algorithm)).reproduce(gpu, folder, progress)
    return found, write_reproduction(folder, algorithm, machine_identity(gpu), found)


def write_reproduction(folder: Path, algorithm: str, machine: Mapping[str, Any], found: Reproduction) -> list[Path]:
    """Write ``reproduction.json``, a CSV per table and a PNG and SVG per plot; returns their paths."""
    record = {
        "format": FORMAT,
        "version": VERSION,
        "algorithm": algorithm,
        "source": RENDERERS[algorithm].source,
        "machine": dict(machine),
        **asdict(found),
    }
    paths = [folder / "reproduction.json"]
    write_text(paths[0], json.dumps(record, indent=1) + "\n")
    for table in found.tables:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table.columns)
        writer.writerows(["" if cell is None else cell for cell in row] for row in table.rows)
        paths.append(folder / f"{table.name}.csv")
        write_text(paths[-1], text.getvalue())
    for plot in found.plots:
        paths += _write_plot(folder, plot)
    return paths


def format_table(table: Table) -> str:
    """A table as text, columns aligned."""
    cells = [list(table.columns), *([_text(cell) for cell in row] for row in table.rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    return "\n".join([table.title, *lines, *([table.note] if table.note else [])])


def _text(cell: Cell) -> str:
    if cell is None:
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return f"{cell:,.0f}" if abs(cell) >= 1000 else f"{cell:.4g}"
    return f"{cell:,}" if isinstance(cell, int) else cell


def _write_plot(folder: Path, plot: Plot) -> list[Path]:
    from matplotlib.figure import Figure  # 170 ms, and only plots need it

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    colours: dict[str, str] = {}  # the paper's line and ours share one
    for name, points in plot.series.items():
        x, y = zip(*points, strict=True)
        is_paper = name.startswith("paper, ") or name.endswith(" (paper)")
        colour = colours.setdefault(name.removesuffix(" (paper)"), f"C{len(colours)}")
        axes.plot(x, y, color=colour, marker="o", markersize=4, linestyle="--" if is_paper else "-", label=name)
    if plot.log_x:
        axes.set_xscale("log", base=2)
        axes.set_xticks(sorted({x for points in plot.series.values() for x, _ in points}))
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_formatter(lambda *_: "")
    if plot.log_y:
        axes.set_yscale("log")
        for formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            formatter(_one_two_five)
    axes.set_title(plot.title, fontsize=10, loc="left")
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)
    axes.grid(True, color="#e8e8e8", linewidth=0.6)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    paths = []
    for suffix in ("png", "svg"):
        paths.append(folder / f"{plot.name}.{suffix}")
        figure.savefig(paths[-1], dpi=150)
    return paths


def _one_two_five(value: float, _: float) -> str:
    """Labels of a logarithmic axis: few enough to be read, and no powers of ten to be multiplied."""
    return f"{value:g}" if f"{value:e}"[0] in "125" else ""


def _module(algorithm: str) -> str:
    return f"terrain.measure.papers.{algorithm}"
