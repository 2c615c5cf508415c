"""Cutting meshes out of the right-triangulated hierarchy, for many square patches at once.

A patch of level l covers 2^l x 2^l cells; its mesh at rung r is the part of the whole terrain's mesh at that rung that
lies in the patch, refined where it must be to have the patch's corners. Meshes are lists of *post numbers*: row times
the padded row length plus column. No vertex is stored anywhere: the vertex shader finds a post's place from its number
and its height in the height texture.

**Source** W. Evans, D. Kirkpatrick, G. Townsend, "Right-triangulated irregular networks", Algorithmica 30 (2001).
"""

from __future__ import annotations

from functools import lru_cache
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
    """The meshes of all patches, refined together, level by level; in each patch the largest triangles come first.

    A triangle is one whole number: the post in the middle of its hypotenuse, the *heading* from there to its apex, and
    its patch. Its corners and its children lie at offsets that depend on its size and its heading alone.
    """
    drop_rung, stride = rtin.drop_rung.ravel(), rtin.drop_rung.shape[1]
    coarsest = int(patches.level.max(initial=0))
    owner = np.arange(len(patches.level), dtype=np.int64)
    centre = (((2 * patches.row + 1).astype(np.int64) << patches.level) * stride >> 1) + (
        (2 * patches.col + 1).astype(np.int64) << patches.level >> 1
    )
    # Even cells are cut NW-SE, into the halves whose apices are south-west and north-east, odd ones the other way.
    first = np.where((patches.row + patches.col) % 2 == 1, _NORTH_WEST, _SOUTH_WEST)
    roots = centre | owner << _OWNER | np.stack([first, (first + 2) % 4]) << _HEADING  # (2, patch)

    state, rung = np.empty(0, np.int64), np.empty(0, np.uint8)
    done, corner_lists = [np.empty(0, np.int64)], [np.empty((3, 0), np.int32)]

    def keep(states: npt.NDArray[np.int64], vertices: Ints) -> None:
        done.append(states >> _OWNER)
        middle = (states & _MIDDLE).astype(np.int32)
        corner_lists.append(vertices.take(states >> _HEADING & 3, axis=1) + middle)

    for step in range(2 * coarsest):
        if step % 2 == 0:  # the patches that are diagonal cells of this size join
            joining = np.flatnonzero(patches.level == coarsest - step // 2)
            if len(joining):
                state = np.concatenate([state, roots[:, joining].ravel()])
                rung = np.concatenate([rung, np.tile(patches.rung[joining].astype(np.uint8), 2)])
        shape = _shape(step % 2 == 0, 1 << (coarsest - 1 - step // 2), stride)
        splits = drop_rung.take(state & _MIDDLE) > rung
        keep(state.take(np.flatnonzero(~splits)), shape.vertices)
        split = np.flatnonzero(splits)
        state, rung = state.take(split), rung.take(split)
        if step + 1 < 2 * coarsest:
            state = (shape.to_children.take(state >> _HEADING & 3, axis=1) + state).ravel()
            rung = np.concatenate([rung, rung])
        else:  # legs of single cells: nothing lies between the posts
            for vertices in shape.child_vertices:
                keep(state, vertices)
    of_patch, corners = np.concatenate(done), np.concatenate(corner_lists, axis=1)
    order = np.argsort(of_patch.astype(np.uint16) if len(owner) < 1 << 16 else of_patch, kind="stable")
    triangles = np.empty((len(order), 3), np.int32)
    for corner in range(3):
        triangles[:, corner] = corners[corner].take(order)
    starts = np.concatenate([[0], np.cumsum(np.bincount(of_patch, minlength=len(owner)))])
    return Meshes(triangles, starts)


# Bits of a triangle: the number of the post in the middle of its hypotenuse, its heading, the number of its patch.
_MIDDLE, _HEADING, _OWNER = (1 << 40) - 1, 40, 42
_SOUTH_WEST, _NORTH_WEST = 0, 1  # headings go on clockwise, and from step to step by an eighth of a turn
_DIAGONALS = np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]])  # (row, col) of SW, NW, NE, SE
_STRAIGHTS = np.array([[1, 0], [0, -1], [-1, 0], [0, 1]])  # S, W, N, E


class _Shape(NamedTuple):
    """Offsets of triangles of one size, for each heading: of the corners (3, 4) from the middle; of the states of the
    two children (2, 4) from the own; and of the children's corners (2, 3, 4) from the middle."""

    vertices: Ints
    to_children: npt.NDArray[np.int64]
    child_vertices: Ints


@lru_cache(maxsize=256)
def _shape(is_half: bool, reach: int, stride: int) -> _Shape:
    """Triangles that are half a cell or a quarter of one, of a cell of 2 ``reach`` posts."""
    apex = (_DIAGONALS if is_half else _STRAIGHTS) * reach
    number = np.array([stride, 1])
    left, right = np.roll(apex, -1, axis=0), np.roll(apex, 1, axis=0)  # the ends of the hypotenuse
    to_children, child_vertices = [], []
    below = _STRAIGHTS if is_half else _DIAGONALS
    for end in (left, right):  # a child's hypotenuse runs from an end to the apex; its apex is the middle
        heading = np.array([np.flatnonzero((below == m).all(axis=1))[0] for m in -np.sign(end + apex)])
        to_children.append((end + apex) // 2 @ number + ((heading - np.arange(4)) << _HEADING))
        one, other = (end, apex) if end is right else (apex, end)
        child_vertices.append(np.stack([one, 0 * apex, other]) @ number)
    return _Shape(
        (np.stack([left, apex, right]) @ number).astype(np.int32),
        np.stack(to_children).astype(np.int64), np.stack(child_vertices).astype(np.int32),
    )  # fmt: skip
