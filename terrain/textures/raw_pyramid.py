"""Coarser levels of an image as a file of bare numbers, mapped into memory: made once, kept in the cache folder.

Safe with several processes at once: each builds under a name of its own and renames when it has finished; an older file
stays readable to those who have it open. The folder is bounded, the pyramid longest unused is dropped first.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from terrain.cache import cache_folder
from terrain.textures.tree import Pixels, halve

FOLDER_LIMIT_BYTES = 6 << 30
LEFT_FREE_BYTES = 1 << 30  # of the disk
ABANDONED_S = 24 * 3600.0  # after which an unfinished file was left by a process that is no more
STRIP_LEVELS = 8
STRIP_ROWS = 1 << STRIP_LEVELS  # of the first level: levels above are made strip by strip as long as that comes out

Shapes = list[tuple[int, int]]
ReadRows = Callable[[int, int], Pixels]


class RawPyramid:
    """Levels ``first`` to ``first + len(shapes) - 1`` of an image.

    Parameters
    ----------
    key : str
        Names content and layout.
    first : int
        The finest level that is kept.
    shapes : list of (rows, cols)
        Of each level, the finest first.
    channels : int
        3, or 4 where there is transparency.
    """

    def __init__(self, key: str, first: int, shapes: Shapes, channels: int) -> None:
        self.first, self._shapes, self._channels = first, shapes, channels
        self._path = cache_folder() / "textures" / f"{key}.pyramid"
        self._sizes = [rows * cols * channels for rows, cols in shapes]
        self._levels: list[npt.NDArray[np.uint8]] = []
        self._rows_done = [0] * len(shapes)
        self.bytes = sum(self._sizes)
        self.is_complete = self._open()

    def level(self, level: int, rows: slice) -> npt.NDArray[np.uint8] | None:
        """A level (rows, cols, channels), or None while these rows of it are not made yet."""
        index = level - self.first
        if index < 0 or rows.stop > self._rows_done[index]:
            return None
        return self._levels[index]

    def build(self, read_rows: ReadRows, cancelled: threading.Event) -> bool:
        """Make it, the finest level from ``read_rows(first, last)``; whether it was finished.

        What is done of it can be read meanwhile. False where the disk has no room, or when cancelled.
        """
        folder, size = self._path.parent, self.bytes
        temporary: Path | None = None
        try:
            folder.mkdir(parents=True, exist_ok=True)
            drop_oldest(folder, FOLDER_LIMIT_BYTES - size)
            if shutil.disk_usage(folder).free < size + LEFT_FREE_BYTES:
                return False
            with tempfile.NamedTemporaryFile(dir=folder, suffix=".building", delete=False) as file:
                temporary = Path(file.name)
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, size)  # a full disk must be an error now, not a crash later
                file.truncate(size)
            self._map(temporary, "r+")
            self._fill(read_rows, cancelled)
            if cancelled.is_set():
                return False
            for level in self._levels:
                level.flush()  # type: ignore[attr-defined]
            temporary.replace(self._path)
            temporary = None
            self.is_complete = True
        except OSError:
            return False
        finally:
            if temporary is not None:  # what is mapped stays readable where the system allows it
                with contextlib.suppress(OSError):
                    temporary.unlink(missing_ok=True)
        return True

    def _open(self) -> bool:
        """Map the file, if it is there and whole."""
        try:
            if self._path.stat().st_size != self.bytes:
                return False
            self._map(self._path, "r")
            os.utime(self._path)  # used just now: the oldest are dropped first
        except OSError:
            return False
        self._rows_done = [rows for rows, _ in self._shapes]
        return True

    def _map(self, path: Path, mode: str) -> None:
        begin = np.cumsum([0, *self._sizes[:-1]])
        self._levels = [
            np.memmap(path, np.uint8, mode, int(offset), (*shape, self._channels))  # type: ignore[call-overload]
            for offset, shape in zip(begin, self._shapes, strict=True)
        ]

    def _fill(self, read_rows: ReadRows, cancelled: threading.Event) -> None:
        rows = self._shapes[0][0]
        for begin in range(0, rows, STRIP_ROWS):
            if cancelled.is_set():
                return
            strip = read_rows(begin, min(begin + STRIP_ROWS, rows))[..., : self._channels]
            for index in range(min(STRIP_LEVELS + 1, len(self._levels))):
                if index:
                    strip = halve(strip)
                at = begin >> index
                self._levels[index][at : at + len(strip)] = strip
                self._rows_done[index] = at + len(strip)
        for index in range(STRIP_LEVELS + 1, len(self._levels)):
            self._levels[index][:] = halve(np.asarray(self._levels[index - 1]))
            self._rows_done[index] = len(self._levels[index])


def drop_oldest(folder: Path, limit_bytes: int) -> None:
    """Delete pyramids, least recently used first, until the folder is within its limit."""
    entries = []
    for path in [*folder.glob("*.pyramid"), *folder.glob("*.building")]:
        try:
            status = path.stat()
            if path.suffix == ".pyramid":
                entries.append((status.st_mtime, status.st_size, path))
            elif time.time() - status.st_mtime > ABANDONED_S:
                path.unlink()
        except OSError:
            continue  # another process deleted it
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= limit_bytes:
            break
        try:
            path.unlink(missing_ok=True)
        except OSError:
            continue  # open in another process, on a system that minds
        total -= size
