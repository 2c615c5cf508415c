"""The results file: what was measured, of what, on what machine. JSON, and the same rows as CSV."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import terrain
from terrain.errors import InputError
from terrain.gpu.context import Gpu
from terrain.heightfield import Heightfield

FORMAT, VERSION = "reliefscope-results", 1


def machine_identity(gpu: Gpu) -> dict[str, Any]:
    """Who measured: driver, processor, versions."""
    return {
        "renderer": gpu.name,
        "gl": gpu.version,
        "cpu": _processor(),
        "cores": os.cpu_count() or 1,
        "python": platform.python_version(),
        "reliefscope": terrain.__version__,
    }


def terrain_identity(heightfield: Heightfield) -> dict[str, Any]:
    """What was drawn: its content's hash, size, spacing and range of heights."""
    return {
        "name": heightfield.name,
        "sha256": heightfield.sha256,
        "rows": heightfield.rows,
        "cols": heightfield.cols,
        "spacing_m": list(map(float, heightfield.spacing_m)),
        "height_m": list(heightfield.height_range_m),
    }


def settings_record(settings: Any) -> dict[str, Any]:
    """The settings that differ from the defaults, and the tolerance."""
    defaults = asdict(type(settings)())
    return {k: v for k, v in asdict(settings).items() if k == "tolerance_px" or v != defaults[k]}


def make_results(
    machine: Mapping[str, Any], scene: Mapping[str, Any], viewport_px: tuple[int, int], flight: Mapping[str, Any],
    runs: list[dict[str, Any]],
) -> dict[str, Any]:  # fmt: skip
    """The whole results file as a dictionary."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "machine": dict(machine),
        "terrain": dict(scene),
        "viewport": list(viewport_px),
        "flight": dict(flight),
        "runs": runs,
    }


def write_results(folder: Path, results: Mapping[str, Any]) -> tuple[Path, Path]:
    """Write ``results.json`` and ``results.csv``, each under a temporary name first; an earlier pair is replaced."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [flatten_run(run) for run in results["runs"]]
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = io.StringIO()
    writer = csv.DictWriter(table, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    paths = folder / "results.json", folder / "results.csv"
    write_text(paths[0], json.dumps(results, indent=1) + "\n")
    write_text(paths[1], table.getvalue())
    return paths


def read_results(path: Path) -> dict[str, Any]:
    """Read a results file.

    Raises
    ------
    InputError
        If it cannot be read or is no results file of this version.
    """
    try:
        results = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"Expected a results file at {path}, could not read one ({error}).") from None
    if not isinstance(results, dict) or results.get("format") != FORMAT or results.get("version") != VERSION:
        raise InputError(f"Expected {FORMAT} version {VERSION} in {path}, found something else. Measure again.")
    return results


def flatten_run(run: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """One run as a flat row: ``frame_ms.p50``, ``settings.tolerance_px`` ..."""
    row: dict[str, Any] = {}
    for key, value in run.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            row |= flatten_run(value, f"{name}.")
        elif isinstance(value, list):
            row |= {f"{name}.{i}": item for i, item in enumerate(value)}
        else:
            row[name] = value
    return row


def write_text(path: Path, text: str) -> None:
    """Write a file under a temporary name, then rename it."""
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8", suffix=".part") as file:
        file.write(text)
    try:
        Path(file.name).chmod(0o644)
        Path(file.name).replace(path)
    except OSError:
        Path(file.name).unlink(missing_ok=True)
        raise


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
