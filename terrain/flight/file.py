"""The flight file, ``*.flight.json``, and names that are still free.

One JSON object: ``format`` and ``version``; ``name``; ``terrain``, its ``crs`` and ``origin`` (easting and northing of
the north-west post), where it has them; ``keyframes``, each with ``t`` [s], ``position`` [m] (east of that post,
height, south of it) and, in degrees, ``yaw`` clockwise from north, ``pitch`` up, ``roll`` clockwise, vertical ``fov``.
"""

from __future__ import annotations

import json
import math
import os
import re
import uuid
from pathlib import Path
from typing import Any

from terrain.camera import Camera
from terrain.errors import InputError
from terrain.flight.path import Flight, Keyframe

FORMAT, VERSION = "reliefscope-flight", 1
_MAX_BYTES = 256 << 20  # a day at 20 keyframes a second


def read_flight(path: str | os.PathLike[str]) -> Flight:
    """Read and check a flight file.

    Raises
    ------
    InputError
        If it cannot be read, is no flight file, is newer than this program, or holds values that make no flight.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path} is no flight file: expected at most {_MAX_BYTES >> 20} MiB.")
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is no flight file: expected JSON, found that {_first_line(error)}.") from None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        found = record.get("format") if isinstance(record, dict) else type(record).__name__
        raise InputError(f'{path} is no flight file: expected "format": "{FORMAT}", found {found!r}.')
    version = record.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise InputError(f'{path}: expected "version": {VERSION}, found {version!r}.')
    if version > VERSION:
        raise InputError(
            f"{path} has version {version} of the flight format; this program reads up to {VERSION}: update it."
        )
    try:
        return _parse(record)
    except ValueError as error:
        raise InputError(f"{path}: {_first_line(error)}.") from None


def write_flight(flight: Flight, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a flight file: under a temporary name first, then renamed.

    Parameters
    ----------
    flight : Flight
    path : path-like
    overwrite : bool
        Whether a file of that name may be replaced.

    Raises
    ------
    InputError
        If the file exists and may not be replaced, or the disk refuses.
    """
    write_text(Path(path), _format(flight), overwrite)


def write_text(path: Path, text: str, overwrite: bool = False) -> None:
    """Write a text file under a temporary name and rename it; raises as `write_flight` does."""
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
    is_claimed = False
    try:
        temporary.write_text(text, encoding="utf-8")
        if overwrite or not _linked(temporary, path):
            if not overwrite:
                path.touch(exist_ok=False)  # claims the name: of two processes only one gets past this line
                is_claimed = True
            temporary.replace(path)
    except FileExistsError:
        raise InputError(f"{path} exists already and is not overwritten. Choose another name.") from None
    except OSError as error:
        if is_claimed:
            path.unlink(missing_ok=True)
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    finally:
        temporary.unlink(missing_ok=True)


def numbered_path(path: str | os.PathLike[str]) -> Path:
    """The next free name of a series: ``alps.flight.json`` gives ``alps-1.flight.json``, then ``alps-2.flight.json``.

    One above the highest number in the folder, whatever has been deleted below it. The name is not taken yet: writers
    that never overwrite decide who gets it.
    """
    path = Path(path)
    stem, dot, suffix = path.name.partition(".")
    pattern = re.compile(re.escape(stem) + r"-(\d{1,9})" + re.escape(dot + suffix), re.IGNORECASE)
    try:
        taken = [int(match[1]) for name in os.listdir(path.parent) if (match := pattern.fullmatch(name))]
    except OSError:
        taken = []  # the writer says what is wrong with the folder
    return path.with_name(f"{stem}-{max(taken, default=0) + 1}{dot}{suffix}")


def _linked(temporary: Path, path: Path) -> bool:
    """Give a whole file its name in one step, unless the name is taken; False where the disk knows no links."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:
        return False
    return True


def _parse(record: dict[str, Any]) -> Flight:
    keyframes = record.get("keyframes")
    if not isinstance(keyframes, list):
        raise ValueError(f"expected a list of keyframes, found {type(keyframes).__name__}")
    name, terrain, crs = (record.get(field) for field in ("name", "terrain", "crs"))
    for field, text in (("name", name), ("terrain", terrain), ("crs", crs)):
        if text is not None and not isinstance(text, str):
            raise ValueError(f'expected text or null for "{field}", found {text!r:.40}')
    origin = None if record.get("origin") is None else _numbers(record["origin"], 2, "origin")
    keys = tuple(_parse_keyframe(key, number) for number, key in enumerate(keyframes, 1))
    return Flight(keys, name or "flight", terrain or "", crs, None if origin is None else (origin[0], origin[1]))


def _parse_keyframe(key: Any, number: int) -> Keyframe:
    if not isinstance(key, dict):
        raise ValueError(f"expected an object for keyframe {number}, found {key!r:.40}")
    for field in ("t", "position"):
        if field not in key:
            raise ValueError(f'keyframe {number} lacks "{field}"')
    x, y, z = _numbers(key["position"], 3, f"position of keyframe {number}")
    t, yaw, pitch, roll, fov = (
        _number(key.get(field, default), f"{field} of keyframe {number}")
        for field, default in (("t", 0.0), ("yaw", 0.0), ("pitch", 0.0), ("roll", 0.0), ("fov", 60.0))
    )
    if not 0.0 < fov < 180.0:
        raise ValueError(f"expected a field of view between 0 and 180 degrees at keyframe {number}, found {fov}")
    return Keyframe(t, Camera((x, y, z), yaw, pitch, roll, fov))


def _numbers(values: Any, count: int, what: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise ValueError(f"expected {count} numbers for the {what}, found {values!r:.60}")
    return [_number(value, what) for value in values]


def _number(value: Any, what: str) -> float:
    # A whole number too long for a float is as bad as infinity.
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
    if not is_number or not math.isfinite(value):
        raise ValueError(f"expected a finite number for the {what}, found {value!r:.40}")
    return float(value)


def _format(flight: Flight) -> str:
    """JSON with one keyframe a line, so that people can read and compare flights."""
    head = {
        "format": FORMAT,
        "version": VERSION,
        "name": flight.name,
        "terrain": flight.terrain,
        "crs": flight.crs,
        "origin": flight.origin,
    }
    lines = [json.dumps(_record(key)) for key in flight.keyframes]
    top = json.dumps(head, indent=1)[:-2]
    return top + ',\n "keyframes": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"


def _record(key: Keyframe) -> dict[str, Any]:
    camera = key.camera
    return {
        "t": key.t_s,
        "position": [float(p) for p in camera.position_m],
        "yaw": camera.yaw_deg,
        "pitch": camera.pitch_deg,
        "roll": camera.roll_deg,
        "fov": camera.fov_deg,
    }


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")
