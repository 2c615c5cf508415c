"""Compressed files: the one terrain inside, unpacked into a temporary folder.

GDAL reads archives itself, but seeks in them by decompressing from the start again and again; a bomb would have hours
of work there. Here every archive is streamed once, up to `MAX_UNPACKED_BYTES`.
"""

from __future__ import annotations

import bz2
import gzip
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Any

from terrain.errors import InputError
from terrain.progress import tell

MAX_UNPACKED_BYTES = 1 << 30
_MAX_ENTRIES = 100_000
_STREAMS: dict[str, Callable[[Path], Any]] = {".gz": gzip.GzipFile, ".bz2": bz2.BZ2File}
_SIDECARS = {
    *(".hdr", ".prj", ".tfw", ".wld", ".pgw", ".jgw", ".blw", ".clr", ".stx", ".rrd", ".ovr", ".msk", ".xml", ".json"),
    *(".txt", ".md", ".html", ".htm", ".pdf", ".doc", ".docx", ".rtf", ".csv", ".log", ".md5", ".sha256"),
    *(".dbf", ".shp", ".shx", ".cpg", ".sbn", ".sbx", ".kml", ".lyr", ".met"),
}
_PICTURES = (".jpg", ".jpeg", ".png", ".gif", ".bmp")
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError, ValueError)


@contextmanager
def unpacked(path: Path, notes: list[str]) -> Iterator[Path]:
    """The file itself, or while the block runs the one terrain inside it.

    Parameters
    ----------
    path : Path
    notes : list of str
        What was decided is added.

    Raises
    ------
    InputError
        If an archive is damaged, too large, or holds no terrain or more than one.
    """
    suffix = path.suffix.lower()
    if suffix not in (".zip", *_STREAMS):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="reliefscope-") as folder:
        try:
            if suffix == ".zip":
                inner = _from_zip(path, Path(folder), notes)
            else:
                inner = Path(folder) / path.stem
                with _STREAMS[suffix](path) as stream:
                    _copy(stream, inner, MAX_UNPACKED_BYTES, path)
        except _DAMAGED as error:
            reason = str(error) or type(error).__name__
            raise InputError(
                f"expected an intact {suffix} file, found {path.name} ({reason}); get a fresh copy, or unpack it"
            ) from error
        yield inner


def _from_zip(path: Path, folder: Path, notes: list[str]) -> Path:
    with zipfile.ZipFile(path) as archive:
        entries = [info for info in archive.infolist() if not info.is_dir() and "__MACOSX" not in info.filename]
        chosen = choose_entry([info.filename for info in entries], path.name)
        parent = PurePosixPath(chosen).parent
        size = 0
        for info in entries:
            name = PurePosixPath(info.filename)
            beside = name.parent == parent and (name.suffix.lower() in _SIDECARS or name.suffix.lower() == ".adf")
            if info.filename != chosen and not beside:
                continue
            size += info.file_size
            if size > MAX_UNPACKED_BYTES:
                raise _too_large(path)
            with archive.open(info) as stream:  # never gives more than file_size bytes
                _copy(stream, folder / name.name, info.file_size, path)  # the name alone: no way out of the folder
        notes.append(f"{chosen} was read from the archive {path.name}.")
        return folder / PurePosixPath(chosen).name


def choose_entry(names: list[str], archive: str) -> str:
    """The one name among an archive's that can be a terrain."""
    if len(names) > _MAX_ENTRIES:
        raise InputError(f"expected one terrain in {archive}, found {len(names)} files; unpack it yourself")
    suffixes = {name: PurePosixPath(name).suffix.lower() for name in names}
    # an ESRI binary grid is a folder of .adf files, named by its hdr.adf
    grids = [
        name
        for name in names
        if suffixes[name] not in _SIDECARS
        and not PurePosixPath(name).name.startswith(".")
        and (suffixes[name] != ".adf" or PurePosixPath(name).name.lower() == "hdr.adf")
    ]
    if len(grids) > 1:  # a preview may come along
        grids = [name for name in grids if suffixes[name] not in _PICTURES] or grids
    if len(grids) != 1:
        found = "none" if not grids else f"{len(grids)} ({', '.join(grids[:4])}{' ...' if len(grids) > 4 else ''})"
        raise InputError(f"expected exactly one terrain in {archive}, found {found}; unpack it and name one file")
    return grids[0]


def _copy(stream: IO[bytes], target: Path, limit: int, path: Path) -> None:
    left = limit
    with target.open("wb") as file:
        while block := stream.read(1 << 20):
            left -= len(block)
            if left < 0:
                raise _too_large(path)
            file.write(block)
            tell("unpacking", 1.0 - left / limit)


def _too_large(path: Path) -> InputError:
    return InputError(
        f"expected at most {MAX_UNPACKED_BYTES >> 20} MB unpacked, found more in {path.name}; unpack it yourself"
    )


def unpack_member(archive: zipfile.ZipFile, name: str, folder: Path, path: Path) -> Path:
    """Unpack one entry of an open archive (an array of a ``.npz``)."""
    target = folder / "member.npy"
    if archive.getinfo(name).file_size > MAX_UNPACKED_BYTES:
        raise _too_large(path)
    with archive.open(name) as stream:
        _copy(stream, target, MAX_UNPACKED_BYTES, path)
    return target
