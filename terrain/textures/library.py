"""What layers can show on one terrain, by name: themes made from it, and image files; each is opened once.

A theme is computed by a thread of its own when its first tile is asked for, so that the picture never waits for it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path

from terrain.errors import InputError
from terrain.heightfield import Heightfield
from terrain.textures.array_source import ArraySource, whole_extent
from terrain.textures.image_source import ImageSource
from terrain.textures.thematic import THEMES, Legend, Theme, make_theme
from terrain.textures.tree import Pixels, TileNotReady, TileSource


class ThemeSource:
    """The tiles of a theme; see `terrain.textures.tree.TileSource`.

    Parameters
    ----------
    name : str
        A key of `THEMES`.
    heightfield : Heightfield
    """

    revision = 0
    is_final = True
    notes: tuple[str, ...] = ()

    def __init__(self, name: str, heightfield: Heightfield) -> None:
        self.name = THEMES[name].title
        self.size_px = THEMES[name].size_px(heightfield)
        self.image_from_post = whole_extent(heightfield)
        self._theme, self._heightfield = name, heightfield
        self._lock = threading.Lock()
        self._maker: threading.Thread | None = None
        self._made: tuple[ArraySource, Legend] | None = None
        self._failure: Exception | None = None

    @property
    def legend(self) -> Legend | None:
        """How to read it; None until it is computed."""
        return None if self._made is None else self._made[1]

    def read_tile(self, level: int, row: int, col: int) -> Pixels:
        with self._lock:
            if self._maker is None:
                self._maker = threading.Thread(target=self._make, name=f"theme-{self._theme}", daemon=True)
                self._maker.start()
        if self._failure is not None:
            raise self._failure
        if self._made is None:
            raise TileNotReady
        return self._made[0].read_tile(level, row, col)

    def close(self) -> None:
        """Wait until it is computed, if that has begun."""
        with self._lock:
            maker = self._maker
        if maker is not None:
            maker.join()

    def _make(self) -> None:
        try:
            theme: Theme = make_theme(self._theme, self._heightfield)
            self._made = ArraySource(theme.name, theme.pixels, self.image_from_post), theme.legend
        except Exception as error:  # a grid too large for the memory, above all
            self._failure = error


class Library:
    """The sources of one terrain's layers.

    Parameters
    ----------
    heightfield : Heightfield
        Its exaggeration does not matter.
    """

    def __init__(self, heightfield: Heightfield) -> None:
        self._heightfield = heightfield
        self._sources: dict[str, TileSource] = {}

    def open(self, name: str) -> TileSource:
        """A theme, or else an image file.

        Raises
        ------
        InputError
            If it is neither, or lies beside the terrain.
        """
        if name not in self._sources:
            if name in THEMES:
                self._sources[name] = ThemeSource(name, self._heightfield)
            elif not Path(name).is_file():
                raise InputError(
                    f"Expected a theme ({', '.join(THEMES)}) or an image file to lay on the terrain, found {name!r}."
                )
            else:
                self._sources[name] = ImageSource(name, self._heightfield)
        return self._sources[name]

    def adopt(self, name: str, source: TileSource) -> None:
        """Take over a source that somebody else has opened for this terrain, under a name."""
        if name in self._sources:
            source.close()
        else:
            self._sources[name] = source

    def open_all(self, names: Iterable[str]) -> dict[str, TileSource]:
        """Several, by name."""
        return {name: self.open(name) for name in names}

    @property
    def names(self) -> tuple[str, ...]:
        """All that can be shown without opening a file: themes, then the images that are open."""
        return (*THEMES, *(name for name in self._sources if name not in THEMES))

    @property
    def notes(self) -> list[str]:
        """What was decided while opening images, one line each."""
        return [f"{source.name}: {note}" for source in self._sources.values() for note in source.notes]

    def legend(self, name: str) -> Legend | None:
        """How to read a theme; None for an image, and while it is computed."""
        source = self._sources.get(name)
        return source.legend if isinstance(source, ThemeSource) else None

    def close(self) -> None:
        """Let go of files and threads, after the stages that show them."""
        for source in self._sources.values():
            source.close()
        self._sources.clear()


def title_of(name: str) -> str:
    """What to call a source: a theme's title, or the file's name."""
    return THEMES[name].title if name in THEMES else Path(name).name
