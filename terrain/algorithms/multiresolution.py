"""The approximation tree: which geometry patches of a terrain to draw for a view.

A patch is a quadtree node of 8 to 128 cells with meshes of guaranteed error. For a view the tree is descended while a
patch is near for its size; each patch then gets the coarsest rung of the error ladder whose visual error alpha stays
within the tolerance at the point of its box nearest to the eye.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", sections
"Generic multiresolution data structure" and "Rendering algorithm".

**Deviations** In the paper a patch has one error, and descending the tree refines it. Here a patch has a ladder of
meshes (`rtin`), and descending only keeps patches small against their distance, so that one error serves a whole patch.
The paper's alpha is an upright segment of the error's length, seen in perspective; here it is that segment seen
squarely, which is never less. Gamma never splits a patch of geometry: textures have trees of their own, which go on
below the finest patches (`terrain.textures.select`). About 15 % of the patches, where a grid serves worst, are
*microstructures*: they may get TINs in place of grid meshes (`patch_pool`). The paper left open how to find them.
Imported lines refine the cells they cross (`refined_cells`): patches near enough for a line to matter are split down to
it and drawn with every post.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from terrain.algorithms.culling import Culler, Nodes
from terrain.algorithms.refined_cells import PATCH_LEVEL, RefinedCells, load_refined
from terrain.algorithms.rtin import Ladder, Rtin, build_rtin
from terrain.algorithms.rtin_mesh import Patches
from terrain.breaklines import Breaklines
from terrain.cache import load_arrays, store_arrays
from terrain.frame import Frame
from terrain.heightfield import Heightfield
from terrain.pyramid import BASE_LEVEL

FINEST_LEVEL = PATCH_LEVEL  # patches of 8 cells ...
COARSEST_LEVEL = 7  # ... to 128
SPLIT_RATIO = 16.0  # a patch nearer than this many times its size is split: its far end is 9 % farther at most
MICROSTRUCTURE_SHARE = 0.15  # the paper: "about 15 % of the reference grid cells exhibit morphologically complex parts"
MARGIN = 0.97  # of the tolerance is used: 99.9 % of the pixels then stay within 0.8 of it on any terrain tried
PREVIEW_STRIDE = 4
CACHE_VERSION = 4
REFINED = -1  # the rung of refined patches: they have every post
LINES_SHARE = 0.5  # of the tolerance: lines that would shift the surface by less are left out

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ApproximationTree:
    """All geometry patches of a terrain, as the rungs of its vertices.

    Attributes
    ----------
    heightfield : Heightfield
    rtin : Rtin
        Made from every ``stride``-th post.
    microstructures : tuple of ndarray of bool
        For each level from FINEST_LEVEL on, the patches (row, col) to be triangulated freely.
    stride : int
        1, or PREVIEW_STRIDE in a preview, whose errors are bounds against every fourth post only.
    refined : RefinedCells or None
        What imported lines made of the cells they cross.
    """

    heightfield: Heightfield
    rtin: Rtin
    microstructures: tuple[Bools, ...]
    stride: int = 1
    refined: RefinedCells | None = None

    @cached_property
    def posts_m(self) -> npt.NDArray[np.float32]:
        """Heights of the posts the hierarchy is made from."""
        return _every_post(self.heightfield, self.stride)

    @property
    def coarsest_level(self) -> int:
        return self.rtin.top_level + (self.stride.bit_length() - 1)

    def meshed(self, patches: Patches) -> Patches:
        """The patches as the hierarchy counts them: in every ``stride``-th post."""
        return patches._replace(level=patches.level - np.int32(self.stride.bit_length() - 1))


def load_tree(heightfield: Heightfield, breaklines: Breaklines | None = None) -> ApproximationTree:
    """The tree of a height field, from the disk cache where it was built before; 4097 x 4097 posts take seconds.

    Raises
    ------
    InputError
        If the lines crowd in one cell.
    """
    key = f"{heightfield.sha256}-v{CACHE_VERSION}"
    top = _coarsest_level(heightfield)
    arrays = load_arrays("multiresolution", key)
    if arrays is not None and {"drop_rung", "ladder"} <= set(arrays):
        rtin = Rtin(arrays["drop_rung"], Ladder(*map(float, arrays["ladder"])), top)
    else:
        rtin = build_rtin(heightfield.heights_m, heightfield.spacing_m, top)
        if rtin.drop_rung.size > 1 << 18:  # smaller ones are quicker to build than to keep
            ladder = np.array([rtin.ladder.exact_m, rtin.ladder.base_m])
            store_arrays("multiresolution", key, {"drop_rung": rtin.drop_rung, "ladder": ladder})
    refined = None
    if breaklines is not None:
        refined = load_refined(heightfield, breaklines, rtin.drop_rung.shape, top)
    return ApproximationTree(heightfield, rtin, find_microstructures(rtin), refined=refined)


def build_preview(heightfield: Heightfield) -> ApproximationTree:
    """A tree over every fourth post, made in a fraction of the time: something to look at while the tree is built."""
    step = PREVIEW_STRIDE
    dx, dz = heightfield.spacing_m
    posts = _every_post(heightfield, step)
    top = _coarsest_level(heightfield) - (step.bit_length() - 1)
    return ApproximationTree(heightfield, build_rtin(posts, (dx * step, dz * step), top), (), step)


def _every_post(heightfield: Heightfield, step: int) -> npt.NDArray[np.float32]:
    """Every ``step``-th post, and at the far edges enough to cover all cells."""
    posts = heightfield.heights_m[::step, ::step]
    missing = [-(-(n - 1) // step) + 1 - m for n, m in zip(heightfield.heights_m.shape, posts.shape, strict=True)]
    return np.pad(posts, [(0, n) for n in missing], mode="edge") if any(missing) else posts


def _coarsest_level(heightfield: Heightfield) -> int:
    """Level of the largest patches: none larger than the grid needs."""
    cells = max(heightfield.rows, heightfield.cols) - 1
    return min(max((cells - 1).bit_length(), FINEST_LEVEL, BASE_LEVEL), COARSEST_LEVEL)


def find_microstructures(rtin: Rtin, share: float = MICROSTRUCTURE_SHARE) -> tuple[Bools, ...]:
    """The patches that need most vertices, summed over all rungs: there a TIN saves most.

    Parameters
    ----------
    rtin : Rtin
    share : float
        Largest share of the patches of a level; patches that every rung can leave empty never count.

    Returns
    -------
    tuple of ndarray of bool
        One per level from FINEST_LEVEL to the coarsest.
    """
    size = 1 << FINEST_LEVEL
    rungs = rtin.drop_rung[:-1, :-1]
    rungs = np.where(rungs == 255, 0, rungs)  # the corners are in every mesh
    need = rungs.reshape(rungs.shape[0] // size, size, rungs.shape[1] // size, size).sum(axis=(1, 3), dtype=np.int64)
    chosen = []
    for level in range(FINEST_LEVEL, rtin.top_level + 1):
        count = int(need.size * share)
        least = max(int(np.partition(need.ravel(), -count)[-count]), 1) if count else np.inf
        chosen.append(need >= least)
        if level < rtin.top_level:
            need = need[::2, ::2] + need[1::2, ::2] + need[::2, 1::2] + need[1::2, 1::2]
    return tuple(chosen)


def select_patches(
    tree: ApproximationTree, culler: Culler, frame: Frame, tolerance_px: float, *, horizon: bool = True
) -> tuple[Patches, Nodes]:
    """The patches to draw for a view, nearest first, and their nodes.

    Parameters
    ----------
    tree : ApproximationTree
    culler : Culler
        Of the same terrain, with FINEST_LEVEL.
    frame : Frame
    tolerance_px : float
        Largest allowed alpha.
    horizon : bool
        Whether to leave out what nearer ground hides.
    """
    nodes = culler.select(frame, horizon=horizon, split_ratio=SPLIT_RATIO)
    while (large := nodes.level > tree.coarsest_level).any():
        nodes = _split(nodes, large, culler)
    metres_per_px = MARGIN * tolerance_px / frame.pixels_per_radian
    if tree.refined is None:
        rung = tree.rtin.ladder.coarsest_within(metres_per_px * nodes.distance_m).astype(np.int32)
        return Patches(nodes.level, nodes.row, nodes.col, rung), nodes
    departure_m = _departures(tree.refined, nodes)
    while (shows := departure_m > LINES_SHARE * metres_per_px * nodes.distance_m)[nodes.level > FINEST_LEVEL].any():
        nodes = _split(nodes, shows & (nodes.level > FINEST_LEVEL), culler)
        departure_m = _departures(tree.refined, nodes)
    rung = tree.rtin.ladder.coarsest_within(metres_per_px * nodes.distance_m - departure_m).astype(np.int32)
    fine = np.flatnonzero(nodes.level == FINEST_LEVEL)
    rung[fine[tree.refined.index_of(nodes.row[fine], nodes.col[fine]) >= 0]] = REFINED
    return Patches(nodes.level, nodes.row, nodes.col, rung), nodes


def all_patches(tree: ApproximationTree, culler: Culler) -> tuple[Patches, Nodes]:
    """Every patch of the finest level with all there is of it, and its node: no level of detail, nothing culled."""
    shape = (-(-culler.cells[0] >> FINEST_LEVEL), -(-culler.cells[1] >> FINEST_LEVEL))
    row, col = (g.ravel().astype(np.int32) for g in np.indices(shape))
    level, rung = np.full_like(row, FINEST_LEVEL), np.zeros_like(row)
    if tree.refined is not None:
        rung[tree.refined.index_of(row, col) >= 0] = REFINED
    return Patches(level, row, col, rung), Nodes(level, row, col, np.zeros(len(row)))


def _departures(refined: RefinedCells, nodes: Nodes) -> npt.NDArray[np.float32]:
    """How far the lines in each node may take the surface from the posts' own [m]."""
    departure_m = np.zeros(len(nodes.level), np.float32)
    for level, of_level in enumerate(refined.departure_m, FINEST_LEVEL):
        here = np.flatnonzero(nodes.level == level)
        departure_m[here] = of_level[nodes.row[here], nodes.col[here]]
    return departure_m


def _split(nodes: Nodes, which: Bools, culler: Culler) -> Nodes:
    """The nodes with some replaced by their quarters inside the grid, which keep their distance."""
    quarters = np.array([[0, 0, 1, 1], [0, 1, 0, 1]], np.int32)
    count = np.where(which, 4, 1)
    owner = np.repeat(np.arange(len(which)), count)
    quarter = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    double = np.where(which, 2, 1)[owner].astype(np.int32)
    down = np.where(which[owner], quarters[:, quarter], 0).astype(np.int32)
    nodes = Nodes(
        nodes.level[owner] - (double - 1), nodes.row[owner] * double + down[0], nodes.col[owner] * double + down[1],
        nodes.distance_m[owner],
    )  # fmt: skip
    return nodes.take((nodes.row << nodes.level < culler.cells[0]) & (nodes.col << nodes.level < culler.cells[1]))
