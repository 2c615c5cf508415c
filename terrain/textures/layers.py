"""Layers over the ground: their order, how each is blended, where it shows, and the animation between key frames.

Every layer keeps its own images; the shader combines them for each pixel (``shaders/lib/layers.glsl``), so that moving
a slider, the lens or time touches no texture. What is off is not compiled. `compose` is the shader's twin.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Multitexturing for Terrain Visualization": information layers merged by image operations, visibility textures, thematic
lenses, thematic animation between two consecutive key frames by weights.

**Deviations** The paper's lens is a luminance texture that moves; here it is a circle of the shader, with the same
effect (what lies outside is darkened) and another: layers may show only within it, or only outside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.gpu.frame_block import MOST_LAYERS

Blend = Literal["mix", "modulate", "add"]
Where = Literal["everywhere", "inside", "outside"]
Floats = npt.NDArray[np.float64]

BLENDS: Mapping[Blend, str] = {
    "mix": "covers what lies below, in the light of the ground",
    "modulate": "multiplies what lies below: it darkens",
    "add": "adds its light to what lies below",
}
PLACES: Mapping[Where, str] = {"everywhere": "everywhere", "inside": "in the lens", "outside": "outside the lens"}
LUMINANCE = (0.2126, 0.7152, 0.0722)  # what a visibility texture shows: white all, black and clear nothing


class Key(NamedTuple):
    """An image of a thematic animation: the name of its source, and its time."""

    source: str
    time: float = 0.0


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes
    ----------
    name : str
        What the list calls it; each name once in a stack.
    keys : tuple of Key
        Its image; or several, in the order of their times, between which it is animated.
    blend : {"mix", "modulate", "add"}
    opacity : float
        0..1.
    is_on : bool
    where : {"everywhere", "inside", "outside"}
        Of the lens; without a lens a layer that belongs inside does not show.
    visibility : str or None
        Source of the visibility texture: where it is white the layer shows, where it is black or clear it does not.
    """

    name: str
    keys: tuple[Key, ...]
    blend: Blend = "mix"
    opacity: float = 1.0
    is_on: bool = True
    where: Where = "everywhere"
    visibility: str | None = None

    @property
    def is_animated(self) -> bool:
        return len(self.keys) > 1

    def between(self, time: float) -> tuple[str, str | None, float]:
        """The two key frames around a time and the share of the second; at a key frame and past the ends only one."""
        times = [key.time for key in self.keys]
        after = sum(t <= time for t in times)
        if after == 0 or after == len(times):
            return self.keys[max(after - 1, 0)].source, None, 0.0
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return (self.keys[after - 1].source, self.keys[after].source if share > 0.0 else None, share)


@dataclass(frozen=True)
class Lens:
    """A circle on the ground.

    Attributes
    ----------
    is_on : bool
    centre_m : tuple of float
        World x and z.
    radius_m : float
    rim : float
        Width of its soft edge, inwards, as a share of the radius.
    dimming : float
        How dark it is outside, 0..1: the highlight lens.
    """

    is_on: bool = False
    centre_m: tuple[float, float] = (0.0, 0.0)
    radius_m: float = 1000.0
    rim: float = 0.15
    dimming: float = 0.0

    def inside(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> Floats:
        """1 inside, 0 outside, smooth over the rim."""
        away = np.hypot(np.asarray(x_m, np.float64) - self.centre_m[0], np.asarray(z_m, np.float64) - self.centre_m[1])
        inner = self.radius_m * (1.0 - self.rim)
        t = np.clip((away - inner) / max(self.radius_m - inner, 1e-6), 0.0, 1.0)
        return 1.0 - t * t * (3.0 - 2.0 * t)


@dataclass(frozen=True)
class LayerStack:
    """Layers from the lowest to the uppermost, the lens, and the time of the animation."""

    layers: tuple[Layer, ...] = ()
    lens: Lens = Lens()
    time: float = 0.0

    @property
    def shown(self) -> tuple[Layer, ...]:
        """The layers that can be seen at all."""
        return tuple(
            layer
            for layer in self.layers
            if layer.is_on and layer.opacity > 0.0 and (self.lens.is_on or layer.where != "inside")
        )

    @property
    def sources(self) -> tuple[str, ...]:
        """The names of all images that are shown now, each once."""
        names: list[str | None] = []
        for layer in self.shown:
            names += [*layer.between(self.time)[:2], layer.visibility]
        return tuple(dict.fromkeys(name for name in names if name is not None))

    @property
    def following_sources(self) -> tuple[str, ...]:
        """The names of all images of the layers that are shown, at any time, each once."""
        names = [name for layer in self.shown for name in (*(key.source for key in layer.keys), layer.visibility)]
        return tuple(dict.fromkeys(name for name in names if name is not None))

    @property
    def time_range(self) -> tuple[float, float] | None:
        """First and last time of the animated layers, or None where there are none."""
        times = [key.time for layer in self.layers if layer.is_animated for key in layer.keys]
        return (min(times), max(times)) if times else None

    def with_layer(self, layer: Layer) -> LayerStack:
        """Another layer on top, under a name of its own."""
        taken, name, number = {each.name for each in self.layers}, layer.name, 1
        while name in taken:
            number += 1
            name = f"{layer.name} {number}"
        layers = (*self.layers, replace(layer, name=name))
        stack = replace(self, layers=layers)
        span = stack.time_range
        return stack if span is None else replace(stack, time=min(max(self.time, span[0]), span[1]))

    def without(self, index: int) -> LayerStack:
        """The others."""
        return replace(self, layers=self.layers[:index] + self.layers[index + 1 :])

    def changed(self, index: int, **values: Any) -> LayerStack:
        """One layer changed."""
        changed = replace(self.layers[index], **values)
        return replace(self, layers=(*self.layers[:index], changed, *self.layers[index + 1 :]))

    def moved(self, index: int, steps: int) -> LayerStack:
        """One layer moved up (positive) or down, as far as there is room."""
        rest = list(self.without(index).layers)
        rest.insert(min(max(index + steps, 0), len(rest)), self.layers[index])
        return replace(self, layers=tuple(rest))


def layer_defines(stack: LayerStack) -> dict[str, Any]:
    """Compile-time switches of the shading include."""
    shown = stack.shown
    if not shown and not _dims(stack.lens):
        return {}
    switches = {
        "LENS": _dims(stack.lens) or (stack.lens.is_on and any(layer.where != "everywhere" for layer in shown)),
        "KEY_FRAMES": any(layer.is_animated for layer in shown),
        "VISIBILITY": any(layer.visibility for layer in shown),
    }
    return {"LAYERS": len(shown)} | {name: 1 for name, on in switches.items() if on}


class LayerUniforms(NamedTuple):
    """The stack's part of the frame's uniform block, as `terrain.gpu.frame_block.Look` names it."""

    layer_what: tuple[tuple[float, ...], ...]
    layer_how: tuple[tuple[float, ...], ...]
    lens: tuple[float, ...]
    lens_effect: tuple[float, ...]


def layer_uniforms(
    stack: LayerStack, tree_of: Mapping[str, int], ground_of_lens: tuple[float, float]
) -> LayerUniforms:  # fmt: skip
    """What the shader reads.

    Parameters
    ----------
    stack : LayerStack
    tree_of : mapping
        The tree's number of every source that is shown.
    ground_of_lens : tuple of float
        The lens's centre in coordinates of the ground textures.
    """
    what, how = [], []
    for layer in stack.shown:
        source, following, share = layer.between(stack.time)
        mask = -1.0 if layer.visibility is None else float(tree_of[layer.visibility])
        what.append((float(tree_of[source]), float(tree_of[following or source]), share, mask))
        outside, inside = {"everywhere": (1.0, 1.0), "inside": (0.0, 1.0), "outside": (1.0, 0.0)}[layer.where]
        how.append((layer.opacity, float(list(BLENDS).index(layer.blend)), outside, inside))
    unused = ((0.0, 0.0, 0.0, -1.0),) * (MOST_LAYERS - len(what))
    lens = stack.lens
    return LayerUniforms(
        (*what, *unused), (*how, *unused), (*ground_of_lens, lens.radius_m, max(lens.rim * lens.radius_m, 1e-3)),
        (lens.dimming, 0.0, 0.0, 0.0),
    )  # fmt: skip


def compose(
    base: Floats, light: Floats, layers: Sequence[Layer], images: Mapping[str, Floats], time: float = 0.0,
    inside: Floats | float | None = None, dimming: float = 0.0,
) -> Floats:  # fmt: skip
    """What layers make of a colour, display colours 0..1: the twin of ``compose_layers`` in GLSL.

    Parameters
    ----------
    base : ndarray, (..., 3)
        Ground colour times light.
    light : ndarray, (..., 3)
        Light relative to that on level ground.
    layers : sequence of Layer
        From the lowest to the uppermost.
    images : mapping of str to ndarray, (..., 4)
        Samples of the sources: RGBA with colours premultiplied by alpha.
    time : float
    inside : ndarray, (...), or None
        Share inside the lens; None where there is none.
    dimming : float

    Returns
    -------
    ndarray, (..., 3)
    """
    colour = np.asarray(base, np.float64)
    for layer in layers:
        source, following, share = layer.between(time)
        image = np.asarray(images[source], np.float64)
        if following is not None:
            image = image + share * (images[following] - image)
        weight = np.full(image.shape[:-1], layer.opacity)
        if inside is not None and layer.where != "everywhere":
            weight = weight * (inside if layer.where == "inside" else 1.0 - np.asarray(inside))
        if layer.visibility is not None:
            weight = weight * (images[layer.visibility][..., :3] @ np.array(LUMINANCE))
        weight = weight[..., None]
        gain = {"mix": light, "modulate": colour, "add": np.ones(3)}[layer.blend]
        keep = 1.0 if layer.blend == "add" else 1.0 - weight * image[..., 3:]
        colour = np.clip(colour * keep + gain * image[..., :3] * weight, 0.0, 1.0)
    if inside is not None:
        colour = colour * (1.0 - dimming * (1.0 - np.asarray(inside)))[..., None]
    return colour


def plain_stack(names: Sequence[str]) -> LayerStack:
    """Images that cover the ground, each over those before it."""
    return LayerStack(tuple(Layer(name, (Key(name),)) for name in names))


def _dims(lens: Lens) -> bool:
    return lens.is_on and lens.dimming > 0.0
