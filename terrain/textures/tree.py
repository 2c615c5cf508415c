"""Texture trees: an image of any size as a pyramid of levels, and each level as square tiles of one size.

Level 0 is the image itself; a texel of level k covers 2^k x 2^k of its pixels, exactly, whatever the image's size: the
last texels of a row or column may reach past the image's edge. The coarsest level is one tile. Every tile is read
with a border of its neighbours' texels, so that bilinear filtering within it has no seams.

**Source** J. Doellner, "Integrated multiresolution modeling of terrain geometry and terrain texture data", section
"Multiresolution data structure for terrain textures".

**Deviations** In the paper a texture patch belongs to a geometry patch and has its shape. Here the trees of textures
have shapes of their own, since images are not bound to the grid's; `select` finds what a piece of ground needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

TILE_PX = 254  # per side, without the border
BORDER_PX = 1  # on each side: what bilinear filtering reads beyond the tile
SLOT_PX = TILE_PX + 2 * BORDER_PX
SLOT_BYTES = 4 * SLOT_PX * SLOT_PX
MOST_CELLS = 1024  # finest tiles per side: images of up to 260 096 pixels each way

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]


class TileNotReady(Exception):
    """The source cannot read this tile yet; its parent is shown, and it is asked for again a little later."""


class TileSource(Protocol):
    """Where the tiles of one tree come from: an image file, an array, something computed.

    Attributes
    ----------
    name : str
        What to call it in a message.
    size_px : tuple of int
        (width, height) of level 0.
    image_from_post : ndarray of float64, (2, 3)
        Image coordinates (0..1, origin at the corner of pixel (0, 0)) = ``image_from_post @ (col, row, 1)``.
    notes : tuple of str
        What was decided while opening it, one sentence each.
    revision : int
        Grows when what `read_tile` gives has changed: tiles are then read again, the old ones shown meanwhile.
    is_final : bool
        False while what is read is only a preview; whoever waits for a finished picture waits for this too.
    """

    name: str
    size_px: tuple[int, int]
    image_from_post: Floats
    notes: tuple[str, ...]

    @property
    def revision(self) -> int: ...
    @property
    def is_final(self) -> bool: ...

    def read_tile(self, level: int, row: int, col: int) -> Pixels:
        """RGBA with colours premultiplied by alpha, (SLOT_PX, SLOT_PX, 4). Called by several threads at once.

        Raises
        ------
        TileNotReady
            If it should be asked for again later; any other exception means that this tile cannot be read.
        """
        ...

    def close(self) -> None:
        """Let go of files and threads; no tile is read any more."""
        ...


@dataclass(frozen=True, eq=False)
class TextureTree:
    """The tiles of one image over one grid of posts.

    Tiles have numbers: those of level 0 row by row, then those of level 1, and so on.

    Parameters
    ----------
    size_px : tuple of int
        (width, height) of level 0, any from 1 x 1.
    image_from_post : ndarray of float64, (2, 3)
        As in `TileSource`.
    spacing_m : tuple of float
        Metres between posts, (dx, dz).

    Raises
    ------
    ValueError
        If the image has more than `MOST_CELLS` tiles per side.
    """

    size_px: tuple[int, int]
    image_from_post: Floats
    spacing_m: tuple[float, float]

    def __post_init__(self) -> None:
        if not 1 <= min(self.size_px) <= max(self.size_px) <= MOST_CELLS * TILE_PX:
            raise ValueError(f"expected an image of 1 to {MOST_CELLS * TILE_PX} pixels per side, found {self.size_px}")

    @cached_property
    def top_level(self) -> int:
        """The level that is one tile."""
        return (-(-max(self.size_px) // TILE_PX) - 1).bit_length()

    def level_size(self, level: int) -> tuple[int, int]:
        """(width, height) of a level in texels."""
        width, height = self.size_px
        return -(-width // (1 << level)), -(-height // (1 << level))

    @cached_property
    def shapes(self) -> Ints:
        """(levels, 2): rows and columns of tiles of every level."""
        sizes = np.array([self.level_size(level)[::-1] for level in range(self.top_level + 1)], np.int64)
        return -(-sizes // TILE_PX)

    @cached_property
    def _first(self) -> Ints:
        """(levels + 1,): the number of the first tile of each level, and the number of tiles."""
        return np.concatenate([[0], np.cumsum(self.shapes.prod(axis=1))])

    @property
    def tile_count(self) -> int:
        return int(self._first[-1])

    def number_of(self, level: npt.ArrayLike, row: npt.ArrayLike, col: npt.ArrayLike) -> Ints:
        """Numbers of tiles."""
        level = np.asarray(level, np.int64)
        return self._first[level] + np.asarray(row, np.int64) * self.shapes[level, 1] + np.asarray(col, np.int64)

    def locate(self, number: npt.ArrayLike) -> tuple[Ints, Ints, Ints]:
        """Level, row and column of tiles: the inverse of `number_of`."""
        number = np.asarray(number, np.int64)
        level = np.searchsorted(self._first, number, "right") - 1
        within = number - self._first[level]
        return level, within // self.shapes[level, 1], within % self.shapes[level, 1]

    @cached_property
    def px_from_ground(self) -> Floats:
        """(2, 3): pixels of level 0 = ``px_from_ground @ (x, z, 1)``, x and z in world metres."""
        per_post = np.diag(self.size_px) @ self.image_from_post
        per_post[:, :2] /= self.spacing_m
        return per_post

    @cached_property
    def pixel_m2(self) -> float:
        """Ground covered by a pixel of level 0."""
        return 1.0 / max(abs(float(np.linalg.det(self.px_from_ground[:, :2]))), 1e-12)


def halve(pixels: Pixels) -> Pixels:
    """The next coarser level: means of 2 x 2 texels; at an odd edge of those there are."""
    rows, cols = pixels.shape[:2]
    if rows % 2 or cols % 2:
        pixels = np.pad(pixels, ((0, rows % 2), (0, cols % 2), (0, 0)), mode="edge")
    pairs = pixels[0::2].astype(np.uint16)
    pairs += pixels[1::2]
    sums = pairs[:, 0::2] + pairs[:, 1::2]
    sums += 2
    sums >>= 2
    return sums.astype(np.uint8)


def tile_window(size: tuple[int, int], row: int, col: int) -> tuple[slice, slice, list[tuple[int, int]]]:
    """Which rows and columns of a level a tile and its border have, and how many are missing before and after them.

    Parameters
    ----------
    size : tuple of int
        (width, height) of the level in texels.
    row, col : int
        The tile.
    """
    slices, missing = [], []
    for at, length in ((row, size[1]), (col, size[0])):
        begin, end = at * TILE_PX - BORDER_PX, (at + 1) * TILE_PX + BORDER_PX
        slices.append(slice(max(begin, 0), min(end, length)))
        missing.append((max(-begin, 0), max(end - length, 0)))
    return slices[0], slices[1], missing


def pad_tile(pixels: Pixels, missing: list[tuple[int, int]]) -> Pixels:
    """A whole slot from what a level has of it: RGBA, the level's edge repeated outwards."""
    if pixels.shape[2] == 3:
        pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
    if any(map(any, missing)):
        pixels = np.pad(pixels, (*missing, (0, 0)), mode="edge")
    return np.ascontiguousarray(pixels)


def cut_tile(level_pixels: Pixels, row: int, col: int) -> Pixels:
    """A tile with its border from a whole level (rows, cols, 3 or 4)."""
    rows, cols, missing = tile_window((level_pixels.shape[1], level_pixels.shape[0]), row, col)
    return pad_tile(np.asarray(level_pixels[rows, cols]), missing)
