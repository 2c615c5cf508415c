"""Walls between neighbouring patches that do not fit: what closes the gap between two edges.

Patches of one size and rung fit exactly, and most of those that differ still have the same vertices on their common
edge. Where they have not, the two edges run one above the other, now this one higher, now that one. A wall reaches from
the higher one straight down to the lower, no farther, and faces the side from which the gap is seen.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Recursive rendering of approximation trees": walls between patches of different level, coloured like their edge.

**Deviations** The paper's walls have the height of the allowed error; these have the height of the gap. So none hangs
into view below the rim of a hole or over steep ground.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.algorithms.rtin import Rtin
from terrain.algorithms.rtin_mesh import Patches

Ints = npt.NDArray[np.int32]
Bools = npt.NDArray[np.bool_]
Places = npt.NDArray[np.intp]
Floats = npt.NDArray[np.float64]

# Sides of a square, north, south, west and east: the corner (row, col) where each begins, in sizes of the square, the
# step along it, and the step across it, outwards. The square lies to the left.
_BEGIN = np.array([[0, 1], [1, 0], [0, 0], [1, 1]])
_ALONG = np.array([[0, -1], [0, 1], [1, 0], [-1, 0]])
_ACROSS = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
_SOUTH, _WEST, _EAST = 1, 2, 3


def build_walls(
    rtin: Rtin, patches: Patches, finest_level: int, heights_m: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """The walls between the drawn patches.

    Parameters
    ----------
    rtin : Rtin
    patches : Patches
        All that is drawn; none overlap. Where nothing is drawn beyond an edge, there is no wall.
    finest_level : int
        The level of the smallest patches.
    heights_m : ndarray of float32, (rows, cols)
        The posts the hierarchy was made from.

    Returns
    -------
    ndarray of float32, (m, 3, 4)
        Triangles, counter-clockwise from where they are seen: column and row in posts, height [m], and 1 for vertices
        of the upper edge, -1 for those of the lower.
    """
    drawn = _map_patches(rtin, patches, finest_level)
    walls = [np.empty((0, 3, 4), np.float32)]
    for level in np.unique(patches.level):
        members, side = _unlike_sides(rtin, patches, np.flatnonzero(patches.level == level), drawn, finest_level)
        if len(members):
            walls.append(_side_walls(rtin, patches, members, side, drawn, finest_level, heights_m))
    return np.concatenate(walls)


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


def _post_offsets(stride: int, size: int) -> Places:
    """Post numbers (4, size + 1) along the sides of a square of ``size`` cells, from its north-west corner's."""
    places = _BEGIN[:, None] * size + _ALONG[:, None] * np.arange(size + 1)[:, None]
    return places @ np.array([stride, 1])


def _square_offsets(stride: int, span: int) -> Places:
    """Places (4, span) in the map of the squares beyond a patch's sides, from its own north-west square's."""
    # From the corner half a square along and half a square across.
    first = _BEGIN * span + (_ALONG + _ACROSS - 1) // 2
    return (first[:, None] + _ALONG[:, None] * np.arange(span)[:, None]) @ np.array([stride, 1])


def _corners(patches: Patches, members: Places, size: int, stride: int) -> Places:
    """Places (n,) of the north-west corners of patches in a grid of ``size`` places to a patch."""
    return patches.row[members].astype(np.intp) * (size * stride) + patches.col[members] * size


def _unlike_sides(
    rtin: Rtin, patches: Patches, members: Places, drawn: Ints, finest_level: int
) -> tuple[Places, Places]:
    """Patches of one size, and a side of each, along which what lies beyond may have different vertices.

    Each edge is found once: by the larger of its two patches, or by the northern or western one of two equals.
    """
    level = int(patches.level[members[0]])
    size, span, stride = 1 << level, 1 << (level - finest_level), drawn.shape[1]
    square = _corners(patches, members, span, stride) + stride + 1
    beyond = drawn.ravel()[square[:, None, None] + _square_offsets(stride, span)]
    other_level = patches.level[beyond]
    unlike = ((beyond >= 0) & (other_level < level)).any(axis=2)
    # A vertex is in the mesh of one equal and not of the other where its rung lies between theirs.
    other = beyond[:, [_SOUTH, _EAST], 0]
    own_rung, other_rung = patches.rung[members, None], patches.rung[other]
    equal = (other >= 0) & (other_level[:, [_SOUTH, _EAST], 0] == level)
    who, which = np.nonzero(equal & (own_rung != other_rung))
    low, high = patches.rung[members[who]], other_rung[who, which]
    low, high = np.minimum(low, high).astype(np.uint8), np.maximum(low, high).astype(np.uint8)
    stride = rtin.drop_rung.shape[1]
    corner = _corners(patches, members[who], size, stride)[:, None]
    rung = rtin.drop_rung.ravel()[corner + _post_offsets(stride, size)[[_SOUTH, _EAST], 1:-1][which]]
    unlike[who, np.array([_SOUTH, _EAST])[which]] = ((rung > low[:, None]) & (rung <= high[:, None])).any(axis=1)
    who, side = np.nonzero(unlike)
    return members[who], side


def _side_walls(
    rtin: Rtin, patches: Patches, members: Places, side: Places, drawn: Ints, finest_level: int,
    heights_m: npt.NDArray[np.float32],
) -> npt.NDArray[np.float32]:  # fmt: skip
    """The walls along chosen sides of patches of one size, beyond which lie patches no larger."""
    size, unit = 1 << int(patches.level[members[0]]), 1 << finest_level
    span, stride = size // unit, rtin.drop_rung.shape[1]
    posts = _corners(patches, members, size, stride)[:, None] + _post_offsets(stride, size)[side]
    square = _corners(patches, members, span, drawn.shape[1]) + drawn.shape[1] + 1
    beyond = drawn.ravel()[square[:, None] + _square_offsets(drawn.shape[1], span)[side]]
    drop_rung = rtin.drop_rung.ravel()[posts]
    own = drop_rung > patches.rung[members, None]
    own[:, [0, -1]] = True
    # Beyond, the vertices above the rung of the patch on either side of a post, and its corners.
    step = np.arange(size + 1)
    is_drawn = beyond >= 0
    rung, mask = patches.rung[beyond].astype(np.uint8), np.left_shift(1, patches.level[beyond]) - 1
    theirs = np.zeros_like(own)
    for neighbour in (np.maximum(step - 1, 0) // unit, np.minimum(step // unit, span - 1)):
        is_corner = step & mask[:, neighbour] == 0
        theirs |= is_drawn[:, neighbour] & ((drop_rung > rung[:, neighbour]) | is_corner)

    row, col = np.divmod(posts, stride)
    inside = np.minimum(row, heights_m.shape[0] - 1), np.minimum(col, heights_m.shape[1] - 1)
    heights = heights_m[inside].astype(np.float64)
    ours, others = _along(heights, own), _along(heights, theirs)
    # Pieces from each vertex of either edge to the one after, where anything is drawn beyond.
    owner, place = np.nonzero(own | theirs)
    starts = np.flatnonzero(owner[1:] == owner[:-1])
    starts = starts[is_drawn[owner[starts], np.minimum(place[starts] // unit, span - 1)]]
    ends = starts + 1
    flat = owner * (size + 1) + place
    where = np.stack([col.ravel()[flat], row.ravel()[flat]], axis=1)
    ours, others = ours.ravel()[flat], others.ravel()[flat]
    # Even the smallest difference gets its wall: without, a pixel could fall between two edges.
    outwards = starts[(ours[starts] > others[starts]) | (ours[ends] > others[ends])]
    inwards = starts[(others[starts] > ours[starts]) | (others[ends] > ours[ends])]
    return np.concatenate([
        _quads(where, outwards, outwards + 1, ours, others), _quads(where, inwards + 1, inwards, others, ours)
    ])  # fmt: skip


def _along(heights: Floats, vertices: Bools) -> Floats:
    """Heights (n, m) along edges that run straight from vertex to vertex; before the first and after the last, any."""
    step = np.arange(heights.shape[1])
    before = np.maximum.accumulate(np.where(vertices, step, 0), axis=1)
    after = np.minimum.accumulate(np.where(vertices, step, heights.shape[1] - 1)[:, ::-1], axis=1)[:, ::-1]
    low, high = np.take_along_axis(heights, before, axis=1), np.take_along_axis(heights, after, axis=1)
    return low + (high - low) * ((step - before) / np.maximum(after - before, 1))


def _quads(where: Places, here: Places, there: Places, upper: Floats, lower: Floats) -> npt.NDArray[np.float32]:
    """Two triangles for every piece of an edge, from the upper edge down to the lower, as far as it is the upper."""
    begin, end = upper[here] - lower[here], upper[there] - lower[there]
    crossing = begin / np.where(begin == end, 1.0, begin - end)
    corners = []
    for t in (np.where(begin < 0, crossing, 0.0), np.where(end < 0, crossing, 1.0)):
        place = where[here] + t[:, None] * (where[there] - where[here])
        for heights, way in ((upper, 1.0), (lower, -1.0)):
            height = heights[here] + t * (heights[there] - heights[here])
            corners.append(np.column_stack([place, height, np.full(len(t), way)]).astype(np.float32))
    here_up, here_down, there_up, there_down = corners
    quads = np.stack([here_up, here_down, there_down, here_up, there_down, there_up], axis=1)
    return quads.reshape(-1, 3, 4)
