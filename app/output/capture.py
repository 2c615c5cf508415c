"""Pictures on disk: PNG files, folders of frames, films.

Everything is written under a temporary name beside its place and renamed when it is complete; what exists already is
replaced only where the caller says so.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from app.output.png import PngWriter
from terrain.errors import InputError

FILE_SUFFIXES = (".png", ".mp4")
CODECS = {
    "h264": ("libx264", {"preset": "veryfast", "crf": "18"}, "H.264: plays everywhere"),
    "av1": ("libsvtav1", {"preset": "8", "crf": "25"}, "AV1: half the size, needs a newer player"),
}
"""Name of a codec: its encoder, the encoder's options, one sentence."""
Picture = npt.NDArray[np.uint8]
"""(height, width, 3) RGB, row 0 at the top."""


class Sink(Protocol):
    """Takes pictures one after the other; a context manager that finishes what it began."""

    def add(self, picture: Picture) -> None: ...
    def __enter__(self) -> Sink: ...
    def __exit__(self, kind: Any, error: Any, trace: Any) -> None: ...


def refuse_existing(path: Path, overwrite: bool = False) -> None:
    """Raise `InputError` where ``path`` exists and may not be replaced, or its folder cannot be written."""
    if path.is_dir():
        raise InputError(f"Expected a file to write, found the folder {path}. Name a file in it.")
    if path.exists() and not overwrite:
        raise InputError(f"{path} exists already and is not overwritten. Choose another name, or add --overwrite.")
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} does not exist. Make it first, or write elsewhere.")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"The folder {path.parent} cannot be written. Write elsewhere, or change its permissions.")


@contextlib.contextmanager
def replacing(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary name that becomes ``path`` when the block ends well, and is deleted when it does not.

    Raises
    ------
    InputError
        If ``path`` exists and may not be replaced, or the disk refuses.
    """
    refuse_existing(path, overwrite)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        refuse_existing(path, overwrite)  # another process may have been quicker
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    finally:
        temporary.unlink(missing_ok=True)


def save_png(path: Path, picture: Picture, overwrite: bool = False, notes: Mapping[str, str] | None = None) -> None:
    """Write one picture as PNG, with words about it in the file."""
    with open_png(path, (picture.shape[1], picture.shape[0]), notes or {}, overwrite) as png:
        png.add(picture)


@contextlib.contextmanager
def open_png(
    path: Path, size_px: tuple[int, int], notes: Mapping[str, str], overwrite: bool = False
) -> Iterator[PngWriter]:
    """A PNG file to be filled row by row; it appears when it is complete."""
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        png = PngWriter(file, size_px, notes)
        yield png
        png.finish()


def save_array(path: Path, array: npt.NDArray[Any], overwrite: bool = False) -> None:
    """Write one array as ``.npy``."""
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        np.save(file, array)


class FrameFolder:
    """A folder of ``frame_0000.png``, ``frame_0001.png`` ...; the folder is made where it is missing.

    Raises
    ------
    InputError
        If the folder holds frames already and ``overwrite`` is off.
    """

    def __init__(self, folder: Path, overwrite: bool = False) -> None:
        self._folder, self._overwrite, self._count = folder, overwrite, 0
        refuse_frames(folder, overwrite)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"The folder {folder} cannot be made: {error.strerror}.") from None

    def add(self, picture: Picture) -> None:
        save_png(self._folder / f"frame_{self._count:04d}.png", picture, self._overwrite)
        self._count += 1

    def __enter__(self) -> FrameFolder:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        pass


class Film:
    """An MP4 film. Cancelled it keeps the frames it has; after an error nothing is left.

    Parameters
    ----------
    path : Path
    size_px : tuple of int
        ``(width, height)``; odd sizes lose their last column or row, which the format cannot hold.
    fps : int
    overwrite : bool
    codec : {"h264", "av1"}
    """

    def __init__(
        self, path: Path, size_px: tuple[int, int], fps: int, overwrite: bool = False, codec: str = "h264"
    ) -> None:
        import av  # 60 ms to import

        encoder, options, _ = CODECS[codec]
        refuse_codec(codec)

        self._width, self._height = (n - n % 2 for n in size_px)
        if min(self._width, self._height) < 2:
            raise InputError(
                f"A film needs at least 2 x 2 pixels, found {size_px[0]}x{size_px[1]}. Use a larger --size."
            )
        self._count = 0
        self._stack = contextlib.ExitStack()
        temporary = self._stack.enter_context(replacing(path, overwrite))
        self._container = av.open(str(temporary), "w", format="mp4")
        self._stream = cast(Any, self._container.add_stream(encoder, rate=fps, options=options))
        self._stream.width, self._stream.height, self._stream.pix_fmt = self._width, self._height, "yuv420p"

    def add(self, picture: Picture) -> None:
        import av

        self._count += 1
        cropped = np.ascontiguousarray(picture[: self._height, : self._width])
        frame = av.VideoFrame.from_ndarray(cropped, format="rgb24")
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        keep = self._count > 0 and (
            kind is None or not issubclass(kind, Exception)
        )  # cancelled: Ctrl+C, or a closed task
        if keep:
            for packet in self._stream.encode():
                self._container.mux(packet)
        self._container.close()
        # The renaming block ends well, or sees an error and deletes.
        lost = kind or InterruptedError
        self._stack.__exit__(None, None, None) if keep else self._stack.__exit__(lost, error or lost(), trace)


def refuse_codec(codec: str) -> None:
    """Raise `InputError` where the video library has no encoder for a codec."""
    import av

    encoder = CODECS[codec][0]
    if encoder not in av.codec.codecs_available:
        raise InputError(f"This installation of PyAV has no {encoder} to write {codec}; use --codec h264.")


def refuse_frames(folder: Path, overwrite: bool = False) -> None:
    """Raise `InputError` where ``folder`` is a file, or holds frames that may not be replaced."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"Expected a folder for the frames, found the file {folder}. Choose another name.")
    if folder.is_dir() and not overwrite and any(folder.glob("frame_*.png")):
        raise InputError(f"{folder} holds frames already. Choose another folder, or add --overwrite.")


def refuse_output(out: Path, overwrite: bool = False) -> None:
    """Raise `InputError` where `open_sink` would: asked before the work begins."""
    (refuse_existing if out.suffix.lower() in FILE_SUFFIXES else refuse_frames)(out, overwrite)


def open_sink(out: Path, size_px: tuple[int, int], fps: int, overwrite: bool = False, codec: str = "h264") -> Sink:
    """What ``out`` names: ``.mp4`` a film, anything else a folder of frames."""
    if out.suffix.lower() == ".mp4":
        return Film(out, size_px, fps, overwrite, codec)
    return FrameFolder(out, overwrite)
