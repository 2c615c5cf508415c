"""Rivers on a grid: who flows where, how much water passes, and the landscape that is in balance with it.

**Source** Stream-power landscapes: Braun and Willett, *A very efficient O(n), implicit and parallel method to solve the
stream power equation* (Geomorphology 180, 2013). Water leaves a basin over its lowest pass, found by a minimum spanning
tree of basins: Cordonnier, Bovy and Braun, *A versatile, linear complexity algorithm for flow routing in topographies
with depressions* (Earth Surface Dynamics 7, 2019).

**Deviations** Nothing walks the river tree post by post: sums up and down the tree use pointer doubling
(``receiver[receiver]``), ``log2`` of the longest river in array operations. Posts may be shifted at random inside their
cells, which hides the eight directions of a grid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from terrain.synthetic.noise import Grid

Receivers = npt.NDArray[np.int64]
"""For each post of a flattened grid the post its water flows to; itself where it flows nowhere."""

NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class ShiftedGrid:
    """A square grid whose posts lie at random places within their cells.

    Parameters
    ----------
    size : int
        Posts along each side.
    spacing_m : float
    key : tuple of int
        Seeds the shifts.
    reach : float
        Largest shift along each axis, in cells.
    """

    def __init__(self, size: int, spacing_m: float, key: tuple[int, ...], reach: float = 0.42) -> None:
        self.shift_z, self.shift_x = (
            np.random.default_rng(key).uniform(-reach, reach, (2, size, size)).astype(np.float32)
        )
        z, x = np.pad(self.shift_z, 1), np.pad(self.shift_x, 1)
        self.per_m = np.empty((8, size, size), np.float32)
        for k, (dr, dc) in enumerate(NEIGHBOURS):
            there = (slice(1 + dr, 1 + dr + size), slice(1 + dc, 1 + dc + size))
            self.per_m[k] = 1.0 / (spacing_m * np.hypot(dr + z[there] - self.shift_z, dc + x[there] - self.shift_x))

    def unshifted(self, heights: Grid) -> Grid:
        """Heights at the regular posts, from those at the shifted ones: one step along the gradient."""
        slope_z, slope_x = np.gradient(heights)
        return (heights - slope_x * self.shift_x - slope_z * self.shift_z).astype(np.float32)


def steepest_receivers(heights: Grid, per_m: npt.ArrayLike) -> tuple[Receivers, Grid]:
    """The neighbour down the steepest slope, and that slope.

    Parameters
    ----------
    heights : ndarray of float32, (rows, cols)
    per_m : array_like, (8,) or (8, rows, cols)
        One over the distance [m] to each of the eight neighbours, in the order of rows.

    Returns
    -------
    receivers : ndarray of int64, (rows * cols,)
        Pits receive themselves.
    slope : ndarray of float32, (rows * cols,)
        Metres per metre, 0 at pits.
    """
    rows, cols = heights.shape
    padded = np.pad(heights, 1, constant_values=np.inf)
    steepest = np.zeros(heights.shape, np.float32)
    towards = np.full(heights.shape, 8, np.uint8)
    for k, ((dr, dc), scale) in enumerate(zip(NEIGHBOURS, np.asarray(per_m, np.float32), strict=True)):
        slope = heights - padded[1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]
        slope *= scale
        steeper = slope > steepest
        np.copyto(steepest, slope, where=steeper)
        np.copyto(towards, np.uint8(k), where=steeper)
    steps = np.array([dr * cols + dc for dr, dc in NEIGHBOURS] + [0])
    receivers = steps[towards.ravel()]
    receivers += np.arange(heights.size)
    return receivers, steepest.ravel()


def drain_pits(heights: Grid, receivers: Receivers, outlets: npt.NDArray[np.bool_]) -> None:
    """Let every pit flow over the lowest pass out of its basin, in place.

    Outlets receive themselves afterwards and are the only ends of the river tree. There must be one at least.
    """
    ends, flat = outlets.ravel(), heights.ravel()
    receivers[ends] = np.flatnonzero(ends)
    is_root = receivers == np.arange(flat.size)
    pits = np.flatnonzero(is_root & ~ends)
    if not pits.size:
        return
    basin_of_root = np.zeros(flat.size, np.int64)  # basin 0: whatever drains to an outlet
    basin_of_root[pits] = 1 + np.arange(pits.size)
    basin = basin_of_root[_roots(receivers)]
    here, there = _across_basins(basin.reshape(heights.shape))
    low, high = np.minimum(basin[here], basin[there]), np.maximum(basin[here], basin[there])
    pair, pass_height = low * (pits.size + 1) + high, np.maximum(flat[here], flat[there])
    order = np.lexsort((pass_height, pair))
    order = order[np.r_[True, np.diff(pair[order]) > 0]]  # the lowest pass of each pair of basins
    here, there, pair, pass_height = here[order], there[order], pair[order], pass_height[order]
    rank = np.empty(order.size)  # ranks, because a spanning tree takes a weight of 0 for no edge
    rank[np.argsort(pass_height, kind="stable")] = 1 + np.arange(order.size)
    shape = (pits.size + 1, pits.size + 1)
    tree = csgraph.minimum_spanning_tree(sparse.csr_matrix((rank, (low[order], high[order])), shape))
    found, parent = csgraph.breadth_first_order(tree, 0, directed=False)
    child = found[1:].astype(np.int64)
    parent_of = parent[child].astype(np.int64)
    edge = np.searchsorted(pair, np.minimum(child, parent_of) * (pits.size + 1) + np.maximum(child, parent_of))
    receivers[pits[child - 1]] = np.where(basin[here[edge]] == parent_of, here[edge], there[edge])


def upstream_sum(
    receivers: Receivers, weights: npt.NDArray[np.floating], doublings: int = 64
) -> npt.NDArray[np.float64]:
    """Sum of the weights of every post and all that flows through it, at most ``2^doublings - 1`` posts upstream."""
    n = receivers.size
    jump = np.append(np.where(receivers == np.arange(n), n, receivers), n)  # post n swallows what leaves
    total = np.append(weights, 0.0).astype(np.float64)
    for _ in range(doublings):
        arriving = np.bincount(jump, total, n + 1)
        arriving[n] = 0.0
        total += arriving
        jump = jump[jump]
        if (jump == n).all():
            break
    return total[:n]


def downstream_sum(receivers: Receivers, rises: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Sum of the rises along each post's way to its outlet: a height, where they are slope times length."""
    total = np.where(receivers == np.arange(receivers.size), 0.0, rises)
    jump = receivers
    while True:
        total = total + total[jump]
        following = jump[jump]
        if np.array_equal(following, jump):
            return total
        jump = following


def _roots(receivers: Receivers) -> Receivers:
    """The end of each post's way."""
    while True:
        following = receivers[receivers]
        if np.array_equal(following, receivers):
            return receivers
        receivers = following


def _across_basins(basin: Receivers) -> tuple[Receivers, Receivers]:
    """Posts ``(here, there)`` of all neighbours in different basins."""
    index = np.arange(basin.size).reshape(basin.shape)
    every, lower, upper = slice(None), slice(None, -1), slice(1, None)
    here, there = [], []
    for a, b in (
        ((every, lower), (every, upper)),
        ((lower, every), (upper, every)),
        ((lower, lower), (upper, upper)),
        ((lower, upper), (upper, lower)),
    ):
        differs = basin[a] != basin[b]
        here.append(index[a][differs])
        there.append(index[b][differs])
    return np.concatenate(here), np.concatenate(there)
