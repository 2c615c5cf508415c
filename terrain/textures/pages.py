"""Which tiles are resident, where, and what is shown in place of those that are not.

The atlas has a fixed number of slots for the tiles of all trees. A slot is given to another tile only if its own was
not needed in this frame, the one longest unused first. The *page table* says for every cell (tile of level 0) in which
slot to look: in that of the finest resident tile over it that is no finer than wanted, which in the worst case is the
root of its tree.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.textures.select import Selection
from terrain.textures.tree import Ints, TextureTree

ABSENT, FAILED = -1, -2


class Slots:
    """Slots and their tiles: least recently used first out.

    Parameters
    ----------
    count : int
        Number of slots.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.used = 0  # slots that hold a tile
        self._tree = np.full(count, -1, np.int64)
        self._tile = np.full(count, -1, np.int64)
        self._last = np.full(count, -1, np.int64)  # frame of the last use

    def touch(self, slots: Ints, frame: int) -> None:
        """Mark slots as needed in a frame."""
        self._last[slots] = frame

    def take(self, tree: int, tile: int, frame: int) -> tuple[int, tuple[int, int] | None] | None:
        """A slot for a tile and the (tree, tile) that had to leave it; None if all are needed in this frame."""
        slot = int(self._last.argmin())
        if self._last[slot] >= frame:
            return None
        evicted = (int(self._tree[slot]), int(self._tile[slot])) if self._tree[slot] >= 0 else None
        self.used += evicted is None
        self._tree[slot], self._tile[slot], self._last[slot] = tree, tile, frame
        return slot, evicted

    def drop_tree(self, tree: int) -> None:
        """Free all slots of a tree."""
        own = self._tree == tree
        self.used -= int(own.sum())
        self._tree[own] = self._tile[own] = self._last[own] = -1

    def grow(self, count: int) -> None:
        """Add free slots behind the others."""
        more = np.full(count - self.count, -1, np.int64)
        self._tree, self._tile, self._last = (np.append(a, more) for a in (self._tree, self._tile, self._last))
        self.count = count


class Pages:
    """The resident tiles of one tree."""

    def __init__(self, tree: TextureTree) -> None:
        self.tree = tree
        self.slot = np.full(tree.tile_count, ABSENT, np.int64)  # of every tile; or ABSENT, or FAILED
        self.revision = np.zeros(tree.tile_count, np.int64)  # of its content

    def missing(self, tiles: Ints, revision: int) -> npt.NDArray[np.bool_]:
        """Of tiles, those that are not resident in their newest revision (and did not fail in it)."""
        return (self.slot[tiles] == ABSENT) | (self.revision[tiles] != revision)

    def shown(self, selection: Selection) -> tuple[Ints, Ints]:
        """Slot and level shown in each cell of a selection; slot ABSENT where not even the root is resident yet."""
        tree = self.tree
        row, col = selection.cell // tree.shapes[0, 1], selection.cell % tree.shapes[0, 1]
        slot = np.full(len(row), ABSENT, np.int64)
        level = np.full(len(row), tree.top_level, np.int64)
        for k in range(tree.top_level, -1, -1):
            found = self.slot[tree.number_of(k, row >> k, col >> k)]
            better = (found >= 0) & (selection.level <= k)
            slot, level = np.where(better, found, slot), np.where(better, k, level)
        return slot, level
