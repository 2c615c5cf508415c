"""Triangles of geometry patches, made when first wanted and kept: what to send to the GPU for a choice of patches.

Storing every mesh of every patch would take a hundred million triangles for 4097 x 4097 posts; a view needs a few
thousand patches, and a step of the camera a few new ones. Missing meshes are extracted all at once. *Microstructures*
are first drawn with the grid mesh, and later, when there is time, with a TIN of the same rim and the same error.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", sections
"Approximation strategies" and "Implementation issues" (patches kept as display lists).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.algorithms.multiresolution import FINEST_LEVEL, ApproximationTree
from terrain.algorithms.rtin_mesh import Patches, extract_meshes
from terrain.algorithms.tin import greedy_tin
from terrain.algorithms.walls import build_walls

POOL_LIMIT = 1 << 26  # post numbers kept, 256 MiB: beyond, all is dropped and the view extracted anew
MAX_TIN_POINTS = 256  # the paper's s

Ints = npt.NDArray[np.int32]
Keys = npt.NDArray[np.int64]


class PatchPool:
    """Meshes by (patch, rung).

    Parameters
    ----------
    tree : ApproximationTree
    limit : int
        Post numbers to keep at most, beside those of the view at hand.
    """

    def __init__(self, tree: ApproximationTree, limit: int = POOL_LIMIT) -> None:
        self.tree, self.limit = tree, limit
        self.extracted = 0  # meshes made by the last `gather`
        self._drop_all()

    def gather(self, patches: Patches) -> Ints:
        """Post numbers (3 m,) of the triangles of all patches, one patch after another, in their order."""
        slots = self._slots_of(patches)
        starts, lengths = self._starts[slots], self._lengths[slots]
        ends = np.cumsum(lengths)
        place = np.arange(ends[-1] if len(ends) else 0) + np.repeat(starts - (ends - lengths), lengths)
        return self._posts[place]

    def walls(self, patches: Patches) -> npt.NDArray[np.float32]:
        """Triangles (m, 3, 4) of the walls between the patches; see `build_walls`."""
        finest = FINEST_LEVEL - (self.tree.stride.bit_length() - 1)
        return build_walls(self.tree.rtin, self.tree.meshed(patches), finest, self.tree.posts_m)

    def count_tins(self, patches: Patches) -> int:
        """How many of the patches are drawn as TINs."""
        slots = self._slots_of(patches)
        return int(np.count_nonzero(self._is_tin[slots]))

    def refine(self, patches: Patches, count: int) -> int:
        """Make TINs for at most ``count`` microstructures among the patches, first come first served.

        Returns
        -------
        int
            How many were tried; 0 when every microstructure among the patches has been.
        """
        waiting = np.flatnonzero(self._is_microstructure(patches))
        slots = self._slots_of(patches.take(waiting))
        waiting = waiting[~self._tried[slots]][:count]
        for i in waiting:
            self._triangulate(patches.take(np.array([i])))
        return len(waiting)

    @property
    def resident_bytes(self) -> int:
        return self._posts.nbytes

    def _drop_all(self) -> None:
        self._keys: Keys = np.empty(0, np.int64)  # sorted
        self._order: Keys = np.empty(0, np.int64)  # slot of each key
        self._starts: Keys = np.empty(0, np.int64)
        self._lengths: Keys = np.empty(0, np.int64)
        self._tried = np.empty(0, np.bool_)
        self._is_tin = np.empty(0, np.bool_)
        self._posts: Ints = np.empty(1 << 16, np.int32)
        self._used = 0

    def _slots_of(self, patches: Patches) -> Keys:
        """The place of each patch's mesh, which is extracted where it is missing."""
        keys = _keys_of(patches)
        at, known = self._find(keys)
        self.extracted = int(np.count_nonzero(~known))
        if self.extracted:
            if self._used > self.limit:
                self._drop_all()
                known[:] = False
            missing = np.unique(keys[~known], return_index=True)[1]
            self._extract(patches.take(np.flatnonzero(~known)[missing]))
            at, _ = self._find(keys)
        return self._order[at]

    def _find(self, keys: Keys) -> tuple[Keys, npt.NDArray[np.bool_]]:
        """Place of each key among the sorted ones, and whether it is there."""
        at = np.searchsorted(self._keys, keys)
        inside = np.minimum(at, len(self._keys) - 1)
        known = self._keys[inside] == keys if len(self._keys) else np.zeros(len(keys), np.bool_)
        return inside, known

    def _extract(self, patches: Patches) -> None:
        """Add the meshes of new patches, sorted by key."""
        meshes = extract_meshes(self.tree.rtin, self.tree.meshed(patches))
        first_slot, keys = len(self._starts), _keys_of(patches)
        self._starts = np.concatenate([self._starts, self._append(meshes.triangles.ravel()) + meshes.starts[:-1] * 3])
        self._lengths = np.concatenate([self._lengths, np.diff(meshes.starts) * 3])
        fresh = np.zeros(len(keys), np.bool_)
        self._tried, self._is_tin = (np.concatenate([a, fresh]) for a in (self._tried, self._is_tin))
        at = np.searchsorted(self._keys, keys)
        self._keys = np.insert(self._keys, at, keys)
        self._order = np.insert(self._order, at, first_slot + np.arange(len(keys)))

    def _append(self, posts: Ints) -> int:
        """Store post numbers; returns where they start."""
        start = self._used
        self._used += len(posts)
        if self._used > len(self._posts):
            grown = np.empty(max(2 * len(self._posts), self._used), np.int32)
            grown[:start] = self._posts[:start]
            self._posts = grown
        self._posts[start : self._used] = posts
        return start

    def _is_microstructure(self, patches: Patches) -> npt.NDArray[np.bool_]:
        """Whether each patch is a microstructure that lies wholly inside the grid."""
        terrain = self.tree.heightfield
        size = np.left_shift(1, patches.level)
        found = ((patches.row + 1) * size < terrain.rows) & ((patches.col + 1) * size < terrain.cols)
        for i, chosen in enumerate(self.tree.microstructures):
            here = np.flatnonzero(found & (patches.level == FINEST_LEVEL + i))
            found[here] = chosen[patches.row[here], patches.col[here]]
        return found & (patches.level < FINEST_LEVEL + len(self.tree.microstructures))

    def _triangulate(self, patch: Patches) -> None:
        """Replace one patch's grid mesh by a TIN, if that takes fewer triangles."""
        slot = int(self._slots_of(patch)[0])
        self._tried[slot] = True
        level, row, col, rung = (int(a[0]) for a in patch)
        terrain, rtin = self.tree.heightfield, self.tree.rtin
        north, west = row << level, col << level
        size = 1 << level
        inside = (slice(north, north + size + 1), slice(west, west + size + 1))
        error_m = float(rtin.ladder.error_m(rung))
        tin = greedy_tin(terrain.heights_m[inside], rtin.drop_rung[inside] > rung, error_m, MAX_TIN_POINTS)
        if tin is None or 3 * len(tin.triangles) >= self._lengths[slot]:
            return
        posts = (tin.row.astype(np.int64) + north) * rtin.drop_rung.shape[1] + tin.col.astype(np.int64) + west
        self._starts[slot] = self._append(posts[tin.triangles].astype(np.int32).ravel())
        self._lengths[slot] = 3 * len(tin.triangles)
        self._is_tin[slot] = True


def _keys_of(patches: Patches) -> Keys:
    """One whole number per (patch, rung)."""
    level, row, col, rung = (a.astype(np.int64) for a in patches)
    return ((level << 8 | rung) << 24 | row) << 24 | col
