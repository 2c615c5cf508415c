"""How the terrain looks: the settings a person changes, and what the shaders get from them.

What is off is compiled out (`shading_defines`), so that it costs nothing; what only changes colours or numbers is part
of the frame's uniform block (`look_uniforms`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrain.gpu.frame_block import Look
from terrain.heightfield import Heightfield
from terrain.settings import setting
from terrain.textures.baking import RULES, RULES_HELP, Design
from terrain.textures.palettes import PALETTES

BOLD_EVERY = 5  # contour lines: every fifth is an index line, as on maps
CONTOUR_LINES = 16  # aimed at between the lowest and the highest point when the interval is automatic
VISIBLE_CONTRAST = 3.912  # -ln 0.02: at the visibility 2 % of the contrast is left (Koschmieder)
# Automatic haze, as shares of the terrain's diagonal: on the ground it parts ridge from ridge; an eye that rises looks
# through ever less of it, so that the whole terrain seen from afar keeps four fifths of its colours.
AUTOMATIC_VISIBILITY, AUTOMATIC_HAZE_HEIGHT = 2.0, 0.04


@dataclass(frozen=True)
class LookSettings:
    """The look of a stage. Frozen: a changed copy is given to `terrain.stage.Stage.set_look`."""

    palette: str = setting("natural", "Elevation tints", "Colours by height.", choices=PALETTES)
    shading: str = setting("sunlight", "Relief shading", RULES_HELP, choices=tuple(RULES))
    sun_azimuth_deg: float = setting(
        305.0, "Sun azimuth", "Where the sun stands, clockwise from north.", unit="deg", range=(0.0, 360.0)
    )
    sun_elevation_deg: float = setting(
        34.0, "Sun elevation", "Height of the sun above the horizon.", unit="deg", range=(0.0, 90.0)
    )
    fog: bool = setting(True, "Haze", "Air that takes colour from what is far.")
    visibility_km: float = setting(
        0.0, "Visibility", "Distance at which haze has nearly hidden the ground; 0 suits the terrain and the eye.",
        unit="km", range=(0.0, 500.0),
    )  # fmt: skip
    fog_height_m: float = setting(
        0.0, "Haze height", "Height over which haze thins out; 0 keeps it the same all over a picture.",
        unit="m", range=(0.0, 5000.0),
    )  # fmt: skip
    contours: bool = setting(False, "Contour lines", "Lines of equal height; every fifth is bold.")
    contour_interval_m: float = setting(
        0.0, "Contour interval", "Height between lines; 0 adapts it to the relief.", unit="m", range=(0.0, 1000.0)
    )
    water: bool = setting(False, "Water", "A water surface at one height.")
    water_level_m: float = setting(0.0, "Water level", "Height of the water.", unit="m", range=(-500.0, 9000.0))
    texture_tolerance_px2: float = setting(
        2.0, "Texel size", "Largest area of an image's texel on the screen; smaller is sharper and loads more.",
        unit="px²", range=(0.25, 64.0),
    )  # fmt: skip
    texture_budget_mib: int = setting(
        256, "Image memory", "Memory for tiles of images on the graphics card.", unit="MiB", range=(16, 1020)
    )


def sun_direction(look: LookSettings) -> tuple[float, float, float]:
    """Unit vector to the sun, world axes."""
    azimuth, elevation = math.radians(look.sun_azimuth_deg), math.radians(look.sun_elevation_deg)
    return (
        math.sin(azimuth) * math.cos(elevation),
        math.sin(elevation),
        -math.cos(azimuth) * math.cos(elevation),
    )


def bake_design(look: LookSettings) -> Design:
    """What the ground's textures must show under this look."""
    return Design(look.palette, look.shading, (look.sun_azimuth_deg, look.sun_elevation_deg))


def automatic_interval_m(relief_m: float) -> float:
    """Contour interval of 1, 2 or 5 times a power of ten that gives about `CONTOUR_LINES` lines."""
    wanted = max(relief_m, 1e-3) / CONTOUR_LINES
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / wanted)))


def shading_defines(look: LookSettings) -> dict[str, Any]:
    """Compile-time switches of the shading include."""
    switches = {
        "FOG": look.fog,
        "HEIGHT_FOG": look.fog and look.fog_height_m > 0.0,
        "CONTOURS": look.contours,
    }
    return {name: 1 for name, on in switches.items() if on}


def look_uniforms(look: LookSettings, heightfield: Heightfield) -> Look:
    """The look's part of the frame's uniform block."""
    low, high = heightfield.height_range_m
    relief_m = max(high - low, 1.0)
    sunlight, sky_light, zenith, horizon, haze = _sky_colours(look.sun_elevation_deg)
    interval_m = look.contour_interval_m or automatic_interval_m(relief_m / heightfield.exaggeration)
    return Look(
        sun=(*sun_direction(look), 1.0),
        sunlight=(*sunlight, 1.0),
        sky_light=(*sky_light, 1.0),
        zenith=(*zenith, 1.0),
        horizon=(*horizon, 1.0),
        fog_colour=(*haze, 1.0),
        fog=_haze(look, heightfield),
        contour=(interval_m * heightfield.exaggeration, BOLD_EVERY, 1.0, heightfield.exaggeration),
        water=(look.water_level_m * heightfield.exaggeration, min(0.003 * relief_m, 4.0), 0.0, 0.0),
    )


def _haze(look: LookSettings, heightfield: Heightfield) -> tuple[float, ...]:
    """Density at the lowest ground [1/m], height of that [m], and by how much it falls off as a point and as the eye
    rises [1/m]."""
    low, high = heightfield.height_range_m
    diagonal_m = math.hypot(*heightfield.extent_m, high - low)
    density = VISIBLE_CONTRAST / (1e3 * look.visibility_km or AUTOMATIC_VISIBILITY * diagonal_m)
    if look.fog_height_m > 0.0:
        return density, low, 1.0 / (look.fog_height_m * heightfield.exaggeration), 0.0
    return density, low, 0.0, 0.0 if look.visibility_km else 1.0 / (AUTOMATIC_HAZE_HEIGHT * diagonal_m)


def _sky_colours(elevation_deg: float) -> tuple[tuple[float, ...], ...]:
    """Colours of sunlight and sky light (linear), zenith, horizon and haze (display), from a low to a high sun."""
    at = [0.0, 4.0, 12.0, 30.0, 90.0]
    table = np.array(
        [
            # sunlight            sky light           zenith              horizon             haze
            [[0.55, 0.16, 0.05], [0.14, 0.15, 0.24], [0.10, 0.15, 0.32], [0.80, 0.47, 0.34], [0.42, 0.33, 0.37]],
            [[1.35, 0.62, 0.25], [0.16, 0.18, 0.28], [0.15, 0.24, 0.46], [0.91, 0.66, 0.47], [0.60, 0.49, 0.47]],
            [[1.75, 1.18, 0.68], [0.13, 0.18, 0.29], [0.19, 0.36, 0.63], [0.86, 0.80, 0.70], [0.68, 0.67, 0.65]],
            [[1.80, 1.50, 1.13], [0.13, 0.19, 0.30], [0.21, 0.43, 0.73], [0.78, 0.86, 0.92], [0.66, 0.74, 0.81]],
            [[1.75, 1.60, 1.36], [0.15, 0.21, 0.33], [0.19, 0.42, 0.76], [0.76, 0.86, 0.94], [0.65, 0.75, 0.84]],
        ]
    )
    flat = table.reshape(len(at), -1)
    mixed = np.array([np.interp(elevation_deg, at, column) for column in flat.T]).reshape(5, 3)
    return tuple(tuple(float(v) for v in row) for row in mixed)
