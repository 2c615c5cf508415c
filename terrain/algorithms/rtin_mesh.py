"""Cutting meshes and their walls out of the right-triangulated hierarchy, for many square patches at once.

A patch of level l covers 2^l x 2^l cells; its mesh at rung r is the part of the whole terrain's mesh at that rung that
lies in the patch, refined where it must be to have the patch's corners. Meshes are lists of *post numbers*: row times
the padded row length plus column. No vertex is stored anywhere: the vertex shader finds a post's place from its number
and its height in the height texture.

**Source** W. Evans, D. Kirkpatrick, G. Townsend, "Right-triangulated irregular networks", Algorithmica 30 (2001).
Walls: J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Recursive rendering of approximation trees".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.rtin import Rtin

Ints = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]

FOOT = 1 << 30
"""Set in a post number: the post's copy at the foot of a wall."""


class Patches(NamedTuple):
    """Square patches: ``level``, ``row`` and ``col`` counted in patches of that level, and ``rung``; all (n,) int32."""

    level: Ints
    row: Ints
    col: Ints
    rung: Ints

    def take(self, which: npt.NDArray[np.intp] | Bools) -> Patches:
        """Some of the patches."""
        return Patches(*(a[which] for a in self))


class Meshes(NamedTuple):
    """Triangles (m, 3) of int32 post numbers, counter-clockwise from above, patch after patch; patch i owns
    ``triangles[starts[i]:starts[i + 1]]``."""

    triangles: Ints
    starts: npt.NDArray[np.int64]


def extract_meshes(rtin: Rtin, patches: Patches) -> Meshes:
    """The meshes of all patches, refined together, level by level.

    Inside a patch triangles follow the curve of the hierarchy: each shares an edge with the one before.
    """
    drop_rung, stride = rtin.drop_rung.ravel(), rtin.drop_rung.shape[1]
    count = len(patches.level)
    corner = (patches.row << patches.level) * stride + (patches.col << patches.level)
    size = np.left_shift(np.int32(1), patches.level)
    nw, ne, sw, se = corner, corner + size, corner + size * stride, corner + size * (stride + 1)
    odd = ((patches.row + patches.col) % 2 == 1)[:, None]
    # (hypotenuse's two ends, apex): the south-west and north-east halves, or the north-west and south-east ones.
    first = np.where(odd, np.stack([sw, ne, nw], 1), np.stack([se, nw, sw], 1))
    second = np.where(odd, np.stack([ne, sw, se], 1), np.stack([nw, se, ne], 1))
    roots = np.stack([first, second], 1).astype(np.int32)  # (patch, 2, 3)

    coarsest = int(patches.level.max(initial=0))
    active = np.empty((0, 3), np.int32)
    owner = np.empty(0, np.int32)
    place = np.empty(0, np.int32)  # position along the patch's curve: the path, as bits from the top
    done: list[tuple[Ints, Ints, Ints]] = []
    for step in range(2 * coarsest + 1):
        if step % 2 == 0:  # the patches that are diagonal cells of this size join
            joining = np.flatnonzero(patches.level == coarsest - step // 2).astype(np.int32)
            if len(joining):
                active = np.concatenate([active, roots[joining].reshape(-1, 3)])
                owner = np.concatenate([owner, np.repeat(joining, 2)])
                half = np.int32(1 << (2 * coarsest - step))
                place = np.concatenate([place, np.tile(np.array([0, half], np.int32), len(joining))])
        middle = (active[:, 0] + active[:, 1]) >> 1
        splits = drop_rung[middle] > patches.rung[owner]
        if step == 2 * coarsest:
            splits[:] = False  # legs of one cell: nothing lies between the posts
        keep = ~splits
        done.append((active[keep], owner[keep], place[keep]))
        active, owner, place, middle = active[splits], owner[splits], place[splits], middle[splits]
        children = np.empty((len(active), 2, 3), np.int32)
        children[:, 0, 0], children[:, 0, 1], children[:, 0, 2] = active[:, 2], active[:, 0], middle
        children[:, 1, 0], children[:, 1, 1], children[:, 1, 2] = active[:, 1], active[:, 2], middle
        active = children.reshape(-1, 3)
        owner = np.repeat(owner, 2)
        place = np.repeat(place, 2)
        # The curve runs from one end of the hypotenuse to the other, and the other way at every second depth.
        place[1 - step % 2 :: 2] += np.int32(1 << max(2 * coarsest - step - 1, 0))
    triangles, owner, place = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort((owner.astype(np.int64) << (2 * coarsest + 1)) + place)
    starts = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))])
    return Meshes(triangles[order], starts)


def select_walls(rtin: Rtin, patches: Patches, finest_level: int) -> Bools:
    """Which sides need a wall: (n, 4) for north, south, west and east.

    A side needs one where any drawn patch beyond it has another size or rung; where nothing is drawn beyond, none.
    """
    shape = ((rtin.drop_rung.shape[0] - 1) >> finest_level, (rtin.drop_rung.shape[1] - 1) >> finest_level)
    kind = np.full((shape[0] + 2, shape[1] + 2), -1, np.int16)  # a frame of "nothing" around the terrain
    own = (patches.rung * 16 + patches.level).astype(np.int16)
    needs = np.zeros((len(own), 4), np.bool_)
    groups = []
    for level in np.unique(patches.level):
        members = np.flatnonzero(patches.level == level)
        span = 1 << (int(level) - finest_level)
        first_row, first_col = patches.row[members] * span + 1, patches.col[members] * span + 1
        along = np.arange(span)
        rows, cols = first_row[:, None] + along, first_col[:, None] + along
        kind[rows[:, :, None], cols[:, None, :]] = own[members, None, None]
        groups.append((members, span, first_row[:, None], first_col[:, None], rows, cols))
    for members, span, first_row, first_col, rows, cols in groups:
        beyond = (
            kind[first_row - 1, cols], kind[first_row + span, cols],
            kind[rows, first_col - 1], kind[rows, first_col + span],
        )  # fmt: skip
        for side, other in enumerate(beyond):
            needs[members, side] = ((other >= 0) & (other != own[members, None])).any(axis=1)
    return needs


def extract_walls(rtin: Rtin, patches: Patches, sides: Bools) -> Ints:
    """Wall triangles (m, 3) under the chosen sides (n, 4) of the patches: from each edge down to its `FOOT` copies."""
    drop_rung, stride = rtin.drop_rung.ravel(), rtin.drop_rung.shape[1]
    tops: list[Ints] = []
    ends: list[Ints] = []
    for level in np.unique(patches.level):
        size = 1 << int(level)
        # Step along each side so that the patch is on the left: the wall then faces outwards.
        for side, (row, col, step) in enumerate(
            ((0, size, -1), (size, 0, 1), (0, 0, stride), (size, size, -stride))
        ):  # fmt: skip
            members = np.flatnonzero((patches.level == level) & sides[:, side])
            start = (patches.row[members] * size + row) * stride + patches.col[members] * size + col
            posts = start[:, None] + np.arange(size + 1) * step
            present = drop_rung[posts] > patches.rung[members, None]
            present[:, 0] = present[:, -1] = True
            last = np.zeros_like(present)
            last[:, -1] = True
            tops.append(posts[present].astype(np.int32))
            ends.append(last[present])
    if not tops:
        return np.empty((0, 3), np.int32)
    top, end = np.concatenate(tops), np.concatenate(ends)
    here, there = top[:-1][~end[:-1]], top[1:][~end[:-1]]
    quads = np.stack([here, here | FOOT, there | FOOT, here, there | FOOT, there], axis=1)
    return quads.reshape(-1, 3).astype(np.int32)
