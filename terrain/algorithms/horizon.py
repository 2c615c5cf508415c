"""Which boxes rise above the horizon made by nearer ones: one table of azimuth bins by bands of distance.

**Source**: in the spirit of Downs, Moeller and Sequin, *Occlusion horizons for driving through urban scenery*
(I3D 2001), on the pyramid's bounds.

**Deviations**: no sweep from front to back. Every box raises the bins it fills, in the band of distance in which it
ends, to the tangent of the elevation below which everything farther is certainly hidden; the running maximum over the
bands is the horizon at every distance, and a box is tested against that of the band before the one in which it begins.
Azimuths are counted by a monotone function of the angle that needs no trigonometry, from -2 to 2 around the eye.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

AZIMUTH_BINS = 1024
BAND_BITS = 2  # a distance's band is its exponent and so many bits of its mantissa: bands of ratio 5/4 to 8/7

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

_LEAST_M = 1e-9  # instead of no distance at all
_WIDTH = AZIMUTH_BINS + 1  # the last bin holds the azimuth straight behind


def rises_above_horizon(x: Floats, z: Floats, bottom: Floats, top: Floats, forward: Floats) -> Bools:
    """Which boxes are not certainly hidden behind others.

    Parameters
    ----------
    x, z : ndarray, (2, n)
        West and east, north and south edges of the boxes from the eye [m]; the boxes do not overlap.
    bottom : ndarray, (n,)
        Height that all ground in a box reaches, from the eye [m]; minus infinity if it has holes: behind a hole nothing
        is hidden for certain, for a ray may go below the ground through it.
    top : ndarray, (n,)
        Highest point of the boxes from the eye [m].
    forward : ndarray, (3,)
        The sight line: azimuths are counted from it, so that no box in front is cut by the seam behind the viewer.
    """
    gap_x, gap_z = np.maximum(np.maximum(x[0], -x[1]), 0.0), np.maximum(np.maximum(z[0], -z[1]), 0.0)
    near = np.sqrt(gap_x * gap_x + gap_z * gap_z)
    around = near <= 0.0  # the eye is above this box: it is seen all round
    near = np.maximum(near, _LEAST_M)
    far = np.sqrt(np.square(np.maximum(-x[0], x[1])) + np.square(np.maximum(-z[0], z[1])))

    first, last = _azimuths(x, z, forward)
    seam = around | (last - first > AZIMUTH_BINS / 2)  # no box spans more than half the horizon, but those behind
    first_bin, last_bin = first.astype(np.int64), last.astype(np.int64)
    # Bands counted from the first in which a box ends; what ends in the last, or begins in the first, changes nothing.
    near_band, far_band = _bands(near), _bands(far)
    count = int(near_band.max() - far_band.min())
    if count <= 0:
        return np.ones(len(near), np.bool_)
    near_band, far_band = near_band - far_band.min(), far_band - far_band.min()

    horizon = np.full((count, _WIDTH), -np.inf)
    fill_first = np.ceil(first).astype(np.int64)  # bins covered in part are not filled
    fills = np.flatnonzero((fill_first < last_bin) & (far_band < count) & ~seam)
    size = (last_bin - fill_first)[fills]
    index, _ = _spans(far_band[fills] * _WIDTH + fill_first[fills], size)
    low = bottom[fills]
    np.maximum.at(horizon.ravel(), index, np.repeat(low / np.where(low > 0.0, far[fills], near[fills]), size))
    holes = np.flatnonzero((bottom == -np.inf) & (near_band < count))
    if len(holes):
        opened = _opened(np.maximum(near_band, 0)[holes], first_bin[holes], last_bin[holes], seam[holes], count)
        horizon[opened] = -np.inf
    np.maximum.accumulate(horizon, axis=0, out=horizon)

    tested = np.flatnonzero((near_band > 0) & ~seam)
    visible = np.ones(len(near), np.bool_)
    if len(tested):
        begin = (near_band[tested] - 1) * _WIDTH + first_bin[tested]
        index, start = _spans(begin, (last_bin - first_bin)[tested] + 1)
        high = top[tested]
        highest = high / np.where(high > 0.0, near[tested], far[tested])
        visible[tested] = highest >= np.minimum.reduceat(horizon.ravel()[index], start)
    return visible


def _azimuths(x: Floats, z: Floats, forward: Floats) -> tuple[Floats, Floats]:
    """Least and greatest azimuth of the corners of boxes, in bins: 0 and AZIMUTH_BINS straight behind."""
    level = float(np.hypot(forward[0], forward[2]))
    ahead = (forward[0] / level, forward[2] / level) if level > _LEAST_M else (0.0, -1.0)
    along = ((ahead[0] * x)[:, None] + (ahead[1] * z)[None, :]).reshape(4, -1)
    across = ((-ahead[1] * x)[:, None] + (ahead[0] * z)[None, :]).reshape(4, -1)
    turn = across / np.maximum(np.abs(along) + np.abs(across), _LEAST_M)
    behind = np.copysign(2.0, across) - turn
    turn = np.where(along < 0.0, behind, turn)
    turn += 2.0
    turn *= AZIMUTH_BINS / 4
    return turn.min(axis=0), turn.max(axis=0)


def _bands(distance_m: Floats) -> Ints:
    """Number of the band of each distance, by the bits of the float: exact at the borders, and growing with it."""
    return distance_m.view(np.int64) >> (52 - BAND_BITS)


def _spans(first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """All integers of the ranges [first, first + count) one behind the other, and where each range starts."""
    stop = np.cumsum(count)
    start = stop - count
    total = int(stop[-1]) if len(stop) else 0
    return np.arange(total) + np.repeat(first - start, count), start


def _opened(band: Ints, first: Ints, last: Ints, seam: Bools, bands: int) -> Bools:
    """The bins (bands, bins) in or behind a hole, from the band in which it begins."""
    opened = np.zeros((bands, _WIDTH), np.bool_)
    opened[band[seam]] = True  # below or behind the eye: all round it
    first, count = band * _WIDTH + first, last - first + 1
    opened.ravel()[_spans(first[~seam], count[~seam])[0]] = True
    return np.logical_or.accumulate(opened, axis=0)
