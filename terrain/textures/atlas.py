"""The GPU's side of texture trees: one array texture with slots for tiles, and one with a page table per tree.

Any number of trees costs two texture units. ``shaders/lib/pages.glsl`` reads both.
"""

from __future__ import annotations

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.gpu.context import Gpu
from terrain.gpu.programs import UNITS
from terrain.textures.tree import BORDER_PX, SLOT_BYTES, SLOT_PX, TILE_PX, Ints, Pixels

SLOTS_PER_SIDE = 4  # of a layer
SLOTS_PER_LAYER = SLOTS_PER_SIDE * SLOTS_PER_SIDE
LAYER_PX = SLOTS_PER_SIDE * SLOT_PX
LAYER_BYTES = SLOTS_PER_LAYER * SLOT_BYTES

Table = npt.NDArray[np.float32]


class Atlas:
    """Slots for tiles, never more than fit into a budget.

    Parameters
    ----------
    gpu : Gpu
    budget_bytes : int
        What the slots may take; at least one layer of `SLOTS_PER_LAYER` is there in any case.
    """

    def __init__(self, gpu: Gpu, budget_bytes: int) -> None:
        self._gpu = gpu
        most_layers = int(gpu.ctx.info["GL_MAX_ARRAY_TEXTURE_LAYERS"])
        self.most_slots = SLOTS_PER_LAYER * min(max(budget_bytes // LAYER_BYTES, 1), most_layers)
        self.slots = 0
        self._texture: moderngl.TextureArray | None = None

    @property
    def allocated_bytes(self) -> int:
        return self.slots * SLOT_BYTES

    def grow(self, slots: int) -> None:
        """Have room for at least that many slots, as far as the budget goes; what is in them stays."""
        layers = -(-min(slots, self.most_slots) // SLOTS_PER_LAYER)
        if layers * SLOTS_PER_LAYER <= self.slots:
            return
        old = self._texture
        self._texture = texture = self._gpu.ctx.texture_array((LAYER_PX, LAYER_PX, layers), 4)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        if old is not None:
            texture.write(old.read(), viewport=(0, 0, 0, LAYER_PX, LAYER_PX, old.layers))
            old.release()
        self.slots = layers * SLOTS_PER_LAYER

    def write(self, slot: int, pixels: Pixels) -> None:
        """Fill a slot with a tile (SLOT_PX, SLOT_PX, 4)."""
        assert self._texture is not None
        x, y, layer = (int(v) for v in slot_places(np.array([slot]))[0])
        self._texture.write(pixels, viewport=(x * SLOT_PX, y * SLOT_PX, layer, SLOT_PX, SLOT_PX, 1))

    def bind(self) -> None:
        if self._texture is not None:
            self._texture.use(UNITS["u_atlas"])

    def release(self) -> None:
        if self._texture is not None:
            self._texture.release()
            self._texture = None
        self.slots = 0


class PageTables:
    """An entry per cell and tree: in which layer of the atlas to look, and where for which pixel."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._texture: moderngl.TextureArray | None = None
        self._written: dict[int, Table] = {}  # as the GPU has them

    def write(self, tree: int, table: Table, first: int, last: int) -> None:
        """Bring the rows [first, last) of a tree's table (rows, cols, 4) up to date; all of it the first time."""
        self._make_room(table.shape[1], table.shape[0], tree + 1)
        old = self._written.get(tree)
        if old is None or old.shape != table.shape:
            self._written[tree] = table.copy()
            first, last = 0, len(table)
        elif np.array_equal(old[first:last], table[first:last]):
            return
        else:
            old[first:last] = table[first:last]
        self._upload(tree, first, last)

    def drop(self, tree: int) -> None:
        """Forget the table of a tree that is no more."""
        self._written.pop(tree, None)

    def bind(self) -> None:
        if self._texture is not None:
            self._texture.use(UNITS["u_pages"])

    def release(self) -> None:
        if self._texture is not None:
            self._texture.release()
            self._texture = None
        self._written.clear()

    def _upload(self, tree: int, first: int, last: int) -> None:
        assert self._texture is not None
        rows = np.ascontiguousarray(self._written[tree][first:last])
        self._texture.write(rows, viewport=(0, first, tree, rows.shape[1], last - first, 1))

    def _make_room(self, cols: int, rows: int, trees: int) -> None:
        """Have a texture of at least that size, with all tables that were written."""
        old = self._texture
        if old is not None:
            if cols <= old.width and rows <= old.height and trees <= old.layers:
                return
            cols, rows, trees = max(cols, old.width), max(rows, old.height), max(trees, old.layers)
            old.release()
        self._texture = self._gpu.ctx.texture_array((cols, rows, trees), 4, dtype="f4")
        self._texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        for tree, table in self._written.items():
            self._upload(tree, 0, len(table))


def slot_places(slots: Ints) -> Ints:
    """(n, 3): column, row and layer of slots in the atlas."""
    within = slots % SLOTS_PER_LAYER
    return np.stack([within % SLOTS_PER_SIDE, within // SLOTS_PER_SIDE, slots // SLOTS_PER_LAYER], axis=-1)


def page_entries(slots: Ints, levels: Ints, rows: Ints, cols: Ints) -> Table:
    """(n, 4): entries of the page table for cells, whose tiles of some levels are in some slots (below 0: in none).

    A pixel of level 0 is found at texel ``entry[:2] + entry[2] * pixel`` of layer ``entry[3]``.
    """
    entries = np.empty((len(slots), 4), np.float32)
    places = slot_places(np.maximum(slots, 0))
    for axis, at in enumerate((cols, rows)):
        entries[:, axis] = places[:, axis] * SLOT_PX + BORDER_PX - (at >> levels) * TILE_PX
    entries[:, 2] = 2.0 ** -levels.astype(np.float64)
    entries[:, 3] = np.where(slots < 0, -1, places[:, 2])
    return entries
