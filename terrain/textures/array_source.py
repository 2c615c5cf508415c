"""Texture trees from arrays: small images, and thematic layers that were computed."""

from __future__ import annotations

import threading

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Heightfield
from terrain.textures.tree import Floats, Pixels, cut_tile, halve


class ArraySource:
    """Tiles of an array in memory. May be given another picture of the same size at any time.

    Parameters
    ----------
    name : str
    pixels : ndarray of uint8, (rows, cols, 3 or 4)
        RGB or RGBA, sRGB, not premultiplied, row 0 first.
    image_from_post : ndarray of float64, (2, 3)
        As in `terrain.textures.tree.TileSource`; `whole_extent` covers the whole terrain.
    """

    is_final = True

    def __init__(self, name: str, pixels: Pixels, image_from_post: Floats, notes: tuple[str, ...] = ()) -> None:
        self.name, self.image_from_post, self.notes = name, image_from_post, notes
        self.size_px = (pixels.shape[1], pixels.shape[0])
        self._lock = threading.Lock()
        self._levels = [premultiplied(pixels)]
        self._revision = 0

    @property
    def revision(self) -> int:
        return self._revision

    def replace(self, pixels: Pixels) -> None:
        """Show other pixels (of the same size) from now on."""
        with self._lock:
            self._levels = [premultiplied(pixels)]
            self._revision += 1

    def read_tile(self, level: int, row: int, col: int) -> Pixels:
        with self._lock:
            while len(self._levels) <= level:
                self._levels.append(halve(self._levels[-1]))
            pixels = self._levels[level]
        return cut_tile(pixels, row, col)

    def close(self) -> None:
        """Nothing to let go of."""


def whole_extent(heightfield: Heightfield) -> Floats:
    """``image_from_post`` of an image of the whole terrain; a post stands for the area around it, as a pixel does."""
    cols, rows = heightfield.cols, heightfield.rows
    return np.array([[1.0 / cols, 0.0, 0.5 / cols], [0.0, 1.0 / rows, 0.5 / rows]])


def premultiplied(pixels: Pixels) -> Pixels:
    """Colours times alpha: what is filtered and blended without dark or bright rims. Opaque pixels stay as they are."""
    if pixels.shape[2] == 3:
        return pixels
    alpha: npt.NDArray[np.uint16] = pixels[..., 3:].astype(np.uint16)
    if (alpha == 255).all():
        return pixels
    return np.concatenate([((pixels[..., :3] * alpha + 127) // 255).astype(np.uint8), pixels[..., 3:]], axis=2)
