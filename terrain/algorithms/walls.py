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
    ndarray of float32, (m, 3, 5)
        Triangles, counter-clockwise from where they are seen: column and row in posts, height [m], and 1 to 4 for a
        wall that faces north, south, west or east, negative at the vertices of the lower edge; last, how
        far the vertex lies above that height [m], which is a post's: float32 would not hold the sum for high terrain.
    """
    drawn = _map_patches(rtin, patches, finest_level)
    found = [
        _unlike_sides(rtin, patches, np.flatnonzero(patches.level == level), drawn, finest_level)
        for level in np.unique(patches.level)
    ]
    if not sum(len(members) for members, _ in found):
        return np.empty((0, 3, 5), np.float32)
    members, side = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return _side_walls(rtin, patches, members, side, drawn, finest_level, heights_m)


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
    low, high = np.minimum(low, high), np.maximum(low, high)
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
    """The walls along chosen sides, beyond which lie patches no larger."""
    stride, squares = rtin.drop_rung.shape[1], drawn.shape[1]
    level = patches.level[members].astype(np.intp)
    size, span = np.left_shift(1, level), np.left_shift(1, level - finest_level)
    # All posts of all sides, one side after another: `owner` and `step` along it.
    owner = np.repeat(np.arange(len(members)), size + 1)
    step = np.arange(len(owner)) - (np.cumsum(size + 1) - size - 1)[owner]
    number = np.array([stride, 1])
    first = (patches.row[members] * size) * stride + patches.col[members] * size + (_BEGIN @ number)[side] * size
    post = first[owner] + (_ALONG @ number)[side][owner] * step
    # Beyond, the vertices above the rung of the patch on either side of a post, and its corners.
    number = np.array([squares, 1])
    square = (patches.row[members] * span + 1) * squares + patches.col[members] * span + 1
    square += (_BEGIN @ number)[side] * span + ((_ALONG + _ACROSS - 1) // 2 @ number)[side]
    square_step = (_ALONG @ number)[side][owner]
    square, last = square[owner], (span - 1)[owner]
    drop_rung, everywhere = rtin.drop_rung.ravel().take(post), drawn.ravel()
    own = drop_rung > patches.rung[members][owner]
    own |= (step == 0) | (step == size[owner])
    theirs = np.zeros(len(own), np.bool_)
    for place in (np.maximum(step - 1, 0) >> finest_level, np.minimum(step >> finest_level, last)):
        beyond = everywhere.take(square + square_step * place)  # after the last turn: of the piece after each post
        is_corner = step & (np.left_shift(1, patches.level.take(beyond)) - 1) == 0
        theirs |= (beyond >= 0) & ((drop_rung > patches.rung.take(beyond)) | is_corner)

    at = np.flatnonzero(own | theirs)
    owner, step, own, theirs, is_drawn = owner[at], step[at], own[at], theirs[at], beyond[at] >= 0
    row, col = np.divmod(post[at], stride)
    height = heights_m[np.minimum(row, heights_m.shape[0] - 1), np.minimum(col, heights_m.shape[1] - 1)]
    height = height.astype(np.float64)
    ours, others = _along(height, step, own), _along(height, step, theirs)
    # Pieces from each vertex of either edge to the one after, where anything is drawn beyond.
    starts = np.flatnonzero((owner[1:] == owner[:-1]) & is_drawn[:-1])
    ends = starts + 1
    where = np.stack([col, row], axis=1)
    # Even the smallest difference gets its wall, and so does a vertex that only one of two level edges has: the picture
    # rounds vertices to a fraction of a pixel, and one could fall between the edges.
    level_ends = (ours == others)[starts] & (ours == others)[ends]
    level_ends &= (own != theirs)[starts] | (own != theirs)[ends]
    outwards = starts[(ours[starts] > others[starts]) | (ours[ends] > others[ends]) | level_ends]
    inwards = starts[(others[starts] > ours[starts]) | (others[ends] > ours[ends]) | level_ends]
    here, there = np.concatenate([outwards, inwards + 1]), np.concatenate([outwards + 1, inwards])
    upper, lower = np.stack([ours, others]) - height, np.stack([others, ours]) - height
    which = np.repeat([0, 1], [len(outwards), len(inwards)])
    quads = _quads(
        where[here], where[there], upper[which, here], upper[which, there], lower[which, here], lower[which, there],
        height[here], height[there],
    )  # fmt: skip
    facing = side[owner[here]] ^ which  # opposite sides differ in the last bit
    quads[..., 3] *= (1 + facing)[:, None]
    return quads.reshape(-1, 3, 5)


def _along(height: Floats, step: Places, vertices: Bools) -> Floats:
    """Heights on edges that run straight from vertex to vertex, one edge after another, each from vertex to vertex;
    before the first vertex of an edge and after its last, any."""
    place = np.arange(len(height))
    before = np.maximum.accumulate(np.where(vertices, place, 0))
    after = np.minimum.accumulate(np.where(vertices, place, len(place) - 1)[::-1])[::-1]
    t = (step - step[before]) / np.maximum(step[after] - step[before], 1)
    return height[before] + (height[after] - height[before]) * t


def _quads(
    here: Places, there: Places, upper_here: Floats, upper_there: Floats, lower_here: Floats, lower_there: Floats,
    post_here: Floats, post_there: Floats,
) -> npt.NDArray[np.float32]:  # fmt: skip
    """Two triangles (n, 6, 5) for every piece of an edge, from the upper edge down to the lower, as far as it is the
    upper. The edges' heights are given relative to the posts' at both ends."""
    rise = post_there - post_here
    upper_there, lower_there = upper_there + rise, lower_there + rise
    begin, end = upper_here - lower_here, upper_there - lower_there
    crossing = begin / np.where(begin == end, 1.0, begin - end)
    corners = np.empty((2, 2, len(here), 5), np.float32)  # (here and there, up and down)
    starts = np.where(begin < 0, crossing, 0.0), np.where(end < 0, crossing, 1.0)
    for i, (t, post, above) in enumerate(zip(starts, (post_here, post_there), (0.0 * rise, rise), strict=True)):
        corners[i, :, :, :2] = here + t[:, None] * (there - here)
        corners[i, :, :, 2] = post
        corners[i, 0, :, 4] = upper_here + t * (upper_there - upper_here) - above
        corners[i, 1, :, 4] = lower_here + t * (lower_there - lower_here) - above
    corners[:, 0, :, 3], corners[:, 1, :, 3] = 1.0, -1.0
    quads = corners.reshape(4, len(here), 5)[[0, 1, 3, 0, 3, 2]]
    return np.ascontiguousarray(quads.transpose(1, 0, 2))
