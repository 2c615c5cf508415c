"""The file dialog: folders and the files that can be opened, on any system, without a desktop's own dialog.

Pure: `app.windows.open` draws it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from app.opening.files import PICTURE_SUFFIXES, is_flight

TERRAIN_SUFFIXES = (
    ".tif", ".tiff", ".hgt", ".asc", ".dem", ".dt0", ".dt1", ".dt2", ".bil", ".flt", ".img", ".adf", ".vrt", ".nc",
    ".xyz", ".grd", ".sdat", ".npy", ".npz", ".r16", ".r32", ".zip", ".gz", ".bz2", ".png",
)  # fmt: skip
MOST_ENTRIES = 5000


class Entry(NamedTuple):
    """One line of the list."""

    path: Path
    is_folder: bool
    size_bytes: int

    @property
    def label(self) -> str:
        return f"{self.path.name}/" if self.is_folder else self.path.name


class Browser:
    """Where one looks for a file.

    Attributes
    ----------
    folder : Path
    shows_all : bool
        Also files that do not look like anything that can be opened.
    as_terrain : bool
        Pictures are taken for heights.
    problem : str
        Why the folder cannot be shown; empty where it can.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.problem = folder.absolute(), ""
        self.shows_all = self.as_terrain = False
        self._entries: list[Entry] = []
        self._listed: object = None

    def entries(self) -> list[Entry]:
        """Folders, then files, by name; listed again when the folder changes."""
        try:
            key = self.folder, self.shows_all, self.folder.stat().st_mtime_ns
            if key != self._listed:
                self._entries, self._listed = self._list(), key
                self.problem = ""
        except OSError as error:
            self._entries, self._listed = [], None
            self.problem = f"{self.folder} cannot be shown: {error.strerror or error}."
        return self._entries

    def go(self, text: str) -> Path | None:
        """Enter a folder, or give the file that was typed or clicked; what exists not is told in `problem`."""
        path = Path(os.path.expanduser(text.strip()))
        path = Path(os.path.normpath(self.folder / path))
        if path.is_dir():
            self.folder = path
            return None
        if path.is_file():
            return path
        self.problem = f"There is no file or folder {path}."
        return None

    def up(self) -> None:
        """To the folder around this one."""
        self.folder = self.folder.parent

    def _list(self) -> list[Entry]:
        found = []
        with os.scandir(self.folder) as items:
            for item in items:
                try:
                    is_folder = item.is_dir()
                    if item.name.startswith(".") or not (is_folder or self.shows_all or _is_known(item.name)):
                        continue
                    found.append(Entry(self.folder / item.name, is_folder, 0 if is_folder else item.stat().st_size))
                except OSError:
                    continue  # gone meanwhile, or nobody may look at it
                if len(found) == MOST_ENTRIES:
                    break
        return sorted(found, key=lambda entry: (not entry.is_folder, entry.path.name.lower()))


def _is_known(name: str) -> bool:
    path = Path(name.lower())
    return path.suffix in (*TERRAIN_SUFFIXES, *PICTURE_SUFFIXES) or is_flight(path)
