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
Places = npt.NDArray[np.intp]

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


def extract_walls(rtin: Rtin, patches: Patches, finest_level: int) -> Ints:
    """Walls between the patches: triangles (m, 3) from their edges down to the edges' `FOOT` copies.

    A wall stands under those pieces of a patch's edge that the patch beyond does not have too: patches of one size and
    rung fit exactly, and most of those that differ have the same vertices on their common edge. Where nothing is drawn
    beyond, there is no wall. Each patch's walls face outwards.

    Parameters
    ----------
    rtin : Rtin
    patches : Patches
        All that is drawn; none overlap.
    finest_level : int
        The level of the smallest patches.
    """
    drawn = _map_patches(rtin, patches, finest_level)
    unlike = np.zeros((len(patches.level), 4), np.bool_)
    levels = np.unique(patches.level)
    for level in levels:
        _mark_unlike_sides(unlike, rtin, patches, np.flatnonzero(patches.level == level), drawn, finest_level)
    pieces = [np.empty((2, 0), np.int32)]
    for level in levels:
        member, side = np.nonzero(unlike & (patches.level == level)[:, None])
        if len(member):
            pieces.append(_side_walls(rtin, patches, member, side, drawn, finest_level))
    here, there = np.concatenate(pieces, axis=1)
    return np.stack([here, here | FOOT, there | FOOT, here, there | FOOT, there], axis=1).reshape(-1, 3)


# Sides of a square, north, south, west and east: the corner (row, col) where each begins, in sizes of the square, the
# step along it, and the step across it, outwards. The square lies to the left, so that walls face outwards.
_BEGIN = np.array([[0, 1], [1, 0], [0, 0], [1, 1]])
_ALONG = np.array([[0, -1], [0, 1], [1, 0], [-1, 0]])
_ACROSS = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
_SOUTH, _WEST, _EAST = 1, 2, 3


def _map_patches(rtin: Rtin, patches: Patches, finest_level: int) -> Ints:
    """Which patch covers each square of the smallest patches' size: -1 where none does, and around the terrain."""
    drawn = np.full([((n - 1) >> finest_level) + 2 for n in rtin.drop_rung.shape], -1, np.int32)
    for level in np.unique(patches.level):
        members = np.flatnonzero(patches.level == level).astype(np.int32)
        span = 1 << (int(level) - finest_level)
        inside = np.arange(1, span + 1)
        rows, cols = patches.row[members, None] * span + inside, patches.col[members, None] * span + inside
        drawn[rows[:, :, None], cols[:, None, :]] = members[:, None, None]
    return drawn


def _post_offsets(rtin: Rtin, size: int) -> Places:
    """Post numbers (4, size + 1) along the sides of a square of ``size`` cells, from its north-west corner's."""
    places = _BEGIN[:, None] * size + _ALONG[:, None] * np.arange(size + 1)[:, None]
    return places @ np.array([rtin.drop_rung.shape[1], 1])


def _square_offsets(drawn: Ints, span: int) -> Places:
    """Places (4, span) in the map of the squares beyond a patch's sides, from its own north-west square's."""
    # From the corner half a square along and half a square across.
    first = _BEGIN * span + (_ALONG + _ACROSS - 1) // 2
    return (first[:, None] + _ALONG[:, None] * np.arange(span)[:, None]) @ np.array([drawn.shape[1], 1])


def _beyond(patches: Patches, members: Places, drawn: Ints, span: int, offsets: Places) -> Ints:
    """The patches at ``offsets`` (m, span) or (m, 4, span) from patches of ``span`` smallest squares."""
    square = (patches.row[members].astype(np.intp) * span + 1) * drawn.shape[1] + patches.col[members] * span + 1
    return drawn.ravel()[square.reshape(-1, *[1] * (offsets.ndim - 1)) + offsets]


def _mark_unlike_sides(
    unlike: Bools, rtin: Rtin, patches: Patches, members: Places, drawn: Ints, finest_level: int
) -> None:
    """Mark the sides (n, 4) along which patches of one size and what lies beyond may have different vertices."""
    level = int(patches.level[members[0]])
    size, span = 1 << level, 1 << (level - finest_level)
    beyond = _beyond(patches, members, drawn, span, _square_offsets(drawn, span)[None])
    is_alike = patches.level[beyond] == level
    unlike[members] |= ((beyond >= 0) & ~is_alike).any(axis=2)
    # Patches of one size look at their common edge once. A vertex is in the mesh of one and not of the other where its
    # rung lies between theirs.
    other, is_alike = beyond[:, [_SOUTH, _EAST], 0], is_alike[:, [_SOUTH, _EAST], 0]
    own_rung, other_rung = patches.rung[members, None], patches.rung[other]
    who, which = np.nonzero((other >= 0) & is_alike & (own_rung != other_rung))
    low, high = patches.rung[members[who]], other_rung[who, which]
    low, high = np.minimum(low, high).astype(np.uint8), np.maximum(low, high).astype(np.uint8)
    corner = _north_west_posts(rtin, patches, members[who], size)
    rung = rtin.drop_rung.ravel()[corner + _post_offsets(rtin, size)[[_SOUTH, _EAST], 1:-1][which]]
    differs = np.flatnonzero(((rung > low[:, None]) & (rung <= high[:, None])).any(axis=1))
    side = np.array([_SOUTH, _EAST])[which[differs]]
    unlike[members[who[differs]], side] = True
    unlike[other[who[differs], which[differs]], side - 1] = True


def _north_west_posts(rtin: Rtin, patches: Patches, members: Places, size: int) -> Places:
    """Post numbers (n, 1) of the north-west corners of patches of ``size`` cells."""
    row, col = patches.row[members].astype(np.intp), patches.col[members]
    return (row * (size * rtin.drop_rung.shape[1]) + col * size)[:, None]


def _side_walls(rtin: Rtin, patches: Patches, members: Places, side: Places, drawn: Ints, finest_level: int) -> Ints:
    """Ends (2, m) of the pieces of chosen sides of patches of one size under which walls stand."""
    size, unit = 1 << int(patches.level[members[0]]), 1 << finest_level
    span = size // unit
    posts = _north_west_posts(rtin, patches, members, size) + _post_offsets(rtin, size)[side]
    beyond = _beyond(patches, members, drawn, span, _square_offsets(drawn, span)[side])
    drop_rung = rtin.drop_rung.ravel()[posts]
    own = drop_rung > patches.rung[members, None]
    own[:, [0, -1]] = True
    # What the patches on either side of each post have there: the vertices above their rung, and their corners.
    step = np.arange(size + 1)
    begin = np.where(side < _WEST, patches.col[members], patches.row[members]) * size
    forwards = (side == _SOUTH) | (side == _WEST)
    along = (begin[:, None] + np.where(forwards[:, None], step, size - step)).astype(np.int16)  # low bits suffice
    is_drawn = beyond >= 0
    rung = patches.rung[beyond].astype(np.uint8)
    mask = np.where(is_drawn, np.left_shift(1, patches.level[beyond]) - 1, -1).astype(np.int16)
    theirs, known = np.zeros_like(own), np.zeros_like(own)
    for square in (np.maximum(step - 1, 0) // unit, np.minimum(step // unit, span - 1)):
        there = is_drawn[:, square]
        known |= there
        theirs |= there & ((drop_rung > rung[:, square]) | (along & mask[:, square] == 0))
    unlike = known & (own != theirs)
    so_far = np.cumsum(unlike, axis=1, dtype=np.int32)[own]
    owner, top = np.nonzero(own)[0], posts[own]
    wall = (owner[1:] == owner[:-1]) & (so_far[1:] - so_far[:-1] + unlike[own][:-1] > 0)
    return np.stack([top[:-1][wall], top[1:][wall]]).astype(np.int32)
