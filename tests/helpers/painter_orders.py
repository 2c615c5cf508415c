"""What the tests of the painter share: eyes, levels, triangles of index buffers, and a judge of their order."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from terrain.algorithms import painter

coordinates = st.one_of(
    st.floats(-40, 80),
    st.integers(-3, 36).map(float),
    st.integers(-6, 72).map(lambda i: i / 2),
    st.floats(-1e12, 1e12),
    st.floats(allow_nan=False, allow_infinity=False),
)


def violations(triangles: np.ndarray, col: float, row: float) -> int:
    """Shared edges whose nearer triangle, seen from (col, row), does not come later; in exact arithmetic.

    ``triangles`` (n, 3, 2) are integer posts (row, col) in drawing order; those without area are no triangles.
    """
    triangles = triangles[doubled_area(triangles) != 0]
    start, end, third = (np.roll(triangles, -i, axis=1).reshape(-1, 2) for i in (0, 1, 2))
    owner = np.repeat(np.arange(len(triangles)), 3)
    # The line through an edge: a col + b row = k, direction-free.
    a, b = end[:, 0] - start[:, 0], start[:, 1] - end[:, 1]
    divisor = np.gcd(a, b) * np.where((a > 0) | ((a == 0) & (b > 0)), 1, -1)
    a, b = a // divisor, b // divisor
    k = a * start[:, 1] + b * start[:, 0]
    side = np.sign(a * third[:, 1] + b * third[:, 0] - k)
    low, high = np.minimum(code(start), code(end)), np.maximum(code(start), code(end))
    by_edge = np.lexsort((owner, high, low))
    first, second = by_edge[:-1], by_edge[1:]
    is_shared = (low[first] == low[second]) & (high[first] == high[second])
    first, second = first[is_shared], second[is_shared]  # the triangle of `first` is drawn earlier
    assert (side[first] == -side[second]).all(), "two triangles overlap"
    eye_side = np.zeros(len(first), np.int64)
    for line in {(int(x), int(y)) for x, y in zip(a[first], b[first], strict=True)}:
        value = line[0] * Fraction(col) + line[1] * Fraction(row)
        low_k, high_k = (int(np.clip(v, -(2**60), 2**60)) for v in (math.ceil(value) - 1, math.floor(value) + 1))
        is_line = (a[first] == line[0]) & (b[first] == line[1])
        eye_side += is_line * ((k[first] <= low_k).astype(int) - (k[first] >= high_k))
    return int((side[first] * eye_side > 0).sum())


def code(posts: np.ndarray) -> np.ndarray:
    return posts[:, 0] * 100_000 + posts[:, 1]


def doubled_area(triangles: np.ndarray) -> np.ndarray:
    """Twice the area in plan, positive where counter-clockwise seen from above (rows run south)."""
    p, q = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]


def triangles_of_strips(indices: np.ndarray, posts: int) -> np.ndarray:
    """What OpenGL makes of an index buffer of strips, degenerate triangles left out."""
    indices = indices.astype(np.int64)
    is_restart = indices == painter.RESTART
    start = np.maximum.accumulate(np.where(np.roll(is_restart, 1), np.arange(len(indices)), 0))
    k = np.arange(len(indices) - 2)
    is_whole = ~(is_restart[k] | is_restart[k + 1] | is_restart[k + 2])
    k = k[is_whole]
    is_odd = ((k - start[k]) % 2 == 1)[:, None]
    corners = np.where(is_odd, indices[np.stack([k + 1, k, k + 2], 1)], indices[np.stack([k, k + 1, k + 2], 1)])
    triangles = np.stack(np.divmod(corners, posts), -1)
    return triangles[doubled_area(triangles) != 0]


def eyes_over(cells: int, count: int, seed: int) -> list[tuple[float, float]]:
    """Feet inside, on posts, on edges, on diagonals, next to all of these, around the grid and far away."""
    random = np.random.default_rng(seed)
    eyes: list[tuple[float, float]] = []
    while len(eyes) < count:
        u, v = random.uniform(-0.6 * cells - 1, 1.6 * cells + 1, 2)
        i, j = (float(x) for x in random.integers(-2, cells + 3, 2))
        tiny = float(random.choice([0.0, 1e-300, 1e-17, 1e-9])) * random.choice([-1, 1])
        eyes += [(u, v), (i, j), (i, v), (u, j), (i + 0.5, j + 0.5), (u, i - u), (i + tiny, j), (i, j + tiny)]
        eyes += [(np.nextafter(i + 0.25, 9e9), j - 0.25), (np.nextafter(i + 0.25, -9e9), j - 0.25), (u * 1e7, v * 1e7)]
        eyes += [(u * 1e300, v), (0.5, -1e12), (i + 0.5, j + tiny)]
    return eyes[:count]


def levels_over(shape: tuple[int, int], seed: int, highest: int = 2) -> np.ndarray:
    """Levels that differ by at most one between neighbours, with every kind of corner."""
    random = np.random.default_rng(seed)
    levels = random.integers(0, highest + 1, shape)
    for _ in range(highest):
        padded = np.pad(levels, 1, mode="edge")
        low = np.minimum.reduce([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
        levels = np.minimum(levels, low + 1)
    return levels
