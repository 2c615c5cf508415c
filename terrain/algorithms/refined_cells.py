"""Imported microstructures: the cells that breaklines cross, each refined by a small TIN of its own.

Every cell of the reference grid that a line crosses is triangulated anew with the line as edges. The paper's
conditions hold: a TIN's domain is its cell; at the corners it has the posts' heights; and what vertices it has on a
side of its cell, the cell beyond has as well, for a line that touches a side refines the cells on both.

Refined cells come in *refined patches*: squares of 8 x 8 cells, drawn with every post. A patch that is far enough for
the lines in it not to matter is drawn as any other (`departure_m` says how much they matter).

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Characteristics of hybrid terrain models".
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from terrain.algorithms.cell_tin import UNITS, Piece, Point, Triangle, triangulate_cell
from terrain.breaklines import Breaklines
from terrain.cache import load_arrays, store_arrays
from terrain.errors import InputError
from terrain.heightfield import Heightfield, surface_heights
from terrain.pyramid import BASE_LEVEL, Pyramid

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
PATCH_LEVEL = BASE_LEVEL  # refined patches of 8 x 8 cells
PATCH_CELLS = 1 << PATCH_LEVEL
MOST_PIECES = 100  # of lines in one cell
KEPT_CELLS = 500  # fewer are quicker to refine than to keep
CACHE_VERSION = 2


@dataclass(frozen=True, eq=False)
class RefinedCells:
    """The refined patches of a terrain.

    Attributes
    ----------
    vertices : ndarray of float32, (k, 3)
        Column, row and height [m] of the vertices that are no posts.
    patches : ndarray of int64, (p, 2)
        Row and column, in patches, of the refined patches, in ascending order.
    triangles : ndarray of int32, (m, 3)
        Counter-clockwise from above: numbers of posts in the padded grid and, behind all of them, of the vertices.
    starts : ndarray of int64, (p + 1,)
        Patch i owns ``triangles[starts[i]:starts[i + 1]]``.
    fins : ndarray of float32, (f, 3, 5)
        Upright triangles between a side of a patch with the lines' vertices and the same side without; as `build_walls`
        gives them.
    fin_patches : ndarray of int64, (f, 2)
        The two patches each fin stands between: it is needed where just one of them is drawn refined.
    departure_m : tuple of ndarray of float32
        For patches of level 3 and up, how far the refined surface may lie from the posts' own.
    cell_height_m : ndarray of float64, (p, 2)
        The lowest and the highest vertex of each refined patch.
    counts : tuple of int
        Refined cells, and their triangles.
    """

    vertices: npt.NDArray[np.float32]
    patches: Ints
    triangles: npt.NDArray[np.int32]
    starts: Ints
    fins: npt.NDArray[np.float32]
    fin_patches: Ints
    departure_m: tuple[npt.NDArray[np.float32], ...]
    cell_height_m: Floats
    counts: tuple[int, int]

    def index_of(self, row: npt.NDArray[np.int32], col: npt.NDArray[np.int32]) -> Ints:
        """Which refined patch each patch of level 3 is; -1 where it is none."""
        if not len(self.patches):
            return np.full(len(row), -1, np.int64)
        keys, wanted = self.patches @ [1 << 32, 1], row.astype(np.int64) << 32 | col
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        return np.where(keys[at] == wanted, at, -1)

    def spans(self, patches: Ints) -> Ints:
        """Where the triangles of some patches begin and end (2, n)."""
        return np.stack([self.starts[patches], self.starts[patches + 1]])

    def fins_of(self, drawn: Ints) -> npt.NDArray[np.float32]:
        """The fins needed where the refined patches ``drawn`` are drawn and the others are not."""
        is_drawn = np.zeros(len(self.patches), np.bool_)
        is_drawn[drawn] = True
        return self.fins[is_drawn[self.fin_patches[:, 0]] != is_drawn[self.fin_patches[:, 1]]]


def widened(pyramid: Pyramid, refined: RefinedCells) -> Pyramid:
    """The pyramid with bounds that hold the lines too: a bridge rises above its ground."""
    minima, maxima = ([a.copy() for a in bounds] for bounds in (pyramid.minimum_m, pyramid.maximum_m))
    row, col = refined.patches.T
    for low, high in zip(minima, maxima, strict=True):
        np.minimum.at(low, (row, col), refined.cell_height_m[:, 0].astype(np.float32))
        np.maximum.at(high, (row, col), refined.cell_height_m[:, 1].astype(np.float32))
        row, col = row >> 1, col >> 1
    return Pyramid(tuple(minima), tuple(maxima), pyramid.error_m, pyramid.cells)


def load_refined(
    heightfield: Heightfield, breaklines: Breaklines, padded_shape: tuple[int, int], top_level: int
) -> RefinedCells:
    """As `refine_cells`, from the disk cache where the same lines were refined before: many take seconds."""
    digest = hashlib.sha256(f"{heightfield.sha256}:{padded_shape}:{top_level}:{CACHE_VERSION}".encode())
    for line in breaklines.lines:
        digest.update(np.ascontiguousarray(line).tobytes() + b";")
    names = [field.name for field in fields(RefinedCells) if field.name not in ("departure_m", "counts")]
    arrays = load_arrays("refined", digest.hexdigest())
    if arrays is not None and {*names, "counts", "departure0"} <= set(arrays):
        levels = sum(name.startswith("departure") for name in arrays)
        departures = tuple(arrays[f"departure{i}"] for i in range(levels))
        count, triangles = arrays["counts"].tolist()
        return RefinedCells(**{n: arrays[n] for n in names}, departure_m=departures, counts=(count, triangles))
    refined = refine_cells(heightfield, breaklines, padded_shape, top_level)
    if refined.counts[0] > KEPT_CELLS:
        kept = {n: np.asarray(getattr(refined, n)) for n in (*names, "counts")}
        store_arrays(
            "refined", digest.hexdigest(), kept | {f"departure{i}": d for i, d in enumerate(refined.departure_m)}
        )
    return refined


def refine_cells(
    heightfield: Heightfield, breaklines: Breaklines, padded_shape: tuple[int, int], top_level: int
) -> RefinedCells:
    """The refined patches of a terrain with lines.

    Parameters
    ----------
    heightfield : Heightfield
    breaklines : Breaklines
    padded_shape : tuple of int
        Rows and columns of the grid whose post numbers are used; a multiple of the coarsest patches' size, plus 1.
    top_level : int
        Level of the coarsest patches.

    Raises
    ------
    InputError
        As `refuse_crowds`.
    """
    refuse_crowds(heightfield, breaklines)
    pieces, height_of = _cut_lines(heightfield, breaklines)
    cells = _group_by_cell(pieces, height_of, heightfield)
    triangles = {cell: triangulate_cell(cell, points, inside, height_of) for cell, (points, inside) in cells.items()}
    number = _Numbers(height_of, padded_shape)
    patches = np.unique(np.array(list(cells), np.int64).reshape(-1, 2) // PATCH_CELLS, axis=0)
    lists = [_patch_triangles(patch, triangles, number) for patch in patches.tolist()]
    fins, fin_patches = _build_fins(height_of, heightfield, patches)
    lowest = [_height_range(patch, cells, height_of) for patch in patches.tolist()]
    return RefinedCells(
        number.vertices(), patches, np.concatenate([np.empty((0, 3), np.int32), *lists]),
        np.cumsum([0, *map(len, lists)]), fins, fin_patches,
        _departures(heightfield, cells, height_of, padded_shape, top_level), np.array(lowest).reshape(-1, 2),
        (len(cells), sum(map(len, triangles.values()))),
    )  # fmt: skip


def refuse_crowds(heightfield: Heightfield, breaklines: Breaklines) -> None:
    """Check that lines leave the cells they cross room for triangles.

    Raises
    ------
    InputError
        If more than `MOST_PIECES` pieces of lines lie in one cell.
    """
    places = [np.empty(0, np.int64)]
    for line in breaklines.lines:
        owner, points, _ = _cut_line(line, heightfield)
        middle = (points[1:] + points[:-1])[owner[1:] == owner[:-1]] / 2.0
        places.append(middle[:, 1].astype(np.int64) * heightfield.cols + middle[:, 0].astype(np.int64))
    _, counts = np.unique(np.concatenate(places), return_counts=True)
    if (most := int(counts.max(initial=0))) > MOST_PIECES:
        raise InputError(
            f"Expected at most {MOST_PIECES} pieces of lines in one cell of the terrain, found {most} in "
            f"{breaklines.name}: simplify the lines first."
        )


def _cut_lines(heightfield: Heightfield, breaklines: Breaklines) -> tuple[list[Piece], dict[Point, float]]:
    """The lines inside the grid in pieces that each lie within one cell, and the heights of the pieces' ends.

    Where points coincide, the first line's height counts; on a post it is the post's own.
    """
    pieces: dict[Piece, None] = {}
    height_of: dict[Point, float] = {}
    for line in breaklines.lines:
        owner, points, heights = _cut_line(line, heightfield)
        units = np.rint(points * UNITS).astype(np.int64)
        if np.isnan(heights).any():
            heights = surface_heights(heightfield.heights_m, units[:, 0] / UNITS, units[:, 1] / UNITS)
        on_post = (units % UNITS == 0).all(axis=1)
        col, row = units[on_post].T // UNITS
        heights[on_post] = heightfield.heights_m[row, col]
        places: list[Point] = [(c, r) for c, r in units.tolist()]
        for place, height in zip(places, heights.tolist(), strict=True):
            height_of.setdefault(place, height)
        for i in np.flatnonzero(owner[1:] == owner[:-1]).tolist():
            ends = min(places[i], places[i + 1]), max(places[i], places[i + 1])
            if ends[0] != ends[1]:
                pieces[ends] = None
    return list(pieces), height_of


def _cut_line(line: Floats, heightfield: Heightfield) -> tuple[Ints, Floats, Floats]:
    """Points (n, 2) along the segments of a line inside the grid, at their ends and wherever they cross an edge of the
    grid; the segment each belongs to, and heights."""
    begin, step = line[:-1], np.diff(line, axis=0)
    enter, leave = np.zeros(len(step)), np.ones(len(step))
    for axis, last in ((0, heightfield.cols - 1), (1, heightfield.rows - 1)):
        for sign, limit in ((1.0, 0.0), (-1.0, -float(last))):  # sign * (begin + t * step) >= limit
            rise, room = sign * step[:, axis], limit - sign * begin[:, axis]
            with np.errstate(all="ignore"):
                at = room / rise
            enter = np.where(rise > 0, np.maximum(enter, at), enter)
            leave = np.where(rise < 0, np.minimum(leave, at), leave)
            leave = np.where((rise == 0) & (room > 0), -1.0, leave)
    inside = np.flatnonzero(leave > enter)
    begin, step, enter, leave = begin[inside], step[inside], enter[inside], leave[inside]
    owners, places = [np.repeat(np.arange(len(inside)), 2)], [np.stack([enter, leave], axis=1).ravel()]
    for axis in (0, 1):
        ends = begin[:, axis, None] + np.stack([enter, leave], axis=1) * step[:, axis, None]
        first = np.floor(ends.min(axis=1)).astype(np.int64) + 1
        count = np.maximum(np.ceil(ends.max(axis=1)).astype(np.int64) - first, 0)
        owner = np.repeat(np.arange(len(inside)), count)
        edge = first[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        owners.append(owner)
        places.append((edge - begin[owner, axis]) / step[owner, axis])
    owner, t = np.concatenate(owners), np.concatenate(places)
    order = np.lexsort((t, owner))
    owner, t = owner[order], t[order]
    points = begin[owner] + t[:, None] * step[owner]
    low, high = np.zeros(2), np.array([heightfield.cols - 1, heightfield.rows - 1])
    return owner, np.clip(points[:, :2], low, high), points[:, 2]


Cells = dict[tuple[int, int], tuple[set[Point], list[Piece]]]
"""By (row, col): the points in or on a cell that are no posts, and the pieces through it."""


def _group_by_cell(pieces: Sequence[Piece], height_of: dict[Point, float], heightfield: Heightfield) -> Cells:
    """The refined cells. A piece along a side of a cell is no piece of its inside; its ends refine both cells."""
    cells: Cells = {}

    def cell_at(row: int, col: int) -> tuple[set[Point], list[Piece]] | None:
        is_inside = 0 <= row < heightfield.rows - 1 and 0 <= col < heightfield.cols - 1
        return cells.setdefault((row, col), (set(), [])) if is_inside else None

    for point in height_of:
        (col, x), (row, y) = divmod(point[0], UNITS), divmod(point[1], UNITS)
        if x == y == 0:
            continue
        for r in (row - 1, row) if y == 0 else (row,):
            for c in (col - 1, col) if x == 0 else (col,):
                if (cell := cell_at(r, c)) is not None:
                    cell[0].add(point)
    for piece in pieces:
        (c0, r0), (c1, r1) = piece
        if not ((c0 == c1 and c0 % UNITS == 0) or (r0 == r1 and r0 % UNITS == 0)):
            found = cell_at((r0 + r1) // 2 // UNITS, (c0 + c1) // 2 // UNITS)
            if found is not None:
                found[1].append(piece)
    return cells


class _Numbers:
    """Numbers of points: of posts by their place in the padded grid, of all others as they come, behind the posts."""

    def __init__(self, height_of: dict[Point, float], padded_shape: tuple[int, int]) -> None:
        self.row_length, self.posts = padded_shape[1], padded_shape[0] * padded_shape[1]
        self._extra = [p for p in height_of if p[0] % UNITS or p[1] % UNITS]
        self._number = {p: self.posts + i for i, p in enumerate(self._extra)}
        self._heights = [height_of[p] for p in self._extra]

    def __call__(self, point: Point) -> int:
        extra = self._number.get(point)
        return point[1] // UNITS * self.row_length + point[0] // UNITS if extra is None else extra

    def vertices(self) -> npt.NDArray[np.float32]:
        places = np.array(self._extra, np.float64).reshape(-1, 2) / UNITS
        return np.column_stack([places, self._heights]).astype(np.float32)


def _patch_triangles(
    patch: list[int], triangles: dict[tuple[int, int], list[Triangle]], number: _Numbers
) -> npt.NDArray[np.int32]:
    """The triangles of a refined patch: those of its refined cells, and two for every other."""
    found: list[tuple[int, int, int]] = []
    width = number.row_length
    for row in range(patch[0] * PATCH_CELLS, (patch[0] + 1) * PATCH_CELLS):
        for col in range(patch[1] * PATCH_CELLS, (patch[1] + 1) * PATCH_CELLS):
            refined = triangles.get((row, col))
            if refined is not None:
                found += [(number(a), number(b), number(c)) for a, b, c in refined]
                continue
            nw = row * width + col
            ne, sw, se = nw + 1, nw + width, nw + width + 1
            found += [(nw, sw, se), (nw, se, ne)] if (row + col) % 2 == 0 else [(nw, sw, ne), (ne, sw, se)]
    return np.array(found, np.int32)


def _build_fins(
    height_of: dict[Point, float], heightfield: Heightfield, patches: Ints
) -> tuple[npt.NDArray[np.float32], Ints]:
    """Fins along the sides of patches: fans from one post over the lines' vertices to the next, with two faces."""
    edge_units = PATCH_CELLS * UNITS
    index_of = {(r, c): i for i, (r, c) in enumerate(patches.tolist())}
    sides: dict[tuple[bool, int, int], list[Point]] = {}  # (upright, line in units, unit edge along it) -> vertices
    for col, row in height_of:
        if col % edge_units == 0 and row % UNITS:
            sides.setdefault((True, col, row // UNITS), []).append((col, row))
        elif row % edge_units == 0 and col % UNITS:
            sides.setdefault((False, row, col // UNITS), []).append((col, row))
    fins, between = [], []
    for (upright, line, edge), vertices in sides.items():
        beyond, along = line // edge_units, edge // PATCH_CELLS
        both = [(along, beyond - 1), (along, beyond)] if upright else [(beyond - 1, along), (beyond, along)]
        if not all(patch in index_of for patch in both):
            continue  # the edge of the terrain
        posts = [(line, e * UNITS) if upright else (e * UNITS, line) for e in (edge, edge + 1)]
        chain = [posts[0], *sorted(vertices), posts[1]]
        corners = []
        for col, row in chain:
            is_post = (col, row) in posts
            height = heightfield.heights_m[row // UNITS, col // UNITS] if is_post else height_of[col, row]
            corners.append((col / UNITS, row / UNITS, height, 0.0, 0.0))
        for one, other in pairwise(corners[1:]):
            fins += [(corners[0], one, other), (corners[0], other, one)]
            between += [[index_of[both[0]], index_of[both[1]]]] * 2
    return np.array(fins, np.float32).reshape(-1, 3, 5), np.array(between, np.int64).reshape(-1, 2)


def _height_range(patch: list[int], cells: Cells, height_of: dict[Point, float]) -> tuple[float, float]:
    """The lowest and the highest of the lines' vertices in a patch."""
    heights = [
        height_of[point]
        for row in range(patch[0] * PATCH_CELLS, (patch[0] + 1) * PATCH_CELLS)
        for col in range(patch[1] * PATCH_CELLS, (patch[1] + 1) * PATCH_CELLS)
        if (row, col) in cells
        for point in cells[row, col][0]
    ]
    return (min(heights), max(heights)) if heights else (np.inf, -np.inf)


def _departures(
    heightfield: Heightfield, cells: Cells, height_of: dict[Point, float], padded_shape: tuple[int, int], top_level: int
) -> tuple[npt.NDArray[np.float32], ...]:
    """How far the refined surface may lie from the posts' own, for patches of every level.

    Any triangulation of a cell that has the surface's heights at its vertices lies within half the cell's bend of it.
    """
    rows, cols = ((n - 1) >> PATCH_LEVEL for n in padded_shape)
    departure = np.zeros((rows, cols), np.float32)
    for (row, col), (points, _) in cells.items():
        (nw, ne), (sw, se) = heightfield.heights_m[row : row + 2, col : col + 2].astype(np.float64).tolist()
        place = np.array(sorted(points), np.float64).reshape(-1, 2) / UNITS
        surface = surface_heights(heightfield.heights_m, place[:, 0], place[:, 1])
        off = np.abs(surface - [height_of[p] for p in sorted(points)]).max(initial=0.0) + abs(nw + se - ne - sw) / 2
        at = row // PATCH_CELLS, col // PATCH_CELLS
        departure[at] = max(departure[at], off)
    levels = [departure]
    for _ in range(PATCH_LEVEL, top_level):
        d = levels[-1]
        levels.append(np.maximum(np.maximum(d[::2, ::2], d[1::2, ::2]), np.maximum(d[::2, 1::2], d[1::2, 1::2])))
    return tuple(levels)
