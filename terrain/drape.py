"""What lies over the ground: layers of images and themes, and the tiles of their images that a frame needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from terrain.algorithms.culling import Culler
from terrain.errors import InputError
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.frame_block import MOST_LAYERS
from terrain.renderers.base import Boxes
from terrain.scene import Scene
from terrain.textures.layers import LayerStack, layer_uniforms
from terrain.textures.tree import TileSource
from terrain.textures.trees import TREE_LIMIT, Trees

FINEST_GROUND, GROUND_SPLIT = 3, 8.0  # visible ground in boxes of 8 cells, or an eighth of their distance


class Drape:
    """The layers of one scene and the texture trees of their images.

    Attributes
    ----------
    stack : LayerStack
        What lies over the ground.
    trees : Trees
    """

    def __init__(self, gpu: Gpu, scene: Scene, budget_bytes: int) -> None:
        terrain = scene.heightfield
        self._scene = scene
        self.stack = LayerStack()
        self.trees = Trees(gpu, terrain.spacing_m, (terrain.cols, terrain.rows), budget_bytes)
        self._sources: Mapping[str, TileSource] = {}
        self._tree_of: dict[str, tuple[int, TileSource]] = {}
        self._culler: Culler | None = None  # of visible ground

    def lay(self, stack: LayerStack, sources: Mapping[str, TileSource]) -> None:
        """Lay other layers over the ground.

        Parameters
        ----------
        stack : LayerStack
        sources : mapping
            The image of every name that a layer shown refers to.

        Raises
        ------
        InputError
            If there are more of them, or more images, than can be shown at once; then nothing has changed.
        """
        if len(stack.shown) > MOST_LAYERS:
            raise InputError(f"Expected at most {MOST_LAYERS} layers at once, found {len(stack.shown)}: hide some.")
        wanted = stack.following_sources
        if len(wanted) > TREE_LIMIT:
            wanted = stack.sources
        if len(wanted) > TREE_LIMIT:
            raise InputError(f"Expected at most {TREE_LIMIT} images at once, found {len(wanted)}: hide some layers.")
        for name, (number, source) in list(self._tree_of.items()):
            if name not in wanted or sources[name] is not source:
                self.trees.remove(number)
                del self._tree_of[name]
        for name in wanted:
            if name not in self._tree_of:
                self._tree_of[name] = self.trees.add(sources[name]), sources[name]
        self.stack, self._sources = stack, sources

    def go_to(self, time: float) -> None:
        """Show the layers at a time of their key frames."""
        self.lay(replace(self.stack, time=time), self._sources)

    def uniforms(self) -> dict[str, Any]:
        """What the layers decide of the frame's uniform block."""
        terrain, lens = self._scene.heightfield, self.stack.lens
        col, row = (at / step for at, step in zip(lens.centre_m, terrain.spacing_m, strict=True))
        ground_of_lens = (col + 0.5) / terrain.cols, (row + 0.5) / terrain.rows
        numbers = {name: number for name, (number, _) in self._tree_of.items()}
        return layer_uniforms(self.stack, numbers, ground_of_lens)._asdict()

    def stream(self, frame: Frame, patches: Boxes | None, tolerance_px2: float) -> None:
        """Bring the tiles up to date for what a frame sees of the ground, as far as they are read, and bind them.

        Parameters
        ----------
        frame : Frame
        patches : tuple or None
            The patches of ground that the renderer draws; None where it tells none.
        tolerance_px2 : float
            How much of the screen a texel may cover.
        """
        if self.trees.count:
            self._choose(frame, patches, tolerance_px2)
            self.trees.bind()

    def load(self, frame: Frame, patches: Boxes | None, tolerance_px2: float, within_s: float) -> bool:
        """Read on for a moment what a frame needs; whether all of it is there.

        Raises
        ------
        InputError
            If nothing at all of an image can be read.
        """
        self._choose(frame, patches, tolerance_px2)
        if self.trees.is_loading:
            self.trees.wait(within_s)
            return False
        self.trees.check()
        return True

    def _choose(self, frame: Frame, patches: Boxes | None, tolerance_px2: float) -> None:
        if patches is not None:
            lower_m, upper_m, _ = patches
        else:
            if self._culler is None:
                self._culler = Culler(self._scene, FINEST_GROUND)
            lower_m, upper_m = self._culler.boxes(self._culler.select(frame.whole, split_ratio=GROUND_SPLIT))
        self.trees.update(frame, lower_m, upper_m, tolerance_px2)
