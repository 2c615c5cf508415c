"""Parts of image files as RGBA: whatever GDAL reads, at any reduction, by several threads."""

from __future__ import annotations

import os
import queue
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terrain.textures.array_source import premultiplied
from terrain.textures.tree import Pixels

HANDLES = 3  # open datasets: GDAL's must not be used by two threads at once
SEQUENTIAL = {"PNG", "JPEG", "GIF", "WEBP", "BIGGIF", "JPEGXL", "HEIF", "AVIF"}  # decoded from the start only
LARGEST_BLOCK_PX = 1 << 20  # larger blocks make a file no better than sequential
STRETCH_PX = 512  # per side: from how many pixels the range of values is estimated
_GDAL_OPTIONS = {
    "GDAL_CACHEMAX": 256 << 20,  # bytes of blocks kept; GDAL's own default is a twentieth of the memory
    "GDAL_HTTP_CONNECTTIMEOUT": 3,  # a local file may name remote ones
    "GDAL_HTTP_TIMEOUT": 10,
    "GDAL_HTTP_MAX_RETRY": 0,
}
NOT_8_BIT = "Stretched to 8 bits between its 1st and 99th percentile."


class ImageReader:
    """An image file, or the same warped to another coordinate system.

    Parameters
    ----------
    path : Path
    warp : dict or None
        Options of ``rasterio.vrt.WarpedVRT``.

    Raises
    ------
    rasterio.errors.RasterioError
        If GDAL cannot open it.
    """

    def __init__(self, path: Path, warp: dict[str, Any] | None = None) -> None:
        from rasterio.enums import ColorInterp, MaskFlags

        self._path, self._warp = path, warp
        self._free: queue.LifoQueue[Any] = queue.LifoQueue()
        self._closers: list[Any] = []
        datasets = [self._open() for _ in range(HANDLES)]
        for dataset in datasets:
            self._free.put(dataset)
        self.size_px = (dataset.width, dataset.height)
        interpretation = list(dataset.colorinterp)
        alpha = interpretation.index(ColorInterp.alpha) + 1 if ColorInterp.alpha in interpretation else None
        bands = [band for band in dataset.indexes if band != alpha]
        self._bands = bands[:3] if len(bands) >= 3 else bands[:1]
        self._table = _colour_table(dataset) if interpretation[0] == ColorInterp.palette else None
        self._is_masked = MaskFlags.all_valid not in dataset.mask_flag_enums[0]
        self.has_alpha = self._is_masked or (self._table is not None and bool((self._table[:, 3] < 255).any()))
        self.is_8_bit = dataset.dtypes[self._bands[0] - 1] == "uint8"
        self._range: tuple[float, float] | None = None
        block_rows, block_cols = dataset.block_shapes[0]
        interleaved = str(dataset.tags(ns="IMAGE_STRUCTURE").get("INTERLEAVE", "")).upper() == "PIXEL"
        decoded_bands = dataset.count if interleaved else len(bands[:3])
        self.block_row_bytes = block_rows * max(dataset.width, block_cols) * decoded_bands * _item_bytes(dataset)
        self.is_sequential = self._source_driver in SEQUENTIAL or block_rows * block_cols > LARGEST_BLOCK_PX
        self.coarsest_overview = max(self._overviews, default=1)
        self.decimates_fast = bool(self._overviews) or not (self.is_sequential or self._is_compressed)

    def _open(self) -> Any:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning
        from rasterio.vrt import WarpedVRT

        with warnings.catch_warnings(), rasterio.Env(**_GDAL_OPTIONS):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            source = rasterio.open(os.path.abspath(self._path))
            self._source_driver, self._overviews = source.driver, source.overviews(1)
            self._is_compressed = source.compression is not None
            dataset = source if self._warp is None else WarpedVRT(source, **self._warp)
        self._closers += [source] if self._warp is None else [dataset, source]
        return dataset

    def level_texels(self, level: int, rows: tuple[int, int], cols: tuple[int, int]) -> Pixels:
        """Texels [first, last) of a level, RGBA premultiplied: means of 2^level x 2^level pixels.

        The last texel of a row or column may reach past the image's edge: it is read on its own, since GDAL would
        stretch what there is over the whole window.
        """
        with self.dataset() as dataset:
            lines = []
            for row0, row1, y0, y1 in _pieces(self.size_px[1], level, *rows):
                line = [
                    self._read(dataset, (x0, y0, x1, y1), (row1 - row0, col1 - col0))
                    for col0, col1, x0, x1 in _pieces(self.size_px[0], level, *cols)
                ]
                lines.append(np.concatenate(line, axis=1))
            return np.concatenate(lines)

    def decimated(self, size_px: tuple[int, int]) -> Pixels:
        """The whole image at another size (width, height), quickly: nearest pixels."""
        with self.dataset() as dataset:
            return self._read(dataset, (0, 0, *self.size_px), size_px[::-1], averaged=False)

    def close(self) -> None:
        """Let go of the file, as soon as nobody reads from it."""
        closers, self._closers = self._closers, []
        for _ in range(HANDLES if closers else 0):
            self._free.get()  # GDAL would crash if it were closed under a reader
        for dataset in closers:
            dataset.close()
        self._free.put(None)

    @contextmanager
    def dataset(self) -> Iterator[Any]:
        """An open dataset that no other thread uses meanwhile."""
        import rasterio

        dataset = self._free.get()
        if dataset is None:
            self._free.put(None)  # for the next who comes too late
            raise OSError(f"{self._path.name} was closed")
        try:
            with rasterio.Env(**_GDAL_OPTIONS):
                yield dataset
        finally:
            self._free.put(dataset)

    def _read(
        self, dataset: Any, box: tuple[int, int, int, int], shape: tuple[int, int], averaged: bool = True
    ) -> Pixels:
        """Pixels ``(x0, y0, x1, y1)`` reduced to ``shape`` (rows, cols)."""
        from rasterio.enums import Resampling
        from rasterio.windows import Window

        x0, y0, x1, y1 = box
        area: dict[str, Any] = {"window": Window(x0, y0, x1 - x0, y1 - y0)}
        if averaged and self._table is None and shape != (y1 - y0, x1 - x0):
            area["resampling"] = Resampling.average
        if self._table is not None:
            pixels = self._table[np.minimum(dataset.read(self._bands[0], out_shape=shape, **area), 255)]
        else:
            data = dataset.read(self._bands, out_shape=(len(self._bands), *shape), **area)
            if not self.is_8_bit:
                data = self._stretch(dataset, data)
            pixels = np.empty((*shape, 4), np.uint8)
            pixels[..., :3] = np.moveaxis(data, 0, -1)  # one band fills all three
            pixels[..., 3] = 255
        if self._is_masked:
            mask = dataset.dataset_mask(window=area["window"], out_shape=shape, resampling=Resampling.nearest)
            pixels[..., 3] = np.minimum(pixels[..., 3], mask)
        return premultiplied(pixels)

    def _stretch(self, dataset: Any, data: npt.NDArray[Any]) -> Pixels:
        """Values as bytes, between the 1st and the 99th percentile of the whole image."""
        if self._range is None:
            shrink = max(1.0, max(self.size_px) / STRETCH_PX)
            shape = (len(self._bands), *(max(1, round(n / shrink)) for n in self.size_px[::-1]))
            sample = np.nan_to_num(dataset.read(self._bands, out_shape=shape).astype(np.float32))
            low, high = (float(v) for v in np.percentile(sample, [1.0, 99.0]))
            self._range = low, 255.0 / max(high - low, 1e-9)
        values = np.nan_to_num(data.astype(np.float32))
        return np.clip((values - self._range[0]) * self._range[1], 0, 255).astype(np.uint8)


def _item_bytes(dataset: Any) -> int:
    """Bytes of a number; types numpy does not know (complex integers) count as the largest."""
    try:
        return np.dtype(dataset.dtypes[0]).itemsize
    except TypeError:
        return 16


def _colour_table(dataset: Any) -> Pixels:
    table = np.zeros((256, 4), np.uint8)
    for index, colour in dataset.colormap(1).items():
        table[min(index, 255)] = colour
    return table


def _pieces(length: int, level: int, first: int, last: int) -> list[tuple[int, int, int, int]]:
    """Texels [first, last) of a side: those that lie wholly in the image, and the one that reaches past its edge.

    Each piece is (first texel, last texel, first pixel, last pixel).
    """
    whole = length >> level
    pieces = []
    if first < min(last, whole):
        pieces.append((first, min(last, whole), first << level, min(last, whole) << level))
    if last > whole:
        pieces.append((whole, whole + 1, whole << level, length))
    return pieces
