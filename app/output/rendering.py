"""Off screen: a camera or a flight drawn into pictures, frames, films and arrays of positions.

A picture larger than `TILE_PX` is drawn in tiles: no GPU draws 16,000 pixels at once, and a window that lives on while
it exports must not wait for a large picture. What is drawn is chosen once, for the whole picture, so that tiles meet.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.output.capture import Picture, Sink, open_png, refuse_existing
from app.output.whereabouts import is_straight_down, picture_notes, world_file, world_file_path
from terrain.camera import Camera
from terrain.flight.file import write_text

TILE_PX = 2048
LARGEST_CALIBRATED_PX = 4096  # a renderer that measures the GPU at its picture's size measures at this one at most


def flight_times(duration_s: float, frames: int | None, fps: int) -> list[float]:
    """Times of the pictures of a flight [s].

    ``frames`` pictures from its first to its last moment; without a number, one every ``1 / fps``, so that a film plays
    at the speed of the flight.
    """
    if frames is None:
        return [i / fps for i in range(max(1, int(duration_s * fps + 1e-6) + 1))]
    return [0.0] if frames == 1 else np.linspace(0.0, duration_s, frames).tolist()


def draw_bands(
    stage: Any, camera: Camera, size_px: tuple[int, int], view: Any, time_s: float = 0.0, tile_px: int = TILE_PX
) -> Iterator[Picture | None]:
    """One picture as bands of rows from the top, and None after each tile but a band's last.

    What is read piece by piece (images on the terrain) is waited for: None is given out meanwhile.
    """
    if max(size_px) > LARGEST_CALIBRATED_PX:
        stage.render(camera, (TILE_PX, max(TILE_PX * size_px[1] // size_px[0], 1)), view, time_s)
    frame = stage.frame(camera, size_px, time_s)
    columns, rows = (_split(length, tile_px) for length in size_px)
    is_first = True
    for bottom, top in reversed(rows):
        parts = []
        for left, right in columns:
            tile = frame if len(rows) * len(columns) == 1 else frame.tile((left, bottom), (right - left, top - bottom))
            while not stage.load_tiles(tile):
                yield None
            target = stage.target(tile.viewport_px)
            stage.draw(tile, target, view, choose=is_first)
            is_first = False
            parts.append(target.read()[..., :3])
            if right < size_px[0]:
                yield None
        yield np.ascontiguousarray(np.concatenate(parts, axis=1))


def draw_slowly(
    stage: Any, camera: Camera, size_px: tuple[int, int], view: Any, time_s: float = 0.0, tile_px: int = TILE_PX
) -> Generator[None, None, Picture]:
    """One picture (height, width, 3), as what the generator returns; it yields after each tile."""
    bands = []
    for band in draw_bands(stage, camera, size_px, view, time_s, tile_px):
        if band is not None:
            bands.append(band)
        yield
    return bands[0] if len(bands) == 1 else np.concatenate(bands)


def draw_pictures(
    stage: Any, cameras: Sequence[Camera], times_s: Sequence[float], size_px: tuple[int, int], view: Any,
    animates: bool = False,
) -> Iterator[Picture]:  # fmt: skip
    """The picture (height, width, 3) of each camera in turn; ``animates`` lets the layers' time run with them."""
    for number, (camera, time_s) in enumerate(zip(cameras, times_s, strict=True)):
        if animates:
            stage.animate_layers(number / max(len(times_s) - 1, 1))
        bands = [band for band in draw_bands(stage, camera, size_px, view, time_s) if band is not None]
        yield bands[0] if len(bands) == 1 else np.concatenate(bands)


def save_picture(
    stage: Any, camera: Camera, size_px: tuple[int, int], view: Any, time_s: float, path: Path, overwrite: bool = False
) -> None:
    """One picture as PNG that says where it was taken; of a view straight down with a world file beside it."""
    for _ in save_slowly(stage, camera, size_px, view, time_s, path, overwrite):
        pass


def save_slowly(
    stage: Any, camera: Camera, size_px: tuple[int, int], view: Any, time_s: float, path: Path, overwrite: bool = False,
    tile_px: int = TILE_PX,
) -> Iterator[float]:  # fmt: skip
    """`save_picture` in steps of a tile, each telling the share that is done."""
    terrain, renderer = stage.scene.heightfield, stage.renderer
    notes = picture_notes(camera, terrain, algorithm=renderer.name, tolerance_px=renderer.settings.tolerance_px)
    beside = world_file_path(path) if is_straight_down(camera) else None
    if beside is not None:
        refuse_existing(beside, overwrite)
    rows = 0
    with open_png(path, size_px, notes, overwrite) as png:
        for band in draw_bands(stage, camera, size_px, view, time_s, tile_px):
            if band is not None:
                png.add(band)
                rows += len(band)
            yield rows / size_px[1]
    if beside is not None:
        write_text(beside, world_file(camera, terrain, size_px), overwrite)


def _split(length: int, most: int) -> list[tuple[int, int]]:
    """A length in parts of one size, none above ``most``, the last one smaller.

    Parts begin at multiples of 8: pixels stay in the same blocks, where shaders look at neighbours or start together.
    """
    if length <= most:
        return [(0, length)]
    step = min(8 * math.ceil(length / math.ceil(length / most) / 8), most // 8 * 8)
    return [(start, min(start + step, length)) for start in range(0, length, step)]


def write_pictures(pictures: Iterable[Picture], count: int, sinks: Sequence[Sink], label: str) -> None:
    """Give each picture to every sink, with a progress bar on stderr where there is more than one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    silent = count < 2 or not console.is_terminal
    with Progress(*columns, console=console, disable=silent, transient=True) as progress:
        task = progress.add_task(label, total=count)
        for picture in pictures:
            for sink in sinks:
                sink.add(picture)
            progress.advance(task)
