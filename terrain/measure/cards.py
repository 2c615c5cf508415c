"""What the stability check leaves behind: a card for every case that is not all right, and a table of all.

A card is a flight file that holds the cameras of the case, the scene it was flown over, and a picture of its worst
frame: reference, test and error heat map side by side. ``reliefscope render SCENE --flight CARD`` flies it again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from terrain.files.geotiff import write_geotiff
from terrain.flight import Flight, Keyframe, write_flight
from terrain.measure.hostile import FRAME_S
from terrain.measure.results import write_text
from terrain.measure.stability import SIZE_PX, Checker, Verdict

FORMAT, VERSION = "reliefscope-check", 1


def write_card(folder: Path, verdict: Verdict, checker: Checker) -> list[Path]:
    """Write the flight, the scene (once) and the picture of a verdict; returns their paths."""
    from PIL import Image

    terrain = checker.stage.scene.heightfield
    scene = folder / "scenes" / f"{_file_name(verdict.scene)}.tif"
    scene.parent.mkdir(parents=True, exist_ok=True)
    if not scene.exists():
        write_geotiff(terrain, scene)
    stem = _file_name(f"{verdict.algorithm} {verdict.scene} {verdict.case}")
    flight, picture = folder / f"{stem}.flight.json", folder / f"{stem}.png"
    keys = tuple(Keyframe(i * FRAME_S, camera) for i, camera in enumerate(verdict.path))
    write_flight(Flight(keys, f"{verdict.case}: {'; '.join(verdict.complaints)}", terrain.name), flight, overwrite=True)
    paths = [flight, scene]
    drawn = checker.picture(verdict)
    if drawn is not None:
        Image.fromarray(drawn).save(picture)
        paths.append(picture)
    return paths


def replay_command(folder: Path, verdict: Verdict) -> str:
    """The command that draws the worst frame of a card again."""
    stem = _file_name(f"{verdict.algorithm} {verdict.scene} {verdict.case}")
    scene = folder / "scenes" / f"{_file_name(verdict.scene)}.tif"
    return (
        f"reliefscope render {scene} --flight {folder / stem}.flight.json --at {verdict.worst * FRAME_S:.4f}"
        f" --algorithm {verdict.algorithm} --size {SIZE_PX[0]}x{SIZE_PX[1]} --out {stem}-again.png"
    )


def write_verdicts(folder: Path, machine: Mapping[str, Any], verdicts: Sequence[Verdict]) -> Path:
    """Write ``check.json``: every case with its figures, complaints and limits."""
    cases = [
        {
            "algorithm": v.algorithm,
            "scene": v.scene,
            "case": v.case,
            "outcome": v.outcome,
            **v.figures,
            "complaints": list(v.complaints),
            **({"limit": v.limit} if v.limit else {}),
            "worst_frame": v.worst,
        }
        for v in verdicts
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "check.json"
    record = {"format": FORMAT, "version": VERSION, "machine": dict(machine), "cases": cases}
    write_text(path, json.dumps(record, indent=1) + "\n")
    return path


def _file_name(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower()).strip("-")
