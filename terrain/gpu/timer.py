"""How long the GPU worked on a frame, read a few frames later so that nobody waits for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import moderngl

FRAMES_IN_FLIGHT = 4


class GpuTimer:
    """A ring of timer queries. Useless on software GL, where queries measure only the submission."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._queries = [ctx.query(time=True) for _ in range(FRAMES_IN_FLIGHT)]
        self._count = 0

    @contextmanager
    def measure(self) -> Iterator[None]:
        """Time what is submitted inside; must not be nested, nor used inside another time query."""
        with self._queries[self._count % FRAMES_IN_FLIGHT]:
            yield
        self._count += 1

    def oldest_ms(self) -> float | None:
        """Time of the frame measured `FRAMES_IN_FLIGHT` - 1 frames ago; None in the first frames."""
        if self._count < FRAMES_IN_FLIGHT:
            return None
        return float(self._queries[self._count % FRAMES_IN_FLIGHT].elapsed) * 1e-6
