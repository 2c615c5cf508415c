"""Thematic layers made from the terrain itself: rasters of colours, each with the legend that reads it.

Every theme is one entry in `THEMES`. Its colours stay apart for colour-blind eyes: ramps rise or fall steadily in
lightness, classes differ in lightness or along blue and yellow. Ground without data is transparent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.textures.relief import (
    aspect_deg,
    curvature_per_m,
    drained_area_m2,
    shapes,
    slope_deg,
    smoothed,
    standing_water,
)

Pixels = npt.NDArray[np.uint8]
Colours = npt.NDArray[np.uint8]

STEPS = 256
STEEPEST_DEG = 60.0  # from here on slopes share the last colour
SMOOTHING_POSTS = 1.5  # before curvature is taken: ridges and hollows, not single posts
FLAT_DEG = 2.0  # below, where a slope faces says nothing
DRAINAGE_POSTS = 1537  # per side at most: where drainage is found; a layer's texels stay below a kilometre anywhere
LEAST_SPRING_CELLS = 30.0  # drain into a river before it shows
LEAST_RELIEF_M = 1200.0  # low hills wear no snow: as in the palette of elevation tints


class Swatch(NamedTuple):
    """One colour of a legend, sRGB 0..255, and what it means."""

    colour: tuple[int, int, int]
    label: str


@dataclass(frozen=True)
class Legend:
    """How to read a theme.

    Attributes
    ----------
    title, unit : str
    swatches : tuple of Swatch
        Classes; or, of a ramp, colours at equal steps from its first to its last end, labelled where a label is due.
    is_ramp : bool
    """

    title: str
    unit: str
    swatches: tuple[Swatch, ...]
    is_ramp: bool


@dataclass(frozen=True, eq=False)
class Theme:
    """A raster of colours over the whole terrain.

    Attributes
    ----------
    name : str
        A key of `THEMES`.
    pixels : ndarray of uint8, (rows, cols, 4)
        RGBA, sRGB, row 0 north; one texel stands for the area around one post, or around several.
    legend : Legend
    """

    name: str
    pixels: Pixels
    legend: Legend


class ThemeKind(NamedTuple):
    """What a theme is called, one sentence about it, how it is made, and its largest width and height in texels."""

    title: str
    help: str
    make: Callable[[Heightfield], tuple[Pixels, Legend]]
    most_texels: int = 1 << 30

    def size_px(self, heightfield: Heightfield) -> tuple[int, int]:
        """(width, height) of the raster."""
        return min(heightfield.cols, self.most_texels), min(heightfield.rows, self.most_texels)


def make_theme(name: str, heightfield: Heightfield) -> Theme:
    """One of `THEMES` for a terrain; its true heights count, not the exaggerated ones.

    Raises
    ------
    InputError
        If there is no theme of that name.
    """
    if name not in THEMES:
        raise InputError(f"Expected a theme of {', '.join(THEMES)}, found {name!r}.")
    return Theme(name, *THEMES[name].make(heightfield))


def _make_slope(heightfield: Heightfield) -> tuple[Pixels, Legend]:
    ramp = _ramp("#fdf6d8", "#f6c96b", "#e08b3e", "#b04a3a", "#6b1f4a", "#260b33")
    pixels = _blank(heightfield)
    for rows, shape in shapes(heightfield):
        pixels[rows] = _shade(ramp, slope_deg(shape) / STEEPEST_DEG)
    labels = [f"{degrees:.0f}" for degrees in np.linspace(0.0, STEEPEST_DEG, 5)]
    labels[-1] += "+"
    return _cut_holes(pixels, heightfield), _ramp_legend("Slope", "deg", ramp, labels)


_ASPECTS = (
    ("N", "#31205a"), ("NE", "#7d3a4c"), ("E", "#c8743c"), ("SE", "#ebb780"),
    ("S", "#f7f0dc"), ("SW", "#aecbe0"), ("W", "#5f97cb"), ("NW", "#3a53a0"), ("level", "#8f8f8f"),
)  # fmt: skip


def _make_aspect(heightfield: Heightfield) -> tuple[Pixels, Legend]:
    pixels, table, level = _blank(heightfield), _table(_ASPECTS), len(_ASPECTS) - 1
    for rows, shape in shapes(heightfield):
        sector = np.round(aspect_deg(shape) / 45.0).astype(np.intp) % level
        pixels[rows] = table[np.where(slope_deg(shape) < FLAT_DEG, level, sector)]
    return _cut_holes(pixels, heightfield), _class_legend("Aspect", _ASPECTS)


def _make_curvature(heightfield: Heightfield) -> tuple[Pixels, Legend]:
    ramp = _ramp("#12406b", "#3f86b8", "#a9cfe2", "#f4f2ec", "#ecc08c", "#bf7426", "#6b3606")
    bends = _curvature(heightfield)
    known = bends[::4, ::4] if heightfield.holes is None else bends[~heightfield.holes][::16]
    strongest = 1e3 * float(np.percentile(np.abs(known), 98.0)) if known.size else 0.0
    limit_per_km = _round_up(strongest)
    pixels = _shade(ramp, 0.5 + bends * np.float32(500.0 / limit_per_km))
    labels = [f"-{limit_per_km:g} hollow", "", "0", "", f"{limit_per_km:g} ridge"]
    return _cut_holes(pixels, heightfield), _ramp_legend("Curvature", "1/km", ramp, labels)


def _curvature(heightfield: Heightfield) -> npt.NDArray[np.float32]:
    """Mean curvature [1/m] of what is larger than the roughness of single posts."""
    bends = np.empty(heightfield.heights_m.shape, np.float32)
    for rows, shape in shapes(smoothed(heightfield, SMOOTHING_POSTS)):
        bends[rows] = curvature_per_m(shape)
    return bends


def _make_drainage(heightfield: Heightfield) -> tuple[Pixels, Legend]:
    """Rivers over clear ground: the smallest areas are transparent, so that the layer lies over any other."""
    ramp = _ramp("#d9ecf5", "#8fc3e0", "#4a8fca", "#23559f", "#131f5c")
    area = drained_area_m2(heightfield, DRAINAGE_POSTS)
    cell_m2 = heightfield.spacing_m[0] * heightfield.spacing_m[1] * heightfield.heights_m.size / area.size
    low = math.ceil(math.log10(LEAST_SPRING_CELLS * cell_m2))
    high = max(math.ceil(math.log10(max(float(area.max()), 1.0))), low + 2)
    share = (np.log10(np.maximum(area, 1e-3)) - low) / (high - low)
    pixels = _shade(ramp, share)
    pixels[..., 3] = np.clip(0.35 + share * 2.5, 0.0, 1.0) * (share > 0.0) * 255.0
    pixels[area <= 0.0] = 0
    labels = [_area_label(10.0**power) for power in range(low, high + 1)]
    labels = [label if i % math.ceil(len(labels) / 5) == 0 else "" for i, label in enumerate(labels)]
    return pixels, _ramp_legend("Drained area", "", ramp, labels)


_COVERS = (
    ("water", "#1f4e79"), ("meadow", "#c3d35a"), ("forest", "#2e5d3a"), ("scree", "#d2bfa6"), ("rock", "#7f7075"),
    ("snow", "#f7fafd"),
)  # fmt: skip


def _make_cover(heightfield: Heightfield, snow_line: float = 0.78) -> tuple[Pixels, Legend]:
    """Rules of thumb for mountains of the temperate zone, by height within the relief, slope and curvature.

    ``snow_line`` is a share of the relief: it falls as winter comes.
    """
    low_m, high_m = (height / heightfield.exaggeration for height in heightfield.height_range_m)
    span_m = max(high_m - low_m, LEAST_RELIEF_M)
    pixels, table, water = _blank(heightfield), _table(_COVERS), standing_water(heightfield)
    bends = _curvature(heightfield)
    for rows, shape in shapes(heightfield):
        steep, share = slope_deg(shape), heightfield.heights_m[rows] / np.float32(heightfield.exaggeration)
        share = (share - low_m) / span_m
        # Hollows hold soil and snow, ridges are bare: a bend as strong as one over 200 m counts as 5 % of the height.
        bare = np.clip(bends[rows] * 10.0, -0.05, 0.05)
        cover = np.full(share.shape, 1, np.uint8)
        cover[(share + bare > 0.06) & (share + bare < 0.52) & (steep > 8.0)] = 2
        cover[(share + bare > 0.64) | (steep > 33.0)] = 3
        cover[steep + 200.0 * bare > 41.0] = 4
        cover[(share - bare > snow_line) & (steep < 48.0)] = 5
        cover[water[rows]] = 0
        pixels[rows] = table[cover]
    return _cut_holes(pixels, heightfield), _class_legend("Land cover", _COVERS)


THEMES: Mapping[str, ThemeKind] = {
    "slope": ThemeKind("Slope", "How steep the ground is.", _make_slope),
    "aspect": ThemeKind("Aspect", "Where the ground faces.", _make_aspect),
    "curvature": ThemeKind("Curvature", "Where ground bulges out or bends in.", _make_curvature),
    "drainage": ThemeKind(
        "Flow accumulation", "The area whose water passes through: rivers.", _make_drainage, DRAINAGE_POSTS
    ),
    "cover": ThemeKind("Land cover", "Water, meadow, forest, scree, rock and snow, by rule.", _make_cover),
    "winter": ThemeKind(
        "Land cover in winter",
        "As land cover, with snow far down: cover+winter is an animation.",
        partial(_make_cover, snow_line=0.3),
    ),
}


def _blank(heightfield: Heightfield) -> Pixels:
    return np.empty((*heightfield.heights_m.shape, 4), np.uint8)


def _cut_holes(pixels: Pixels, heightfield: Heightfield) -> Pixels:
    if heightfield.holes is not None:
        pixels[heightfield.holes] = 0
    return pixels


def _ramp(*colours: str) -> Colours:
    """(STEPS, 4) opaque colours, linear between colours at equal steps."""
    stops = np.array([[*bytes.fromhex(text[1:]), 255] for text in colours], np.float64)
    at = np.linspace(0.0, len(stops) - 1.0, STEPS)
    return np.stack([np.interp(at, np.arange(len(stops)), channel) for channel in stops.T], axis=1).round().astype("u1")


def _shade(ramp: Colours, share: npt.NDArray[np.floating]) -> Pixels:
    """The ramp's colours at shares 0..1."""
    return ramp[np.clip(share * np.asarray(STEPS, share.dtype), 0, STEPS - 1).astype(np.uint8)]


def _table(classes: tuple[tuple[str, str], ...]) -> Colours:
    return np.array([[*bytes.fromhex(colour[1:]), 255] for _, colour in classes], np.uint8)


def _class_legend(title: str, classes: tuple[tuple[str, str], ...]) -> Legend:
    colours = _table(classes)[:, :3].tolist()
    swatches = tuple(Swatch((r, g, b), label) for (r, g, b), (label, _) in zip(colours, classes, strict=True))
    return Legend(title, "", swatches, False)


def _ramp_legend(title: str, unit: str, ramp: Colours, labels: list[str]) -> Legend:
    """Labels at equal steps along the ramp."""
    at = np.linspace(0, STEPS - 1, len(labels)).round().astype(int)
    colours = ramp[at, :3].tolist()
    return Legend(title, unit, tuple(Swatch((r, g, b), t) for (r, g, b), t in zip(colours, labels, strict=True)), True)


def _round_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    value = max(value, 1e-6)
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-9))


def _area_label(area_m2: float) -> str:
    for unit, size in (("km²", 1e6), ("ha", 1e4)):
        if area_m2 >= size:
            return f"{area_m2 / size:,.0f} {unit}"
    return f"{area_m2:,g} m²"
