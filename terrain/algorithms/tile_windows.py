"""Windows of a grid of tiles, and masks of tiles from one size to the next: whole arrays, no tile by tile."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Bools = npt.NDArray[np.bool_]
Window = tuple[slice, slice]


def whole(mask: Bools) -> Window:
    return slice(0, mask.shape[0]), slice(0, mask.shape[1])


def bounding_window(mask: Bools, outer: Window) -> Window:
    """The smallest window that holds all that is set in ``mask``, which lies in ``outer``; empty if nothing is."""
    bits = mask.view(np.uint8)  # their maximum is found faster than whether any is true
    rows, cols = np.flatnonzero(bits.max(axis=1, initial=0)), np.flatnonzero(bits.max(axis=0, initial=0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    (top, left), (last_row, last_col) = (w.start for w in outer), (int(rows[-1]) + 1, int(cols[-1]) + 1)
    return slice(top + int(rows[0]), top + last_row), slice(left + int(cols[0]), left + last_col)


def parts_window(window: Window, outer: Window, margin: int) -> Window:
    """The window of tiles of half the size, widened by ``margin`` of them inside ``outer``, aligned to whole tiles."""
    rows, cols = (
        slice(
            max(2 * inner.start - margin, 2 * bound.start) // 2 * 2,
            max(min(2 * inner.stop + margin + 1, 2 * bound.stop) // 2 * 2, 2 * bound.start),
        )
        for inner, bound in zip(window, outer, strict=True)
    )
    return rows, cols


def grown(mask: Bools) -> Bools:
    """The mask and a ring of one tile around it."""
    padded = bordered(mask, np.bool_(False))
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return np.asarray(rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:])


def join_parts(parts: npt.NDArray[Any], how: np.ufunc) -> npt.NDArray[Any]:
    """Blocks of 2 x 2 joined by a ufunc; both sides are even."""
    return how(how(parts[::2, ::2], parts[1::2, ::2]), how(parts[::2, 1::2], parts[1::2, 1::2]))


def doubled(mask: Bools) -> Bools:
    """Every element as 2 x 2: two bytes at a time across, then row by row."""
    return np.repeat((mask.view(np.uint8) * np.uint16(0x0101)).view(np.bool_), 2, axis=0)


def bordered(field: npt.NDArray[Any], value: np.generic) -> npt.NDArray[Any]:
    """The field with a border of one tile."""
    result = np.full((field.shape[0] + 2, field.shape[1] + 2), value, field.dtype)
    result[1:-1, 1:-1] = field
    return result
