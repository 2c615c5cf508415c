"""``reliefscope info`` and ``reliefscope make``: what a terrain is, and the embedded ones as files."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from app.commands import arguments
from app.opening.terrain import open_terrain
from terrain.errors import InputError


def info(args: argparse.Namespace) -> None:
    """Tell what a terrain is, and what was decided while reading it."""
    from terrain.files.describe import describe, describe_text

    heightfield = open_terrain(args)
    print(json.dumps(describe(heightfield), indent=2) if args.json else describe_text(heightfield))


def make(args: argparse.Namespace) -> None:
    """Write an embedded scene as GeoTIFF."""
    from app.output.capture import refuse_existing
    from terrain.files.geotiff import write_geotiff
    from terrain.synthetic import SCENES, make_scene

    if args.name not in SCENES:
        raise InputError(f"Expected a scene of {', '.join(SCENES)}, found {args.name!r}.")
    refuse_existing(args.out, args.overwrite)
    heightfield = make_scene(args.name, args.size, args.seed)
    write_geotiff(heightfield, args.out)
    print(f"Wrote {args.out}: {args.name}, {heightfield.cols} x {heightfield.rows} posts, seed {args.seed}.")


def info_options(parser: argparse.ArgumentParser) -> None:
    arguments.add_terrain_options(parser)
    parser.add_argument("--json", action="store_true", help="for programs")


def make_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name", metavar="NAME", help="alps, city, plain, snake, flat, ramp, cone, step, needle or waves"
    )
    parser.add_argument("--size", metavar="N", type=arguments.count, default=1025, help="posts per side (1025)")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="another seed, another terrain (0)")
    parser.add_argument("--out", metavar="FILE.tif", type=Path, required=True, help="what exists is not overwritten")
    parser.add_argument("--overwrite", action="store_true", help="replace what exists")
