"""The frame limiter: at most so many pictures per second, at an even pace."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pacer:
    """Waits before a frame until it is due.

    Parameters
    ----------
    clock, sleep : callable
        Seconds now, and waiting for seconds; tests bring their own.
    """

    def __init__(
        self, clock: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._due_s = clock()

    def wait(self, limit_fps: int) -> None:
        """Wait for the next frame; not at all where the limit is 0 or the last frame took too long.

        Frames are due at even intervals: one that comes a little late does not delay those after it.
        """
        now_s = self._clock()
        if limit_fps <= 0:
            self._due_s = now_s
            return
        interval_s = 1.0 / limit_fps
        if self._due_s > now_s:
            self._sleep(self._due_s - now_s)
            now_s = self._clock()
        self._due_s = max(self._due_s + interval_s, now_s)
