"""Pieces of the command line: parsers that answer in one line, and the options that commands share."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

LARGEST_PX = 16384


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose complaints are one line on stderr, with exit status 2."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {' '.join(message.split())} (see {self.prog} --help)", file=sys.stderr)
        sys.exit(2)


def join_negative_values(argv: Sequence[str]) -> list[str]:
    """``--eye -5,2,9`` as ``--eye=-5,2,9``: argparse would take the value for an option."""
    joined: list[str] = []
    for word in argv:
        follows_option = bool(joined) and re.fullmatch(r"--[a-z-]+", joined[-1]) is not None
        if follows_option and re.match(r"-\.?\d", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def size(text: str) -> tuple[int, int]:
    """``"1280x720"`` -> ``(1280, 720)``."""
    match = re.fullmatch(r"(\d{1,6})[xX×](\d{1,6})", text.strip())
    if not match:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT as in 1280x720, found {text!r}")
    width, height = int(match[1]), int(match[2])
    if not (1 <= width <= LARGEST_PX and 1 <= height <= LARGEST_PX):
        raise argparse.ArgumentTypeError(f"expected 1 to {LARGEST_PX} pixels each way, found {text!r}")
    return width, height


def triple(text: str) -> tuple[float, float, float]:
    """``"1,2,3"`` -> ``(1.0, 2.0, 3.0)``."""
    try:
        x, y, z = (number(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected X,Y,Z in metres as in 1200,850,3400, found {text!r}") from None
    return x, y, z


def circle(text: str) -> tuple[float, float, float]:
    """``"1,2,3"`` -> ``(1.0, 2.0, 3.0)``."""
    try:
        x, z, radius = (number(part) for part in text.split(","))
    except (ValueError, argparse.ArgumentTypeError):
        raise argparse.ArgumentTypeError(f"expected X,Z,RADIUS in metres as in 1200,3400,500, found {text!r}") from None
    return x, z, radius


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, found {text!r}")
    return value


def field_of_view(text: str) -> float:
    """Degrees between 1 and 170."""
    value = number(text)
    if not 1.0 <= value <= 170.0:
        raise argparse.ArgumentTypeError(f"expected a field of view of 1 to 170 degrees, found {text!r}")
    return value


def positive(text: str) -> float:
    """A finite number above 0."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"expected a number above 0, found {text!r}")
    return value


def positives(text: str) -> list[float]:
    """``"0.5,1"`` -> ``[0.5, 1.0]``: numbers above 0, each once."""
    return list(dict.fromkeys(positive(part) for part in text.split(",")))


def words(text: str) -> list[str]:
    """``"a,b"`` -> ``["a", "b"]``: names, each once."""
    return list(dict.fromkeys(part.strip() for part in text.split(",")))


def count(text: str) -> int:
    """A whole number from 1."""
    if not re.fullmatch(r"\d{1,9}", text.strip()) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1, found {text!r}")
    return int(text)


def add_terrain_options(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """``TERRAIN`` and how to read it."""
    parser.add_argument(
        "terrain",
        metavar="TERRAIN",
        **({} if default is None else {"nargs": "?", "default": default}),  # type: ignore[arg-type]
        help="a file in any format GDAL reads, an image, .npy, .npz, .r16 or .r32; or an embedded scene:"
        " alps, alps:4097 (posts per side), alps:4097:7 (and seed)"
        + (f" ({default} where none is given)" if default else ""),
    )
    group = parser.add_argument_group("reading the terrain")
    group.add_argument("--encoding", metavar="NAME", help="how colours mean heights: terrarium, mapbox or grey")
    group.add_argument("--raw", metavar="WxH[,TYPE][,ENDIAN]", help="read bare numbers, as in 1024x1024,uint16,little")
    group.add_argument(
        "--spacing", metavar="M", type=positive, help="metres between posts, instead of what the file says"
    )
    group.add_argument(
        "--height-scale", metavar="K", type=number, default=1.0, help="metres per unit of height (0.3048 for feet)"
    )


def add_drawing_options(parser: argparse.ArgumentParser) -> None:
    """Algorithm, settings, view, look."""
    group = parser.add_argument_group("drawing")
    group.add_argument("--algorithm", metavar="NAME", help="the renderer (geomorph)")
    group.add_argument("--tolerance", metavar="PX", type=positive, help="allowed geometric error on the screen (1)")
    group.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[], dest="pairs",
        help="a setting of the algorithm or of the look, as often as needed; listed below",
    )  # fmt: skip
    group.add_argument(
        "--view", metavar="NAME", default="shaded", help="shaded, or a debug view (wireframe, levels ...)"
    )
    group.add_argument(
        "--texture", metavar="IMG", type=Path, action="append", default=[],
        help="an image to lay on the terrain, of any size; as often as needed, each over those before it",
    )  # fmt: skip
    group.add_argument(
        "--breaklines", metavar="FILE", type=Path,
        help="GeoJSON or CSV (x,y or lon,lat, then z) of lines that refine the cells they cross; multiresolution draws"
        " them",
    )  # fmt: skip
    group.add_argument(
        "--layer", metavar="LAYER", action="append", default=[],
        help="a layer, as NAME[:blend[:opacity[:place]]]: NAME is slope, aspect, curvature, drainage, cover, winter or"
        " an image file, or several joined by + as key frames; blend mix, modulate or add; place everywhere, inside or"
        " outside the lens; as often as needed",
    )  # fmt: skip
    group.add_argument("--lens", metavar="X,Z,R", type=circle, help="a lens on the ground: east, south, radius [m]")
    group.add_argument("--layer-time", metavar="T", type=number, help="hold animated layers at this time")
    group.add_argument(
        "--exaggeration", metavar="K", type=positive, default=1.0, help="factor to the heights, in the picture only"
    )
    group.add_argument(
        "--flight", metavar="FILE", type=Path, help="a *.flight.json, or a track: GPX, KML, CSV (the demo flight)"
    )
    group.add_argument(
        "--above-ground", metavar="M", type=positive, help="fly a track this high above the ground, not at its heights"
    )
    group.add_argument("--duration", metavar="S", type=positive, help="how long a track is flown, instead of its times")
    group.add_argument("--size", metavar="WxH", type=size, help="size of the picture in pixels")


def add_settings_help(parser: argparse.ArgumentParser) -> None:
    """Give ``--help`` the settings of every algorithm and of the look; nothing is imported before it is asked for."""

    def epilog() -> str:
        from app.opening.settings import settings_table
        from terrain.renderers import RENDERERS
        from terrain.textures.look import LookSettings

        tables = [
            settings_table(kind.Settings(), f"--set for {name} ({kind.title})") for name, kind in RENDERERS.items()
        ]
        return "\n\n".join([*tables, settings_table(LookSettings(), "--set for the look")])

    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    show = parser.format_help
    parser.format_help = lambda: f"{show()}\n{epilog()}\n"  # type: ignore[method-assign]
