"""What the colours of each view mean, as swatches and words.

The colours are those of the shaders (``lib/debug.glsl``, ``view_overdraw.frag``, ``view_error.frag``); a test draws
both and compares. All debug views use colours that colour-blind eyes tell apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from app.session.session import Session
from terrain.heightfield import Heightfield
from terrain.textures.palettes import STEPS, read_palette

Rgb = tuple[float, float, float]

LEVEL_HUES: tuple[Rgb, ...] = (  # Okabe and Ito (2008)
    (0.00, 0.45, 0.70), (0.90, 0.62, 0.00), (0.00, 0.62, 0.45), (0.80, 0.47, 0.65),
    (0.34, 0.71, 0.91), (0.84, 0.37, 0.00), (0.94, 0.89, 0.26), (0.60, 0.60, 0.60),
)  # fmt: skip
HEAT: tuple[Rgb, ...] = ((0.05, 0.03, 0.53), (0.61, 0.09, 0.62), (0.93, 0.47, 0.33), (0.94, 0.98, 0.13))
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16)
ABOVE, BELOW, NONE = (0.84, 0.37, 0.0), (0.0, 0.45, 0.70), (0.97, 0.97, 0.97)
TINT_STOPS = 5


class Legend(NamedTuple):
    """Swatches from left to right, each with a few letters below it, and a title in words."""

    title: str
    colours: tuple[Rgb, ...]
    labels: tuple[str, ...]


def legend_of(session: Session) -> Legend | None:
    """What the colours of the picture on the screen mean; None where they mean nothing that words could say better."""
    view = session.view
    if view == "overdraw":
        return Legend("times drawn", tuple(map(heat, COUNTS)), (*map(str, COUNTS[:-1]), f"{COUNTS[-1]}+"))
    if view in ("levels", "boxes"):
        return Legend("level, 0 is the finest; colours repeat", LEVEL_HUES, tuple(map(str, range(8))))
    if view == "error":
        return _error_legend(session.settings.tolerance_px)
    if view == "normals":
        directions = {"up": (0, 1, 0), "east": (1, 0, 0), "north": (0, 0, -1), "west": (-1, 0, 0), "south": (0, 0, 1)}
        return Legend("the surface faces", tuple(map(normal_colour, directions.values())), tuple(directions))
    theme = session.layers.legend
    if theme is not None:
        title = f"{theme.title} [{theme.unit}]" if theme.unit else theme.title
        colours = tuple(_mixed(*(channel / 255.0 for channel in swatch.colour)) for swatch in theme.swatches)
        return Legend(title, colours, tuple(swatch.label for swatch in theme.swatches))
    look = session.stage.look
    return _tint_legend(session.heightfield, look.palette)


def heat(count: float) -> Rgb:
    """The colour of a pixel drawn ``count`` times."""
    at = 3.0 * min(np.log2(max(count, 1.0)) / 4.0, 1.0)
    return _mixed(*(float(np.interp(at, range(4), [colour[i] for colour in HEAT])) for i in range(3)))


def error_colour(share: float) -> Rgb:
    """The colour of an error of ``share`` times the tolerance, positive above the true surface."""
    hue, size = (ABOVE if share > 0.0 else BELOW), abs(share)
    dark = 1.0 - 0.75 * min(max(size - 1.0, 0.0), 1.0)
    return _mixed(*(((1.0 - min(size, 1.0)) * NONE[i] + min(size, 1.0) * hue[i]) * dark for i in range(3)))


def normal_colour(normal: tuple[float, float, float]) -> Rgb:
    """The colour of a surface whose unit normal is (x east, y up, z south)."""
    x, y, z = normal
    return _mixed(0.5 + 0.5 * x, 0.5 - 0.5 * z, 0.5 + 0.5 * y)


def _error_legend(tolerance_px: float) -> Legend:
    shares = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
    labels = tuple(f"{share * tolerance_px:+.3g}" if share else "0" for share in shares)
    return Legend("error [px]: minus below the true surface", tuple(map(error_colour, shares)), labels)


def _tint_legend(heightfield: Heightfield, name: str) -> Legend:
    """Tints of gentle ground at heights from the lowest to the highest, without exaggeration."""
    palette = read_palette(name)
    low, high = (height / heightfield.exaggeration for height in heightfield.height_range_m)
    span = max(high - low, palette.least_relief_m, 1e-3)
    heights = np.linspace(low, high, TINT_STOPS)
    rows = np.rint((heights - low) / span * (STEPS - 1)).astype(int)
    colours = tuple(_mixed(*(palette.colours[0, row] / 255.0)) for row in rows)
    return Legend("height [m]", colours, tuple(f"{height:,.0f}" for height in heights))


def _mixed(red: float, green: float, blue: float) -> Rgb:
    return float(red), float(green), float(blue)
