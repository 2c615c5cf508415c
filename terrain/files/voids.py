"""Posts without data: what the file declares, what is no number, and the numbers that others leave undeclared.

An undeclared number counts as "no data" only where it lies far outside the range of all other posts, so that a trench
that happens to reach -9999 stays a trench.

**Source** the numbers in use: SRTM and DTED void (-32768, -32767), ESRI grid (-9999), float32 limits (ESRI binary,
Surfer's 1.70141e38).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats32 = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

SENTINELS = (-32768.0, -32767.0, -9999.0, 32767.0, -99999.0, -2147483648.0)
BEYOND = 1e38
"""No height is as large: +-3.4e38 and 1.7e38 mean "no data", declared or not."""
_GAP = 0.25
"""How far outside the range of the others a sentinel lies, as a share of that range."""


def find_voids(values: Floats32, nodata: float | None, notes: list[str]) -> Mask | None:
    """Mask of the posts without data, or None where all have data.

    Parameters
    ----------
    values : ndarray of float32, (rows, cols)
        Stored numbers, before scale and offset.
    nodata : float or None
        The declared number.
    notes : list of str
        What was decided is added.
    """
    voids: Mask | None = None
    low, high = float(values.min()), float(values.max())  # NaN spreads, so four comparisons clear most files
    if not (low > -BEYOND and high < BEYOND):
        with np.errstate(invalid="ignore"):
            voids = ~(np.abs(values) < BEYOND)
        notes.append(f"{_count(voids)} hold no number (NaN, infinite or beyond 1e38): holes.")
        low, high = _range(values, ~voids)
    if nodata is not None and low <= np.float32(nodata) <= high:
        declared = values == np.float32(nodata)
        if declared.any():
            notes.append(f"{_count(declared)} hold {nodata:g}, which the file declares as no data: holes.")
            voids = declared if voids is None else voids | declared
            low, high = _range(values, ~voids)
    if low in SENTINELS or high in SENTINELS:
        suspects = [np.float32(number) for number in SENTINELS if low <= number <= high]
        others = np.isin(values, suspects, invert=True)
        if voids is not None:
            others &= ~voids
        floor, ceiling = _range(values, others)
        for number in suspects:
            if max(floor - number, number - ceiling) <= max(_GAP * (ceiling - floor), 1.0):
                continue
            suspect = values == number
            if suspect.any():
                notes.append(f"{_count(suspect)} hold {number:g}, far outside all other heights: undeclared holes.")
                voids = suspect if voids is None else voids | suspect
    return voids


def _range(values: Floats32, data: Mask) -> tuple[float, float]:
    """Lowest and highest post with data; (inf, -inf) where there is none."""
    low = np.min(values, where=data, initial=np.float32(np.inf))
    return float(low), float(np.max(values, where=data, initial=np.float32(-np.inf)))


def _count(mask: Mask) -> str:
    count = int(mask.sum())
    return f"{count} post{'s' if count > 1 else ''} ({100 * count / mask.size:.3g} %)"
