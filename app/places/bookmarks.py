"""Views kept by name, one JSON file per terrain in the platform's folder for a person's data.

A terrain is known by its content, so that a file may be moved or renamed. Every change reads the file anew, in case
another window has changed it, and is written under a temporary name that is then renamed. A file that cannot be
understood is kept aside under another name.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.places.framing import ground_m
from terrain.camera import Camera
from terrain.flight import numbered_path
from terrain.heightfield import Heightfield

FORMAT = "reliefscope-bookmarks"
LONGEST_NAME = 60


@dataclass(frozen=True)
class Bookmark:
    """A view by name.

    Attributes
    ----------
    name : str
    camera : Camera
        Its height counts from the ground below it, whatever the exaggeration.
    """

    name: str
    camera: Camera

    @classmethod
    def of(cls, name: str, camera: Camera, heightfield: Heightfield) -> Bookmark:
        """A bookmark of a view of the terrain as it is shown."""
        return cls(name, _raised(camera, -ground_m(heightfield, camera.position_m[0], camera.position_m[2])))

    def view(self, heightfield: Heightfield) -> Camera:
        """The view, over the terrain as it is shown."""
        x, _, z = self.camera.position_m
        return _raised(self.camera, ground_m(heightfield, x, z))


class Bookmarks:
    """The bookmarks of one terrain.

    Parameters
    ----------
    heightfield : Heightfield
        With true heights: the key is made from its content.
    folder : Path or None
        Where the files lie; None keeps nothing.

    Attributes
    ----------
    all : tuple of Bookmark
        In the order they were made.
    problem : str
        One line where the file could not be understood or written; empty otherwise.
    """

    def __init__(self, heightfield: Heightfield, folder: Path | None) -> None:
        name = re.sub(r"[^\w-]+", "_", heightfield.name)[:LONGEST_NAME]
        self.problem = ""
        self._terrain = heightfield.name
        self._path = None if folder is None else folder / "bookmarks" / f"{name}-{heightfield.sha256[:12]}.json"
        self.all = self._read() or ()

    def add(self, bookmark: Bookmark) -> None:
        """Keep a view; one of the same name is replaced."""
        self._change(lambda kept: (*(old for old in kept if old.name != bookmark.name), bookmark))

    def remove(self, name: str) -> None:
        self._change(lambda kept: tuple(old for old in kept if old.name != name))

    def rename(self, name: str, new_name: str) -> None:
        """Give a view another name, unless that is empty or taken."""
        new_name = new_name.strip()[:LONGEST_NAME]
        if new_name and all(new_name != old.name for old in self.all):
            self._change(lambda kept: tuple(Bookmark(new_name, o.camera) if o.name == name else o for o in kept))

    def take_over(self, old: Bookmarks) -> None:
        """Keep the bookmarks of what the terrain was before its file changed, where this one has none."""
        if old.all and not self.all:
            self._change(lambda kept: old.all)

    def free_name(self) -> str:
        """``"View 1"``, ``"View 2"`` ..., the first above all that are taken."""
        numbers = [int(found[1]) for old in self.all if (found := re.fullmatch(r"View (\d{1,9})", old.name))]
        return f"View {max(numbers, default=0) + 1}"

    def _change(self, edit: Any) -> None:
        read = self._read()
        self.all = edit(self.all if read is None else read)
        self._write()

    def _read(self) -> tuple[Bookmark, ...] | None:
        """What the file holds; None where nothing is kept or can be read."""
        if self._path is None:
            return None
        try:
            record = json.loads(self._path.read_text(encoding="utf-8"))
            if not isinstance(record, dict) or record.get("format") != FORMAT:
                raise ValueError("no bookmarks")
            return tuple({found.name: found for found in map(_parse, record["bookmarks"])}.values())
        except FileNotFoundError:
            return ()
        except OSError as error:
            self.problem = f"{self._path} cannot be read: {error.strerror or error}."
        except (ValueError, TypeError, KeyError, RecursionError):
            self._set_aside(self._path)
        return None

    def _set_aside(self, path: Path) -> None:
        """Keep a damaged file under another name."""
        aside = numbered_path(path.with_name(f"{path.stem}-damaged.json"))
        with contextlib.suppress(OSError):
            path.rename(aside)
        self.problem = f"The bookmarks of {self._terrain} could not be understood; the file is kept as {aside}."

    def _write(self) -> None:
        if self._path is None:
            return
        lines = ",\n  ".join(json.dumps(_record(bookmark), ensure_ascii=False) for bookmark in self.all)
        head = json.dumps({"format": FORMAT, "version": 1, "terrain": self._terrain}, ensure_ascii=False, indent=1)[:-2]
        temporary = self._path.with_name(f".{self._path.name}.{uuid.uuid4().hex}.part")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_text(f'{head},\n "bookmarks": [\n  {lines}\n ]\n}}\n', encoding="utf-8")
            temporary.replace(self._path)
        except OSError as error:
            self.problem = f"{self._path} cannot be written: {error.strerror or error}. Bookmarks last until you leave."
            with contextlib.suppress(OSError):
                temporary.unlink()


def _raised(camera: Camera, by_m: float) -> Camera:
    x, y, z = camera.position_m
    return Camera((x, y + by_m, z), camera.yaw_deg, camera.pitch_deg, camera.roll_deg, camera.fov_deg)


def _record(bookmark: Bookmark) -> dict[str, Any]:
    camera = bookmark.camera
    x, y, z = camera.position_m
    return {
        "name": bookmark.name, "x": x, "above_ground": y, "z": z,
        "yaw": camera.yaw_deg, "pitch": camera.pitch_deg, "roll": camera.roll_deg, "fov": camera.fov_deg,
    }  # fmt: skip


def _parse(item: dict[str, Any]) -> Bookmark:
    """A bookmark of the file; ValueError, TypeError or KeyError where it is none."""
    numbers = [item[key] for key in ("x", "above_ground", "z", "yaw", "pitch", "roll", "fov")]
    if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers) or not isinstance(item["name"], str):
        raise ValueError("no bookmark")
    x, y, z, *angles = map(float, numbers)
    return Bookmark(item["name"], Camera((x, y, z), *angles))
