"""Layers as text: ``NAME[:blend[:opacity[:place]]]``, as on the command line and in the window."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from terrain.errors import InputError
from terrain.textures.layers import BLENDS, PLACES, Key, Layer, LayerStack, Lens
from terrain.textures.library import title_of
from terrain.textures.thematic import THEMES

LAYER_FORM = "NAME[:blend[:opacity[:place]]]"
RIM = 0.15  # of a lens: the width of its soft edge, as a share of its radius
_OPTIONS = re.compile(rf":({'|'.join(BLENDS)})(?::([0-9]*\.?[0-9]+))?(?::({'|'.join(PLACES)}))?$")


def parse_layer(text: str) -> Layer:
    """A layer from ``NAME[:blend[:opacity[:place]]]``.

    NAME is a theme or an image file; several, joined by ``+``, are key frames of an animation at the times 0, 1, 2 ...
    or, as in ``old.png@1990+new.png@2020``, at times of their own.

    Raises
    ------
    InputError
        If it cannot be understood; whether the image exists is found when it is opened.
    """
    match = _OPTIONS.search(text)
    names, blend, opacity, where = text, "mix", 1.0, "everywhere"
    if match is not None:
        names, blend = text[: match.start()], match[1]
        opacity = 1.0 if match[2] is None else float(match[2])
        where = match[3] or where
    if not 0.0 <= opacity <= 1.0:
        raise InputError(f"Expected an opacity of 0 to 1, found {match[2] if match else opacity} in layer {text!r}.")
    stray = re.search(r":([a-z]+)(:[0-9.]*)?$", names)
    if stray is not None and not os.path.exists(names):
        raise InputError(
            f"Expected {LAYER_FORM} with blend {_either(BLENDS)}, place {_either(PLACES)}, found {text!r}."
        )
    keys = _parse_keys(names)
    return Layer(title_of(keys[0].source), keys, blend, opacity, True, where)  # type: ignore[arg-type]


def _parse_keys(names: str) -> tuple[Key, ...]:
    if not names:
        raise InputError(f"Expected {LAYER_FORM} with a theme ({', '.join(THEMES)}) or an image file, found no name.")
    if os.path.exists(names):
        return (Key(names),)
    keys = []
    for number, part in enumerate(names.split("+")):
        source, at, time = part.rpartition("@")
        if at and re.fullmatch(r"-?[0-9]*\.?[0-9]+", time):
            keys.append(Key(source, float(time)))
        else:
            keys.append(Key(part, float(number)))
    times = [key.time for key in keys]
    if any(later <= earlier for earlier, later in pairwise(times)):
        raise InputError(f"Expected key frames in the order of their times, found {names!r}.")
    return tuple(keys)


def read_layers(
    layers: Sequence[str], textures: Sequence[Path], lens: Sequence[float] | None, time: float | None
) -> LayerStack:  # fmt: skip
    """The stack that a command asks for: images first, then layers, each over those before it.

    Raises
    ------
    InputError
        If a layer cannot be understood.
    """
    stack = LayerStack()
    for path in textures:
        stack = stack.with_layer(Layer(path.name, (Key(str(path)),)))
    for text in layers:
        stack = stack.with_layer(parse_layer(text))
    if lens is not None:
        x, z, radius_m = lens
        if radius_m <= 0.0:
            raise InputError(f"Expected a lens X,Z,RADIUS with a radius above 0 m, found {radius_m:g}.")
        stack = replace(stack, lens=Lens(True, (x, z), radius_m, RIM, dimming_of(stack)))
    span = stack.time_range
    if time is not None:
        if span is None:
            raise InputError("--layer-time goes with a layer of key frames, as in --layer a.png+b.png.")
        if not span[0] <= time <= span[1]:
            raise InputError(f"Expected a time of {span[0]:g} to {span[1]:g}, found {time:g}.")
        stack = replace(stack, time=time)
    return stack


def dimming_of(stack: LayerStack) -> float:
    """A lens in which nothing shows is a highlight: what lies outside is darkened."""
    return 0.0 if any(layer.where != "everywhere" for layer in stack.layers) else 0.6


def _either(names: Sequence[str] | object) -> str:
    *first, last = names  # type: ignore[misc]
    return f"{', '.join(first)} or {last}"
