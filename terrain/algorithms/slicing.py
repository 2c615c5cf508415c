"""Adaptive slicing: which boxes of terrain to draw as bundles of slices, in which direction, and which as polygons.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, Vision, Modeling and
Visualization 2001. Numbers in comments are its sections.

Deviations:

* The hit on a slice is carried back to the surface by secant steps between this plane and the one before (in the
  shader), so planes need not lie a pixel apart. Their distance is the longest over which no ground rises over its chord
  by more than the tolerance (`terrain.algorithms.slicing_tree`).
* A slice stands for several planes of its bundle: the shader looks at all those between it and the slice before, so
  that a ray is tested as often as with a slice per plane, and far fewer are drawn.
* A bundle is closed by the far sides and the bottom of its box, so that a ray that meets the ground and leaves the box
  before the next plane is caught where it leaves. The paper's borders (section 5) leak at steep ground.
* Horizontal slices are used wherever they are cheaper, not only above 45 degrees: over a flat box a few of them do what
  hundreds of upright ones would.
* Polygons leave out posts where the tolerance allows it (section 7: "combined with continuous level of detail").
* Costs follow the pixels that are really touched; polygons take part in the descent, and the cut starts from nodes that
  rise above the horizon.

``rule="paper"`` brings back the paper's counts, directions, costs, borders and descent from the root. Under either rule
a box around the eye can only be drawn as polygons, also where slices alone are asked for; by default, so are boxes of
needles that no planes could follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing_cost import (
    POLYGONS,
    X_SLICES,
    Y_SLICES,
    Z_SLICES,
    Boxes,
    Floats,
    Ints,
    Speeds,
    View,
    paper_bundles,
    refined_bundles,
    search_cost_ms,
)
from terrain.algorithms.slicing_tree import Nodes, SliceTree
from terrain.frame import Frame
from terrain.pyramid import BASE_LEVEL

Mode = Literal["hybrid", "slices", "polygons"]
Rule = Literal["secant", "paper"]

# Section 4: descend where a box costs more than c times its children; the paper found 0.9 reasonable.
DESCENT = np.float32(0.9)
# The cut starts at nodes farther away than this many times their size: smaller ones are hidden more often by the
# horizon, and larger ones would save few slices.
START_RATIO = 12.0
# A slice is named by one 32-bit word: its box in the low bits, its number above. Numbers from the last one down are the
# box's own faces: x low, x high, y low, y high, z low, z high.
BOX_BITS, LAST_NUMBER, FACE_COUNT = 20, 4095, 6
# Slices are looked for in squares of the picture of this size.
PATCH_PX = 16
# Slices are drawn beside polygons where they save this share of what polygons alone would cost.
WORTHWHILE = 0.1


@dataclass(frozen=True, eq=False)
class Cut:
    """The chosen boxes, front to back; arrays (n,) or (n, 3).

    Attributes
    ----------
    nodes : Nodes
    lower_m, upper_m : ndarray of float64
        World corners, cut off at the grid's edges.
    direction : ndarray of int32
        POLYGONS, X_SLICES, Y_SLICES or Z_SLICES.
    planes : ndarray of int32
        Planes of the bundle, without the faces that close it; 0 for polygons.
    stride : ndarray of int32
        Polygons have every 2^stride-th post inside their tile, and every post along its border.
    patches : ndarray of float32, (k, 4)
        Where in the picture the slices are (`patches_of`).
    cost_ms : float
        What all boxes together were estimated to cost.
    """

    nodes: Nodes
    lower_m: npt.NDArray[np.float64]
    upper_m: npt.NDArray[np.float64]
    direction: Ints
    planes: Ints
    stride: Ints
    patches: Floats
    cost_ms: float


def select_cut(
    tree: SliceTree,
    frame: Frame,
    speeds: Speeds,
    tolerance_px: float,
    mode: Mode = "hybrid",
    rule: Rule = "secant",
    horizon: bool = True,
    coarse: bool = False,
) -> Cut:
    """The boxes to draw for a view, front to back.

    Parameters
    ----------
    tree : SliceTree
    frame : Frame
        The view.
    speeds : Speeds
        What this machine takes.
    tolerance_px : float
        Allowed geometric error.
    mode : {"hybrid", "slices", "polygons"}
        Whether boxes may be drawn as both, slices alone, or polygons alone.
    rule : {"secant", "paper"}
        Whose slice counts and costs.
    horizon : bool
        Whether to drop boxes hidden behind nearer ground (``rule="secant"`` only).
    coarse : bool
        Whether polygons may leave out posts (``rule="secant"`` only).
    """
    pixels = frame.viewport_px[0] * frame.viewport_px[1]
    view = View(tolerance_px, frame.pixels_per_radian, pixels, tree.spacing_m, coarse)
    paper = rule == "paper"
    planes = np.concatenate([frame.side_planes, frame.camera.forward[None]]).astype(np.float32)
    first = tree.culler.select(frame, horizon=horizon and not paper, split_ratio=0.0 if paper else START_RATIO)
    looked_at = _look_at(tree, frame, planes, view, speeds, paper, Nodes(first.level, first.row, first.col))
    chosen = [looked_at.where(np.zeros(0, np.intp))]
    while len(looked_at.slices_ms):
        inner = looked_at.nodes.level > BASE_LEVEL
        chosen.append(looked_at.where(~inner))
        looked_at = looked_at.where(inner)
        parent, nodes = tree.children(looked_at.nodes)
        children = _look_at(tree, frame, planes, view, speeds, paper, nodes, parent)
        if paper:  # slices alone: polygons cost the same at every level
            whole, part = looked_at.slices_ms, children.slices_ms * DESCENT
        else:
            whole = _least_ms(mode, looked_at.slices_ms, looked_at.polygons_ms)
            part = _least_ms(mode, children.slices_ms * DESCENT, children.polygons_ms)
        parts = np.bincount(children.parent, part, len(whole))
        descend = ~(whole <= parts) | ~np.isfinite(whole)
        chosen.append(looked_at.where(~descend))
        looked_at = children.where(descend[children.parent])
    return _decide(tree, frame, mode, speeds, chosen)


class _Choice(NamedTuple):
    """Visible nodes and what drawing them would take; arrays (n,)."""

    parent: npt.NDArray[np.intp]  # index among the nodes looked at before
    nodes: Nodes
    direction: Ints
    planes: Ints
    slices_ms: Floats  # infinite where slices cannot be used, or (paper) have no bound
    polygons_ms: Floats
    stride: Ints

    def where(self, kept: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> _Choice:
        return _Choice(
            self.parent[kept], self.nodes.where(kept), self.direction[kept], self.planes[kept], self.slices_ms[kept],
            self.polygons_ms[kept], self.stride[kept],
        )  # fmt: skip


def _least_ms(mode: Mode, slices_ms: Floats, polygons_ms: Floats) -> Floats:
    """The cost of the cheaper way that ``mode`` allows."""
    if mode == "hybrid":
        return np.minimum(slices_ms, polygons_ms)
    return slices_ms if mode == "slices" else polygons_ms


def _look_at(
    tree: SliceTree, frame: Frame, planes: Floats, view: View, speeds: Speeds, paper: bool, nodes: Nodes,
    parent: npt.NDArray[np.intp] | None = None,
) -> _Choice:  # fmt: skip
    """Those of the nodes in front of the four sides and the near plane, with their bundles and costs."""
    lower, upper = (corner.T.astype(np.float32) for corner in tree.corners(nodes, frame.eye_m))  # (3, n)
    distance = planes @ ((lower + upper) * np.float32(0.5))  # (5, n)
    reach = np.abs(planes) @ ((upper - lower) * np.float32(0.5))
    distance[4] -= np.float32(frame.near_m)
    kept = np.flatnonzero((distance > -reach).all(axis=0))
    lower, upper, distance, reach, nodes = (
        *(a.take(kept, axis=1) for a in (lower, upper, distance, reach)), nodes.where(kept)
    )  # fmt: skip
    share = np.float32(0.5) + np.float32(0.5) * distance[:4] / np.maximum(reach[:4], np.float32(1e-6))
    inside: Floats = np.clip(share, 0, 1).prod(axis=0, dtype=np.float32)
    dx, dz = (np.float32(spacing) for spacing in tree.spacing_m)
    cells = (upper[0] - lower[0]) * (upper[2] - lower[2]) / (dx * dz)
    number = tree.number(nodes)
    peak, error = tree.peak_m.take(number, axis=0), tree.error_m.take(number if view.coarse else number[:0], axis=0)
    boxes = Boxes(lower.T, upper.T, inside, cells, peak, error)
    bundles = (paper_bundles if paper else refined_bundles)(boxes, view, speeds)
    if paper:  # no bound where the box crosses the near plane or the sides: descend, polygons at the leaves
        crosses = distance < reach
        bundles.slices_ms[crosses[4] | (crosses[:4].any(axis=0) & (nodes.level > BASE_LEVEL))] = np.inf
    return _Choice(np.zeros(len(kept), np.intp) if parent is None else parent[kept], nodes, *bundles)


def _decide(tree: SliceTree, frame: Frame, mode: Mode, speeds: Speeds, parts: list[_Choice]) -> Cut:
    """The final choice between slices and polygons, sorted front to back."""
    level, row, col = (np.concatenate(a) for a in zip(*(p.nodes for p in parts), strict=True))
    direction, planes, slices_ms, polygons_ms, stride = (
        np.concatenate(a) for a in zip(*(p[2:] for p in parts), strict=True)
    )  # fmt: skip
    nodes = Nodes(level, row, col)
    sliced = np.isfinite(slices_ms)
    if mode == "polygons":
        sliced[:] = False
    elif mode == "hybrid":
        sliced &= slices_ms < polygons_ms
    lower, upper = tree.corners(nodes)
    patches, search_ms = np.zeros((0, 4), np.float32), 0.0
    # The pass that looks for slices covers more than they do, and estimates are uncertain: small gains are none.
    gain_ms = (polygons_ms - slices_ms)[sliced].sum() - WORTHWHILE * polygons_ms.sum()
    if mode == "hybrid" and gain_ms < speeds.search_ms:
        sliced[:] = False
    if sliced.any():
        patches = patches_of(lower[sliced], upper[sliced], frame)
        search_ms = search_cost_ms(patches, frame.viewport_px, speeds)
        if mode == "hybrid" and gain_ms < search_ms:
            sliced[:], patches, search_ms = False, patches[:0], 0.0
    order = front_to_back(tree, frame, nodes)
    sliced = sliced[order]
    cost_ms = float(np.where(sliced, slices_ms[order], polygons_ms[order]).sum()) + search_ms
    return Cut(
        nodes.where(order), lower[order], upper[order], np.where(sliced, direction[order], np.int32(POLYGONS)),
        np.where(sliced, planes[order], np.int32(0)), stride[order],
        patches, cost_ms,
    )  # fmt: skip


def front_to_back(tree: SliceTree, frame: Frame, nodes: Nodes) -> npt.NDArray[np.intp]:
    """The order (n,) in which rays from the eye pass the nodes of a cut.

    Nodes are squares in the ground plane, counted in cells. Where a ray enters square B after A, B's centre is at least
    (a + b) / 2 further along one axis, a and b being their sides, and less than (a + b) / 2 nearer along the other,
    since the squares do not overlap: the sum of distances along both axes grows. (Squares on the eye's own row or
    column may come out of order, which costs a few pixels drawn twice.)
    """
    half = np.left_shift(np.int32(1), nodes.level) * 0.5
    away = np.abs((nodes.col << nodes.level) + half - frame.eye_m[0] / tree.spacing_m[0])
    away += np.abs((nodes.row << nodes.level) + half - frame.eye_m[2] / tree.spacing_m[1])
    return np.argsort(away, kind="stable")


def name_slices(
    cut: Cut, eye_m: npt.NDArray[np.float64], closed: bool, planes_per_slice: int = 1
) -> npt.NDArray[np.uint32]:  # fmt: skip
    """One word per slice, box by box, front to back inside each.

    Parameters
    ----------
    cut : Cut
    eye_m : ndarray (3,)
    closed : bool
        Whether bundles are closed by those faces of their box through which rays from the eye leave it.
    planes_per_slice : int
        Every so many planes there is a slice, and at the last one.

    Returns
    -------
    ndarray of uint32
        The box in the low `BOX_BITS`, the number of the slice's plane above.
    """
    if not cut.planes.any():
        return np.zeros(0, np.uint32)
    leaves = np.zeros((len(cut.planes), FACE_COUNT), np.bool_)
    if closed:
        leaves[:, 0::2], leaves[:, 1::2] = cut.lower_m < eye_m, cut.upper_m > eye_m
        leaves[:, 3] = False  # above its highest post a box is empty
        leaves[cut.direction == POLYGONS] = False
        for direction, faces in ((X_SLICES, (0, 1)), (Y_SLICES, (2, 3)), (Z_SLICES, (4, 5))):
            leaves[np.ix_(cut.direction == direction, faces)] = False  # the last slice stands there
    faces_per_box = leaves.sum(axis=1)
    slices = -(-cut.planes // planes_per_slice)
    total = slices + faces_per_box
    box = np.repeat(np.arange(len(total)), total)
    number = np.arange(len(box)) - np.repeat(np.cumsum(total) - total, total)
    is_face = number >= slices[box]
    number = np.minimum((number + 1) * planes_per_slice, cut.planes[box]) - 1
    number[is_face] = LAST_NUMBER - np.nonzero(leaves)[1]
    return np.asarray(box | number << BOX_BITS).astype(np.uint32)


def patches_of(lower_m: npt.NDArray[np.float64], upper_m: npt.NDArray[np.float64], frame: Frame) -> Floats:
    """Where in the picture the boxes (n, 3) are: rows of squares of `PATCH_PX` pixels, as rectangles (k, 4) float32.

    Columns are the low and the high corner, 0..1 from the lower left.
    """
    clip_from_eye = frame.clip_from_eye[[0, 1, 3], :3]
    ends = np.stack([lower_m, upper_m]).transpose(2, 0, 1) - frame.eye_m[:, None, None]  # (axis, end, n)
    x, y, z = (clip_from_eye.T[:, None, :, None] * ends[:, :, None]).astype(np.float32)  # (end, clip x y w, n) each
    clip = (x[:, None, None] + y[:, None] + z).reshape(8, 3, -1)
    size_px = np.array(frame.viewport_px, np.float32)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        place_px = (np.float32(0.5) + np.float32(0.5) * clip[:, :2] / clip[:, 2:]) * size_px
    low, high = place_px.min(axis=0), place_px.max(axis=0)  # (2, n)
    around = clip[:, 2].min(axis=0) <= frame.near_m  # a corner behind the eye says nothing
    low[:, around], high[:, around] = 0.0, size_px
    cols, rows = (-(-size // PATCH_PX) for size in frame.viewport_px)
    most = np.array([cols, rows])[:, None] - 1
    margin_px = np.float32(1.5)  # borders of slices, and rounding
    left, bottom = ((low - margin_px) / PATCH_PX).clip(0, most).astype(np.int64)
    right, top = ((high + margin_px) / PATCH_PX).clip(0, most).astype(np.int64) + 1
    # How many boxes cover each square: sums of what begins and ends along both axes.
    change = sum(
        sign * np.bincount(row * (cols + 1) + col, minlength=(rows + 1) * (cols + 1))
        for row, col, sign in ((bottom, left, 1), (bottom, right, -1), (top, left, -1), (top, right, 1))
    )
    covered = np.cumsum(np.cumsum(np.reshape(change, (rows + 1, cols + 1)), axis=0), axis=1)[:-1, :-1] > 0
    edges = np.diff(np.pad(covered, ((0, 0), (1, 1))), axis=1)
    row, col = np.nonzero(edges)
    corners = np.stack([col[::2], row[::2], col[1::2], row[::2] + 1], axis=1) * PATCH_PX / np.tile(size_px[:, 0], 2)
    return np.minimum(corners, 1.0).astype(np.float32)
