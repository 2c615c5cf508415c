"""From what was typed to what is drawn, and with what: algorithm, settings, look, view, layers."""

from __future__ import annotations

import argparse
import difflib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from app.opening.settings import apply_settings, read_value
from terrain.errors import InputError
from terrain.heightfield import Heightfield

DEFAULT_ALGORITHM = "geomorph"


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
    from app.opening.layers import read_layers
    from terrain.renderers import RENDERERS
    from terrain.textures.look import LookSettings
    from terrain.views import VIEWS

    algorithm = args.algorithm or DEFAULT_ALGORITHM
    _choose("an algorithm", algorithm, RENDERERS)
    _choose("a view", args.view, VIEWS)
    settings, look = apply_settings(args.pairs, RENDERERS[algorithm].Settings(), LookSettings())
    if args.tolerance is not None:
        tolerance = next(field for field in fields(settings) if field.name == "tolerance_px")
        settings = replace(settings, tolerance_px=read_value(tolerance, str(args.tolerance)))
    layers = read_layers(args.layer, args.texture, args.lens, args.layer_time)
    return Drawing(algorithm, settings, look, args.view, layers, args.exaggeration, args.breaklines)


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
        raise InputError(f"Expected {what} of {', '.join(known)}, found {name!r}{hint}")
