"""Which boxes rise above the horizon made by nearer ones: one table of azimuth bins by bands of distance.

**Source**: in the spirit of Downs, Moeller and Sequin, *Occlusion horizons for driving through urban scenery*
(I3D 2001), on the pyramid's bounds.

**Deviations**: no sweep from front to back. Every box raises the bins it fills, in the band of distance in which it
ends, to the tangent of the elevation below which everything farther is certainly hidden; the running maximum over the
bands is the horizon at every distance, and a box is tested against that of the band before the one in which it begins.
Azimuths are counted by a monotone function of the angle that needs no trigonometry, from -2 to 2 around the eye.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

AZIMUTH_BINS = 1024
BAND_BITS = 2  # a distance's band is its exponent and so many bits of its mantissa: bands of ratio 5/4 to 8/7
# Everything is computed in float32, and what rounding may do is given to the boxes: shares of a tangent, of a distance,
# and of a bin.
TANGENT_SLACK, DISTANCE_SLACK, BIN_SLACK = np.float32(4e-6), np.float32(1e-6), np.float32(1e-3)

Grid = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

_LEAST_M = np.float32(1e-6)  # instead of no distance at all
_WIDTH = AZIMUTH_BINS + 1  # the last bin holds the azimuth straight behind


def rises_above_horizon(x: Grid, z: Grid, bottom: Grid, top: Grid, forward: npt.NDArray[np.float64]) -> Bools:
    """Which boxes are not certainly hidden behind others.

    Parameters
    ----------
    x, z : ndarray of float32, (2, n)
        West and east, north and south edges of the boxes from the eye [m]; the boxes do not overlap.
    bottom : ndarray of float32, (n,)
        Height that all ground in a box reaches, from the eye [m]; minus infinity if it has holes: behind a hole nothing
        is hidden for certain, for a ray may go below the ground through it.
    top : ndarray of float32, (n,)
        Highest point of the boxes from the eye [m].
    forward : ndarray, (3,)
        The sight line: azimuths are counted from it, so that no box in front is cut by the seam behind the viewer.
    """
    gap_x, gap_z = np.maximum(np.maximum(x[0], -x[1]), 0), np.maximum(np.maximum(z[0], -z[1]), 0)
    near = np.sqrt(gap_x * gap_x + gap_z * gap_z)
    around = near <= 0  # the eye is above this box: it is seen all round
    near = np.maximum(near, _LEAST_M)
    far = np.sqrt(np.square(np.maximum(-x[0], x[1])) + np.square(np.maximum(-z[0], z[1])))

    first, last = _azimuths(x, z, forward)
    seam = around | (last - first > AZIMUTH_BINS / 2)  # no box spans more than half the horizon, but those behind
    # Bands counted from the first in which a box ends; what ends in the last, or begins in the first, changes nothing.
    near_band, far_band = _bands(near * (1 - DISTANCE_SLACK)), _bands(far)
    lowest_band = int(far_band.min())
    near_band -= lowest_band
    far_band -= lowest_band
    count = int(near_band.max())
    visible = np.ones(len(near), np.bool_)
    if count <= 0:
        return visible

    horizon = np.full((count, _WIDTH), -np.inf, np.float32)
    begin = np.ceil(first + BIN_SLACK).astype(np.int64)  # bins covered in part are not filled
    size = (last - BIN_SLACK).astype(np.int64) - begin
    fills = np.flatnonzero((size > 0) & (far_band < count) & ~seam)
    low, size = bottom[fills], size[fills]
    reached = low / np.where(low > 0, far[fills], near[fills])
    reached -= TANGENT_SLACK * np.abs(reached)
    index, _ = _spans(far_band[fills] * _WIDTH + begin[fills], size)
    np.maximum.at(horizon.ravel(), index, np.repeat(reached, size))
    begin, end = (np.maximum(first - BIN_SLACK, 0)).astype(np.int64), (last + BIN_SLACK).astype(np.int64)
    holes = np.flatnonzero((bottom == -np.inf) & (near_band < count))
    if len(holes):
        horizon[_opened(np.maximum(near_band, 0)[holes], begin[holes], end[holes], seam[holes], count)] = -np.inf
    for nearer, band in pairwise(horizon):
        np.maximum(nearer, band, out=band)

    tested = np.flatnonzero((near_band > 0) & ~seam)
    highest = top / np.where(top > 0, near, far)
    # Most boxes that are seen rise above the horizon in their middle: only the others are tested in all bins.
    row = (near_band - 1) * _WIDTH
    in_middle = horizon.ravel()[row[tested] + (begin[tested] + end[tested]) // 2]
    tested = tested[highest[tested] < in_middle]
    if len(tested):
        index, start = _spans(row[tested] + begin[tested], (end - begin)[tested] + 1)
        visible[tested] = highest[tested] >= np.minimum.reduceat(horizon.ravel()[index], start)
    return visible


def _azimuths(x: Grid, z: Grid, forward: npt.NDArray[np.float64]) -> tuple[Grid, Grid]:
    """Least and greatest azimuth of the corners of boxes, in bins: 0 and AZIMUTH_BINS straight behind."""
    level = float(np.hypot(forward[0], forward[2]))
    ahead = forward[[0, 2]] / level if level > 1e-9 else np.array([0.0, -1.0])
    ahead_x, ahead_z = ahead.astype(np.float32)
    along = ((ahead_x * x)[:, None] + (ahead_z * z)[None, :]).reshape(4, -1)
    across = ((-ahead_z * x)[:, None] + (ahead_x * z)[None, :]).reshape(4, -1)
    turn = np.abs(along)
    turn += np.abs(across)
    np.maximum(turn, _LEAST_M, out=turn)
    np.divide(across, turn, out=turn)
    behind = np.copysign(np.float32(2), across)
    behind -= turn
    np.copyto(turn, behind, where=along < 0)
    scale = np.float32(AZIMUTH_BINS / 4)
    return (turn.min(axis=0) + 2) * scale, (turn.max(axis=0) + 2) * scale


def _bands(distance_m: Grid) -> Ints:
    """Number of the band of each distance, by the bits of the float: it grows with the distance."""
    return (distance_m.view(np.int32) >> (23 - BAND_BITS)).astype(np.int64)


def _spans(first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """All integers of the ranges [first, first + count) one behind the other, and where each range starts."""
    start = np.cumsum(count) - count
    spans = np.repeat(first - start, count)
    spans += np.arange(len(spans))
    return spans, start


def _opened(band: Ints, first: Ints, last: Ints, seam: Bools, bands: int) -> Bools:
    """The bins (bands, bins) in or behind a hole, from the band in which it begins."""
    opened = np.zeros((bands, _WIDTH), np.bool_)
    opened[band[seam]] = True  # below or behind the eye: all round it
    first, count = band * _WIDTH + first, last - first + 1
    opened.ravel()[_spans(first[~seam], count[~seam])[0]] = True
    return np.logical_or.accumulate(opened, axis=0)
