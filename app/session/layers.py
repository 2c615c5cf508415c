"""The layers of a session: what is shown over the ground, the lens that follows the mouse, the animation that plays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.opening.layers import dimming_of, parse_layer
from terrain.camera import Camera
from terrain.errors import InputError
from terrain.textures.layers import Key, Layer, LayerStack
from terrain.textures.library import Library
from terrain.textures.thematic import THEMES, Legend
from terrain.textures.tree import TileSource

if TYPE_CHECKING:
    from app.session.session import Session
    from terrain.stage import Stage

ANIMATION_S = 10.0  # from the first key frame to the last


class Layers:
    """The layers of a session: what is shown, the lens that follows the mouse, and the animation that plays.

    Parameters
    ----------
    session : Session
    library : Library
        Closed here.
    stack : LayerStack
        What is shown at first, already on the session's stage.

    Attributes
    ----------
    stack : LayerStack
    selected : int
        The layer whose settings the window shows.
    is_playing : bool
    """

    def __init__(self, session: Session, library: Library, stack: LayerStack) -> None:
        self._session, self.library, self.stack = session, library, stack
        self.selected = len(stack.layers) - 1
        self.is_playing = False
        self._pointed: tuple[tuple[float, float], Camera] | None = None  # what the lens was moved for
        if not stack.lens.is_on:
            radius_m = max(min(session.heightfield.extent_m) / 8.0, 1e-3)
            self.stack = replace(stack, lens=replace(stack.lens, radius_m=radius_m))

    def show_on(self, stage: Stage) -> None:
        """Show the layers on another stage of the same terrain."""
        stage.set_layers(self.stack, self.library.open_all(self.stack.following_sources))

    def change(self, stack: LayerStack) -> bool:
        """Show another stack; whether that could be done. Otherwise the old one stays, and the reason is shown."""
        before, self.stack = self.stack, stack
        try:
            self.show_on(self._session.stage)
        except InputError as error:
            self.stack = before
            self._session.say(str(error))
            return False
        self.selected = min(max(self.selected, 0), len(stack.layers) - 1)
        self._session.touch()
        return True

    def edit(self, index: int, **values: Any) -> bool:
        """Change a layer."""
        return self.change(self.stack.changed(index, **values))

    def add(self, text: str) -> bool:
        """Put a layer on top: a theme, an image file, or all that the command line takes."""
        try:
            layer = parse_layer(text.strip())
        except InputError as error:
            self._session.say(str(error))
            return False
        added = self.change(self.stack.with_layer(layer))
        if added:
            self.selected = len(self.stack.layers) - 1
        return added

    def lay_image(self, image: TileSource, path: Path) -> None:
        """Put an image that is open already on top."""
        self.library.adopt(str(path), image)
        if self.change(self.stack.with_layer(Layer(path.name, (Key(str(path)),)))):
            self.selected = len(self.stack.layers) - 1
            self._session.say(" ".join([f"{image.name} lies on the terrain.", *image.notes]))

    def add_key(self, index: int, name: str) -> bool:
        """Give a layer another key frame, one unit of time after its last."""
        keys = self.stack.layers[index].keys
        return self.edit(index, keys=(*keys, Key(name.strip(), keys[-1].time + 1.0)))

    def remove(self, index: int) -> None:
        """Take a layer away."""
        self.change(self.stack.without(index))

    def move(self, index: int, steps: int) -> None:
        """Move a layer up or down; it stays selected."""
        self.change(self.stack.moved(index, steps))
        self.selected = min(max(index + steps, 0), len(self.stack.layers) - 1)

    def toggle_playing(self) -> None:
        """Let the animation run, or stop it."""
        self.is_playing = not self.is_playing
        self._session.touch()

    def set_time(self, time: float) -> None:
        """Go to a time of the animation."""
        self.change(replace(self.stack, time=time))

    def change_lens(self, **values: Any) -> None:
        """Change the lens."""
        self.change(replace(self.stack, lens=replace(self.stack.lens, **values)))

    def toggle_lens(self) -> None:
        """Show or hide the lens; where nothing belongs inside it, what lies outside is darkened."""
        lens = self.stack.lens
        dimming = lens.dimming if lens.is_on or lens.dimming > 0.0 else dimming_of(self.stack)
        self.change_lens(is_on=not lens.is_on, dimming=dimming)

    def point_at(self, pointer: tuple[float, float]) -> None:
        """Move the lens to the ground under a point of the picture, 0..1 each from the upper left corner."""
        point = self._session.navigation.point_under(pointer)
        if point is not None and (float(point[0]), float(point[2])) != self.stack.lens.centre_m:
            self.change_lens(centre_m=(float(point[0]), float(point[2])))

    def advance(self, pointer: tuple[float, float] | None, dt_s: float) -> None:
        """Let the lens follow the mouse, and the animation go on, from its end back to its beginning."""
        if pointer is not None and self.stack.lens.is_on and self._pointed != (pointer, self._session.camera):
            self._pointed = pointer, self._session.camera
            self.point_at(pointer)
        span = self.stack.time_range
        if not self.is_playing or span is None:
            return
        share = (self.stack.time - span[0]) / (span[1] - span[0]) + dt_s / ANIMATION_S
        self.set_time(span[0] + (share % 1.0 if share > 1.0 else share) * (span[1] - span[0]))

    @property
    def elsewhere(self) -> LayerStack:
        """The layers that another terrain can have too: those made from the terrain itself."""
        everywhere = [
            layer for layer in self.stack.layers
            if all(name in THEMES for name in (*(key.source for key in layer.keys), layer.visibility or "slope"))
        ]  # fmt: skip
        return LayerStack(tuple(everywhere), time=self.stack.time)

    @property
    def legend(self) -> Legend | None:
        """How to read the uppermost theme that is shown."""
        for layer in reversed(self.stack.shown):
            legend = self.library.legend(layer.between(self.stack.time)[0])
            if legend is not None:
                return legend
        return None

    def close(self) -> None:
        self.library.close()
