"""Index buffers of square tiles, shared by the renderers that draw them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Diagonal


def build_tile_indices(cells: int, diagonal: Diagonal = "alternating") -> npt.NDArray[np.uint32]:
    """Triangles of a tile of ``cells`` x ``cells`` cells: (6 cells^2,) indices, counter-clockwise from above.

    Post (row, col) has index ``row * (cells + 1) + col``; the tile's north-west cell is cell (even, even) of its level.
    """
    row, col = np.mgrid[:cells, :cells]
    nw = row * (cells + 1) + col
    ne, sw, se = nw + 1, nw + cells + 1, nw + cells + 2
    nw_se = np.stack([nw, se, ne, nw, sw, se], axis=-1)
    sw_ne = np.stack([nw, sw, ne, ne, sw, se], axis=-1)
    even = (row + col) % 2 == 0 if diagonal == "alternating" else np.zeros_like(row, np.bool_)
    return np.where(even[..., None], nw_se, sw_ne).reshape(-1).astype(np.uint32)
