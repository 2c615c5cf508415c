"""Elevation tints: small tables in ``assets/palettes``, one file each.

A palette holds colour stops by relative height for gentle ground and, where the look asks for it, others for steep
ground; the bake blends between the two by slope. ``least_relief_m`` keeps low hills from wearing snow: where a terrain
has less relief, only the lower part of the palette is used.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

FOLDER = Path(__file__).resolve().parents[2] / "assets" / "palettes"
PALETTES: tuple[str, ...] = ("natural", "desert", "atlas", "cividis", "plaster")
STEPS = 256


@dataclass(frozen=True, eq=False)
class Palette:
    """Tints by relative height.

    Attributes
    ----------
    title, help : str
    least_relief_m : float
        Relief [m] that spans the whole palette at least.
    colours : ndarray of uint8, (2, STEPS, 3)
        sRGB; row 0 gentle ground, row 1 steep ground, lowest height first.
    """

    title: str
    help: str
    least_relief_m: float
    colours: npt.NDArray[np.uint8]


@cache
def read_palette(name: str) -> Palette:
    """One of `PALETTES`."""
    entry = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    rows = [_ramp(entry["gentle"]), _ramp(entry.get("steep", entry["gentle"]))]
    return Palette(entry["title"], entry["help"], float(entry["least_relief_m"]), np.stack(rows))


def _ramp(stops: list[tuple[float, str]]) -> npt.NDArray[np.uint8]:
    """(STEPS, 3) colours, linear between stops ``[position, "#rrggbb"]``."""
    position = [at for at, _ in stops]
    colour = np.array([list(bytes.fromhex(text.lstrip("#"))) for _, text in stops], np.float64)
    t = np.linspace(0.0, 1.0, STEPS)
    return np.stack([np.interp(t, position, channel) for channel in colour.T], axis=1).round().astype(np.uint8)
