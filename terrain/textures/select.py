"""Which tiles of a texture tree a view needs: the coarsest whose texels are still small enough on the screen.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Visual approximation errors": gamma is the area on the screen [px^2] of a texel's rectangle at the point of a box of
ground nearest to the eye. The climb of section "Recursive rendering", step 3, to the parent texture while its gamma
stays within the threshold is taken at once: gamma grows by 4 from level to level.

**Deviations** The paper's rectangle is level, so that gamma would vanish at the eye's own height and on every wall seen
from the side. Here it is tilted towards the eye as steeply as the box of ground is high for its width: exact on the
average for ground that rises through the box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.frame import Frame
from terrain.textures.tree import TILE_PX, Floats, Ints, TextureTree

Bools = npt.NDArray[np.bool_]

LEAST_SINE = 1.0 / 16.0  # ground seen flatter is treated as seen at this angle: blurred up to 4 px across, no further
SPLIT_TILES, SPLIT_RATIO = 2.0, 4.0  # boxes wider than so many tiles and than this part of their distance are split
MARGIN_PX = 1.0  # boxes of ground are this much larger in the image: a fragment's coordinate is rounded


class Selection(NamedTuple):
    """What a view needs of a tree.

    ``cell`` (n,): visible cells, as numbers of level 0; ``level`` (n,): the coarsest level that is fine enough there;
    ``tiles`` (m,): numbers of the tiles to be loaded, with their ancestors, in the order they are needed.
    """

    cell: Ints
    level: Ints
    tiles: Ints


def texel_errors_px2(tree: TextureTree, lower_m: Floats, upper_m: Floats, frame: Frame) -> tuple[Floats, Floats]:
    """Visual texture error gamma of level 0 and distance [m] of boxes of ground; level k has 4^k times as much.

    Parameters
    ----------
    tree : TextureTree
    lower_m, upper_m : ndarray of float64, (n, 3)
        Corners of boxes that bound visible ground, world metres.
    frame : Frame

    Returns
    -------
    gamma_px2, distance_m : ndarray of float64, (n,)
    """
    eye = frame.eye_m
    nearest = np.clip(eye, lower_m, upper_m) - eye
    distance = np.sqrt((nearest**2).sum(axis=1))
    away = np.maximum(distance, frame.near_m)
    size = upper_m - lower_m
    width = np.maximum(np.hypot(size[:, 0], size[:, 2]) / np.sqrt(2.0), 1e-9)
    sine = np.maximum(np.abs(nearest[:, 1]) / away, LEAST_SINE)
    tilted = np.minimum(sine + size[:, 1] / width, np.sqrt(1.0 + (size[:, 1] / width) ** 2))
    # The picture is flat: away from its centre things look larger, at most as much as in its corners.
    half = np.tan(np.radians(frame.camera.fov_deg) / 2.0)
    corner = 1.0 / np.sqrt(1.0 + half**2 * (1.0 + frame.aspect**2))
    cosine = np.clip(nearest @ frame.camera.forward / away, corner, 1.0)
    gamma = tree.pixel_m2 * (frame.pixels_per_radian / away) ** 2 * tilted / cosine**3
    return gamma, distance


def select_levels(
    tree: TextureTree, lower_m: Floats, upper_m: Floats, frame: Frame, tolerance_px2: float
) -> tuple[Ints, Floats]:
    """The coarsest level of each box whose gamma stays within the tolerance, and the distance of the box [m]."""
    gamma, distance = texel_errors_px2(tree, lower_m, upper_m, frame)
    level = np.floor(0.5 * np.log2(tolerance_px2 / np.maximum(gamma, 1e-300)))
    return np.clip(level, 0, tree.top_level).astype(np.int64), distance


def select_tiles(
    tree: TextureTree, lower_m: Floats, upper_m: Floats, frame: Frame, tolerance_px2: float, most_tiles: int = 1 << 30
) -> Selection:
    """The tiles that boxes of visible ground need.

    Parameters
    ----------
    tree : TextureTree
    lower_m, upper_m : ndarray of float64, (n, 3)
        Boxes of visible ground, world metres: from a `Culler`, or the patches of a renderer.
    frame : Frame
    tolerance_px2 : float
        Largest gamma, the area of a texel on the screen.
    most_tiles : int
        Where more would be needed, ancestors included, all levels become coarser until it is enough.

    Returns
    -------
    Selection
    """
    lower_m, upper_m = split_near(tree, lower_m, upper_m, frame, tolerance_px2)
    level, distance = select_levels(tree, lower_m, upper_m, frame, tolerance_px2)
    return select_for_levels(tree, lower_m, upper_m, level, distance, most_tiles=most_tiles)


def split_near(
    tree: TextureTree, lower_m: Floats, upper_m: Floats, frame: Frame, tolerance_px2: float
) -> tuple[Floats, Floats]:
    """Boxes of ground in smaller ones, where they are large for their distance and would need many tiles for it.

    Cells of a terrain may be as wide as many tiles of an image: not all of what is near the eye is as near.
    """
    done: list[tuple[Floats, Floats]] = []
    across_px = np.sqrt(1.0 / tree.pixel_m2)
    while len(lower_m):
        level, distance = select_levels(tree, lower_m, upper_m, frame, tolerance_px2)
        size = np.max((upper_m - lower_m)[:, [0, 2]], axis=1)
        large = (size * across_px > SPLIT_TILES * TILE_PX * 2.0**level) & (size > distance / SPLIT_RATIO)
        done.append((lower_m[~large], upper_m[~large]))
        low, high = lower_m[large], upper_m[large]
        middle = 0.5 * (low + high)
        quarters = [
            (np.where([west, True, north], low, middle), np.where([not west, True, not north], high, middle))
            for west in (True, False) for north in (True, False)
        ]  # fmt: skip
        lower_m, upper_m = (np.concatenate([quarter[i] for quarter in quarters]) for i in (0, 1))
        seen = in_view(lower_m, upper_m, frame)
        lower_m, upper_m = lower_m[seen], upper_m[seen]
    lower, upper = zip(*done, strict=True) if done else ((lower_m,), (upper_m,))
    return np.concatenate(lower), np.concatenate(upper)


def in_view(lower_m: Floats, upper_m: Floats, frame: Frame) -> Bools:
    """Which boxes reach into a frame, or into the tile of a picture that it is."""
    corner = np.where(frame.side_planes[:, None] > 0, upper_m, lower_m) - frame.eye_m  # farthest inwards
    return (np.einsum("pnk,pk->pn", corner, frame.side_planes) >= 0.0).all(axis=0)


def select_for_levels(
    tree: TextureTree, lower_m: Floats, upper_m: Floats, level: Ints, distance_m: Floats, seen: Bools | None = None,
    most_tiles: int = 1 << 30,
) -> Selection:  # fmt: skip
    """The tiles of boxes of ground whose levels are already chosen; see `select_tiles`.

    Where only some boxes are ``seen``, tiles are wanted for these alone, but at the levels that all boxes together ask
    for: so the tiles of a picture meet.
    """
    cell, level, distance = _cells_of(tree, lower_m, upper_m, level, distance_m, seen)
    while True:
        tiles = _in_order(tree, cell, level, distance)
        if len(tiles) <= most_tiles or (level == tree.top_level).all():
            return Selection(cell, level, tiles)
        level = np.minimum(level + 1, tree.top_level)


def _cells_of(
    tree: TextureTree, lower_m: Floats, upper_m: Floats, level: Ints, distance_m: Floats, seen: Bools | None
) -> tuple[Ints, Ints, Floats]:
    """Cells under seen boxes of ground, each once: number, finest level and smallest distance of all boxes over it."""
    (a, b, c), (d, e, f) = tree.px_from_ground.tolist()
    x, z = (np.stack([lower_m[:, axis], upper_m[:, axis]]) for axis in (0, 2))
    spans = []
    for along_x, along_z, offset, cells in ((d, e, f, tree.shapes[0, 0]), (a, b, c, tree.shapes[0, 1])):
        ends_x, ends_z = np.sort(along_x * x, axis=0), np.sort(along_z * z, axis=0)
        first = np.floor((ends_x[0] + ends_z[0] + offset - MARGIN_PX) / TILE_PX)
        last = np.floor((ends_x[1] + ends_z[1] + offset + MARGIN_PX) / TILE_PX)
        spans.append((np.maximum(first, 0).astype(np.int64), np.minimum(last, cells - 1).astype(np.int64)))
    (row0, row1), (col0, col1) = spans
    inside = np.flatnonzero((row0 <= row1) & (col0 <= col1))
    # Of several boxes over a cell the last one written stays: the finest level, the smallest distance.
    shape = tuple(tree.shapes[0])
    found = np.full(shape[0] * shape[1], -1, np.int64)
    near = np.zeros(found.shape)
    wanted = found if seen is None else np.full(found.shape, -1, np.int64)
    steps = [
        (level, found, np.argsort(-level[inside], kind="stable")),
        (distance_m, near, np.argsort(-distance_m[inside], kind="stable")),
    ]
    if seen is not None:
        steps.append((level, wanted, np.flatnonzero(seen[inside])))
    for values, into, order in steps:
        box = inside[order]
        width = col1[box] - col0[box] + 1
        count = width * (row1[box] - row0[box] + 1)
        owner = np.repeat(np.arange(len(box)), count)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        row, col = row0[box][owner] + within // width[owner], col0[box][owner] + within % width[owner]
        into[row * shape[1] + col] = values[box][owner]
    cell = np.flatnonzero(wanted >= 0)
    return cell, found[cell], near[cell]


def _in_order(tree: TextureTree, cell: Ints, level: Ints, distance: Floats) -> Ints:
    """The tiles of cells and all their ancestors: coarse ones first, of one level the nearest first.

    So a picture sharpens evenly, there always is an ancestor to show, and none is evicted before its descendants.
    """
    row, col = cell // tree.shapes[0, 1], cell % tree.shapes[0, 1]
    tiles: list[Ints] = []
    key, near = np.zeros(0, np.int64), np.zeros(0)
    for k in range(tree.top_level + 1):
        width = tree.shapes[k, 1]
        if k:  # parents of the tiles of the level before
            finer = tree.shapes[k - 1, 1]
            key = (key // finer // 2) * width + key % finer // 2
        own = level == k
        key = np.concatenate([key, (row[own] >> k) * width + (col[own] >> k)])
        near = np.concatenate([near, distance[own]])
        order = np.lexsort((near, key))
        key, near = key[order], near[order]
        first = np.ones(len(key), np.bool_)
        first[1:] = key[1:] != key[:-1]
        key, near = key[first], near[first]
        if k == tree.top_level and not len(key):
            key, near = np.zeros(1, np.int64), np.zeros(1)  # the root is always wanted
        tiles.append(tree.number_of(k, 0, 0) + key[np.argsort(near, kind="stable")])
    return np.concatenate(tiles[::-1])
