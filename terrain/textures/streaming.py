"""Worker threads that read tiles while the picture goes on.

The main thread says in every frame what it wants, most urgent first; that replaces what was wanted before. Workers read
the first wanted tile that nobody reads yet, and stop when as many results are waiting as the main thread takes in a few
frames. A tile that cannot be read is reported as such, once; the source's first failure gives a message of one line.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections import deque
from typing import NamedTuple

from terrain.textures.tree import Pixels, TileNotReady, TileSource

MOST_RESULTS = 32  # tiles read and not yet taken: 8 MiB
RETRY_S = 0.2  # after a tile was not ready
POLITENESS = 5  # added to the threads' nice value where that can be done: the picture goes first


def give_way() -> None:
    """Let the calling thread work only where the picture leaves time for it, on systems that can."""
    if sys.platform == "linux":  # where threads have nice values of their own
        with contextlib.suppress(OSError):  # some sandboxes forbid it
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), POLITENESS)


class Request(NamedTuple):
    """A tile to be read, for the tree whose handle is given."""

    handle: int
    number: int
    source: TileSource
    level: int
    row: int
    col: int


class Result(NamedTuple):
    """A tile that was read; no pixels where that failed."""

    handle: int
    number: int
    revision: int
    pixels: Pixels | None


class TileStream:
    """A few threads and a queue.

    Parameters
    ----------
    workers : int or None
        Number of threads; None leaves one processor to the picture.
    """

    def __init__(self, workers: int | None = None) -> None:
        self._workers = workers or max(1, min(4, (os.cpu_count() or 2) - 1))
        self._changed = threading.Condition()
        self._wanted: deque[Request] = deque()
        self._reading: set[tuple[int, int]] = set()
        self._resting: dict[tuple[int, int], float] = {}  # not ready: when to try again
        self._results: deque[Result] = deque()
        self._causes: dict[int, str] = {}  # of the first failure of each tree, by its handle
        self._messages: list[str] = []
        self._threads: list[threading.Thread] = []
        self._closing = False

    def want(self, requests: list[Request]) -> None:
        """Replace what is wanted, most urgent first."""
        if requests and not self._threads:
            self._start()
        with self._changed:
            now_s = time.monotonic()
            self._resting = {key: until_s for key, until_s in self._resting.items() if until_s > now_s}
            waiting = {(result.handle, result.number) for result in self._results}
            skip = self._reading | self._resting.keys() | waiting
            self._wanted = deque(r for r in requests if (r.handle, r.number) not in skip)
            if self._wanted:  # threads that wake up for nothing cost the picture time
                self._changed.notify_all()

    def collect(self, most: int) -> list[Result]:
        """Up to ``most`` results, oldest first."""
        if not self._results:
            return []
        with self._changed:
            found = [self._results.popleft() for _ in range(min(most, len(self._results)))]
            self._changed.notify_all()
        return found

    def wait(self, timeout_s: float) -> None:
        """Sleep until there is a result, or for ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._results), timeout_s)

    @property
    def loading(self) -> int:
        """Tiles wanted, being read, or read and not yet taken."""
        with self._changed:
            return len(self._wanted) + len(self._reading) + len(self._results) + len(self._resting)

    def take_messages(self) -> list[str]:
        """What went wrong since the last call, one line each."""
        with self._changed:
            messages, self._messages = self._messages, []
        return messages

    def cause(self, handle: int) -> str:
        """Why the first tile of a tree that could not be read could not."""
        with self._changed:
            return self._causes.get(handle, "")

    def forget(self, handle: int) -> None:
        """Drop all that concerns a tree, and wait until none of its tiles is being read."""
        with self._changed:
            self._wanted = deque(r for r in self._wanted if r.handle != handle)
            self._changed.wait_for(lambda: not any(reading == handle for reading, _ in self._reading))
            self._results = deque(r for r in self._results if r.handle != handle)
            self._resting = {key: until_s for key, until_s in self._resting.items() if key[0] != handle}
            self._changed.notify_all()

    def release(self) -> None:
        """Stop the threads; a tile being read is read to its end."""
        with self._changed:
            self._closing = True
            self._wanted.clear()
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()
        self._threads.clear()
        self._results.clear()

    def _start(self) -> None:
        for number in range(self._workers):
            thread = threading.Thread(target=self._work, name=f"tiles-{number}", daemon=True)
            self._threads.append(thread)
            thread.start()

    def _work(self) -> None:
        give_way()
        while (request := self._next()) is not None:
            key = (request.handle, request.number)
            result: Result | None = None
            revision = request.source.revision  # before reading: what changes meanwhile is read again
            try:
                pixels = request.source.read_tile(request.level, request.row, request.col)
                result = Result(*key, revision, pixels)
            except TileNotReady:
                pass
            except Exception as error:  # whatever a driver raises for a damaged file
                result = Result(*key, revision, None)
                self._tell(request, error)
            with self._changed:
                self._reading.discard(key)
                if result is None:
                    self._resting[key] = time.monotonic() + RETRY_S
                else:
                    self._results.append(result)
                self._changed.notify_all()

    def _next(self) -> Request | None:
        """The most urgent tile; None when the threads are to end."""
        with self._changed:
            self._changed.wait_for(lambda: self._closing or (self._wanted and len(self._results) < MOST_RESULTS))
            if self._closing:
                return None
            request = self._wanted.popleft()
            self._reading.add((request.handle, request.number))
            return request

    def _tell(self, request: Request, error: Exception) -> None:
        with self._changed:
            if request.handle in self._causes:
                return
            cause = " ".join(str(error.__cause__ or error).split())[:160] or type(error).__name__
            self._causes[request.handle] = cause
            self._messages.append(
                f"{request.source.name}: tile {request.row}, {request.col} of level {request.level} cannot be read "
                f"({cause}); coarser ones are shown in its place, where there are any."
            )
