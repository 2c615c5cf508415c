"""Cutting meshes out of the right-triangulated hierarchy, for many square patches at once.

A patch of level l covers 2^l x 2^l cells; its mesh at rung r is the part of the whole terrain's mesh at that rung that
lies in the patch, refined where it must be to have the patch's corners. Meshes are lists of *post numbers*: row times
the padded row length plus column. No vertex is stored anywhere: the vertex shader finds a post's place from its number
and its height in the height texture.

**Source** W. Evans, D. Kirkpatrick, G. Townsend, "Right-triangulated irregular networks", Algorithmica 30 (2001).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.rtin import Rtin

Ints = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]


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
    """The meshes of all patches, refined together, level by level; in each patch the largest triangles come first."""
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
    a, b, apex, owner = (np.empty(0, np.int32) for _ in range(4))
    rung = np.empty(0, np.uint8)
    done: list[tuple[Ints, Ints, Ints, Ints]] = []
    for step in range(2 * coarsest + 1):
        if step % 2 == 0:  # the patches that are diagonal cells of this size join
            joining = np.flatnonzero(patches.level == coarsest - step // 2).astype(np.int32)
            halves = roots[joining].reshape(-1, 3)
            a, b, apex = (np.concatenate(pair) for pair in ((a, halves[:, 0]), (b, halves[:, 1]), (apex, halves[:, 2])))
            owner = np.concatenate([owner, np.repeat(joining, 2)])
            rung = np.concatenate([rung, np.repeat(patches.rung[joining].astype(np.uint8), 2)])
        middle = (a + b) >> 1
        # The legs of the last are single cells: nothing lies between the posts.
        splits = drop_rung[middle] > rung if step < 2 * coarsest else np.zeros(len(a), np.bool_)
        kept, split = np.flatnonzero(~splits), np.flatnonzero(splits)
        done.append((a[kept], b[kept], apex[kept], owner[kept]))
        a, b, apex, middle = a[split], b[split], apex[split], middle[split]
        a, b, apex = np.concatenate([apex, b]), np.concatenate([a, apex]), np.concatenate([middle, middle])
        owner, rung = np.tile(owner[split], 2), np.tile(rung[split], 2)
    a, b, apex, owner = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(owner.astype(np.uint16) if count < 1 << 16 else owner, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))])
    return Meshes(np.stack([a[order], b[order], apex[order]], axis=1), starts)
