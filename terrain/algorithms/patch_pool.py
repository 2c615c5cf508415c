"""Triangles of geometry patches, made when first wanted and kept: what to send to the GPU for a choice of patches.

Storing every mesh of every patch would take a hundred million triangles for 4097 x 4097 posts; a view needs a few
thousand patches, and a step of the camera a few new ones. Missing meshes are extracted all at once. *Microstructures*
may get a TIN of the same rim and the same error in place of the grid mesh. Measured at 1025 x 1025 posts, one pixel
allowed: TINs of the 15 % save 6 % of all triangles on mountains (a quarter of a millisecond of drawing), nothing in a
city, and take 10 to 80 ms each, seconds for a view: so they are an option.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", sections
"Approximation strategies" and "Implementation issues" (patches kept as display lists).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from terrain.algorithms.multiresolution import FINEST_LEVEL, REFINED, ApproximationTree
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
        if not len(slots):
            return np.empty(0, np.int32)
        begin = self._starts[slots]
        end = begin + self._lengths[slots]
        # New meshes are stored in the order in which they are drawn: neighbours there are copied together.
        breaks = np.flatnonzero(begin[1:] != end[:-1])
        runs = zip(begin[np.r_[0, breaks + 1]].tolist(), end[np.r_[breaks, -1]].tolist(), strict=True)
        return np.concatenate([self._posts[first:last] for first, last in runs])

    def walls(self, patches: Patches) -> npt.NDArray[np.float32]:
        """Triangles (m, 3, 5) of the walls between the patches; see `build_walls`."""
        finest = FINEST_LEVEL - (self.tree.stride.bit_length() - 1)
        walls = build_walls(self.tree.rtin, self.tree.meshed(patches), finest, self.tree.posts_m)
        if self.tree.refined is None:
            return walls
        lined = patches.take(patches.rung == REFINED)
        return np.concatenate([walls, self.tree.refined.fins_of(self.tree.refined.index_of(lined.row, lined.col))])

    def count_tins(self, patches: Patches) -> int:
        """How many of the patches are drawn as TINs."""
        slots = self._slots_of(patches)
        return int(np.count_nonzero(self._is_tin[slots]))

    def waiting_tins(self, patches: Patches) -> Patches:
        """The microstructures among the patches for which no TIN has been tried yet."""
        found = np.flatnonzero(self._is_microstructure(patches))
        slots = self._slots_of(patches.take(found))
        return patches.take(found[~self._tried[slots]])

    def add_tins(self, patches: Patches, tins: Sequence[Ints | None]) -> None:
        """Replace grid meshes by what `triangulate` gave, where that takes fewer triangles."""
        for slot, posts in zip(self._slots_of(patches).tolist(), tins, strict=True):
            self._tried[slot] = True
            if posts is not None and len(posts) < self._lengths[slot]:
                self._starts[slot], self._lengths[slot] = self._append(posts), len(posts)
                self._is_tin[slot] = True

    @property
    def resident_bytes(self) -> int:
        return 4 * self._used

    def _drop_all(self) -> None:
        self._keys: Keys = np.empty(0, np.int64)  # sorted
        self._order: Keys = np.empty(0, np.int64)  # slot of each key
        self._starts: Keys = np.empty(0, np.int64)
        self._lengths: Keys = np.empty(0, np.int64)
        self._tried = np.empty(0, np.bool_)
        self._is_tin = np.empty(0, np.bool_)
        self._posts: Ints = np.empty(1 << 22, np.int32)  # memory is only taken as it is filled
        self._used = 0

    def _slots_of(self, patches: Patches) -> Keys:
        """The place of each patch's mesh, which is extracted where it is missing."""
        keys = _keys_of(patches)
        at, known = self._find(keys)
        missing = np.flatnonzero(~known)
        self.extracted = len(missing)
        if self.extracted:
            if self._used > self.limit:
                self._drop_all()
                missing = np.arange(len(keys))
            self._extract(patches.take(missing), keys[missing])
            at, _ = self._find(keys)
        return self._order[at]

    def _find(self, keys: Keys) -> tuple[Keys, npt.NDArray[np.bool_]]:
        """Place of each key among the sorted ones, and whether it is there."""
        at = np.searchsorted(self._keys, keys)
        inside = np.minimum(at, len(self._keys) - 1)
        known = self._keys[inside] == keys if len(self._keys) else np.zeros(len(keys), np.bool_)
        return inside, known

    def _extract(self, patches: Patches, keys: Keys) -> None:
        """Add the meshes of new patches; of one that comes several times, each."""
        first_slot = len(self._starts)
        triangles, starts, lengths = self._meshes_of(patches)
        self._starts = np.concatenate([self._starts, self._append(triangles.ravel()) + 3 * starts])
        self._lengths = np.concatenate([self._lengths, 3 * lengths])
        fresh = np.zeros(len(keys), np.bool_)
        self._tried, self._is_tin = (np.concatenate([a, fresh]) for a in (self._tried, self._is_tin))
        order = np.argsort(keys)
        at = np.searchsorted(self._keys, keys[order])
        self._keys = np.insert(self._keys, at, keys[order])
        self._order = np.insert(self._order, at, first_slot + order)

    def _meshes_of(self, patches: Patches) -> tuple[Ints, Keys, Keys]:
        """Triangles of some patches, cut from the hierarchy or, where lines refine them, made before; where those of
        each patch start and how many there are."""
        lined = patches.rung == REFINED
        meshes = extract_meshes(self.tree.rtin, self.tree.meshed(patches.take(~lined)))
        if self.tree.refined is None or not lined.any():
            return meshes.triangles, meshes.starts[:-1], np.diff(meshes.starts)
        refined = self.tree.refined
        at = refined.index_of(patches.row[lined], patches.col[lined])
        lists = [refined.triangles[first:last] for first, last in zip(*refined.spans(at).tolist(), strict=True)]
        starts, lengths = np.empty(len(lined), np.int64), np.empty(len(lined), np.int64)
        starts[~lined], lengths[~lined] = meshes.starts[:-1], np.diff(meshes.starts)
        lengths[lined] = [len(triangles) for triangles in lists]
        starts[lined] = len(meshes.triangles) + np.cumsum(lengths[lined]) - lengths[lined]
        return np.concatenate([meshes.triangles, *lists]), starts, lengths

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
        found &= patches.rung != REFINED
        for i, chosen in enumerate(self.tree.microstructures):
            here = np.flatnonzero(found & (patches.level == FINEST_LEVEL + i))
            found[here] = chosen[patches.row[here], patches.col[here]]
        return found & (patches.level < FINEST_LEVEL + len(self.tree.microstructures))


def triangulate(tree: ApproximationTree, patches: Patches) -> list[Ints | None]:
    """Post numbers of the triangles of a TIN for each patch; None where it would need too many points."""
    return [_tin_posts(tree, *(int(a[i]) for a in patches)) for i in range(len(patches.level))]


def _tin_posts(tree: ApproximationTree, level: int, row: int, col: int, rung: int) -> Ints | None:
    terrain, rtin = tree.heightfield, tree.rtin
    north, west, size = row << level, col << level, 1 << level
    inside = (slice(north, north + size + 1), slice(west, west + size + 1))
    error_m = float(rtin.ladder.error_m(rung))
    tin = greedy_tin(terrain.heights_m[inside], rtin.drop_rung[inside] > rung, error_m, MAX_TIN_POINTS)
    if tin is None:
        return None
    posts = (tin.row + north) * rtin.drop_rung.shape[1] + tin.col + west
    return posts[tin.triangles].astype(np.int32).ravel()


def _keys_of(patches: Patches) -> Keys:
    """One whole number per (patch, rung)."""
    level, row, col, rung = (a.astype(np.int64) for a in patches)
    return ((level << 8 | (rung + 1)) << 24 | row) << 24 | col
