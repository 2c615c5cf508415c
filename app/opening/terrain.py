"""From what was typed to a terrain: a file or an embedded scene."""

from __future__ import annotations

import argparse
import difflib
import hashlib
import os
from pathlib import Path

import numpy as np

from terrain.errors import InputError
from terrain.heightfield import Heightfield

SCENE_POSTS = 1025


def open_terrain(args: argparse.Namespace) -> Heightfield:
    """The terrain a command names: an embedded scene, or a file.

    Raises
    ------
    InputError
        If it is neither.
    """
    from terrain.synthetic import SCENES

    name, *numbers = str(args.terrain).split(":")
    if name in SCENES and not os.path.exists(args.terrain):
        if len(numbers) > 2 or not all(number.isdigit() for number in numbers):
            raise InputError(f"Expected a scene as {name}, {name}:POSTS or {name}:POSTS:SEED, found {args.terrain!r}.")
        size, seed = [*map(int, numbers), *(SCENE_POSTS, 0)[len(numbers) :]]
        return _embedded_scene(name, size, seed)
    path = Path(args.terrain)
    if not path.exists() and not path.suffix and path.parent == Path():
        near = difflib.get_close_matches(name, SCENES, 1)
        hint = f"Did you mean {near[0]}?" if near else f"The scenes are {', '.join(SCENES)}."
        raise InputError(f"Expected a terrain file or an embedded scene, found neither for {name!r}. {hint}")

    from terrain.files.sources import read_heightfield

    return read_heightfield(
        path, encoding=args.encoding, raw=args.raw, spacing_m=args.spacing, height_scale=args.height_scale
    )


def _embedded_scene(name: str, size: int, seed: int) -> Heightfield:
    """An embedded scene, from the cache where it was made before: eroding mountains takes longer than reading them.

    The key holds the source code that makes scenes, so that no other version's scene is ever shown.
    """
    from terrain import synthetic
    from terrain.cache import load_arrays, store_arrays

    digest = hashlib.sha256(f"{name}:{size}:{seed}".encode())
    for source in sorted(Path(synthetic.__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    if (found := load_arrays("scene", digest.hexdigest())) is not None:
        dx, dz = found["spacing_m"].tolist()
        return Heightfield(found["heights_m"], (dx, dz), name=str(found["name"]), notes=tuple(found["notes"].tolist()))
    made = synthetic.make_scene(name, size, seed)
    if made.holes is None and made.georeference is None:
        arrays = {"heights_m": made.heights_m, "spacing_m": np.array(made.spacing_m), "name": np.array(made.name)}
        store_arrays("scene", digest.hexdigest(), arrays | {"notes": np.array(made.notes, np.str_)})
    return made
