"""All texture trees of a terrain: what of them is wanted, loaded, resident and shown.

In each frame: choose the tiles the view needs, put those that workers have read into slots, as many as the frame's
budget allows, ask for what is missing, and write the page tables. A tile that is not there yet is shown by its nearest
resident ancestor. Nothing ever waits; whoever must have a picture that does not depend on the moment goes on until
`is_loading` is False.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from terrain.errors import InputError
from terrain.frame import Frame
from terrain.gpu.context import Gpu
from terrain.gpu.programs import TREES_BINDING
from terrain.textures.atlas import Atlas, PageTables, Table, page_entries
from terrain.textures.pages import ABSENT, FAILED, Pages, Slots
from terrain.textures.select import Bools, Selection, in_view, select_for_levels, select_levels, split_near
from terrain.textures.streaming import Request, Result, TileStream
from terrain.textures.tree import SLOT_BYTES, Floats, Ints, TextureTree, TileSource

TREE_LIMIT = 16  # as in shaders/lib/pages.glsl
UPLOAD_BYTES = 4 << 20  # per frame at most ...
UPLOAD_MS = 3.0  # ... and no further tile after this time
FIGURES = ("textures resident", "textures loading", "textures missing", "textures [MiB]")
EDGE = 1e-6  # of an image's size: what is nearer to its far edges must not be rounded to a tile beyond
MOST_REQUESTS = 64  # handed to the workers at a time; the list is made anew in every frame


@dataclass
class _Member:
    """One tree and its source."""

    source: TileSource
    pages: Pages
    handle: int
    selection: Selection
    drawn: Ints  # the cells that the table shows as something else than the root
    root: int = FAILED  # slot of the root in the table; at first none was written
    table: Table | None = None

    def draw_table(self) -> tuple[Table, int, int]:
        """The page table: what is shown in the visible cells, and the root elsewhere; which rows may have changed."""
        pages, cell, root = self.pages, self.selection.cell, int(self.pages.slot[-1])
        rows, cols = pages.tree.shapes[0].tolist()
        if self.table is None or root != self.root:
            self.drawn = np.arange(rows * cols)
            self.table = np.empty((rows, cols, 4), np.float32)
            self.root = root
        table = self.table.reshape(-1, 4)
        back, top = self.drawn, np.full(len(self.drawn), pages.tree.top_level)
        table[back] = page_entries(np.full(len(back), root), top, back // cols, back % cols)
        table[cell] = page_entries(*pages.shown(self.selection), cell // cols, cell % cols)
        self.drawn = cell
        # Both lists are sorted.
        ends = [part[[0, -1]] // cols for part in (back, cell) if len(part)]
        first, last = (int(np.min(ends)), int(np.max(ends)) + 1) if ends else (0, 0)
        return self.table, first, last


class Trees:
    """The texture trees of one terrain.

    Parameters
    ----------
    gpu : Gpu
    spacing_m : tuple of float
        Metres between the terrain's posts.
    grid : tuple of int
        (cols, rows) of the terrain's posts.
    budget_bytes : int
        Memory for tiles on the GPU.
    workers : int or None
        Threads that read tiles.
    """

    def __init__(
        self, gpu: Gpu, spacing_m: tuple[float, float], grid: tuple[int, int], budget_bytes: int,
        workers: int | None = None,
    ) -> None:  # fmt: skip
        self._gpu, self._spacing_m, self._grid = gpu, spacing_m, grid
        self._members: dict[int, _Member] = {}
        self._atlas, self._tables = Atlas(gpu, budget_bytes), PageTables(gpu)
        self._slots = Slots(0)
        self._stream = TileStream(workers)
        self._block = gpu.ctx.buffer(reserve=TREE_LIMIT * 3 * 16, dynamic=True)
        self._handles = self._frame = self._misses = self._uploaded_bytes = 0

    def add(self, source: TileSource) -> int:
        """Make a tree of a source; its number is what ``sample_tree`` in the shaders takes.

        Raises
        ------
        InputError
            If there are `TREE_LIMIT` already.
        """
        free = [number for number in range(TREE_LIMIT) if number not in self._members]
        if not free:
            raise InputError(f"Expected at most {TREE_LIMIT} images and layers at once; take one away first.")
        tree = TextureTree(source.size_px, source.image_from_post, self._spacing_m)
        none = np.zeros(0, np.int64)
        self._handles += 1
        pages = Pages(tree)
        self._members[free[0]] = _Member(source, pages, self._handles, Selection(none, none, none), none)
        self._atlas.grow(sum(member.pages.tree.tile_count for member in self._members.values()))
        self._slots.grow(self._atlas.slots)
        self._write_block()
        return free[0]

    def remove(self, number: int) -> None:
        """Take a tree away; its source is not closed."""
        member = self._members.pop(number)
        self._stream.forget(member.handle)
        self._slots.drop_tree(number)
        self._tables.drop(number)
        if not self._members:
            self._misses = 0

    def set_budget(self, budget_bytes: int) -> None:
        """Change the memory for tiles; all are loaded anew."""
        self._atlas.release()
        self._atlas, self._slots = Atlas(self._gpu, budget_bytes), Slots(0)
        self._atlas.grow(sum(member.pages.tree.tile_count for member in self._members.values()))
        self._slots.grow(self._atlas.slots)
        for member in self._members.values():
            member.pages.slot[member.pages.slot >= 0] = ABSENT

    def update(self, frame: Frame, lower_m: Floats, upper_m: Floats, tolerance_px2: float) -> None:
        """Bring the trees up to date for a frame, within the frame's budget of uploads.

        Parameters
        ----------
        frame : Frame
        lower_m, upper_m : ndarray of float64, (n, 3)
            Boxes that bound the visible ground, of the whole picture where the frame is a tile of one; world metres.
        tolerance_px2 : float
            Largest area of a texel on the screen.
        """
        chosen, whole = [], frame.whole
        for member in self._members.values():
            tree = member.pages.tree
            boxes = split_near(tree, lower_m, upper_m, whole, tolerance_px2)
            seen = None if whole is frame else in_view(*boxes, frame)
            chosen.append((*boxes, *select_levels(tree, *boxes, whole, tolerance_px2), seen))
        self._frame += 1
        self._choose(chosen)
        for member in self._members.values():
            slots = member.pages.slot[member.selection.tiles]
            self._slots.touch(slots[slots >= 0], self._frame)
        self._upload()
        self._ask()
        for number, member in self._members.items():
            self._tables.write(number, *member.draw_table())

    def wait(self, timeout_s: float) -> None:
        """Sleep until a tile has been read, or for ``timeout_s``."""
        self._stream.wait(timeout_s)

    def check(self) -> None:
        """Say so where not even the coarsest tile of a tree could be read.

        Raises
        ------
        InputError
        """
        for member in self._members.values():
            if member.pages.slot[-1] == FAILED:
                self._stream.take_messages()
                cause = self._stream.cause(member.handle)
                raise InputError(f"Expected an image in {member.source.name}, of which nothing can be read ({cause}).")

    @property
    def count(self) -> int:
        return len(self._members)

    @property
    def is_loading(self) -> bool:
        """Whether the picture will change by itself: something is missing, or only a preview yet."""
        return self._misses > 0 or not all(member.source.is_final for member in self._members.values())

    @property
    def figures(self) -> dict[str, float]:
        """Counters for the panel, named as in `FIGURES`; none without trees."""
        if not self._members:
            return {}
        mib = self._slots.used * SLOT_BYTES / 2**20
        return dict(zip(FIGURES, (self._slots.used, self._stream.loading, self._misses, mib), strict=True))

    @property
    def resident_bytes(self) -> int:
        """Memory taken on the GPU."""
        return self._atlas.allocated_bytes

    @property
    def uploaded_bytes(self) -> int:
        """Uploaded for the last frame."""
        return self._uploaded_bytes

    def take_messages(self) -> list[str]:
        """What went wrong since the last call, one line each."""
        return self._stream.take_messages()

    def bind(self) -> None:
        """Bind what shaders read."""
        self._atlas.bind()
        self._tables.bind()
        self._block.bind_to_uniform_block(TREES_BINDING)

    def release(self) -> None:
        """End the threads and free the GPU's memory; sources are not closed."""
        self._stream.release()
        for part in (self._atlas, self._tables, self._block):
            part.release()
        self._members.clear()

    def _choose(self, chosen: list[tuple[Floats, Floats, Ints, Floats, Bools | None]]) -> None:
        """Select for every tree; where all together need more slots than there are, each gets its share."""
        room = self._slots.count
        members = list(self._members.values())
        for most in (room, room // max(len(members), 1)):
            for member, boxes in zip(members, chosen, strict=True):
                member.selection = select_for_levels(member.pages.tree, *boxes, most_tiles=most)
            if sum(len(member.selection.tiles) for member in members) <= room:
                return

    def _upload(self) -> None:
        """Put tiles that were read into slots."""
        begin = time.perf_counter()
        self._uploaded_bytes = 0
        by_handle = {member.handle: (number, member) for number, member in self._members.items()}
        while self._uploaded_bytes < UPLOAD_BYTES and (time.perf_counter() - begin) * 1e3 < UPLOAD_MS:
            results = self._stream.collect(1)
            if not results:
                break
            if results[0].handle in by_handle:
                self._place(results[0], *by_handle[results[0].handle])

    def _place(self, result: Result, number: int, member: _Member) -> None:
        pages, tile = member.pages, result.number
        if result.pixels is None:
            if pages.slot[tile] < 0:
                pages.slot[tile] = FAILED
            pages.revision[tile] = result.revision
            return
        slot = int(pages.slot[tile])
        if slot < 0:
            if not (member.selection.tiles == tile).any():
                return  # read for a view that is gone
            taken = self._slots.take(number, tile, self._frame)
            if taken is None:
                return
            slot, evicted = taken
            if evicted is not None:
                self._members[evicted[0]].pages.slot[evicted[1]] = ABSENT
            pages.slot[tile] = slot
        self._atlas.write(slot, result.pixels)
        pages.revision[tile] = result.revision
        self._uploaded_bytes += SLOT_BYTES

    def _ask(self) -> None:
        """Tell the workers what is missing: of all trees in turn, the most urgent first."""
        queue: list[tuple[int, Request]] = []
        self._misses = 0
        for member in self._members.values():
            tiles = member.selection.tiles
            missing = tiles[member.pages.missing(tiles, member.source.revision)]
            self._misses += len(missing)
            first = missing[:MOST_REQUESTS]
            for place, (tile, level, row, col) in enumerate(
                zip(first.tolist(), *(part.tolist() for part in member.pages.tree.locate(first)), strict=True)
            ):
                queue.append((place, Request(member.handle, tile, member.source, level, row, col)))
        queue.sort(key=lambda entry: entry[0])
        self._stream.want([request for _, request in queue[:MOST_REQUESTS]])

    def _write_block(self) -> None:
        """The uniform block: for each tree the affine map from ground coordinates to pixels, and the last pixel."""
        block = np.zeros((TREE_LIMIT, 3, 4), np.float32)
        cols, rows = self._grid
        post_from_ground = np.array([[cols, 0.0, -0.5], [0.0, rows, -0.5], [0.0, 0.0, 1.0]])
        for number, member in self._members.items():
            tree = member.pages.tree
            block[number, :2, :3] = np.diag(tree.size_px) @ tree.image_from_post @ post_from_ground
            block[number, 2, :2] = np.array(tree.size_px) * (1.0 - EDGE)
        self._block.write(block.tobytes())
