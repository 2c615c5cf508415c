"""Texture trees over image files of any size, placed on a terrain.

Small images are read whole. Large ones are read tile by tile where the file allows it: blocks that can be reached at
once, and overviews for the coarser levels. What is missing, all levels or only the coarser ones, is made once by a
thread of its own and kept as a raw pyramid in the cache folder; until that is done, coarse tiles come from a decimated
read, where that is quick, and fine ones straight from the file, or as they become ready.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.textures.image_placement import Placement, covered_share, place_image
from terrain.textures.image_reader import NOT_8_BIT, ImageReader
from terrain.textures.raw_pyramid import FOLDER_LIMIT_BYTES, RawPyramid
from terrain.textures.streaming import give_way
from terrain.textures.tree import MOST_CELLS, TILE_PX, Pixels, TextureTree, TileNotReady, halve, pad_tile, tile_window

SMALL_PX = 1 << 24  # 4096 x 4096: 85 MiB with all levels
OVERVIEW_REACH = 4  # levels up to this many times coarser than the coarsest overview are read from it
PREVIEW_PX = 5 * TILE_PX  # per side at most
DIRECT_LEVELS = 3  # up to this level tiles are read from the pixels while the pyramid is not there: 4 million each
MOST_BLOCK_ROW_BYTES = 300 << 20
PYRAMID_VERSION = 1


class ImageSource:
    """The tiles of an image file; see `terrain.textures.tree.TileSource`.

    Parameters
    ----------
    path : str or Path
        Anything GDAL reads.
    heightfield : Heightfield
        The terrain it is to lie on.

    Raises
    ------
    InputError
        If the file is no image, or lies wholly beside the terrain.
    """

    def __init__(self, path: str | Path, heightfield: Heightfield) -> None:
        path = Path(path)
        self.name = path.name
        try:
            self._reader, place = _open_placed(path, heightfield)
        except np.linalg.LinAlgError as error:
            raise InputError(f"{path.name}: its coordinate system does not match the terrain's ({error}).") from None
        except Exception as error:  # drivers of damaged files raise whatever they like
            cause = " ".join(str(error).replace(f"{path.resolve().parent}{os.sep}", "").split())[:200]
            raise InputError(f"Expected an image in {path.name}, which cannot be read as one ({cause}).") from None
        self.image_from_post, self.size_px = place.image_from_post, place.size_px
        notes = list(place.notes) if self._reader.is_8_bit else [*place.notes, NOT_8_BIT]
        share = covered_share(heightfield, self.image_from_post)
        try:
            if share == 0.0:
                raise InputError(f"{path.name} lies beside the terrain: their extents do not overlap.")
            self._prepare(path, place, heightfield.spacing_m)
        except InputError:
            self._reader.close()
            raise
        if share < 0.995:
            notes.append(f"The image covers {_percent(share)} of the terrain.")
        self.notes = tuple(notes)

    def _prepare(self, path: Path, place: Placement, spacing_m: tuple[float, float]) -> None:
        """Decide how tiles are read; refuse what no reading could be quick for."""
        (width, height), reader = self.size_px, self._reader
        found = f"{width} x {height} in {path.name}"
        if max(self.size_px) > MOST_CELLS * TILE_PX:
            raise InputError(
                f"Expected an image of at most {MOST_CELLS * TILE_PX} pixels per side, found {found}; "
                "cut it or reduce it first (gdal_translate -outsize)."
            )
        if reader.block_row_bytes > MOST_BLOCK_ROW_BYTES:
            raise InputError(
                f"Expected rows of blocks below {MOST_BLOCK_ROW_BYTES >> 20} MB, found "
                f"{reader.block_row_bytes >> 20} MB ({found}); rewrite it first (gdal_translate -co TILED=YES)."
            )
        tree = self._tree = TextureTree(self.size_px, self.image_from_post, spacing_m)
        self._lock = threading.Lock()
        self._cancelled = threading.Event()
        self._builder: threading.Thread | None = None
        self._in_memory: list[Pixels] = []  # all levels of a small image
        self._preview: list[Pixels] = []  # levels from _preview_level on, until the pyramid is complete
        self._preview_level = next(k for k in range(tree.top_level + 1) if max(tree.level_size(k)) <= PREVIEW_PX)
        self._revision = 0
        self._pyramid: RawPyramid | None = None
        reaches_top = reader.coarsest_overview * OVERVIEW_REACH >= 1 << tree.top_level
        self._is_small = width * height <= SMALL_PX
        self._is_direct = not self._is_small and not reader.is_sequential and reaches_top
        if not (self._is_small or self._is_direct):
            first = 0 if reader.is_sequential or place.warp is not None else 1
            shapes = [tree.level_size(k)[::-1] for k in range(first, tree.top_level + 1)]
            self._pyramid = RawPyramid(_key(path, place, first), first, shapes, 4 if reader.has_alpha else 3)
            if self._pyramid.bytes > FOLDER_LIMIT_BYTES:
                raise InputError(
                    f"Expected an image with overviews, or with less than {FOLDER_LIMIT_BYTES >> 30} GB of coarser "
                    f"levels to be made, found {found}; add overviews to it first (gdaladdo)."
                )

    @property
    def revision(self) -> int:
        return self._revision

    @property
    def is_final(self) -> bool:
        return self._pyramid is None or self._pyramid.is_complete or self._is_direct

    def read_tile(self, level: int, row: int, col: int) -> Pixels:
        rows, cols, missing = tile_window(self._tree.level_size(level), row, col)
        return pad_tile(self._texels(level, rows, cols), missing)

    def close(self) -> None:
        self._cancelled.set()
        if self._builder is not None:
            self._builder.join()
        self._reader.close()

    def _texels(self, level: int, rows: slice, cols: slice) -> Pixels:
        """Some rows and columns of a level, from wherever they are to be had."""
        if self._is_small:
            return self._level_in_memory(level)[rows, cols]
        if self._pyramid is not None:
            self._begin()
            stored = self._pyramid.level(level, rows)
            if stored is not None:
                return np.asarray(stored[rows, cols])
            with self._lock:
                if level >= self._preview_level and self._preview:
                    return self._preview[level - self._preview_level][rows, cols]
        if not self._is_direct and (self._reader.is_sequential or level > DIRECT_LEVELS):
            raise TileNotReady
        return self._reader.level_texels(level, (rows.start, rows.stop), (cols.start, cols.stop))

    def _level_in_memory(self, level: int) -> Pixels:
        with self._lock:
            if not self._in_memory:
                width, height = self.size_px
                self._in_memory = list(_levels(self._reader.level_texels(0, (0, height), (0, width)), self._tree, 0))
            return self._in_memory[level]

    def _begin(self) -> None:
        """Start to build the pyramid, once."""
        with self._lock:
            if self._builder is None and self._pyramid is not None and not self._pyramid.is_complete:
                self._builder = threading.Thread(target=self._build, name=f"pyramid of {self.name}", daemon=True)
                self._builder.start()

    def _build(self) -> None:
        pyramid, tree, level = self._pyramid, self._tree, self._preview_level
        assert pyramid is not None
        give_way()
        try:
            if self._reader.decimates_fast:  # else it takes as long as the pyramid itself
                levels = list(_levels(self._reader.decimated(tree.level_size(level)), tree, level))
                with self._lock:
                    self._preview = levels
            width = tree.level_size(pyramid.first)[0]
            pyramid.build(lambda a, b: self._reader.level_texels(pyramid.first, (a, b), (0, width)), self._cancelled)
        except Exception:  # whatever a driver raises for a damaged file
            pass  # tile by tile, what can be read is shown, and what cannot is told
        with self._lock:
            self._is_direct = not pyramid.is_complete
            if self._preview:
                self._preview = []
                self._revision += 1


def _open_placed(path: Path, heightfield: Heightfield) -> tuple[ImageReader, Placement]:
    reader = ImageReader(path)
    try:
        with reader.dataset() as dataset:
            place = place_image(dataset, heightfield)
        if place.warp is None:
            return reader, place
    except BaseException:
        reader.close()
        raise
    reader.close()
    return ImageReader(path, place.warp), place


def _levels(pixels: Pixels, tree: TextureTree, level: int) -> Iterable[Pixels]:
    """A level and all coarser ones."""
    yield pixels
    for _ in range(level, tree.top_level):
        pixels = halve(pixels)
        yield pixels


def _key(path: Path, place: Placement, first: int) -> str:
    """Changes with the file and with how it is read."""
    status = path.resolve().stat()
    warp = {} if place.warp is None else {name: str(value) for name, value in place.warp.items()}
    parts = (PYRAMID_VERSION, str(path.resolve()), status.st_size, status.st_mtime_ns, sorted(warp.items()), first)
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def _percent(share: float) -> str:
    """A share that is more than nothing."""
    return f"{share:.0%}" if share >= 0.1 else f"{share:.1%}" if share >= 0.001 else "less than 0.1%"
