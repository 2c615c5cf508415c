"""A disk cache of numpy arrays by content hash, in the platform's cache folder.

Safe with several processes at once: entries are written under a temporary name and renamed, a damaged or vanished entry
counts as absent, and nothing that goes wrong here ever stops the program: the arrays are simply made again.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from platformdirs import user_cache_path

CACHE_LIMIT_BYTES = 1 << 30


def cache_folder() -> Path:
    """The folder of all caches: the platform's, or ``$RELIEFSCOPE_CACHE`` where that is set."""
    chosen = os.environ.get("RELIEFSCOPE_CACHE")
    return Path(chosen) if chosen else user_cache_path("reliefscope", appauthor=False)


def store_arrays(kind: str, key: str, arrays: Mapping[str, npt.NDArray[Any]]) -> bool:
    """Keep ``arrays`` under ``kind`` and ``key``; False where the folder cannot be written."""
    folder = cache_folder() / kind
    temporary = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".part", delete=False) as file:
            temporary = Path(file.name)
            np.savez(file, **arrays)  # type: ignore[arg-type]
        temporary.replace(folder / f"{key}.npz")
        _drop_oldest(cache_folder())
        return True
    except OSError:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        return False


def load_arrays(kind: str, key: str) -> dict[str, npt.NDArray[Any]] | None:
    """What `store_arrays` kept, or None where it is absent or damaged."""
    path = cache_folder() / kind / f"{key}.npz"
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        os.utime(path)  # used just now: the oldest entries are dropped first
        return arrays
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None


def _drop_oldest(folder: Path, limit_bytes: int = CACHE_LIMIT_BYTES) -> None:
    """Delete the least recently used entries until the cache is within its limit."""
    entries = []
    for path in [*folder.glob("*/*.npz"), *folder.glob("*/*.part")]:
        try:
            status = path.stat()
        except OSError:
            continue  # another process deleted it
        entries.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries)[:-1]:  # the newest entry stays, however large
        if total <= limit_bytes:
            break
        path.unlink(missing_ok=True)
        total -= size
