"""From what was typed to what is shown: terrain, settings, camera, flight."""

from __future__ import annotations

import argparse
import difflib
import hashlib
import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.opening.settings import apply_settings, read_value
from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight import Flight, Keyframe, demo_flight, make_flight, tour
from terrain.heightfield import Heightfield

SCENE_POSTS = 1025
PREFERRED = "geomorph"


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

    from terrain.sources import read_heightfield

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


def open_tour(heightfield: Heightfield) -> Flight:
    """The terrain's demo flight, from the cache where it was found before: a start takes 0.3 s less.

    The key holds the source code that finds it, so that no other version's tour is ever flown.
    """
    from terrain.cache import load_arrays, store_arrays

    source = hashlib.sha256(Path(tour.__file__).read_bytes()).hexdigest()[:16]
    kept = load_arrays("tours", f"{heightfield.sha256}-{source}")
    if kept is not None:
        keys = [Keyframe(t_s, Camera((x, y, z), *view)) for t_s, x, y, z, *view in kept["keyframes"].tolist()]
        return make_flight(keys, str(kept["name"]), heightfield)
    flight = demo_flight(heightfield)
    cameras = [(key.t_s, key.camera) for key in flight.keyframes]
    rows = [(t_s, *c.position_m, c.yaw_deg, c.pitch_deg, c.roll_deg, c.fov_deg) for t_s, c in cameras]
    arrays = {"keyframes": np.array(rows, np.float64), "name": np.array(flight.name)}
    store_arrays("tours", f"{heightfield.sha256}-{source}", arrays)
    return flight


@dataclass(frozen=True)
class Drawing:
    """What to draw with, checked: see `read_drawing`."""

    algorithm: str
    settings: Any
    look: Any
    view: Any
    layers: Any
    exaggeration: float
    breaklines: Path | None = None


def read_drawing(args: argparse.Namespace) -> Drawing:
    """The drawing options of a command, checked against what the renderers and the look offer.

    Raises
    ------
    InputError
        If a name is unknown or a value out of range.
    """
    from app.session.layers import read_layers
    from terrain.renderers import RENDERERS
    from terrain.textures.look import LookSettings
    from terrain.views import VIEWS

    algorithm = args.algorithm or default_algorithm()
    _choose("algorithm", algorithm, RENDERERS)
    _choose("view", args.view, VIEWS)
    settings, look = apply_settings(args.pairs, RENDERERS[algorithm].Settings(), LookSettings())
    if args.tolerance is not None:
        tolerance = next(field for field in fields(settings) if field.name == "tolerance_px")
        settings = replace(settings, tolerance_px=read_value(tolerance, str(args.tolerance)))
    layers = read_layers(args.layer, args.texture, args.lens, args.layer_time)
    return Drawing(algorithm, settings, look, args.view, layers, args.exaggeration, args.breaklines)


def default_algorithm() -> str:
    """The algorithm that is on when none is named."""
    from terrain.renderers import RENDERERS

    return PREFERRED if PREFERRED in RENDERERS else next(iter(RENDERERS))


def without_waiting(settings: Any) -> Any:
    """The settings for a window, where a preview is better than a wait."""
    return replace(settings, preview=True) if any(f.name == "preview" for f in fields(settings)) else settings


def open_library(drawing: Drawing, heightfield: Heightfield) -> Any:
    """The images of all layers, opened; whoever opens them closes them, after the stage that shows them.

    Raises
    ------
    InputError
        If one of them is no image, or lies beside the terrain.
    """
    from terrain.textures.library import Library

    library = Library(heightfield)
    try:
        library.open_all(drawing.layers.following_sources)
    except InputError:
        library.close()
        raise
    return library


def open_stage(gpu: Any, heightfield: Heightfield, drawing: Drawing, library: Any) -> Any:
    """A stage that draws ``heightfield`` as asked, with layers from ``library``.

    Raises
    ------
    InputError
        If the breaklines cannot be read, or the images are too many.
    """
    from terrain.scene import open_scene
    from terrain.stage import Stage
    from terrain.synthetic.slabs import planes_beside

    lines = None
    if drawing.breaklines is not None:
        from terrain.algorithms.refined_cells import refuse_crowds
        from terrain.breaklines import read_breaklines

        lines = read_breaklines(drawing.breaklines, heightfield)
        refuse_crowds(heightfield, lines)
    scene = open_scene(heightfield, planes_beside(heightfield), lines)
    if drawing.exaggeration != 1.0:
        scene = scene.exaggerated(drawing.exaggeration)
    stage = Stage(gpu, scene, drawing.algorithm, drawing.settings, drawing.look)
    try:
        stage.set_layers(drawing.layers, library.open_all(drawing.layers.following_sources))
    except InputError:
        stage.release()
        raise
    return stage


def _choose(what: str, name: str, known: Any) -> None:
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        hint = f"; did you mean {near[0]}?" if near else "."
        raise InputError(f"Expected an {what} of {', '.join(known)}, found {name!r}{hint}".replace("an view", "a view"))
