"""Polygon boxes of adaptive slicing: triangle fans around every second post, or around fewer where ground is smooth.

Source: S. Röttger, T. Ertl, *Hardware Accelerated Terrain Rendering by Adaptive Slicing*, VMV 2001, sections 4 and 7
("combined with continuous level of detail").

Deviation: a fan may span 2 x 2 cells of several posts. Along the border between two tiles both keep the posts of the
finer one, and beside slices all: a tile that has finer neighbours is drawn with all posts along its border, and the
shader moves those that are not needed onto the next that is (``shaders/lib/fans.glsl``). So tiles of any two sizes and
strides meet without a gap, and so do tiles and slices.
"""

from __future__ import annotations

from itertools import pairwise

import moderngl
import numpy as np
import numpy.typing as npt

from terrain.algorithms.slicing_cost import TILE_LEVELS, tile_strides
from terrain.algorithms.slicing_tree import Nodes
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.geometry import Geometry
from terrain.gpu.programs import UNITS
from terrain.pyramid import BASE_LEVEL

# Stands for the stride of a box that is not drawn: nothing needs to fit to it.
NOTHING = 15


class FanTiles:
    """Tiles of all sizes and strides; those of one kind are one instanced draw."""

    def __init__(self, gpu: Gpu, cells: tuple[int, int]) -> None:
        self._cells = cells
        largest = TILE_LEVELS[-1]
        rows, cols = ((-(-n >> largest) << largest - BASE_LEVEL) + 2 for n in cells)  # one more on every side
        self._kept = np.zeros((rows, cols), np.uint8)
        self._map = gpu.ctx.texture((cols, rows), 1, dtype="u1", alignment=1)
        self._map.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._sets = {
            (level, stride, step): _TileSet(gpu, 1 << level, stride, step)
            for level in TILE_LEVELS
            for stride in tile_strides(level)
            for step in {0, stride}
        }

    @property
    def triangles(self) -> int:
        return sum(tiles.triangles for tiles in self._sets.values())

    @property
    def draw_calls(self) -> int:
        return sum(tiles.count > 0 for tiles in self._sets.values())

    @property
    def resident_bytes(self) -> int:
        return sum(tiles.resident_bytes for tiles in self._sets.values())

    def write(self, nodes: Nodes, stride: npt.NDArray[np.int32], sliced: Nodes) -> int:
        """Upload the tiles of nodes (n,) drawn with every 2^stride-th post; returns the number of bytes.

        ``sliced`` are the nodes drawn as slices.
        """
        for tiles in self._sets.values():
            tiles.count = 0
        if not stride.any():  # nothing has to fit to anything
            level_of = np.minimum(nodes.level, TILE_LEVELS[-1])
            return sum(
                self._sets[level, 0, 0].write(split_nodes(nodes.where(level_of == level), level, self._cells))
                for level in np.unique(level_of).tolist()
            )
        self._kept[:] = NOTHING
        level_of = np.minimum(sliced.level, TILE_LEVELS[-1])
        for level in np.unique(level_of).tolist():
            self._mark(split_nodes(sliced.where(level_of == level), level, self._cells), level, 0)  # all posts
        kind = np.minimum(nodes.level, TILE_LEVELS[-1]) << 4 | stride
        tiles_of = {}
        for one in np.unique(kind).tolist():
            level, every = one >> 4, one & 15
            tiles_of[level, every] = posts = split_nodes(nodes.where(kind == one), level, self._cells)
            self._mark(posts, level, every)
        self._map.write(self._kept)
        uploaded = self._kept.nbytes
        for (level, every), posts in tiles_of.items():
            if every:
                has_finer = self._have_finer_neighbours(posts, level, every)
                uploaded += self._sets[level, every, 0].write(posts[has_finer])
                posts = posts[~has_finer]
            uploaded += self._sets[level, every, every].write(posts)
        return uploaded

    def _mark(self, posts: npt.NDArray[np.int32], level: int, stride: int) -> None:
        """Note the stride of squares of ``level`` with these north-west posts (n, 2)."""
        col, row = (posts.T >> BASE_LEVEL)[:, :, None, None] + 1
        boxes = np.arange(1 << (level - BASE_LEVEL))
        self._kept[row + boxes[:, None], col + boxes] = stride

    def _have_finer_neighbours(
        self, posts: npt.NDArray[np.int32], level: int, stride: int
    ) -> npt.NDArray[np.bool_]:  # fmt: skip
        """Whether tiles of ``level`` with these north-west posts (n, 2) have a smaller stride on one of their sides."""
        size = 1 << (level - BASE_LEVEL)
        col, row = (posts.T >> BASE_LEVEL)[:, :, None] + 1
        along = np.arange(size)
        sides = ((row - 1, col + along), (row + size, col + along), (row + along, col - 1), (row + along, col + size))
        return np.any([(self._kept[r, c] < stride).any(axis=1) for r, c in sides], axis=0)

    def draw(self, frame: Frame) -> None:
        self._map.use(UNITS["u_extra2"])
        for tiles in self._sets.values():
            tiles.draw(frame, centres=False)

    def draw_centres(self, frame: Frame) -> None:
        """The debug picture of figure 4: dark centres."""
        self._map.use(UNITS["u_extra2"])
        for tiles in self._sets.values():
            tiles.draw(frame, centres=True)

    def release(self) -> None:
        for tiles in self._sets.values():
            tiles.release()
        self._map.release()


class _TileSet:
    """Tiles of one size and stride, with every 2^step-th post along their border."""

    def __init__(self, gpu: Gpu, cells: int, stride: int, step: int) -> None:
        self._cells, self._stride = cells, stride
        self.count = 0
        indices = build_fan_indices(cells, 1 << stride, 1 << step)
        self._triangles = len(indices) // 3
        self._indices = gpu.ctx.buffer(indices)
        self._posts = gpu.ctx.buffer(reserve=8 << 8, dynamic=True)
        content = [(self._posts, "2i /i", "in_tile")]
        self._surface = Geometry(gpu, "slicing_fans", "mesh", content, self._indices)
        self._centres = Geometry(gpu, "slicing_centres", "slicing_figure", content, self._indices)

    @property
    def triangles(self) -> int:
        return self._triangles * self.count

    @property
    def resident_bytes(self) -> int:
        return int(self._indices.size + self._posts.size)

    def write(self, posts: npt.NDArray[np.int32]) -> int:
        """Upload the north-west posts (n, 2) of the tiles; returns the number of bytes."""
        self.count = len(posts)
        if not self.count:
            return 0
        if posts.nbytes > self._posts.size:
            self._posts.orphan(2 * posts.nbytes)
        self._posts.write(posts)
        return posts.nbytes

    def draw(self, frame: Frame, centres: bool) -> None:
        if not self.count:
            return
        geometry = self._centres if centres else self._surface
        program = geometry.program(frame.output)
        program["u_tile_posts"], program["u_stride"] = self._cells + 1, self._stride
        geometry.render(frame.output, moderngl.TRIANGLES, instances=self.count)

    def release(self) -> None:
        for part in (self._surface, self._centres, self._indices, self._posts):
            part.release()


def build_fan_indices(cells: int, stride: int, step: int) -> npt.NDArray[np.uint32]:
    """Triangles of a tile of ``cells`` x ``cells`` cells, counter-clockwise from above: (3 n,) indices.

    Fans of 2 x 2 cells of ``stride`` posts, with every ``step``-th post along the tile's border. Post (row, col) has
    index ``row * (cells + 1) + col``. With a stride of 1 these are the triangles of the surface itself.
    """
    triangles = []
    for row in range(stride, cells, 2 * stride):
        for col in range(stride, cells, 2 * stride):
            triangles += [((row, col), *edge) for edge in _rim(row, col, stride, step, cells)]
    posts = np.array(triangles)  # (n, 3, row and col)
    return (posts[..., 0] * (cells + 1) + posts[..., 1]).reshape(-1).astype(np.uint32)


def _rim(row: int, col: int, stride: int, step: int, cells: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Edges around the fan of a centre, counter-clockwise from its north-west corner."""
    north, south, west, east = row - stride, row + stride, col - stride, col + stride
    sides = (
        [(r, west) for r in _posts(north, south, step if west == 0 else stride)],
        [(south, c) for c in _posts(west, east, step if south == cells else stride)],
        [(r, east) for r in _posts(south, north, step if east == cells else stride)],
        [(north, c) for c in _posts(east, west, step if north == 0 else stride)],
    )
    return [edge for side in sides for edge in pairwise(side)]


def _posts(first: int, last: int, step: int) -> list[int]:
    return list(range(first, last + 1, step)) if last > first else list(range(first, last - 1, -step))


def split_nodes(nodes: Nodes, level: int, cells: tuple[int, int]) -> npt.NDArray[np.int32]:
    """North-west posts (n, 2), col before row, of the tiles of ``level`` in nodes at or above it, inside the grid."""
    if (nodes.level == level).all():
        return np.ascontiguousarray(np.stack([nodes.col, nodes.row], axis=1) << level)
    parts = np.left_shift(np.int32(1), nodes.level - level)
    squares = parts * parts
    node = np.repeat(np.arange(len(parts)), squares)
    number = np.arange(len(node)) - np.repeat(np.cumsum(squares) - squares, squares)
    row = (nodes.row[node] * parts[node] + number // parts[node]) << level
    col = (nodes.col[node] * parts[node] + number % parts[node]) << level
    inside = (row < cells[0]) & (col < cells[1])
    return np.ascontiguousarray(np.stack([col[inside], row[inside]], axis=1), np.int32)
