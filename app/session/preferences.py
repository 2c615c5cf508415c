"""What the program remembers of a person between runs: theme, scale, frame limit, recent files, open windows.

One JSON file in the platform's folder for configuration. Every change is written at once, under a temporary name that
is then renamed; a file that cannot be understood is kept aside under another name and the defaults hold.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import uuid
from dataclasses import Field, asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from platformdirs import user_config_path

from terrain.flight import numbered_path
from terrain.settings import setting

FORMAT = "reliefscope-preferences"
RECENT_FILES = 10
FILE_NAME, LAYOUT_NAME = "preferences.json", "layout.ini"


@dataclass(frozen=True)
class Preferences:
    """What a person chose. The fields made of `setting` are widgets of the preferences window."""

    theme: str = setting("dark", "Theme", "Colours of the windows: dark or light.", choices=("dark", "light"))
    ui_scale: float = setting(
        1.0, "Scale", "Size of text and widgets, on top of what the screen asks for.", unit="x", range=(0.75, 2.5),
        rebuild=True,
    )  # fmt: skip
    frame_limit_fps: int = setting(
        60, "Frame limit", "Pictures per second at most, which saves energy; 0 sets no limit.", unit="fps",
        range=(0, 240),
    )  # fmt: skip
    vsync: bool = setting(True, "Vertical sync", "Wait for the screen before each picture, so that none is torn.")
    shows_scale_bar: bool = setting(True, "Scale and north", "A scale bar and a north arrow over the picture.")
    shows_legend: bool = setting(True, "Legend", "What the colours of the picture mean, over the picture.")
    recent_files: tuple[str, ...] = field(default=())
    open_windows: dict[str, bool] = field(default_factory=dict)


class PreferenceFile:
    """The preferences of one person and the file that keeps them.

    Parameters
    ----------
    folder : Path or None
        Where the file lies; None keeps nothing.

    Attributes
    ----------
    current : Preferences
    problem : str
        One line where the file could not be understood or written; empty otherwise.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder, self.problem = folder, ""
        self.current = self._read()

    def change(self, **changes: Any) -> None:
        """Set some fields and write the file, in which another window's changes to other fields are kept."""
        changes = {name: value for name, value in changes.items() if value != getattr(self.current, name)}
        if not changes:
            return
        self.current = replace(self.current, **changes)
        if self.folder is not None:
            self._write(replace(self._read(), **changes))

    def remember_file(self, path: str | os.PathLike[str]) -> None:
        """Put a terrain first among the recent files."""
        name = os.path.abspath(path)
        others = [other for other in self.current.recent_files if other != name]
        self.change(recent_files=(name, *others)[:RECENT_FILES])

    def read_layout(self) -> str:
        """The layout of the windows as `write_layout` was given it; empty where there is none, or it was damaged."""
        if self.folder is None:
            return ""
        try:
            head, _, text = (self.folder / LAYOUT_NAME).read_text(encoding="utf-8").partition("\n")
        except (OSError, ValueError):
            return ""
        return text if head == _seal(text) else ""

    def write_layout(self, text: str) -> None:
        """Keep the layout of the windows."""
        if self.folder is not None:
            self._replace(LAYOUT_NAME, f"{_seal(text)}\n{text}")

    def _read(self) -> Preferences:
        """What the file says; of a field that holds no such value, the default."""
        if self.folder is None:
            return Preferences()
        path = self.folder / FILE_NAME
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(record, dict) or record.get("format") != FORMAT:
                raise ValueError("no preferences")
        except FileNotFoundError:
            return Preferences()
        except OSError as error:
            self.problem = f"{path} cannot be read: {error.strerror or error}. The defaults hold."
            return Preferences()
        except (ValueError, RecursionError):
            self._set_aside(path)
            return Preferences()
        found: dict[str, Any] = {
            f.name: record[f.name] for f in fields(Preferences) if _is_value(f, record.get(f.name))
        }
        if "recent_files" in found:
            found["recent_files"] = tuple(found["recent_files"])
        return Preferences(**found)

    def _set_aside(self, path: Path) -> None:
        """Keep a damaged file under another name."""
        aside = numbered_path(path.with_name("preferences-damaged.json"))
        try:
            path.rename(aside)
        except OSError:
            aside = path
        self.problem = f"The preferences could not be understood and are now the defaults; the old ones are {aside}."

    def _write(self, preferences: Preferences) -> None:
        record = {"format": FORMAT, **asdict(preferences)}
        self._replace(FILE_NAME, json.dumps(record, indent=2, ensure_ascii=False) + "\n")

    def _replace(self, name: str, text: str) -> None:
        """Write a file under a temporary name and rename it: it is there whole, or as it was."""
        assert self.folder is not None
        path = self.folder / name
        temporary = path.with_name(f".{name}.{uuid.uuid4().hex}.part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(path)
        except OSError as error:
            self.problem = f"{path} cannot be written: {error.strerror or error}. Choices hold until the window closes."
            with contextlib.suppress(OSError):
                temporary.unlink()


def config_folder() -> Path:
    """The folder of the preferences: the platform's, or ``$RELIEFSCOPE_CONFIG`` where that is set."""
    chosen = os.environ.get("RELIEFSCOPE_CONFIG")
    return Path(chosen) if chosen else user_config_path("reliefscope", appauthor=False)


def _seal(text: str) -> str:
    """The first line of the layout file: tells a whole file from one that was cut off or touched by chance."""
    return f"; Reliefscope's windows, {hashlib.sha256(text.encode()).hexdigest()}"


def _is_value(field: Field[Any], value: Any) -> bool:
    """Whether a field takes a value found in the file."""
    if field.name == "recent_files":
        return isinstance(value, list) and all(isinstance(name, str) for name in value)
    if field.name == "open_windows":
        return isinstance(value, dict) and all(isinstance(is_open, bool) for is_open in value.values())
    choices, limits = field.metadata["choices"], field.metadata["range"]
    if choices is not None:
        return value in choices
    if isinstance(field.default, bool):
        return isinstance(value, bool)
    number = (int,) if isinstance(field.default, int) else (int, float)
    return isinstance(value, number) and not isinstance(value, bool) and limits[0] <= value <= limits[1]
